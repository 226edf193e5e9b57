//! Moments against closed forms, slow sums and each other.

use proptest::prelude::*;

use super::*;
use crate::dsp::real::floor_index;
use crate::dsp::reference::gaussian_noise;
use crate::dsp::reference::sine;

/// Two-pass moments as the definition says, without blocks or shifts.
fn slow_moments(x: &[f64]) -> [f64; 4] {
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    let central = |p: i32| x.iter().map(|v| (v - mean).powi(p)).sum::<f64>();
    [mean, central(2), central(3), central(4)]
}

#[test]
fn sine_has_its_closed_form() {
    // 100 whole periods: RMS A/√2, crest √2, kurtosis 1.5, skewness 0; the peak is missed by
    // at most 1 − cos(π·f/fs) = 5e-5 because the samples may straddle it.
    let x = sine(10_000, 10_000.0, 100.0, 3.0, 0.3);
    let m = Moments::of(&x);
    assert!((m.rms().unwrap() - 3.0 / 2f64.sqrt()).abs() < 1e-12);
    assert!((m.crest().unwrap() - 2f64.sqrt()).abs() < 1e-3);
    assert!((m.kurtosis().unwrap() - 1.5).abs() < 1e-12);
    assert!(m.skewness().unwrap().abs() < 1e-12);
}

#[test]
fn zero_denominators_give_none() {
    let empty = Moments::of::<f64>(&[]);
    assert_eq!(empty.n, 0);
    assert_eq!((empty.rms(), empty.peak(), empty.crest()), (None, None, None));
    for constant in [vec![0.1_f64; 5000], vec![7.3], vec![0.0; 3]] {
        let m = Moments::of(&constant);
        // Exactly zero by the shift, not merely small.
        assert_eq!((m.rms(), m.peak()), (Some(0.0), Some(0.0)));
        assert_eq!((m.crest(), m.kurtosis(), m.skewness()), (None, None, None));
    }
}

#[test]
fn a_huge_offset_costs_only_input_rounding() {
    let x = gaussian_noise(20_000, 7);
    let plain = Moments::of(&x);
    let shifted: Vec<f64> = x.iter().map(|v| v + 1e6).collect();
    let with_dc = Moments::of(&shifted);
    // Adding 1e6 rounds each sample by up to 6e-11.
    assert!((with_dc.rms().unwrap() - plain.rms().unwrap()).abs() < 1e-10);
    assert!((with_dc.kurtosis().unwrap() - plain.kurtosis().unwrap()).abs() < 1e-9);
    // In f32 a DC of 100 RMS rounds samples by up to 4e-6 of the RMS.
    let narrow: Vec<f32> = x.iter().map(|v| f32::rounded(v + 100.0)).collect();
    assert!((Moments::of(&narrow).rms().unwrap() - plain.rms().unwrap()).abs() < 1e-6);
}

#[test]
fn f32_agrees_with_f64() {
    let x = gaussian_noise(10_007, 3);
    let narrow: Vec<f32> = x.iter().map(|v| f32::rounded(*v)).collect();
    let (a, b) = (Moments::of(&x), Moments::of(&narrow));
    // All sums are f64; only the rounding of the samples (6e-8) is left.
    assert!((a.rms().unwrap() - b.rms().unwrap()).abs() < 1e-7);
    assert!((a.kurtosis().unwrap() - b.kurtosis().unwrap()).abs() < 1e-5);
}

/// Mean, RMS, skewness, kurtosis, M6, M8 as the definition says, on values divided by `unit`.
fn slow_figures(x: &[f64], unit: f64) -> [f64; 6] {
    let x: Vec<f64> = x.iter().map(|v| v / unit).collect();
    let n = x.len() as f64;
    let mean = x.iter().sum::<f64>() / n;
    let central = |p: i32| x.iter().map(|v| (v - mean).powi(p)).sum::<f64>() / n;
    let rms = central(2).sqrt();
    let ratio = |p: i32| central(p) / rms.powi(p);
    [mean * unit, rms * unit, ratio(3), ratio(4), ratio(6), ratio(8)]
}

