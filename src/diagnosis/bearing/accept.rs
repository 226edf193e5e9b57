//! Which lines are proven: weighed over the bands, accepted strongest first, each explaining others.

use super::owner;
use crate::diagnosis::confidence;
use crate::diagnosis::severity;
use crate::features::WindowFeatures;
use crate::features::bearing::BandReading;
use crate::features::bearing::DefectLine;
use crate::features::bearing::LineSearch;
use crate::machine::BearingIndex;
use crate::signal::ChannelIndex;
use crate::units::Hz;

/// A band counts as showing a line at this probability.
const BAND_PROBABILITY: f64 = 1e-4;

/// Power ratio of lines from which one bearing drowns another (10 dB).
const OVERHEARD_POWER: f64 = 10.0;

/// Parts of the bands that must agree.
const MOST: f64 = 0.5;
const A_QUARTER: f64 = 0.25;

/// Ways to be proven, each of which may err.
const N_WAYS: f64 = 2.0;

/// Effect size that counts in a quarter of the bands: half of the energy in one of them.
const NARROW_DEPTH: f64 = 2.0 * severity::WARNING_DEPTH;

/// Standard deviations below a measured depth that must still matter: one side, 5 %.
const DEVIATIONS: f64 = 1.645;

/// Relative error allowed when a line is matched to another's harmonic.
const MATCH_TOLERANCE: f64 = 5e-4;

/// A line of one bearing, read in one channel, after what is explained has been taken out.
#[derive(Debug, Clone)]
pub(super) struct Candidate<'a> {
    pub(super) search: &'a LineSearch,
    pub(super) n_bands: usize,
    pub(super) n_showing: usize,
    /// False-alarm probability if most bands must show it, paid for the other way.
    broad_probability: f64,
    /// The same if a quarter of them must.
    narrow_probability: f64,
    pub(super) best: Option<&'a BandReading>,
    /// Depth that a quarter of the bands reach.
    agreed_depth: f64,
}

/// An accepted line, and what it explains elsewhere.
#[derive(Debug, Clone)]
pub(super) struct Accepted<'a> {
    pub(super) frequency: Hz,
    pub(super) spacing: Hz,
    /// Channel it was heard in, and the power it carries there.
    heard: (ChannelIndex, f64),
    /// Whose it is; several where it cannot be decided; none if it is heard best where it may be the
    /// shaft's events that passing elements modulate.
    pub(super) owners: Vec<&'a LineSearch>,
}

impl<'a> Accepted<'a> {
    /// Whether it is, or may be, this line of this bearing.
    pub(super) fn is_of(&self, bearing: BearingIndex, line: DefectLine) -> bool {
        self.owners.iter().any(|s| (s.bearing, s.line) == (bearing, line))
    }

    /// Whether it was accepted by `search`.
    pub(super) fn is_by(&self, search: &LineSearch) -> bool {
        self.owners.iter().any(|s| std::ptr::eq(*s, search))
    }

    /// The searches besides `search` that it may belong to as well.
    pub(super) fn others(&self, search: &LineSearch) -> Vec<&'a LineSearch> {
        self.owners.iter().copied().filter(|s| !std::ptr::eq(*s, search)).collect()
    }

    /// Whether `frequency` is a harmonic or side band of this line.
    pub(super) fn explains(&self, frequency: Hz, resolution: Hz) -> bool {
        (0..=4).any(|k| {
            (-2..=2).filter(|m| k != 0 || *m != 0).any(|m| {
                let place = f64::from(k) * self.frequency.0 + f64::from(m) * self.spacing.0;
                (frequency.0 - place).abs() <= resolution.0 + MATCH_TOLERANCE * place.abs()
            })
        })
    }
}

impl<'a> Candidate<'a> {
    pub(super) fn depth(&self) -> f64 {
        self.best.map_or(0.0, BandReading::total_depth)
    }

    pub(super) fn part(&self) -> f64 {
        if self.n_bands == 0 { 0.0 } else { self.n_showing as f64 / self.n_bands as f64 }
    }

    /// Power the line carries in its best band: what decides who hears it best.
    pub(super) fn line_power(&self) -> f64 {
        self.best.map_or(0.0, |b| b.total_depth() * b.mean_square)
    }

