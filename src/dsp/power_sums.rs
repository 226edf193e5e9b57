//! Σ|z|² and Σ|z|⁴ of complex numbers, taken on the way from one list to another.
//!
//! Must not know what the numbers are.

use std::ops::AddAssign;

use pulp::Arch;
use pulp::Simd;
use pulp::WithSimd;

use crate::dsp::lanes::lanes_of;
use crate::dsp::real::Real;

/// Vectors summed in `T` before the sum goes on in f64.
const BLOCK: usize = 32;

/// Sums over some complex numbers.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(in crate::dsp) struct PowerSums {
    /// Σ|z|².
    pub(in crate::dsp) second: f64,
    /// Σ|z|⁴.
    pub(in crate::dsp) fourth: f64,
}

impl AddAssign for PowerSums {
    fn add_assign(&mut self, other: Self) {
        self.second += other.second;
        self.fourth += other.fourth;
    }
}

/// Writes a + b into `to`, as many as fit, and sums the powers. Lists are real and imaginary parts.
pub(in crate::dsp) fn of_sum<T: Real>(a: [&[T]; 2], b: [&[T]; 2], to: [&mut [T]; 2]) -> PowerSums {
    Arch::new().dispatch(OfSum { a, b, to })
}

/// Sums the powers of groups of `lanes` real parts, `lanes` imaginary parts, and writes them apart.
pub(in crate::dsp) fn of_groups<T: Real>(list: &[T], lanes: usize, to: [&mut [T]; 2]) -> PowerSums {
    Arch::new().dispatch(OfGroups { list, lanes, to })
}

/// Σ|z|² of lists of real and imaginary parts.
pub(in crate::dsp) fn of_list<T: Real>(re: &[T], im: &[T]) -> f64 {
    Arch::new().dispatch(OfList { re, im })
}

/// Mean, blocks of it summed in `T`: for an offset that need not be exact. That of equal samples is. 0 of
/// none.
pub(in crate::dsp) fn rough_mean<T: Real>(x: &[T]) -> f64 {
    Arch::new().dispatch(RoughMean { x })
}

/// Sums of the vectors of a block.
struct Sums<T: Real, S: Simd> {
    second: T::Vector<S>,
    fourth: T::Vector<S>,
}

impl<T: Real, S: Simd> Sums<T, S> {
    #[inline(always)]
    fn zero(simd: S) -> Self {
        let zero = T::splat(simd, T::zero());
        Self { second: zero, fourth: zero }
    }

    #[inline(always)]
    fn add(&mut self, simd: S, re: T::Vector<S>, im: T::Vector<S>) {
        let square = T::times_plus(simd, re, re, T::times(simd, im, im));
        self.second = T::plus(simd, self.second, square);
        self.fourth = T::times_plus(simd, square, square, self.fourth);
    }

    #[inline(always)]
    fn sums(&self) -> PowerSums {
        PowerSums {
            second: sum_of_lanes::<T, S>(self.second),
            fourth: sum_of_lanes::<T, S>(self.fourth),
        }
    }
}

/// The sum of a vector's numbers, in f64, four at a time.
#[inline(always)]
pub(in crate::dsp) fn sum_of_lanes<T: Real, S: Simd>(vector: T::Vector<S>) -> f64 {
    let list = [vector];
    let (fours, rest) = bytemuck::cast_slice::<T::Vector<S>, T>(&list).as_chunks::<4>();
    let mut sums = [0.0; 4];
    for four in fours {
        for (sum, x) in sums.iter_mut().zip(four) {
            *sum += x.to_f64();
        }
    }
    sums.iter().sum::<f64>() + rest.iter().map(|x| x.to_f64()).sum::<f64>()
}

/// Of numbers one by one.
fn of_rest<T: Real>(re: &[T], im: &[T]) -> PowerSums {
    let mut sums = PowerSums::default();
    for (re, im) in re.iter().zip(im) {
        let square = (*re * *re + *im * *im).to_f64();
        sums += PowerSums { second: square, fourth: square * square };
    }
    sums
}

struct OfList<'a, T> {
    re: &'a [T],
    im: &'a [T],
}