fn figures(m: &Moments) -> [f64; 6] {
    [
        m.mean,
        m.rms().unwrap(),
        m.skewness().unwrap(),
        m.kurtosis().unwrap(),
        m.m6().unwrap(),
        m.m8().unwrap(),
    ]
}

/// RMS relative to itself, ratios to themselves or 1.
fn assert_close(found: &[f64; 6], exact: &[f64; 6], tolerance: f64) {
    assert!((found[1] / exact[1] - 1.0).abs() <= tolerance, "{found:?} {exact:?}");
    for (found, exact) in found[2..].iter().zip(&exact[2..]) {
        assert!((found - exact).abs() <= tolerance * exact.abs().max(1.0), "{found} {exact}");
    }
}

#[test]
fn sixth_and_eighth_moments_have_their_closed_forms() {
    // A sine: (2p)!/(p!)²/2^p: 20/8 and 70/16; all periods whole.
    let m = Moments::of(&sine(10_000, 10_000.0, 100.0, 3.0, 0.3));
    assert!((m.m6().unwrap() - 2.5).abs() < 1e-12);
    assert!((m.m8().unwrap() - 4.375).abs() < 1e-12);
    // Two values: every even moment is 1.
    let two: Vec<f32> = (0..4096).map(|i| if i % 2 == 0 { 2.0 } else { -2.0 }).collect();
    let m = Moments::of(&two);
    assert!((m.m6().unwrap() - 1.0).abs() < 1e-12 && (m.m8().unwrap() - 1.0).abs() < 1e-12);
    // White noise: 15 ± 2.4·√(1000/n), 105 ± 36·√(1000/n) (one standard deviation).
    let m = Moments::of(&gaussian_noise(200_000, 21));
    assert!((m.m6().unwrap() - 15.0).abs() < 0.6 && (m.m8().unwrap() - 105.0).abs() < 10.0);
}

#[test]
fn one_sample_impulse_has_its_closed_form() {
    // One 1 among n − 1 zeros at p = 1/n: central moments p(1 − p)^k + (1 − p)(−p)^k.
    for place in [0, 1, 1023, 1024, 5000, 9999] {
        let mut x = vec![0.0_f32; 10_000];
        x[place] = 1.0;
        let m = Moments::of(&x);
        let p = 1e-4_f64;
        let central = |k: i32| p * (1.0 - p).powi(k) + (1.0 - p) * (-p).powi(k);
        let ratio = |k: i32| central(k) / central(2).powi(k / 2);
        for (found, k) in [(m.kurtosis(), 4), (m.m6(), 6), (m.m8(), 8)] {
            // Rounding of a few thousand additions.
            assert!((found.unwrap() / ratio(k) - 1.0).abs() < 1e-12, "{place} {k}");
        }
        assert!((m.crest().unwrap() - (1.0 - p) / central(2).sqrt()).abs() < 1e-9);
    }
}

