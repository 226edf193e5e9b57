//! Which bearing, which element: envelope lines → verdicts.
//!
//! Lines are accepted one at a time, the strongest of the whole machine first; what an accepted line
//! explains (its harmonics and side bands, heard anywhere) no longer counts for another. Two gates:
//! the combined false-alarm probability over the bands, and the effect size (docs/theory.md, C1–C4,
//! S1). A significant line of small effect is evidence, not a verdict.

use super::Context;
use super::confidence;
use super::fault::ComponentKind;
use super::fault::FaultMode;
use super::fault::State;
use super::severity;
use super::verdict::ComponentDiagnosis;
use super::verdict::Evidence;
use super::verdict::OtherFault;
use crate::features::WindowFeatures;
use crate::features::absolute::AbsoluteLine;
use crate::features::bearing::BandReading;
use crate::features::bearing::DefectLine;
use crate::features::bearing::LineSearch;
use crate::features::bearing::Unreadable;
use crate::machine::BearingIndex;
use crate::units::Hz;
use crate::units::Unit;

/// Lines of several elements: the strongest must lead the next by this power ratio (6 dB).
const LEAD_POWER_RATIO: f64 = 4.0;

/// A significant line this deep competes with a stronger one; below, it is a trace of it.
const COMPETING_DEPTH: f64 = severity::WARNING_DEPTH / 2.0;

/// A band counts as showing a line at this probability.
const BAND_PROBABILITY: f64 = 1e-4;

/// Lines of several elements in at least this part of the bands, of too little effect to accuse, are
/// more than chance and less than a verdict: structural lines fill one of four bands at most.
const AMBIGUOUS_PART: f64 = 0.25 + 1e-9;

/// Such lines must at least be this deep.
const AMBIGUOUS_DEPTH: f64 = 0.15;

/// Relative error allowed when a line is matched to another's harmonic.
const MATCH_TOLERANCE: f64 = 5e-4;

/// A line of one bearing, read in one channel, after what is explained has been taken out.
#[derive(Debug, Clone)]
struct Candidate<'a> {
    search: &'a LineSearch,
    n_bands: usize,
    n_showing: usize,
    probability: f64,
    best: Option<&'a BandReading>,
}

/// An accepted line, and what it explains elsewhere.
#[derive(Debug, Clone, Copy)]
struct Accepted<'a> {
    bearing: BearingIndex,
    line: DefectLine,
    frequency: Hz,
    spacing: Hz,
    search: &'a LineSearch,
}

impl Accepted<'_> {
    /// Whether `frequency` is a harmonic or side band of this line.
    fn explains(&self, frequency: Hz, resolution: Hz) -> bool {
        (0..=4).any(|k| {
            (-2..=2).filter(|m| k != 0 || *m != 0).any(|m| {
                let place = f64::from(k) * self.frequency.0 + f64::from(m) * self.spacing.0;
                (frequency.0 - place).abs() <= resolution.0 + MATCH_TOLERANCE * place.abs()
            })
        })
    }
}

impl<'a> Candidate<'a> {
    fn depth(&self) -> f64 {
        self.best.map_or(0.0, BandReading::total_depth)
    }

    fn part(&self) -> f64 {
        if self.n_bands == 0 { 0.0 } else { self.n_showing as f64 / self.n_bands as f64 }
    }

    /// Power the line carries in its best band: what decides who hears it best.
    fn line_power(&self) -> f64 {
        self.best.map_or(0.0, |b| b.total_depth() * b.mean_square)
    }

    fn power_ratio(&self) -> f64 {
        let fundamental = self.best.and_then(|b| b.harmonics[0]);
        fundamental.map_or(0.0, |h| h.power_ratio)
    }

