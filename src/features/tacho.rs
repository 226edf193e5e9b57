//! Measured speed: tacho pulses and speed channels; and the notes when speeds disagree.
//!
//! Pulses are read twice, for two questions. Mean speed and the angle of synchronous averages need one count of turns
//! through the whole window: [`PhaseTrack::from_pulses`] takes each pulse as it is and bridges what is lost. Resampling to even
//! turning needs the speed between pulses, which jitter would shake: [`PulseTrainPlan`] smooths it, and ends where the train is
//! lost instead of guessing.

use super::ChannelWindow;
use super::Window;
use super::sensor::SensorReading;
use super::speed::Phase;
use super::speed::Speed;
use super::speed::SpeedSource;
use super::turning::Turning;
use crate::dsp::order::PhaseTrack;
use crate::dsp::pulses::PulseTrainPlan;
use crate::dsp::pulses::Segment;
use crate::dsp::pulses::Wheel;
use crate::dsp::stats::Moments;
use crate::dsp::tacho::Edge;
use crate::dsp::tacho::Threshold;
use crate::machine::Machine;
use crate::machine::sensor::Sensor;
use crate::machine::sensor::SensorKind;
use crate::machine::sensor::TachoEdge;
use crate::machine::sensor::TachoMark;
use crate::signal::ChannelInfo;
use crate::units::Hz;
use crate::units::Unit;

/// Speeds that differ by more than this, relative, are reported.
const DISAGREEMENT: f64 = 0.02;

/// Fewest pulses or samples a measured speed rests on.
const MIN_PULSES: usize = 3;

/// Measures the speed of the first shaft by tacho, else by a speed channel; `None` when there is
/// neither, or neither gives a speed.
#[must_use]
pub fn measured_speed(
    machine: &Machine,
    channels: &[ChannelInfo],
    window: &Window<'_>,
    sensors: &[SensorReading],
) -> Option<Speed> {
    let of_kind = |kind: SensorKind| {
        sensors.iter().filter(move |r| machine.sensors[r.sensor].kind == kind).filter_map(|r| {
            let run = window.channels.get(r.channel.0).copied().flatten()?;
            Some((&machine.sensors[r.sensor], &channels[r.channel.0], run))
        })
    };
    let mut tachos =
        of_kind(SensorKind::Tacho).filter_map(|(s, info, x)| tacho(machine, s, info, x));
    let mut by_tacho = tachos.next();
    // The first to give pulses tells the speed. On a shaft of another speed it tells no angle, of several pulses none that counts from a
    // mark; the next may.
    if let Some(measured) = by_tacho.as_mut().filter(|measured| !is_marked(measured)) {
        let (marked, others): (Vec<Speed>, Vec<Speed>) = tachos.partition(is_marked);
        let own = measured.phase.take();
        let first = |of: Vec<Speed>| of.into_iter().find_map(|other| other.phase);
        measured.phase = first(marked).or(own).or_else(|| first(others));
    }
    let by_channel =
        of_kind(SensorKind::Speed).find_map(|(s, info, x)| speed_channel(machine, s, info, x));
    let measured = match (by_tacho, by_channel) {
        (Some(mut measured), Some(other)) => {
            if let (Some(first), Some(other)) = (measured.first, other.first) {
                let told = disagreement("the tacho", first, "the speed channel", other);
                measured.notes.extend(told);
            }
            Some(measured)
        }
        (by_tacho, by_channel) => by_tacho.or(by_channel),
    };
    // A tacho without pulses is a machine at rest or a lost sensor: a nominal speed would be a guess.
    measured.or_else(|| {
        let (_, info, _) = of_kind(SensorKind::Tacho).next()?;
        let note = format!("tacho `{}` gives no pulses: machine stopped, or tacho lost", info.name);
        Some(Speed { notes: vec![note], ..Speed::unknown() })
    })
}

