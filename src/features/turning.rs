//! Makes turning even: of a shaft whose speed changes, samples at equal angles instead of equal times.
//!
//! Everything after this reads lines at multiples of one speed. Where the speed changes by more than
//! the lines can bear within the window (F13), every vibration channel is resampled along the shaft's
//! angle (D69) and goes on as if the shaft had turned at its mean speed: its lines stand where they
//! stood, sharp. Lines that do not turn with the shaft (mains) smear instead, and levels are not read
//! from these samples. Must not know where the angle comes from.

use super::bearing::N_HARMONICS;
use super::plans::Plans;
use super::trace::Trace;
use crate::dsp::order::PhaseTrack;
use crate::dsp::order_track::OrderTrackPlan;
use crate::dsp::real::ceil_index;
use crate::machine::Machine;
use crate::units::Hz;

/// Shaft and mesh lines are read up to this harmonic.
const SHAFT_HARMONICS: f64 = 3.0;

/// Part of a cell by which the highest line may move: less blurs nothing.
const BLUR: f64 = 0.5;

/// The angle must be known over this part of a channel's window.
const COVERED: f64 = 0.8;

/// Down to this part of the mean speed what folds lies above the usable band: frequencies f_s/2·(1 ± 0.025) change places, and lines are read
/// below 0.95·f_s/2 (F4). No finer points are needed then.
const STEADY: f64 = 0.975;

/// Points at which the slowest speed is looked for.
const LOOKS: u32 = 512;

/// The turning of the first shaft over a window.
#[derive(Debug, Clone)]
pub struct Turning {
    /// Revolutions of the first shaft over time.
    pub track: PhaseTrack,
    /// Stream time of the track's t = 0, s.
    pub start_s: f64,
    /// (max − min)/mean of the speed, as far as its measurement can tell.
    pub excursion: f64,
}

/// How a shaft turned, as the lines of its traces are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Turned {
    /// Its speed changes by no more than the lines can bear, as far as is known.
    Steady,
    /// It changes, and the traces go on at equal angles.
    Evened,
    /// It changes, and the angle is known over too little of the window: lines are smeared.
    Smeared,
}

