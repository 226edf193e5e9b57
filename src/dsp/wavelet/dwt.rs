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
    n: usize,
    levels: u32,
    /// Low and high pass, each as what meets even and odd samples.
    analysis: [[Phase; 2]; 2],
    /// Low and high pass, each as what makes even and odd samples.
    synthesis: [[Phase; 2]; 2],
    samples: Vec<f64>,
    coefficients: Vec<f64>,
    /// Even and odd samples of a level.
    halves: [Vec<f64>; 2],
    /// A half with its continuation.
    continued: Vec<f64>,
}

/// Every other tap of a filter: out[k] = Σ taps[j]·in[k + first + j].
#[derive(Debug)]
struct Phase {
    first: isize,
    taps: Vec<f64>,
}

impl Phase {
    /// What of `a[k] = Σ h[n]·x[n + 2k]` meets the samples `x[2i + parity]`: n = 2s + parity, i = k + s.
    fn of_analysis(filter: &Taps, parity: isize) -> Self {
        let taps = filter.iter().filter(|(n, _)| n.rem_euclid(2) == parity);
        let (places, taps): (Vec<isize>, Vec<f64>) = taps.unzip();
        let first = places.first().map_or(0, |n| (n - parity) / 2);
        Self { first, taps }
    }

    /// What of `x[n] = Σ h[n − 2k]·a[k]` makes the samples `x[2i + parity]`: the same taps from the last to the first,
    /// k = i − s.
    fn of_synthesis(filter: &Taps, parity: isize) -> Self {
        let Self { first, mut taps } = Self::of_analysis(filter, parity);
        taps.reverse();
        let last = first + taps.len().cast_signed() - 1;
        Self { first: -last, taps }
    }

    /// Adds to `out`; `input` goes on periodically, into `continued`.
    fn add(&self, input: &[f64], continued: &mut Vec<f64>, out: &mut [f64]) {
        let n = input.len();
        let begin = self.first.rem_euclid(n.cast_signed()).cast_unsigned();
        continued.clear();
        continued.extend_from_slice(&input[begin..]);
        let wanted = n + self.taps.len();
        while continued.len() < wanted {
            continued.extend_from_slice(&input[..n.min(wanted - continued.len())]);
        }
        sum_of_taps(&self.taps, continued, out);
    }
}

/// Sums made side by side, so that none waits for another.
const LANES: usize = 8;

/// out[k] += Σ taps[j]·x[k + j].
fn sum_of_taps(taps: &[f64], x: &[f64], out: &mut [f64]) {
    let (blocks, rest) = out.as_chunks_mut::<LANES>();
    let n_in_blocks = blocks.len() * LANES;
    for (i, block) in blocks.iter_mut().enumerate() {
        for (tap, x) in taps.iter().zip(x[i * LANES..].windows(LANES)) {
            for (sum, x) in block.iter_mut().zip(x) {
                *sum += tap * x;
            }
        }
    }
    for (k, out) in rest.iter_mut().enumerate() {
        let x = &x[n_in_blocks + k..];
        *out += taps.iter().zip(x).map(|(tap, x)| tap * x).sum::<f64>();
    }
}

