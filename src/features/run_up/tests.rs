//! Runs made in closed form: what the probe sees is known at every angle.

use super::*;
use crate::dsp::real::Real;
use crate::features::ChannelFeatures;
use crate::features::ChannelWindow;
use crate::features::Extractor;
use crate::features::Window;
use crate::features::speed::SpeedHints;
use crate::machine::file;
use crate::signal::ChannelInfo;
use std::f64::consts::TAU;

const RATE_HZ: f64 = 5000.0;

/// A bow of 30 µm at 40° and an unbalance that shows 2 µm at 10 Hz at 200°.
const PARTS: [(f64, f64); 2] = [(30.0, 40.0), (2.0, 200.0)];

const MACHINE: &str = r#"
[machine]
id = "m"
[[shaft]]
id = "main"
[[sensor]]
channel = "probe"
kind = "proximitor"
unit = "um"
at = { shaft = "main" }
[[sensor]]
channel = "tacho"
kind = "tacho"
at = { shaft = "main" }
"#;

/// Speed and revolutions at a time: 8 Hz for 2 s, then to 40 Hz in 16 s, then steady.
fn turned(t: f64) -> (f64, f64) {
    let ramp = (t - 2.0).clamp(0.0, 16.0);
    (8.0 + 2.0 * ramp, 8.0 * t + ramp * ramp + 32.0 * (t - 18.0).max(0.0))
}

/// When the bow has trebled.
const TREBLED_S: f64 = 60.0;

/// What tells the speed.
#[derive(Debug, Clone, Copy)]
enum By {
    /// Pulses, so many a revolution.
    Pulses(u32),
    /// A channel in Hz.
    Speed,
}

impl By {
    /// The machine's file.
    fn machine(self) -> String {
        match self {
            Self::Pulses(n) => format!("{MACHINE}pulses_per_rev = {n}\n"),
            Self::Speed => MACHINE.replace("kind = \"tacho\"", "kind = \"speed\""),
        }
    }

    /// A sample at a speed and an angle in revolutions.
    fn sample(self, speed: f64, revolutions: f64) -> f32 {
        match self {
            Self::Pulses(n) if (f64::from(n) * revolutions).fract() < 0.1 => 1.0,
            Self::Pulses(_) => 0.0,
            Self::Speed => f32::rounded(speed),
        }
    }

    fn unit(self) -> Unit {
        match self {
            Self::Pulses(_) => Unit::Volt,
            Self::Speed => Unit::Hertz,
        }
    }
}

/// Samples of probe and tacho from `start_s` on for `n` samples: the parts, a steady 2× and something at 13 Hz.
fn samples(by: By, start_s: f64, n: u32) -> [Vec<f32>; 2] {
    let at = |i: u32| {
        let t = start_s + f64::from(i) / RATE_HZ;
        let (speed, revolutions) = turned(t);
        (t, speed, revolutions)
    };
    let probe = |i: u32| {
        let (t, speed, revolutions) = at(i);
        let angle = TAU * revolutions;
        let of = |(amplitude, lag): (f64, f64)| amplitude * (angle - lag.to_radians()).cos();
        let rise = (speed / 10.0).powi(2);
        f32::rounded(
            of(PARTS[0]) * if t < TREBLED_S { 1.0 } else { 3.0 }
                + rise * of(PARTS[1])
                + 3.0 * (2.0 * angle).cos()
                + 0.5 * (TAU * 13.0 * t).cos(),
        )
    };
    let reference = |i: u32| {
        let (_, speed, revolutions) = at(i);
        by.sample(speed, revolutions)
    };
    [(0..n).map(probe).collect(), (0..n).map(reference).collect()]
}

fn channels(by: By) -> Vec<ChannelInfo> {
    [("probe", Unit::Micrometre), ("tacho", by.unit())]
        .into_iter()
        .map(|(name, unit)| ChannelInfo {
            name: name.to_owned(),
            sample_rate: Hz(RATE_HZ),
            unit,
            offset: 0.0,
            unit_conflict: None,
            full_scale: None,
        })
        .collect()
}

/// The windows of 10 s that begin at the given times, followed by one mark a revolution.
fn followed(starts_s: &[f64], run: &mut RunUp) -> Vec<WindowFeatures> {
    followed_by(By::Pulses(1), starts_s, run)
}

/// The same by something else.
fn followed_by(by: By, starts_s: &[f64], run: &mut RunUp) -> Vec<WindowFeatures> {
    let machine = std::sync::Arc::new(file::parse(&by.machine(), "m.toml").unwrap());
    let mut extractor =
        Extractor::new(std::sync::Arc::clone(&machine), channels(by), SpeedHints::default());
    let window = |start_s: &f64| {
        let samples = samples(by, *start_s, 50_000);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "whole seconds"
        )]
        let start = (*start_s * RATE_HZ) as u64;
        let run_of = |samples| Some(ChannelWindow { start, time_s: *start_s, samples });
        let channels = samples.iter().map(|s| run_of(&s[..])).collect();
        let mut features =
            extractor.extract(&Window { time_s: (*start_s, start_s + 10.0), channels });
        run.follow(&machine, &mut features);
        features
    };
    starts_s.iter().map(window).collect()
}

