//! How the power of a line lies about its place: in its lobe, or spread by what wanders (F14). Must not know what the line is of.

use super::DepthSpectrum;
use super::Harmonic;
use super::LineTask;
use super::read::bin_at;
use super::read::is_apart;

/// A line of what wanders lies this near to a multiple, relative, unless it is sharp: three standard deviations of the speed of an induction motor
/// that wanders by 0.3 % while the window lasts. Its lines are smeared, highest where the speed turns back, and a line and its multiple need not
/// be highest at the same turn.
pub(super) const WANDER: f64 = 9e-3;

/// What wanders together has its power this near to one multiple, relative, on average: one of those deviations.
const DEVIATION: f64 = WANDER / 3.0;

/// Part of the power nearby that the main lobe of a sharp line holds: at least; a line that wanders over twice its lobe's
/// width has half of it outside, one that mostly rests where the speed turns back a fifth.
const SHARP: f64 = 0.9;

/// Half width of a Hann main lobe, steps of 1/T.
const HANN_LOBE: f64 = 2.0;

/// The power over a floor around a line.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spread<'a> {
    spectrum: &'a DepthSpectrum<'a>,
    task: &'a LineTask<'a>,
    /// Mean power of the noise in a bin.
    floor: f64,
}

impl<'a> Spread<'a> {
    /// Over the floor beside `line`.
    pub(super) fn over_floor_of(
        line: Harmonic,
        spectrum: &'a DepthSpectrum<'a>,
        task: &'a LineTask<'a>,
    ) -> Self {
        Self { spectrum, task, floor: line.depth * line.depth / line.power_ratio }
    }

    fn lobe_hz(&self) -> f64 {
        HANN_LOBE / self.spectrum.duration_s
    }

    /// Known lines as near to `about_hz` as `reach_hz` and the resolution, and apart from a line at `frequency_hz`, Hz.
    fn known_apart(&self, frequency_hz: f64, (about_hz, reach_hz): (f64, f64)) -> Vec<f64> {
        let reach_hz = reach_hz + self.task.resolution.0;
        let near = |hz: &f64| (hz - about_hz).abs() < reach_hz;
        let known = self.task.known.iter().map(|line| line.frequency.0).filter(near);
        known.filter(|hz| is_apart(self.spectrum, *hz, frequency_hz)).collect()
    }

    /// Frequencies and powers over the floor of the bins within `reach_hz` of `about_hz`, those at `known` lines left out.
    fn powers<'b>(
        &'b self,
        (about_hz, reach_hz): (f64, f64),
        known: &'b [f64],
    ) -> impl Iterator<Item = (f64, f64)> + 'b {
        let bin_hz = self.spectrum.bin_hz;
        let is_known =
            |hz: f64| known.iter().any(|known_hz| (known_hz - hz).abs() < self.task.resolution.0);
        let bins =
            bin_at((about_hz - reach_hz).max(0.0), bin_hz)..=bin_at(about_hz + reach_hz, bin_hz);
        bins.filter_map(move |k| {
            let depth = f64::from(*self.spectrum.depth.get(k)?);
            let hz = k as f64 * bin_hz;
            (!is_known(hz)).then_some((hz, depth * depth - self.floor))
        })
    }

    /// Where the power lies on average as far around `about_hz` as a line at `frequency_hz` may wander, Hz: of what wanders the mean of the
    /// frequencies it has had, wherever it is highest.
    fn centroid(&self, frequency_hz: f64, about_hz: f64) -> f64 {
        let range = (about_hz, WANDER * frequency_hz + self.lobe_hz());
        let known = self.known_apart(frequency_hz, range);
        let (moment, power) = self
            .powers(range, &known)
            .fold((0.0, 0.0), |(moment, power), (hz, p)| (moment + (hz - about_hz) * p, power + p));
        if power > 0.0 { about_hz + moment / power } else { frequency_hz }
    }
}

/// Whether the main lobe at `frequency_hz` holds most of the power over the floor as far around it as a line may wander, known
/// lines apart from it left out: then it has not wandered, and neither has what it is a multiple of.
pub(super) fn is_sharp(spread: &Spread<'_>, frequency_hz: f64) -> bool {
    let (lobe_hz, reach_hz) = (spread.lobe_hz(), WANDER * frequency_hz);
    if reach_hz <= lobe_hz {
        return false;
    }
    let known = spread.known_apart(frequency_hz, (frequency_hz, reach_hz));
    let power_within = |within_hz: f64| -> f64 {
        spread.powers((frequency_hz, within_hz), &known).map(|(_, power)| power).sum()
    };
    power_within(lobe_hz) >= SHARP * power_within(reach_hz)
}

/// Whether the power about a line at `frequency_hz` lies on average at the `multiple` of a slower line's place, or of where the power about that
/// lies: what wanders takes its multiples along, and what slip broadens lies about a rate of its own.
pub(super) fn wander_together(
    spread: &Spread<'_>,
    (slower_hz, multiple, frequency_hz): (f64, f64, f64),
) -> bool {
    let places = [slower_hz, spread.centroid(slower_hz, slower_hz)];
    places.iter().map(|place_hz| multiple * place_hz).any(|about_hz| {
        let apart_hz = spread.centroid(frequency_hz, about_hz) - about_hz;
        apart_hz.abs() <= DEVIATION * frequency_hz
    })
}
