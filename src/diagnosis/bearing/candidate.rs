//! One line of one bearing in one channel, weighed over the bands: how probable by chance, how deep, how
//! powerful, where in the spectrum.

use super::accept::Accepted;
use super::alone::Alone;
use super::owner;
use super::place::Rival;
use super::power;
use super::power::LinePower;
use super::power::OVERHEARD_POWER;
use crate::diagnosis::confidence;
use crate::diagnosis::severity;
use crate::features::bearing;
use crate::features::bearing::BandReading;
use crate::features::bearing::DefectLine;
use crate::features::bearing::LineSearch;
use crate::units::Hz;

/// A band counts as showing a line at this probability.
pub(super) const BAND_PROBABILITY: f64 = 1e-4;

/// How much higher a line stands over the shaft's events than where it would come from with them (6 dB).
const OUTDOES: f64 = 2.0;

/// Ways to be proven, each of which may err.
const N_WAYS: f64 = 2.0;

/// Effect size that counts in a quarter of the bands: half of the energy in one of them.
pub(super) const NARROW_DEPTH: f64 = 2.0 * severity::WARNING_DEPTH;

/// Effect size in a quarter of the bands from which a line that is there no longer acquits (C42): blows that accuse have as little
/// where what else is heard grows by 3.7 dB, less than what is no news of a level.
const OPEN_DEPTH: f64 = 0.5 * severity::WARNING_DEPTH;

/// Parts of the bands that must agree.
const MOST: f64 = 0.5;
pub(super) const A_QUARTER: f64 = 0.25;

/// A line of one bearing, read in one channel, after what is explained has been taken out.
#[derive(Debug, Clone)]
pub(super) struct Candidate<'a> {
    pub(super) search: &'a LineSearch,
    pub(super) n_bands: usize,
    pub(super) n_showing: usize,
    /// Part of the usable band that the bands cover.
    covered: f64,
    /// Bands that show it with all its harmonics, of the race at rest in noise.
    n_whole: usize,
    /// Of the bands that show it those that are in noise (F30).
    n_in_noise: usize,
    /// Bands that show it at the probability at which a line counts as there.
    n_noted: usize,
    /// What it is a side band of, as most of the bands that show it tell: the line beside it is higher (C40).
    pub(super) side_band_of: Option<Hz>,
    /// False-alarm probability if most bands must show it, paid for the other way.
    broad_probability: f64,
    /// The same if a quarter of them must.
    narrow_probability: f64,
    /// The deepest of the bands that show it.
    pub(super) best: Option<BandReading>,
    /// Depth that a quarter of the bands reach.
    agreed_depth: f64,
    /// Depth in the band that owes most of what is no noise to it (F30).
    depth_beside_noise: f64,
    /// Its fundamental, whatever its harmonics do.
    pub(super) alone: Option<Alone>,
    /// Where in the spectrum its power is.
    pub(super) power: LinePower,
    /// The loudest of the other bearings whose it may be by its rate alone, once it is accepted.
    pub(super) rival: Option<Rival>,
}

