//! Sets of bands below, and what stands between events, against what they stand for.

use crate::dsp::real::Real;
use crate::features::ChannelWindow;
use crate::features::Window;
use crate::features::WindowFeatures;
use crate::features::bearing::BandReading;
use crate::features::bearing::DefectLine;
use crate::features::bearing::LineSearch;
use crate::features::extract::Extractor;
use crate::features::speed::SpeedHints;
use crate::machine::file;
use crate::signal::ChannelInfo;
use crate::units::Hz;
use crate::units::Unit;
use rand::RngExt;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use std::sync::Arc;

/// Two seconds of noise at 48 kHz, and at a rate of the bearing blows that ring at 2 kHz.
fn struck() -> Vec<f32> {
    let mut random = Pcg64Mcg::seed_from_u64(3);
    let at = |i: u32| {
        let since = (f64::from(i) / 48e3) % (1.0 / 105.0);
        (-since * 600.0).exp() * (since * std::f64::consts::TAU * 2e3).sin()
    };
    (0..96_000).map(|i| f32::rounded(at(i) + random.random_range(-1.0..1.0_f64))).collect()
}

/// What channels of these names (`slow` at 12 kHz, all others at 48) tell of the same record, with more lines of their sensors' descriptions.
fn features(sensors: &[(&str, &str)]) -> WindowFeatures {
    of_samples(sensors, &struck())
}

/// The same of these samples at 48 kHz.
fn of_samples(sensors: &[(&str, &str)], samples: &[f32]) -> WindowFeatures {
    let of_sensor = |(name, more): &(&str, &str)| {
        format!(
            "[[sensor]]\nchannel='{name}'\nkind='accelerometer'\nunit='g'\nat={{bearing='b'}}\n{more}\n"
        )
    };
    let text = format!(
        "[machine]\nid='m'\n[[shaft]]\nid='s'\nspeed_hz=30.0\n[[bearing]]\nid='b'\nshaft='s'\nelements=9\n\
         element_diameter_mm=7.94\npitch_diameter_mm=39.04\n{}",
        sensors.iter().map(of_sensor).collect::<String>()
    );
    let channels: Vec<ChannelInfo> = sensors
        .iter()
        .map(|(name, _)| ChannelInfo {
            name: (*name).into(),
            sample_rate: Hz(if *name == "slow" { 12e3 } else { 48e3 }),
            unit: Unit::MetrePerSecondSquared,
            full_scale: None,
            offset: 0.0,
            unit_conflict: None,
        })
        .collect();
    let machine = Arc::new(file::parse(&text, "m.toml").unwrap());
    let slow: Vec<f32> = samples.iter().step_by(4).copied().collect();
    let run = |(name, _): &(&str, &str)| {
        let samples = if *name == "slow" { &slow[..] } else { samples };
        Some(ChannelWindow { start: 0, time_s: 0.0, samples })
    };
    let window = Window { time_s: (0.0, 2.0), channels: sensors.iter().map(run).collect() };
    Extractor::new(machine, channels, SpeedHints::default()).extract(&window)
}

#[test]
fn a_set_below_reads_what_a_sensor_tells_whose_usable_band_ends_there() {
    let all = features(&[("x", "")]);
    assert_eq!(all.lower_lines.len(), 2, "22.8 kHz: of 5.7 a quarter holds eight lines");
    let outcomes = |lines: &[LineSearch]| -> Vec<_> {
        lines.iter().map(|s| (s.line, s.outcome.clone())).collect()
    };
    for (lines, top) in all.lower_lines.iter().zip([11_400.0, 5_700.0]) {
        let there = features(&[("x", &format!("usable_hz=[0.0, {top:.1}]"))]);
        assert_eq!(outcomes(lines), outcomes(&there.bearing_lines));
        assert_ne!(outcomes(&all.bearing_lines), outcomes(&there.bearing_lines));
    }
    let covered =
        |lines: &[LineSearch]| -> Vec<_> { lines.iter().map(|s| s.covered.clone()).collect() };
    assert_eq!(covered(&all.lower_lines[0]), covered(&all.bearing_lines), "of all of the band");
}

/// Two seconds at 48 kHz of a shaft of 30 Hz that knocks once a turn, and of an inner race struck 162.5 times a second while its load lets it.
fn knocks_and_strikes(knock: f64, strike: f64) -> Vec<f32> {
    let mut random = Pcg64Mcg::seed_from_u64(5);
    let ring = |t: f64, rate: f64, tone: f64, decay: f64| {
        let since = t % (1.0 / rate);
        (-since * decay).exp() * (since * std::f64::consts::TAU * tone).sin()
    };
    let at = |i: u32| {
        let t = f64::from(i) / 48e3;
        let load = 1.0 + (std::f64::consts::TAU * 30.0 * t).cos();
        knock * ring(t, 30.0, 5e3, 3e3) + strike * load * ring(t, 162.5, 5e3, 900.0)
    };
    (0..96_000).map(|i| f32::rounded(at(i) + random.random_range(-0.1..0.1_f64))).collect()
}

#[test]
fn between_knocks_of_the_shaft_a_race_is_as_deep_as_without_them() {
    // In all of the band, as measured.
    let depth = |lines: &[LineSearch], line| {
        let search = lines.iter().find(|s| s.line == line);
        let readings = search.and_then(|s| s.outcome.as_deref().ok()).unwrap_or_default();
        readings.first().map_or(0.0, BandReading::total_depth)
    };
    let inner = |lines: &[LineSearch]| depth(lines, DefectLine::Bpfi);
    let alone = of_samples(&[("x", "")], &knocks_and_strikes(0.0, 1.0));
    assert!(alone.between_lines.is_empty(), "nothing hides it");
    let both = of_samples(&[("x", "")], &knocks_and_strikes(30.0, 1.0));
    let (hidden, between) = (inner(&both.bearing_lines), inner(&both.between_lines));
    let free = inner(&alone.bearing_lines);
    assert!(hidden < 0.2 * free && between > 0.7 * free, "{hidden}, {between} of {free}");
    let sound = of_samples(&[("x", "")], &knocks_and_strikes(30.0, 0.0));
    assert!(inner(&sound.between_lines) < 0.1, "{}", inner(&sound.between_lines));
    for line in [DefectLine::Bpfo, DefectLine::TwoBsf, DefectLine::Ftf] {
        let (there, here) = (depth(&both.between_lines, line), depth(&both.bearing_lines, line));
        assert!((there - here).abs() < 1e-12, "{line:?} is read as it is");
    }
}

#[test]
fn every_channel_is_in_every_set_below() {
    let both = features(&[("x", ""), ("slow", "")]);
    let alone = features(&[("slow", "")]);
    assert!(alone.lower_lines.is_empty(), "12 kHz");
    let slow = |lines: &[LineSearch]| -> Vec<LineSearch> {
        lines.iter().filter(|s| s.channel.0 == 1).cloned().collect()
    };
    assert_eq!(both.lower_lines[0].len(), both.bearing_lines.len());
    assert_eq!(slow(&both.lower_lines[0]), slow(&both.bearing_lines), "in its only one");
}
