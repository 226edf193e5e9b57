//! Which bearing, which element: envelope lines → verdicts.
//!
//! Lines are accepted one at a time, the strongest of the whole machine first; what an accepted line
//! explains (its harmonics and side bands, heard anywhere) no longer counts for another. Two gates:
//! the combined false-alarm probability over the bands, and the effect size (docs/theory.md, C1–C5,
//! S1), and what leaves a bearing open besides (C9 to C52, C54, C55; C53 reads once more). A significant line of small effect is evidence, not a verdict.

mod accept;
mod acquit;
mod alone;
mod between;
mod blows;
mod candidate;
mod doubt;
mod evidence;
mod grown;
mod looked;
mod lower;
mod mains;
mod nobodys;
mod owner;
mod place;
mod power;
mod risen;
mod said;
mod something_else;
mod struck;

use super::Context;
use super::confidence;
use super::fault::ComponentKind;
use super::fault::FaultMode;
use super::fault::State;
use super::sensor;
use super::severity;
use super::verdict::ComponentDiagnosis;
use super::verdict::OtherFault;
use crate::features::Elsewhere;
use crate::features::WindowFeatures;
use crate::features::bearing::DefectLine;
use crate::features::bearing::LineSearch;
use crate::features::speed::Speed;
use crate::features::speed::SpeedSource;
use crate::machine::BearingIndex;
use crate::signal::ChannelIndex;
use accept::Accepted;
pub use between::BETWEEN_EVENTS;
use candidate::Candidate;
use doubt::Seen;
use doubt::Sorted;
use grown::Growth;
pub use place::Unplaced;
use struck::Struck;

/// Lines of several elements: the strongest must lead the next by this power ratio (6 dB).
const LEAD_POWER_RATIO: f64 = 4.0;

/// A significant line this deep competes with a stronger one; below, it is a trace of it.
const COMPETING_DEPTH: f64 = severity::WARNING_DEPTH / 2.0;

/// Judges all bearings, and tells of damage that no single one can be accused of.
#[must_use]
pub fn judge(
    features: &WindowFeatures,
    context: &Context<'_>,
) -> (Vec<ComponentDiagnosis>, Option<Unplaced>) {
    let context = &paid_for_ways(context);
    let accepted = accept::accept(features);
    let (mut verdicts, unplaced): (Vec<_>, Vec<_>) =
        judge_all(features, context, &accepted).into_iter().unzip();
    // A line that stands confirms the speed as well as slip lets it, and what it is of strikes.
    if accepted.is_empty() {
        features.elsewhere.iter().for_each(|other| reopen(&mut verdicts, other, features, context));
        blows::reopen(&mut verdicts, features, context);
    }
    let open = unplaced.into_iter().flatten().filter(|found| is_open(found, &verdicts));
    let worst = open.max_by(|a, b| a.severity.total_cmp(&b.severity));
    if worst.is_none() && nobody_is_accused(&verdicts) {
        lower::look(&mut verdicts, features, context, &accepted);
    }
    if nobody_is_accused(&verdicts) {
        between::look(&mut verdicts, features, context, &accepted);
    }
    let worst = worst.filter(|found| is_open(found, &verdicts));
    (verdicts, worst)
}

fn nobody_is_accused(verdicts: &[ComponentDiagnosis]) -> bool {
    verdicts.iter().all(|verdict| !verdict.state.is_accusation())
}

/// Whether none of the bearings that a line may come from is accused: that one may be what makes it.
fn is_open(found: &Unplaced, verdicts: &[ComponentDiagnosis]) -> bool {
    found.bearings.iter().all(|bearing| !verdicts[bearing.0].state.is_accusation())
}

/// Ways in which a bearing may be accused where there is a baseline: lines in the envelopes, and what has outgrown the baseline of the
/// absolute vibration, of combs or of small lines. Each may err; without a baseline there is the first alone (C36 has no probability).
const N_WAYS_WITH_BASELINE: f64 = 4.0;

/// The same context, in which all ways together have the declared probability of a false alarm.
fn paid_for_ways<'a>(context: &Context<'a>) -> Context<'a> {
    let has_baseline = !context.baseline.records.is_empty();
    let ways = if has_baseline { N_WAYS_WITH_BASELINE } else { 1.0 };
    Context { false_alarm_probability: context.false_alarm_probability / ways, ..*context }
}

/// A bearing's verdict, and what would accuse it, were it told that it comes from there.
type Judged = (ComponentDiagnosis, Option<Unplaced>);

