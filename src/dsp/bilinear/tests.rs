use std::f64::consts::PI;
use std::f64::consts::TAU;

use super::kernel::gaussian_of_lag;
use super::*;
use crate::dsp::fft::ForwardPlan;
use crate::dsp::fft::n_bins;
use crate::dsp::reference::dft;
use crate::dsp::reference::dft_of_real;
use crate::dsp::reference::gaussian_noise;
use crate::dsp::reference::narrow;
use crate::dsp::reference::sine;
use crate::dsp::reference::sum;

const FS_HZ: f64 = 1000.0;

fn distribution<T: Real>(x: &[f64], spec: JointSpec) -> (Vec<f64>, JointPlan<T>) {
    let mut cache = FftCache::new();
    let mut forward = ForwardPlan::new(x.len(), &mut cache);
    let mut x_hat = vec![Complex::zero(); forward.n_bins()];
    forward.process(&narrow::<T>(x), &mut x_hat);
    let mut plan = JointPlan::new(x.len(), FS_HZ, spec, &mut cache).unwrap();
    let mut out = vec![T::zero(); plan.out_len()];
    plan.process(&x_hat, &mut out);
    (out.iter().map(|v| v.to_f64()).collect(), plan)
}

/// z by its definition: positive frequencies doubled.
fn analytic(x: &[f64]) -> Vec<Complex<f64>> {
    let n = x.len();
    let mut spectrum = dft_of_real(x);
    for (k, value) in spectrum.iter_mut().enumerate() {
        *value *= if k > 0 && 2 * k < n { 2.0 } else { 0.0 };
    }
    // The inverse: conjugates in and out.
    let conjugates: Vec<_> = spectrum.iter().map(|v| v.conj() / n as f64).collect();
    dft(&conjugates).iter().map(|v| v.conj()).collect()
}

fn every_sample(n: usize, spec: JointSpec) -> JointSpec {
    JointSpec { n_times: n, ..spec }
}

/// (2/fs) Σ_m h[m] Σ_u w_m(u − t) z[u + m] z*[u − m] e^(−j2πkm/N_f), all sums written out.
fn by_definition(z: &[Complex<f64>], spec: &JointSpec, t: usize, k: usize) -> Complex<f64> {
    let n = z.len().cast_signed();
    let at = |i: isize| {
        if (0..n).contains(&i) { z[i.cast_unsigned()] } else { Complex::new(0.0, 0.0) }
    };
    let weight = |m: isize, s: isize| match spec.kernel {
        Kernel::Delta => f64::from(u8::from(s == 0)),
        Kernel::Hann(half) => {
            let width = (half + 1) as f64;
            let hann =
                |s: f64| if s.abs() < width { 0.5 + 0.5 * (PI * s / width).cos() } else { 0.0 };
            hann(s as f64) / width
        }
        Kernel::ChoiWilliams(sigma) if m != 0 => {
            let (deviation, sum) = gaussian_of_lag(sigma, m.unsigned_abs());
            (-0.5 * (s as f64 / deviation).powi(2)).exp() / sum
        }
        Kernel::ChoiWilliams(_) => f64::from(u8::from(s == 0)),
    };
    let most = spec.n_lags.cast_signed();
    let mut total = Complex::new(0.0, 0.0);
    for m in -most..=most {
        let lag = if spec.is_lag_windowed {
            (0.5 * PI * m as f64 / (most + 1) as f64).cos().powi(2)
        } else {
            1.0
        };
        let mut of_lag = Complex::new(0.0, 0.0);
        for u in 0..n {
            of_lag += at(u + m) * at(u - m).conj() * weight(m, u - t.cast_signed());
        }
        let angle = -TAU * k as f64 * m as f64 / spec.n_frequencies as f64;
        total += of_lag * lag * Complex::from_polar(1.0, angle);
    }
    total * (2.0 / FS_HZ)
}

