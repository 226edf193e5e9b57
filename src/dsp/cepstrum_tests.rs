use std::f64::consts::TAU;

use super::*;
use crate::dsp::fft::ForwardPlan;
use crate::dsp::reference::dft;
use crate::dsp::reference::dft_of_real;
use crate::dsp::reference::gaussian_noise;
use crate::dsp::reference::largest_difference;
use crate::dsp::reference::narrow;
use crate::dsp::stats;
use crate::dsp::synthesis::SynthesisPlan;

const FS_HZ: f64 = 1000.0;

fn spectrum<T: Real>(x: &[f64]) -> Vec<Complex<T>> {
    let mut forward = ForwardPlan::new(x.len(), &mut FftCache::new());
    let mut x_hat = vec![Complex::zero(); forward.n_bins()];
    forward.process(&narrow::<T>(x), &mut x_hat);
    x_hat
}

fn cepstrum<T: Real>(x: &[f64], kind: Kind) -> Vec<T> {
    let mut plan = CepstrumPlan::new(x.len(), &mut FftCache::new());
    let mut out = vec![T::one(); plan.n_values()];
    plan.process(&spectrum::<T>(x), kind, &mut out);
    out
}

fn liftered<T: Real>(x: &[f64], lifter: Lifter) -> Vec<Complex<T>> {
    let mut plan = LifterPlan::new(x.len(), FS_HZ, lifter, &mut FftCache::new()).unwrap();
    let mut out = vec![Complex::zero(); fft::n_bins(x.len())];
    plan.process(&spectrum::<T>(x), &mut out);
    out
}

/// x[i] + a·x[i − d], circular: the spectrum times 1 + a·e^(−j2πkd/n), exactly.
fn with_echo(x: &[f64], a: f64, d: usize) -> Vec<f64> {
    let n = x.len();
    (0..n).map(|i| x[i] + a * x[(i + n - d) % n]).collect()
}

#[test]
fn matches_the_definition() {
    for n in [2, 3, 64, 97, 250] {
        let x = gaussian_noise(n, 5);
        let power: Vec<f64> = dft_of_real(&x).iter().map(|x| x.norm_sqr()).collect();
        let floor = 1e-12 * power.iter().copied().fold(0.0, f64::max);
        // Bin 0 is rounding of the mean's removal: ε.
        let log = |(k, s): (usize, &f64)| {
            Complex::new((if k == 0 { floor } else { s + floor }).ln(), 0.0)
        };
        let exact = dft(&power.iter().enumerate().map(log).collect::<Vec<_>>());
        let exact: Vec<f64> = exact[..=n / 2].iter().map(|c| c.re / n as f64).collect();
        // Logarithms up to 30: rounding of the transform; a bin 100 times below its neighbours has
        // 1e-5 of error in f32.
        assert!(largest_difference(&cepstrum::<f64>(&x, Kind::Power), &exact) < 1e-12, "{n}");
        assert!(largest_difference(&cepstrum::<f32>(&x, Kind::Power), &exact) < 1e-5, "{n}");
        let half: Vec<f64> = exact.iter().map(|c| 0.5 * c).collect();
        let square: Vec<f64> = exact.iter().map(|c| c * c).collect();
        assert!(largest_difference(&cepstrum::<f64>(&x, Kind::Real), &half) < 1e-12);
        assert!(largest_difference(&cepstrum::<f64>(&x, Kind::Squared), &square) < 1e-11);
    }
}

#[test]
fn an_echo_has_its_closed_form() {
    // ln|1 + a·e^(−jωd)|² = 2·Σ (−1)^(m+1)·a^m/m·cos(mωd): a^m/m at m·d, signs alternating.
    let (n, a, d) = (4096, 0.5_f64, 50);
    let x = gaussian_noise(n, 2);
    let (plain, echo) =
        (cepstrum::<f64>(&x, Kind::Power), cepstrum::<f64>(&with_echo(&x, a, d), Kind::Power));
    // Bin 0, ε in both, misses its share of the echo, 2·ln(1 + a) and the change of ε, over n.
    let missing = 2.0 * (1.0 + a).ln() / n as f64;
    for q in 1..400 {
        let m = q / d;
        let sign = if m % 2 == 1 { 1.0 } else { -1.0 };
        let exact = if q % d == 0 { sign * a.powf(m as f64) / m as f64 } else { 0.0 };
        let found = echo[q] - plain[q];
        assert!((found - exact).abs() < 2.0 * missing, "{q}: {found} {exact}");
    }
}