/// Resamples `traces` to even turning if the speed changes by more than their lines can bear; all or none.
pub(super) fn even(
    machine: &Machine,
    speed: (Option<Hz>, Option<&Turning>),
    traces: &mut [Trace<'_>],
    plans: &mut Plans,
) -> Turned {
    let (Some(first), Some(turning)) = speed else { return Turned::Steady };
    let longest_s = traces.iter().map(|t| t.samples.len() as f64 / t.rate.0).fold(0.0, f64::max);
    if turning.excursion <= bearable_excursion(machine, first, longest_s) {
        return Turned::Steady;
    }
    let evened: Option<Vec<_>> =
        traces.iter().map(|trace| resample(trace, turning, first)).collect();
    let Some(evened) = evened else { return Turned::Smeared };
    for (trace, (samples, rate)) in traces.iter_mut().zip(evened) {
        trace.replace(samples, rate, plans);
    }
    Turned::Evened
}

/// What is said of lines that are smeared.
pub(super) fn smeared(turning: &Turning) -> String {
    format!(
        "the speed changes by {:.2} % within the window, more than lines can bear, and is not evened out, for which the angle must be known over \
         {:.0} % of it: lines are read smeared, and a defect may be hidden; a tacho over the whole record would tell",
        100.0 * turning.excursion,
        100.0 * COVERED
    )
}

/// The relative change of speed that blurs the highest line read by half a cell (F13).
fn bearable_excursion(machine: &Machine, first: Hz, duration_s: f64) -> f64 {
    let of_bearings = machine.bearings.iter().filter_map(|bearing| {
        let speed = machine.shaft_speed(bearing.shaft, first)?;
        let rates = bearing.fault_rates(speed)?;
        let fastest = rates.bpfi.0.max(rates.bpfo.0).max(rates.two_bsf().0);
        Some(N_HARMONICS as f64 * fastest)
    });
    let of_gears = machine.gears.iter().filter_map(|gear| {
        let speed = machine.shaft_speed(gear.driving.shaft, first)?;
        Some(SHAFT_HARMONICS * gear.mesh_frequency(speed).0)
    });
    let highest = of_bearings.chain(of_gears).fold(SHAFT_HARMONICS * first.0, f64::max);
    BLUR / (duration_s * highest)
}

/// The samples of a trace at equal angles, at a rate of whole points a revolution of `first`, at
/// least as many as were sampled. `None` if the angle is known over too little of them.
pub(super) fn resample(trace: &Trace<'_>, turning: &Turning, first: Hz) -> Option<(Vec<f32>, Hz)> {
    let x = trace.all.samples;
    let track = turning.track.seen_from(trace.start_s() - turning.start_s);
    let duration_s = x.len() as f64 / trace.rate.0;
    let (from, to) = track.covered_revolutions(0.0, duration_s)?;
    let (from_s, to_s) = (track.time_at(from)?, track.time_at(to)?);
    if to_s - from_s < COVERED * duration_s {
        return None;
    }
    let speeds = (0..=LOOKS)
        .filter_map(|i| track.speed_at(from_s + (to_s - from_s) * f64::from(i) / f64::from(LOOKS)));
    let slowest = speeds.fold(f64::INFINITY, f64::min);
    let points = ceil_index(trace.rate.0 / first.0);
    let kept_apart = if slowest > STEADY * first.0 { first.0 } else { slowest };
    let mut plan = OrderTrackPlan::new(points, trace.rate.0, kept_apart)?;
    let mut samples = vec![0.0_f32; ceil_index((to - from) * points as f64) + 1];
    let found = plan.process(x, trace.rate.0, &track, &mut samples)?;
    samples.truncate(found.n_points);
    (samples.len() >= x.len() / 2).then_some((samples, Hz(points as f64 * first.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::line;
    use crate::dsp::real::Real;
    use crate::features::ChannelWindow;
    use crate::features::sensor::SensorReading;
    use crate::machine::file;
    use crate::signal::ChannelIndex;
    use std::f64::consts::TAU;

    const RATE_HZ: f64 = 10_000.0;
    const FIRST_HZ: f64 = 20.0;

    /// Revolutions of a shaft whose speed swings by ± `depth` once in 5 s.
    fn turned(depth: f64, t: f64) -> f64 {
        let swing = depth * (1.0 - (TAU * t / 5.0).cos()) * 5.0 / TAU;
        FIRST_HZ * (t + swing)
    }

    fn turning(depth: f64, start_s: f64, end_s: f64) -> Turning {
        let knots = |i: u32| start_s + 0.05 * f64::from(i);
        let times_s: Vec<f64> = (0..).map(knots).take_while(|t| *t <= end_s).collect();
        let revolutions: Vec<f64> = times_s.iter().map(|t| turned(depth, *t)).collect();
        let since: Vec<f64> = times_s.iter().map(|t| t - start_s).collect();
        let track = PhaseTrack::from_knots(&since, &revolutions).unwrap();
        Turning { track, start_s, excursion: 2.0 * depth }
    }

    fn machine() -> Machine {
        let text = "[machine]\nid = \"m\"\n[[shaft]]\nid = \"s\"\n[[bearing]]\nid = \"b\"\nshaft = \"s\"\n\
                    elements = 9\nelement_diameter_mm = 7.94\npitch_diameter_mm = 39.04\n\
                    [[sensor]]\nchannel = \"a\"\nkind = \"accelerometer\"\nat = { bearing = \"b\" }\n";
        file::parse(text, "m.toml").unwrap()
    }

    /// Ten seconds from 100 s on, of a unit line at order 21.66 (four times the fastest of the bearing).
    fn samples(depth: f64) -> Vec<f32> {
        let value = |i: u32| (TAU * 21.66 * turned(depth, 100.0 + f64::from(i) / RATE_HZ)).cos();
        (0..100_000).map(|i| f32::rounded(value(i))).collect()
    }

    fn trace<'a>(samples: &'a [f32], plans: &mut Plans) -> Trace<'a> {
        let run = ChannelWindow { start: 1_000_000, time_s: 100.0, samples };
        let reading = SensorReading {
            sensor: 0,
            channel: ChannelIndex(0),
            absent: None,
            doubts: Vec::new(),
            lost: Vec::new(),
            flaw: None,
            sample_range: (1_000_000, 1_100_000),
        };
        Trace::new(&reading, run, Hz(RATE_HZ), plans)
    }

    fn amplitude(trace: &Trace<'_>) -> f64 {
        line::line_at(&trace.samples, trace.rate.0, 21.66 * FIRST_HZ).unwrap().amplitude
    }

    #[test]
    fn a_line_that_turns_with_the_shaft_is_sharp_again() {
        for depth in [0.002, 0.02, 0.3] {
            let mut plans = Plans::new();
            let x = samples(depth);
            let mut traces = [trace(&x, &mut plans)];
            assert!(amplitude(&traces[0]) < 0.7, "smeared over many cells");
            let turning = turning(depth, 99.0, 111.0);
            let speed = (Some(Hz(FIRST_HZ)), Some(&turning));
            assert_eq!(even(&machine(), speed, &mut traces, &mut plans), Turned::Evened);
            // Knots 0.05 s apart miss the swing by 1e-4 revolutions, so the line by 0.013 rad at most.
            assert!((amplitude(&traces[0]) - 1.0).abs() < 2e-3, "{depth}");
            assert!((traces[0].rate.0 / RATE_HZ - 1.0).abs() < 1e-9, "500 points a revolution");
            assert_eq!(traces[0].range, (1_000_000, 1_100_000));
        }
    }

    #[test]
    fn a_steady_shaft_is_left_alone_and_so_is_one_whose_angle_is_known_in_part() {
        let mut plans = Plans::new();
        let x = samples(0.02);
        for (turning, turned) in [
            (Turning { excursion: 5e-5, ..turning(0.02, 99.0, 111.0) }, Turned::Steady),
            (turning(0.02, 99.0, 107.0), Turned::Smeared),
            (turning(0.02, 120.0, 130.0), Turned::Smeared),
        ] {
            let mut traces = [trace(&x, &mut plans)];
            let speed = (Some(Hz(FIRST_HZ)), Some(&turning));
            assert_eq!(even(&machine(), speed, &mut traces, &mut plans), turned);
            assert_eq!(&traces[0].samples[..], &x[..]);
        }
    }

    #[test]
    fn what_blurs_depends_on_the_highest_line_and_the_window() {
        // BPFI is 5.4152·f, read to its fourth harmonic: 433 Hz at 20 Hz.
        let bearable = bearable_excursion(&machine(), Hz(20.0), 10.0);
        assert!((bearable / (0.5 / (10.0 * 433.217)) - 1.0).abs() < 1e-4, "{bearable}");
    }
}
