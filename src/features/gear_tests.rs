//! A gear's averages: a burst at a known angle, with and without a tacho.

use super::*;
use crate::dsp::real::Real;
use crate::features::speed::Phase;
use crate::features::turning::Turning;
use crate::machine::file;
use crate::units::Hz;
use std::f64::consts::TAU;

const RIG: &str = "[machine]\nid = \"rig\"\nname = \"rig\"\n\
    [[shaft]]\nid = \"motor\"\nspeed_hz = 10.0\n[[shaft]]\nid = \"main\"\n\
    [[gear]]\nid = \"mesh\"\ndriving = { shaft = \"motor\", teeth = 28 }\n\
    driven = { shaft = \"main\", teeth = 28 }\n\
    [[sensor]]\nchannel = \"acc\"\nkind = \"accelerometer\"\nat = { gear = \"mesh\" }\n";

const RATE_HZ: f64 = 10_000.0;

/// Ten seconds of a 28-tooth mesh at 10 Hz; a burst of `burst` at `angle_deg` of each revolution.
fn mesh(burst: f64, angle_deg: f64) -> Vec<f32> {
    mesh_along(&|t| 10.0 * t, burst, angle_deg)
}

/// The same where `turned` revolutions have passed after so many seconds.
fn mesh_along(turned: &dyn Fn(f64) -> f64, burst: f64, angle_deg: f64) -> Vec<f32> {
    let sample = |i: u32| {
        let angle = turned(f64::from(i) / RATE_HZ);
        let since = (angle - angle_deg / 360.0).rem_euclid(1.0) / 10.0;
        let ringing = (-since / 1.5e-3).exp() * (TAU * 1730.0 * since).sin();
        let (mesh, once) = ((TAU * 28.0 * angle).cos(), (TAU * angle).cos());
        f32::rounded(mesh + 0.2 * once + burst * ringing)
    };
    (0..100_000).map(sample).collect()
}

/// By a tacho with a pulse at each of these times.
fn by_tacho(pulses: &[f64]) -> Speed {
    let track = PhaseTrack::from_pulses(pulses, 1).unwrap();
    Speed {
        phase: Some(Phase { track, start_s: 0.0, is_marked: true }),
        source: Some(SpeedSource::Tacho),
        ..written()
    }
}

/// As it is written down.
fn written() -> Speed {
    Speed {
        first: Some(Hz(10.0)),
        source: Some(SpeedSource::Machine),
        confidence: 1.0,
        excursion: 0.0,
        phase: None,
        turning: None,
        is_evened: false,
        notes: Vec::new(),
    }
}

fn reading(x: &[f32]) -> GearReading {
    let pulses: Vec<f64> = (0..=99).map(|k| f64::from(k) / 10.0).collect();
    reading_from(0.0, x, &by_tacho(&pulses)).unwrap()
}

fn acc() -> ChannelInfo {
    ChannelInfo {
        name: "acc".to_owned(),
        sample_rate: Hz(RATE_HZ),
        unit: Unit::Unknown,
        offset: 0.0,
        unit_conflict: None,
        full_scale: None,
    }
}

/// Of samples from `time_s` on.
fn reading_from(time_s: f64, x: &[f32], speed: &Speed) -> Option<GearReading> {
    let machine = file::parse(RIG, "rig.toml").unwrap();
    let input =
        Input { sensor: 0, channel: ChannelIndex(0), time_s, samples: x, range: (0, 100_000) };
    let mut found = read(&machine, &[acc()], speed, &[input], &mut FftCache::new());
    let whole = found.iter().filter(|r| r.part == Part::Whole);
    assert!(whole.count() <= 1, "a 1 : 1 pair is averaged once");
    (!found.is_empty()).then(|| found.remove(0))
}

#[test]
fn a_burst_once_a_revolution_is_found_at_its_angle() {
    let (healthy, damaged) = (reading(&mesh(0.001, 120.0)), reading(&mesh(0.5, 120.0)));
    assert!(damaged.has_angle && damaged.revolutions >= 97);
    // The same burst 500 times larger: linear up to what the mesh leaves, 1e-4 of it.
    let ratio = damaged.local_amplitude / healthy.local_amplitude;
    assert!(ratio > 100.0, "{ratio}");
    // One tooth is 12.9°; the ringing itself lasts 5°.
    let angle = damaged.localisation.centre_rev * 360.0;
    assert!((angle - 120.0).abs() < 360.0 / 28.0, "{angle}");
}