impl<T: Real> WithSimd for OfList<'_, T> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let block = BLOCK * lanes_of::<T, S>();
        let mut sum = 0.0;
        for (re, im) in self.re.chunks(block).zip(self.im.chunks(block)) {
            let (re_vectors, im_vectors) = (T::vectors::<S>(re), T::vectors::<S>(im));
            let mut lanes = [T::splat(simd, T::zero()); 2];
            for (re, im) in re_vectors.iter().zip(im_vectors) {
                lanes[0] = T::times_plus(simd, *re, *re, lanes[0]);
                lanes[1] = T::times_plus(simd, *im, *im, lanes[1]);
            }
            sum += sum_of_lanes::<T, S>(T::plus(simd, lanes[0], lanes[1]));
            let whole = re_vectors.len() * lanes_of::<T, S>();
            sum += of_rest(&re[whole..], &im[whole..]).second;
        }
        sum
    }
}

struct RoughMean<'a, T> {
    x: &'a [T],
}

impl<T: Real> WithSimd for RoughMean<'_, T> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let Some(first) = self.x.first() else { return 0.0 };
        let shift = T::splat(simd, *first);
        let mut sum = 0.0;
        for block in self.x.chunks(4 * BLOCK * lanes_of::<T, S>()) {
            let vectors = T::vectors::<S>(block);
            let mut lanes = [T::splat(simd, T::zero()); 4];
            let (fours, rest) = vectors.as_chunks::<4>();
            for four in fours {
                for i in 0..4 {
                    lanes[i] = T::plus(simd, lanes[i], T::minus(simd, four[i], shift));
                }
            }
            for vector in rest {
                lanes[0] = T::plus(simd, lanes[0], T::minus(simd, *vector, shift));
            }
            let halves = [T::plus(simd, lanes[0], lanes[1]), T::plus(simd, lanes[2], lanes[3])];
            sum += sum_of_lanes::<T, S>(T::plus(simd, halves[0], halves[1]));
            let whole = vectors.len() * lanes_of::<T, S>();
            sum += block[whole..].iter().map(|x| (*x - *first).to_f64()).sum::<f64>();
        }
        first.to_f64() + sum / self.x.len() as f64
    }
}

