//! Motions known beforehand.

use std::f64::consts::TAU;

use super::*;
use crate::dsp::comb;
use crate::dsp::comb::CombOrder;
use crate::dsp::reference::gaussian_noise;
use crate::dsp::reference::narrow;

const FS_HZ: f64 = 2000.0;

fn spec(low_hz: f64, high_hz: f64, n_frame: usize, max_rate_hz_s: f64) -> SpeedTrackSpec {
    let search = SpeedSearch { low_hz, high_hz, orders: comb::shaft_orders(6) };
    SpeedTrackSpec { search, fs_hz: FS_HZ, n_frame, max_rate_hz_s }
}

const SHAFT: [(f64, f64); 4] = [(1.0, 1.0), (2.0, 0.7), (3.0, 0.5), (4.0, 0.4)];

/// Orders along an angle, in noise `snr_db` below all of them together.
fn machine(n: usize, turned: impl Fn(f64) -> f64, orders: &[(f64, f64)], snr_db: f64) -> Vec<f64> {
    let power: f64 = orders.iter().map(|(_, a)| 0.5 * a * a).sum();
    let sigma = (power / 10_f64.powf(0.1 * snr_db)).sqrt();
    let noise = gaussian_noise(n, 77);
    (0..n)
        .map(|i| {
            let angle = TAU * turned(i as f64 / FS_HZ);
            let lines: f64 = orders.iter().map(|(k, a)| a * (k * angle + 0.7 * k * k).cos()).sum();
            lines + sigma * noise[i]
        })
        .collect()
}

/// RMS and largest relative error of the points.
fn errors(points: &[SpeedPoint], speed: impl Fn(f64) -> f64) -> (f64, f64) {
    let relative = |p: &SpeedPoint| p.speed_hz / speed(p.time_s) - 1.0;
    let squares: f64 = points.iter().map(|p| relative(p).powi(2)).sum();
    let worst = points.iter().map(|p| relative(p).abs()).fold(0.0, f64::max);
    ((squares / points.len() as f64).sqrt(), worst)
}

#[test]
fn clean_run_ups_are_followed_within_a_thousandth() {
    let n = 40_000;
    // 12 → 42 Hz in 20 s, and one that swings by ± 20 % in 8 s.
    let steady = (|t: f64| 12.0 * t + 0.75 * t * t, |t: f64| 12.0 + 1.5 * t);
    let w = TAU / 8.0;
    let swing = (
        move |t: f64| 25.0 * t - 5.0 / w * (w * t).cos(),
        move |t: f64| 25.0 + 5.0 * (w * t).sin(),
    );
    let mut plan =
        SpeedTrackPlan::<f32>::new(spec(10.0, 45.0, 1600, 5.0), n, &mut FftCache::new()).unwrap();
    let found = plan.process(&narrow::<f32>(&machine(n, steady.0, &SHAFT, 40.0))).unwrap();
    let (rms, worst) = errors(plan.points(), steady.1);
    // Asked: 1e-3 RMS.
    assert!(rms < 1e-3 && worst < 3e-3 && found.confidence > 0.95, "{rms} {worst} {found:?}");
    let found = plan.process(&narrow::<f32>(&machine(n, swing.0, &SHAFT, 40.0))).unwrap();
    let (rms, worst) = errors(plan.points(), swing.1);
    assert!(rms < 1e-3 && worst < 3e-3 && found.confidence > 0.95, "{rms} {worst} {found:?}");
    assert_eq!(found.n_unrefined, 0);
    // The stated edges: a quarter of a frame, half a step.
    let first = plan.points()[0].time_s;
    assert!((first - (400.0 + 100.0) / FS_HZ).abs() < 1e-12, "{first}");
    assert!(plan.points().last().unwrap().time_s > 20.0 - 0.3);
}

#[test]
fn at_zero_decibels_the_error_is_below_half_a_per_cent() {
    let n = 40_000;
    let mut plan =
        SpeedTrackPlan::<f64>::new(spec(10.0, 45.0, 2000, 3.0), n, &mut FftCache::new()).unwrap();
    let x = machine(n, |t| 12.0 * t + 0.75 * t * t, &SHAFT, 0.0);
    let found = plan.process(&x).unwrap();
    let (rms, _) = errors(plan.points(), |t| 12.0 + 1.5 * t);
    assert!(rms < 5e-3 && found.confidence > 0.95, "{rms} {found:?}");
    // The points' own standard errors are the scatter, within a factor of 1.5: blocks overlap.
    let expected: f64 = plan
        .points()
        .iter()
        .map(|p| (p.standard_error_hz.unwrap() / p.speed_hz).powi(2))
        .sum::<f64>();
    let expected = (expected / plan.points().len() as f64).sqrt();
    assert!((0.67..1.5).contains(&(rms / expected)), "{rms} {expected}");
}

