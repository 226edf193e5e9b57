//! What stands in a line's range where a known line of the machine lies: the two are not told apart there.

use super::Band;
use super::DepthSpectrum;
use super::Harmonic;
use super::KnownLine;
use super::LineTask;
use super::Searched;
use super::read;
use super::searched_range;
use crate::units::Hz;

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
    let (low, high) = searched_range(task.line, task.expected, task.band);
    let bins = read::bin_at(low.0, spectrum.bin_hz)..=read::bin_at(high.0, spectrum.bin_hz);
    let n_bins = bins.clone().count();
    let at = read::strongest_peak(spectrum, bins)?;
    let frequency = Hz(at as f64 * spectrum.bin_hz);
    let known = nearest(frequency, task)?;
    let harmonic = read::measure(spectrum, task, at, Searched::peaks(n_bins as f64), scratch)?;
    let beside = [-1.0, 1.0].map(|side| known.frequency.0 + side * known.spacing.0);
    let lines = beside.iter().filter(|hz| **hz > task.resolution.0);
    let beside = lines.map(|hz| read::depth_at(spectrum, *hz)).fold(0.0, f64::max);
    Some(Covered { band, frequency, harmonic, with: known.label.clone(), beside })
}

/// The known line nearest to a place within the resolution of it.
fn nearest<'a>(place: Hz, task: &LineTask<'a>) -> Option<&'a KnownLine> {
    let apart = |line: &KnownLine| (line.frequency.0 - place.0).abs();
    let within = task.known.iter().filter(|line| apart(line) < task.resolution.0);
    within.min_by(|a, b| apart(a).total_cmp(&apart(b)))
}
