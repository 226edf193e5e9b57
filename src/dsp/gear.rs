//! Residual and difference of a synchronous average, and the figures of merit read from them.
//!
//! Sets of orders, z teeth: S = {1, 2}; G = {hz, h = 1…H}, H the largest with Hz + 1 inside the usable
//! orders; B = {hz ± 1}. Regular g: the part in S∪G∪B; residual r: without S∪G; difference d: without
//! S∪G∪B (D23). f64 only: an average is short. Must not know healthy from damaged.

use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::fft;
use crate::dsp::fft::BandInverse;
use crate::dsp::fft::FftCache;
use crate::dsp::fft::ForwardPlan;
use crate::dsp::real::floor_index;
use crate::dsp::stats::Moments;

/// A part of y below this share of y's RMS is rounding, not signal.
const ROUNDING: f64 = 1e-12;

/// Tooth pitches over which energy is looked for: a blow rings on while the next teeth pass.
pub const WIDTHS: [usize; 3] = [1, 2, 4];

/// Splits a synchronous average of `n` points into regular, residual and difference signal (D23).
#[derive(Debug)]
pub struct GearPlan {
    teeth: usize,
    n_harmonics: usize,
    forward: ForwardPlan<f64>,
    without_all: BandInverse<f64>,
    side_bands: BandInverse<f64>,
    y_hat: Vec<Complex<f64>>,
    analytic: Vec<Complex<f64>>,
    buffer: Vec<Complex<f64>>,
    regular: Vec<f64>,
    residual: Vec<f64>,
    difference: Vec<f64>,
    envelope: Vec<f64>,
}

/// Figures of merit of one average (D24); `None` where a denominator is 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GearFigures {
    /// (max y − min y)/Σ Y_hz. Source: Stewart 1977.
    pub fm0: Option<f64>,
    /// Kurtosis of d; 3 when healthy. Source: Stewart 1977.
    pub fm4: Option<f64>,
    /// N²Σd⁶/(Σd²)³; 15 when healthy. Source: Martin 1989.
    pub m6a: Option<f64>,
    /// N³Σd⁸/(Σd²)⁴; 105 when healthy. Source: Martin 1989.
    pub m8a: Option<f64>,
    /// RMS(d)/RMS(g). Source: Swansson 1980.
    pub energy_ratio: Option<f64>,
    /// (Y_{z−1} + Y_{z+1})/σ(y). Source: Lebold et al. 2000.
    pub sideband_level_factor: Option<f64>,
    /// Kurtosis of r.
    pub residual_kurtosis: Option<f64>,
    /// RMS of d, unit of y.
    pub difference_rms: f64,
    /// √(Σ_h Y_hz²): amplitude of the mesh, unit of y.
    pub mesh_amplitude: f64,
}

/// Where in the revolution the difference signal has its energy (D25).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Localisation {
    /// Largest over mean squared envelope of d, smoothed over each of [`WIDTHS`] tooth pitches; ≥ 1.
    pub peak_over_mean: [f64; WIDTHS.len()],
    /// Centre of the peak, revolutions after the tacho edge, 0…1.
    pub centre_rev: f64,
}

impl GearPlan {
    /// Plans averages of `n` points of a gear of `teeth` teeth whose orders up to `max_order` are
    /// inside the usable band; `None` if not even the fundamental mesh and its side bands are.
    #[must_use]
    pub fn new(
        n: usize,
        teeth: usize,
        max_order: usize,
        cache: &mut FftCache<f64>,
    ) -> Option<Self> {
        Self::in_orders(n, teeth, max_order, |_| true, cache)
    }

    /// The same with a difference and a residual signal of those orders alone that lie in (h ± ½)·z: what one
    /// harmonic of the mesh carries (D23). `None` too if that harmonic is not inside.
    #[must_use]
    pub fn around(
        harmonic: usize,
        n: usize,
        teeth: usize,
        max_order: usize,
        cache: &mut FftCache<f64>,
    ) -> Option<Self> {
        let is_near = move |k: usize| (2 * k).abs_diff(2 * harmonic * teeth) <= teeth;
        let plan = Self::in_orders(n, teeth, max_order, is_near, cache)?;
        (1..=plan.n_harmonics).contains(&harmonic).then_some(plan)
    }

