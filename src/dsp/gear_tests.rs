use std::f64::consts::TAU;

use super::*;
use crate::dsp::reference::gaussian_noise;
use crate::dsp::reference::sine;
use crate::dsp::reference::sum;

const N: usize = 1024;
const TEETH: usize = 28;

fn plan() -> GearPlan {
    GearPlan::new(N, TEETH, 200, &mut FftCache::new()).unwrap()
}

fn order(k: f64, amplitude: f64) -> Vec<f64> {
    sine(N, N as f64, k, amplitude, 0.3)
}

#[test]
fn each_set_goes_where_the_definition_says() {
    let mut plan = plan();
    assert_eq!(plan.n_harmonics(), 7, "7·28 + 1 = 197 ≤ 200");
    let (shaft, mesh) = (order(1.0, 3.0), order(56.0, 2.0));
    let (side, other) = (order(29.0, 0.5), order(10.0, 0.25));
    let y = sum(&[shaft.clone(), mesh.clone(), side.clone(), other.clone(), vec![9.0; N]]);
    let figures = plan.process(&y);
    for i in 0..N {
        // Rounding of an FFT of values of 10.
        assert!((plan.difference()[i] - other[i]).abs() < 1e-13);
        assert!((plan.residual()[i] - other[i] - side[i]).abs() < 1e-13);
        assert!((plan.regular()[i] - shaft[i] - mesh[i] - side[i]).abs() < 1e-13);
    }
    // A sine alone in d: kurtosis 1.5, 6th 2.5, 8th 4.375 (E cos^2m · 2^m).
    assert!((figures.fm4.unwrap() - 1.5).abs() < 1e-10);
    assert!((figures.m6a.unwrap() - 2.5).abs() < 1e-10);
    assert!((figures.m8a.unwrap() - 4.375).abs() < 1e-10);
    let regular = ((9.0 + 4.0 + 0.25) / 2.0_f64).sqrt();
    assert!((figures.energy_ratio.unwrap() - 0.25 / 2f64.sqrt() / regular).abs() < 1e-12);
    let sigma = ((9.0 + 4.0 + 0.25 + 0.0625) / 2.0_f64).sqrt();
    assert!((figures.sideband_level_factor.unwrap() - 0.5 / sigma).abs() < 1e-12);
}

#[test]
fn noise_has_the_gaussian_figures_and_scale_does_not_matter() {
    let y = sum(&[order(28.0, 5.0), gaussian_noise(N, 21)]);
    let mut plan = plan();
    let figures = plan.process(&y);
    // Scatter of N = 1000 (domain knowledge): ± 0.15, ± 2.4, ± 36; three times that.
    assert!((figures.fm4.unwrap() - 3.0).abs() < 0.45, "{figures:?}");
    assert!((figures.m6a.unwrap() - 15.0).abs() < 7.2, "{figures:?}");
    assert!((figures.m8a.unwrap() - 105.0).abs() < 108.0, "{figures:?}");
    let doubled = plan.process(&y.iter().map(|v| 2.0 * v).collect::<Vec<_>>());
    for (a, b) in [(figures.fm0, doubled.fm0), (figures.fm4, doubled.fm4)] {
        // A power of two changes no mantissa.
        assert!((a.unwrap() - b.unwrap()).abs() < 1e-12);
    }
}

#[test]
fn offsets_counts_and_prime_lengths_change_nothing() {
    for n in [N, 1009] {
        let mut plan = GearPlan::new(n, TEETH, 200, &mut FftCache::new()).unwrap();
        let line = |k: f64, a: f64| sine(n, n as f64, k, a, 0.3);
        let y = sum(&[line(28.0, 5.0), line(29.0, 0.5), line(1.0, 2.0), gaussian_noise(n, 8)]);
        let plain = plan.process(&y);
        assert_eq!(plan.strongest_harmonic(), 1);
        let offset = plan.process(&y.iter().map(|v| v + 1e6).collect::<Vec<_>>());
        // 24-bit counts into eighth powers; an offset of 1e6 rounds y by 6e-11.
        let counts = plan.process(&y.iter().map(|v| 8_388_607.0 * v).collect::<Vec<_>>());
        for (other, tolerance) in [(offset, 1e-7), (counts, 1e-11)] {
            for (a, b) in [
                (plain.fm0, other.fm0),
                (plain.fm4, other.fm4),
                (plain.m6a, other.m6a),
                (plain.m8a, other.m8a),
                (plain.energy_ratio, other.energy_ratio),
                (plain.sideband_level_factor, other.sideband_level_factor),
            ] {
                assert!((a.unwrap() / b.unwrap() - 1.0).abs() < tolerance, "{plain:?} {other:?}");
            }
        }
        let second = plan.process(&sum(&[y, line(56.0, 7.0)]));
        assert!(second.fm0.is_some() && plan.strongest_harmonic() == 2);
    }
}

