//! Whether a line is a multiple of something slower: strikes at a rate have lines at every multiple of it (F14). Must not know what the line is of.

use super::DefectLine;
use super::DepthSpectrum;
use super::Harmonic;
use super::LineTask;
use super::Searched;
use super::read::STANDS_OUT;
use super::read::bin_at;
use super::read::measure;
use super::read::peak;
use super::read::strongest_peak;
use super::spread::Spread;
use super::spread::WANDER;
use super::spread::is_sharp;
use super::spread::wander_together;
use crate::dsp::real::floor_index;
use crate::units::Hz;

/// Highest multiple of a slower rate that a line is checked for: shafts have knocks, and bearings of
/// fewer than a dozen elements other lines, this far below a defect's.
const HIGHEST_MULTIPLE: u32 = 12;

/// From this multiple on the comb beside the line is looked at, too: the rate itself is placed the worse the higher the multiple.
const LOWEST_OF_COMB: u32 = 5;

/// Highest multiple of a comb's rate: what strikes every other or every third turn has lines that reach over all of a defect's, and so has a slow
/// shaft. The tolerance ends most searches before it.
const HIGHEST_OF_COMB: u32 = 100;

/// Above this multiple a comb must reach on: so many spacings are tried that two lines may meet one by chance.
const HIGHEST_OF_TWO: u32 = 40;

/// Half the distance of two lines is known to this, cells, where each is placed within a tenth (0.1/√2).
const SPACING_TOLERANCE: f64 = 0.07;

/// The tolerance tells a multiple from what lies between two as long as it is this part of the rate at most.
const MOST_TOLERANCE: f64 = 0.25;

/// That many times the tolerance where a comb reaches on: lines half as deep may be placed so badly, and four need not meet by chance.
const REACHING_TOLERANCE: f64 = 2.0;

/// A slower rate's line must be this part as high: strikes have lines of heights that fall with the rate.
const EQUAL_HEIGHT: f64 = 0.5;

/// A rate and its m-th harmonic are found this near to a multiple, cells: an amplitude 11 dB over the noise
/// places a line within a tenth of a cell, and that counts m times.
const MULTIPLE_TOLERANCE: f64 = 0.6;

/// The rate f/m of which the line at f is the m-th harmonic, if any (F14): it stands out, and is at
/// least half as deep. Half the rate of a rolling element's line is its own: one race struck. A known line that the line is told `apart_from`
/// by a harmonic has its own submultiples: what stands rather there is none of the line's.
pub(super) fn slower_rate(
    spectrum: &DepthSpectrum<'_>,
    task: &LineTask<'_>,
    (frequency_hz, fundamental): (f64, Harmonic),
    apart_from: Option<Hz>,
    scratch: &mut Vec<f32>,
) -> Option<Hz> {
    let spread = Spread::over_floor_of(fundamental, spectrum, task);
    let wander = if is_sharp(&spread, frequency_hz) { 0.0 } else { WANDER };
    let tolerance_hz = (MULTIPLE_TOLERANCE / spectrum.duration_s).max(wander * frequency_hz);
    let first = if task.line == DefectLine::TwoBsf { 3 } else { 2 };
    let below = (first..=HIGHEST_MULTIPLE).map(f64::from).find_map(|multiple| {
        let centre = bin_at(frequency_hz / multiple, spectrum.bin_hz);
        let reach = floor_index(tolerance_hz / multiple / spectrum.bin_hz) + 1;
        let at = strongest_peak(spectrum, centre.saturating_sub(reach)..=centre + reach)?;
        let (place, height) = peak(spectrum.depth, at);
        let slower_hz = place * spectrum.bin_hz;
        let apart_hz = (multiple * slower_hz - frequency_hz).abs();
        let is_known_ones =
            apart_from.is_some_and(|known| (multiple * slower_hz - known.0).abs() < apart_hz);
        let is_multiple = apart_hz <= tolerance_hz
            && !is_known_ones
            && (apart_hz <= MULTIPLE_TOLERANCE / spectrum.duration_s
                || wander_together(&spread, (slower_hz, multiple, frequency_hz)));
        let is_equal = is_multiple && height >= EQUAL_HEIGHT * fundamental.depth;
        let bins = 2.0 * reach as f64 + 1.0;
        let found =
            measure(spectrum, task, at, Searched::peaks(bins), scratch).filter(|_| is_equal)?;
        (found.power_ratio > STANDS_OUT).then_some(Hz(slower_hz))
    });
    below.or_else(|| comb_rate(spectrum, task, (frequency_hz, fundamental), scratch))
}

/// Where a line stands out within a bin of `near_hz` that is half as deep as the fundamental at least, Hz.
pub(super) fn equal_line(
    spectrum: &DepthSpectrum<'_>,
    task: &LineTask<'_>,
    (near_hz, fundamental): (f64, Harmonic),
    scratch: &mut Vec<f32>,
) -> Option<f64> {
    let centre = bin_at(near_hz, spectrum.bin_hz);
    let at = strongest_peak(spectrum, centre.saturating_sub(1)..=centre + 1)?;
    let (place, height) = peak(spectrum.depth, at);
    if height < EQUAL_HEIGHT * fundamental.depth {
        return None;
    }
    let read = measure(spectrum, task, at, Searched::peaks(3.0), scratch)?;
    (read.power_ratio > STANDS_OUT).then_some(place * spectrum.bin_hz)
}

