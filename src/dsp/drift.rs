//! Every form that goes on from its own last value, over a thousand million samples.
//!
//! Filters and merged moments here; phases of blocks in `line::phasors`, means of records in
//! `history`, counted revolutions in `pulses`, summed ones in `speed_track`. All else in `dsp` begins
//! anew with each record. Must not be used outside tests.

#![expect(clippy::print_stdout, reason = "the figures of the documents")]

use crate::dsp::butterworth;
use crate::dsp::butterworth::Pass;
use crate::dsp::moments::Moments;
use crate::dsp::reference::largest_difference;
use crate::dsp::reference::sine;
use crate::dsp::sos::SosFilter;
use crate::dsp::sos::response;

const FS_HZ: f64 = 10_000.0;

/// Samples: 28 hours at 10 kHz.
const N: u64 = 1_000_000_000;

/// A gap voltage of 10⁶ under noise of ± ½ that is a function of the index: any stretch can be made anew.
fn fill(first: u64, out: &mut [f64]) {
    for (i, out) in (first..).zip(out) {
        // Splitmix64.
        let mut z = i.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        *out = 1e6 - 0.5 + ((z ^ (z >> 31)) >> 11) as f64 * 2f64.powi(-53);
    }
}

#[test]
#[ignore = "1e9 samples: ten seconds in the dev profile"]
fn a_filter_of_1e9_samples_is_where_a_fresh_one_is() {
    const BLOCK: usize = 10_000;
    // The slowest poles a shaft's velocity needs; they forget within 1/(1 − r) = 4000 samples.
    let sections = butterworth::design(Pass::High { edge_hz: 1.0 }, 4, FS_HZ).unwrap();
    let mut filter = SosFilter::new(sections.clone());
    filter.settle(1e6);
    let (mut x, mut y, mut fresh_y) = (vec![0.0; BLOCK], vec![0.0; BLOCK], vec![0.0; BLOCK]);
    let mut worst = 0.0_f64;
    for first in (0..N).step_by(BLOCK) {
        fill(first, &mut x);
        filter.process(&x, &mut y);
        let end = first + BLOCK as u64;
        if [N / 1000, N / 100, N / 10, N].contains(&end) {
            let mut fresh = SosFilter::new(sections.clone());
            fresh.settle(1e6);
            // 500,000 samples: what they started with has fallen to e^(−120).
            for first in (end - 500_000..end).step_by(BLOCK) {
                fill(first, &mut x);
                fresh.process(&x, &mut fresh_y);
            }
            let difference = largest_difference(&y, &fresh_y);
            println!("filter, {end} samples: {difference:.1e} from a fresh one");
            worst = worst.max(difference);
        }
    }
    // Rounding of a state of 10⁶, 6e-11, at random through a double pole: (1 − r)^(−3/2) = 2.5e5 times
    // (D37), in either filter; and no more of it after 10⁹ samples than after 10⁶.
    assert!(worst < 2e-5, "{worst}");
    // And what it says of a sine after all that is the sine's closed form.
    let gain = response(&sections, 100.0, FS_HZ);
    let exact = sine(BLOCK, FS_HZ, 100.0, gain.norm(), -gain.arg());
    let x: Vec<f64> = sine(BLOCK, FS_HZ, 100.0, 1.0, 0.0).iter().map(|v| v + 1e6).collect();
    for _ in 0..50 {
        filter.process(&x, &mut y);
    }
    let error = largest_difference(&y, &exact);
    println!("filter, then a sine: {error:.1e} from its closed form");
    assert!(error < 2e-5, "{error}");
}

/// Σ(2k − (m − 1))^p over k < m, exact.
fn uniform_sum(m: i128, p: u32) -> f64 {
    (0..m).map(|k| (2 * k - (m - 1)).pow(p)).sum::<i128>() as f64
}

#[test]
#[ignore = "1e9 samples: ten seconds in the dev profile"]
fn moments_of_1e9_samples_have_their_closed_form() {
    // Every residue of a prime equally often, out of step with the blocks, on an offset of 10⁶ times the
    // step: the central moments are those of a uniform distribution, sums of integers.
    const M: u64 = 10_007;
    let n = N / M * M;
    let mut all = Moments::EMPTY;
    let mut x = Vec::with_capacity(10_000);
    for first in (0..n).step_by(10_000) {
        x.clear();
        x.extend((first..n.min(first + 10_000)).map(|i| 1e6 + (i * 7919 % M) as f64));
        all = all.merge(&Moments::of(&x));
    }
    let m = i128::from(M);
    let half_mean = |p: u32| uniform_sum(m, p) / M as f64;
    let variance = half_mean(2) / 4.0;
    let ratio = |p: u32| half_mean(p) / half_mean(2).powi(p.cast_signed() / 2);
    let relative = [
        all.mean / (1e6 + (M - 1) as f64 / 2.0) - 1.0,
        all.variance().unwrap() / variance - 1.0,
        all.kurtosis().unwrap() / ratio(4) - 1.0,
        all.m6().unwrap() / ratio(6) - 1.0,
        all.m8().unwrap() / ratio(8) - 1.0,
    ];
    println!("moments of {n} samples: {relative:?}, skewness {:.1e}", all.skewness().unwrap());
    assert_eq!(all.n, n);
    // 10⁵ merges, each rounds all sums once or twice: at most 10⁵·2.2e-16, at random 10^2.5 of it.
    assert!(relative.iter().all(|error| error.abs() < 2e-11), "{relative:?}");
    assert!(all.skewness().unwrap().abs() < 2e-11);
}
