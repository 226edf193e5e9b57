//! How the first shaft turned, by its own harmonics, where no tacho and no speed channel says it.
//!
//! A machine without a tacho rarely turns evenly: slip follows load and mains. The harmonics of the shaft tell by
//! how much (D74, D75); what they tell is believed only if it is far more than noise makes of an even speed (F20).
//! Must not know what is resampled along it.

use super::plans::Plans;
use super::shaft_lines;
use super::shaft_lines::Peak;
use super::speed;
use super::speed::Speed;
use super::speed::SpeedSource;
use super::targets::mains;
use super::trace;
use super::trace::Trace;
use super::turning;
use super::turning::Turning;
use crate::dsp::comb::CombOrder;
use crate::dsp::comb::SpeedSearch;
use crate::dsp::fft;
use crate::dsp::low_band::LowBandPlan;
use crate::dsp::real::ceil_index;
use crate::dsp::speed_track::SpeedPoint;
use crate::dsp::speed_track::SpeedTrackPlan;
use crate::dsp::speed_track::SpeedTrackSpec;
use crate::machine::Machine;
use crate::units::Hz;
use rustfft::num_complex::Complex;

/// Highest harmonic that is followed.
const HIGHEST: u32 = 8;

/// How much less each harmonic is to be expected than the one before.
const PRESENCE: f64 = 0.85;

/// Revolutions of a frame: enough for a line to stand out, short beside the swings of a load.
const FRAME_REVOLUTIONS: f64 = 30.0;

/// Shortest frame, s, and its longest part of the window.
const FRAME_S: f64 = 0.8;
const FRAME_PART: f64 = 0.1;

/// Steepest relative change followed, 1/s: slip and governors; a run-up is steeper and needs a tacho.
const STEEPEST_PER_S: f64 = 0.02;

/// The low band reaches beyond the highest harmonic by this factor, so that there is background on both sides.
const MARGIN: f64 = 1.2;

/// Confidence of the track (D74) below which nothing is followed; a single harmonic, however strong, gives 0.92.
const CONFIDENCE: f64 = 0.9;

/// Part of the points at which harmonics must be clear.
const CLEAR: f64 = 0.9;

/// Mean square by which the angle bends away from even turning, in variances of its noise, above which the speed
/// changes. Blocks that overlap by three quarters leave a quarter of the points independent, 16 or more in a window:
/// a mean of 16 χ²₁ exceeds 4 once in 10⁷.
const CHANGE: f64 = 4.0;

/// Sum of the logarithms of the factors by which harmonics stand higher over the floor along the angle found: a
/// factor of e in all. What is no shaft's angle smears them, and the sum is negative.
const SHARPER: f64 = 1.0;

/// Points over a frame: steps are an eighth of one (D75).
const FRAME_POINTS: usize = 8;

/// Points of a track at least: what [`CHANGE`] rests on.
const MIN_POINTS: usize = 64;

