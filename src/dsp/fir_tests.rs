use rustfft::num_complex::Complex;

use super::*;
use crate::dsp::line::line_at;
use crate::dsp::reference::gaussian_noise;
use crate::dsp::reference::largest_difference;
use crate::dsp::reference::narrow;
use crate::dsp::reference::sine;

const FS_HZ: f64 = 10_000.0;

fn spec() -> FirSpec {
    FirSpec { low_hz: 500.0, high_hz: 1500.0, transition_hz: 200.0, stop_db: 80.0 }
}

/// Σ h·e^(−j2πfi/fs) less the lag: real for a symmetric filter.
fn gain(h: &[f64], f_hz: f64) -> Complex<f64> {
    let half = (h.len() - 1) as f64 / 2.0;
    let at =
        |(i, h): (usize, &f64)| Complex::from_polar(*h, -TAU * f_hz / FS_HZ * (i as f64 - half));
    h.iter().enumerate().map(at).sum()
}

#[test]
fn designs_keep_what_they_promise() {
    for (low_hz, high_hz) in [(500.0, 1500.0), (0.0, 1500.0), (500.0, 5000.0), (0.0, 5000.0)] {
        for stop_db in [40.0, 60.0, 80.0, 120.0] {
            let spec = FirSpec { low_hz, high_hz, stop_db, ..spec() };
            let h = design(&spec, FS_HZ).unwrap();
            assert!(h.len() % 2 == 1);
            let ripple = 10f64.powf(-stop_db / 20.0);
            for f_hz in (0..=1000).map(|k| 5.0 * f64::from(k)) {
                let g = gain(&h, f_hz);
                assert!(g.im.abs() < 1e-13, "linear phase");
                let near = |edge_hz: f64| {
                    edge_hz > 0.0 && edge_hz < 5000.0 && (f_hz - edge_hz).abs() < 100.0
                };
                if near(low_hz) || near(high_hz) {
                    continue;
                }
                let wanted = if f_hz >= low_hz && f_hz <= high_hz { 1.0 } else { 0.0 };
                assert!((g.re - wanted).abs() < ripple, "{low_hz} {high_hz} {stop_db} {f_hz}: {g}");
            }
            if low_hz > 0.0 {
                assert!((gain(&h, low_hz).re - 0.5).abs() < 1e-2, "−6 dB at the edge");
            }
        }
    }
}

#[test]
fn the_stream_is_the_convolution() {
    let h = design(&spec(), FS_HZ).unwrap();
    let x = gaussian_noise(3000, 5);
    let exact: Vec<f64> =
        (0..x.len()).map(|i| (0..h.len().min(i + 1)).map(|m| h[m] * x[i - m]).sum()).collect();
    let mut out = vec![0.0; x.len()];
    FirFilter::new(&h).process(&x, &mut out);
    assert!(largest_difference(&out, &exact) < 1e-14, "the order of a sum");
    let mut single = vec![0.0_f32; x.len()];
    FirFilter::new(&h).process(&narrow(&x), &mut single);
    assert!(largest_difference(&single, &exact) < 5e-7, "rounding of samples up to 4");
}

#[test]
fn blocks_give_the_whole_bit_by_bit() {
    let h = design(&spec(), FS_HZ).unwrap();
    let x: Vec<f32> = narrow(&gaussian_noise(5000, 5));
    let mut whole = vec![0.0; x.len()];
    FirFilter::new(&h).process(&x, &mut whole);
    for block in [1, 13, 1000, 1024, 1025, 4999] {
        let mut filter = FirFilter::new(&h);
        let mut out = vec![0.0; x.len()];
        for (x, out) in x.chunks(block).zip(out.chunks_mut(block)) {
            filter.process(x, out);
        }
        assert!(out.iter().zip(&whole).all(|(a, b)| a.to_bits() == b.to_bits()), "{block}");
    }
    for factor in [1, 2, 5, 16] {
        let mut decimator = Decimator::new(factor);
        let mut whole = vec![0.0_f32; decimator.out_len(x.len())];
        decimator.process(&x, &mut whole);
        assert_eq!(whole.len(), x.len().div_ceil(factor));
        for block in [1, 3, 17, 1024, 3000] {
            let mut decimator = Decimator::new(factor);
            let mut out = Vec::new();
            for x in x.chunks(block) {
                let start = out.len();
                out.resize(start + decimator.out_len(x.len()), 0.0);
                decimator.process(x, &mut out[start..]);
            }
            assert_eq!(out.len(), whole.len());
            assert!(out.iter().zip(&whole).all(|(a, b)| a.to_bits() == b.to_bits()), "{block}");
        }
    }
}

