//! Discrete wavelet transform of a record that is taken as periodic.
//!
//! For what a picture does not need: a decomposition without redundancy that gives the samples back.
//! Must not know what is done to the coefficients in between.

use crate::dsp::real::Real;
use crate::dsp::wavelet::taps::FilterBank;
use crate::dsp::wavelet::taps::Taps;

/// Decomposition into `levels` octaves and back (D104).
#[derive(Debug)]
pub struct DwtPlan {
    bank: FilterBank,
    n: usize,
    levels: u32,
    one: Vec<f64>,
    other: Vec<f64>,
}

impl DwtPlan {
    /// Plans records of `n` samples; `None` unless `n` is a multiple of 2^`levels` and `levels` ≥ 1.
    #[must_use]
    pub fn new(bank: FilterBank, n: usize, levels: u32) -> Option<Self> {
        let step = 1_usize.checked_shl(levels)?;
        if levels == 0 || n == 0 || !n.is_multiple_of(step) {
            return None;
        }
        Some(Self { bank, n, levels, one: vec![0.0; n], other: vec![0.0; n] })
    }

    /// Writes the coefficients: the coarsest approximation, then the details from the coarsest to the
    /// finest (the upper half of `out`: fs/4 to fs/2).
    ///
    /// `x` and `out`: n values, the same unit for an orthogonal bank: Σ out² = Σ x².
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn analyse<T: Real>(&mut self, x: &[T], out: &mut [T]) {
        assert_eq!((x.len(), out.len()), (self.n, self.n), "samples of the plan");
        let Self { bank, one, other, .. } = self;
        for (to, from) in one.iter_mut().zip(x) {
            *to = from.to_f64();
        }
        for level in 0..self.levels {
            let n = self.n >> level;
            let (approximation, detail) = other[..n].split_at_mut(n / 2);
            correlate(&bank.analysis_low, &one[..n], approximation);
            correlate(&bank.analysis_high, &one[..n], detail);
            one[..n].copy_from_slice(&other[..n]);
        }
        for (to, from) in out.iter_mut().zip(one.iter()) {
            *to = T::rounded(*from);
        }
    }

    /// Writes the samples whose coefficients these are.
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn synthesise<T: Real>(&mut self, coefficients: &[T], out: &mut [T]) {
        assert_eq!((coefficients.len(), out.len()), (self.n, self.n), "samples of the plan");
        let Self { bank, one, other, .. } = self;
        for (to, from) in one.iter_mut().zip(coefficients) {
            *to = from.to_f64();
        }
        for level in (0..self.levels).rev() {
            let n = self.n >> level;
            other[..n].fill(0.0);
            let (approximation, detail) = one[..n].split_at(n / 2);
            spread(&bank.synthesis_low, approximation, &mut other[..n]);
            spread(&bank.synthesis_high, detail, &mut other[..n]);
            one[..n].copy_from_slice(&other[..n]);
        }
        for (to, from) in out.iter_mut().zip(one.iter()) {
            *to = T::rounded(*from);
        }
    }
}

/// Place of a filter's first tap where it lies inside of `n` samples as a whole.
fn inside(taps: &Taps, k: usize, n: usize) -> Option<usize> {
    let start = usize::try_from(2 * k.cast_signed() + taps.first).ok()?;
    (start + taps.taps.len() <= n).then_some(start)
}

/// Σ taps[n]·x[n + 2k], indices modulo the length.
fn correlate(taps: &Taps, x: &[f64], out: &mut [f64]) {
    let n = x.len().cast_signed();
    for (k, out) in out.iter_mut().enumerate() {
        *out = match inside(taps, k, x.len()) {
            Some(start) => x[start..].iter().zip(&taps.taps).map(|(x, tap)| x * tap).sum(),
            None => {
                let at = |i: isize| (2 * k.cast_signed() + i).rem_euclid(n).cast_unsigned();
                taps.iter().map(|(i, tap)| tap * x[at(i)]).sum()
            }
        };
    }
}

