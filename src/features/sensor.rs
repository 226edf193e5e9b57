//! Is the sensor alive: dead, stuck, clipped. Read before anything else is.

use crate::dsp::stats::Moments;
use crate::signal::ChannelIndex;

/// What is wrong with a sensor's signal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SensorFlaw {
    /// Every sample has the same value.
    Dead,
    /// The signal stays at one value for a long run: length of the run as a part of the window.
    Stuck {
        /// Longest run of one value ÷ window length.
        part: f64,
    },
    /// The signal is cut at its extremes: part of the samples that lie there.
    Clipped {
        /// Samples at either extreme ÷ window length.
        part: f64,
    },
}

/// Health of one sensor in a window.
#[derive(Debug, Clone, PartialEq)]
pub struct SensorReading {
    /// Place in the machine's sensors.
    pub sensor: usize,
    /// Its channel.
    pub channel: ChannelIndex,
    /// Why the window holds no samples of it, if so.
    pub absent: Option<String>,
    /// What is wrong, if anything.
    pub flaw: Option<SensorFlaw>,
    /// First sample and one past the last.
    pub sample_range: (u64, u64),
}

/// A run of one value longer than this part of the window is no vibration: at any sampling rate
/// that resolves a vibration the signal crosses a quantisation step far more often.
const STUCK_PART: f64 = 0.05;

/// Clipping cuts the crest: at least this many samples and this part of the window lie there.
const CLIPPED_MIN_SAMPLES: usize = 8;

/// See [`CLIPPED_MIN_SAMPLES`].
const CLIPPED_PART: f64 = 1e-4;

/// See [`held_extreme`].
const HELD: usize = 8;

/// Looks for a flaw; `full_scale` are the ends of an integer source's range.
#[must_use]
pub fn find_flaw(
    x: &[f32],
    moments: &Moments,
    full_scale: Option<(f32, f32)>,
) -> Option<SensorFlaw> {
    if x.len() < 2 {
        return None;
    }
    if moments.max <= moments.min {
        return Some(SensorFlaw::Dead);
    }
    let n = x.len() as f64;
    let part = longest_run(x) as f64 / n;
    let clipped = clipped_samples(x, moments, full_scale);
    if clipped >= CLIPPED_MIN_SAMPLES && clipped as f64 / n >= CLIPPED_PART {
        return Some(SensorFlaw::Clipped { part: clipped as f64 / n });
    }
    (part > STUCK_PART && x.len() > 200).then_some(SensorFlaw::Stuck { part })
}

/// Longest run of equal neighbours.
fn longest_run(x: &[f32]) -> usize {
    let mut longest = 1;
    let mut run = 1;
    for pair in x.windows(2) {
        run = if pair[0].to_bits() == pair[1].to_bits() { run + 1 } else { 1 };
        longest = longest.max(run);
    }
    longest
}

/// Samples that lie at an end of the number range, or at an extreme that is held as a cut holds it.
fn clipped_samples(x: &[f32], moments: &Moments, full_scale: Option<(f32, f32)>) -> usize {
    let at_end = |value: f32| full_scale.is_some_and(|(low, high)| value <= low || value >= high);
    let at_range = x.iter().filter(|v| at_end(**v)).count();
    // A switching signal, or a coarse quantiser, holds its extremes without being cut.
    if has_few_levels(x) {
        return at_range;
    }
    let up = held_extreme(x.iter().map(|v| f64::from(*v)), moments.max);
    let down = held_extreme(x.iter().map(|v| -f64::from(*v)), -moments.min);
    at_range.max(up + down)
}

/// Number of samples at the extreme `top` if it is a cut: it holds eight times what the next lower
/// value holds. The crest of a quantised sine holds 2.4 times (levels crossed as √2 − 1), that of
/// noise less.
fn held_extreme(x: impl Iterator<Item = f64> + Clone, top: f64) -> usize {
    let next = x.clone().filter(|v| *v < top).fold(f64::NEG_INFINITY, f64::max);
    let (mut at_top, mut at_next) = (0_usize, 0_usize);
    for value in x {
        at_top += usize::from(value >= top);
        at_next += usize::from(value < top && value >= next);
    }
    if at_top >= CLIPPED_MIN_SAMPLES && at_top >= HELD * at_next { at_top } else { 0 }
}

/// Whether the record holds fewer different values than a vibration takes.
fn has_few_levels(x: &[f32]) -> bool {
    const FEW: usize = 64;
    let mut seen = std::collections::BTreeSet::new();
    !x.iter().any(|value| {
        seen.insert(value.to_bits());
        seen.len() >= FEW
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::real::Real;

    fn flaw(x: &[f32]) -> Option<SensorFlaw> {
        find_flaw(x, &Moments::of(x), None)
    }

    fn sine(n: usize) -> Vec<f32> {
        (0..n).map(|i| (i as f32 * 0.0371).sin()).collect()
    }

    #[test]
    fn a_sine_is_healthy_and_a_constant_is_dead() {
        assert_eq!(flaw(&sine(20_000)), None);
        assert_eq!(flaw(&[3.0; 1000]), Some(SensorFlaw::Dead));
    }

    #[test]
    fn a_cut_sine_is_clipped() {
        let cut: Vec<f32> = sine(20_000).iter().map(|v| v.clamp(-0.9, 0.9)).collect();
        assert!(matches!(flaw(&cut), Some(SensorFlaw::Clipped { part }) if part > 0.1));
    }

    #[test]
    fn a_signal_that_freezes_is_stuck() {
        let mut x = sine(20_000);
        let held = x[5000];
        x[5000..7000].fill(held);
        assert!(matches!(flaw(&x), Some(SensorFlaw::Stuck { part }) if part > 0.09));
    }

    #[test]
    fn a_coarse_quantiser_is_not_clipped() {
        let coarse: Vec<f32> = sine(20_000).iter().map(|v| (v * 8.0).round() / 8.0).collect();
        assert_eq!(flaw(&coarse), None);
    }

    #[test]
    fn a_switching_signal_is_not_clipped() {
        let pulses: Vec<f32> =
            (0..20_000_u32).map(|i| if i % 400 < 20 { 5.0 } else { 0.0 }).collect();
        assert!(!matches!(flaw(&pulses), Some(SensorFlaw::Clipped { .. })));
    }

    #[test]
    fn a_clean_slow_sine_is_not_clipped() {
        // 2 Hz at 20 kHz: neighbours at the crest round to the same f32.
        let slow = |scale: f64| {
            let sine = |i: u32| scale * (f64::from(i) * std::f64::consts::TAU * 1e-4).sin();
            (0..240_000).map(sine).collect::<Vec<f64>>()
        };
        let fine: Vec<f32> = slow(1.0).iter().map(|v| f32::rounded(*v)).collect();
        assert_eq!(flaw(&fine), None);
        let counts: Vec<f32> = slow(9000.0).iter().map(|v| f32::rounded(v.round())).collect();
        assert_eq!(find_flaw(&counts, &Moments::of(&counts), Some((-32_768.0, 32_767.0))), None);
    }

    #[test]
    fn full_scale_counts_are_clipped() {
        let x: Vec<f32> =
            sine(20_000).iter().map(|v| (v * 40_000.0).clamp(-32_768.0, 32_767.0)).collect();
        let found = find_flaw(&x, &Moments::of(&x), Some((-32_768.0, 32_767.0)));
        assert!(matches!(found, Some(SensorFlaw::Clipped { .. })));
    }
}