#[test]
fn a_decimated_sine_keeps_amplitude_and_place() {
    for factor in [2, 3, 8, 25] {
        let n = 4000 * factor;
        let rate_hz = FS_HZ / factor as f64;
        let mut decimator = Decimator::new(factor);
        for relative in [0.01, 0.2, 0.39] {
            decimator.reset();
            let f_hz = relative * rate_hz;
            let mut out = vec![0.0; decimator.out_len(n)];
            decimator.process(&sine(n, FS_HZ, f_hz, 1.0, 0.3), &mut out);
            let start = decimator.n_starting();
            // The pass band ripples by 1e-6 at most.
            let line = line_at(&out[start..], rate_hz, f_hz).unwrap();
            assert!((line.amplitude - 1.0).abs() < 1e-6, "{factor} {relative}: {line:?}");
            // Output k is input (k − lag)·factor: its first used one, lag, is 2·lag − lag.
            let shift = TAU * relative * decimator.lag_outputs() as f64;
            let lag = (line.phase_lag_rad - 0.3 + shift).rem_euclid(TAU);
            assert!(lag.min(TAU - lag) < 1e-8, "{factor} {relative}: {lag}");
        }
    }
}

#[test]
fn what_would_fold_is_gone() {
    for factor in [2, 3, 10] {
        let rate_hz = FS_HZ / factor as f64;
        let mut decimator = Decimator::new(factor);
        for relative in [0.5, 0.6, 1.0, 1.3] {
            let f_hz = relative * rate_hz;
            if f_hz > 0.5 * FS_HZ {
                continue;
            }
            decimator.reset();
            let n = 3000 * factor;
            let mut out = vec![0.0; decimator.out_len(n)];
            decimator.process(&sine(n, FS_HZ, f_hz, 1.0, 0.3), &mut out);
            let largest = out[decimator.n_starting()..].iter().map(|y| y.abs()).fold(0.0, f64::max);
            // −120 dB.
            assert!(largest < 1e-6, "{factor} {relative}: {largest}");
        }
    }
}

#[test]
fn constants_impulses_and_short_blocks() {
    let mut decimator = Decimator::new(4);
    decimator.settle(1e6);
    let mut out = vec![0.0; decimator.out_len(1000)];
    decimator.process(&[1e6_f64; 1000], &mut out);
    // Coefficients add up to 1.
    assert!(out.iter().all(|y| (y / 1e6 - 1.0).abs() < 1e-14));
    decimator.process::<f32>(&[], &mut []);
    assert_eq!(decimator.out_len(0), 0);
    // Shorter than the filter: outputs, all of them of the start, all finite.
    let mut decimator = Decimator::new(50);
    let mut out = vec![0.0_f32; decimator.out_len(7)];
    decimator.process(&[0.0, 0.0, 1e-45, 0.0, f32::MAX, 0.0, 0.0], &mut out);
    assert!(out.len() == 1 && out[0].is_finite());
    // An impulse comes out as the coefficients.
    let h = design(&spec(), FS_HZ).unwrap();
    let mut filter = FirFilter::new(&h);
    let mut impulse = vec![0.0; h.len()];
    impulse[0] = 1.0;
    let mut out = impulse.clone();
    filter.process(&impulse, &mut out);
    assert!(largest_difference(&out, &h) <= 0.0);
    assert!((filter.lag_samples() - (h.len() as f64 - 1.0) / 2.0).abs() < 1e-12);
    // What was long ago leaves nothing behind: no recursion.
    let (mut zeros, quiet) = (vec![1.0_f64; 4000], vec![0.0; 4000]);
    filter.process(&quiet, &mut zeros);
    assert!(zeros[h.len()..].iter().all(|y| y.abs() <= 0.0));
}

#[test]
fn impossible_filters_are_none() {
    let none = |spec: FirSpec| design(&spec, FS_HZ).is_none();
    assert!(none(FirSpec { low_hz: 1500.0, ..spec() }) && none(FirSpec { low_hz: -1.0, ..spec() }));
    assert!(none(FirSpec { high_hz: 5001.0, ..spec() }));
    assert!(none(FirSpec { transition_hz: 0.0, ..spec() }));
    assert!(none(FirSpec { transition_hz: 1e-9, ..spec() }));
    assert!(none(FirSpec { stop_db: f64::NAN, ..spec() }));
}
