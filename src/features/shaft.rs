//! Shaft lines: 1×, 2×, 3× amplitude at the exact frequency, for every shaft a channel can see.

use super::Feature;
use crate::dsp::line;
use crate::dsp::real::floor_index;
use crate::dsp::stats;
use crate::machine::ShaftIndex;
use crate::signal::ChannelIndex;
use crate::units::Hz;
use crate::units::Unit;
use rustfft::num_complex::Complex;
use std::sync::Arc;

/// Shaft orders read.
pub const ORDERS: [u8; 3] = [1, 2, 3];

/// Name of the feature "amplitude at `order` × `shaft`".
#[must_use]
pub fn line_name(order: u8, shaft: &str) -> String {
    format!("line_{order}x_{shaft}")
}

/// Name of the feature "mean CWT magnitude at the speed of `shaft`".
#[must_use]
pub fn cwt_name(shaft: &str) -> String {
    format!("cwt_1x_{shaft}")
}

/// Name of the feature "mean CWT magnitude at the mesh frequency of `gear`".
#[must_use]
pub fn cwt_mesh_name(gear: &str) -> String {
    format!("cwt_mesh_{gear}")
}

/// Reads 1×, 2×, 3× of a shaft (zero-to-peak, exact frequency); lines that the window or the
/// sampling cannot show are left out.
#[must_use]
pub fn lines(x: &[f32], sample_rate: Hz, shaft: &str, speed: Hz, unit: Unit) -> Vec<Feature> {
    ORDERS
        .iter()
        .filter_map(|order| {
            let read = line::line_at(x, sample_rate.0, speed.0 * f64::from(*order))?;
            Some(Feature { name: Arc::from(line_name(*order, shaft)), value: read.amplitude, unit })
        })
        .collect()
}

/// How far a line of a shaft stands over the noise around it in one channel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OverFloor {
    /// Which shaft.
    pub shaft: ShaftIndex,
    /// Multiple of its speed, one of [`ORDERS`].
    pub order: u8,
    /// Which channel.
    pub channel: ChannelIndex,
    /// Power of the line ÷ expected power of the noise floor at its place.
    pub power_ratio: f64,
    /// Independent spectral estimates the floor rests on.
    pub floor_dof: f64,
}

/// Cells the highest bin at a known frequency is taken over.
pub const LINE_CELLS: f64 = 3.0;

/// Bins beside a line that its Hann lobe and a small speed error fill.
const LOBE_BINS: usize = 4;

/// Reads the power at `frequency` against the median of the neighbourhood of ± `half_width` (F11).
///
/// `x_hat`: unnormalised one-sided DFT of n samples, mean removed; Hann-weighted here. `None` where
/// the spectrum ends or holds no noise.
#[must_use]
pub fn over_floor(
    x_hat: &[Complex<f32>],
    n: usize,
    sample_rate: Hz,
    frequency: Hz,
    half_width: Hz,
) -> Option<(f64, f64)> {
    let bin_hz = sample_rate.0 / n as f64;
    let centre = floor_index((frequency.0 / bin_hz).round());
    let width = floor_index(half_width.0 / bin_hz).max(4 * LOBE_BINS);
    let last = x_hat.len().checked_sub(2)?;
    if centre < 2 || centre >= last {
        return None;
    }
    let at_line = (centre - 1..=centre + 1).map(|k| hann_magnitude(x_hat, k)).fold(0.0, f64::max);
    let low = centre.saturating_sub(width).max(2);
    let around = (low..=(centre + width).min(last)).filter(|k| k.abs_diff(centre) > LOBE_BINS);
    let mut noise: Vec<f64> = around.map(|k| hann_magnitude(x_hat, k)).collect();
    let median = stats::median(&mut noise).filter(|m| *m > 0.0)?;
    // Hann cells are 1.5 bins wide; a median is worth half of a mean.
    let floor_dof = (noise.len() as f64 / 3.0).max(1.0);
    Some(((at_line / median).powi(2) * std::f64::consts::LN_2, floor_dof))
}

/// Magnitude of bin `k` after a Hann window, applied as the sum of three bins.
#[must_use]
pub fn hann_magnitude(x_hat: &[Complex<f32>], k: usize) -> f64 {
    let at = |i: usize| x_hat.get(i).map_or((0.0, 0.0), |c| (f64::from(c.re), f64::from(c.im)));
    let (a, b, c) = (at(k.wrapping_sub(1)), at(k), at(k + 1));
    let re = 0.5 * b.0 - 0.25 * (a.0 + c.0);
    let im = 0.5 * b.1 - 0.25 * (a.1 + c.1);
    re.hypot(im)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::fft::FftCache;
    use crate::dsp::fft::ForwardPlan;
    use crate::dsp::real::Real;

    fn power_ratio(line: f64, seed: u64) -> f64 {
        let mut state = seed;
        let x: Vec<f32> = (0..20_000)
            .map(|i| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                let noise = (state >> 33) as f64 / (1_u64 << 31) as f64 - 0.5;
                let t = f64::from(i) / 2000.0;
                f32::rounded(line * (std::f64::consts::TAU * 25.0 * t).cos() + noise)
            })
            .collect();
        let mut plan = ForwardPlan::new(x.len(), &mut FftCache::new());
        let mut x_hat = vec![Complex::default(); plan.n_bins()];
        plan.process(&x, &mut x_hat);
        over_floor(&x_hat, x.len(), Hz(2000.0), Hz(25.0), Hz(10.0)).unwrap().0
    }

    #[test]
    fn a_line_stands_over_noise_and_noise_does_not() {
        // Uniform noise of variance 1/12: a line of 0.1 has A²N/(4σ²)/1.5 = 400 times its cell.
        let ratio = power_ratio(0.1, 5);
        assert!((ratio / 400.0 - 1.0).abs() < 0.35, "{ratio}: floor and line each scatter by 10 %");
        // Maximum of three exponential cells: above 15 once in 10^6.
        assert!((1..20).all(|seed| power_ratio(0.0, seed * 7919) < 15.0));
    }
}