#[test]
fn a_window_that_begins_later_than_the_tacho_has_the_same_angle() {
    let pulses: Vec<f64> = (-2..=99).map(|k| f64::from(k) / 10.0).collect();
    let mut speed = by_tacho(&pulses.iter().map(|t| t + 0.2).collect::<Vec<_>>());
    if let Some(phase) = &mut speed.phase {
        phase.start_s = 6.8;
    }
    let found = reading_from(7.0, &mesh(0.5, 120.0), &speed).unwrap();
    let angle = found.localisation.centre_rev * 360.0;
    assert!(found.has_angle && (angle - 120.0).abs() < 360.0 / 28.0, "{angle}");
}

#[test]
fn a_gear_whose_speed_swings_is_averaged_along_the_angle_its_harmonics_tell() {
    // ± 1 % in 5 s: 0.16 of a turn ahead, four teeth and a half.
    let turned = |t: f64| 10.0 * t + 0.1 * 5.0 / TAU * (1.0 - (TAU * t / 5.0).cos());
    let x = mesh_along(&turned, 0.5, 120.0);
    let times_s: Vec<f64> = (0..=500).map(|i| f64::from(i) / 50.0).collect();
    let angles: Vec<f64> = times_s.iter().map(|t| turned(*t)).collect();
    let track = PhaseTrack::from_knots(&times_s, &angles).unwrap();
    let turning = Some(Turning { track, start_s: 0.0, excursion: 0.02 });
    let followed = Speed { turning: turning.clone(), ..written() };
    let of = |speed: &Speed| reading_from(0.0, &x, speed);
    let mesh = |found: Option<GearReading>| found.unwrap().mesh[0];
    assert!((mesh(of(&followed)) - 1.0).abs() < 0.02, "nothing is smeared but the filter's ends");
    assert!(mesh(of(&written())) < 0.5, "at constant speed most of it is");
    // What a speed channel adds up to is no angle.
    let source = Some(SpeedSource::SpeedChannel);
    assert!(of(&Speed { turning, source, excursion: 0.02, ..written() }).is_none());
}

#[test]
fn a_gear_whose_speed_is_a_little_off_is_averaged_along_the_angle_its_mesh_tells() {
    // 1e-4 of 100 revolutions: a quarter of a tooth.
    let x = mesh_along(&|t| 10.001 * t, 0.5, 120.0);
    let found = reading_from(0.0, &x, &written()).unwrap();
    assert!(found.is_sharp && !found.has_angle);
    assert!((found.mesh[0] - 1.0).abs() < 0.01, "nothing is smeared: {:?}", found.mesh);
    let right = reading_from(0.0, &mesh(0.5, 120.0), &written()).unwrap();
    let ratio = found.local_amplitude / right.local_amplitude;
    assert!(right.is_sharp && (ratio - 1.0).abs() < 0.05, "the blow is as sharp: {ratio}");
    // Noise has no angle to follow: what its average holds says nothing of the mesh.
    let noise: Vec<f32> =
        crate::dsp::reference::gaussian_noise(100_000, 3).into_iter().map(f32::rounded).collect();
    let blurred = reading_from(0.0, &noise, &written()).unwrap();
    assert!(!blurred.is_sharp);
    let machine = file::parse(RIG, "rig.toml").unwrap();
    assert_eq!(features(&machine, &blurred, &[acc()]), []);
    assert!(!features(&machine, &found, &[acc()]).is_empty());
}

#[test]
fn the_crossing_of_a_cosine_is_ninety_degrees_before_its_crest() {
    let y: Vec<f64> = (0..360).map(|d| f64::from(d - 120).to_radians().cos()).collect();
    assert!((zero_crossing_deg(&y) - 30.0).abs() < 1e-9, "a cosine with its crest at 120°");
}
