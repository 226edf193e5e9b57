//! Demodulation bands: which slices of the spectrum the envelope is taken of.
//!
//! A fixed dyadic set (the whole usable band, halves, quarters) is read both as measured and after
//! whitening, instead of one "best" band: a defect's impacts are broadband, a structural line is
//! not, and a set of fixed size has a known price in false alarms (theory: docs/theory.md, F4). Where the usable
//! band is much wider than what structures ring in, the same sets of its lower parts are read as well.

use crate::machine::sensor::Sensor;
use crate::units::Hz;

/// One band of the spectrum, and whether it is read after whitening.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Band {
    /// Lower edge.
    pub low: Hz,
    /// Upper edge.
    pub high: Hz,
    /// Read after division by the local spectral level, discrete lines clipped.
    pub whitened: bool,
}

impl Band {
    /// Whether `other` is a part of this band, or all of it, by its middle: bands of a set lie inside one another or apart.
    #[must_use]
    pub fn holds(&self, other: &Self) -> bool {
        let width_hz = |band: &Self| band.high.0 - band.low.0;
        let middle_hz = 0.5 * (other.low.0 + other.high.0);
        (self.low.0..=self.high.0).contains(&middle_hz) && width_hz(self) > 0.9 * width_hz(other)
    }
}

/// Into how many equal bands the usable band is split at each level.
const SPLITS: [u32; 3] = [1, 2, 4];

/// Levels there are: the whole, halves, quarters.
pub const LEVELS: usize = SPLITS.len();

/// Motions that passing elements impose end below this many times their rate: of a smooth one, 12 dB an octave, less than a thousandth is left
/// above the eighth harmonic.
const MOTION_LINES: f64 = 8.0;

/// The lowest octave holds the first three harmonics: above them 22 dB less is left of a smooth motion, twice what C12 asks of the next octave. So many the lowest
/// quarter of records of 10 kHz holds on which sound bearings were tried at 60 Hz.
const OCTAVE_LINES: f64 = 3.0;

/// Nor is the band they live in cut below 1 kHz: modes of shafts and housings ring there, and carry such motions upwards. Records of 10 kHz have
/// their lowest quarter there, and it is on those that sound bearings were tried.
pub const MOTION: Hz = Hz(1000.0);

/// Part of the Nyquist band that is used when the sensor states no usable band: anti-alias filters
/// of the field roll off above 0.9…0.95 of it.
const USABLE_PART_OF_NYQUIST: f64 = 0.95;

/// Gives the band in which a sensor's signal may be believed, by its file or its sample rate.
#[must_use]
pub fn usable_band(sensor: &Sensor, sample_rate: Hz) -> (Hz, Hz) {
    let top = Hz(sample_rate.0 / 2.0 * USABLE_PART_OF_NYQUIST);
    match sensor.usable {
        Some((low, high)) => (low, Hz(high.0.min(top.0))),
        None => (Hz(0.0), top),
    }
}

/// Lists the bands inside `usable` of the first `levels` that are at least `min_width` wide, widest first.
#[must_use]
pub fn demodulation_bands(usable: (Hz, Hz), min_width: Hz, levels: usize) -> Vec<Band> {
    split((usable.0, usable.1.0 - usable.0.0), min_width, levels)
}

/// The same from `low` on, `width_hz` wide in all.
fn split((low, width_hz): (Hz, f64), min_width: Hz, levels: usize) -> Vec<Band> {
    let mut bands = Vec::new();
    for whitened in [false, true] {
        for parts in SPLITS.into_iter().take(levels) {
            let width = width_hz / f64::from(parts);
            if width < min_width.0 {
                break;
            }
            for part in 0..parts {
                let start = low.0 + f64::from(part) * width;
                bands.push(Band { low: Hz(start), high: Hz(start + width), whitened });
            }
        }
    }
    bands
}

/// The same sets of the lower half of `usable`, of its lower quarter, and so on, as long as the lowest of the narrowest bands holds eight times
/// the rate of the `fastest` line and 1 kHz (F4): what a record tells that is sampled half as fast. Widest first; empty where there is none.
#[must_use]
pub fn lower_sets(usable: (Hz, Hz), fastest: Hz, levels: usize) -> Vec<Vec<Band>> {
    let Some(parts) = SPLITS.into_iter().take(levels).next_back() else {
        return Vec::new();
    };
    let least = Hz(MOTION.0.max(MOTION_LINES * fastest.0));
    let widths = std::iter::successors(Some(0.5 * (usable.1.0 - usable.0.0)), |w| Some(0.5 * w));
    widths
        .take_while(|width| width / f64::from(parts) >= least.0)
        .map(|width| split((usable.0, width), least, levels))
        .collect()
}

