//! The values of a spectrum: from samples to bins, by its kind.
//!
//! Must not know who asks and what of it is shown.

use super::error::ApiError;
use super::turning::{Turns, last_whole};
use super::wire::finite;
use super::wire::signals::{AngleFrom, SpectrumKind};
use crate::dsp::cepstrum;
use crate::dsp::envelope::{EnvelopeSpectrumPlan, SquaredEnvelopePlan, bins_of_band};
use crate::dsp::fft::{FftCache, ForwardPlan, n_bins};
use crate::dsp::order_spectrum::OrderSpectrumPlan;
use crate::dsp::order_track::OrderTrackPlan;
use crate::dsp::real::Real;
use crate::dsp::spectrum::AmplitudePlan;
use crate::dsp::welch::WelchPlan;
use crate::dsp::window::Shape;
use rustfft::num_complex::Complex;

/// Most points of a revolution, and of a whole record, at equal angles.
const MAX_POINTS_PER_REV: usize = 4096;

/// Which spectrum.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wanted {
    pub(super) kind: SpectrumKind,
    pub(super) fs_hz: f64,
    /// Samples of a window, at most those there are.
    pub(super) n_window: usize,
    /// Demodulated, for envelopes.
    pub(super) band_hz: (f64, f64),
}

/// Bins of a spectrum.
#[derive(Debug)]
pub(super) struct Bins {
    pub(super) value: Vec<f32>,
    pub(super) axis: Axis,
    pub(super) averages: usize,
    pub(super) n_window: usize,
    /// Of orders: where the angle comes from.
    pub(super) angle_from: Option<AngleFrom>,
}

/// What bin k stands for.
#[derive(Debug, Clone, Copy)]
pub(super) enum Axis {
    /// The frequency k·`width_hz`.
    Frequency { width_hz: f64 },
    /// The order k·`width` of a shaft at `speed_hz`.
    Order { width: f64, speed_hz: f64 },
    /// The quefrency k·`step_s`.
    Quefrency { step_s: f64 },
}

impl Axis {
    /// The frequency of bin k: of an order at the mean speed, of a quefrency the spacing of lines it stands for.
    pub(super) fn frequency_hz(self, k: usize) -> f64 {
        let k = k as f64;
        match self {
            Self::Frequency { width_hz } => k * width_hz,
            Self::Order { width, speed_hz } => k * width * speed_hz,
            Self::Quefrency { step_s } => 1.0 / (k * step_s),
        }
    }

    /// Distance of two bins, Hz.
    pub(super) fn width_hz(self) -> Option<f64> {
        match self {
            Self::Frequency { width_hz } => Some(width_hz),
            Self::Order { width, speed_hz } => Some(width * speed_hz),
            Self::Quefrency { .. } => None,
        }
    }

    /// Mean speed of the shaft whose orders these are.
    pub(super) fn speed_hz(self) -> Option<f64> {
        match self {
            Self::Order { speed_hz, .. } => Some(speed_hz),
            Self::Frequency { .. } | Self::Quefrency { .. } => None,
        }
    }

    /// The orders of bins.
    pub(super) fn orders(self, k: impl Iterator<Item = usize>) -> Option<Vec<Option<f64>>> {
        match self {
            Self::Order { width, .. } => Some(k.map(|k| finite(k as f64 * width)).collect()),
            Self::Frequency { .. } | Self::Quefrency { .. } => None,
        }
    }

    /// The quefrencies of bins.
    pub(super) fn quefrencies_s(self, k: impl Iterator<Item = usize>) -> Option<Vec<Option<f64>>> {
        match self {
            Self::Quefrency { step_s } => Some(k.map(|k| finite(k as f64 * step_s)).collect()),
            Self::Frequency { .. } | Self::Order { .. } => None,
        }
    }
}

