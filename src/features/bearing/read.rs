//! Reads one defect line in the depth spectrum of one band: fundamental, harmonics, side bands, noise floor, and
//! what else may explain it.

use super::Band;
use super::BandReading;
use super::DefectLine;
use super::DepthSpectrum;
use super::FULL_MODULATION;
use super::Harmonic;
use super::KnownLine;
use super::LineTask;
use super::N_HARMONICS;
use super::OVER_SHAFT;
use super::Searched;
use super::carrier;
use super::covered;
use super::mirrored::is_mirrored;
use super::outdone::higher_side_band;
use super::searched_range;
use super::slower::slower_rate;
use crate::dsp::real::floor_index;
use crate::dsp::stats;
use crate::units::Hz;

/// So many bins are worth one independent power: the median of n exponential powers, Hann window, padded twice, scatters like
/// a mean of n/6.2 (F7).
const BINS_A_DEGREE: f64 = 6.2;

/// Bins to either side of a line that its lobe reaches, in a spectrum padded twice: they are no floor.
const LOBE_BINS: usize = 4;

/// A harmonic takes part in the frequency estimate when its power ratio exceeds this: at 12 a noise
/// cell does so once in 160 000.
pub(super) const STANDS_OUT: f64 = 12.0;

/// Whether a harmonic takes part in the frequency estimate.
pub(super) fn stands_out(harmonic: Harmonic) -> bool {
    harmonic.power_ratio > STANDS_OUT
}

/// Finds which known line, if any, blocks the whole neighbourhood of `expected`: slip of races is
/// small and negative, so a line is lost when its kinematic place is covered.
#[must_use]
pub fn coinciding(expected: Hz, known: &[KnownLine], resolution: Hz) -> Option<&KnownLine> {
    known.iter().find(|line| (line.frequency.0 - expected.0).abs() < resolution.0)
}

/// Searches one line in one band (F5–F7, F12). `None` when every cell in tolerance is covered by known
/// lines, from which no harmonic tells it, or outside the spectrum.
#[must_use]
pub fn read_line(
    spectrum: &DepthSpectrum<'_>,
    band: Band,
    task: &LineTask<'_>,
    scratch: &mut Vec<f32>,
) -> Option<BandReading> {
    let (low, high) = searched_range(task.line, task.expected, task.band);
    let first = bin_at(low.0, spectrum.bin_hz);
    let last = bin_at(high.0, spectrum.bin_hz);
    let told = covered::told_apart(spectrum, task, scratch);
    let mut harmonics = [None; N_HARMONICS];
    let mut sums = match told {
        // A harmonic stands for the fundamental that a known line covers.
        Some(told) => {
            harmonics[0] = Some(told.harmonic);
            ((told.multiple * told.at) as f64, (told.multiple * told.multiple) as f64)
        }
        None => {
            let (found, searched) = strongest_line(spectrum, task, first, last)?;
            harmonics[0] = measure(spectrum, task, found, searched, scratch);
            (found as f64, 1.0)
        }
    };
    let fundamental = harmonics[0]?;
    for (i, slot) in harmonics.iter_mut().enumerate().skip(1) {
        let h = i + 1;
        if told.is_some_and(|told| told.multiple >= h) {
            continue;
        }
        let centre = (sums.0 / sums.1 * h as f64).round();
        let reach = h.div_ceil(2);
        let (low, high) = (floor_index(centre).saturating_sub(reach), floor_index(centre) + reach);
        let Some((at, searched)) = strongest(spectrum, task, low, high) else {
            continue;
        };
        *slot = measure(spectrum, task, at, searched, scratch);
        if slot.is_some_and(stands_out) && stands_out(fundamental) {
            sums.0 += (h * at) as f64;
            sums.1 += (h * h) as f64;
        }
    }
    let frequency = sums.0 / sums.1 * spectrum.bin_hz;
    // What stands beside it is read, and held against it, where it is told.
    let multiple = told.map_or(1, |told| told.multiple) as f64;
    let told_hz = multiple * frequency;
    let cage_spacing = task.cage_spacing.filter(|_| stands_out(fundamental));
    let cage_band =
        cage_spacing.and_then(|cage| side_band(spectrum, task, (told_hz, cage), scratch));
    let side_band = side_band(spectrum, task, (told_hz, task.side_band_spacing), scratch);
    let is_shaft_product =
        is_shaft_product(spectrum, task, (told_hz, fundamental.depth), side_band, scratch);
    let is_mirrored = is_mirrored(spectrum, task, (told_hz, fundamental, multiple), scratch);
    let apart_from = told.map(|told| told.known);
    let slower = slower_rate(spectrum, task, (frequency, fundamental), apart_from, scratch);
    Some(BandReading {
        band,
        frequency: Hz(frequency),
        harmonics,
        side_band,
        cage_band,
        is_shaft_product,
        is_mirrored,
        shaft_depth: shaft_depth(spectrum, task, frequency),
        passing_depth: task.sum_of_races.map(|sum| depth_at(spectrum, sum.0 - frequency)),
        slower,
        carrier: spectrum.tone.filter(|t| !carrier::is_own(*t, Hz(frequency), band)),
        outdone_by: higher_side_band(spectrum, task, (told_hz, fundamental)),
        mean_square: spectrum.mean_square,
    })
}