    pub(super) fn power_ratio(&self) -> f64 {
        let fundamental = self.best.and_then(|b| b.harmonics[0]);
        fundamental.map_or(0.0, |h| h.power_ratio)
    }

    /// Weighs one search, leaving out readings that accepted lines or the shaft's events explain.
    /// `n_looks`: searches of this bearing among which the strongest is picked.
    pub(super) fn weigh(search: &'a LineSearch, accepted: &[Accepted<'_>], n_looks: f64) -> Self {
        Self::weigh_those(search, accepted, n_looks, |r| !r.is_explained())
    }

    /// Weighs one search, those readings included that the shaft's events explain.
    pub(super) fn weigh_all(
        search: &'a LineSearch,
        accepted: &[Accepted<'_>],
        n_looks: f64,
    ) -> Self {
        Self::weigh_those(search, accepted, n_looks, |_| true)
    }

    /// Weighs the readings of one search that are `fit` and that accepted lines do not explain.
    fn weigh_those(
        search: &'a LineSearch,
        accepted: &[Accepted<'_>],
        n_looks: f64,
        fit: impl Fn(&BandReading) -> bool,
    ) -> Self {
        let readings = search.outcome.as_deref().unwrap_or(&[]);
        // A line is weighed as it was accepted: against those accepted before it.
        let before = accepted.iter().take_while(|a| !a.is_of(search.bearing, search.line));
        let before: Vec<&Accepted<'_>> = before.collect();
        let own = |r: &BandReading| {
            let explained = || before.iter().any(|a| a.explains(r.frequency, search.resolution));
            fit(r) && !explained()
        };
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
        let mut depths: Vec<f64> =
            readings.iter().filter(showing).map(BandReading::total_depth).collect();
        depths.sort_by(|a, b| b.total_cmp(a));
        let quarter = readings.len().div_ceil(4).max(1);
        let paid =
            |part: f64| (confidence::combine(&probabilities, part) * n_looks * N_WAYS).min(1.0);
        Self {
            agreed_depth: depths.get(quarter - 1).copied().unwrap_or(0.0),
            search,
            n_bands: readings.len(),
            n_showing: readings.iter().filter(showing).count(),
            broad_probability: paid(MOST),
            narrow_probability: paid(A_QUARTER),
            best,
        }
    }

    /// Whether the line is there and as deep as matters: in most bands, or in few and twice as deep.
    pub(super) fn is_proven(&self) -> bool {
        self.is_broad() || self.is_narrow()
    }

    /// Proven in most bands, as impacts are heard.
    pub(super) fn is_broad(&self) -> bool {
        self.broad_probability <= confidence::FALSE_ALARM_PROBABILITY
            && self.depth() >= severity::WARNING_DEPTH
    }

    /// Proven in a quarter of the bands, one of which owes half of its energy to the line (C4): impacts
    /// that one resonance alone brings above the noise.
    fn is_narrow(&self) -> bool {
        // A cage strikes nothing: what few bands show at its rate is modulation.
        self.search.line != DefectLine::Ftf
            && self.narrow_probability <= confidence::FALSE_ALARM_PROBABILITY
            && self.depth() >= NARROW_DEPTH
    }

    /// Probability of a false alarm of the way it is proven: in a quarter of the bands only where most do
    /// not prove it.
    pub(super) fn probability(&self) -> f64 {
        if self.is_narrow() && !self.is_broad() {
            self.narrow_probability
        } else {
            self.broad_probability
        }
    }

    /// Whether it stands over the noise, so that it competes with a line that accuses: it is not accused,
    /// and pays for no second way.
    pub(super) fn stands(&self) -> bool {
        self.probability() <= N_WAYS * confidence::FALSE_ALARM_PROBABILITY
    }

    /// Whether a quarter of the bands find it as deep as matters: impacts are deep wherever they are heard,
    /// passing elements only where they happen to move the vibration's level.
    pub(super) fn is_agreed(&self) -> bool {
        self.agreed_depth >= severity::WARNING_DEPTH
    }

    /// Whether another bearing strikes so much harder that what is heard here may be its blows, modulated
    /// by the elements of this one.
    pub(super) fn is_overheard(&self, accepted: &[Accepted<'_>]) -> bool {
        accepted.iter().any(|a| {
            let elsewhere = !a.owners.is_empty()
                && a.owners.iter().all(|s| s.bearing != self.search.bearing)
                && a.heard.0 != self.search.channel;
            elsewhere && a.heard.1 >= OVERHEARD_POWER * self.line_power()
        })
    }

    /// Whether a band shows a line of effect, though too few do to accuse.
    pub(super) fn is_deep_in_few(&self) -> bool {
        self.n_showing > 0 && self.is_surely_deep()
    }

    /// Whether it is as deep as matters even at the lower end of what the noise beside it leaves open
    /// (C9).
    pub(super) fn is_surely_deep(&self) -> bool {
        self.least_depth() >= severity::WARNING_DEPTH
    }

    /// Whether it is a rolling element's line without the side bands of the cage: a damaged element goes
    /// through the load zone at FTF.
    pub(super) fn is_bare(&self) -> bool {
        let frequency = self.best.map_or(Hz(0.0), |best| best.frequency);
        self.search.line == DefectLine::TwoBsf && !owner::has_side_bands(self.search, frequency)
    }

    /// Lower end of the depth: noise adds to an amplitude with a standard deviation of 1/√(2·R) of it,
    /// R its power over the noise's.
    fn least_depth(&self) -> f64 {
        let ratio = self.power_ratio();
        let spread = if ratio > 0.0 { DEVIATIONS / (2.0 * ratio).sqrt() } else { 0.0 };
        self.depth() * (1.0 - spread).max(0.0)
    }
}

pub(super) fn n_looks(features: &WindowFeatures, bearing: BearingIndex) -> f64 {
    features.bearing_lines.iter().filter(|s| s.bearing == bearing && s.outcome.is_ok()).count()
        as f64
}

/// Accepts proven lines, strongest first, for those they may belong to, until none is left that the accepted do not explain.
///
/// Cage lines come last and only for bearings without another: every defect's line carries the
/// cage rate as soon as the elements differ from one another.
pub(super) fn accept(features: &WindowFeatures) -> Vec<Accepted<'_>> {
    let mut accepted = Vec::new();
    accept_among(features, &mut accepted, |line| line != DefectLine::Ftf);
    let mut with_race: Vec<BearingIndex> =
        accepted.iter().flat_map(|a| a.owners.iter().map(|s| s.bearing)).collect();
    with_race.extend(doubtful_races(features, &accepted));
    accept_among(features, &mut accepted, |line| line == DefectLine::Ftf);
    accepted.retain_mut(|found| {
        let was_owned = !found.owners.is_empty();
        found.owners.retain(|s| s.line != DefectLine::Ftf || !with_race.contains(&s.bearing));
        !was_owned || !found.owners.is_empty()
    });
    accepted
}

/// Bearings with another line than the cage's that stands, whatever explains it: its elements may be
/// what the cage carries around.
fn doubtful_races<'a>(
    features: &'a WindowFeatures,
    accepted: &'a [Accepted<'_>],
) -> impl Iterator<Item = BearingIndex> + 'a {
    let of_elements = features.bearing_lines.iter().filter(|s| s.line != DefectLine::Ftf);
    of_elements
        .map(|s| Candidate::weigh_all(s, accepted, n_looks(features, s.bearing)))
        .filter(Candidate::is_proven)
        .map(|c| c.search.bearing)
}