    /// Weighs one search, leaving out readings that accepted lines explain. `n_looks`: searches of
    /// this bearing among which the strongest is picked.
    fn weigh(search: &'a LineSearch, accepted: &[Accepted<'_>], n_looks: f64) -> Self {
        let readings = search.outcome.as_deref().unwrap_or(&[]);
        // A line is weighed as it was accepted: against those accepted before it.
        let before =
            accepted.iter().take_while(|a| (a.bearing, a.line) != (search.bearing, search.line));
        let before: Vec<&Accepted<'_>> = before.collect();
        let own =
            |r: &BandReading| !before.iter().any(|a| a.explains(r.frequency, search.resolution));
        let probabilities: Vec<f64> = readings
            .iter()
            .map(|r| if own(r) { confidence::band_probability(r) } else { 1.0 })
            .collect();
        let showing =
            |r: &&BandReading| own(r) && confidence::band_probability(r) <= BAND_PROBABILITY;
        let best = readings
            .iter()
            .filter(showing)
            .max_by(|a, b| a.total_depth().total_cmp(&b.total_depth()));
        Self {
            search,
            n_bands: readings.len(),
            n_showing: readings.iter().filter(showing).count(),
            probability: (confidence::combine(&probabilities) * n_looks).min(1.0),
            best,
        }
    }

    fn is_proven(&self) -> bool {
        self.probability <= confidence::FALSE_ALARM_PROBABILITY
            && self.depth() >= severity::WARNING_DEPTH
    }
}

/// Judges all bearings.
#[must_use]
pub fn judge(features: &WindowFeatures, context: &Context<'_>) -> Vec<ComponentDiagnosis> {
    let accepted = accept(features);
    (0..context.machine.bearings.len())
        .map(|b| judge_one(BearingIndex(b), features, context, &accepted))
        .collect()
}

fn n_looks(features: &WindowFeatures, bearing: BearingIndex) -> f64 {
    features.bearing_lines.iter().filter(|s| s.bearing == bearing && s.outcome.is_ok()).count()
        as f64
}

/// Accepts proven lines, strongest first, until none is left that the accepted do not explain.
///
/// Cage lines come last and only for bearings without another: every defect's line carries the
/// cage rate as soon as the elements differ from one another.
fn accept(features: &WindowFeatures) -> Vec<Accepted<'_>> {
    let mut accepted = Vec::new();
    accept_among(features, &mut accepted, |line| line != DefectLine::Ftf);
    let with_race: Vec<BearingIndex> = accepted.iter().map(|a| a.bearing).collect();
    accept_among(features, &mut accepted, |line| line == DefectLine::Ftf);
    accepted.retain(|a| a.line != DefectLine::Ftf || !with_race.contains(&a.bearing));
    accepted
}

fn accept_among<'a>(
    features: &'a WindowFeatures,
    accepted: &mut Vec<Accepted<'a>>,
    eligible: impl Fn(DefectLine) -> bool,
) {
    loop {
        let next = features
            .bearing_lines
            .iter()
            .filter(|s| eligible(s.line))
            .filter(|s| !accepted.iter().any(|a| (a.bearing, a.line) == (s.bearing, s.line)))
            .map(|s| Candidate::weigh(s, accepted, n_looks(features, s.bearing)))
            .filter(Candidate::is_proven)
            .max_by(|a, b| (a.depth() * a.part()).total_cmp(&(b.depth() * b.part())));
        let Some((candidate, best)) = next.as_ref().and_then(|c| c.best.map(|b| (c, b))) else {
            return;
        };
        let search = heard_best(features, candidate, best.frequency);
        accepted.push(Accepted {
            bearing: search.bearing,
            line: search.line,
            frequency: best.frequency,
            spacing: search.shaft_speed,
            search,
        });
    }
}

/// Among equal bearings the line belongs to the one whose sensor shows it with the most power.
fn heard_best<'a>(
    features: &'a WindowFeatures,
    candidate: &Candidate<'a>,
    frequency: Hz,
) -> &'a LineSearch {
    features
        .bearing_lines
        .iter()
        .filter(|s| s.line == candidate.search.line)
        .map(|s| Candidate::weigh(s, &[], n_looks(features, s.bearing)))
        .filter(|c| c.is_proven())
        .filter(|c| {
            let near = c.search.resolution.0 + MATCH_TOLERANCE * frequency.0;
            c.best.is_some_and(|b| (b.frequency.0 - frequency.0).abs() <= near)
        })
        .max_by(|a, b| a.line_power().total_cmp(&b.line_power()))
        .map_or(candidate.search, |c| c.search)
}