/// Bins among `first..=last` that lie in the spectrum and that no known line covers.
fn open_bins<'a>(
    spectrum: &'a DepthSpectrum<'_>,
    task: &'a LineTask<'_>,
    first: usize,
    last: usize,
) -> impl Iterator<Item = usize> + 'a {
    (first.max(2)..=last).filter(|k| *k < spectrum.depth.len()).filter(|k| {
        coinciding(Hz(*k as f64 * spectrum.bin_hz), task.known, task.resolution).is_none()
    })
}

/// Highest side band at the shaft's speed, over its line, of a defect whose load turns in part with the shaft: blows of amplitude 1 + m·cos θ
/// have m/(1 + m²/2), 0.71 at most, and noise adds to it.
const TURNING_LOAD: f64 = 0.8;

/// Whether a line of the race at rest or of a rolling element has higher side bands at the shaft's speed than full
/// modulation makes (F12). `side_band_read`: those at its own spacing, for a race the shaft's speed.
fn is_shaft_product(
    spectrum: &DepthSpectrum<'_>,
    task: &LineTask<'_>,
    (frequency_hz, depth): (f64, f64),
    side_band_read: Option<Harmonic>,
    scratch: &mut Vec<f32>,
) -> bool {
    let at_shaft = match task.line {
        DefectLine::TwoBsf => side_band(spectrum, task, (frequency_hz, task.shaft_speed), scratch),
        DefectLine::Bpfi | DefectLine::Bpfo | DefectLine::Ftf => {
            side_band_read.filter(|_| task.is_at_rest)
        }
    };
    let Some(side) = at_shaft.filter(|side| side.depth > FULL_MODULATION * depth) else {
        return false;
    };
    let speed_hz = task.shaft_speed.0;
    let of_shaft = depth_at(spectrum, speed_hz).max(shaft_depth(spectrum, task, frequency_hz));
    let is_of_load = task.is_at_rest
        && task.line != DefectLine::TwoBsf
        && side.depth <= TURNING_LOAD * depth
        && depth > OVER_SHAFT * of_shaft;
    !is_of_load
}

/// Reads the stronger of the side bands at ± spacing around a frequency.
fn side_band(
    spectrum: &DepthSpectrum<'_>,
    task: &LineTask<'_>,
    (frequency_hz, spacing): (f64, Hz),
    scratch: &mut Vec<f32>,
) -> Option<Harmonic> {
    [-1.0, 1.0]
        .iter()
        .filter_map(|sign| {
            let centre = bin_at(frequency_hz + sign * spacing.0, spectrum.bin_hz);
            let (at, _) = strongest(spectrum, task, centre.saturating_sub(1), centre + 1)?;
            // Three bins at either place, and the stronger counts.
            measure(spectrum, task, at, Searched::largest(6.0, 2.0), scratch)
        })
        .max_by(|a, b| a.power_ratio.total_cmp(&b.power_ratio))
}