struct OfSum<'a, T> {
    a: [&'a [T]; 2],
    b: [&'a [T]; 2],
    to: [&'a mut [T]; 2],
}

impl<T: Real> WithSimd for OfSum<'_, T> {
    type Output = PowerSums;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> PowerSums {
        let Self { a, b, to: [to_re, to_im] } = self;
        let n = to_re.len();
        let [a_re, a_im] = a.map(|list| &list[..n]);
        let [b_re, b_im] = b.map(|list| &list[..n]);
        let whole = n - n % lanes_of::<T, S>();
        let mut sums = PowerSums::default();
        let block = BLOCK * lanes_of::<T, S>();
        for first in (0..whole).step_by(block) {
            let places = first..whole.min(first + block);
            let (a_re, a_im) = (&a_re[places.clone()], &a_im[places.clone()]);
            let (b_re, b_im) = (&b_re[places.clone()], &b_im[places.clone()]);
            let (a_re, a_im) = (T::vectors::<S>(a_re), T::vectors::<S>(a_im));
            let (b_re, b_im) = (T::vectors::<S>(b_re), T::vectors::<S>(b_im));
            let to_re = T::vectors_mut::<S>(&mut to_re[places.clone()]);
            let to_im = T::vectors_mut::<S>(&mut to_im[places]);
            let mut block = Sums::<T, S>::zero(simd);
            let n = to_re.len();
            let (a_re, a_im, b_re, b_im) = (&a_re[..n], &a_im[..n], &b_re[..n], &b_im[..n]);
            let to_im = &mut to_im[..n];
            for i in 0..n {
                to_re[i] = T::plus(simd, a_re[i], b_re[i]);
                to_im[i] = T::plus(simd, a_im[i], b_im[i]);
                block.add(simd, to_re[i], to_im[i]);
            }
            sums += block.sums();
        }
        for i in whole..n {
            (to_re[i], to_im[i]) = (a_re[i] + b_re[i], a_im[i] + b_im[i]);
        }
        sums += of_rest(&to_re[whole..], &to_im[whole..]);
        sums
    }
}

struct OfGroups<'a, T> {
    list: &'a [T],
    lanes: usize,
    to: [&'a mut [T]; 2],
}

impl<T: Real> WithSimd for OfGroups<'_, T> {
    type Output = PowerSums;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> PowerSums {
        let Self { list, lanes, to: [re, im] } = self;
        if lanes == lanes_of::<T, S>() {
            let (pairs, _) = T::vectors::<S>(list).as_chunks::<2>();
            let (re, im) = (T::vectors_mut::<S>(re), T::vectors_mut::<S>(im));
            let mut sums = PowerSums::default();
            let lists = re.chunks_mut(BLOCK).zip(im.chunks_mut(BLOCK));
            for ((re, im), pairs) in lists.zip(pairs.chunks(BLOCK)) {
                let mut block = Sums::<T, S>::zero(simd);
                for ((re, im), pair) in re.iter_mut().zip(im).zip(pairs) {
                    (*re, *im) = (pair[0], pair[1]);
                    block.add(simd, pair[0], pair[1]);
                }
                sums += block.sums();
            }
            return sums;
        }
        // Another width of vectors: the library's single numbers, or lengths that the widest do not divide.
        let (re_groups, im_groups) = (re.chunks_mut(lanes), im.chunks_mut(lanes));
        for ((re, im), pair) in re_groups.zip(im_groups).zip(list.chunks(2 * lanes)) {
            re.copy_from_slice(&pair[..lanes]);
            im.copy_from_slice(&pair[lanes..]);
        }
        let mut sums = PowerSums::default();
        let block = BLOCK * lanes_of::<T, S>();
        for (re, im) in re.chunks(block).zip(im.chunks(block)) {
            let (re_vectors, im_vectors) = (T::vectors::<S>(re), T::vectors::<S>(im));
            let mut block = Sums::<T, S>::zero(simd);
            for (re, im) in re_vectors.iter().zip(im_vectors) {
                block.add(simd, *re, *im);
            }
            sums += block.sums();
            let whole = re_vectors.len() * lanes_of::<T, S>();
            sums += of_rest(&re[whole..], &im[whole..]);
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::narrow;

    /// Powers of sums and of groups against their definitions, at lengths with and without a rest.
    fn check<T: Real>(tolerance: f64) {
        for n in [1, 7, 16, 40, 600, 1000, 1024] {
            let lists = [1, 2, 3, 4].map(|seed| narrow::<T>(&gaussian_noise(n, seed)));
            let [a_re, a_im, b_re, b_im] = &lists;
            let (mut re, mut im) = (vec![T::zero(); n], vec![T::zero(); n]);
            let found = of_sum([a_re, a_im], [b_re, b_im], [&mut re, &mut im]);
            let close = |found: PowerSums, re: &[T], im: &[T]| {
                let exact = of_rest(re, im);
                assert!((found.second / exact.second - 1.0).abs() < tolerance, "{n}: {found:?}");
                assert!((found.fourth / exact.fourth - 1.0).abs() < tolerance, "{n}: {found:?}");
            };
            for i in 0..n {
                assert!(re[i] == a_re[i] + b_re[i] && im[i] == a_im[i] + b_im[i]);
            }
            close(found, &re, &im);
            for lanes in [1, 2, 4, 8, 16].into_iter().filter(|lanes| n.is_multiple_of(*lanes)) {
                let pairs = a_re.chunks(lanes).zip(a_im.chunks(lanes));
                let list: Vec<T> = pairs.flat_map(|(re, im)| [re, im].concat()).collect();
                let found = of_groups(&list, lanes, [&mut re, &mut im]);
                assert!(re == *a_re && im == *a_im, "{n} {lanes}");
                close(found, a_re, a_im);
            }
        }
    }

    #[test]
    fn lists_and_rough_means_are_those_of_the_definition() {
        for n in [1, 7, 16, 100, 5000] {
            let [re, im] = [1, 2].map(|seed| narrow::<f32>(&gaussian_noise(n, seed)));
            let exact = of_rest(&re, &im).second;
            assert!((of_list(&re, &im) / exact - 1.0).abs() < 1e-6, "as below");
            let offset: Vec<f32> = re.iter().map(|x| x + 100.0).collect();
            let mean = offset.iter().map(|x| f64::from(*x)).sum::<f64>() / n as f64;
            // Sums of 32 numbers of size 3, rounded to 6e-8 each time.
            assert!((rough_mean(&offset) - mean).abs() < 1e-5, "{n}");
            assert!((rough_mean(&vec![0.1_f32; n]) - f64::from(0.1_f32)).abs() <= 0.0);
        }
        assert!(rough_mean::<f32>(&[]).abs() <= 0.0);
    }

    #[test]
    fn sums_are_those_of_the_definition() {
        // Blocks of 32 are summed in the type: a third of 32 roundings, of positive numbers.
        check::<f32>(1e-6);
        check::<f64>(2e-15);
    }
}
