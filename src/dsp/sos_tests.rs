use super::*;
use crate::dsp::butterworth::Pass;
use crate::dsp::butterworth::design;
use crate::dsp::line::line_at;
use crate::dsp::reference::gaussian_noise;
use crate::dsp::reference::largest_difference;
use crate::dsp::reference::narrow;
use crate::dsp::reference::sine;

const FS_HZ: f64 = 10_000.0;

fn high_pass(edge_hz: f64, order: usize) -> Vec<Section> {
    design(Pass::High { edge_hz }, order, FS_HZ).unwrap()
}

fn band_pass() -> Vec<Section> {
    design(Pass::Band { low_hz: 100.0, high_hz: 1000.0 }, 3, FS_HZ).unwrap()
}

fn filtered<T: Real>(sections: &[Section], x: &[f64]) -> Vec<T> {
    let mut out = vec![T::zero(); x.len()];
    SosFilter::new(sections.to_vec()).process(&narrow::<T>(x), &mut out);
    out
}

fn zero_phase<T: Real>(sections: Vec<Section>, x: &[f64]) -> Vec<T> {
    let mut out = vec![T::zero(); x.len()];
    ZeroPhasePlan::new(x.len(), sections).process(&narrow::<T>(x), &mut out);
    out
}

/// The recursion of the whole cascade as one direct form: y = (Σ b·x − Σ a·y), polynomials expanded.
fn direct_form(sections: &[Section], x: &[f64]) -> Vec<f64> {
    let times = |p: &[f64], q: &[f64]| {
        let mut product = vec![0.0; p.len() + q.len() - 1];
        for (i, p) in p.iter().enumerate() {
            for (j, q) in q.iter().enumerate() {
                product[i + j] += p * q;
            }
        }
        product
    };
    let (mut b, mut a) = (vec![1.0], vec![1.0]);
    for section in sections {
        b = times(&b, &section.b);
        a = times(&a, &[1.0, section.a[0], section.a[1]]);
    }
    let mut y: Vec<f64> = Vec::with_capacity(x.len());
    for i in 0..x.len() {
        let sum = |c: &[f64], v: &[f64], from: usize| -> f64 {
            (from..c.len()).filter(|m| *m <= i).map(|m| c[m] * v[i - m]).sum()
        };
        let value = sum(&b, x, 0) - sum(&a, &y, 1);
        y.push(value);
    }
    y
}

#[test]
fn a_cascade_is_its_direct_form() {
    let x = gaussian_noise(5000, 3);
    // Low order and a high edge: the expanded polynomials are well conditioned there.
    for pass in [Pass::Low { edge_hz: 1500.0 }, Pass::Band { low_hz: 1000.0, high_hz: 3000.0 }] {
        let sections = design(pass, 3, FS_HZ).unwrap();
        let exact = direct_form(&sections, &x);
        assert!(largest_difference(&filtered::<f64>(&sections, &x), &exact) < 1e-12);
        // Rounding of input and output, 6e-8 of values up to 4.
        assert!(largest_difference(&filtered::<f32>(&sections, &x), &exact) < 1e-6);
    }
}

#[test]
fn blocks_give_the_whole_bit_by_bit() {
    let x: Vec<f32> = narrow(&gaussian_noise(3001, 1));
    let mut whole = vec![0.0; x.len()];
    SosFilter::new(band_pass()).process(&x, &mut whole);
    for block in [1, 7, 256, 3000] {
        let mut filter = SosFilter::new(band_pass());
        let mut out = vec![0.0; x.len()];
        for (x, out) in x.chunks(block).zip(out.chunks_mut(block)) {
            filter.process(x, out);
        }
        let same = out.iter().zip(&whole).all(|(a, b)| a.to_bits() == b.to_bits());
        assert!(same, "{block}");
    }
}

#[test]
fn a_sine_takes_the_gain_and_lag_of_the_response() {
    let sections = band_pass();
    for f_hz in [50.0, 100.0, 317.0, 1000.0, 2000.0] {
        let y = filtered::<f64>(&sections, &sine(20_000, FS_HZ, f_hz, 2.0, 0.3));
        // A second in, transients of 100 Hz poles are e^(−200) and less.
        let line = line_at(&y[10_000..], FS_HZ, f_hz).unwrap();
        let gain = response(&sections, f_hz, FS_HZ);
        assert!((line.amplitude - 2.0 * gain.norm()).abs() < 1e-9, "{f_hz}");
        let lag = (line.phase_lag_rad - 0.3 + gain.arg()).rem_euclid(TAU);
        assert!(lag.min(TAU - lag) < 1e-8, "{f_hz}: {lag}");
    }
}

#[test]
fn nothing_drifts() {
    // A constant of 1e6 under a sine, 2·10⁶ samples through a high pass of 1 Hz: what is left after
    // the whole run is what is left after a tenth of it, rounding only. Longer runs repeat this: the
    // state is bounded and forgets within 1/(1 − r) = 2000 samples.
    let sections = high_pass(1.0, 4);
    let mut filter = SosFilter::new(sections.clone());
    filter.settle(1e6);
    let period: Vec<f64> = sine(10_000, FS_HZ, 100.0, 1.0, 0.0).iter().map(|v| v + 1e6).collect();
    let mut out = vec![0.0; period.len()];
    let gain = response(&sections, 100.0, FS_HZ);
    let exact: Vec<f64> = sine(10_000, FS_HZ, 100.0, gain.norm(), -gain.arg());
    let mut errors = Vec::new();
    for _ in 0..200 {
        filter.process(&period, &mut out);
        errors.push(largest_difference(&out, &exact));
    }
    let early = errors[15..25].iter().copied().fold(0.0, f64::max);
    let late = errors[190..].iter().copied().fold(0.0, f64::max);
    // Rounding of 1e6 is 1e-10; the poles amplify it by (1/(1 − r))^½ and more.
    assert!(early < 1e-5 && late < 1e-5, "{early} {late}");
    assert!(late <= 2.0 * early, "{early} {late}");
}

