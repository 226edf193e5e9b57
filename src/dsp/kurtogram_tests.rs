use std::f64::consts::TAU;

use super::*;
use crate::dsp::fft::ForwardPlan;
use crate::dsp::length::quick_len_at_least;
use crate::dsp::reference::dft_of_real;
use crate::dsp::reference::gaussian_noise;
use crate::dsp::reference::narrow;
use crate::dsp::reference::sum;

const FS_HZ: f64 = 10_000.0;

/// Euler's constant.
const GAMMA: f64 = 0.577_215_664_901_532_9;

fn spectrum<T: Real>(x: &[f64]) -> Vec<Complex<T>> {
    let mut forward = ForwardPlan::new(x.len(), &mut FftCache::new());
    let mut x_hat = vec![Complex::zero(); forward.n_bins()];
    forward.process(&narrow::<T>(x), &mut x_hat);
    x_hat
}

fn kurtogram<T: Real>(x: &[f64], depth: u32) -> (Vec<Band>, Vec<Option<f64>>) {
    let all = 0..fft::n_bins(x.len());
    let mut plan = KurtogramPlan::<T>::new(x.len(), depth, all, &mut FftCache::new());
    let mut out = vec![None; plan.bands().len()];
    plan.process(&spectrum(x), &mut out);
    (plan.bands().to_vec(), out)
}

fn infogram<T: Real>(x: &[f64], depth: u32) -> (Vec<Band>, Vec<Option<Negentropy>>) {
    let all = 0..fft::n_bins(x.len());
    let mut plan = InfogramPlan::<T>::new(x.len(), depth, all, &mut FftCache::new());
    let mut out = vec![None; plan.bands().len()];
    plan.process(&spectrum(x), &mut out);
    (plan.bands().to_vec(), out)
}

/// The squared envelope of a band by its Fourier sum, at `n_times` times, mean 1.
fn slow_envelope(x: &[f64], band: &Band, n_times: usize) -> Vec<f64> {
    let spectrum = dft_of_real(x);
    let at = |m: usize| -> f64 {
        let turn = |k: usize| Complex::from_polar(1.0, TAU * (k * m) as f64 / n_times as f64);
        band.bins().map(|k| spectrum[k] * turn(k)).sum::<Complex<f64>>().norm_sqr()
    };
    let e2: Vec<f64> = (0..n_times).map(at).collect();
    let mean = e2.iter().sum::<f64>() / n_times as f64;
    e2.iter().map(|v| v / mean).collect()
}

/// Impulses every `period` samples that ring at `f_hz`, the k-th of height `height(k)`.
fn ringing(n: usize, period: usize, f_hz: f64, height: impl Fn(usize) -> f64) -> Vec<f64> {
    let mut x = vec![0.0; n];
    for (count, start) in (0..n).step_by(period).enumerate() {
        for (i, x) in x[start..].iter_mut().take(200).enumerate() {
            let t = i as f64 / FS_HZ;
            *x += height(count) * (-800.0 * t).exp() * (TAU * f_hz * t).sin();
        }
    }
    x
}