fn specs(n: usize) -> Vec<JointSpec> {
    let whole = JointSpec::wigner_ville(n, 7);
    let pseudo = JointSpec { n_lags: 9, is_lag_windowed: true, n_frequencies: 24, ..whole };
    let with = |kernel| JointSpec { kernel, ..pseudo };
    vec![
        whole,
        pseudo,
        with(Kernel::Hann(0)),
        with(Kernel::Hann(6)),
        with(Kernel::Hann(n - 1)),
        with(Kernel::ChoiWilliams(1.0)),
        JointSpec { kernel: Kernel::ChoiWilliams(0.05), ..whole },
        JointSpec { kernel: Kernel::ChoiWilliams(500.0), ..whole },
    ]
}

#[test]
fn the_plan_is_the_definition() {
    for n in [40, 41] {
        let x = gaussian_noise(n, 2);
        let z = analytic(&x);
        for spec in specs(n) {
            let (wide, plan) = distribution::<f64>(&x, spec);
            let (single, _) = distribution::<f32>(&x, spec);
            let largest = wide.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
            for (j, t) in plan.instants().iter().enumerate() {
                for k in 0..spec.n_frequencies {
                    let right = by_definition(&z, &spec, *t, k);
                    let place = j * spec.n_frequencies + k;
                    assert!((wide[place] - right.re).abs() < 1e-13 * largest, "{spec:?} {t} {k}");
                    assert!(right.im.abs() < 1e-13 * largest, "real");
                    assert!((single[place] - right.re).abs() < 2e-6 * largest, "{spec:?} {t} {k}");
                }
            }
        }
    }
}

/// A pulse that is nothing at the ends: what is lost there does not count.
fn pulse(n: usize, f_hz: f64) -> Vec<f64> {
    let middle = 0.5 * n as f64;
    let x = sine(n, FS_HZ, f_hz, 1.0, 0.3);
    let bell = |i: usize| (-((i as f64 - middle) / (0.06 * n as f64)).powi(2)).exp();
    x.iter().enumerate().map(|(i, v)| v * bell(i)).collect()
}

#[test]
fn the_sum_over_frequency_is_the_instantaneous_power() {
    for (n, x) in [(64, gaussian_noise(64, 8)), (101, pulse(101, 130.0))] {
        let z = analytic(&x);
        let whole = JointSpec::wigner_ville(n, n);
        for kernel in [Kernel::Delta, Kernel::ChoiWilliams(1.0), Kernel::ChoiWilliams(0.01)] {
            for spec in [
                JointSpec { kernel, ..whole },
                JointSpec { kernel, is_lag_windowed: true, n_lags: 12, ..whole },
            ] {
                let (w, plan) = distribution::<f64>(&x, spec);
                for (t, row) in plan.instants().iter().zip(w.chunks(spec.n_frequencies)) {
                    let marginal = row.iter().sum::<f64>() * plan.bin_width_hz();
                    // Exact, kernel or not: at lag 0 nothing is smoothed.
                    assert!((marginal - z[*t].norm_sqr()).abs() < 1e-12, "{kernel:?} {t}");
                }
            }
        }
    }
}

#[test]
fn the_sum_over_time_is_the_energy_spectrum() {
    let n = 128;
    let noise = gaussian_noise(n, 8);
    let spectrum = |x: &[f64]| {
        let z = analytic(x);
        // At k·fs/(2N_f), and half the rate above it: the other half of a sum over every second product.
        move |k: usize, n_frequencies: usize| {
            [0.0, 0.5].map(|shift| {
                let turn = 0.5 * k as f64 / n_frequencies as f64 + shift;
                let term = |(i, z): (usize, &Complex<f64>)| {
                    z * Complex::from_polar(1.0, -TAU * turn * i as f64)
                };
                z.iter().enumerate().map(term).sum::<Complex<f64>>().norm_sqr() / (FS_HZ * FS_HZ)
            })
        }
    };
    let marginal = |x: &[f64], spec: JointSpec, k: usize| {
        let (w, _) = distribution::<f64>(x, spec);
        w.chunks(spec.n_frequencies).map(|row| row[k]).sum::<f64>() / FS_HZ
    };
    let whole = JointSpec { n_frequencies: 2 * n, ..JointSpec::wigner_ville(n, n) };
    let right = spectrum(&noise);
    for k in 0..2 * n {
        let [wanted, folded] = right(k, 2 * n);
        assert!((marginal(&noise, whole, k) - wanted - folded).abs() < 1e-13, "{k}");
        // On the record's own bins there is nothing to fold: the factor of 2 is right.
        assert!(k % 4 != 0 || folded < 1e-20, "{k}: {folded:e}");
    }
    // Choi and Williams': weights that leave the record are lost, so for what is far from its ends.
    let x = pulse(n, 130.0);
    let right = spectrum(&x);
    let spec = JointSpec { kernel: Kernel::ChoiWilliams(20.0), ..whole };
    for k in (0..2 * n).step_by(3) {
        let [wanted, folded] = right(k, 2 * n);
        let found = marginal(&x, spec, k);
        assert!((found - wanted - folded).abs() < 2e-3 * right(67, 2 * n)[0], "{k} {found}");
    }
}