/// Ratio of the sensor's shaft to the first.
fn ratio(machine: &Machine, sensor: &Sensor) -> Option<f64> {
    let shaft = match machine.shaft_at(sensor) {
        Some(index) => machine.shaft(index),
        None => machine.shafts.first()?,
    };
    shaft.ratio_to_first.filter(|r| *r > 0.0)
}

fn tacho(
    machine: &Machine,
    sensor: &Sensor,
    info: &ChannelInfo,
    run: ChannelWindow<'_>,
) -> Option<Speed> {
    let x = run.samples;
    let mark = sensor.tacho?;
    let ratio = ratio(machine, sensor)?;
    let threshold = Threshold::of(x, &mut Vec::new())?;
    let edge = match mark.edge {
        TachoEdge::Rising => Edge::Rising,
        TachoEdge::Falling => Edge::Falling,
    };
    let mut times_s = Vec::new();
    threshold.edges(x, info.sample_rate.0, edge, &mut times_s);
    if times_s.len() < MIN_PULSES {
        return None;
    }
    let phase = PhaseTrack::from_pulses(&times_s, mark.pulses_per_rev)?;
    let mean = phase.mean_speed_hz();
    if !(mean.is_finite() && mean > 0.0) {
        return None;
    }
    let mut notes = Vec::new();
    let odd = phase.n_missing() + phase.n_double();
    if odd > 0 {
        notes.push(format!(
            "tacho `{}`: {} pulses missing, {} double",
            info.name,
            phase.n_missing(),
            phase.n_double()
        ));
    }
    let bad = odd as f64 / times_s.len() as f64;
    let excursion = excursion(&phase, info.sample_rate);
    let same_shaft = (ratio - 1.0).abs() < 1e-9;
    let smooth = smooth_track(&times_s, mark.pulses_per_rev, (mean, info.sample_rate), ratio);
    Some(Speed {
        first: Some(Hz(mean / ratio)),
        source: Some(SpeedSource::Tacho),
        confidence: (1.0 - bad).max(0.5),
        excursion,
        turning: smooth.map(|track| Turning { track, start_s: run.time_s, excursion }),
        is_evened: false,
        phase: same_shaft
            .then(|| from_the_common_mark(machine, &mark, &phase))
            .flatten()
            .map(|track| Phase { track, start_s: run.time_s, is_marked: mark.pulses_per_rev == 1 }),
        notes,
    })
}

/// Whether an angle is known that counts from a mark.
fn is_marked(speed: &Speed) -> bool {
    speed.phase.as_ref().is_some_and(|phase| phase.is_marked)
}

/// The angle counted from the mark of the machine's first tacho, to which everything that has an angle refers, whichever tacho
/// gave it: marks sit at different angles of the shaft (F10).
fn from_the_common_mark(
    machine: &Machine,
    mark: &TachoMark,
    track: &PhaseTrack,
) -> Option<PhaseTrack> {
    let common = machine.sensors.iter().find_map(|sensor| sensor.tacho)?;
    track.counted_from((mark.offset_deg - common.offset_deg) / 360.0)
}

/// Longest stretch over which the speed is averaged, revolutions.
const LONGEST_STRETCH: u32 = 256;

/// (max − min)/mean of the speed, as far as pulses can tell (F13). A 0/1 waveform places an edge to a sample: so much of the excursion
/// is the sampling's, the less the more revolutions are averaged; and the longer they take the less they show of what changes fast.
fn excursion(phase: &PhaseTrack, rate: Hz) -> f64 {
    let quantisation = 2.0 * phase.mean_speed_hz() / rate.0;
    let stretches = (0..).map(|k| 1_u32 << k).take_while(|n| *n <= LONGEST_STRETCH);
    stretches
        .filter_map(|n| Some(phase.relative_excursion(n)? - quantisation / f64::from(n)))
        .fold(0.0, f64::max)
}

/// Pulses on either side over which the jitter of one is smoothed.
const SMOOTHING_PULSES: usize = 4;