/// Judges one bearing by the lines accepted for it.
fn judge_one(
    bearing: BearingIndex,
    features: &WindowFeatures,
    context: &Context<'_>,
    accepted: &[Accepted<'_>],
) -> ComponentDiagnosis {
    let searches: Vec<&LineSearch> =
        features.bearing_lines.iter().filter(|s| s.bearing == bearing).collect();
    let mut verdict = blank(bearing, context);
    if let Some(why) = cannot_look(bearing, &searches, features, context) {
        verdict.why = why;
        return verdict;
    }
    let looks = n_looks(features, bearing);
    let candidates: Vec<Candidate<'_>> = searches
        .iter()
        .filter(|s| s.outcome.is_ok())
        .map(|s| Candidate::weigh(s, accepted, looks))
        .collect();
    verdict.evidence = evidence(bearing, &candidates, features, context);
    let own: Vec<&Accepted<'_>> = accepted.iter().filter(|a| a.bearing == bearing).collect();
    let proven: Vec<&Candidate<'_>> = own
        .iter()
        .filter_map(|a| candidates.iter().find(|c| std::ptr::eq(c.search, a.search)))
        .collect();
    match proven.first() {
        Some(first) => accuse(&mut verdict, first, &proven[1..], &candidates, features, context),
        None => acquit(&mut verdict, &candidates, &searches, accepted, features),
    }
    verdict
}

fn blank(bearing: BearingIndex, context: &Context<'_>) -> ComponentDiagnosis {
    ComponentDiagnosis {
        id: context.machine.bearings[bearing.0].id.clone(),
        kind: ComponentKind::Bearing,
        state: State::Undetermined,
        fault: None,
        severity: None,
        confidence: None,
        why: String::new(),
        evidence: Vec::new(),
        other_faults: Vec::new(),
        gear: None,
    }
}

/// Why the races of a bearing could not be looked at, if so.
fn cannot_look(
    bearing: BearingIndex,
    searches: &[&LineSearch],
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Option<String> {
    let described = &context.machine.bearings[bearing.0];
    if described.geometry.is_none() {
        let name = described.catalogue.as_deref().unwrap_or("unnamed");
        return Some(format!(
            "geometry of `{name}` is not known: state elements and diameters in the machine file"
        ));
    }
    if features.speed.first.is_none() {
        return Some("shaft speed is not known".to_owned());
    }
    if searches.is_empty() {
        return Some("no usable vibration channel at this bearing or its shaft".to_owned());
    }
    let races = [DefectLine::Bpfi, DefectLine::Bpfo];
    let blocked = races.into_iter().find_map(|line| {
        let mut of_line = searches.iter().filter(|s| s.line == line);
        if of_line.clone().any(|s| s.outcome.is_ok()) {
            return None;
        }
        of_line.find_map(|s| s.outcome.as_ref().err().map(|e| unreadable(s, e)))
    });
    blocked
}

fn unreadable(search: &LineSearch, reason: &Unreadable) -> String {
    let line = format!("{} {:.1} Hz", search.line.name(), search.expected.0);
    match reason {
        Unreadable::TooSlow { usable, needed } => format!(
            "sampled too slowly: {line} is out of reach, a band up to {:.0} Hz is needed and {:.0} Hz are there",
            needed.0, usable.0
        ),
        Unreadable::TooShort { needed_s } => {
            format!(
                "window too short: {line} needs {needed_s:.1} s to be told from shaft harmonics"
            )
        }
        Unreadable::Coincides { with } => {
            format!(
                "{line} coincides with {with} within the resolution of {:.2} Hz",
                search.resolution.0
            )
        }
    }
}

/// Fills in an accusation: the strongest line names the fault unless another element competes.
fn accuse(
    verdict: &mut ComponentDiagnosis,
    first: &Candidate<'_>,
    others: &[&Candidate<'_>],
    candidates: &[Candidate<'_>],
    features: &WindowFeatures,
    context: &Context<'_>,
) {
    let depth = first.depth();
    let severity = severity::of_depth(depth);
    let rival = candidates
        .iter()
        .filter(|c| c.search.line != first.search.line && c.search.line != DefectLine::Ftf)
        .filter(|c| {
            c.probability <= confidence::FALSE_ALARM_PROBABILITY && c.depth() >= COMPETING_DEPTH
        })
        .max_by(|a, b| a.power_ratio().total_cmp(&b.power_ratio()));
    let leads = rival.is_none_or(|r| {
        first.power_ratio() >= LEAD_POWER_RATIO * r.power_ratio() && first.n_showing > r.n_showing
    });
    verdict.why = sentence(first, context);
    verdict.severity = Some(severity);
    if leads {
        verdict.state = severity::state(severity);
        verdict.fault = Some(fault_of(first.search.line, context, verdict));
        verdict.confidence = Some(confidence_in(first, features));
        verdict.other_faults = others
            .iter()
            .map(|c| OtherFault {
                fault: fault_of(c.search.line, context, verdict),
                severity: severity::of_depth(c.depth()),
                confidence: confidence_in(c, features),
                why: sentence(c, context),
            })
            .collect();
    } else if let Some(rival) = rival {
        verdict.state = State::Warning;
        verdict.severity = Some(severity.min(severity::DAMAGED - 1e-6));
        verdict.confidence = Some(0.7 * features.speed.confidence);
        verdict.why = format!(
            "lines of several elements: {} and {}; none leads by 6 dB, cause not proven",
            sentence(first, context),
            rival.search.line.name()
        );
    }
}

/// Which element a line accuses.
fn fault_of(line: DefectLine, _context: &Context<'_>, _verdict: &ComponentDiagnosis) -> FaultMode {
    match line {
        DefectLine::Bpfi => FaultMode::InnerRace,
        DefectLine::Bpfo => FaultMode::OuterRace,
        DefectLine::TwoBsf => FaultMode::RollingElement,
        DefectLine::Ftf => FaultMode::Cage,
    }
}

/// Confidence that state and fault are right (C5). Not calibrated yet: the product of what the speed,
/// the agreement of bands and the distance from the threshold leave.
fn confidence_in(candidate: &Candidate<'_>, features: &WindowFeatures) -> f64 {
    let agreement = 0.6 + 0.4 * candidate.part();
    let margin = 1.0
        - 0.25 * (severity::WARNING_DEPTH / candidate.depth().max(severity::WARNING_DEPTH)).powi(2);
    let speed = 0.5 + 0.5 * features.speed.confidence;
    (agreement * margin * speed * (1.0 - candidate.probability)).min(0.99)
}

fn sentence(candidate: &Candidate<'_>, context: &Context<'_>) -> String {
    let Some(best) = candidate.best else { return String::new() };
    let over = 10.0 * candidate.power_ratio().max(1.0).log10();
    let harmonics = best.harmonics[1..]
        .iter()
        .flatten()
        .filter(|h| confidence::harmonic_tail(h) <= confidence::FALSE_ALARM_PROBABILITY)
        .count();
    let side = best
        .side_band
        .filter(|s| confidence::harmonic_tail(s) <= confidence::FALSE_ALARM_PROBABILITY)
        .map_or("no side bands", |_| match candidate.search.line {
            DefectLine::TwoBsf => "FTF side bands present",
            DefectLine::Bpfi | DefectLine::Bpfo | DefectLine::Ftf => "1× side bands present",
        });
    format!(
        "{} {:.1} Hz and {harmonics} of {} harmonics stand {over:.0} dB over the noise floor in the envelope of {}, \
         in {} of {} bands, {side}; modulation depth {:.2}",
        candidate.search.line.name(),
        best.frequency.0,
        best.harmonics.len() - 1,
        context.channel_name(candidate.search.channel),
        candidate.n_showing,
        candidate.n_bands,
        candidate.depth(),
    )
}

/// Healthy, or undetermined where the evidence is neither chance nor proof.
fn acquit(
    verdict: &mut ComponentDiagnosis,
    candidates: &[Candidate<'_>],
    searches: &[&LineSearch],
    accepted: &[Accepted<'_>],
    features: &WindowFeatures,
) {
    let strongest = candidates.iter().map(Candidate::depth).fold(0.0, f64::max);
    if let Some(why) = ambiguous(candidates) {
        verdict.why = why;
        return;
    }
    verdict.state = State::Healthy;
    verdict.severity = Some(severity::of_depth(strongest).min(severity::WARNING - 1e-6));
    verdict.confidence = Some(0.9 * (0.5 + 0.5 * features.speed.confidence));
    verdict.why = match candidates
        .iter()
        .filter(|c| c.n_showing > 0)
        .max_by(|a, b| a.depth().total_cmp(&b.depth()))
    {
        Some(c) if c.depth() > 0.0 => format!(
            "no defect line of effect: the deepest is {} with modulation depth {:.2} in {} of {} bands (accused from {:.2} in most)",
            c.search.line.name(),
            c.depth(),
            c.n_showing,
            c.n_bands,
            severity::WARNING_DEPTH
        ),
        Some(_) | None => "no defect line stands over the noise floor".to_owned(),
    };
    if !accepted.is_empty() {
        verdict.why.push_str("; lines of the accused bearing were set aside");
    }
    for line in DefectLine::ALL {
        let mut of_line = searches.iter().filter(|s| s.line == line);
        if of_line.clone().any(|s| s.outcome.is_ok()) {
            continue;
        }
        if let Some((search, reason)) =
            of_line.find_map(|s| s.outcome.as_ref().err().map(|e| (s, e)))
        {
            verdict.why.push_str("; not looked for: ");
            verdict.why.push_str(&unreadable(search, reason));
        }
    }
}

/// Lines of two elements in one channel, each in a quarter of the bands, none of effect.
fn ambiguous(candidates: &[Candidate<'_>]) -> Option<String> {
    let notable = |c: &&Candidate<'_>| c.depth() >= AMBIGUOUS_DEPTH && c.part() >= AMBIGUOUS_PART;
    let found: Vec<&Candidate<'_>> = candidates.iter().filter(notable).collect();
    let channel = found.iter().map(|c| c.search.channel).find(|channel| {
        found
            .iter()
            .filter(|c| c.search.channel == *channel && c.search.line != DefectLine::Ftf)
            .count()
            > 1
    })?;
    let names: Vec<&str> = found
        .iter()
        .filter(|c| c.search.channel == channel)
        .map(|c| c.search.line.name())
        .collect();
    Some(format!(
        "weak lines of several elements ({}): more than chance, too little effect to name a cause",
        names.join(", ")
    ))
}

/// The best reading of each line, and the absolute-vibration lines.
fn evidence(
    bearing: BearingIndex,
    candidates: &[Candidate<'_>],
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Vec<Evidence> {
    let mut found = Vec::new();
    for line in DefectLine::ALL {
        let of_line = candidates.iter().filter(|c| c.search.line == line);
        if let Some(best) = of_line.max_by(|a, b| {
            (a.depth(), -a.probability)
                .partial_cmp(&(b.depth(), -b.probability))
                .unwrap_or(std::cmp::Ordering::Equal)
        }) {
            found.push(envelope_evidence(best, context));
        }
    }
    let absolute = features.absolute_lines.iter().filter(|l| l.bearing == bearing);
    found.extend(absolute.map(|l| absolute_evidence(l, context)));
    found
}

fn envelope_evidence(candidate: &Candidate<'_>, context: &Context<'_>) -> Evidence {
    let search = candidate.search;
    Evidence {
        indicator: format!("envelope_line_{}", search.line.slug()),
        channel: context.channel_name(search.channel).to_owned(),
        detector: None,
        frequency: candidate.best.map(|b| b.frequency),
        expected: Some(search.expected),
        order: candidate.best.map(|b| b.frequency.0 / search.shaft_speed.0),
        value: candidate.depth(),
        unit: Unit::One,
        threshold: Some(severity::WARNING_DEPTH),
        false_alarm_probability: Some(candidate.probability),
        sample_range: Some(search.sample_range),
    }
}

fn absolute_evidence(line: &AbsoluteLine, context: &Context<'_>) -> Evidence {
    let (x, y) = line.pair;
    let tail = line.reading.harmonics[0].map_or(1.0, |h| confidence::harmonic_tail(&h));
    // Power ratio at which one search of this width reaches the declared probability.
    let z = line.reading.harmonics[0].map_or(0.0, |h| {
        let per_cell = confidence::FALSE_ALARM_PROBABILITY / h.n_cells;
        h.floor_dof * (per_cell.powf(-1.0 / h.floor_dof) - 1.0)
    });
    Evidence {
        indicator: format!("absolute_vibration_{}", line.line.slug()),
        channel: format!("{}+{}", context.channel_name(x), context.channel_name(y)),
        detector: Some(super::fault::Detector::ZeroToPeak),
        frequency: Some(line.reading.frequency),
        expected: Some(line.expected),
        order: None,
        value: line.amplitude,
        unit: context.channels[x.0].unit,
        threshold: Some(line.floor * z.sqrt()),
        false_alarm_probability: Some(tail),
        sample_range: Some(line.sample_range),
    }
}
