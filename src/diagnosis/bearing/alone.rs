//! A line that stands by its fundamental alone (docs/theory.md, C55). Must not know what else is heard.

use super::candidate::A_QUARTER;
use super::candidate::BAND_PROBABILITY;
use super::power;
use super::power::LinePower;
use crate::diagnosis::confidence;
use crate::diagnosis::severity;
use crate::features::bands;
use crate::features::bearing::BandReading;
use crate::features::bearing::Harmonic;
use crate::units::Hz;

/// Depth of a line of four harmonics as high as the fundamental, as blows have them, over that of the fundamental alone.
const FULL_HEIGHT: f64 = 2.0;

/// The fundamental of a line, over the bands, whatever its harmonics do.
#[derive(Debug, Clone, Copy)]
pub(super) struct Alone {
    /// Where the deepest has it.
    pub(super) frequency: Hz,
    /// Power over the noise floor there.
    pub(super) power_ratio: f64,
    /// Bands that show it.
    pub(super) n_showing: usize,
    /// Depth that a quarter of the bands reach.
    pub(super) depth: f64,
    /// Where in the spectrum its power is.
    power: LinePower,
    /// Probability that it is chance, the search paid for.
    probability: f64,
}

impl Alone {
    /// Weighs the fundamentals of the readings that are the line's own, `octaves` those of the lowest band where it is wide; `n_looks`: searches among
    /// which it is picked. `None` if less than a quarter of the bands show it.
    pub(super) fn weigh(
        (readings, octaves): (&[BandReading], &[BandReading]),
        own: impl Fn(&BandReading) -> bool,
        n_looks: f64,
    ) -> Option<Self> {
        let tail = |r: &BandReading| r.harmonics[0].map_or(1.0, |h| confidence::harmonic_tail(&h));
        let stands = |r: &BandReading| tail(r) <= BAND_PROBABILITY;
        let probabilities: Vec<f64> =
            readings.iter().map(|r| if own(r) { tail(r) } else { 1.0 }).collect();
        let shown = readings.iter().filter(|r| own(r) && stands(r));
        let mut shown: Vec<(Hz, Harmonic)> =
            shown.filter_map(|r| r.harmonics[0].map(|h| (r.frequency, h))).collect();
        shown.sort_by(|(_, a), (_, b)| b.depth.total_cmp(&a.depth));
        let quarter = readings.len().div_ceil(4).max(1);
        let (frequency, deepest) = *shown.first()?;
        Some(Self {
            frequency,
            power_ratio: deepest.power_ratio,
            n_showing: shown.len(),
            depth: shown.get(quarter - 1)?.1.depth,
            power: LinePower::of((readings, octaves), own, stands),
            probability: (confidence::combine(&probabilities, A_QUARTER) * n_looks).min(1.0),
        })
    }

    /// Whether it is there, and a quarter of the bands find it so deep that with its four harmonics it would accuse.
    pub(super) fn is_deep(&self) -> bool {
        self.probability <= confidence::FALSE_ALARM_PROBABILITY
            && FULL_HEIGHT * self.depth >= severity::WARNING_DEPTH
    }

    /// Whether sound elements that pass the race at rest may make it: smooth below what structures ring at (C12, C43), or a tone's modulation (C34).
    pub(super) fn is_passing(&self) -> bool {
        let is_below_ringing = self.power.lowest_top.0 <= 2.0 * bands::MOTION.0;
        let power = std::iter::once(&self.power);
        power::is_smooth(power.clone()) && is_below_ringing || power::is_of_tone(power)
    }
}