#[test]
fn a_mesh_order_and_the_angle_it_gives() {
    let n = 20_000;
    let turned = |t: f64| 15.0 * t + 0.2 * t * t;
    let mut spec = spec(13.0, 21.0, 1600, 2.0);
    spec.search.orders.truncate(3);
    spec.search.orders.push(CombOrder { order: 23.0, presence: 0.7 });
    let mut plan = SpeedTrackPlan::<f64>::new(spec, n, &mut FftCache::new()).unwrap();
    let orders = [(1.0, 0.3), (2.0, 0.2), (23.0, 1.0)];
    let found = plan.process(&machine(n, turned, &orders, 20.0)).unwrap();
    let (rms, _) = errors(plan.points(), |t| 15.0 + 0.4 * t);
    assert!(rms < 5e-4 && found.confidence > 0.95, "{rms} {found:?}");
    // The angle stays with the shaft from end to end: phases do not pile up errors.
    let track = plan.phase_track().unwrap();
    let start_s = plan.points()[0].time_s;
    for i in 1..40 {
        let t = start_s + 0.2 * f64::from(i);
        let error = track.revolutions_at(t).unwrap() - (turned(t) - turned(start_s));
        assert!(error.abs() < 5e-3, "{t}: {error}");
    }
}

#[test]
fn noise_has_no_track() {
    let n = 5600;
    let mut plan =
        SpeedTrackPlan::<f32>::new(spec(10.0, 45.0, 1600, 5.0), n, &mut FftCache::new()).unwrap();
    let (mut above_half, mut above_95) = (0, 0);
    for seed in 0..30 {
        let x = narrow::<f32>(&gaussian_noise(n, 400 + seed));
        let confidence = plan.process(&x).unwrap().confidence;
        above_half += u32::from(confidence > 0.5);
        above_95 += u32::from(confidence > 0.95);
    }
    // Mean likelihood ratio 1 under noise: at most 1 in 20 above 0.95; far less in fact.
    assert!(above_95 <= 1 && above_half <= 3, "{above_half} {above_95}");
}

#[test]
fn offsets_silence_and_no_numbers() {
    let n = 12_000;
    let mut plan =
        SpeedTrackPlan::<f64>::new(spec(10.0, 45.0, 1601, 5.0), n, &mut FftCache::new()).unwrap();
    let x = machine(n, |t| 25.0 * t, &SHAFT, 20.0);
    plan.process(&x).unwrap();
    let plain = plan.points().to_vec();
    let offset: Vec<f64> = x.iter().map(|v| v + 1e6).collect();
    plan.process(&offset).unwrap();
    for (a, b) in plain.iter().zip(plan.points()) {
        // Rounding of 1e6: 1e-10 of the signal.
        assert!((a.speed_hz - b.speed_hz).abs() < 1e-7);
    }
    assert_eq!(plan.process(&vec![2.0; n]), None);
    assert!(plan.points().is_empty() && plan.phase_track().is_none());
    let mut bad = x.clone();
    bad[5000] = f64::INFINITY;
    assert_eq!(plan.process(&bad), None);
    let mut gone = x;
    gone[4000..8000].fill(0.0);
    assert_eq!(plan.process(&gone), None, "a dropout is no background");
}

#[test]
fn impossible_tracks_are_not_planned() {
    let mut cache = FftCache::<f32>::new();
    for (spec, n) in [
        (spec(10.0, 45.0, 1599, 5.0), 8000),
        (spec(10.0, 45.0, 1600, 5.0), 2399),
        (spec(10.0, 45.0, 1600, -1.0), 8000),
        (spec(10.0, 45.0, 1600, f64::NAN), 8000),
        (spec(45.0, 10.0, 1600, 5.0), 8000),
        (spec(10.0, 45.0, 0, 5.0), 8000),
        (SpeedTrackSpec { fs_hz: f64::NAN, ..spec(10.0, 45.0, 1600, 5.0) }, 8000),
    ] {
        assert!(SpeedTrackPlan::new(spec, n, &mut cache).is_none());
    }
    assert!(SpeedTrackPlan::new(spec(10.0, 45.0, 1600, 5.0), 2400, &mut cache).is_some());
}

#[test]
fn the_angle_of_1e9_samples_does_not_drift() {
    // Points every 2500 samples of 10⁹ at 10 kHz, at a speed that is no binary fraction. The sum of as
    // many intervals against the product.
    let spec = spec(10.0, 45.0, 1600, 5.0);
    let mut plan = SpeedTrackPlan::<f32>::new(spec, 40_000, &mut FftCache::new()).unwrap();
    let point = |i: u32| SpeedPoint {
        time_s: 0.25 * f64::from(i),
        speed_hz: 29.7,
        standard_error_hz: None,
    };
    plan.points = (0..=400_000).map(point).collect();
    let track = plan.phase_track().unwrap();
    let errors = (0..=400).map(|i| {
        let time_s = 250.0 * f64::from(i);
        (track.revolutions_at(time_s).unwrap() - 29.7 * time_s).abs()
    });
    let worst = errors.fold(0.0, f64::max);
    // Each addition may round by half a last digit of 3·10⁶ revolutions, 2.3e-10, all of one sign at
    // worst where the same step meets the same digits: 4·10⁵ of them.
    assert!(worst < 1e-4, "{worst}");
}