/// Adds taps[n − 2k]·c[k] to x[n], indices modulo the length.
fn spread(taps: &Taps, coefficients: &[f64], x: &mut [f64]) {
    let n = x.len().cast_signed();
    for (k, coefficient) in coefficients.iter().enumerate() {
        if let Some(start) = inside(taps, k, x.len()) {
            for (x, tap) in x[start..].iter_mut().zip(&taps.taps) {
                *x += tap * coefficient;
            }
            continue;
        }
        for (i, tap) in taps.iter() {
            x[(2 * k.cast_signed() + i).rem_euclid(n).cast_unsigned()] += tap * coefficient;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::largest_difference;
    use crate::dsp::reference::narrow;

    fn banks() -> Vec<FilterBank> {
        let daubechies = [1, 2, 4, 10].map(|n| FilterBank::daubechies(n).unwrap());
        let splines = [(1, 3), (2, 4), (3, 9)].map(|(s, a)| FilterBank::spline(s, a).unwrap());
        let mut banks: Vec<_> = daubechies.into_iter().chain(splines).collect();
        banks.push(FilterBank::nine_seven());
        banks
    }

    #[test]
    fn samples_come_back() {
        // Down to one coefficient, with filters that wrap around the shortest octaves.
        for (n, levels) in [(64, 6), (96, 5), (1000, 3)] {
            let x = gaussian_noise(n, 3);
            for bank in banks() {
                let mut plan = DwtPlan::new(bank, n, levels).unwrap();
                let (mut c, mut back) = (vec![0.0; n], vec![0.0; n]);
                plan.analyse(&x, &mut c);
                plan.synthesise(&c, &mut back);
                // Six levels of sums of 20 products with taps up to 10.
                assert!(largest_difference(&back, &x) < 1e-10);
                let single = narrow::<f32>(&x);
                let (mut c, mut back) = (vec![0.0_f32; n], vec![0.0_f32; n]);
                plan.analyse(&single, &mut c);
                plan.synthesise(&c, &mut back);
                assert!(largest_difference(&back, &x) < 1e-5);
            }
        }
    }

    #[test]
    fn orthogonal_banks_keep_the_energy() {
        let x = gaussian_noise(512, 5);
        for order in [1, 3, 8, 12] {
            let bank = FilterBank::daubechies(order).unwrap();
            let mut c = vec![0.0; 512];
            DwtPlan::new(bank, 512, 5).unwrap().analyse(&x, &mut c);
            let [of_x, of_c] = [&x, &c].map(|list| list.iter().map(|v| v * v).sum::<f64>());
            assert!((of_c / of_x - 1.0).abs() < 1e-10, "{order}");
        }
    }

    #[test]
    fn details_of_a_polynomial_vanish_away_from_its_ends() {
        let n = 256;
        let cubic: Vec<f64> = (0..n).map(|i| (i as f64 / 100.0 - 1.0).powi(3)).collect();
        let mut c = vec![0.0; n];
        let mut largest = |bank| {
            DwtPlan::new(bank, n, 1).unwrap().analyse(&cubic, &mut c);
            c[n / 2 + 10..n - 10].iter().fold(0.0_f64, |a, b| a.max(b.abs()))
        };
        assert!(largest(FilterBank::daubechies(4).unwrap()) < 1e-12);
        assert!(largest(FilterBank::nine_seven()) < 1e-12);
        assert!(largest(FilterBank::daubechies(3).unwrap()) > 1e-7, "three moments are too few");
    }

    #[test]
    fn haar_is_sums_and_differences() {
        let mut plan = DwtPlan::new(FilterBank::daubechies(1).unwrap(), 4, 2).unwrap();
        let mut c = [0.0; 4];
        plan.analyse(&[1.0, 3.0, 4.0, 10.0], &mut c);
        let root = 2.0_f64.sqrt();
        let right = [9.0, -5.0, -2.0 / root, -6.0 / root];
        assert!(c.iter().zip(right).all(|(a, b)| (a - b).abs() < 1e-14), "{c:?}");
    }

    #[test]
    fn lengths_that_do_not_halve_are_not_planned() {
        let bank = FilterBank::daubechies(2).unwrap();
        for (n, levels) in [(12, 3), (0, 1), (8, 0), (8, 64), (8, 4)] {
            assert!(DwtPlan::new(bank.clone(), n, levels).is_none(), "{n}, {levels}");
        }
    }
}
