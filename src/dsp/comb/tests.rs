//! Speeds known beforehand, and none.

use std::f64::consts::TAU;

use super::*;
use crate::dsp::reference::gaussian_noise;
use crate::dsp::reference::narrow;
use crate::dsp::reference::sine;
use crate::dsp::reference::sum;
use crate::dsp::stats;

const FS_HZ: f64 = 2000.0;
const N: usize = 20_000;

fn search(low_hz: f64, high_hz: f64) -> SpeedSearch {
    SpeedSearch { low_hz, high_hz, orders: shaft_orders(8) }
}

fn plan<T: Real>(search: SpeedSearch, n: usize) -> CombSpeedPlan<T> {
    CombSpeedPlan::new(search, n, FS_HZ, &mut FftCache::new()).unwrap()
}

/// Orders with amplitudes, phases by `seed`, and noise `snr_db` below all of them together.
fn machine(n: usize, speed_hz: f64, orders: &[(f64, f64)], snr_db: f64, seed: u64) -> Vec<f64> {
    let power: f64 = orders.iter().map(|(_, a)| 0.5 * a * a).sum();
    let sigma = (power / 10_f64.powf(0.1 * snr_db)).sqrt();
    let noise: Vec<f64> = gaussian_noise(n, seed).iter().map(|v| sigma * v).collect();
    let line = |(k, a): &(f64, f64)| sine(n, FS_HZ, k * speed_hz, *a, seed as f64 * 1.3 * k);
    let lines: Vec<Vec<f64>> = orders.iter().map(line).collect();
    sum(&[sum(&lines), noise])
}

const SHAFT: [(f64, f64); 4] = [(1.0, 1.0), (2.0, 0.6), (3.0, 0.4), (4.0, 0.3)];

#[test]
fn constant_speed_is_read_within_a_fiftieth_of_a_per_cent() {
    let mut plan = plan::<f32>(search(10.0, 60.0), N);
    for (seed, speed_hz) in [(1, 24.37), (2, 10.02), (3, 59.3), (4, 33.333), (5, 17.0)] {
        for snr_db in [40.0, 10.0, 0.0] {
            let x = machine(N, speed_hz, &SHAFT, snr_db, seed);
            let found = plan.process(&narrow::<f32>(&x)).unwrap();
            let error = (found.speed_hz / speed_hz - 1.0).abs();
            // Asked: 2e-4 at 10 dB. The estimate's own standard error, five times.
            assert!(error < 2e-4, "{speed_hz} {snr_db}: {found:?}");
            let five = 5.0 * found.standard_error_hz.unwrap() + 1e-6;
            assert!((found.speed_hz - speed_hz).abs() < five, "{speed_hz} {snr_db}: {found:?}");
            assert!(found.confidence > 0.95, "{speed_hz} {snr_db}: {found:?}");
            assert!(found.n_orders >= 3, "{found:?}");
        }
    }
}

#[test]
fn mesh_orders_sharpen_the_speed() {
    let orders = [(1.0, 0.2), (2.0, 0.1), (23.0, 1.0), (46.0, 0.4)];
    let mut comb = search(14.0, 16.0);
    comb.orders.truncate(3);
    for order in [23.0, 46.0] {
        comb.orders.push(CombOrder { order, presence: 0.7 });
    }
    let mut plan = plan::<f64>(comb, N);
    let found = plan.process(&machine(N, 15.1234, &orders, 10.0, 3)).unwrap();
    assert!(found.confidence > 0.95 && found.n_orders == 4, "{found:?}");
    // A line at order 23 is known 23 times as well.
    assert!((found.speed_hz - 15.1234).abs() < 5.0 * found.standard_error_hz.unwrap());
    assert!(found.standard_error_hz.unwrap() < 1e-5 * 15.0, "{found:?}");
}