/// Computes a spectrum of `samples`; `turns` of the shaft, from the first sample on, for orders.
pub(super) fn wanted_bins(
    wanted: &Wanted,
    samples: &[f32],
    turns: Option<&Turns>,
) -> Result<Bins, ApiError> {
    let Wanted { fs_hz, n_window, .. } = *wanted;
    let mut cache = FftCache::new();
    let bins = |(value, averages), axis| Bins { value, axis, averages, n_window, angle_from: None };
    let frequency = |width_hz| Axis::Frequency { width_hz };
    Ok(match wanted.kind {
        SpectrumKind::Psd => {
            let mut plan = WelchPlan::new(n_window, &mut cache);
            let mut density = vec![0.0; plan.n_bins()];
            let averages = plan.process(samples, fs_hz, &mut density);
            bins((density, averages), frequency(fs_hz / n_window as f64))
        }
        SpectrumKind::Amplitude | SpectrumKind::Absolute => {
            let mut plan = AmplitudePlan::new(n_window, &mut cache);
            let n_bins = plan.n_bins();
            let found = power_mean(samples, n_window, n_bins, |window, out| {
                plan.process(window, out);
            });
            bins(found, frequency(plan.bin_width_hz(fs_hz)))
        }
        SpectrumKind::Envelope => return envelope(wanted, samples, &mut cache),
        SpectrumKind::Cepstrum => bins(
            power_cepstrum(samples, n_window, &mut cache),
            Axis::Quefrency { step_s: 1.0 / fs_hz },
        ),
        SpectrumKind::Order => {
            let turns = turns.ok_or(ApiError::Internal)?;
            return orders(wanted, samples, turns, &mut cache);
        }
    })
}

fn envelope(wanted: &Wanted, samples: &[f32], cache: &mut FftCache<f32>) -> Result<Bins, ApiError> {
    let Wanted { fs_hz, n_window, band_hz: (low_hz, high_hz), .. } = *wanted;
    let band = bins_of_band(n_window, fs_hz, low_hz, high_hz).ok_or_else(|| {
        ApiError::Invalid(format!(
            "the band {low_hz} to {high_hz} Hz holds no bin of a window of {n_window} samples"
        ))
    })?;
    let mut forward = ForwardPlan::new(n_window, cache);
    let mut squared = SquaredEnvelopePlan::new(n_window, band, cache);
    let mut spectrum = EnvelopeSpectrumPlan::new(squared.out_len(), cache);
    let mut x_hat = vec![Complex::new(0.0, 0.0); n_bins(n_window)];
    let mut e2 = vec![0.0; squared.out_len()];
    let n_depths = spectrum.n_bins();
    let (value, averages) = power_mean(samples, n_window, n_depths, |window, depth| {
        forward.process(window, &mut x_hat);
        squared.process(&x_hat, &mut e2);
        // No signal, nothing modulated: the depths are 0 then.
        let _mean = spectrum.process(&e2, depth);
    });
    let axis = Axis::Frequency { width_hz: spectrum.bin_width_hz(squared.out_rate_hz(fs_hz)) };
    Ok(Bins { value, axis, averages, n_window, angle_from: None })
}

/// Mean of the power cepstra (D34) of all whole windows, which overlap by half.
fn power_cepstrum(
    samples: &[f32],
    n_window: usize,
    cache: &mut FftCache<f32>,
) -> (Vec<f32>, usize) {
    let mut forward = ForwardPlan::new(n_window, cache);
    let mut plan = cepstrum::CepstrumPlan::new(n_window, cache);
    let mut x_hat = vec![Complex::new(0.0, 0.0); forward.n_bins()];
    let mut sum = vec![0.0_f64; plan.n_values()];
    let mut value = vec![0.0_f32; plan.n_values()];
    let mut n_averages = 0_u32;
    for window in samples.windows(n_window).step_by((n_window / 2).max(1)) {
        forward.process(window, &mut x_hat);
        // Nothing but zeros has a cepstrum of zeros.
        let _floor = plan.process(&x_hat, cepstrum::Kind::Power, &mut value);
        for (sum, value) in sum.iter_mut().zip(&value) {
            *sum += f64::from(*value);
        }
        n_averages += 1;
    }
    let averages = f64::from(n_averages.max(1));
    (sum.iter().map(|sum| f32::rounded(sum / averages)).collect(), n_averages as usize)
}

