//! How much of a channel's energy comes in blows, whatever their rate (docs/theory.md, F25).
//!
//! What bearing lines cannot tell: elements that slip strike at no rate. Read in the whitened bands, in which tones and whatever turns
//! with the shafts are down at the noise. Must not know what is healthy.

use super::Feature;
use super::bands;
use super::bands::Band;
use super::bearing;
use super::bearing::DepthSpectrum;
use super::trace::Trace;
use crate::dsp::impulsive;
use crate::signal::ChannelIndex;
use crate::units::Hz;
use crate::units::Unit;
use std::sync::Arc;

/// Values of the squared envelope whose median is taken: it is then known to 2.3 %.
const N_VALUES: usize = 4096;

/// Multiples of a shaft's speed at which its events are looked for.
const ORDERS: u32 = 10;

/// First bin of a rate that something foreign may keep: below lie drifts of the level.
const FIRST_BIN: usize = 16;

/// Blows at a rate have nearly as much at twice and three times that; modulation has not.
const HALF: f64 = 0.5;

/// Name of the feature "amplitude of blows over that of the rest".
pub const BLOWS: &str = "blows_over_rest";

/// Least value of that feature: what is less cannot be told from noise, and has no ratio.
const LEAST: f64 = 0.1;

/// Blows in one band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Blows {
    /// The band.
    pub band: Band,
    /// Part of the band's energy.
    pub part: f64,
    /// Whether they keep a rate that is none of a bearing's: a shaft's, or that of something foreign.
    pub is_others: bool,
}

/// Rates that are looked for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rates<'a> {
    /// Speeds of the shafts whose bearings are listened for.
    pub(super) own_shafts: &'a [Hz],
    /// Those of the other shafts.
    pub(super) other_shafts: &'a [Hz],
    /// Ranges in which lines of bearings are searched.
    pub(super) lines: &'a [(Hz, Hz)],
}

/// Blows in one band. They are a shaft's if they hold the part η and a line at one of the multiples of its speed is as deep: blows once a
/// turn have lines of depth up to 2η at all of them, and those of a shaft beside the bearing's must show half as much at twice that multiple. They are something foreign's if such a line, and half as much at twice and three times its rate, stands
/// anywhere but in the ranges in which lines of bearings are searched.
///
/// `e2`: the band's squared envelope, which `spectrum` is of; `n_bins` those of the band.
pub(super) fn read(
    e2: &[f32],
    spectrum: &DepthSpectrum<'_>,
    (band, n_bins): (Band, usize),
    rates: Rates<'_>,
    scratch: &mut Vec<f32>,
) -> Blows {
    scratch.clear();
    scratch.resize(N_VALUES, 0.0);
    let part = impulsive::part(e2, spectrum.mean_square, n_bins, scratch);
    let is_deep = |hz: f64, part: f64| bearing::depth_at(spectrum, hz) >= part;
    let is_own = multiples(rates.own_shafts).any(|hz| is_deep(hz, part));
    let is_train = |hz: f64| is_deep(hz, part) && is_deep(2.0 * hz, HALF * part);
    let is_shafts = is_own || multiples(rates.other_shafts).any(is_train);
    Blows { band, part, is_others: is_shafts || is_foreign(spectrum, part, rates.lines) }
}

/// Multiples of the shafts' speeds at which their events are looked for, Hz.
fn multiples(shafts: &[Hz]) -> impl Iterator<Item = f64> {
    shafts.iter().flat_map(|speed| (1..=ORDERS).map(|order| f64::from(order) * speed.0))
}

/// Whether a line as deep as `part`, with half as much at twice and three times its rate, stands outside the ranges `own`.
fn is_foreign(spectrum: &DepthSpectrum<'_>, part: f64, own: &[(Hz, Hz)]) -> bool {
    let depth = spectrum.depth;
    let is_peak = |k: &usize| {
        let height = f64::from(depth[*k]);
        height >= part && depth[*k] >= depth[k - 1] && depth[*k] >= depth[k + 1]
    };
    let is_train = |at_hz: f64, height: f64| {
        let is_own = own.iter().any(|(low, high)| (low.0..=high.0).contains(&at_hz));
        let is_high = |times: f64| bearing::depth_at(spectrum, times * at_hz) >= HALF * height;
        !is_own && is_high(2.0) && is_high(3.0)
    };
    let mut peaks = (FIRST_BIN..depth.len() / 3).filter(is_peak);
    peaks.any(|k| is_train(k as f64 * spectrum.bin_hz, f64::from(depth[k])))
}

