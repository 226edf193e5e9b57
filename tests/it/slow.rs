//! A roll that turns slowly: the daemon judges it by revolutions where it is told to.

use crate::support;
use crate::support::Daemon;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use rotorwatch::trials::motion::Motion;
use rotorwatch::trials::motion::Turn;
use rotorwatch::trials::vibration;
use rotorwatch::trials::vibration::Path;
use rotorwatch::trials::vibration::Strikes;
use serde_json::Value;

const RATE_HZ: f64 = 4000.0;
/// 165 s.
const N_SAMPLES: usize = 660_000;

/// 11 revolutions in the usual window of 10 s, 120 in one of 109 s.
const SPEED_HZ: f64 = 1.1;

const MACHINE: &str = "[machine]\nid = \"roll-1\"\nname = \"Roll\"\n[[shaft]]\nid = \"roll\"\nspeed_hz = 1.1\n\
    [[bearing]]\nid = \"drive-side\"\nshaft = \"roll\"\nelements = 15\nelement_diameter_mm = 40.0\n\
    pitch_diameter_mm = 300.0\ncontact_angle_deg = 0.0\n[[sensor]]\nchannel = \"right_x\"\n\
    kind = \"accelerometer\"\nunit = \"m/s^2\"\nat = { bearing = \"drive-side\" }\n";

/// What is said of the bearing, and the longest part of the record that it rests on, s.
fn verdict(settings: &str) -> (Value, f64) {
    let config = format!(
        "[server]\nbind = \"127.0.0.1:0\"\n{settings}[[machine]]\nfile = \"roll.toml\"\n[[source]]\n\
         kind = \"replay\"\nmachine = \"roll-1\"\nfile = \"roll.h5\"\nspeed = \"max\"\n"
    );
    let dir = support::folder(&config, &[("roll.toml", MACHINE.as_bytes())]);
    support::write_samples(&dir, "roll.h5", RATE_HZ, &outer_race());
    let daemon = Daemon::start_in(dir);
    daemon.wait_finished("roll-1");
    let (status, document) = daemon.get_json("/api/v1/machines/roll-1/diagnosis");
    assert_eq!(status, 200, "{document:#}");
    let components = document["components"].as_array().unwrap();
    let bearing = components.iter().find(|c| c["id"] == "drive-side").unwrap().clone();
    let evidence = bearing["evidence"].as_array().unwrap().iter();
    let ranges = evidence
        .filter_map(|e| Some(e["sample_range"][1].as_f64()? - e["sample_range"][0].as_f64()?));
    let longest_s = ranges.fold(0.0, f64::max) / RATE_HZ;
    (bearing, longest_s)
}

/// Strikes of an outer race, as loud as the noise.
fn outer_race() -> Vec<f64> {
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let turn = Turn::draw(Motion::Steady, SPEED_HZ, N_SAMPLES as f64 / RATE_HZ, &mut random);
    // BPFO: 15/2·(1 − 40/300), 1 % of slip. No multiple of a speed 3 % off is near.
    let order = 0.99 * 6.5;
    let strikes =
        Strikes { order, jitter: 0.005, drift: 0.0, scatter: 0.2, modulation: (1.0, 0.0) };
    let struck = strikes.make(&turn, N_SAMPLES, RATE_HZ, &mut random);
    let heard = Path::draw(&mut random).hear(&struck);
    let mut samples: Vec<f64> = (0..N_SAMPLES).map(|_| vibration::normal(&mut random)).collect();
    vibration::add_scaled(&mut samples, &heard, 1.0);
    samples
}

#[test]
fn a_slow_shaft_is_judged_in_windows_of_120_revolutions() {
    let (bearing, longest_s) = verdict("[pipeline]\nlengthen_windows = true\n");
    assert_eq!(bearing["fault"], "outer_race", "{bearing:#}");
    assert!((108.0..110.0).contains(&longest_s), "{longest_s} s: {bearing:#}");
}

#[test]
fn windows_that_stay_as_stated_say_what_to_set() {
    let (bearing, _) = verdict("");
    assert_eq!(bearing["state"], "undetermined", "{bearing:#}");
    let why = bearing["why"].as_str().unwrap();
    assert!(why.contains("window too short") && why.contains("lengthen_windows"), "{why}");
}