/// Two lines are apart if the spectrum falls between them to this part of the lower; Hann lobes of lines that are resolved do
/// not meet.
pub(super) const VALLEY: f64 = 0.25;

/// Whether the spectrum falls between two lines below a quarter of either: one that is smeared over both does not.
pub(super) fn is_apart(spectrum: &DepthSpectrum<'_>, one_hz: f64, other_hz: f64) -> bool {
    let (one, other) = (bin_at(one_hz, spectrum.bin_hz), bin_at(other_hz, spectrum.bin_hz));
    let lower = depth_at(spectrum, one_hz).min(depth_at(spectrum, other_hz));
    let between = spectrum.depth.get(one.min(other)..=one.max(other)).unwrap_or_default();
    between.iter().any(|d| f64::from(*d) < VALLEY * lower)
}

/// Strongest local maximum among `bins`: a bin beside a higher one is the skirt of another line.
pub(super) fn strongest_peak(
    spectrum: &DepthSpectrum<'_>,
    bins: std::ops::RangeInclusive<usize>,
) -> Option<usize> {
    let depth = spectrum.depth;
    let is_peak = |k: &usize| depth[*k] >= depth[*k - 1] && depth[*k] >= depth[*k + 1];
    let (first, last) = (*bins.start().max(&2), *bins.end());
    (first..=last.min(depth.len().saturating_sub(2)))
        .filter(is_peak)
        .max_by(|a, b| depth[*a].total_cmp(&depth[*b]))
}

/// Depth of the deeper of the shaft harmonics below and above `frequency_hz` (F12); one whose lobe meets the
/// line's own is not read.
fn shaft_depth(spectrum: &DepthSpectrum<'_>, task: &LineTask<'_>, frequency_hz: f64) -> f64 {
    let speed_hz = task.shaft_speed.0;
    if speed_hz <= 0.0 {
        return 0.0;
    }
    let below = (frequency_hz / speed_hz).floor() * speed_hz;
    [below, below + speed_hz]
        .iter()
        .filter(|f| **f > 0.0 && (**f - frequency_hz).abs() > 2.0 * task.resolution.0)
        .map(|f| depth_at(spectrum, *f))
        .fold(0.0, f64::max)
}

/// Depth of the highest of three bins at a known place.
pub(in crate::features) fn depth_at(spectrum: &DepthSpectrum<'_>, frequency_hz: f64) -> f64 {
    highest_within(spectrum, frequency_hz, 0.0).1
}

/// Place and depth of the highest of the bins within `reach_hz` of a place, and of one more to either side.
pub(super) fn highest_within(
    spectrum: &DepthSpectrum<'_>,
    centre_hz: f64,
    reach_hz: f64,
) -> (f64, f64) {
    let first = bin_at((centre_hz - reach_hz).max(0.0), spectrum.bin_hz).saturating_sub(1);
    let last = bin_at((centre_hz + reach_hz).max(0.0), spectrum.bin_hz) + 1;
    let near = (first..=last).filter(|k| *k < spectrum.depth.len());
    let highest = near.max_by(|a, b| spectrum.depth[*a].total_cmp(&spectrum.depth[*b]));
    highest
        .map_or((centre_hz, 0.0), |k| (k as f64 * spectrum.bin_hz, peak_height(spectrum.depth, k)))
}

