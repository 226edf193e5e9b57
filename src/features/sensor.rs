//! Is the sensor alive: dead, stuck, clipped, spiking, of the wrong range. Read before anything else is.

use crate::dsp::real::Real;
use crate::dsp::stats;
use crate::dsp::stats::Moments;
use crate::machine::sensor::Sensor;
use crate::signal::ChannelIndex;
use crate::units::Unit;

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
    /// Single samples stand far out of their neighbours: a loose plug, a discharge, lost bits.
    Spiking {
        /// How many.
        count: usize,
        /// Their energy ÷ that of the whole window.
        part: f64,
    },
    /// The signal takes a handful of values: the range is far too wide for it.
    WrongRange {
        /// How many.
        levels: usize,
    },
    /// The largest deviation from the mean is no machine's in any unit: a wrong scale, or bytes read as another type.
    Magnitude {
        /// That deviation, in the unit of the samples.
        largest: f64,
    },
    /// A probe stands too near or too far: its gap voltage lies outside the range in which it may be believed.
    Gap {
        /// Gap voltage, V.
        volts: f64,
        /// Lowest and highest that is allowed, V.
        allowed: (f64, f64),
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
    /// What may be wrong besides, in sentences ([`super::reception`]).
    pub doubts: Vec<String>,
    /// Indices of samples that are no motion and were set aside, in order: nothing is read of them (F29).
    pub lost: Vec<u64>,
    /// What is wrong, if anything.
    pub flaw: Option<SensorFlaw>,
    /// First sample and one past the last.
    pub sample_range: (u64, u64),
}

/// Part of the samples that may be cut for rates still to be read: a Gaussian vibration is cut at 1.6 standard
/// deviations then.
const CUT_PART: f64 = 0.1;

impl SensorReading {
    /// Whether the signal is cut at the ends of its range, and so little that what repeats in it can still be read:
    /// cutting lowers a line, and makes none at a rate that is not there.
    #[must_use]
    pub fn is_cut(&self) -> bool {
        matches!(self.flaw, Some(SensorFlaw::Clipped { part }) if part <= CUT_PART)
    }
}

/// A run of one value longer than this part of the window is no vibration: at any sampling rate
/// that resolves a vibration the signal crosses a quantisation step far more often.
const STUCK_PART: f64 = 0.05;

/// Clipping cuts the crest: at least this many samples and this part of the window lie there.
const CLIPPED_MIN_SAMPLES: usize = 8;

/// See [`CLIPPED_MIN_SAMPLES`].
const CLIPPED_PART: f64 = 1e-4;

/// Standard deviation of a Gaussian variable over the median of its magnitude.
const MAD_TO_DEVIATION: f64 = 1.4826;

/// Values a vibration must take to be one: below, it is quantised to an eighth of its peak, an error of −31 dB.
const FEWEST_LEVELS: usize = 8;

/// A spike's height in standard deviations of what samples of a Gaussian signal deviate from their neighbours' mean: none
/// of 10¹⁰ reaches eight, and impacts that ring are wider than one sample.
const SPIKE_DEVIATIONS: f64 = 12.0;

/// Part of a spike's height that the samples beside it may deviate: what vibrates takes them along.
const BESIDE_SPIKE: f64 = 0.1;

/// So many spikes in a window are a fault; one may be a glitch.
const FEWEST_SPIKES: usize = 3;

/// Part of the vibration's energy from which spikes hide it. Below, converters' pick-up is borne, and so are blows of stiff
/// teeth that an anti-alias filter makes one sample wide.
const SPIKES_PART: f64 = 0.5;

/// See [`held_extreme`].
const HELD: usize = 8;

/// Deviations from the mean between which a signal's largest lies, in any unit: twice squared, as envelopes are, what lies beyond leaves
/// single precision.
const SMALLEST: f64 = 1e-12;
const LARGEST: f64 = 1e12;

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
    let largest = (moments.max - moments.mean).max(moments.mean - moments.min);
    if !(SMALLEST..=LARGEST).contains(&largest) {
        return Some(SensorFlaw::Magnitude { largest });
    }
    let n = x.len() as f64;
    let part = longest_run(x) as f64 / n;
    let clipped = clipped_samples(x, moments, full_scale);
    if clipped >= CLIPPED_MIN_SAMPLES && clipped as f64 / n >= CLIPPED_PART {
        return Some(SensorFlaw::Clipped { part: clipped as f64 / n });
    }
    if part > STUCK_PART && x.len() > 200 {
        return Some(SensorFlaw::Stuck { part });
    }
    let levels = count_levels(x, FEWEST_LEVELS + 1);
    if levels <= FEWEST_LEVELS && x.len() > 200 {
        return Some(SensorFlaw::WrongRange { levels });
    }
    let spikes = spikes(x);
    let energy: f64 = spikes.iter().map(|(_, height)| height * height).sum();
    let (count, part) = (spikes.len(), energy / (n * moments.variance()?));
    (count >= FEWEST_SPIKES && part >= SPIKES_PART)
        .then_some(SensorFlaw::Spiking { count, part: part.min(1.0) })
}