/// RMS error of an edge of a 0/1 waveform, samples: uniform over one, 1/√12.
const ROUNDING: f64 = 0.288_675_134_594_812_9;

/// A shaft slower than this part of its mean speed counts as standing.
const STANDING: f64 = 0.05;

/// The turning of the first shaft by the pulses of a shaft that turns `ratio` times as fast, jitter
/// smoothed (D61–D63): the longest stretch over which the pulses can be followed.
fn smooth_track(
    times_s: &[f64],
    pulses_per_rev: u32,
    (mean_hz, rate): (f64, Hz),
    ratio: f64,
) -> Option<PhaseTrack> {
    let wheel = Wheel {
        smoothing_pulses: SMOOTHING_PULSES,
        rounding_s: ROUNDING / rate.0,
        ..Wheel::even(pulses_per_rev, STANDING * mean_hz)
    };
    let mut plan = PulseTrainPlan::new(wheel, times_s.len())?;
    plan.process(times_s);
    let span_s = |segment: &&Segment| match plan.knots(segment).0 {
        [first, .., last] => last - first,
        [] | [_] => 0.0,
    };
    let longest = plan.segments().iter().max_by(|a, b| span_s(a).total_cmp(&span_s(b)))?;
    let (times_s, revolutions) = plan.knots(longest);
    let of_first: Vec<f64> = revolutions.iter().map(|r| r / ratio).collect();
    PhaseTrack::from_knots(times_s, &of_first)
}

/// Knots of a speed channel's window at most: the samples between two are averaged, so that their noise does
/// not shake the angle.
const KNOTS: usize = 256;

/// The turning of the first shaft by the speeds of a shaft that turns `ratio` times as fast.
fn integrated_track(x: &[f32], rate_hz: f64, offset: f64, ratio: f64) -> Option<PhaseTrack> {
    let n = x.len().div_ceil(KNOTS).max(1);
    let (mut times_s, mut revolutions) = (vec![0.0], vec![0.0]);
    let (mut turned, mut passed) = (0.0, 0);
    for block in x.chunks(n) {
        passed += block.len();
        turned += block.iter().map(|v| f64::from(*v) + offset).sum::<f64>() / rate_hz;
        times_s.push(passed as f64 / rate_hz);
        revolutions.push(turned / ratio);
    }
    PhaseTrack::from_knots(&times_s, &revolutions)
}

fn speed_channel(
    machine: &Machine,
    sensor: &Sensor,
    info: &ChannelInfo,
    run: ChannelWindow<'_>,
) -> Option<Speed> {
    let x = run.samples;
    let ratio = ratio(machine, sensor)?;
    if x.len() < MIN_PULSES || info.unit != Unit::Hertz {
        return None;
    }
    let moments = Moments::of(x);
    let mean = moments.mean + info.offset;
    let span = moments.max - moments.min;
    let excursion = if mean > 0.0 { span / mean } else { 0.0 };
    let track = integrated_track(x, info.sample_rate.0, info.offset, ratio);
    (mean.is_finite() && mean >= 0.0).then(|| Speed {
        first: Some(Hz(mean / ratio)),
        source: Some(SpeedSource::SpeedChannel),
        confidence: 0.97,
        excursion,
        phase: None,
        turning: track.map(|track| Turning { track, start_s: run.time_s, excursion }),
        is_evened: false,
        notes: Vec::new(),
    })
}

/// Adds a note when the measured speed and a nominal one disagree.
#[must_use]
pub fn with_disagreement(mut measured: Speed, nominal: Option<(Hz, SpeedSource)>) -> Speed {
    if let (Some(first), Some((nominal, source))) = (measured.first, nominal) {
        measured.notes.extend(disagreement("the measured speed", first, source.name(), nominal));
    }
    measured
}