/// Gives the window's speed with what its harmonics tell, if the speed is known but not measured and changes.
pub(super) fn refine(
    machine: &Machine,
    speed: Speed,
    traces: &[Trace<'_>],
    plans: &mut Plans,
) -> Speed {
    let around = match speed.source {
        Some(SpeedSource::Tacho | SpeedSource::SpeedChannel) | None => None,
        Some(
            SpeedSource::Capture
            | SpeedSource::Machine
            | SpeedSource::Option
            | SpeedSource::Estimated,
        ) => speed.first.filter(|first| first.0 > 0.0),
    };
    let Some(around) = around else { return speed };
    // Those that no motor states would take half of the harmonics of a shaft near 25 or 30 Hz.
    let mains = mains(machine, Hz(around.0 * f64::from(HIGHEST + 1))).stated;
    let witnesses = beside(&mains, around);
    let orders = orders(machine, &witnesses);
    let found = traces.iter().filter_map(|trace| follow(trace, around, &orders, plans));
    let found = found.filter(|followed| followed.is_about(&speed));
    // The clearest: its noise is the smallest part of the speed.
    let clearest = found.min_by(|a, b| a.noise.total_cmp(&b.noise));
    match clearest.filter(|followed| followed.is_confirmed(traces, &witnesses, plans)) {
        Some(followed) => followed.into_speed(speed),
        None => speed,
    }
}

/// What following one trace gave.
#[derive(Debug, Clone)]
struct Followed {
    /// Which sensor told.
    sensor: usize,
    /// Mean speed.
    first: Hz,
    /// By which harmonics.
    orders: Vec<CombOrder>,
    /// Noise of the speed at a point, relative.
    noise: f64,
    /// The angle over the window.
    turning: Turning,
}

impl Followed {
    /// Whether the speed that harmonics of the shaft have told, if they have, is within what is passed through: else a line beside them was followed.
    fn is_about(&self, settled: &Speed) -> bool {
        let reach = self.turning.excursion + settled.told_to();
        let is_within = |first: Hz| (self.first.0 / first.0 - 1.0).abs() <= reach;
        settled.is_unconfirmed() || settled.first.is_some_and(is_within)
    }

    /// Whether the `witnesses` are sharper along the angle found, harmonics followed aside in the channel followed, and those not followed anywhere
    /// as well: a modulated line that is no shaft's, or two lines that beat, make an angle of their own, which smears everything else. They beat in
    /// all channels alike, so that the same harmonic elsewhere proves less.
    fn is_confirmed(&self, traces: &[Trace<'_>], witnesses: &[u32], plans: &mut Plans) -> bool {
        let is_followed =
            |order: u32| self.orders.iter().any(|o| (o.order - f64::from(order)).abs() < 0.5);
        let (mut gain, mut of_other_orders) = (0.0, 0.0);
        for trace in traces {
            let Some((samples, rate)) = turning::resample(trace, &self.turning, self.first) else {
                return false;
            };
            let samples = &samples[samples.len() - fft::fast_len_at_most(samples.len())..];
            let x_hat = trace::transform(samples, plans);
            let before = self.harmonics((&trace.x_hat, trace.samples.len(), trace.rate));
            let after = self.harmonics((&x_hat, samples.len(), rate));
            let pairs = (1..=HIGHEST).zip(before.into_iter().zip(after));
            for (order, (before, after)) in pairs.filter(|(order, _)| witnesses.contains(order)) {
                let sharper = (after / before).ln();
                if !is_followed(order) {
                    of_other_orders += sharper;
                }
                if !is_followed(order) || trace.sensor != self.sensor {
                    gain += sharper;
                }
            }
        }
        gain > SHARPER && of_other_orders > 0.0
    }

    /// Power over the floor of the peak nearest to each harmonic, no less than that of a peak of noise.
    fn harmonics(&self, (x_hat, n, rate): (&[Complex<f32>], usize, Hz)) -> Vec<f64> {
        let top = Hz(f64::from(HIGHEST + 1) * self.first.0);
        let peaks = shaft_lines::peaks(x_hat, n, rate, top, Hz(0.5 * self.first.0));
        let reach = self.turning.excursion.max(self.first.0.recip() * rate.0 / n as f64);
        let strongest = |order: u32| {
            let at_hz = f64::from(order) * self.first.0;
            let is_near = |peak: &&Peak| (peak.frequency.0 - at_hz).abs() <= reach * at_hz;
            let near = peaks.iter().filter(is_near).map(|peak| peak.power_ratio);
            near.fold(shaft_lines::PEAK_POWER_RATIO, f64::max)
        };
        (1..=HIGHEST).map(strongest).collect()
    }

    fn into_speed(self, settled: Speed) -> Speed {
        let is_moved =
            settled.first.is_some_and(|first| (self.first.0 / first.0 - 1.0).abs() > speed::MOVED);
        let mut notes = settled.notes;
        notes.push(format!(
            "the speed changes by {:.2} % within the window: followed by harmonics of the shaft",
            100.0 * self.turning.excursion
        ));
        Speed {
            first: Some(self.first),
            source: if is_moved { Some(SpeedSource::Estimated) } else { settled.source },
            confidence: settled.confidence.max(CONFIDENCE),
            // Within the ± 3 % followed, levels stay those of one speed: the window is none of a run-up.
            turning: Some(self.turning),
            notes,
            ..settled
        }
    }
}

/// Harmonics of the shaft where no line of the mains stands: along a wrong angle that is spread over them.
fn beside(mains: &[Hz], around: Hz) -> Vec<u32> {
    let is_near = |order: u32, line: &Hz| {
        (line.0 / (f64::from(order) * around.0) - 1.0).abs() < speed::REFINE_RANGE
    };
    (1..=HIGHEST).filter(|order| !mains.iter().any(|line| is_near(*order, line))).collect()
}

/// Those that no other line of the machine can imitate.
fn orders(machine: &Machine, beside_mains: &[u32]) -> Vec<CombOrder> {
    let imitators = shaft_lines::imitators(machine);
    beside_mains
        .iter()
        .map(|k| (f64::from(*k), *k))
        .filter(|(order, _)| !shaft_lines::is_imitated(*order, &imitators))
        .map(|(order, k)| CombOrder { order, presence: PRESENCE.powf(f64::from(k)) })
        .collect()
}

/// Follows one trace; `None` if it turns as evenly as can be told, or cannot be followed.
fn follow(
    trace: &Trace<'_>,
    around: Hz,
    orders: &[CombOrder],
    plans: &mut Plans,
) -> Option<Followed> {
    if 2.0 * f64::from(HIGHEST) * around.0 >= trace.rate.0 {
        return None; // Too slow for the harmonics that would confirm it.
    }
    let orders = leading(trace, around, orders);
    let n = trace.samples.len();
    let duration_s = n as f64 / trace.rate.0;
    let last = orders.last()?.order;
    let top_hz = MARGIN * last * around.0;
    let mut low = LowBandPlan::new(n, ceil_index(top_hz * duration_s), plans.tables())?;
    let mut x = vec![0.0_f32; low.out_len()];
    low.process(&trace.x_hat, &mut x);
    let fs_hz = low.out_rate_hz(trace.rate.0);
    let frame_s = (FRAME_REVOLUTIONS / around.0).max(FRAME_S).min(FRAME_PART * duration_s);
    let reach = speed::REFINE_RANGE;
    let spec = SpeedTrackSpec {
        search: SpeedSearch {
            low_hz: around.0 * (1.0 - reach),
            high_hz: around.0 * (1.0 + reach),
            orders: orders.clone(),
        },
        fs_hz,
        n_frame: ceil_index(frame_s * fs_hz),
        max_rate_hz_s: STEEPEST_PER_S * around.0,
    };
    let mut plan = SpeedTrackPlan::new(spec, x.len(), plans.tables())?;
    if plan.find(&x)? < CONFIDENCE {
        return None;
    }
    plan.refine(&x)?;
    let (mean_hz, noise_hz, excursion) = change(plan.points())?;
    let start_s = trace.start_s() + (trace.all.samples.len() - n) as f64 / trace.rate.0;
    let turning = Turning { track: plan.phase_track()?, start_s, excursion };
    Some(Followed {
        sensor: trace.sensor,
        first: Hz(mean_hz),
        orders,
        noise: noise_hz / mean_hz,
        turning,
    })
}

/// The half of the harmonics present that tells most of the angle; the others are left to confirm it.
fn leading(trace: &Trace<'_>, around: Hz, orders: &[CombOrder]) -> Vec<CombOrder> {
    let top = Hz(f64::from(HIGHEST + 1) * around.0);
    let run = (trace.samples.len(), trace.rate);
    let peaks = shaft_lines::peaks(&trace.x_hat, run.0, run.1, top, Hz(0.5 * around.0));
    let told = |o: &CombOrder| {
        let at_hz = o.order * around.0;
        let is_near = |p: &&Peak| (p.frequency.0 / at_hz - 1.0).abs() <= speed::REFINE_RANGE;
        peaks.iter().filter(is_near).map(|p| p.power_ratio).fold(0.0, f64::max) * o.order * o.order
    };
    let mut present: Vec<(f64, CombOrder)> =
        orders.iter().map(|o| (told(o), *o)).filter(|(told, _)| *told > 0.0).collect();
    present.sort_by(|a, b| b.0.total_cmp(&a.0));
    present.truncate(present.len().div_ceil(2));
    let mut leading: Vec<CombOrder> = present.into_iter().map(|(_, order)| order).collect();
    leading.sort_by(|a, b| a.order.total_cmp(&b.order));
    leading
}

/// Mean speed, its noise over a frame, and the excursion beyond noise, if harmonics are clear all along the track and its
/// angle bends by more than noise does (F20).
fn change(points: &[SpeedPoint]) -> Option<(f64, f64, f64)> {
    let errors_hz: Vec<f64> = points.iter().filter_map(|p| p.standard_error_hz).collect();
    let is_sure =
        points.len() >= MIN_POINTS && errors_hz.len() as f64 >= CLEAR * points.len() as f64;
    if !is_sure {
        return None;
    }
    let n = points.len() as f64;
    let step_s = (points.last()?.time_s - points.first()?.time_s) / (n - 1.0);
    let mean_hz = points.iter().map(|p| p.speed_hz).sum::<f64>() / n;
    let noise_hz = (errors_hz.iter().map(|e| e * e).sum::<f64>() / errors_hz.len() as f64).sqrt();
    // A speed is the difference of two angles over a step: an angle has half of its variance.
    let noise_turns = noise_hz * step_s / std::f64::consts::SQRT_2;
    let bend = mean_square_bend(points, mean_hz, step_s) / (noise_turns * noise_turns);
    let over_frame: Vec<f64> = points
        .windows(FRAME_POINTS)
        .map(|frame| frame.iter().map(|p| p.speed_hz).sum::<f64>() / FRAME_POINTS as f64)
        .collect();
    let frame_noise_hz = noise_hz / FRAME_POINTS as f64;
    let highest = over_frame.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let lowest = over_frame.iter().copied().fold(f64::INFINITY, f64::min);
    // Extremes of some twenty independent points stick out by two standard errors on either side.
    let excursion = ((highest - lowest - 4.0 * frame_noise_hz) / mean_hz).max(0.0);
    (bend > CHANGE && mean_hz > 0.0).then_some((mean_hz, frame_noise_hz, excursion))
}

/// Mean square deviation of the angle from even turning, turns²: about its line of least squares.
fn mean_square_bend(points: &[SpeedPoint], mean_hz: f64, step_s: f64) -> f64 {
    let mut turned = 0.0;
    let (mut sum, mut square, mut moment) = (0.0, 0.0, 0.0);
    let n = points.len() as f64;
    for (i, point) in points.iter().enumerate() {
        turned += (point.speed_hz - mean_hz) * step_s;
        sum += turned;
        square += turned * turned;
        moment += turned * (i as f64 - 0.5 * (n - 1.0));
    }
    // Σ(i − mean)² of n equidistant places.
    let spread = n * (n * n - 1.0) / 12.0;
    (square - sum * sum / n - moment * moment / spread).max(0.0) / n
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::real::Real;
    use crate::dsp::reference::gaussian_noise;
    use crate::features::ChannelWindow;
    use crate::features::sensor::SensorReading;
    use crate::machine::file;
    use crate::signal::ChannelIndex;
    use std::f64::consts::TAU;

    const RATE_HZ: f64 = 6000.0;
    const FIRST_HZ: f64 = 25.0;
    const N: u32 = 60_000;

    fn machine() -> Machine {
        let text = "[machine]\nid = \"m\"\n[[shaft]]\nid = \"s\"\n[[sensor]]\nchannel = \"a\"\n\
                    kind = \"accelerometer\"\nat = { shaft = \"s\" }\n";
        file::parse(text, "m.toml").unwrap()
    }

    /// Revolutions of a shaft whose speed swings by ± `depth` once in 4 s.
    fn turned(depth: f64, t: f64) -> f64 {
        FIRST_HZ * (t + depth * (1.0 - (TAU * t / 4.0).cos()) * 4.0 / TAU)
    }

    /// Orders and amplitudes over noise of unit variance.
    fn samples(depth: f64, orders: &[(f64, f64)], seed: u64) -> Vec<f32> {
        let noise = gaussian_noise(N as usize, seed);
        let value = |i: u32| {
            let turns = turned(depth, f64::from(i) / RATE_HZ);
            orders.iter().map(|(order, a)| a * (TAU * order * turns).cos()).sum::<f64>()
        };
        (0..N).zip(noise).map(|(i, noise)| f32::rounded(noise + value(i))).collect()
    }

    fn reading(sensor: usize) -> SensorReading {
        SensorReading {
            sensor,
            channel: ChannelIndex(sensor),
            absent: None,
            doubts: Vec::new(),
            lost: Vec::new(),
            flaw: None,
            sample_range: (0, u64::from(N)),
        }
    }

    fn refined(x: &[f32], nominal_hz: f64) -> Speed {
        let settled = speed::settle(Hz(nominal_hz), SpeedSource::Machine, None, false);
        refined_in(&machine(), &[x], settled)
    }

    fn refined_in(machine: &Machine, channels: &[&[f32]], settled: Speed) -> Speed {
        let mut plans = Plans::new();
        let readings: Vec<SensorReading> = (0..channels.len()).map(reading).collect();
        let of = |(reading, samples)| {
            let run = ChannelWindow { start: 0, time_s: 7.0, samples };
            Trace::new(reading, run, Hz(RATE_HZ), &mut plans)
        };
        let traces: Vec<Trace<'_>> =
            readings.iter().zip(channels.iter().copied()).map(of).collect();
        refine(machine, settled, &traces, &mut plans)
    }

    const SHAFT: [(f64, f64); 6] =
        [(1.0, 0.5), (2.0, 0.3), (3.0, 0.4), (4.0, 0.2), (5.0, 0.3), (6.0, 0.2)];

    #[test]
    fn a_swing_is_followed_to_a_small_part_of_a_turn() {
        for depth in [0.005, 0.01] {
            let speed = refined(&samples(depth, &SHAFT, 5), 25.3);
            let turning = speed.turning.expect("followed");
            assert!((turning.excursion / (2.0 * depth) - 1.0).abs() < 0.3, "{}", turning.excursion);
            let track = turning.track.seen_from(7.0 - turning.start_s);
            let truth_at = |t: f64| turned(depth, t);
            let (from, to) = track.covered_revolutions(0.0, 10.0).unwrap();
            let (from_s, to_s) = (track.time_at(from).unwrap(), track.time_at(to).unwrap());
            let mean_hz = (truth_at(to_s) - truth_at(from_s)) / (to_s - from_s);
            // The trapezoids of the ends beside the sum of the points.
            assert!((speed.first.unwrap().0 / mean_hz - 1.0).abs() < 2e-4, "{:?}", speed.first);
            let offset = track.revolutions_at(5.0).unwrap() - truth_at(5.0);
            for t in [1.0, 2.5, 4.0, 6.0, 7.5, 9.0] {
                let error = track.revolutions_at(t).unwrap() - offset - truth_at(t);
                // A tenth of a period of the 20th order: such lines keep most of their power.
                assert!(error.abs() < 0.005, "{error} turns at {t} s");
            }
        }
    }

    #[test]
    fn an_even_speed_noise_and_foreign_tones_are_not_followed() {
        for seed in 0..10 {
            for orders in [
                &SHAFT[..],
                &[],
                &[(1.0, 0.5)],
                // Two lines that beat around the first harmonic, one of them no shaft's.
                &[(1.0, 0.5), (1.004, 0.4), (2.0, 0.3), (3.0, 0.4)],
                &[(1.01, 0.5), (2.97, 0.5), (3.03, 0.5), (5.2, 1.0)],
            ] {
                let speed = refined(&samples(0.0, orders, seed), FIRST_HZ);
                assert!(speed.turning.is_none(), "{orders:?}, seed {seed}: {:?}", speed.notes);
            }
        }
    }

    #[test]
    fn one_harmonic_alone_is_no_proof() {
        assert!(refined(&samples(0.005, &[(1.0, 0.5)], 3), FIRST_HZ).turning.is_none());
    }

    #[test]
    fn what_was_measured_is_left_alone() {
        let x = samples(0.005, &SHAFT, 5);
        let measured =
            Speed { source: Some(SpeedSource::Tacho), first: Some(Hz(25.0)), ..Speed::unknown() };
        assert!(refined_in(&machine(), &[&x], measured).turning.is_none());
    }

    #[test]
    fn side_lines_that_all_channels_hear_are_no_swing() {
        // A motor on a mains of 51.3 Hz: a line beside 1× that wanders, in both sensors alike, and its hum beside 4×.
        let text = "[machine]\nid = \"m\"\n[[shaft]]\nid = \"s\"\n[[motor]]\nshaft = \"s\"\npoles = 4\nline_frequency_hz = 51.3\n\
                    [[sensor]]\nchannel = \"a\"\nkind = \"accelerometer\"\nat = { shaft = \"s\" }\n\
                    [[sensor]]\nchannel = \"b\"\nkind = \"accelerometer\"\nat = { shaft = \"s\" }\n";
        let machine = file::parse(text, "m.toml").unwrap();
        let is_followed = |depth: f64, hum: f64, seed: u64| {
            let lines = |loud: f64, seed: u64| {
                let orders = [(1.0, 0.1), (3.0, 0.05 * loud), (5.0, 0.05 * loud)];
                let mut x = samples(depth, &orders, seed);
                for (i, x) in (0_u32..).zip(&mut x) {
                    let t = f64::from(i) / RATE_HZ;
                    let beside = 0.3 * (TAU * turned(0.012, t)).cos();
                    *x += f32::rounded(beside + hum * (TAU * 102.6 * t).cos());
                }
                x
            };
            let (a, b) = (lines(1.0, 2 * seed), lines(2.0, 2 * seed + 1));
            let settled = speed::settle(Hz(FIRST_HZ), SpeedSource::Machine, None, false);
            refined_in(&machine, &[&a, &b], settled).turning.is_some()
        };
        for seed in 0..5 {
            assert!(is_followed(0.012, 0.0, seed), "seed {seed}: all harmonics wander with it");
            for hum in [0.0, 2.0] {
                assert!(!is_followed(0.0, hum, seed), "seed {seed}, hum {hum}: they do not");
            }
        }
    }

    #[test]
    fn a_line_beside_the_shafts_is_not_followed_where_its_harmonics_tell_the_speed() {
        let followed = |depth: f64| {
            let turning = refined(&samples(depth, &SHAFT, 5), FIRST_HZ).turning.unwrap();
            let first = Hz(FIRST_HZ * 1.001);
            Followed { sensor: 0, first, orders: Vec::new(), noise: 0.0, turning }
        };
        let told = |first_hz: f64| Speed {
            first: Some(Hz(first_hz)),
            source: Some(SpeedSource::Estimated),
            confidence: 0.98,
            ..Speed::unknown()
        };
        let swing = followed(0.005);
        assert!(swing.is_about(&told(FIRST_HZ * 1.008)) && !swing.is_about(&told(FIRST_HZ * 1.02)));
        let written = Speed { confidence: 0.7, ..told(FIRST_HZ * 1.02) };
        assert!(swing.is_about(&written), "nothing has told another");
        let x = samples(0.005, &SHAFT, 5);
        assert!(refined_in(&machine(), &[&x], told(FIRST_HZ * 1.001)).turning.is_some());
        assert!(refined_in(&machine(), &[&x], told(FIRST_HZ * 1.02)).turning.is_none());
        assert!(refined_in(&machine(), &[&x], written).turning.is_some());
    }
}