/// Frequency of the largest value of each row.
fn ridge(w: &[f64], plan: &JointPlan<f64>, n_frequencies: usize) -> Vec<f64> {
    let top = |row: &[f64]| (0..row.len()).max_by(|a, b| row[*a].total_cmp(&row[*b])).unwrap();
    w.chunks(n_frequencies).map(|row| top(row) as f64 * plan.bin_width_hz()).collect()
}

#[test]
fn a_linear_chirp_lies_on_its_line() {
    let n = 512;
    let (from_hz, rate_hz_s) = (60.0, 600.0);
    let phase = |t: f64| TAU * (from_hz * t + 0.5 * rate_hz_s * t * t);
    let x: Vec<f64> = (0..n).map(|i| phase(i as f64 / FS_HZ).cos()).collect();
    let whole = JointSpec::wigner_ville(n, 64);
    let pseudo = JointSpec { n_lags: 100, is_lag_windowed: true, ..whole };
    let smoothed = JointSpec { kernel: Kernel::Hann(8), ..pseudo };
    let choi = JointSpec { kernel: Kernel::ChoiWilliams(10.0), ..pseudo };
    for spec in [whole, pseudo, smoothed, choi] {
        let (w, plan) = distribution::<f64>(&x, spec);
        let ridge = ridge(&w, &plan, spec.n_frequencies);
        for (t, found) in plan.instants().iter().zip(ridge) {
            // Away from the ends, where the periodic analytic signal joins 60 to 367 Hz.
            if (100..n - 100).contains(t) {
                let right = from_hz + rate_hz_s * *t as f64 / FS_HZ;
                // One bin of 0.98 Hz.
                assert!((found - right).abs() < 1.0, "{spec:?} {t}: {found} {right}");
            }
        }
    }
}

