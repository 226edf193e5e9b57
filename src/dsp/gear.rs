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
#[path = "gear_tests.rs"]
mod tests;