    fn in_orders(
        n: usize,
        teeth: usize,
        max_order: usize,
        is_inside: impl Fn(usize) -> bool + Copy,
        cache: &mut FftCache<f64>,
    ) -> Option<Self> {
        let top = max_order.min(n.checked_sub(1)? / 2);
        let n_harmonics = top.checked_sub(1)?.checked_div(teeth)?;
        if n_harmonics == 0 {
            return None;
        }
        let is_mesh = |k: usize| k > 0 && k.is_multiple_of(teeth) && k / teeth <= n_harmonics;
        let is_side = move |k: usize| is_mesh(k + 1) || (k > 0 && is_mesh(k - 1));
        let is_shaft = |k: usize| k == 1 || k == 2;
        let is_free = move |k: usize| !is_shaft(k) && !is_mesh(k) && !is_side(k);
        let is_kept = move |k: usize| k > 0 && is_inside(k) && is_free(k);
        let keep = |yes: bool| if yes { 1.0 } else { 0.0 };
        let bins = 0..fft::n_bins(n);
        // An order in S or G that is also hz ± 1 counts there: the residual must not hold it.
        let only_side = move |k: usize| is_inside(k) && is_side(k) && !is_shaft(k) && !is_mesh(k);
        let zeros = vec![0.0; n];
        Some(Self {
            teeth,
            n_harmonics,
            forward: ForwardPlan::new(n, cache),
            without_all: BandInverse::new(n, bins.clone(), n, cache, |k| keep(is_kept(k))),
            side_bands: BandInverse::new(n, bins, n, cache, |k| keep(only_side(k))),
            y_hat: vec![Complex::zero(); fft::n_bins(n)],
            analytic: vec![Complex::zero(); n],
            buffer: vec![Complex::zero(); n],
            regular: zeros.clone(),
            residual: zeros.clone(),
            difference: zeros.clone(),
            envelope: zeros,
        })
    }

    /// Number H of mesh harmonics in the sets.
    #[must_use]
    pub fn n_harmonics(&self) -> usize {
        self.n_harmonics
    }

    /// Teeth of the gear.
    #[must_use]
    pub fn teeth(&self) -> usize {
        self.teeth
    }

    /// Y_hz of the last call, zero-to-peak; `None` beyond [`Self::n_harmonics`].
    #[must_use]
    pub fn harmonic_amplitude(&self, h: usize) -> Option<f64> {
        let is_mesh = h > 0 && h <= self.n_harmonics;
        let n = self.difference.len() as f64;
        is_mesh.then(|| 2.0 * self.y_hat[h * self.teeth].norm() / n)
    }

    /// The h of the largest Y_hz of the last call; the lowest of equals. Of a baseline's average it is
    /// the h* that [`crate::dsp::demodulate::MeshDemodPlan`] is planned with and that stays (D65).
    #[must_use]
    pub fn strongest_harmonic(&self) -> usize {
        let power = |h: usize| self.y_hat[h * self.teeth].norm_sqr();
        (2..=self.n_harmonics).fold(1, |best, h| if power(h) > power(best) { h } else { best })
    }

    /// Difference signal d of the last call, unit of y.
    #[must_use]
    pub fn difference(&self) -> &[f64] {
        &self.difference
    }

    /// Residual signal r of the last call, unit of y.
    #[must_use]
    pub fn residual(&self) -> &[f64] {
        &self.residual
    }

    /// Regular signal g of the last call, unit of y.
    #[must_use]
    pub fn regular(&self) -> &[f64] {
        &self.regular
    }

    /// Splits `y` (n points of one revolution) and computes its figures of merit.
    ///
    /// # Panics
    ///
    /// If `y` does not have the plan's length.
    pub fn process(&mut self, y: &[f64]) -> GearFigures {
        let mean = self.forward.process(y, &mut self.y_hat);
        self.without_all.process(&self.y_hat, &mut self.analytic);
        self.side_bands.process(&self.y_hat, &mut self.buffer);
        for (i, value) in y.iter().enumerate() {
            self.difference[i] = self.analytic[i].re;
            self.residual[i] = self.analytic[i].re + self.buffer[i].re;
            self.regular[i] = value - mean - self.analytic[i].re;
        }
        self.figures(y)
    }