#[test]
fn cross_terms_are_twice_the_product_and_fall_as_each_kernel_says() {
    let n = 1000;
    let (f1, f2) = (150.0, 200.0);
    let x = sum(&[sine(n, FS_HZ, f1, 1.0, 0.0), sine(n, FS_HZ, f2, 0.5, 0.0)]);
    // Bins of 2.5 Hz: both tones and 175 Hz between them lie on bins.
    let pseudo = JointSpec {
        kernel: Kernel::Delta,
        n_lags: 60,
        is_lag_windowed: true,
        n_frequencies: 200,
        n_times: n,
    };
    // Lines of amplitude A read A²·this.
    let h = |m: usize| (0.5 * PI * m as f64 / 61.0).cos().powi(2);
    let line = 2.0 / FS_HZ * (1.0 + 2.0 * (1..=60).map(h).sum::<f64>());
    let at = |kernel, f_hz: f64| {
        let spec = JointSpec { kernel, ..pseudo };
        let (w, plan) = distribution::<f64>(&x, spec);
        let k = crate::dsp::real::floor_index((f_hz / plan.bin_width_hz()).round());
        // 440…460: a whole beat of 50 Hz, far from the ends.
        let values: Vec<f64> = w.chunks(200).skip(440).take(20).map(|row| row[k]).collect();
        let mean = values.iter().sum::<f64>() / 20.0;
        let swing = values.iter().map(|v| (v - mean).abs()).fold(0.0, f64::max);
        (mean / line, swing / line)
    };
    let (tone, _) = at(Kernel::Delta, f1);
    let (mean, cross) = at(Kernel::Delta, 175.0);
    // Side lobes of Hann's lag window 25 Hz off: 3e-3 of a line.
    assert!((tone - 1.0).abs() < 5e-3, "{tone}");
    assert!(mean.abs() < 5e-3 && (cross - 1.0).abs() < 1e-3, "2·A₁·A₂ = 1: {mean} {cross}");
    // Smoothing over 21 samples: Hann's transform at 50 Hz, f·(half + 1)/fs = 1 turn a half: ½ of its zero.
    for half in [9_usize, 19] {
        let width = (half + 1) as f64;
        let transform: f64 = (1..2 * (half + 1))
            .map(|i| {
                let s = i as f64 - width;
                (0.5 + 0.5 * (PI * s / width).cos()) / width * (TAU * 50.0 * s / FS_HZ).cos()
            })
            .sum();
        let (_, found) = at(Kernel::Hann(half), 175.0);
        assert!((found - transform.abs()).abs() < 1e-3, "{half}: {found} {transform}");
    }
    let mut before = 1.0;
    for sigma in [100.0, 1.0, 0.1] {
        // e^(−(2π·50·τ)²/σ), τ = 2m/fs, over the lags.
        let damp = |m: usize| h(m) * (-(TAU * 50.0 * 2.0 * m as f64 / FS_HZ).powi(2) / sigma).exp();
        let right = 2.0 / FS_HZ * (1.0 + 2.0 * (1..=60).map(damp).sum::<f64>()) / line;
        let (_, found) = at(Kernel::ChoiWilliams(sigma), 175.0);
        assert!((found - right).abs() < 2e-3, "{sigma}: {found} {right}");
        assert!(found < 0.8 * before, "a smaller σ keeps less");
        before = found;
        // Tones stay: the kernel is 1 where a product does not beat.
        if sigma >= 1.0 {
            assert!((at(Kernel::ChoiWilliams(sigma), f1).0 - 1.0).abs() < 1e-2);
        }
    }
}

#[test]
fn without_weights_choi_and_williams_is_wigner_and_ville() {
    let x = gaussian_noise(60, 3);
    let whole = JointSpec::wigner_ville(60, 60);
    let (ville, _) = distribution::<f64>(&x, whole);
    let spec = JointSpec { kernel: Kernel::ChoiWilliams(1e9), ..whole };
    let (choi, _) = distribution::<f64>(&x, spec);
    assert!(ville.iter().zip(&choi).all(|(a, b)| (a - b).abs() < 1e-12));
}

#[test]
fn what_is_too_large_or_makes_no_sense_is_not_planned() {
    let whole = JointSpec::wigner_ville(100, 10);
    let planned = |n, spec| JointPlan::<f64>::new(n, FS_HZ, spec, &mut FftCache::new()).is_some();
    assert!(planned(100, whole));
    for spec in [
        JointSpec { n_lags: 50, ..whole },
        JointSpec { n_lags: 0, ..whole },
        JointSpec { n_frequencies: 98, ..whole },
        JointSpec { n_times: 0, ..whole },
        JointSpec { n_times: 101, ..whole },
        JointSpec { n_frequencies: MAX_CELLS, ..whole },
        JointSpec { kernel: Kernel::Hann(100), ..whole },
        JointSpec { kernel: Kernel::ChoiWilliams(0.0), ..whole },
        JointSpec { kernel: Kernel::ChoiWilliams(f64::NAN), ..whole },
    ] {
        assert!(!planned(100, spec), "{spec:?}");
    }
    assert!(!planned(3, JointSpec { n_lags: 1, n_frequencies: 4, n_times: 1, ..whole }));
    assert!(!planned(MAX_SAMPLES + 1, whole));
    let n = 4096;
    assert!(planned(n, JointSpec::wigner_ville(n, 1000)));
    assert!(!planned(n, every_sample(n, JointSpec::wigner_ville(n, 1))), "17 million values");
    assert_eq!(n_bins(n), 2049);
}