/// Order spectrum (D70) of the whole revolutions there are, the newest `n_window` samples long at most.
fn orders(
    wanted: &Wanted,
    samples: &[f32],
    turns: &Turns,
    cache: &mut FftCache<f32>,
) -> Result<Bins, ApiError> {
    let Wanted { fs_hz, n_window, .. } = *wanted;
    let none = || ApiError::NotFound("no whole revolution of the shaft is held".to_owned());
    // The newest window: a spectrum of orders is not averaged, a longer window resolves more.
    let skipped = samples.len() - n_window;
    let samples = &samples[skipped..];
    let track = turns.track.seen_from(skipped as f64 / fs_hz);
    let end_s = (n_window - 1) as f64 / fs_hz;
    let (begin, last, times_s) = last_whole(&track, (0.0, end_s), usize::MAX).ok_or_else(none)?;
    let speed_hz = (last - begin) / (times_s[1] - times_s[0]);
    let points = whole(fs_hz / speed_hz).next_power_of_two().clamp(64, MAX_POINTS_PER_REV);
    let mut plan = OrderTrackPlan::new(points, fs_hz, 0.9 * speed_hz).ok_or_else(none)?;
    let mut even = vec![0.0_f32; points * (whole(last - begin) + 2)];
    let tracked = plan.process(samples, fs_hz, &track, &mut even).ok_or_else(none)?;
    let revolutions = tracked.n_points / points;
    if revolutions == 0 {
        return Err(none());
    }
    let mut spectrum = OrderSpectrumPlan::new(points, revolutions, Shape::Hann, cache);
    let mut value = vec![0.0; spectrum.n_bins()];
    spectrum.process(&even[..points * revolutions], &mut value);
    Ok(Bins {
        value,
        axis: Axis::Order { width: spectrum.bin_width_orders(), speed_hz },
        averages: 1,
        n_window,
        angle_from: Some(turns.from),
    })
}

fn whole(value: f64) -> usize {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "float to int casts saturate, and the number is not negative"
    )]
    let whole = value.round().max(0.0) as usize;
    whole
}

/// Power mean √(mean v²) of the spectra of all whole windows, which overlap by half, and their
/// number. `spectrum` writes the `n_bins` values of a window.
fn power_mean(
    samples: &[f32],
    n_window: usize,
    n_bins: usize,
    mut spectrum: impl FnMut(&[f32], &mut [f32]),
) -> (Vec<f32>, usize) {
    let mut value = vec![0.0_f32; n_bins];
    let mut power = vec![0.0_f64; n_bins];
    let mut n_averages = 0_u32;
    for window in samples.windows(n_window).step_by((n_window / 2).max(1)) {
        spectrum(window, &mut value);
        for (power, value) in power.iter_mut().zip(&value) {
            *power += f64::from(*value) * f64::from(*value);
        }
        n_averages += 1;
    }
    let averages = f64::from(n_averages.max(1));
    for (value, power) in value.iter_mut().zip(&power) {
        *value = f32::rounded((power / averages).sqrt());
    }
    (value, n_averages as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::order::PhaseTrack;
    use std::f64::consts::TAU;

    #[test]
    fn orders_of_the_newest_window_are_read_along_the_angle_of_that_window() {
        let fs_hz = 2048.0;
        let n_window = 4096;
        // From 10 to 18 r/s in the 4 s held, of which the window has the last two.
        let revolutions = |t: f64| 10.0 * t + t * t;
        let times_s: Vec<f64> = (0..=40).map(|i| 0.1 * f64::from(i)).collect();
        let turned: Vec<f64> = times_s.iter().map(|t| revolutions(*t)).collect();
        let track = PhaseTrack::from_knots(&times_s, &turned).unwrap();
        let turns = Turns { track, from: AngleFrom::Mark };
        let third = |i: usize| f32::rounded((TAU * 3.0 * revolutions(i as f64 / fs_hz)).sin());
        let samples: Vec<f32> = (0..2 * n_window).map(third).collect();
        let band_hz = (0.0, 0.0);
        let wanted = Wanted { kind: SpectrumKind::Order, fs_hz, n_window, band_hz };
        let bins = wanted_bins(&wanted, &samples, Some(&turns)).unwrap();
        let Axis::Order { width, .. } = bins.axis else { panic!("an axis of orders") };
        let k = bins.value.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).unwrap().0;
        assert!((k as f64 * width - 3.0).abs() < 1e-9, "{}", k as f64 * width);
        // Whole revolutions hold whole periods: the height is the amplitude, but for the resampling.
        assert!((bins.value[k] - 1.0).abs() < 1e-3, "{}", bins.value[k]);
    }
}