    fn figures(&self, y: &[f64]) -> GearFigures {
        let whole = Moments::of(y);
        let floor = ROUNDING * whole.rms().unwrap_or(0.0);
        let above_rounding =
            |part: &[f64]| Some(Moments::of(part)).filter(|m| m.rms() > Some(floor));
        let difference = above_rounding(&self.difference);
        let regular = above_rounding(&self.regular);
        let amplitude = |k: usize| 2.0 * self.y_hat[k].norm() / y.len() as f64;
        let mesh: f64 = (1..=self.n_harmonics).map(|h| amplitude(h * self.teeth)).sum();
        let side = amplitude(self.teeth - 1) + amplitude(self.teeth + 1);
        let ratio = |a: Option<f64>, b: Option<f64>| a.zip(b).map(|(a, b)| a / b);
        GearFigures {
            fm0: whole.peak_to_peak().filter(|_| mesh > floor).map(|span| span / mesh),
            fm4: difference.and_then(|d| d.kurtosis()),
            m6a: difference.and_then(|d| self.even_moment(d, 6)),
            m8a: difference.and_then(|d| self.even_moment(d, 8)),
            energy_ratio: ratio(difference.and_then(|d| d.rms()), regular.and_then(|g| g.rms())),
            sideband_level_factor: whole.rms().filter(|rms| *rms > 0.0).map(|rms| side / rms),
            residual_kurtosis: above_rounding(&self.residual).and_then(|r| r.kurtosis()),
            difference_rms: difference.and_then(|d| d.rms()).unwrap_or(0.0),
            mesh_amplitude: (1..=self.n_harmonics)
                .map(|h| amplitude(h * self.teeth).powi(2))
                .sum::<f64>()
                .sqrt(),
        }
    }

    /// Moment of d of the even order `order` over its variance to the power order/2.
    fn even_moment(&self, d: Moments, order: i32) -> Option<f64> {
        let rms = d.rms().filter(|rms| *rms > 0.0)?;
        let sum: f64 = self.difference.iter().map(|v| ((v - d.mean) / rms).powi(order)).sum();
        Some(sum / self.difference.len() as f64)
    }

    /// Locates the energy of the difference signal of the last call in the revolution (D25).
    ///
    /// `None` if there is none.
    pub fn localise(&mut self) -> Option<Localisation> {
        let rms = Moments::of(&self.difference).rms()?;
        if rms <= ROUNDING * Moments::of(&self.regular).rms()? {
            return None;
        }
        let n = self.envelope.len();
        let mut peak_over_mean = [1.0; WIDTHS.len()];
        let (mut at, mut peak) = (0, 0.0);
        let larger = |a: (usize, f64), b: (usize, f64)| if b.1 > a.1 { b } else { a };
        // The narrowest last: it says where.
        for (found, width) in peak_over_mean.iter_mut().zip(WIDTHS).rev() {
            self.smooth_envelope(width);
            let mean = self.envelope.iter().sum::<f64>() / n as f64;
            (at, peak) = self.envelope.iter().copied().enumerate().fold((0, 0.0), larger);
            if mean <= 0.0 {
                return None;
            }
            *found = peak / mean;
        }
        // Centre of mass of what stands above half the peak around it, the revolution being a circle.
        let (mut weight, mut moment) = (peak, 0.0);
        for direction in [1.0, -1.0] {
            for step in 1..n / 2 {
                let place = if direction > 0.0 { (at + step) % n } else { (at + n - step) % n };
                if self.envelope[place] < 0.5 * peak {
                    break;
                }
                weight += self.envelope[place];
                moment += direction * step as f64 * self.envelope[place];
            }
        }
        let centre_rev = ((at as f64 + moment / weight) / n as f64).rem_euclid(1.0);
        Some(Localisation { peak_over_mean, centre_rev })
    }