#[test]
fn values_are_those_of_the_continuous_envelope() {
    for n in [600, 601] {
        let x = sum(&[gaussian_noise(n, 3), ringing(n, 100, 3000.0, |_| 5.0)]);
        let (bands, wide) = kurtogram::<f64>(&x, 3);
        let (_, single) = kurtogram::<f32>(&x, 3);
        let (_, information) = infogram::<f64>(&x, 3);
        let (_, information_single) = infogram::<f32>(&x, 3);
        for (i, band) in bands.iter().enumerate() {
            // At any number of times above 2·bins the mean of |z|⁴ is the same.
            let e2 = slow_envelope(&x, band, 3 * band.n_bins() + 7);
            let exact = e2.iter().map(|v| v * v).sum::<f64>() / e2.len() as f64 - 2.0;
            // Rounding of two transforms; f32: 1e-7 of the largest of |z|⁴, some 30.
            assert!((wide[i].unwrap() - exact).abs() < 1e-11, "{band:?}");
            assert!((single[i].unwrap() - exact).abs() < 1e-4, "{band:?}");
            // The negentropy depends on the times, so at those of the plan.
            let e2 = slow_envelope(&x, band, 2 * quick_len_at_least(longest(&bands, band)));
            let time = e2.iter().map(|v| v * v.ln()).sum::<f64>() / e2.len() as f64;
            let cyclic: Vec<f64> =
                dft_of_real(&e2)[1..band.n_bins()].iter().map(|c| c.norm_sqr()).collect();
            let mean = cyclic.iter().sum::<f64>() / cyclic.len() as f64;
            let cyclic = cyclic.iter().map(|c| c / mean * (c / mean).ln()).sum::<f64>()
                / cyclic.len() as f64;
            let (found, single) = (information[i].unwrap(), information_single[i].unwrap());
            assert!((found.time - time).abs() < 1e-11 && (found.cyclic - cyclic).abs() < 1e-11);
            assert!((single.time - time).abs() < 1e-4 && (single.cyclic - cyclic).abs() < 1e-4);
        }
    }
}

/// Bins of the widest band of the width of `band`.
fn longest(bands: &[Band], band: &Band) -> usize {
    let same = bands.iter().filter(|other| other.n_of_width == band.n_of_width);
    same.map(Band::n_bins).max().unwrap()
}

#[test]
fn gaussian_noise_has_its_closed_forms() {
    let n = 1 << 16;
    let (bands, values) = kurtogram::<f32>(&gaussian_noise(n, 21), 6);
    let (_, information) = infogram::<f32>(&gaussian_noise(n, 21), 6);
    let (mut n_values, mut squares) = (0.0, 0.0);
    for ((band, value), information) in bands.iter().zip(&values).zip(&information) {
        let scatter = 2.0 / (band.n_bins() as f64).sqrt();
        let relative = value.unwrap() / scatter;
        // The tail of a kurtosis is long: 250 values, 6 sigma.
        assert!(relative.abs() < 6.0, "{band:?}: {value:?}");
        n_values += 1.0;
        squares += relative * relative;
        let found = information.unwrap();
        // x·ln x of an exponential x scatters by 1.2, and over the bins of a band's spectrum by as much.
        let scatter = 1.5 / (band.n_bins() as f64).sqrt();
        assert!((found.time - (1.0 - GAMMA)).abs() < 6.0 * scatter, "{band:?}: {found:?}");
        let expected = 0.5 - GAMMA + 2f64.ln();
        assert!((found.cyclic - expected).abs() < 6.0 * scatter, "{band:?}: {found:?}");
    }
    // Mean square of 250 values of unit variance, overlapping in the tree: ± 0.3.
    assert!((squares / n_values - 1.0_f64).abs() < 0.5, "{}", squares / n_values);
}

#[test]
fn a_sine_has_minus_one_and_the_rest_nothing() {
    // The angle reduced to one turn first: the rounding of 4000 radians is noise of 1e-13.
    let x: Vec<f64> = (0..4096).map(|i| (TAU * f64::from(i * 700 % 4096) / 4096.0).cos()).collect();
    let check = |(bands, values): (Vec<Band>, Vec<Option<f64>>)| {
        for (band, value) in bands.iter().zip(values) {
            if band.bins().contains(&700) {
                assert!((value.unwrap() + 1.0).abs() < 1e-5, "{band:?}: {value:?}");
            } else {
                assert_eq!(value, None, "{band:?}");
            }
        }
    };
    check(kurtogram::<f64>(&x, 5));
    check(kurtogram::<f32>(&x, 5));
    // Its envelope is constant: no information in it.
    let (bands, values) = infogram::<f64>(&x, 5);
    assert!(bands.iter().zip(&values).all(|(_, value)| value.is_none()));
}