/// Whether a line is smooth in all the channels that listen for it (C12).
pub(super) fn is_smooth(line: &[Candidate<'_>]) -> bool {
    power::is_smooth(line.iter().map(|c| &c.power))
}

/// The same where a band above could have shown it in one channel at least: nothing hides it there.
pub(super) fn is_seen_to_be_smooth(line: &[Candidate<'_>]) -> bool {
    is_smooth(line) && line.iter().any(|c| !c.power.is_hidden_above)
}

/// Whether at this rate a tone is modulated, in the channels that listen for it (C34).
pub(super) fn is_of_tone(line: &[Candidate<'_>]) -> bool {
    power::is_of_tone(line.iter().map(|c| &c.power))
}

/// Whether a band shows the line that was read there.
pub(super) fn stands(reading: &BandReading) -> bool {
    confidence::band_probability(reading) <= BAND_PROBABILITY
}

impl<'a> Candidate<'a> {
    pub(super) fn depth(&self) -> f64 {
        self.best.as_ref().map_or(0.0, BandReading::total_depth)
    }

    pub(super) fn part(&self) -> f64 {
        if self.n_bands == 0 { 0.0 } else { self.n_showing as f64 / self.n_bands as f64 }
    }

    /// Part of the usable band that shows it: of what was not read none does, or all of the band would have accused (C51).
    pub(super) fn part_of_all(&self) -> f64 {
        self.part() * self.covered
    }

    /// The same line, read in bands that cover this part of the usable band.
    pub(super) fn covering(self, covered: f64) -> Self {
        Self { covered, ..self }
    }

    /// Part of the bands in which something is there at this rate: noise gets so far in 3 of a million (C3 asks for two lines),
    /// so that it is no sign of health, though too little to accuse.
    pub(super) fn noted_part(&self) -> f64 {
        if self.n_bands == 0 { 0.0 } else { self.n_noted as f64 / self.n_bands as f64 }
    }

    pub(super) fn power_ratio(&self) -> f64 {
        let fundamental = self.best.as_ref().and_then(|b| b.harmonics[0]);
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

    /// Weighs one search, those readings included that only their side bands at the shaft's speed explain.
    pub(super) fn weigh_turned(
        search: &'a LineSearch,
        accepted: &[Accepted<'_>],
        n_looks: f64,
    ) -> Self {
        let is_fit = |r: &BandReading| !r.is_explained() || r.is_of_turning_load();
        Self::weigh_those(search, accepted, n_looks, is_fit)
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
        let found = accepted.get(before.len());
        let explained = |f: Hz| before.iter().any(|a| a.explains(f, search.resolution));
        let own = |r: &BandReading| fit(r) && !explained(r.frequency);
        let alone = |readings: &[BandReading]| -> Vec<BandReading> {
            readings.iter().map(|r| r.without_harmonics(explained)).collect()
        };
        let (readings, octaves) = (alone(readings), alone(&search.octaves));
        let probabilities: Vec<f64> = readings
            .iter()
            .map(|r| if own(r) { confidence::band_probability(r) } else { 1.0 })
            .collect();
        let shows = |r: &BandReading| own(r) && stands(r);
        let noted = probabilities.iter().filter(|p| **p <= confidence::FALSE_ALARM_PROBABILITY);
        let n_noted = noted.count();
        let mut showing: Vec<&BandReading> = readings.iter().filter(|r| shows(r)).collect();
        showing.sort_by(|a, b| b.total_depth().total_cmp(&a.total_depth()));
        let quarter = readings.len().div_ceil(4).max(1);
        let beside_noise = |r: &&BandReading| r.depth_beside_noise(&readings, search.duration_s());
        let paid =
            |part: f64| (confidence::combine(&probabilities, part) * n_looks * N_WAYS).min(1.0);
        Self {
            agreed_depth: showing.get(quarter - 1).map_or(0.0, |r| r.total_depth()),
            depth_beside_noise: showing.iter().map(beside_noise).fold(0.0, f64::max),
            power: LinePower::of((&readings, &octaves), own, stands),
            search,
            n_bands: readings.len(),
            n_showing: showing.len(),
            covered: 1.0,
            n_whole: showing.iter().filter(|r| is_whole(r, search)).count(),
            n_in_noise: showing.iter().filter(|r| r.is_in_noise(search.duration_s())).count(),
            n_noted,
            side_band_of: carrier_of(&showing).filter(|_| search.line != DefectLine::Ftf),
            broad_probability: paid(MOST),
            narrow_probability: paid(A_QUARTER),
            best: showing.first().map(|r| (*r).clone()),
            alone: Alone::weigh((&readings, &octaves), own, n_looks),
            rival: found.and_then(|a| a.rivals.first().copied()),
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
            && (self.depth() >= NARROW_DEPTH || self.is_deep_and_carried())
    }

    /// Whether it is as deep as matters in a band at least, and a rolling element's with side bands at FTF: no sound element that passes
    /// and no structure makes both, so that it need not be deep in more (C4). Not a race that turns with side bands at 1×: a damaged
    /// element makes that, too (C9).
    fn is_deep_and_carried(&self) -> bool {
        self.depth() >= severity::WARNING_DEPTH && self.is_of_struck_element()
    }

    /// Whether it is a rolling element's line with the side bands of the cage: sound elements pass the races, not themselves (C9).
    pub(super) fn is_of_struck_element(&self) -> bool {
        self.search.line == DefectLine::TwoBsf && !self.is_bare()
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

    /// Probability that it is chance, in whichever way it is proven better, however deep it is.
    pub(super) fn least_probability(&self) -> f64 {
        self.broad_probability.min(self.narrow_probability)
    }

    /// Whether it stands over the noise, so that it competes with a line that accuses: it is not accused,
    /// and pays for no second way.
    pub(super) fn stands(&self) -> bool {
        self.probability() <= N_WAYS * confidence::FALSE_ALARM_PROBABILITY
    }

    /// Whether the bands find it as deep as matters: impacts are deep wherever they are heard, passing elements only where they happen
    /// to move the vibration's level.
    pub(super) fn is_agreed(&self) -> bool {
        self.is_deep_in_many() || self.is_deep_and_carried() || self.is_deep_beside_noise()
    }

    /// Whether most bands show a line of the race that turns, with side bands at 1×, and one owes half of its energy to it but for the noise in it
    /// (C54): blows lose depth to noise, not their places.
    fn is_deep_beside_noise(&self) -> bool {
        self.search.is_of_turning_race()
            && self.is_broad()
            && self.has_side_band()
            && self.depth_beside_noise >= NARROW_DEPTH
    }

    /// Whether a quarter of the bands find it as deep as matters, or most show it and one owes half of its energy to it, or most show a race's with
    /// all its harmonics ([`is_whole`]): blows ring everywhere.
    fn is_deep_in_many(&self) -> bool {
        let is_whole = self.is_of_race() && 2 * self.n_whole > self.n_bands;
        self.agreed_depth >= severity::WARNING_DEPTH
            || self.is_broad() && (self.depth() >= NARROW_DEPTH || is_whole)
    }

    fn is_of_race(&self) -> bool {
        matches!(self.search.line, DefectLine::Bpfi | DefectLine::Bpfo)
    }

    /// Whether its depth tells how bad it is, not only that it is there: it is shown by most bands and deep in many.
    pub(super) fn is_measured(&self) -> bool {
        self.is_broad() && self.is_deep_in_many()
    }

    /// Whether it is there beyond chance, and a quarter of the bands find it half as deep as accuses (C42).
    pub(super) fn is_half_deep(&self) -> bool {
        self.least_probability() <= confidence::FALSE_ALARM_PROBABILITY
            && self.agreed_depth >= OPEN_DEPTH
    }

    /// Whether another bearing strikes so much harder that what is heard here may be its blows, modulated
    /// by the elements of this one.
    pub(super) fn is_overheard(&self, accepted: &[Accepted<'_>]) -> bool {
        accepted.iter().any(|a| {
            let elsewhere = !a.owners.is_empty()
                && a.owners.iter().all(|s| s.bearing != self.search.bearing)
                && a.heard.0 != self.search.channel;
            elsewhere && a.heard.1 >= OVERHEARD_POWER * self.power.heard()
        })
    }

    /// Whether this line of the turning race, no side line itself, stands higher over the shaft's events here than in the same band of
    /// `other`, where they explain it (C35): what comes from there brings the events along, and cannot be what is heard here.
    pub(super) fn outdoes_events_at(&self, other: &LineSearch) -> bool {
        let Some(here) = self.best.as_ref().filter(|b| b.stands_over_passing()) else {
            return false;
        };
        let readings = other.outcome.as_deref().unwrap_or(&[]);
        let there = readings.iter().find(|r| r.band == here.band);
        there.is_some_and(|there| {
            there.is_modulated_shaft()
                && !here.is_modulated_shaft()
                && here.over_events() >= OUTDOES * there.over_events()
        })
    }

    /// How probable it is that its own bearing makes it: its part of the power of that and of the loudest of those that may make it, too (C45).
    pub(super) fn share(&self) -> f64 {
        1.0 / (1.0 + self.rival.map_or(0.0, |rival| rival.power_ratio))
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
        let frequency = self.best.as_ref().map_or(Hz(0.0), |best| best.frequency);
        self.search.line == DefectLine::TwoBsf && !owner::has_side_bands(self.search, frequency)
    }

    /// Whether it is a turning race's line without side bands at the shaft's speed where faint ones would be seen (C50).
    pub(super) fn is_unturned(&self) -> bool {
        let best = self.best.as_ref();
        best.is_some_and(|best| owner::is_unturned(self.search, best.frequency))
    }

    /// Whether a side band at the spacing of its own stands beside it, in the reading that tells most.
    pub(super) fn has_side_band(&self) -> bool {
        let side = self.best.as_ref().and_then(|best| best.side_band);
        side.is_some_and(|s| confidence::harmonic_tail(&s) <= confidence::FALSE_ALARM_PROBABILITY)
    }

    /// Whether events of the shaft that elements modulate sharply as they pass may make it (C49): a line of the race that turns without side
    /// bands at 1×, no higher than the shaft's harmonics beside it, and not over the line at the elements' own rate, which they make as well.
    pub(super) fn is_of_events(&self) -> bool {
        let may_be = |best: &BandReading| {
            best.over_events() <= bearing::OVER_SHAFT && !best.stands_over_passing()
        };
        self.search.is_of_turning_race()
            && !self.has_side_band()
            && self.best.as_ref().is_some_and(may_be)
    }

    /// Whether it is a race's line and next to nothing else is heard where it stands, most of the bands that show it not being in noise (F30), and no
    /// band owes half of its energy to it (C52): as deep a line is made there by sound elements as they pass, however softly.
    pub(super) fn is_in_quiet(&self) -> bool {
        self.is_of_race() && 2 * self.n_in_noise < self.n_showing && self.depth() < NARROW_DEPTH
    }

    /// Whether it is a cage's line of less than full modulation: as much is made by sound elements that differ, as
    /// the cage carries them through the load.
    pub(super) fn is_carried(&self) -> bool {
        self.search.line == DefectLine::Ftf && self.depth() < NARROW_DEPTH
    }

    /// Lower end of the depth.
    fn least_depth(&self) -> f64 {
        self.depth() * bearing::least_part(self.power_ratio())
    }
}

/// Whether a band shows a line with all its harmonics, and that of the race at rest over noise (F30): sound elements that pass it do so with
/// harmonics, too, and what they lack is force, which the depth tells only as a part of what else is heard.
fn is_whole(reading: &BandReading, search: &LineSearch) -> bool {
    reading.is_whole() && (!search.is_at_rest || reading.is_in_noise(search.duration_s()))
}

/// The line that most of these bands show higher than theirs, a side band's distance away (C40).
fn carrier_of(showing: &[&BandReading]) -> Option<Hz> {
    let mut higher = showing.iter().filter_map(|r| r.outdone_by);
    (2 * higher.clone().count() > showing.len()).then(|| higher.next())?
}

#[cfg(test)]
#[path = "candidate_tests.rs"]
mod tests;