    /// Power of the difference signal's mean over `blocks` within one tooth pitch around
    /// `centre_rev`, over what chance leaves of it (D26): F(2, 2(B − 1)) at one point if nothing stays
    /// at its angle from block to block.
    ///
    /// `blocks`: B averages of `n` points over successive parts of the record. `None` for fewer than
    /// two, and where they do not differ.
    ///
    /// # Panics
    ///
    /// If a block does not have the plan's length.
    pub fn persistence(&mut self, blocks: &[Vec<f64>], centre_rev: f64) -> Option<f64> {
        let n = self.analytic.len();
        let width = self.pitch_points(1);
        let first = floor_index((centre_rev.rem_euclid(1.0) * n as f64).round()) + n - width / 2;
        let mut sums = vec![Complex::<f64>::zero(); width];
        let mut squares = 0.0;
        for block in blocks {
            self.forward.process(block, &mut self.y_hat);
            self.without_all.process(&self.y_hat, &mut self.analytic);
            for (offset, sum) in sums.iter_mut().enumerate() {
                let value = self.analytic[(first + offset) % n];
                *sum += value;
                squares += value.norm_sqr();
            }
        }
        let n_blocks = blocks.len() as f64;
        let of_mean = sums.iter().map(Complex::norm_sqr).sum::<f64>() / n_blocks;
        // Σ|z_b − z̄|² = Σ|z_b|² − |Σz_b|²/B; below rounding of its terms the blocks are equal.
        let scatter = (squares - of_mean) / (n_blocks - 1.0);
        (blocks.len() > 1 && scatter > ROUNDING * squares).then(|| of_mean / scatter)
    }

    /// Points of some tooth pitches, odd, so that what is taken over them is centred.
    fn pitch_points(&self, pitches: usize) -> usize {
        let n = self.analytic.len();
        (pitches * n / self.teeth / 2 * 2 + 1).min(n)
    }