#[test]
fn around_a_harmonic_its_orders_alone_are_left() {
    let mut plan = GearPlan::around(2, N, TEETH, 200, &mut FftCache::new()).unwrap();
    // 2·28 ± 14: orders 42 to 70.
    let (inside, side, edge) = (order(50.0, 0.5), order(57.0, 0.4), order(70.0, 0.2));
    let others = [order(41.0, 1.0), order(71.0, 1.0), order(10.0, 2.0), order(29.0, 1.0)];
    let all = [&[inside.clone(), side.clone(), edge.clone(), order(56.0, 3.0)][..], &others];
    plan.process(&sum(&all.concat()));
    for i in 0..N {
        // Rounding of an FFT of values of 10.
        assert!((plan.difference()[i] - inside[i] - edge[i]).abs() < 1e-13);
        assert!((plan.residual()[i] - inside[i] - edge[i] - side[i]).abs() < 1e-13);
    }
    // 7·28 + 1 is the last inside 200.
    assert!(GearPlan::around(7, N, TEETH, 200, &mut FftCache::new()).is_some());
    assert!(GearPlan::around(8, N, TEETH, 200, &mut FftCache::new()).is_none());
    assert!(GearPlan::around(0, N, TEETH, 200, &mut FftCache::new()).is_none());
}

#[test]
fn a_local_burst_is_found_where_it_is() {
    for centre in [0.02, 0.37, 0.99] {
        let burst = |i: usize| {
            let distance = (i as f64 / N as f64 - centre + 0.5).rem_euclid(1.0) - 0.5;
            (-0.5 * (distance / 0.012).powi(2)).exp() * (TAU * 100.0 * distance).cos()
        };
        let noise = gaussian_noise(N, 5).iter().map(|v| 0.05 * v).collect::<Vec<_>>();
        let y = sum(&[order(28.0, 3.0), order(1.0, 10.0), (0..N).map(burst).collect(), noise]);
        let mut plan = plan();
        let figures = plan.process(&y);
        let found = plan.localise().unwrap();
        assert!(figures.fm4.unwrap() > 10.0 && found.peak_over_mean[0] > 8.0, "{found:?}");
        let error = (found.centre_rev - centre + 0.5).rem_euclid(1.0) - 0.5;
        // A third of the tooth pitch 1/28.
        assert!(error.abs() < 0.012, "{centre}: {found:?}");
    }
}

/// Blocks of noise of unit variance with `part` added to each, moved on by `step` radians a block.
fn blocks(n_blocks: u64, amplitude: f64, step: f64) -> Vec<Vec<f64>> {
    let block = |b: u64| {
        let phase = step * b as f64;
        sum(&[sine(N, N as f64, 34.0, amplitude, phase), gaussian_noise(N, 31 + b)])
    };
    (0..n_blocks).map(block).collect()
}

#[test]
fn what_stays_from_block_to_block_is_told_from_what_wanders() {
    let mut plan = plan();
    // Power of mean over its scatter: A²·N_b/(2·variance) of the sine alone is 400, and 1 of noise.
    // Kept orders hold 0.86 of the noise; 37 points of it scatter by a third.
    let stays = plan.persistence(&blocks(8, 10.0, 0.0), 0.3).unwrap();
    assert!((stays / (0.5 * 100.0 * 8.0 / 0.9) - 1.0).abs() < 0.4, "{stays}");
    let noise = plan.persistence(&blocks(8, 0.0, 0.0), 0.3).unwrap();
    assert!((0.3..3.0).contains(&noise), "{noise}");
    // Three quarters of a turn over the record, as order 34.008 does in 100 revolutions: the mean
    // keeps |sin(8a)/(8·sin a)| of it, a = 0.75·π/8, and its scatter is the rest.
    let a = 0.75 * std::f64::consts::PI / 8.0;
    let kept = ((8.0 * a).sin() / (8.0 * a.sin())).powi(2);
    let expected = 7.0 * kept / (1.0 - kept);
    let wanders = plan.persistence(&blocks(8, 100.0, 2.0 * a), 0.3).unwrap();
    assert!((wanders / expected - 1.0).abs() < 0.1, "{wanders} {expected}: noise is 1 %");
    assert_eq!(plan.persistence(&blocks(1, 1.0, 0.0), 0.3), None);
    assert_eq!(plan.persistence(&vec![order(10.0, 1.0); 8], 0.3), None, "no chance in it");
}

#[test]
fn nothing_left_is_none_not_rounding() {
    let mut plan = plan();
    let figures = plan.process(&sum(&[order(28.0, 1.0), order(2.0, 3.0)]));
    assert_eq!((figures.fm4, figures.m6a, figures.energy_ratio), (None, None, None));
    assert_eq!(plan.localise(), None);
    let figures = plan.process(&[4.0; N]);
    assert_eq!((figures.fm0, figures.fm4, figures.sideband_level_factor), (None, None, None));
    assert_eq!(plan.localise(), None);
}

#[test]
fn a_mesh_outside_the_usable_orders_is_not_planned() {
    let mut cache = FftCache::new();
    for (n, teeth, max_order) in [(1024, 28, 28), (56, 28, 200), (0, 28, 200), (1024, 0, 200)] {
        assert!(GearPlan::new(n, teeth, max_order, &mut cache).is_none());
    }
    assert!(GearPlan::new(1024, 28, 29, &mut cache).is_some());
}