#[test]
fn a_ringing_fault_is_found_in_its_band() {
    let n = 40_000;
    let faulty = sum(&[gaussian_noise(n, 1), ringing(n, 147, 3100.0, |_| 4.0)]);
    let (bands, values) = kurtogram::<f32>(&faulty, 5);
    let (band, value) = best_band(&bands, &values).unwrap();
    let (low_hz, high_hz) = band.edges_hz(n, FS_HZ);
    assert!(value > 1.0 && low_hz < 3100.0 && high_hz > 3100.0, "{value} {low_hz} {high_hz}");
    let (bands, values) = infogram::<f32>(&faulty, 5);
    let means: Vec<_> = values.iter().map(|v| v.map(|v| v.mean())).collect();
    let (band, _) = best_band(&bands, &means).unwrap();
    let (low_hz, high_hz) = band.edges_hz(n, FS_HZ);
    assert!(low_hz < 3100.0 && high_hz > 3100.0, "{low_hz} {high_hz}");
}

#[test]
fn one_knock_moves_the_kurtogram_and_not_the_cyclic_half() {
    // A fault that repeats at 3.1 kHz and a single large knock at 1.1 kHz.
    let n = 40_000;
    let fault = ringing(n, 147, 3100.0, |_| 4.0);
    let knock = ringing(n, n / 2, 1100.0, |k| if k == 1 { 60.0 } else { 0.0 });
    let x = sum(&[gaussian_noise(n, 1), fault, knock]);
    let holds = |band: Band, f_hz: f64| {
        let (low_hz, high_hz) = band.edges_hz(n, FS_HZ);
        low_hz < f_hz && f_hz < high_hz
    };
    let (bands, values) = kurtogram::<f64>(&x, 5);
    let (band, _) = best_band(&bands, &values).unwrap();
    assert!(holds(band, 1100.0) && !holds(band, 3100.0));
    let (bands, values) = infogram::<f64>(&x, 5);
    let cyclic: Vec<_> = values.iter().map(|v| v.map(|v| v.cyclic)).collect();
    let (band, _) = best_band(&bands, &cyclic).unwrap();
    assert!(holds(band, 3100.0) && !holds(band, 1100.0));
}

#[test]
fn hard_records_have_values_or_none() {
    for x in [vec![0.0; 1009], vec![1e6; 1009], vec![1e-320; 1000]] {
        assert!(kurtogram::<f64>(&x, 4).1.iter().all(Option::is_none));
        assert!(infogram::<f32>(&x, 4).1.iter().all(Option::is_none));
    }
    // Of one impulse in n samples the band has |z| = a Dirichlet kernel of its B bins:
    // ⟨|z|⁴⟩ = (2B² + 1)/(3B), by the sum of squares of a triangle.
    let mut impulse = vec![0.0; 1009];
    impulse[500] = 1.0;
    let (bands, values) = kurtogram::<f64>(&impulse, 4);
    for (band, value) in bands.iter().zip(&values) {
        let b = band.n_bins() as f64;
        let exact = (2.0 * b * b + 1.0) / (3.0 * b) - 2.0;
        assert!((value.unwrap() / exact - 1.0).abs() < 1e-10, "{band:?}");
    }
    // Any unit, from denormal samples to 24-bit counts; any offset.
    let x = sum(&[gaussian_noise(2003, 1), ringing(2003, 147, 3100.0, |_| 4.0)]);
    let (_, exact) = kurtogram::<f64>(&x, 4);
    let changed =
        |scale: f64, offset: f64| x.iter().map(|v| v * scale + offset).collect::<Vec<_>>();
    for x in [changed(1e-30, 0.0), changed(1e6, 0.0)] {
        let (_, values) = kurtogram::<f32>(&x, 4);
        assert!(values.iter().zip(&exact).all(|(a, b)| (a.unwrap() - b.unwrap()).abs() < 1e-3));
        assert!(infogram::<f32>(&x, 4).1.iter().all(Option::is_some));
    }
    let (_, values) = kurtogram::<f64>(&changed(1.0, 1e6), 4);
    assert!(values.iter().zip(&exact).all(|(a, b)| (a.unwrap() - b.unwrap()).abs() < 1e-7));
    // Shorter than a band: nothing to choose from.
    assert_eq!(best_band(&[], &[]), None);
    assert!(kurtogram::<f64>(&[1.0], 4).0.is_empty());
}