    /// Squared envelope of d, averaged over some tooth pitches around each point.
    fn smooth_envelope(&mut self, pitches: usize) {
        let n = self.analytic.len();
        let width = self.pitch_points(pitches);
        let half = width / 2;
        let e2 = |place: usize| self.analytic[place % n].norm_sqr();
        for (i, smooth) in self.envelope.iter_mut().enumerate() {
            let sum: f64 = (0..width).map(|offset| e2(i + n - half + offset)).sum();
            *smooth = sum / width as f64;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::sine;
    use crate::dsp::reference::sum;

    const N: usize = 1024;
    const TEETH: usize = 28;

    fn plan() -> GearPlan {
        GearPlan::new(N, TEETH, 200, &mut FftCache::new()).unwrap()
    }

    fn order(k: f64, amplitude: f64) -> Vec<f64> {
        sine(N, N as f64, k, amplitude, 0.3)
    }

    #[test]
    fn each_set_goes_where_the_definition_says() {
        let mut plan = plan();
        assert_eq!(plan.n_harmonics(), 7, "7·28 + 1 = 197 ≤ 200");
        let (shaft, mesh) = (order(1.0, 3.0), order(56.0, 2.0));
        let (side, other) = (order(29.0, 0.5), order(10.0, 0.25));
        let y = sum(&[shaft.clone(), mesh.clone(), side.clone(), other.clone(), vec![9.0; N]]);
        let figures = plan.process(&y);
        for i in 0..N {
            // Rounding of an FFT of values of 10.
            assert!((plan.difference()[i] - other[i]).abs() < 1e-13);
            assert!((plan.residual()[i] - other[i] - side[i]).abs() < 1e-13);
            assert!((plan.regular()[i] - shaft[i] - mesh[i] - side[i]).abs() < 1e-13);
        }
        // A sine alone in d: kurtosis 1.5, 6th 2.5, 8th 4.375 (E cos^2m · 2^m).
        assert!((figures.fm4.unwrap() - 1.5).abs() < 1e-10);
        assert!((figures.m6a.unwrap() - 2.5).abs() < 1e-10);
        assert!((figures.m8a.unwrap() - 4.375).abs() < 1e-10);
        let regular = ((9.0 + 4.0 + 0.25) / 2.0_f64).sqrt();
        assert!((figures.energy_ratio.unwrap() - 0.25 / 2f64.sqrt() / regular).abs() < 1e-12);
        let sigma = ((9.0 + 4.0 + 0.25 + 0.0625) / 2.0_f64).sqrt();
        assert!((figures.sideband_level_factor.unwrap() - 0.5 / sigma).abs() < 1e-12);
    }

    #[test]
    fn noise_has_the_gaussian_figures_and_scale_does_not_matter() {
        let y = sum(&[order(28.0, 5.0), gaussian_noise(N, 21)]);
        let mut plan = plan();
        let figures = plan.process(&y);
        // Scatter of N = 1000 (domain knowledge): ± 0.15, ± 2.4, ± 36; three times that.
        assert!((figures.fm4.unwrap() - 3.0).abs() < 0.45, "{figures:?}");
        assert!((figures.m6a.unwrap() - 15.0).abs() < 7.2, "{figures:?}");
        assert!((figures.m8a.unwrap() - 105.0).abs() < 108.0, "{figures:?}");
        let doubled = plan.process(&y.iter().map(|v| 2.0 * v).collect::<Vec<_>>());
        for (a, b) in [(figures.fm0, doubled.fm0), (figures.fm4, doubled.fm4)] {
            // A power of two changes no mantissa.
            assert!((a.unwrap() - b.unwrap()).abs() < 1e-12);
        }
    }

    #[test]
    fn offsets_counts_and_prime_lengths_change_nothing() {
        for n in [N, 1009] {
            let mut plan = GearPlan::new(n, TEETH, 200, &mut FftCache::new()).unwrap();
            let line = |k: f64, a: f64| sine(n, n as f64, k, a, 0.3);
            let y = sum(&[line(28.0, 5.0), line(29.0, 0.5), line(1.0, 2.0), gaussian_noise(n, 8)]);
            let plain = plan.process(&y);
            assert_eq!(plan.strongest_harmonic(), 1);
            let offset = plan.process(&y.iter().map(|v| v + 1e6).collect::<Vec<_>>());
            // 24-bit counts into eighth powers; an offset of 1e6 rounds y by 6e-11.
            let counts = plan.process(&y.iter().map(|v| 8_388_607.0 * v).collect::<Vec<_>>());
            for (other, tolerance) in [(offset, 1e-7), (counts, 1e-11)] {
                for (a, b) in [
                    (plain.fm0, other.fm0),
                    (plain.fm4, other.fm4),
                    (plain.m6a, other.m6a),
                    (plain.m8a, other.m8a),
                    (plain.energy_ratio, other.energy_ratio),
                    (plain.sideband_level_factor, other.sideband_level_factor),
                ] {
                    assert!(
                        (a.unwrap() / b.unwrap() - 1.0).abs() < tolerance,
                        "{plain:?} {other:?}"
                    );
                }
            }
            let second = plan.process(&sum(&[y, line(56.0, 7.0)]));
            assert!(second.fm0.is_some() && plan.strongest_harmonic() == 2);
        }
    }

    #[test]
    fn around_a_harmonic_its_orders_alone_are_left() {
        let mut plan = GearPlan::around(2, N, TEETH, 200, &mut FftCache::new()).unwrap();
        // 2·28 ± 14: orders 42 to 70.
        let (inside, side, edge) = (order(50.0, 0.5), order(57.0, 0.4), order(70.0, 0.2));
        let others = [order(41.0, 1.0), order(71.0, 1.0), order(10.0, 2.0), order(29.0, 1.0)];
        let all = [&[inside.clone(), side.clone(), edge.clone(), order(56.0, 3.0)][..], &others];
        plan.process(&sum(&all.concat()));
        for i in 0..N {
            // Rounding of an FFT of values of 10.
            assert!((plan.difference()[i] - inside[i] - edge[i]).abs() < 1e-13);
            assert!((plan.residual()[i] - inside[i] - edge[i] - side[i]).abs() < 1e-13);
        }
        // 7·28 + 1 is the last inside 200.
        assert!(GearPlan::around(7, N, TEETH, 200, &mut FftCache::new()).is_some());
        assert!(GearPlan::around(8, N, TEETH, 200, &mut FftCache::new()).is_none());
        assert!(GearPlan::around(0, N, TEETH, 200, &mut FftCache::new()).is_none());
    }

    #[test]
    fn a_local_burst_is_found_where_it_is() {
        for centre in [0.02, 0.37, 0.99] {
            let burst = |i: usize| {
                let distance = (i as f64 / N as f64 - centre + 0.5).rem_euclid(1.0) - 0.5;
                (-0.5 * (distance / 0.012).powi(2)).exp() * (TAU * 100.0 * distance).cos()
            };
            let noise = gaussian_noise(N, 5).iter().map(|v| 0.05 * v).collect::<Vec<_>>();
            let y = sum(&[order(28.0, 3.0), order(1.0, 10.0), (0..N).map(burst).collect(), noise]);
            let mut plan = plan();
            let figures = plan.process(&y);
            let found = plan.localise().unwrap();
            assert!(figures.fm4.unwrap() > 10.0 && found.peak_over_mean[0] > 8.0, "{found:?}");
            let error = (found.centre_rev - centre + 0.5).rem_euclid(1.0) - 0.5;
            // A third of the tooth pitch 1/28.
            assert!(error.abs() < 0.012, "{centre}: {found:?}");
        }
    }

    /// Blocks of noise of unit variance with `part` added to each, moved on by `step` radians a block.
    fn blocks(n_blocks: u64, amplitude: f64, step: f64) -> Vec<Vec<f64>> {
        let block = |b: u64| {
            let phase = step * b as f64;
            sum(&[sine(N, N as f64, 34.0, amplitude, phase), gaussian_noise(N, 31 + b)])
        };
        (0..n_blocks).map(block).collect()
    }

    #[test]
    fn what_stays_from_block_to_block_is_told_from_what_wanders() {
        let mut plan = plan();
        // Power of mean over its scatter: A²·N_b/(2·variance) of the sine alone is 400, and 1 of noise.
        // Kept orders hold 0.86 of the noise; 37 points of it scatter by a third.
        let stays = plan.persistence(&blocks(8, 10.0, 0.0), 0.3).unwrap();
        assert!((stays / (0.5 * 100.0 * 8.0 / 0.9) - 1.0).abs() < 0.4, "{stays}");
        let noise = plan.persistence(&blocks(8, 0.0, 0.0), 0.3).unwrap();
        assert!((0.3..3.0).contains(&noise), "{noise}");
        // Three quarters of a turn over the record, as order 34.008 does in 100 revolutions: the mean
        // keeps |sin(8a)/(8·sin a)| of it, a = 0.75·π/8, and its scatter is the rest.
        let a = 0.75 * std::f64::consts::PI / 8.0;
        let kept = ((8.0 * a).sin() / (8.0 * a.sin())).powi(2);
        let expected = 7.0 * kept / (1.0 - kept);
        let wanders = plan.persistence(&blocks(8, 100.0, 2.0 * a), 0.3).unwrap();
        assert!((wanders / expected - 1.0).abs() < 0.1, "{wanders} {expected}: noise is 1 %");
        assert_eq!(plan.persistence(&blocks(1, 1.0, 0.0), 0.3), None);
        assert_eq!(plan.persistence(&vec![order(10.0, 1.0); 8], 0.3), None, "no chance in it");
    }

    #[test]
    fn nothing_left_is_none_not_rounding() {
        let mut plan = plan();
        let figures = plan.process(&sum(&[order(28.0, 1.0), order(2.0, 3.0)]));
        assert_eq!((figures.fm4, figures.m6a, figures.energy_ratio), (None, None, None));
        assert_eq!(plan.localise(), None);
        let figures = plan.process(&[4.0; N]);
        assert_eq!((figures.fm0, figures.fm4, figures.sideband_level_factor), (None, None, None));
        assert_eq!(plan.localise(), None);
    }

    #[test]
    fn a_mesh_outside_the_usable_orders_is_not_planned() {
        let mut cache = FftCache::new();
        for (n, teeth, max_order) in [(1024, 28, 28), (56, 28, 200), (0, 28, 200), (1024, 0, 200)] {
            assert!(GearPlan::new(n, teeth, max_order, &mut cache).is_none());
        }
        assert!(GearPlan::new(1024, 28, 29, &mut cache).is_some());
    }
}