fn judge_all(
    features: &WindowFeatures,
    context: &Context<'_>,
    accepted: &[Accepted<'_>],
) -> Vec<Judged> {
    let bearings = (0..context.machine.bearings.len()).map(BearingIndex);
    bearings.map(|bearing| judge_one(bearing, features, context, accepted)).collect()
}

/// Leaves bearings open that another speed of a shaft would accuse: the one that is written down may be wrong (F22).
fn reopen(
    verdicts: &mut [ComponentDiagnosis],
    other: &Elsewhere,
    features: &WindowFeatures,
    context: &Context<'_>,
) {
    if verdicts.iter().all(|verdict| verdict.state != State::Healthy) {
        return;
    }
    // Nothing tells it, nor where side bands would lie.
    let speed = Speed { first: Some(other.first), confidence: 0.0, ..features.speed.clone() };
    let bearing_lines = other.lines.clone();
    // What a baseline could say of them is of the speed at which they were read.
    let (absolute_lines, combs, channels) = (Vec::new(), Vec::new(), Vec::new());
    let there = WindowFeatures {
        speed,
        bearing_lines,
        absolute_lines,
        combs,
        channels,
        ..features.clone()
    };
    let accused = judge_all(&there, context, &accept::accept(&there));
    let unplaced: Vec<BearingIndex> = accused
        .iter()
        .filter_map(|(_, found)| found.as_ref())
        .flat_map(|f| f.bearings.clone())
        .collect();
    for (bearing, (verdict, (there, _))) in verdicts.iter_mut().zip(accused).enumerate() {
        let is_accused = there.state.is_accusation() || unplaced.contains(&BearingIndex(bearing));
        if verdict.state == State::Healthy && is_accused {
            let at = features.speed.first.map_or(0.0, |first| first.0);
            let told = match features.speed.source {
                Some(SpeedSource::Estimated) => "told by one line alone",
                _ => "stated, which nothing confirms",
            };
            let why = format!(
                "at the speed of {at:.2} Hz ({told}) no defect line stands, but near {:.2} Hz one does: {}; measure the speed",
                other.first.0, there.why
            );
            verdict.leave_open(why);
            verdict.evidence.extend(there.evidence);
        }
    }
}

/// Judges one bearing by the lines accepted for it.
fn judge_one(
    bearing: BearingIndex,
    features: &WindowFeatures,
    context: &Context<'_>,
    accepted: &[Accepted<'_>],
) -> Judged {
    let searches: Vec<&LineSearch> =
        features.bearing_lines.iter().filter(|s| s.bearing == bearing).collect();
    let id = &context.machine.bearing(bearing).id;
    let mut verdict = ComponentDiagnosis::undetermined(id, ComponentKind::Bearing, String::new());
    if let Some(why) = looked::cannot_look(bearing, &searches, features, context) {
        verdict.why = why;
        return (verdict, None);
    }
    let looks = accept::n_looks(features, bearing);
    let candidates: Vec<Candidate<'_>> = searches
        .iter()
        .filter(|s| s.outcome.is_ok())
        .map(|s| Candidate::weigh(s, accepted, looks))
        .collect();
    verdict.evidence = evidence::evidence(bearing, &candidates, accepted, features, context);
    let seen = Seen { bearing, features, context, accepted };
    let mut sorted = doubt::sort(&candidates, &seen);
    let unsure = leave_unsure(&mut sorted, context);
    decide(&mut verdict, &sorted, unsure, (&candidates, &searches), &seen);
    if verdict.state.is_accusation() {
        verdict.why.push_str(&sensor::cut_note(features, heard_in(&searches), context));
    }
    if verdict.state == State::Undetermined {
        verdict.why.push_str(&said::wide_band(bearing, context));
    }
    let is_sure = |line: &&Candidate<'_>| line.probability() <= context.false_alarm_probability;
    let unplaced = sorted.unplaced().filter(is_sure).map(|line| {
        let elsewhere = doubt::elsewhere(line, &seen);
        Unplaced {
            severity: severity::not_damaged(severity::of_depth(line.depth())),
            confidence: confidence_in(line, features, 1.0),
            why: said::unplaced(line, &elsewhere, context),
            bearings: [vec![bearing], elsewhere].concat(),
        }
    });
    (verdict, unplaced)
}

/// Fills in what is said of a bearing: what accuses it, strongest first, else what leaves it open, else its health.
fn decide(
    verdict: &mut ComponentDiagnosis,
    sorted: &Sorted<'_>,
    unsure: Option<String>,
    (candidates, searches): (&[Candidate<'_>], &[&LineSearch]),
    seen: &Seen<'_>,
) {
    let Seen { bearing, features, context, accepted } = *seen;
    if let Some((first, others)) = sorted.proven.split_first() {
        return accuse(verdict, first, others, candidates, features, context);
    }
    if let Some((first, others)) = sorted.shared.first() {
        return warn_of_shared(verdict, first, others, features, context);
    }
    let grown = grown::strongest(seen, sorted);
    if let Some(Growth::Proven(grown)) = &grown {
        return accuse_by_growth(verdict, grown, features, context);
    }
    if let Some(struck) = struck::strongest(bearing, features, context, accepted) {
        return warn_of_strikes(verdict, &struck, features, context);
    }
    let open = match &grown {
        Some(Growth::Beside(grown, other)) => Some(said::beside(grown, other, context)),
        Some(Growth::Unheard(grown, other)) => Some(said::without_pair(grown, *other, context)),
        Some(Growth::Carried(grown)) => Some(said::loaded(grown, context)),
        Some(Growth::Proven(_)) | None => unsure,
    };
    if let Some(why) = open {
        verdict.why = why;
        return;
    }
    if let Some(risen) = risen::strongest(seen).filter(|_| sorted.unplaced().is_none()) {
        return risen.warn(verdict, seen);
    }
    let open = doubt::why_open(&sorted.doubts, candidates, searches, seen);
    let unread = looked::race_not_read(searches);
    let open = open.or_else(|| looked::too_short_to_acquit(searches).filter(|_| unread.is_none()));
    let open = open.or_else(|| looked::would_not_be_seen(searches, context));
    match (open, unread) {
        (Some(why), None) | (None, Some(why)) => verdict.why = why,
        (Some(why), Some(unread)) => verdict.why = format!("{why}; besides, {unread}"),
        (None, None) => acquit::acquit_what_is_heard(verdict, candidates, searches, seen),
    }
}

/// Channels that lines could be read in.
fn heard_in<'a>(searches: &'a [&LineSearch]) -> impl Iterator<Item = ChannelIndex> + 'a {
    searches.iter().filter(|s| s.outcome.is_ok()).map(|s| s.channel)
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
    let (bearing, line) = (first.search.bearing, first.search.line);
    let growth = grown::ratio(bearing, line, features, context);
    let severity = line_severity(first, growth);
    let rival = candidates
        .iter()
        .filter(|c| c.search.line != first.search.line && c.search.line != DefectLine::Ftf)
        .filter(|c| c.stands() && c.depth() >= COMPETING_DEPTH)
        .max_by(|a, b| a.power_ratio().total_cmp(&b.power_ratio()));
    let leads = rival.is_none_or(|r| {
        first.power_ratio() >= LEAD_POWER_RATIO * r.power_ratio() && first.n_showing > r.n_showing
    });
    verdict.why = sentence(first, context) + &said::told_by_loudness(first, context);
    if let Some(ratio) = growth {
        let also = format!("; in the absolute vibration it is {ratio:.0} times its baseline");
        verdict.why.push_str(&also);
    }
    // What few bands hear is a fault, not yet a measure of it.
    let severity = if first.is_measured() { severity } else { severity::not_damaged(severity) };
    verdict.severity = Some(severity);
    if leads {
        verdict.state = severity::state(severity);
        verdict.fault = Some(fault_of(first.search.line));
        verdict.confidence = Some(confidence_in(first, features, first.share()));
        verdict.other_faults = others.iter().map(|c| other_fault(c, features, context)).collect();
    } else if let Some(rival) = rival {
        verdict.state = State::Warning;
        verdict.severity = Some(severity::not_damaged(severity));
        verdict.confidence = Some(0.7 * features.speed.confidence);
        verdict.why = format!(
            "lines of several elements: {} and {}; none leads by 6 dB, cause not proven",
            sentence(first, context),
            rival.search.line.name()
        );
    }
}

/// A line that accuses beside a stronger one.
fn other_fault(
    line: &Candidate<'_>,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> OtherFault {
    let severity = severity::of_depth(line.depth());
    OtherFault {
        fault: fault_of(line.search.line),
        state: severity::state(severity),
        severity,
        confidence: confidence_in(line, features, line.share()),
        why: sentence(line, context),
        evidence: vec![evidence::envelope_evidence(line, context)],
    }
}

/// Severity of a line that accuses: of its depth, or of its growth over the baseline if that says more. Depth says how
/// much of a band is the defect's, and is full for a small one in a quiet machine; growth goes on with its size (S1, S2).
fn line_severity(line: &Candidate<'_>, growth: Option<f64>) -> f64 {
    let grown = growth.map_or(0.0, grown::severity_of);
    severity::of_depth(line.depth()).max(grown)
}

/// Fills in a warning without a cause: the line is as well that of another element or bearing.
fn warn_of_shared(
    verdict: &mut ComponentDiagnosis,
    first: &Candidate<'_>,
    others: &[&LineSearch],
    features: &WindowFeatures,
    context: &Context<'_>,
) {
    verdict.state = State::Warning;
    verdict.severity = Some(severity::not_damaged(severity::of_depth(first.depth())));
    verdict.confidence = Some(0.7 * features.speed.confidence);
    let name =
        |s: &&LineSearch| format!("{} of {}", s.line.name(), context.machine.bearing(s.bearing).id);
    verdict.why = format!(
        "{}; at this geometry it coincides with {}, cause not proven",
        sentence(first, context),
        others.iter().map(name).collect::<Vec<_>>().join(" and "),
    );
}

/// Fills in an accusation by a grown line of the absolute vibration.
fn accuse_by_growth(
    verdict: &mut ComponentDiagnosis,
    grown: &grown::Grown<'_>,
    features: &WindowFeatures,
    context: &Context<'_>,
) {
    let severity = grown.severity();
    verdict.state = severity::state(severity);
    verdict.fault = Some(fault_of(grown.line.line));
    verdict.severity = Some(severity);
    let speed = 0.5 + 0.5 * features.speed.confidence;
    verdict.confidence = Some(0.85 * speed * (1.0 - grown.probability));
    verdict.why = grown.sentence(context);
}

/// Fills in a warning of a race that is struck more than when healthy.
fn warn_of_strikes(
    verdict: &mut ComponentDiagnosis,
    struck: &Struck<'_>,
    features: &WindowFeatures,
    context: &Context<'_>,
) {
    let severity = struck::severity_of(struck);
    verdict.state = severity::state(severity);
    verdict.fault = Some(fault_of(struck.comb.line));
    verdict.severity = Some(severity);
    verdict.confidence = Some(0.85 * (0.5 + 0.5 * features.speed.confidence));
    verdict.why = struck::sentence(struck, context);
}

/// Takes away what accuses, but not as surely as this decision asks; why the first of it does not accuse. It is
/// there by the usual measure, so it does not acquit either.
fn leave_unsure(sorted: &mut Sorted<'_>, context: &Context<'_>) -> Option<String> {
    let is_sure = |c: &Candidate<'_>| c.probability() <= context.false_alarm_probability;
    let accusing = sorted.proven.iter().copied().chain(sorted.shared.iter().map(|(c, _)| *c));
    let why = accusing.filter(|c| !is_sure(c)).map(|c| unsure(c, context)).next();
    sorted.proven.retain(|c| is_sure(c));
    sorted.shared.retain(|(c, _)| is_sure(c));
    why
}

/// Why a line does not accuse in this decision.
fn unsure(candidate: &Candidate<'_>, context: &Context<'_>) -> String {
    format!(
        "{}, but it may be chance with a probability of {:.1e}, and accusations are held to {:.1e}",
        sentence(candidate, context),
        candidate.probability(),
        context.false_alarm_probability
    )
}

/// Which element a line accuses.
fn fault_of(line: DefectLine) -> FaultMode {
    match line {
        DefectLine::Bpfi => FaultMode::InnerRace,
        DefectLine::Bpfo => FaultMode::OuterRace,
        DefectLine::TwoBsf => FaultMode::RollingElement,
        DefectLine::Ftf => FaultMode::Cage,
    }
}

/// Confidence that state and fault are right (C5): a lower bound, no fit (ADR 18). The product of what the speed, the agreement
/// of bands, the distance from the threshold and its `share` beside other bearings leave.
fn confidence_in(candidate: &Candidate<'_>, features: &WindowFeatures, share: f64) -> f64 {
    let agreement = 0.6 + 0.4 * candidate.part_of_all();
    let margin = 1.0
        - 0.25 * (severity::WARNING_DEPTH / candidate.depth().max(severity::WARNING_DEPTH)).powi(2);
    let speed = 0.5 + 0.5 * features.speed.confidence;
    let known = agreement * margin * speed * (1.0 - candidate.probability());
    (known * share).min(0.99)
}

fn sentence(candidate: &Candidate<'_>, context: &Context<'_>) -> String {
    let Some(best) = &candidate.best else { return String::new() };
    let over = 10.0 * candidate.power_ratio().max(1.0).log10();
    let harmonics = best.harmonics[1..]
        .iter()
        .flatten()
        .filter(|h| confidence::harmonic_tail(h) <= confidence::FALSE_ALARM_PROBABILITY)
        .count();
    let side = match (candidate.has_side_band(), candidate.search.line) {
        (false, _) => "no side bands",
        (true, DefectLine::TwoBsf) => "FTF side bands present",
        (true, DefectLine::Bpfi | DefectLine::Bpfo | DefectLine::Ftf) => "1× side bands present",
    };
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
