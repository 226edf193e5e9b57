//! What stands in a line's range where a known line of the machine lies: told apart by a harmonic, or not at all.

use super::Band;
use super::DepthSpectrum;
use super::Harmonic;
use super::KnownLine;
use super::LineTask;
use super::N_HARMONICS;
use super::Searched;
use super::read;
use super::searched_range;
use crate::dsp::real::floor_index;
use crate::units::Hz;

/// A line this much deeper than its neighbours in a shaft's series is more than one of them (6 dB): events of a shaft have
/// multiples that fall off evenly.
pub const STANDS_ALONE: f64 = 2.0;

/// The highest line of a band's searched range, where it lies within the resolution of a known line (F5).
#[derive(Debug, Clone, PartialEq)]
pub struct Covered {
    /// The band.
    pub band: Band,
    /// Where it stands.
    pub frequency: Hz,
    /// As read.
    pub harmonic: Harmonic,
    /// The known line.
    pub with: String,
    /// Depth of the deeper of the lines beside the known one in its series: events of a shaft have all its multiples.
    pub beside: f64,
}

/// Reads the highest line in the searched range of one band if a known line lies within the resolution of it (F5).
#[must_use]
pub fn read_covered(
    spectrum: &DepthSpectrum<'_>,
    band: Band,
    task: &LineTask<'_>,
    scratch: &mut Vec<f32>,
) -> Option<Covered> {
    let (at, n_bins, known) = highest(spectrum, task)?;
    let frequency = Hz(at as f64 * spectrum.bin_hz);
    let harmonic = read::measure(spectrum, task, at, Searched::peaks(n_bins), scratch)?;
    let beside = beside(spectrum, task, known);
    Some(Covered { band, frequency, harmonic, with: known.label.clone(), beside })
}

/// The highest line of the searched range, if a known line lies within the resolution of it: its bin, how many were searched, that line.
fn highest<'a>(
    spectrum: &DepthSpectrum<'_>,
    task: &LineTask<'a>,
) -> Option<(usize, f64, &'a KnownLine)> {
    let (low, high) = searched_range(task.line, task.expected, task.band);
    let bins = read::bin_at(low.0, spectrum.bin_hz)..=read::bin_at(high.0, spectrum.bin_hz);
    let n_bins = bins.clone().count() as f64;
    let at = read::strongest_peak(spectrum, bins)?;
    Some((at, n_bins, nearest(Hz(at as f64 * spectrum.bin_hz), task)?))
}

/// Depth of the deeper of the lines beside a known one in its series: of the next but one where the line is a turning race's, whose side bands
/// at the shaft's speed lie at the next.
fn beside(spectrum: &DepthSpectrum<'_>, task: &LineTask<'_>, known: &KnownLine) -> f64 {
    let away = if task.sum_of_races.is_some() { 2.0 } else { 1.0 };
    let places = [-away, away].map(|side| known.frequency.0 + side * known.spacing.0);
    let places = places.into_iter().filter(|hz| *hz > task.resolution.0);
    places.map(|hz| read::depth_at(spectrum, hz)).fold(0.0, f64::max)
}

/// The harmonic by which a line is told from the known one at its place.
#[derive(Debug, Clone, Copy)]
pub(super) struct Told {
    /// Which.
    pub(super) multiple: usize,
    /// Its bin.
    pub(super) at: usize,
    pub(super) harmonic: Harmonic,
    /// Rate of the known line.
    pub(super) known: Hz,
}

/// The lowest harmonic that tells the highest line of the range from a known one within the resolution of it (F5): h times as far from that
/// one's multiple, which the speed's error may move, it stands out where no known line covers it, and the spectrum falls between.
pub(super) fn told_apart(
    spectrum: &DepthSpectrum<'_>,
    task: &LineTask<'_>,
    scratch: &mut Vec<f32>,
) -> Option<Told> {
    let (at, n_bins, known) = highest(spectrum, task)?;
    let (place, depth) = read::peak(spectrum.depth, at);
    if depth < STANDS_ALONE * beside(spectrum, task, known) {
        return None;
    }
    (2..=N_HARMONICS).find_map(|multiple| {
        let h = multiple as f64;
        let reach = multiple.div_ceil(2);
        let centre = floor_index((h * place).round());
        let at = read::strongest_peak(spectrum, centre.saturating_sub(reach)..=centre + reach)?;
        let hz = at as f64 * spectrum.bin_hz;
        let known_hz = h * known.frequency.0;
        let is_other = (hz - known_hz).abs() >= task.known_to * known_hz;
        if nearest(Hz(hz), task).is_some() || !is_other || !is_no_part_of(spectrum, known_hz, hz) {
            return None;
        }
        let harmonic = read::measure(spectrum, task, at, Searched::peaks(h * n_bins), scratch)?;
        read::stands_out(harmonic).then_some(Told {
            multiple,
            at,
            harmonic,
            known: known.frequency,
        })
    })
}

/// Whether what stands at `hz` is no part of the known line's multiple: that is low, or the spectrum falls between the two.
fn is_no_part_of(spectrum: &DepthSpectrum<'_>, known_hz: f64, hz: f64) -> bool {
    let (known, own) = (read::depth_at(spectrum, known_hz), read::depth_at(spectrum, hz));
    known < read::VALLEY * own || read::is_apart(spectrum, known_hz, hz)
}

/// The known line nearest to a place within the resolution of it.
fn nearest<'a>(place: Hz, task: &LineTask<'a>) -> Option<&'a KnownLine> {
    let apart = |line: &KnownLine| (line.frequency.0 - place.0).abs();
    let within = task.known.iter().filter(|line| apart(line) < task.resolution.0);
    within.min_by(|a, b| apart(a).total_cmp(&apart(b)))
}