#[test]
fn the_standard_error_is_the_scatter() {
    let mut plan = plan::<f64>(search(23.0, 26.0), 4000);
    let errors: Vec<f64> = (0..100)
        .map(|seed| {
            let found = plan.process(&machine(4000, 24.4, &SHAFT, 0.0, 50 + seed)).unwrap();
            (found.speed_hz - 24.4) / found.standard_error_hz.unwrap()
        })
        .collect();
    let mean_square = errors.iter().map(|e| e * e).sum::<f64>() / 100.0;
    // 100 squares scatter by 14 %; the power over the background is itself read in noise.
    assert!((0.6..1.6).contains(&mean_square), "{mean_square} {errors:?}");
}

#[test]
fn noise_has_no_speed() {
    let n = 4096;
    let mut plan = plan::<f32>(search(10.0, 60.0), n);
    let (mut above_half, mut above_95) = (0, 0);
    for seed in 0..300 {
        let x = narrow::<f32>(&gaussian_noise(n, 7000 + seed));
        let confidence = plan.process(&x).unwrap().confidence;
        above_half += u32::from(confidence > 0.5);
        above_95 += u32::from(confidence > 0.95);
    }
    // The mean likelihood ratio under noise is 1, so confidence c has at most (1 − c)/c of cases
    // (Markov): 16 of 300 above 0.95; far less in fact.
    assert!(above_95 <= 3 && above_half <= 15, "{above_half} {above_95}");
}

#[test]
fn confidence_is_no_more_than_the_share_of_right_speeds() {
    // 4 s at 12 to 28 dB below the noise: from hardly lost to hardly there.
    let n = 8192;
    let mut plan = plan::<f32>(search(10.0, 60.0), n);
    let (mut sure, mut wrong, mut confidence, mut right) = (0, 0, 0.0, 0.0);
    for seed in 0..100_u64 {
        let speed_hz = 11.0 + 0.48 * seed as f64;
        let x = machine(n, speed_hz, &SHAFT, -12.0 - 0.16 * seed as f64, 4000 + seed);
        let found = plan.process(&narrow::<f32>(&x)).unwrap();
        // Within one bin, as the confidence says of itself.
        let is_right = (found.speed_hz - speed_hz).abs() < FS_HZ / n as f64;
        confidence += 0.01 * found.confidence;
        right += if is_right { 0.01 } else { 0.0 };
        sure += u32::from(found.confidence > 0.95);
        wrong += u32::from(found.confidence > 0.95 && !is_right);
    }
    // A share of 100 scatters by 0.05. Not all are lost, and not all are found.
    assert!(confidence < right + 0.1, "{confidence} {right}");
    assert!(sure > 10 && wrong <= 2 && right < 0.95, "{sure} {wrong} {right}");
}

#[test]
fn foreign_lines_and_coloured_noise_are_no_comb() {
    let n = 8192;
    let mut plan = plan::<f32>(search(10.0, 60.0), n);
    let mut above_95 = 0;
    for seed in 0..100_u64 {
        let mut level = 0.0;
        let coloured: Vec<f64> = gaussian_noise(n, 300 + seed)
            .iter()
            .map(|v| {
                level += 0.2 * (v - level);
                level
            })
            .collect();
        // Six strong lines anywhere in 10…480 Hz.
        let places = gaussian_noise(6, 9000 + seed);
        let line = |z: &f64| sine(n, FS_HZ, 10.0 + 470.0 * (17.3 * z).rem_euclid(1.0), 1.0, *z);
        let x = sum(&[sum(&places.iter().map(line).collect::<Vec<_>>()), coloured]);
        above_95 += u32::from(plan.process(&narrow::<f32>(&x)).unwrap().confidence > 0.95);
    }
    assert!(above_95 <= 3, "{above_95}");
}

#[test]
fn one_line_alone_is_not_believed_and_half_the_speed_is_not_taken() {
    let mut plan = plan::<f64>(search(10.0, 60.0), N);
    let one = plan.process(&machine(N, 25.0, &[(1.0, 1.0)], 20.0, 4)).unwrap();
    assert!(one.confidence < 0.5, "{one:?}: which order is it?");
    // Half and double the speed share orders; the true one explains all with the lowest.
    let found = plan.process(&machine(N, 25.0, &SHAFT, 20.0, 4)).unwrap();
    assert!((found.speed_hz - 25.0).abs() < 1e-3 && found.confidence > 0.95, "{found:?}");
    // Outside of the range nothing is found with confidence that is not there.
    let mut elsewhere = self::plan::<f64>(search(26.0, 36.0), N);
    let other = elsewhere.process(&machine(N, 19.0, &SHAFT, 20.0, 4)).unwrap();
    assert!(other.confidence < 0.5, "{other:?}");
}