#[test]
fn the_parts_are_read_from_the_samples_of_a_run() {
    let mut run = RunUp::default();
    let windows = followed(&[0.0, 5.0, 10.0, 20.0], &mut run);
    let last = windows.last().unwrap();
    let law = &last.laws[0].law;
    // At 20 s the speed is steady, and the run is remembered.
    assert!(!last.speed.is_transient() && law.speeds_hz.0 < 9.0 && law.speeds_hz.1 > 39.0);
    let far = law.fits.iter().max_by(|a, b| a.critical_hz.total_cmp(&b.critical_hz)).unwrap();
    assert!(far.critical_hz.is_infinite(), "what was made has no resonance");
    for (part, (amplitude, lag)) in [(far.bow, PARTS[0]), (far.unbalance, PARTS[1])] {
        let truth = Complex::from_polar(amplitude, f64::to_radians(lag));
        // Pulses are placed to a sample, 1/5000 s: 0.05 rad at 40 Hz, over many pieces.
        let off = (part.vector - truth).norm() / amplitude;
        assert!(off < 0.02 && part.chance < 1e-20, "{part:?} {off}");
    }
    assert!(far.unexplained < 0.02, "2× and what is not of the shaft leave no trace: {far:?}");
    let features: &ChannelFeatures = last.channel(ChannelIndex(0)).unwrap();
    let (bow, unbalance) =
        (features.get(&bow_name("main")).unwrap(), features.get(&unbalance_name("main")).unwrap());
    assert!((29.7..33.0).contains(&bow) && (1.98..2.4).contains(&unbalance), "{bow} {unbalance}");
    assert!(
        is_of_run(&bow_name("main")) && is_of_run(&unbalance_name("main")) && !is_of_run("rms")
    );
}

#[test]
fn windows_that_overlap_give_each_piece_once_and_few_of_a_speed_are_kept() {
    let mut run = RunUp::default();
    let n = |run: &RunUp| run.pieces.len();
    followed(&[0.0], &mut run);
    let first = n(&run);
    followed(&[0.0], &mut run);
    assert_eq!(n(&run), first, "the same window again");
    followed(&[5.0, 10.0], &mut run);
    let after_run = n(&run);
    let distinct =
        |run: &RunUp| run.pieces.windows(2).all(|pair| pair[0].time_s.1 <= pair[1].time_s.0 + 1e-9);
    assert!(after_run > first && distinct(&run), "pieces share samples");
    let steady: Vec<f64> = (0..7).map(|i| 20.0 + 5.0 * f64::from(i)).collect();
    followed(&steady, &mut run);
    assert!(n(&run) <= after_run + 2 * KEPT_OF_A_SPEED, "{} of {after_run}", n(&run));
    // An hour later the run is forgotten, and one speed tells nothing.
    let later = followed(&[3700.0], &mut run);
    assert!(later[0].laws.is_empty());
}

#[test]
fn a_vector_that_changes_at_one_speed_ends_the_run() {
    let mut run = RunUp::default();
    let windows = followed(&[0.0, 5.0, 10.0, 20.0, 40.0, 50.0, 62.0], &mut run);
    let has_law: Vec<bool> = windows.iter().map(|window| !window.laws.is_empty()).collect();
    // In the first window the speed rises from 8 to 24 Hz.
    assert_eq!(has_law, [true, true, true, true, true, true, false]);
    assert!(
        run.pieces.iter().all(|piece| piece.time_s.0 > TREBLED_S),
        "what was before is of another shaft"
    );
}

#[test]
fn without_a_mark_the_lengths_of_the_vectors_tell_both_parts() {
    for by in [By::Pulses(4), By::Speed] {
        let mut run = RunUp::default();
        let windows = followed_by(by, &[0.0, 5.0, 10.0, 20.0], &mut run);
        let law = &windows.last().unwrap().laws[0].law;
        assert_eq!(law.known, Known::Lengths);
        let far = law.fits.iter().max_by(|a, b| a.critical_hz.total_cmp(&b.critical_hz)).unwrap();
        for (part, (amplitude, _)) in [(far.bow, PARTS[0]), (far.unbalance, PARTS[1])] {
            // The angle within a piece is that of a smooth speed; one unknown more is told from the same pieces.
            let off = part.vector.norm() / amplitude - 1.0;
            assert!(off.abs() < 0.05 && part.chance < 1e-6, "{by:?} {part:?} {off}");
        }
        let lag = far.unbalance.vector.arg().to_degrees();
        assert!((lag - 160.0).abs() < 5.0, "{by:?}: {lag}");
        // Kept and read again, it is the same.
        let mut tape = Tape::default();
        run.write(&mut tape);
        assert_eq!(RunUp::read(&mut tape.reader()), Some(run));
    }
}
