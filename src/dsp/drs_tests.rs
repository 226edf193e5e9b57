use std::f64::consts::TAU;

use super::*;
use crate::dsp::line::line_at;
use crate::dsp::reference::dft;
use crate::dsp::reference::gaussian_noise;
use crate::dsp::reference::largest_difference;
use crate::dsp::reference::narrow;
use crate::dsp::reference::sine;
use crate::dsp::reference::sum;

const FS_HZ: f64 = 10_000.0;

fn separated<T: Real>(x: &[f64], n_segment: usize, delay: usize) -> (Vec<T>, Vec<T>) {
    let mut plan = DrsPlan::<T>::new(x.len(), n_segment, delay, &mut FftCache::new()).unwrap();
    let (mut discrete, mut random) = (vec![T::zero(); x.len()], vec![T::zero(); x.len()]);
    plan.process(&narrow(x), &mut discrete, &mut random);
    (discrete, random)
}

fn power(x: &[f64]) -> f64 {
    x.iter().map(|v| v * v).sum::<f64>() / x.len() as f64
}

/// The separation as its equations say: plain transforms, plain sums.
fn slow(x: &[f64], n: usize, delay: usize) -> Vec<f64> {
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    let spectrum = |start: usize| {
        let segment = &x[start..start + n];
        let mean = segment.iter().sum::<f64>() / n as f64;
        let weight = |i: usize| 0.5 - 0.5 * (TAU * i as f64 / n as f64).cos();
        let at = |(i, v): (usize, &f64)| Complex::new((v - mean) * weight(i), 0.0);
        dft(&segment.iter().enumerate().map(at).collect::<Vec<_>>())
    };
    let mut cross = vec![Complex::zero(); n];
    let (mut early, mut late) = (vec![0.0; n], vec![0.0; n]);
    for start in (0..=x.len() - delay - n).step_by(n / 2) {
        let (d, x) = (spectrum(start), spectrum(start + delay));
        for k in 1..n {
            cross[k] += x[k] * d[k].conj();
            early[k] += d[k].norm_sqr();
            late[k] += x[k].norm_sqr();
        }
    }
    let taps = |h: &dyn Fn(usize) -> Complex<f64>, tap: i64| -> f64 {
        let turn = |k: usize| Complex::from_polar(1.0, TAU * k as f64 * tap as f64 / n as f64);
        (1..n).map(|k| (h(k) * turn(k)).re).sum::<f64>() / n as f64
    };
    let half = n as i64 / 2;
    let forward: Vec<f64> = (-half..half).map(|t| taps(&|k| cross[k] / early[k], t)).collect();
    let backward: Vec<f64> =
        (-half..half).map(|t| taps(&|k| cross[k].conj() / late[k], t)).collect();
    let predict = |taps: &[f64], centre: i64| -> Option<f64> {
        let (oldest, newest) = (centre - half + 1, centre + half);
        (oldest >= 0 && newest < x.len() as i64).then(|| {
            let at = |t: i64| usize::try_from(centre - t).unwrap();
            (-half..half).zip(taps).map(|(t, h)| h * (x[at(t)] - mean)).sum()
        })
    };
    let at = |i: usize| {
        let (i, delay) = (i as i64, delay as i64);
        match (predict(&forward, i - delay), predict(&backward, i + delay)) {
            (Some(a), Some(b)) => mean + 0.5 * (a + b),
            (Some(a), None) | (None, Some(a)) => mean + a,
            (None, None) => f64::NAN,
        }
    };
    (0..x.len()).map(at).collect()
}

#[test]
fn matches_the_definition() {
    for (n, n_segment, delay) in [(400, 32, 40), (300, 64, 32), (257, 20, 57)] {
        let x = sum(&[sine(n, FS_HZ, 700.0, 2.0, 0.1), gaussian_noise(n, 3), vec![5.0; n]]);
        let exact = slow(&x, n_segment, delay);
        let (discrete, random) = separated::<f64>(&x, n_segment, delay);
        assert!(largest_difference(&discrete, &exact) < 1e-12, "rounding of transforms of {n}");
        let both: Vec<f64> = discrete.iter().zip(&random).map(|(a, b)| a + b).collect();
        assert!(largest_difference(&both, &x) < 1e-14);
        let (single, _) = separated::<f32>(&x, n_segment, delay);
        // f32: sums of products up to 3, and the estimate of bins with little power.
        assert!(largest_difference(&single, &exact) < 1e-4);
    }
}