/// Strongest local maximum of `first..=last` that no known line covers, and what it was searched in: what rises towards a bin
/// beside it is the skirt of a line there (F14).
fn strongest_line(
    spectrum: &DepthSpectrum<'_>,
    task: &LineTask<'_>,
    first: usize,
    last: usize,
) -> Option<(usize, Searched)> {
    let depth = spectrum.depth;
    let mut bins = 0.0;
    let at = open_bins(spectrum, task, first, last.min(depth.len().saturating_sub(2)))
        .inspect(|_| bins += 1.0)
        .filter(|k| depth[*k] >= depth[*k - 1] && depth[*k] >= depth[*k + 1])
        .max_by(|a, b| depth[*a].total_cmp(&depth[*b]))?;
    Some((at, Searched::peaks(bins)))
}

/// Strongest bin of `first..=last` that no known line covers, and what it was searched in.
fn strongest(
    spectrum: &DepthSpectrum<'_>,
    task: &LineTask<'_>,
    first: usize,
    last: usize,
) -> Option<(usize, Searched)> {
    let mut bins = 0.0;
    let at = open_bins(spectrum, task, first, last)
        .inspect(|_| bins += 1.0)
        .max_by(|a, b| spectrum.depth[*a].total_cmp(&spectrum.depth[*b]))?;
    Some((at, Searched::largest(bins, 1.0)))
}

/// Reads bin `at` against the median of its neighbourhood without its own lobe; for exponential noise powers the mean is
/// median/ln 2 (F7).
pub(super) fn measure(
    spectrum: &DepthSpectrum<'_>,
    task: &LineTask<'_>,
    at: usize,
    searched: Searched,
    scratch: &mut Vec<f32>,
) -> Option<Harmonic> {
    let half = floor_index(task.floor_half_width.0 / spectrum.bin_hz).max(8);
    let low = at.saturating_sub(half).max(2);
    let high = (at + half).min(spectrum.depth.len().saturating_sub(1));
    if high <= low + 8 {
        return None;
    }
    scratch.clear();
    scratch.extend_from_slice(&spectrum.depth[low..at.saturating_sub(LOBE_BINS).max(low)]);
    scratch.extend_from_slice(&spectrum.depth[(at + LOBE_BINS + 1).min(high + 1)..high + 1]);
    let n_around = scratch.len() as f64;
    let median = f64::from(stats::median(scratch)?);
    let floor_power = median * median / std::f64::consts::LN_2;
    let bin_height = f64::from(spectrum.depth[at]);
    if floor_power <= 0.0 {
        return None;
    }
    Some(Harmonic {
        power_ratio: bin_height * bin_height / floor_power,
        depth: peak_height(spectrum.depth, at),
        floor_dof: (n_around / BINS_A_DEGREE).max(1.0),
        searched,
    })
}

/// Height of the line whose highest bin is `at` (F6).
pub(super) fn peak_height(depth: &[f32], at: usize) -> f64 {
    peak(depth, at).1
}

/// Place, in bins, and height of the line whose highest bin is `at` (F6): the vertex of the parabola
/// through the logarithms of three bins. The spectrum is padded twice, so the bins lie half a resolution
/// step apart and the height of a lone line is found within 0.3 %, where the bin itself may be 4 %
/// low. A bin that is no local maximum is read as it is.
pub(super) fn peak(depth: &[f32], at: usize) -> (f64, f64) {
    let value = |k: usize| depth.get(k).map_or(0.0, |v| f64::from(*v));
    let (left, centre, right) = (value(at.wrapping_sub(1)), value(at), value(at + 1));
    let is_peak = left > 0.0 && right > 0.0 && centre >= left && centre >= right;
    let (a, b, c) = (left.ln(), centre.ln(), right.ln());
    let curvature = a - 2.0 * b + c;
    if !is_peak || curvature >= 0.0 {
        return (at as f64, centre);
    }
    let shift = 0.5 * (a - c) / curvature;
    (at as f64 + shift, (b - (a - c).powi(2) / (8.0 * curvature)).exp())
}

pub(super) fn bin_at(frequency_hz: f64, bin_hz: f64) -> usize {
    floor_index((frequency_hz / bin_hz).round())
}