/// Holds the mean of a probe's window, in the unit of its samples with its offset, against the gap voltages that its
/// sensor may have.
#[must_use]
pub fn find_gap(sensor: &Sensor, unit: Unit, mean: f64) -> Option<SensorFlaw> {
    let allowed = sensor.gap_v?;
    // Volts with a sensitivity have become a length; without one they are volts still.
    let volts = if unit == Unit::Volt { mean } else { mean * sensor.sensitivity_v_per_unit? };
    let is_within = (allowed.0..=allowed.1).contains(&volts);
    (!is_within).then_some(SensorFlaw::Gap { volts, allowed })
}

/// Places and heights of single samples far off the mean of their neighbours, which themselves lie where those
/// beyond let expect.
pub(super) fn spikes(x: &[f32]) -> Vec<(usize, f64)> {
    let deviation = |before: f32, at: f32, after: f32| {
        f64::from(at) - 0.5 * (f64::from(before) + f64::from(after))
    };
    let size = |w: &[f32]| f32::rounded(deviation(w[0], w[1], w[2]).abs());
    let mut sizes: Vec<f32> = x.windows(3).map(size).collect();
    let Some(median) = stats::median(&mut sizes).filter(|m| *m > 0.0) else {
        return Vec::new();
    };
    let limit = SPIKE_DEVIATIONS * MAD_TO_DEVIATION * f64::from(median);
    let spike = |w: &[f32]| {
        let height = deviation(w[1], w[2], w[3]).abs();
        if height <= limit {
            return None; // Nearly every sample.
        }
        // Without the sample itself its neighbours lie between their own neighbours and each other.
        let left = deviation(w[0], w[1], w[3]).abs();
        let right = deviation(w[1], w[3], w[4]).abs();
        (left.max(right) <= BESIDE_SPIKE * height).then_some(height)
    };
    let found = x.windows(5).enumerate();
    found.filter_map(|(i, w)| Some((i + 2, spike(w)?))).collect()
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
    count_levels(x, FEW) < FEW
}

/// Different values in the record; counted up to `enough`.
fn count_levels(x: &[f32], enough: usize) -> usize {
    let mut seen = std::collections::BTreeSet::new();
    let _ = x.iter().any(|value| {
        // Minus zero is zero.
        seen.insert((value + 0.0).to_bits());
        seen.len() >= enough
    });
    seen.len()
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn a_gap_outside_its_range_is_found_in_volts_and_in_micrometres() {
        let probe = |sensitivity: &str| {
            let text = format!(
                "[machine]\nid='m'\n[[shaft]]\nid='s'\nspeed_hz=10\n[[sensor]]\nchannel='x'\nkind='proximitor'\n\
                 unit='V'\nat={{shaft='s'}}\ngap_v=[-11, -9]\n{sensitivity}"
            );
            crate::machine::file::parse(&text, "m.toml").unwrap().sensors.remove(0)
        };
        let raw = probe("");
        assert_eq!(find_gap(&raw, Unit::Volt, -10.0), None);
        let found = find_gap(&raw, Unit::Volt, -12.5);
        assert_eq!(found, Some(SensorFlaw::Gap { volts: -12.5, allowed: (-11.0, -9.0) }));
        // 7.87 mV/µm: −10 V are −1270.6 µm, −8.9 V are −1130.9 µm.
        let calibrated = probe("sensitivity_v_per_unit=0.00787");
        assert_eq!(find_gap(&calibrated, Unit::Micrometre, -1270.6), None);
        assert!(find_gap(&calibrated, Unit::Micrometre, -1130.9).is_some());
    }

    #[test]
    fn a_handful_of_values_is_the_wrong_range() {
        let coarse: Vec<f32> = sine(20_000).iter().map(|v| (v * 3.0).round() / 3.0).collect();
        assert_eq!(flaw(&coarse), Some(SensorFlaw::WrongRange { levels: 7 }));
    }

    #[test]
    fn lone_samples_are_spikes_and_impacts_are_not() {
        // Noise of unit variance; spikes of 40; impacts as high that ring at a quarter of the sampling rate.
        let noise = crate::dsp::reference::gaussian_noise(20_000, 5);
        let noise: Vec<f32> = noise.iter().map(|v| f32::rounded(*v)).collect();
        assert_eq!(flaw(&noise), None);
        let mut spikes = noise.clone();
        for at in [3_000, 9_000, 15_000] {
            spikes[at] += 100.0;
        }
        // 3·100² of 20 000 + 3·100².
        let found = flaw(&spikes);
        assert!(
            matches!(found, Some(SensorFlaw::Spiking { count: 3, part }) if (part - 0.6).abs() < 0.03),
            "{found:?}"
        );
        let few: Vec<f32> = spikes.iter().map(|v| v.clamp(-20.0, 20.0)).collect();
        assert_eq!(flaw(&few), None, "a twentieth of the energy hides nothing");
        let mut impacts = noise;
        for start in (500..19_000).step_by(250) {
            for i in 0_u8..60 {
                let t = f32::from(i);
                impacts[start + usize::from(i)] += 60.0 * (-t / 12.0).exp() * (1.6 * t).sin();
            }
        }
        assert_eq!(flaw(&impacts), None);
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