#[test]
fn a_line_comes_out_with_its_closed_form_gain() {
    // ρ/(1 + ρ), ρ = (A²/4)(Σw)²/(σ²Σw²) = A²·N/(6σ²) for Hann; density 2σ²/fs.
    let (n, n_segment) = (200_000, 1000);
    for amplitude in [0.05, 0.1, 0.3] {
        let f_hz = 1230.0;
        let x = sum(&[sine(n, FS_HZ, f_hz, amplitude, 0.4), gaussian_noise(n, 8)]);
        let (discrete, random) = separated::<f64>(&x, n_segment, 1500);
        let rho = amplitude * amplitude * n_segment as f64 / 6.0;
        let line = line_at(&discrete, FS_HZ, f_hz).unwrap();
        // 400 segments; the estimate of H scatters by 1/√(400·ρ), the noise adds √(2·2/n) to the line.
        let gain = rho / (1.0 + rho);
        let scatter = 1.0 / (400.0 * rho).sqrt() * gain + 0.005 / amplitude;
        let found = line.amplitude / amplitude;
        assert!((found - gain).abs() < 3.0 * scatter, "{amplitude}: {found} {gain} {scatter}");
        // The noise: as much as N/(2n) leaks away, and what of it lies in the line's three bins.
        let rest = power(&random);
        assert!((rest - 1.0).abs() < 0.02, "{amplitude}: {rest}");
    }
}

#[test]
fn noise_alone_stays_random() {
    let n = 100_000;
    let (discrete, random) = separated::<f32>(&gaussian_noise(n, 9), 512, 700);
    let discrete: Vec<f64> = discrete.iter().map(|v| f64::from(*v)).collect();
    let random: Vec<f64> = random.iter().map(|v| f64::from(*v)).collect();
    // N/(2n) = 0.26 % stated; overlapping segments are worth some less.
    let stated = 512.0 / (2.0 * n as f64);
    assert!(power(&discrete) < 2.0 * stated, "{}", power(&discrete) / stated);
    assert!(power(&discrete) > 0.5 * stated, "{}", power(&discrete) / stated);
    assert!((power(&random) - 1.0).abs() < 0.02);
}

#[test]
fn gears_and_bearing_part() {
    // Harmonics between the bins, and impacts whose distance slips by 2 %.
    let n = 100_000;
    let gears = sum(&[
        sine(n, FS_HZ, 283.17, 1.0, 0.3),
        sine(n, FS_HZ, 566.34, 0.7, 1.0),
        sine(n, FS_HZ, 2001.33, 0.5, 2.0),
    ]);
    let mut bearing = vec![0.0; n];
    let mut at = 0.0;
    for slip in gaussian_noise(1200, 5) {
        at += 100.0 * (1.0 + 0.02 * slip);
        let start = crate::dsp::real::floor_index(at);
        for (i, x) in bearing.iter_mut().skip(start).take(60).enumerate() {
            let t = i as f64 / FS_HZ;
            *x += 2.0 * (-1500.0 * t).exp() * (TAU * 3100.0 * t).sin();
        }
    }
    let x = sum(&[
        gears.clone(),
        bearing.clone(),
        gaussian_noise(n, 3).iter().map(|v| 0.1 * v).collect(),
    ]);
    let (discrete, random) = separated::<f64>(&x, 4096, 4500);
    for f_hz in [283.17, 566.34, 2001.33] {
        let left = line_at(&random, FS_HZ, f_hz).unwrap().amplitude;
        let whole = line_at(&x, FS_HZ, f_hz).unwrap().amplitude;
        // ρ of several thousand: −40 dB and less; between bins the filter's taps end, −34 dB.
        assert!(left < 0.02 * whole, "{f_hz}: {left} of {whole}");
    }
    let wrong: Vec<f64> = discrete.iter().zip(&gears).map(|(a, b)| a - b).collect();
    // What is not gear in the periodic part: leaked impacts and noise, a few per cent of their power.
    assert!(power(&wrong) < 0.06 * power(&bearing), "{}", power(&wrong) / power(&bearing));
    // Up to the very ends.
    assert!(
        power(&wrong[..500]) < 0.2 * power(&bearing)
            && power(&wrong[n - 500..]) < 0.2 * power(&bearing)
    );
}

#[test]
fn hard_records() {
    for x in [vec![0.0; 101], vec![1e6; 101], vec![1e-320; 101]] {
        let (discrete, random) = separated::<f64>(&x, 16, 20);
        assert!(
            random.iter().all(|v| v.abs() <= 1e-300) && largest_difference(&discrete, &x) < 1e-300
        );
    }
    let mut impulse = vec![0.0; 211];
    impulse[100] = 1.0;
    let (discrete, random) = separated::<f32>(&impulse, 16, 20);
    assert!(discrete.iter().chain(&random).all(|v| v.is_finite()));
    // An offset 1e6 times the signal only rounds it.
    let x = sum(&[sine(2000, FS_HZ, 700.0, 1.0, 0.1), gaussian_noise(2000, 3)]);
    let raised: Vec<f64> = x.iter().map(|v| v + 1e6).collect();
    let (clean, offset) = (separated::<f64>(&x, 64, 100).1, separated::<f64>(&raised, 64, 100).1);
    // Bins of little power are estimated from rounded samples: some 1e-10.
    assert!(largest_difference(&offset, &clean) < 1e-8);
}

#[test]
fn records_too_short_are_none() {
    let none = |n, n_segment, delay| {
        DrsPlan::<f64>::new(n, n_segment, delay, &mut FftCache::new()).is_none()
    };
    assert!(none(99, 20, 30) && !none(100, 20, 30));
    assert!(
        none(1000, 21, 30) && none(1000, 2, 30) && none(1000, 64, 31) && none(1000, 64, usize::MAX)
    );
}