/// The rate g of a comb of which the line at f is the m-th, m = 5 and above (F14): the lines f ± g beside it stand
/// out and are half as deep at least, as those of strikes are that have many; a defect's line has none there. Up to the multiples that are
/// looked for otherwise, and at the spacing of its own side bands, f ± 2g must, too.
fn comb_rate(
    spectrum: &DepthSpectrum<'_>,
    task: &LineTask<'_>,
    (frequency_hz, fundamental): (f64, Harmonic),
    scratch: &mut Vec<f32>,
) -> Option<Hz> {
    let mut place_of_equal =
        |near_hz: f64| equal_line(spectrum, task, (near_hz, fundamental), scratch);
    // Where a tolerance is a quarter of the rate, side bands at any spacing would meet it.
    let tolerance_hz = |m: f64, times: f64| {
        let hz = times * m * SPACING_TOLERANCE / spectrum.duration_s;
        Some(hz).filter(|hz| *hz <= MOST_TOLERANCE * frequency_hz / m)
    };
    let is_told = |m: &f64| tolerance_hz(*m, 1.0).is_some();
    let mut multiples = (LOWEST_OF_COMB..=HIGHEST_OF_COMB).map(f64::from).take_while(is_told);
    multiples.find_map(|m| {
        let below = place_of_equal(frequency_hz - frequency_hz / m)?;
        let above = place_of_equal(frequency_hz + frequency_hz / m)?;
        let spacing = (above - below) / 2.0;
        // The multiple is one that is looked for or the next.
        let m = (frequency_hz / spacing).round();
        let apart = (m * spacing - frequency_hz).abs();
        let is_multiple = |times: f64| tolerance_hz(m, times).is_some_and(|hz| apart <= hz);
        let is_common = (spacing - task.side_band_spacing.0).abs() <= task.resolution.0
            || !(f64::from(HIGHEST_MULTIPLE + 1)..=f64::from(HIGHEST_OF_TWO)).contains(&m);
        let mut reaches_on = || {
            place_of_equal(frequency_hz - 2.0 * spacing).is_some()
                && place_of_equal(frequency_hz + 2.0 * spacing).is_some()
        };
        let is_of_comb = is_multiple(1.0) && !is_common
            || (is_multiple(1.0) || is_multiple(REACHING_TOLERANCE)) && reaches_on();
        is_of_comb.then_some(Hz(spacing))
    })
}

#[cfg(test)]
mod tests {
    use super::super::tests::of_ten_seconds;
    use super::super::tests::spectrum_of;
    use super::super::tests::task;
    use super::*;

    const FUNDAMENTAL: Harmonic = Harmonic {
        power_ratio: 900.0,
        depth: 0.8,
        floor_dof: 100.0,
        searched: Searched::peaks(60.0),
    };

    /// The slower rate found for a line at 98.9 Hz of 10 s.
    fn slower_of(lines: &[(f64, f64)], apart_from: Option<Hz>) -> Option<Hz> {
        let depth = spectrum_of(lines, 0.05);
        let spectrum = of_ten_seconds(&depth);
        slower_rate(&spectrum, &task(&[]), (98.9, FUNDAMENTAL), apart_from, &mut Vec::new())
    }

    /// A rate of 33.1 Hz that wanders, its third multiple highest at one end.
    const WANDERING: [(f64, f64); 6] =
        [(98.9, 0.8), (98.5, 0.6), (99.3, 0.6), (99.7, 0.6), (100.0, 0.5), (33.1, 0.5)];

    #[test]
    fn what_stands_rather_at_a_submultiple_of_the_known_line_is_not_slower() {
        // A known line at 99.2 Hz rather is the third of 33.1 Hz.
        let found = slower_of(&WANDERING, None);
        assert!(found.is_some_and(|rate| (rate.0 - 33.1).abs() < 0.02), "{found:?}");
        assert!(slower_of(&WANDERING, Some(Hz(98.7))).is_some(), "nearer to the line's own third");
        assert_eq!(slower_of(&WANDERING, Some(Hz(99.2))), None);
    }

    #[test]
    fn a_line_that_slip_broadens_is_no_multiple_it_lies_beside() {
        // As wide as the one that wanders about 99.3 Hz, but about 98.9 Hz.
        let broad = [(98.9, 0.8), (98.5, 0.6), (99.3, 0.6), (98.2, 0.4), (99.6, 0.4), (33.1, 0.5)];
        assert_eq!(slower_of(&broad, None), None);
        // A third of it within 0.6/T is slower, whatever the line looks like.
        let sharp = [(98.9, 0.8), (32.967, 0.5)];
        assert!(slower_of(&sharp, None).is_some());
    }
}
