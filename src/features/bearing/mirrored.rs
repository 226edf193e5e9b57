//! Whether a line is one of two to either side of a shaft's harmonic (F12). Must not know what else explains a line.

use super::DepthSpectrum;
use super::Harmonic;
use super::LineTask;
use super::outdone::SIDE_BANDS;
use super::read::bin_at;
use super::read::coinciding;
use super::read::depth_at;
use super::read::peak;
use super::read::stands_out;
use super::read::strongest_peak;
use super::slower::equal_line;
use crate::features::speed::TOLD_TO;
use crate::units::Hz;

/// Whether a line half as deep stands as far on the other side of the nearest shaft harmonic, where no side band of its own belongs: events of the
/// shaft whose strength or rate swings have lines to both sides, a defect's rate is its own. The harmonic is where the speed says, or the highest
/// line as far from there as a speed is told. `multiple`: of the line's rate, at which it is told.
pub(super) fn is_mirrored(
    spectrum: &DepthSpectrum<'_>,
    task: &LineTask<'_>,
    (frequency_hz, fundamental, multiple): (f64, Harmonic, f64),
    scratch: &mut Vec<f32>,
) -> bool {
    if !stands_out(fundamental) {
        return false;
    }
    let shaft_hz = (frequency_hz / task.shaft_speed.0).round() * task.shaft_speed.0;
    let seen_hz = highest_near(spectrum, shaft_hz);
    // What stands there may be a side band of what elements make that pass the other race, and no side band is higher than its line.
    let passing = task.sum_of_races.map(|sum| multiple * sum.0 - frequency_hz);
    let passing_depth = passing.map_or(0.0, |hz| depth_at(spectrum, hz));
    [Some(shaft_hz), seen_hz].into_iter().flatten().any(|centre_hz| {
        let mirror_hz = 2.0 * centre_hz - frequency_hz;
        !is_own(task, (mirror_hz - frequency_hz).abs())
            && coinciding(Hz(mirror_hz), task.known, task.resolution).is_none()
            && equal_line(spectrum, task, (mirror_hz, fundamental), scratch)
                .is_some_and(|place_hz| depth_at(spectrum, place_hz) > passing_depth)
    })
}

/// Where the highest line stands near a harmonic of the shaft, Hz.
fn highest_near(spectrum: &DepthSpectrum<'_>, shaft_hz: f64) -> Option<f64> {
    let reach_hz = TOLD_TO * shaft_hz;
    let bins = [shaft_hz - reach_hz, shaft_hz + reach_hz].map(|hz| bin_at(hz, spectrum.bin_hz));
    let at = strongest_peak(spectrum, bins[0]..=bins[1])?;
    Some(peak(spectrum.depth, at).0 * spectrum.bin_hz)
}

/// Whether what stands so far from a line may be itself, or one of its side bands.
fn is_own(task: &LineTask<'_>, apart_hz: f64) -> bool {
    (0..=SIDE_BANDS).any(|k| {
        (apart_hz - f64::from(k) * task.side_band_spacing.0).abs() < 2.0 * task.resolution.0
    })
}
