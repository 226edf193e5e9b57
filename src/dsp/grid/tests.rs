//! The grid against the definition, and its choices against all others.

use rustfft::num_complex::Complex;

use super::*;
use crate::dsp::reference::dft;
use crate::dsp::reference::gaussian_noise;

/// Largest difference to the definition, relative to the largest value.
fn error<T: Real>(length: usize, is_forward: bool) -> f64 {
    let plan = GridPlan::<T>::new(length).unwrap();
    let mut grid = Grid::<T>::new(length);
    let x: Vec<Complex<f64>> = gaussian_noise(2 * length, 3)
        .chunks(2)
        .map(|pair| Complex::new(T::rounded(pair[0]).to_f64(), T::rounded(pair[1]).to_f64()))
        .collect();
    for (i, x) in x.iter().enumerate() {
        (grid.re[i], grid.im[i]) = (T::rounded(x.re), T::rounded(x.im));
    }
    let groups = if is_forward { plan.forward(&mut grid) } else { plan.inverse(&mut grid) };
    let exact = dft(&x);
    let largest = exact.iter().map(|x| x.norm()).fold(0.0, f64::max);
    let mut worst = 0.0_f64;
    for (i, exact) in exact.iter().enumerate() {
        // The DFT has sign −: results of the inverse stand at −i.
        let i = if is_forward { i } else { (length - i) % length };
        let lanes = plan.lanes();
        let group = &groups[i / lanes * 2 * lanes..];
        let (a, b) = (group[i % lanes].to_f64(), group[i % lanes + lanes].to_f64());
        let found = if is_forward { Complex::new(b, a) } else { Complex::new(a, b) };
        worst = worst.max((found - exact).norm());
    }
    worst / largest
}

#[test]
fn every_radix_gives_the_definition() {
    for m in [1, 2, 3, 4, 5, 6, 8, 9, 15, 16, 20, 25, 30, 64, 80, 100, 128, 135] {
        for is_forward in [false, true] {
            // The largest of many values is 3 to 4 times their RMS: roundings of a few passes, 6e-8
            // and 1e-16 each, are far below it. The f64 reference itself errs by 1e-14 at most.
            let single = error::<f32>(16 * m, is_forward);
            assert!(single < 3e-7, "{} {is_forward}: {single:e}", 16 * m);
            let double = error::<f64>(8 * m, is_forward);
            assert!(double < 1e-14, "{} {is_forward}: {double:e}", 8 * m);
        }
    }
}

#[test]
fn lengths_without_a_grid_have_no_plan() {
    for length in [0, 4, 17, 100, 16 * 7, 16 * 17] {
        assert!(GridPlan::<f32>::new(length).is_none(), "{length}");
    }
    assert!(GridPlan::<f64>::new(56).is_none());
}

#[test]
fn halves_of_rows_go_through_narrower_vectors() {
    for m in [1, 3, 25, 125] {
        let (single, double) = (error::<f32>(8 * m, true), error::<f64>(4 * m, false));
        // As above.
        assert!(single < 3e-7 && double < 1e-14, "{m}: {single:e} {double:e}");
    }
}

#[test]
fn passes_are_those_of_least_time() {
    /// Every order of every choice.
    fn slow(m: usize) -> f64 {
        if m == 1 {
            return 0.0;
        }
        let choices = RADICES.iter().filter(|(radix, _)| m.is_multiple_of(*radix));
        choices.map(|(radix, time)| time + slow(m / radix)).fold(f64::INFINITY, f64::min)
    }
    for m in [1, 2, 6, 32, 64, 128, 256, 512, 600, 1024] {
        let (time, radices) = passes(m).unwrap();
        assert!((time - slow(m)).abs() < 1e-9 && radices.iter().product::<usize>() == m);
    }
    // Of all lengths up to twice the least none is cheaper.
    for n in [17, 1000, 4001, 6752] {
        let time = |length: usize| {
            let m = length / 16;
            passes(m).map(|(time, _)| m as f64 * (BESIDE_PASSES + time))
        };
        let found = time(cheapest_length::<f32>(n).unwrap()).unwrap();
        let all = (n.div_ceil(16)..=2 * n.div_ceil(16)).filter_map(|m| time(16 * m));
        assert!((all.fold(f64::INFINITY, f64::min) - found).abs() < 1e-9, "{n}");
    }
}

#[test]
fn the_cheapest_length_is_long_enough_and_has_a_grid() {
    for n in [0, 1, 16, 17, 100, 1013, 4001, 6752, 100_000] {
        let length = cheapest_length::<f32>(n).unwrap();
        assert!(length >= n && length <= 2 * n.max(16) + 16, "{n}: {length}");
        assert!(is_possible::<f32>(length));
    }
    assert_eq!(cheapest_length::<f32>(1 << 20), None);
}