#[test]
fn silence_ends_in_zero() {
    // An impulse, then zeros: the output dies, and dies out.
    let mut filter = SosFilter::new(high_pass(100.0, 2));
    let mut out = [0.0];
    filter.process(&[1.0], &mut out);
    let (zeros, mut out) = (vec![0.0_f64; 20_000], vec![1.0; 20_000]);
    filter.process(&zeros, &mut out);
    assert!(out.iter().all(|y| y.is_finite()) && out[19_999].abs() <= 0.0);
    // A low pass keeps a constant, and a denormal one is treated as nothing.
    let mut filter = SosFilter::new(design(Pass::Low { edge_hz: 100.0 }, 4, FS_HZ).unwrap());
    filter.settle(7.0);
    filter.process(&[7.0_f64; 5000], &mut out[..5000]);
    assert!(out[..5000].iter().all(|y| (y - 7.0).abs() < 1e-9));
    filter.reset();
    filter.process(&[1e-310_f64; 5000], &mut out[..5000]);
    assert!(out[..5000].iter().all(|y| y.abs() < 1e-300));
}

#[test]
fn zero_phase_has_no_lag_and_the_gain_twice() {
    let n = 20_000;
    for f_hz in [100.0, 317.0, 1000.0, 1500.0] {
        let gain = response(&band_pass(), f_hz, FS_HZ).norm_sqr();
        let plan = ZeroPhasePlan::new(n, band_pass());
        let y = zero_phase::<f64>(band_pass(), &sine(n, FS_HZ, f_hz, 1.0, 0.3));
        let exact = sine(n, FS_HZ, f_hz, gain, 0.3);
        // Beyond the edge 1e-3 of the transient is left; twice as far 1e-6.
        let inner = 2 * plan.n_edge()..n - 2 * plan.n_edge();
        assert!(largest_difference(&y[inner.clone()], &exact[inner]) < 1e-5, "{f_hz}");
    }
}

#[test]
fn zero_phase_is_the_same_backwards() {
    // What is filtered both ways does not know which way is first, but for the ends.
    let x = gaussian_noise(4000, 2);
    let backward: Vec<f64> = x.iter().rev().copied().collect();
    let a = zero_phase::<f64>(band_pass(), &x);
    let mut b = zero_phase::<f64>(band_pass(), &backward);
    b.reverse();
    let n_edge = 2 * ZeroPhasePlan::new(4000, band_pass()).n_edge();
    assert!(largest_difference(&a[n_edge..4000 - n_edge], &b[n_edge..4000 - n_edge]) < 1e-5);
    let single = zero_phase::<f32>(band_pass(), &x);
    assert!(largest_difference(&single, &a) < 1e-6, "rounding of samples up to 4");
}

#[test]
fn zero_phase_edges_follow_a_slow_course() {
    // A ramp on a large offset through a low pass: its point reflection goes on as the same ramp, so
    // the ends are as good as the middle.
    let low_pass = design(Pass::Low { edge_hz: 100.0 }, 2, FS_HZ).unwrap();
    let ramp: Vec<f64> = (0..3000).map(|i| 1e6 + 0.5 * f64::from(i)).collect();
    let y = zero_phase::<f64>(low_pass, &ramp);
    // 1e-3 of the transient of a settled start on the ramp's slope: half a unit a sample, 70 samples.
    assert!(largest_difference(&y, &ramp) < 0.1, "{}", largest_difference(&y, &ramp));
    assert!(largest_difference(&y[500..2500], &ramp[500..2500]) < 1e-4);
    // And a high pass takes it all away.
    let y = zero_phase::<f64>(high_pass(100.0, 2), &ramp);
    assert!(y.iter().all(|y| y.abs() < 0.1));
}

#[test]
fn hard_records() {
    for n in [1, 2, 3, 17, 101] {
        for sections in [band_pass(), high_pass(1.0, 3), Vec::new()] {
            let constant = zero_phase::<f64>(sections.clone(), &vec![1e6; n]);
            let zeros = zero_phase::<f32>(sections.clone(), &vec![0.0; n]);
            let expected = if sections.is_empty() { 1e6 } else { 0.0 };
            assert!(constant.iter().all(|y| (y - expected).abs() < 1e-4), "{n}: {constant:?}");
            assert!(zeros.iter().all(|y| y.abs() <= 0.0));
            let mut impulse = vec![0.0; n];
            impulse[n / 2] = 1.0;
            assert!(zero_phase::<f32>(sections, &impulse).iter().all(|y| y.is_finite()));
        }
    }
    // Nyquist and 0 are zeros of a band pass.
    let y: Vec<f64> = filtered(&band_pass(), &sine(4000, FS_HZ, 5000.0, 1.0, 0.0));
    assert!(y[3000..].iter().all(|y| y.abs() < 1e-12));
    assert!(response(&band_pass(), 5000.0, FS_HZ).norm() < 1e-14);
    assert!(response(&band_pass(), 0.0, FS_HZ).norm() < 1e-14);
}