impl DwtPlan {
    /// Plans records of `n` samples; `None` unless `n` is a multiple of 2^`levels` and `levels` ≥ 1.
    #[must_use]
    pub fn new(bank: &FilterBank, n: usize, levels: u32) -> Option<Self> {
        let step = 1_usize.checked_shl(levels)?;
        if levels == 0 || n == 0 || !n.is_multiple_of(step) {
            return None;
        }
        let analysis = [&bank.analysis_low, &bank.analysis_high]
            .map(|filter| [0, 1].map(|parity| Phase::of_analysis(filter, parity)));
        let synthesis = [&bank.synthesis_low, &bank.synthesis_high]
            .map(|filter| [0, 1].map(|parity| Phase::of_synthesis(filter, parity)));
        let phases = analysis.iter().chain(&synthesis).flatten();
        let longest = phases.map(|phase| phase.taps.len()).max().unwrap_or(0);
        Some(Self {
            n,
            levels,
            analysis,
            synthesis,
            samples: vec![0.0; n],
            coefficients: vec![0.0; n],
            halves: [0, 1].map(|_| vec![0.0; n / 2]),
            continued: Vec::with_capacity(n / 2 + longest),
        })
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
        let Self { analysis, samples, coefficients, halves, continued, .. } = self;
        for (to, from) in samples.iter_mut().zip(x) {
            *to = from.to_f64();
        }
        for level in 0..self.levels {
            let n = self.n >> level;
            let [even, odd] = halves.each_mut().map(|half| &mut half[..n / 2]);
            for ((pair, even), odd) in samples[..n].as_chunks().0.iter().zip(even).zip(odd) {
                [*even, *odd] = *pair;
            }
            coefficients[..n].fill(0.0);
            let (approximation, detail) = coefficients[..n].split_at_mut(n / 2);
            for (filter, out) in analysis.iter().zip([approximation, detail]) {
                for (phase, half) in filter.iter().zip(halves.iter()) {
                    phase.add(&half[..n / 2], continued, out);
                }
            }
            samples[..n / 2].copy_from_slice(&coefficients[..n / 2]);
        }
        for (to, from) in out.iter_mut().zip(coefficients.iter()) {
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
        let Self { synthesis, samples, coefficients: of_level, halves, continued, .. } = self;
        for (to, from) in samples.iter_mut().zip(coefficients) {
            *to = from.to_f64();
        }
        for level in (0..self.levels).rev() {
            let n = self.n >> level;
            of_level[..n].copy_from_slice(&samples[..n]);
            let (approximation, detail) = of_level[..n].split_at(n / 2);
            for (parity, half) in halves.iter_mut().enumerate() {
                let half = &mut half[..n / 2];
                half.fill(0.0);
                for (filter, part) in synthesis.iter().zip([approximation, detail]) {
                    filter[parity].add(part, continued, half);
                }
            }
            let [even, odd] = halves.each_ref().map(|half| &half[..n / 2]);
            for ((pair, even), odd) in samples[..n].as_chunks_mut().0.iter_mut().zip(even).zip(odd)
            {
                *pair = [*even, *odd];
            }
        }
        for (to, from) in out.iter_mut().zip(samples.iter()) {
            *to = T::rounded(*from);
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
                let mut plan = DwtPlan::new(&bank, n, levels).unwrap();
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

    /// The definition (D104), index by index.
    fn by_definition(bank: &FilterBank, x: &[f64], levels: u32) -> Vec<f64> {
        let mut out = x.to_vec();
        for level in 0..levels {
            let n = x.len() >> level;
            let samples = out[..n].to_vec();
            for (half, filter) in [&bank.analysis_low, &bank.analysis_high].into_iter().enumerate()
            {
                for k in 0..n / 2 {
                    let at = |i: isize| {
                        let place = (2 * k.cast_signed() + i).rem_euclid(n.cast_signed());
                        samples[place.cast_unsigned()]
                    };
                    out[half * n / 2 + k] = filter.iter().map(|(i, tap)| tap * at(i)).sum();
                }
            }
        }
        out
    }

    #[test]
    fn coefficients_are_those_of_the_definition() {
        for (n, levels) in [(64, 6), (96, 5), (1000, 3), (2, 1)] {
            let x = gaussian_noise(n, 9);
            for bank in banks() {
                let mut c = vec![0.0; n];
                DwtPlan::new(&bank, n, levels).unwrap().analyse(&x, &mut c);
                // Sums of 20 products in another order, six levels.
                assert!(largest_difference(&c, &by_definition(&bank, &x, levels)) < 1e-12);
            }
        }
    }

    #[test]
    fn orthogonal_banks_keep_the_energy() {
        let x = gaussian_noise(512, 5);
        for order in [1, 3, 8, 12] {
            let bank = FilterBank::daubechies(order).unwrap();
            let mut c = vec![0.0; 512];
            DwtPlan::new(&bank, 512, 5).unwrap().analyse(&x, &mut c);
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
            DwtPlan::new(&bank, n, 1).unwrap().analyse(&cubic, &mut c);
            c[n / 2 + 10..n - 10].iter().fold(0.0_f64, |a, b| a.max(b.abs()))
        };
        assert!(largest(FilterBank::daubechies(4).unwrap()) < 1e-12);
        assert!(largest(FilterBank::nine_seven()) < 1e-12);
        assert!(largest(FilterBank::daubechies(3).unwrap()) > 1e-7, "three moments are too few");
    }

    #[test]
    fn haar_is_sums_and_differences() {
        let mut plan = DwtPlan::new(&FilterBank::daubechies(1).unwrap(), 4, 2).unwrap();
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
            assert!(DwtPlan::new(&bank, n, levels).is_none(), "{n}, {levels}");
        }
    }
}