pub(super) fn accept_among<'a>(
    features: &'a WindowFeatures,
    accepted: &mut Vec<Accepted<'a>>,
    eligible: impl Fn(DefectLine) -> bool,
) {
    loop {
        let next = features
            .bearing_lines
            .iter()
            .filter(|s| eligible(s.line))
            .filter(|s| !accepted.iter().any(|a| a.is_of(s.bearing, s.line)))
            .map(|s| Candidate::weigh(s, accepted, n_looks(features, s.bearing)))
            .filter(Candidate::is_proven)
            .max_by(|a, b| (a.depth() * a.part()).total_cmp(&(b.depth() * b.part())));
        let Some((candidate, best)) = next.as_ref().and_then(|c| c.best.map(|b| (c, b))) else {
            return;
        };
        let search = heard_best(features, candidate, best.frequency, accepted);
        let is_own =
            Candidate::weigh(search, accepted, n_looks(features, search.bearing)).is_proven();
        accepted.push(Accepted {
            frequency: best.frequency,
            spacing: search.side_band_spacing,
            heard: (search.channel, candidate.line_power()),
            owners: if is_own {
                owner::owners(features, search, best.frequency)
            } else {
                Vec::new()
            },
        });
    }
}

/// Among equal bearings with a sensor each the line belongs to the one whose sensor shows it with the
/// most power, whatever makes it there. Those that share the candidate's channel are told apart by [`owner::owners`].
pub(super) fn heard_best<'a>(
    features: &'a WindowFeatures,
    candidate: &Candidate<'a>,
    frequency: Hz,
    accepted: &[Accepted<'_>],
) -> &'a LineSearch {
    features
        .bearing_lines
        .iter()
        .filter(|s| s.line == candidate.search.line)
        .filter(|s| s.channel != candidate.search.channel || std::ptr::eq(*s, candidate.search))
        .filter(|s| !accepted.iter().any(|a| a.is_of(s.bearing, s.line)))
        .map(|s| Candidate::weigh_all(s, accepted, n_looks(features, s.bearing)))
        .filter(Candidate::is_proven)
        .filter(|c| {
            let near = c.search.resolution.0 + MATCH_TOLERANCE * frequency.0;
            c.best.is_some_and(|b| (b.frequency.0 - frequency.0).abs() <= near)
        })
        .max_by(|a, b| a.line_power().total_cmp(&b.line_power()))
        .map_or(candidate.search, |c| c.search)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::bands::Band;
    use crate::features::bearing::Harmonic;
    use crate::machine::uncertainty::RelativeBand;

    /// A line read in eight bands, of this depth in the first `n_deep`, lost in noise in the others.
    fn search(line: DefectLine, n_deep: u32, depth: f64) -> LineSearch {
        let reading = |i: u32| {
            let (power_ratio, depth) = if i < n_deep { (900.0, depth) } else { (1.0, 0.01) };
            let harmonic = Harmonic { power_ratio, depth, floor_dof: 100.0, n_cells: 40.0 };
            BandReading {
                band: Band { low: Hz(0.0), high: Hz(5e3), whitened: false },
                frequency: Hz(150.0),
                harmonics: [Some(harmonic), Some(harmonic), None, None],
                side_band: None,
                shaft_depth: 0.0,
                slower: None,
                mean_square: 1.0,
            }
        };
        LineSearch {
            bearing: BearingIndex(0),
            channel: ChannelIndex(0),
            line,
            expected: Hz(150.0),
            band: RelativeBand::default(),
            shaft_speed: Hz(30.0),
            side_band_spacing: Hz(30.0),
            resolution: Hz(0.2),
            sample_range: (0, 1),
            outcome: Ok((0..8).map(reading).collect()),
        }
    }

    /// Whether it is proven, and in most bands; its probability.
    fn weighed(line: DefectLine, n_deep: u32, depth: f64) -> (bool, bool, f64) {
        let search = search(line, n_deep, depth);
        let candidate = Candidate::weigh(&search, &[], 4.0);
        (candidate.is_proven(), candidate.is_broad(), candidate.probability())
    }

    #[test]
    fn a_line_proven_in_few_bands_has_the_probability_of_those() {
        // Two harmonics of equal depth: D = √2·depth.
        let (proven, broad, p) = weighed(DefectLine::Bpfo, 4, 0.5);
        assert!(proven && broad && p < 1e-6, "half of the bands: {p}");
        let (proven, broad, p) = weighed(DefectLine::Bpfo, 2, 0.8);
        assert!(proven && !broad && p < 1e-6, "a quarter, D = 1.13: {p}");
        let (proven, _, p) = weighed(DefectLine::Bpfo, 2, 0.6);
        assert!(!proven && p > 0.5, "a quarter, D = 0.85: {p}");
        assert!(!weighed(DefectLine::Bpfo, 1, 0.8).0, "one of eight");
        assert!(!weighed(DefectLine::Ftf, 2, 0.8).0, "a cage strikes nothing");
    }
}