/// Cuts the lowest of the narrowest of `levels` bands into octaves from the top down, as long as what is left below holds three times the
/// rate of the `fastest` line and 1 kHz (F4); from the lowest up, as measured. Empty where it is too narrow for that.
#[must_use]
pub fn octaves_of_lowest(usable: (Hz, Hz), fastest: Hz, levels: usize) -> Vec<Band> {
    let Some(parts) = SPLITS.into_iter().take(levels).next_back() else {
        return Vec::new();
    };
    let low = usable.0;
    let least = MOTION.0.max(OCTAVE_LINES * fastest.0);
    let mut width = (usable.1.0 - low.0) / f64::from(parts);
    let mut bands = Vec::new();
    let octave = |from: f64, to: f64| {
        let (low, high) = (Hz(low.0 + from), Hz(low.0 + to));
        Band { low, high, whitened: false }
    };
    while width / 2.0 >= least {
        bands.push(octave(width / 2.0, width));
        width /= 2.0;
    }
    if !bands.is_empty() {
        bands.push(octave(0.0, width));
        bands.reverse();
    }
    bands
}

/// What a quarter of the bands reach: the ⌈n/4⌉-th largest of a value each; 0 without bands.
#[must_use]
pub fn quarter_reach(values: impl Iterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(|a, b| b.total_cmp(a));
    let quarter = sorted.len().div_ceil(4);
    sorted.get(quarter.saturating_sub(1)).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_tile_the_usable_band_at_each_level() {
        let bands = demodulation_bands((Hz(100.0), Hz(4100.0)), Hz(500.0), LEVELS);
        assert_eq!(bands.len(), 14);
        let quarters: Vec<_> = bands.iter().filter(|b| b.high.0 - b.low.0 < 1001.0).collect();
        assert_eq!(quarters.len(), 8);
        assert!((quarters[3].high.0 - 4100.0).abs() < 1e-9, "exact sums of representable widths");
    }

    #[test]
    fn a_band_holds_itself_and_its_parts() {
        let bands = demodulation_bands((Hz(0.1), Hz(4100.0)), Hz(500.0), LEVELS);
        let held = |i: usize| bands.iter().filter(|b| bands[i].holds(b)).count();
        // The whole, a half and a quarter, as measured and whitened.
        assert_eq!([held(0), held(1), held(2), held(3), held(6)], [14, 6, 6, 2, 2]);
    }

    #[test]
    fn a_wide_lowest_band_is_cut_down_to_the_motion_of_passing_elements() {
        let octaves = |top: f64, fastest: f64| -> Vec<(f64, f64)> {
            let bands = octaves_of_lowest((Hz(0.0), Hz(top)), Hz(fastest), LEVELS);
            bands.iter().map(|b| (b.low.0, b.high.0)).collect()
        };
        // 12, 64 and 200 kHz.
        assert!(octaves(5_700.0, 100.0).is_empty());
        let three = [(0.0, 1_900.0), (1_900.0, 3_800.0), (3_800.0, 7_600.0)];
        assert_eq!(octaves(30_400.0, 100.0), three);
        let many = octaves(95_000.0, 100.0);
        assert_eq!(many.len(), 5);
        assert!((many[0].1 - 1_484.375).abs() < 1e-9 && (many[4].1 - 23_750.0).abs() < 1e-9);
        assert!(many.windows(2).all(|pair| (pair[0].1 - pair[1].0).abs() < 1e-9), "they tile it");
        // Fast elements move the machine at higher frequencies.
        assert_eq!(octaves(95_000.0, 700.0).len(), 4);
        assert_eq!(octaves(30_400.0, 1_200.0).len(), 2);
        assert!(octaves(30_400.0, 1_300.0).is_empty());
    }

    #[test]
    fn sets_below_are_those_of_a_record_that_is_sampled_half_as_fast() {
        let usable = |top: f64| (Hz(10.0), Hz(10.0 + top));
        let sets = lower_sets(usable(30_400.0), Hz(100.0), LEVELS);
        assert_eq!(sets.len(), 2, "a quarter of 7.6 kHz holds 1 kHz, of 3.8 it does not");
        for (set, top) in sets.iter().zip([15_200.0, 7_600.0]) {
            assert_eq!(*set, demodulation_bands(usable(top), Hz(250.0), LEVELS));
        }
        // Whole and halves of a set are the halves and quarters of that above: read once.
        let above = demodulation_bands(usable(30_400.0), Hz(250.0), LEVELS);
        assert_eq!(sets[0].iter().filter(|band| above.contains(band)).count(), 6);
        assert!(lower_sets(usable(5_700.0), Hz(100.0), LEVELS).is_empty(), "12 kHz");
        assert_eq!(lower_sets(usable(30_400.0), Hz(400.0), LEVELS).len(), 1, "eight lines");
        assert!(lower_sets(usable(f64::NAN), Hz(100.0), LEVELS).is_empty());
    }

    #[test]
    fn too_narrow_bands_are_left_out() {
        assert_eq!(demodulation_bands((Hz(0.0), Hz(1000.0)), Hz(400.0), LEVELS).len(), 6);
        assert_eq!(demodulation_bands((Hz(0.0), Hz(1000.0)), Hz(1.0), 1).len(), 2);
        assert!(demodulation_bands((Hz(0.0), Hz(1000.0)), Hz(1001.0), LEVELS).is_empty());
    }
}