#[test]
fn scale_moves_the_level_only() {
    let x = gaussian_noise(300, 1);
    let exact = cepstrum::<f64>(&x, Kind::Power);
    for scale in [1e-30, 1e-3, 1e30] {
        let scaled: Vec<f64> = x.iter().map(|v| v * scale).collect();
        let found = cepstrum::<f64>(&scaled, Kind::Power);
        // ln of up to 1e60: 140, rounded to 3e-14.
        assert!((found[0] - exact[0] - 2.0 * scale.ln()).abs() < 1e-11);
        assert!(largest_difference(&found[1..], &exact[1..]) < 1e-11);
    }
}

#[test]
fn an_impulse_is_flat() {
    // |X| = 1 in every bin but 0, which counts as ε: c = ln(1)·δ + ln(ε)/n.
    let n = 101;
    let mut x = vec![0.0; n];
    x[0] = 1.0;
    let out = cepstrum::<f64>(&x, Kind::Power);
    let exact = 1e-12_f64.ln() / n as f64;
    assert!(out.iter().all(|c| (c - exact).abs() < 1e-11), "{:?}", &out[..3]);
}

#[test]
fn silence_has_no_cepstrum() {
    for x in [vec![0.0; 64], vec![1e6; 63], vec![0.0], vec![1e-320; 64]] {
        let mut plan = CepstrumPlan::<f64>::new(x.len(), &mut FftCache::new());
        let mut out = vec![1.0; plan.n_values()];
        assert_eq!(plan.process(&spectrum(&x), Kind::Power, &mut out), None);
        assert!(out.iter().all(|c| c.abs() <= 0.0));
        let edited = liftered::<f64>(&x, Lifter::LongPass { quefrency_s: 0.01 });
        assert!(edited.iter().all(|y| y.norm() <= 0.0));
    }
    // A denormal signal in f32 is a signal.
    let x: Vec<f64> = (0..64).map(|i| if i % 3 == 0 { 1e-42 } else { 0.0 }).collect();
    assert!(cepstrum::<f32>(&x, Kind::Power).iter().all(|c| c.is_finite()));
}

#[test]
fn keeping_everything_changes_nothing() {
    for n in [1, 2, 97, 256] {
        let x = gaussian_noise(n, 4);
        let everything = Lifter::LongPass { quefrency_s: 0.0 };
        for (y, x) in liftered::<f64>(&x, everything).iter().zip(&spectrum::<f64>(&x)) {
            // ε is 1e-12 of the largest power, 1e-12·30 of some bins' amplitude.
            assert!((y - x).norm() < 1e-9 * n as f64, "{n}");
        }
        for (y, x) in liftered::<f32>(&x, everything).iter().zip(&spectrum::<f32>(&x)) {
            assert!((y - x).norm() < 1e-5 * n as f32);
        }
    }
}

#[test]
fn lifters_divide_an_echo_from_its_source() {
    // |X| = |1 + a·e^(−jωd)|: below d nothing but the level, so the short pass leaves |Y| = 1 and the
    // long pass and the comb have the rest.
    let (n, a, d) = (2000, 0.4_f64, 40);
    let mut impulse = vec![0.0; n];
    impulse[7] = 1.0;
    let x = with_echo(&impulse, a, d);
    let at = |q: usize| (q as f64) / FS_HZ;
    let short = liftered::<f64>(&x, Lifter::ShortPass { quefrency_s: at(d - 1) });
    let long = liftered::<f64>(&x, Lifter::LongPass { quefrency_s: at(d - 1) });
    let comb = Lifter::WithoutComb { period_s: at(d), half_width_s: 0.0 };
    let without = liftered::<f64>(&x, comb);
    let whole = spectrum::<f64>(&x);
    for k in 1..=n / 2 {
        let echo = (Complex::new(1.0, 0.0)
            + Complex::from_polar(a, -TAU * (k * d) as f64 / n as f64))
        .norm();
        // Bin 0 has the level of bin 1, not its own 1 + a: the same to the slope of the cosine, 1e-3,
        // shared by 2·d/n of its neighbours. No term of the series folds: a^(n/d) is nothing.
        assert!((short[k].norm() - 1.0).abs() < 2e-4, "{k}: {}", short[k].norm());
        assert!((long[k].norm() - echo).abs() < 2e-4 && (without[k].norm() - 1.0).abs() < 2e-4);
        assert!((short[k] / short[k].norm() - whole[k] / whole[k].norm()).norm() < 1e-9);
    }
}