/// A sentence when two speeds differ by more than 2 %.
#[must_use]
pub fn disagreement(a_name: &str, a: Hz, b_name: &str, b: Hz) -> Option<String> {
    let differ = (a.0 - b.0).abs() > DISAGREEMENT * b.0.abs().max(a.0.abs());
    differ.then(|| {
        format!("{a_name} ({:.3} Hz) and {b_name} ({:.3} Hz) disagree by more than 2 %", a.0, b.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::file;
    use crate::signal::ChannelIndex;

    const MACHINE: &str = "[machine]\nid = \"m\"\nname = \"m\"\n[[shaft]]\nid = \"s\"\n\
        speed_hz = 25.0\n[[sensor]]\nchannel = \"t\"\nkind = \"tacho\"\n\
        [[sensor]]\nchannel = \"v\"\nkind = \"speed\"\n";

    fn measured(channel: &str, unit: Unit, samples: &[f32], rate: f64) -> Option<Speed> {
        let machine = file::parse(MACHINE, "m.toml").unwrap();
        let sensor = machine.sensors.iter().position(|s| s.channel == channel).unwrap();
        let info = ChannelInfo {
            name: channel.to_owned(),
            sample_rate: Hz(rate),
            unit,
            offset: 0.0,
            unit_conflict: None,
            full_scale: None,
        };
        let run = ChannelWindow { start: 0, time_s: 0.0, samples };
        let end = samples.len() as f64 / rate;
        let window = Window { time_s: (0.0, end), channels: vec![Some(run)] };
        let reading = SensorReading {
            sensor,
            channel: ChannelIndex(0),
            absent: None,
            doubts: Vec::new(),
            lost: Vec::new(),
            flaw: None,
            sample_range: (0, samples.len() as u64),
        };
        measured_speed(&machine, &[info], &window, &[reading])
    }

    #[test]
    fn a_logic_tacho_at_constant_speed_shows_no_excursion() {
        // 24.7 Hz sampled at 2 kHz: edges fall on samples, single turns differ by 1.2 %.
        let logic = |i: u32| if (f64::from(i) * 24.7 / 2000.0).fract() < 0.3 { 1.0 } else { 0.0 };
        let samples: Vec<f32> = (0..20_000).map(logic).collect();
        let speed = measured("t", Unit::Volt, &samples, 2000.0).unwrap();
        // First and last edge are each known to a sample: 2/20 000 of the speed.
        assert!((speed.first.unwrap().0 - 24.7).abs() < 3e-3);
        assert!(speed.excursion < 1e-6, "{}", speed.excursion);
        assert!(speed.phase.is_some_and(|phase| phase.is_marked));
    }

    #[test]
    fn a_wander_below_what_a_sample_tells_of_one_turn_is_seen_over_many() {
        // 73 Hz at 42 kHz: single turns are known to 0.35 %, and the speed swings by ± 0.1 % once in 3 s.
        let angle = |t: f64| {
            73.0 * (t + 1e-3 * 3.0 / std::f64::consts::TAU
                * (std::f64::consts::TAU * t / 3.0).sin())
        };
        let logic = |i: u32| if angle(f64::from(i) / 42e3).fract() < 0.3 { 1.0 } else { 0.0 };
        let samples: Vec<f32> = (0..420_000).map(logic).collect();
        let speed = measured("t", Unit::Volt, &samples, 42e3).unwrap();
        assert!((1.5e-3..2.0e-3).contains(&speed.excursion), "{}", speed.excursion);
    }

    /// Two shafts geared 20 : 40 with a tacho on `shaft`, its mark at 30°, and one on the first, its mark at 120°: the angle at
    /// a time by what these give, turns.
    fn turned_with_two(
        (shaft, pulses_per_rev): (&str, u32),
        first: &[f32],
        second: &[f32],
        time_s: f64,
    ) -> Option<f64> {
        let text = format!(
            "[machine]\nid = 'm'\n[[shaft]]\nid = 's'\n[[shaft]]\nid = 'slow'\n[[gear]]\nid = 'g'\n\
             driving = {{ shaft = 's', teeth = 20 }}\ndriven = {{ shaft = 'slow', teeth = 40 }}\n\
             [[sensor]]\nchannel = 'a'\nkind = 'tacho'\nat = {{ shaft = '{shaft}' }}\noffset_deg = 30\n\
             pulses_per_rev = {pulses_per_rev}\n\
             [[sensor]]\nchannel = 'b'\nkind = 'tacho'\nat = {{ shaft = 's' }}\noffset_deg = 120\n"
        );
        let machine = file::parse(&text, "m.toml").unwrap();
        let info = |name: &str| ChannelInfo {
            name: name.to_owned(),
            sample_rate: Hz(1000.0),
            unit: Unit::Volt,
            offset: 0.0,
            unit_conflict: None,
            full_scale: None,
        };
        let run = |samples| Some(ChannelWindow { start: 0, time_s: 0.0, samples });
        let window = Window { time_s: (0.0, 5.0), channels: vec![run(first), run(second)] };
        let reading = |sensor: usize| SensorReading {
            sensor,
            channel: ChannelIndex(sensor),
            absent: None,
            doubts: Vec::new(),
            lost: Vec::new(),
            flaw: None,
            sample_range: (0, 5000),
        };
        let channels = [info("a"), info("b")];
        let speed = measured_speed(&machine, &channels, &window, &[reading(0), reading(1)])?;
        speed.phase.filter(|p| p.is_marked)?.track.revolutions_at(time_s)
    }

    #[test]
    fn of_two_tachos_the_angle_is_that_of_the_one_that_gave_it() {
        // 10 Hz: marks of the second at 0.05 s and every 0.1 s, and so 120° of the shaft there; it stood at 30° a quarter of a turn before.
        let pulses = |every: usize, at: usize| -> Vec<f32> {
            (0..5000)
                .map(|i| if (at..at + 10).contains(&(i % every)) { 5.0 } else { 0.0 })
                .collect()
        };
        let second = pulses(100, 50);
        let part = |first: &[f32], shaft: &str, second: &[f32]| {
            turned_with_two((shaft, 1), first, second, 2.05).map(|turned| turned.rem_euclid(1.0))
        };
        let is_quarter = |part: Option<f64>| part.is_some_and(|p| (p - 0.25).abs() < 0.01);
        // An edge lies half a sample before the first one that is high: 0.005 of a turn. The first tacho is dead, or on the shaft of half the speed.
        assert!(is_quarter(part(&[0.0; 5000], "s", &second)));
        assert!(is_quarter(part(&pulses(200, 20), "slow", &second)));
        // The first is a wheel of two pulses, which counts from no mark.
        let wheel = turned_with_two(("s", 2), &pulses(50, 20), &second, 2.05);
        assert!(is_quarter(wheel.map(|turned| turned.rem_euclid(1.0))));
        // Both live: by the first one, whose mark it counts from; it comes a quarter of a turn before the other's.
        assert!(is_quarter(part(&pulses(100, 25), "s", &second)));
        assert_eq!(
            part(&pulses(200, 20), "slow", &[0.0; 5000]),
            None,
            "no mark on the first shaft"
        );
    }

    #[test]
    fn a_silent_tacho_gives_no_speed_and_says_so() {
        let speed = measured("t", Unit::Volt, &[0.0; 5000], 1000.0).unwrap();
        assert_eq!(speed.first, None, "the nominal 25 Hz would be a guess");
        assert!(speed.notes[0].contains("no pulses"));
    }

    #[test]
    fn a_speed_channel_counts_in_hertz_only() {
        let speed = measured("v", Unit::Hertz, &[29.5; 100], 100.0).unwrap();
        assert_eq!(speed.first, Some(Hz(29.5)));
        assert!(measured("v", Unit::Volt, &[2.5; 100], 100.0).is_none());
    }
}