#[test]
fn offsets_prime_lengths_and_clipping_do_not_matter() {
    let speed_hz = 24.37;
    for n in [19_997, 20_000] {
        let mut plan = plan::<f64>(search(10.0, 60.0), n);
        let x = machine(n, speed_hz, &SHAFT, 10.0, 6);
        let plain = plan.process(&x).unwrap();
        let offset: Vec<f64> = x.iter().map(|v| v + 1e6).collect();
        let with_offset = plan.process(&offset).unwrap();
        // Rounding of 1e6 is 1e-10 of the signal.
        assert!((plain.speed_hz - with_offset.speed_hz).abs() < 1e-8);
        let clipped: Vec<f64> = x.iter().map(|v| v.clamp(-0.8, 0.8)).collect();
        let cut = plan.process(&clipped).unwrap();
        // Clipping makes harmonics of the same comb.
        assert!((cut.speed_hz / speed_hz - 1.0).abs() < 2e-4 && cut.confidence > 0.95, "{cut:?}");
    }
}

#[test]
fn silence_constants_and_no_numbers_give_nothing() {
    let mut plan = plan::<f32>(search(10.0, 60.0), 4000);
    for level in [0.0, 3.5, 1e20] {
        assert_eq!(plan.process(&vec![level; 4000]), None);
    }
    let mut x = narrow::<f32>(&gaussian_noise(4000, 1));
    x[77] = f32::NAN;
    assert_eq!(plan.process(&x), None);
    // A line without any noise: the window's own side lobes are the background.
    let clean: Vec<f32> = (0..4000)
        .map(|i| i as f32 / 2000.0)
        .map(|t| {
            [1.0, 2.0, 3.0]
                .iter()
                .map(|k| f32::rounded((TAU * k * 31.3 * f64::from(t)).cos()))
                .sum()
        })
        .collect();
    let found = plan.process(&clean).unwrap();
    assert!((found.speed_hz / 31.3 - 1.0).abs() < 2e-4, "{found:?}");
    let all_zero_but_one: Vec<f32> = (0..4000).map(|i| if i == 2000 { 1.0 } else { 0.0 }).collect();
    let found = plan.process(&all_zero_but_one).unwrap();
    assert!(found.confidence < 0.5, "{found:?}");
    assert!(stats::mean(&all_zero_but_one).is_some());
}

#[test]
fn impossible_searches_are_not_planned() {
    let mut cache = FftCache::<f32>::new();
    let orders = |list: &[(f64, f64)]| SpeedSearch {
        orders: list
            .iter()
            .map(|(order, presence)| CombOrder { order: *order, presence: *presence })
            .collect(),
        ..search(10.0, 60.0)
    };
    for (search, n) in [
        (search(0.0, 60.0), N),
        (search(60.0, 10.0), N),
        (search(10.0, 1000.0), N),
        (search(f64::NAN, 60.0), N),
        (search(10.0, 60.0), 799),
        (search(10.0, 60.0), 0),
        (orders(&[]), N),
        (orders(&[(1.0, 1.0)]), N),
        (orders(&[(1.0, 0.0)]), N),
        (orders(&[(2.0, 0.5), (1.0, 0.5)]), N),
        (orders(&[(-1.0, 0.5)]), N),
        (orders(&[(1.0, 0.5), (1e9, 0.5)]), N),
    ] {
        assert!(CombSpeedPlan::new(search, n, FS_HZ, &mut cache).is_none());
    }
    assert!(CombSpeedPlan::new(search(10.0, 60.0), 800, FS_HZ, &mut cache).is_some());
}