#[test]
fn the_comb_takes_harmonics_out_of_noise() {
    // A pulse every 20 ms (50 Hz) in noise: its 50 lines stand 20 times over the noise.
    let n = 8000;
    let noise = gaussian_noise(n, 6);
    let pulses = |i: usize| if i.is_multiple_of(20) { 10.0 } else { 0.0 };
    let x: Vec<f64> = noise.iter().enumerate().map(|(i, v)| v + pulses(i)).collect();
    let before = spectrum::<f64>(&x);
    let comb = Lifter::WithoutComb { period_s: 0.02, half_width_s: 0.002 };
    let after = liftered::<f64>(&x, comb);
    let level = (n as f64).sqrt();
    let mut samples = vec![0.0; n];
    SynthesisPlan::new(n).process(&after, &mut samples);
    for line in (1..10).map(|h| h * 400) {
        assert!(before[line].norm() > 30.0 * level);
        // Lines spread over ± 2 of 20 samples' teeth: a fifth of the logarithm stays at least.
        assert!(after[line].norm() < 0.25 * before[line].norm(), "{line}");
    }
    // The noise between them keeps its power.
    let rms = stats::rms(&samples).unwrap();
    assert!((0.6..1.8).contains(&rms), "{rms}");
}

#[test]
fn prewhitened_samples_have_equal_lines() {
    for n in [64, 97] {
        let x: Vec<f64> = gaussian_noise(n, 8).iter().map(|v| v + 1e6).collect();
        let x_hat = spectrum::<f64>(&x);
        let mut white = vec![Complex::zero(); x_hat.len()];
        prewhiten(&x_hat, &mut white);
        for (white, x) in white.iter().zip(&x_hat).skip(1) {
            assert!((white.norm() - 1.0).abs() < 1e-15);
            assert!((white * x.norm() - x).norm() < 1e-12 * x.norm().max(1.0));
        }
        white[0] = Complex::zero();
        let mut samples = vec![0.0; n];
        SynthesisPlan::new(n).process(&white, &mut samples);
        // All bins but 0 have magnitude 1: mean square (n − 1)/n².
        let rms = stats::rms(&samples).unwrap();
        assert!((rms * rms * (n * n) as f64 / (n - 1) as f64 - 1.0).abs() < 1e-12);
        // Its real cepstrum is 0 but at the level.
        assert!(
            cepstrum::<f64>(&samples, Kind::Real)[1..].iter().all(|c| c.abs() < 14.0 / n as f64)
        );
    }
    let mut out = vec![Complex::new(1.0_f32, 1.0); 5];
    prewhiten(&[Complex::zero(); 5], &mut out);
    assert!(out.iter().all(|y| y.norm() <= 0.0));
}

#[test]
fn lifters_that_make_no_sense_are_none() {
    let none = |lifter| LifterPlan::<f64>::new(100, FS_HZ, lifter, &mut FftCache::new()).is_none();
    assert!(none(Lifter::ShortPass { quefrency_s: -1.0 }));
    assert!(none(Lifter::LongPass { quefrency_s: f64::NAN }));
    assert!(none(Lifter::WithoutComb { period_s: 0.0015, half_width_s: 0.0 }));
    assert!(none(Lifter::WithoutComb { period_s: f64::INFINITY, half_width_s: 0.0 }));
    // Longer than the record: nothing to remove, nothing kept but the level.
    assert!(!none(Lifter::WithoutComb { period_s: 1e6, half_width_s: 0.0 }));
    assert!(!none(Lifter::LongPass { quefrency_s: 1e9 }));
}