#[test]
fn raw_counts_denormals_and_huge_numbers_have_all_moments() {
    let noise = gaussian_noise(5000, 12);
    let plain = slow_figures(&noise, 1.0);
    // 24-bit counts at full scale: 8 388 607⁸ is no number of f32.
    let counts: Vec<f32> = noise.iter().map(|v| f32::rounded((v * 2e6).round())).collect();
    let wide: Vec<f64> = counts.iter().map(|v| f64::from(*v)).collect();
    assert_close(&figures(&Moments::of(&counts)), &slow_figures(&wide, 1.0), 1e-12);
    // Powers of two change no digit of f64, whether or not the eighth power is a number.
    for unit in [2f64.powi(-1000), 2f64.powi(-200), 2f64.powi(300), 2f64.powi(1000)] {
        let x: Vec<f64> = noise.iter().map(|v| v * unit).collect();
        let found = figures(&Moments::of(&x));
        assert_close(&found, &slow_figures(&x, unit), 1e-12);
        assert!((found[4] - plain[4]).abs() < 1e-11 * plain[4]);
        // Merged with plain numbers it vanishes in them, or they in it, but no figure is lost.
        let both = Moments::of(&x).merge(&Moments::of(&noise));
        assert!(figures(&both).iter().all(|value| value.is_finite()), "{unit:e}");
    }
    // Denormal f32, a few hundred steps of 1.4e-45.
    let tiny: Vec<f32> = noise.iter().map(|v| f32::rounded(v * 1e-42)).collect();
    assert!(tiny.iter().all(|v| v.abs() < f32::MIN_POSITIVE));
    let wide: Vec<f64> = tiny.iter().map(|v| f64::from(*v)).collect();
    assert_close(&figures(&Moments::of(&tiny)), &slow_figures(&wide, 1e-42), 1e-12);
}

#[test]
fn offset_of_a_million_leaves_the_eighth_moment() {
    let x: Vec<f64> = gaussian_noise(20_000, 7).iter().map(|v| v + 1e6).collect();
    // Against the very samples, from which the offset can be taken without rounding.
    let exact: Vec<f64> = x.iter().map(|v| v - 1e6).collect();
    // The means of the blocks are numbers near 1e6: 1e-10 of a deviation each.
    assert_close(&figures(&Moments::of(&x)), &slow_figures(&exact, 1.0), 1e-10);
}

#[test]
fn a_history_is_that_of_its_newest_samples() {
    let x: Vec<f32> = gaussian_noise(20_000, 5).iter().map(|v| f32::rounded(*v)).collect();
    let mut history = MomentHistory::new(10);
    assert_eq!(history.moments(), Moments::EMPTY);
    for (i, block) in x.chunks(1000).enumerate() {
        history.push(block);
        let held = &x[(i + 1).saturating_sub(10) * 1000..(i + 1) * 1000];
        let (found, exact) = (history.moments(), Moments::of(held));
        assert_eq!((found.n, found.min, found.max), (exact.n, exact.min, exact.max));
        // Other blocks, other roundings.
        assert_close(&figures(&found), &figures(&exact), 1e-12);
    }
    assert_eq!(history.n_blocks(), 10);
    history.clear();
    assert_eq!(history.moments().n, 0);
    // Zeros, then a constant: no variance, then that of two levels.
    let mut history = MomentHistory::new(2);
    history.push(&[0.0_f32; 500]);
    assert_eq!(history.moments().m8(), None);
    history.push(&[4.0_f32; 500]);
    let two = history.moments();
    assert_eq!((two.rms(), two.m8()), (Some(2.0), Some(1.0)));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn merging_equals_computing_at_once(
        x in prop::collection::vec(-100.0..100.0_f64, 2..3000),
        cut in 0.0..1.0_f64,
        offset in -1e3..1e3_f64,
    ) {
        let x: Vec<f64> = x.iter().map(|v| v + offset).collect();
        let at = floor_index(cut * x.len() as f64);
        let merged = Moments::of(&x[..at]).merge(&Moments::of(&x[at..]));
        let [mean, m2, m3, m4] = slow_moments(&x);
        // Rounding of 3000 additions of terms up to 200^p, relative to the sum of magnitudes.
        let n = x.len() as f64;
        prop_assert!((merged.mean - mean).abs() < 1e-11 * 1e3);
        prop_assert!((merged.sums[2] - m2).abs() < 1e-11 * n * 200f64.powi(2));
        prop_assert!((merged.sums[3] - m3).abs() < 1e-11 * n * 200f64.powi(3));
        prop_assert!((merged.sums[4] - m4).abs() < 1e-11 * n * 200f64.powi(4));
        prop_assert_eq!(merged.n, x.len() as u64);
    }
}