/// Blows heard in one channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Impulses {
    /// Which channel.
    pub channel: ChannelIndex,
    /// First sample and one past the last.
    pub sample_range: (u64, u64),
    /// Blows of the whitened bands.
    pub bands: Vec<Blows>,
}

impl Impulses {
    /// What a quarter of the bands reach of the part of the energy that `counted` takes for each; 0 without bands. Those that resonate
    /// bring blows over the noise, others need not.
    #[must_use]
    pub fn agreed(&self, counted: impl Fn(&Blows) -> f64) -> f64 {
        bands::quarter_reach(self.bands.iter().map(counted))
    }

    /// Part of the energy in blows that keep no rate but a bearing's, if any, that a quarter of the bands reach.
    #[must_use]
    pub fn unexplained(&self) -> f64 {
        self.agreed(|blows| if blows.is_others { 0.0 } else { blows.part })
    }

    /// RMS of blows that nothing explains over that of the rest, what trends and baselines hold: √(η/(1 − η)).
    #[must_use]
    pub fn over_rest(&self) -> f64 {
        let part = self.unexplained().clamp(0.0, 1.0 - f64::EPSILON);
        (part / (1.0 - part)).sqrt().max(LEAST)
    }
}

/// Adds the blows to the features of their channels.
pub(super) fn keep(heard: &[Impulses], traces: &mut [Trace<'_>]) {
    for trace in traces {
        let own = heard.iter().find(|heard| heard.channel == trace.channel);
        trace.features.extend(own.map(|own| Feature {
            name: Arc::from(BLOWS),
            value: own.over_rest(),
            unit: Unit::One,
        }));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::envelope;
    use crate::dsp::envelope::EnvelopeSpectrumPlan;
    use crate::dsp::envelope::SquaredEnvelopePlan;
    use crate::dsp::fft::FftCache;
    use crate::dsp::fft::ForwardPlan;
    use crate::dsp::real::Real;
    use crate::dsp::reference::gaussian_noise;
    use rustfft::num_complex::Complex;

    /// The part read of ten seconds of noise at 10 kHz that is ten times as high where it is struck: the bearing on a shaft of 20 Hz, and beside one.
    fn struck_beside(is_struck: impl Fn(usize) -> bool, lines: &[(Hz, Hz)]) -> [Blows; 2] {
        let noise = gaussian_noise(100_000, 5);
        let gain = |i: usize| if is_struck(i) { 10.0 } else { 1.0 };
        let x: Vec<f32> =
            noise.iter().enumerate().map(|(i, v)| f32::rounded(v * gain(i))).collect();
        let mut cache = FftCache::<f32>::new();
        let mut x_hat = vec![Complex::default(); crate::dsp::fft::n_bins(x.len())];
        ForwardPlan::new(x.len(), &mut cache).process(&x, &mut x_hat);
        let bins = envelope::bins_of_band(x.len(), 1e4, 1e3, 3e3).unwrap();
        let n_bins = bins.len();
        let mut squared = SquaredEnvelopePlan::new(x.len(), bins, &mut cache);
        let mut e2 = vec![0.0; squared.out_len()];
        squared.process(&x_hat, &mut e2);
        let mut plan = EnvelopeSpectrumPlan::new(e2.len(), &mut cache);
        let mut depth = vec![0.0; plan.n_bins()];
        let mean_square = plan.process(&e2, &mut depth).unwrap();
        let bin_hz = plan.bin_width_hz(squared.out_rate_hz(1e4));
        let spectrum =
            DepthSpectrum { depth: &depth, bin_hz, duration_s: 10.0, mean_square, tone: None };
        let band = Band { low: Hz(1e3), high: Hz(3e3), whitened: true };
        let shaft = [Hz(20.0)];
        [(&shaft[..], &[][..]), (&[][..], &shaft[..])].map(|(own_shafts, other_shafts)| {
            let rates = Rates { own_shafts, other_shafts, lines };
            read(&e2, &spectrum, (band, n_bins), rates, &mut Vec::new())
        })
    }

    /// The same of blows that have all multiples of their rate, or none: it does not matter whose shaft it is.
    fn struck(is_struck: impl Fn(usize) -> bool, lines: &[(Hz, Hz)]) -> Blows {
        let [own, others] = struck_beside(is_struck, lines);
        assert_eq!(own, others);
        own
    }

    /// Starts of blows at random, so many samples apart in the mean: exponential waits, half the sum of two squares of normal values each.
    fn random_starts(n: usize, mean: f64) -> Vec<f64> {
        let waits = gaussian_noise(2 * n, 11);
        let sums = waits.chunks_exact(2).map(|pair| pair[0].powi(2) + pair[1].powi(2));
        sums.scan(0.0, |at, sum| {
            *at += mean / 2.0 * sum;
            Some(*at)
        })
        .collect()
    }

    fn is_within(starts: &[f64], i: usize) -> bool {
        starts.iter().any(|start| (0.0..20.0).contains(&(i as f64 - start)))
    }

    #[test]
    fn blows_count_unless_they_keep_a_rate_of_something_else() {
        // 2 ms of 47: 4.3 of 5.2 parts of the energy, 21.3 times a second, where a bearing's line may stand.
        let own = [(Hz(21.0), Hz(21.6))];
        let found = struck(|i| i % 470 < 20, &own);
        assert!((found.part - 4.3 / 5.2).abs() < 0.06, "{found:?}");
        let others = |per: usize| struck(|i| i % per < 20, &own).is_others;
        assert!(others(500) && others(250), "20 and 40 a second are the shaft's");
        assert!(others(410), "24.4 a second are something foreign's");
        assert!(struck(|_| false, &own).part < 0.05);
    }

    #[test]
    fn blows_at_random_places_are_nobodys() {
        let starts = random_starts(300, 470.0);
        let found = struck(|i| is_within(&starts, i), &[]);
        assert!(found.part > 0.6 && !found.is_others, "{found:?}");
    }

    #[test]
    fn another_shaft_explains_blows_by_more_than_one_line() {
        // At random, most where a shaft of 20 Hz stands at one place: (½ + ½ cos)², whose second harmonic is a quarter of the first.
        let turned = |start: f64| (std::f64::consts::TAU * 20.0 * start / 1e4).cos();
        let is_kept = |start: f64, chance: f64| chance < (0.5 + 0.5 * turned(start)).powi(2);
        let chances = gaussian_noise(2000, 13);
        let chances =
            chances.chunks_exact(2).map(|pair| (-0.5 * (pair[0].powi(2) + pair[1].powi(2))).exp());
        let starts = random_starts(1000, 120.0).into_iter().zip(chances);
        let starts: Vec<f64> = starts
            .filter(|(start, chance)| is_kept(*start, *chance))
            .map(|(start, _)| start)
            .collect();
        let [own, others] = struck_beside(|i| is_within(&starts, i), &[]);
        assert!(own.part > 0.4 && own.is_others, "{own:?}");
        assert!(
            !others.is_others,
            "what elements that slip make may lie there by chance: {others:?}"
        );
    }

    #[test]
    fn a_quarter_of_the_bands_must_agree() {
        let of = |parts: &[f64], is_others: bool| {
            let (channel, sample_range) = (ChannelIndex(0), (0, 1));
            let band = Band { low: Hz(0.0), high: Hz(1e3), whitened: true };
            let bands = parts.iter().map(|part| Blows { band, part: *part, is_others }).collect();
            Impulses { channel, sample_range, bands }
        };
        let bands = [0.1, 0.9, 0.2, 0.6, 0.0, 0.0, 0.3];
        assert!((of(&bands, false).unexplained() - 0.6).abs() < 1e-15, "two of seven");
        assert!((of(&bands, true).agreed(|blows| blows.part) - 0.6).abs() < 1e-15);
        assert!(of(&bands, true).unexplained().abs() < 1e-15);
        assert!((of(&[0.4], false).agreed(|blows| blows.part) - 0.4).abs() < 1e-15);
        assert!(of(&[], false).agreed(|blows| blows.part).abs() < 1e-15);
        // Half of the energy: as much as the rest; none: what cannot be told from noise.
        assert!((of(&[0.5], false).over_rest() - 1.0).abs() < 1e-12);
        assert!((of(&[0.0], false).over_rest() - LEAST).abs() < 1e-15);
        assert!(of(&[1.0], false).over_rest().is_finite());
    }
}
