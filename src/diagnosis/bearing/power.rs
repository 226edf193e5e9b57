//! Where in the spectrum the power of one line is, and how much of it, in one channel. Must not know probabilities.

use crate::features::bearing::BandReading;
use crate::units::Hz;

/// Bands whose widths differ by less than this factor are of one kind.
const ALIKE: f64 = 1.2;

/// Least fall of power, a ratio, that is asked of a smooth motion (C12): 10 dB, half of its fall from the lowest quarter to the next. What it does in
/// the band of a sensor that begins above it is not told.
const LEAST_FALL: f64 = 10.0;

/// Largest fall of power, a ratio, that is asked (C12): 17 dB, half of that to the fourth quarter, as far up as sound bearings were tried.
const MOST_FALL: f64 = 49.0;

/// Power ratio from which one bearing drowns another, and a modulated tone what is heard beside it (10 dB).
pub(super) const OVERHEARD_POWER: f64 = 10.0;

/// Whether a line with these powers in the channels that listen for it lives in the lowest band alone in all of them (C12): struck metal
/// rings at all frequencies, a motion that passing elements impose is smooth and dies out upwards. The force of impacts is white; a
/// motion without jumps in speed falls by 12 dB an octave: the limit lies halfway.
pub(super) fn is_smooth<'p>(channels: impl Iterator<Item = &'p LinePower> + Clone) -> bool {
    let above: f64 = channels.clone().map(|power| power.above_level).sum();
    let lowest: f64 = channels.clone().map(|power| power.lowest).sum();
    channels.map(|power| power.above).any(|above| above.is_some()) && above < lowest
}

/// Whether at its rate a tone is modulated with ten times the power of all else that is heard at it, in the channels that listen for it
/// (C34): elements that pass carry the tone's force, damaged or not.
pub(super) fn is_of_tone<'p>(channels: impl Iterator<Item = &'p LinePower> + Clone) -> bool {
    let tone = channels.clone().map(|power| power.of_tone).fold(0.0, f64::max);
    let blows = channels.map(|power| power.of_blows).fold(0.0, f64::max);
    tone > 0.0 && tone >= OVERHEARD_POWER * blows
}

/// Power a line carries (C4, C45), u².
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct LinePower {
    /// In the lowest band, or the lowest octave of it where it is wide, whether it shows the line or not.
    pub(super) lowest: f64,
    /// The same if it shows the line, else 0.
    lowest_shown: f64,
    /// Upper edge of that band.
    pub(super) lowest_top: Hz,
    /// In the strongest of the bands above that show it, 0 if none does; `None` if there are no bands above.
    pub(super) above: Option<f64>,
    /// The most that it has in a band above for where that lies: power times what a smooth motion has lost up to there, the square root of it, so
    /// that as much as in the lowest lies halfway between what is white and what falls by 12 dB an octave (C12).
    pub(super) above_level: f64,
    /// Whether blows of something else explain the line in every one of those, so that it may be hidden there.
    pub(super) is_hidden_above: bool,
    /// Of the narrowest bands that show the line: in the strongest that a tone leads, and in the strongest of the others that nothing
    /// else explains; 0 if none does.
    pub(super) of_tone: f64,
    pub(super) of_blows: f64,
    /// Of the narrowest bands above the lowest: in all that show the line, and in all, where noise may be what was read.
    summed: f64,
    read: f64,
    /// Of the same bands: power of all that is heard in them.
    loudness: f64,
    /// In the lowest of the narrowest bands or in its octaves together, whichever is more, where they show the line.
    low: f64,
}

impl LinePower {
    /// From the readings as measured (a whitened band has no power of its own), `octaves` those of the lowest band where it is wide.
    pub(super) fn of(
        (readings, octaves): (&[BandReading], &[BandReading]),
        own: impl Fn(&BandReading) -> bool,
        stands: impl Fn(&BandReading) -> bool,
    ) -> Self {
        let raw = || readings.iter().filter(|r| !r.band.whitened);
        let shows = |r: &BandReading| own(r) && stands(r);
        let width = |r: &BandReading| r.band.high.0 - r.band.low.0;
        let narrowest = raw().map(width).fold(f64::INFINITY, f64::min);
        let is_narrow = |r: &&BandReading| width(r) < ALIKE * narrowest;
        let strongest = |found: &dyn Fn(&BandReading) -> bool| {
            let of_band = raw().filter(is_narrow).filter(|r| found(r));
            of_band.map(|r| r.total_depth() * r.mean_square).fold(0.0, f64::max)
        };
        let floor_hz = raw().map(|r| r.band.low.0).fold(f64::INFINITY, f64::min);
        let is_above = |r: &&BandReading| r.band.low.0 > floor_hz;
        let above = || raw().chain(octaves).filter(is_above);
        let power = |r: &BandReading| r.total_depth() * r.mean_square;
        let shown = |r: &BandReading| if shows(r) { power(r) } else { 0.0 };
        let above_narrowest = || raw().filter(is_narrow).filter(is_above);
        let touching = raw().chain(octaves).filter(|r| r.band.low.0 <= floor_hz);
        let lowest = touching.min_by(|a, b| a.band.high.0.total_cmp(&b.band.high.0));
        // What falls lies at the lower end of a wide band.
        let middle = |r: &BandReading| r.band.low.0 + 0.5 * width(r).min(narrowest);
        let times_up = |r: &BandReading| lowest.map_or(1.0, |lowest| middle(r) / middle(lowest));
        let half_fall = |r: &BandReading| times_up(r).powi(2).clamp(LEAST_FALL, MOST_FALL);
        let levels = above().map(|r| shown(r) * half_fall(r));
        Self {
            lowest: lowest.map_or(0.0, power),
            lowest_shown: lowest.map_or(0.0, shown),
            lowest_top: lowest.map_or(Hz(0.0), |r| r.band.high),
            above: above().map(shown).max_by(f64::total_cmp),
            above_level: levels.fold(0.0, f64::max),
            // A tone that is modulated is no blow that hides others.
            is_hidden_above: !above().any(|r| own(r) || r.carrier.is_some()),
            summed: above_narrowest().map(shown).sum(),
            read: above_narrowest().map(power).sum(),
            loudness: above_narrowest().map(|r| r.mean_square).sum(),
            low: raw()
                .filter(is_narrow)
                .filter(|r| !is_above(r))
                .map(shown)
                .sum::<f64>()
                .max(octaves.iter().map(shown).sum()),
            of_tone: strongest(&|r| r.carrier.is_some() && stands(r)),
            of_blows: strongest(&|r| r.carrier.is_none() && shows(r)),
        }
    }

    /// Power the line carries above the lowest band, or in it if nowhere else: what decides who hears it best. High frequencies die out on their
    /// way, low ones shake the whole machine. It is that of all the narrowest bands that show it together: one resonance may be louder far
    /// away than near by.
    pub(super) fn heard(&self) -> f64 {
        let strongest = self.above.filter(|above| *above > 0.0);
        strongest.map_or(self.lowest_shown, |above| above.max(self.summed))
    }

    /// As much as the line may carry in the same bands, noise there taken for it.
    pub(super) fn at_most(&self) -> f64 {
        self.heard().max(self.read)
    }

    /// How many times louder all is here than there, 1 at least: what is louder here comes from here, and is quieter there by as much.
    pub(super) fn louder_than(&self, there: &Self) -> f64 {
        if there.loudness > 0.0 { (self.loudness / there.loudness).max(1.0) } else { 1.0 }
    }

    /// Power the line carries in all bands, the lowest included.
    pub(super) fn whole(&self) -> f64 {
        self.heard().max(self.summed + self.low)
    }
}
