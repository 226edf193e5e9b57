//! Combs: found where they are, none where nothing repeats.

use super::*;
use crate::dsp::real::Real;
use crate::dsp::reference::gaussian_noise;
use crate::features::ChannelWindow;
use crate::features::plans::Plans;
use crate::features::sensor::SensorReading;
use crate::machine::file;
use std::f64::consts::TAU;

const RATE_HZ: f64 = 10_000.0;
const N: u32 = 100_000;
const FIRST: Hz = Hz(30.0);

/// BPFI of the bearings at order 5.4152, slipped by 0.65 %: far from all parts of the shaft's harmonics.
const BPFI_HZ: f64 = 161.4;

/// Two equal bearings with a pair each: channels 0 and 1, 2 and 3.
fn machine() -> Machine {
    let bearing = |id: &str| {
        let sensor = |axis: u32| {
            format!(
                "[[sensor]]\nchannel='{id}{axis}'\nkind='accelerometer'\nat={{bearing='{id}'}}\naxis_deg={axis}\n"
            )
        };
        format!(
            "[[bearing]]\nid='{id}'\nshaft='s'\nelements=9\nelement_diameter_mm=7.94\npitch_diameter_mm=39.04\n{}{}",
            sensor(0),
            sensor(90)
        )
    };
    let text = format!("[machine]\nid='m'\n[[shaft]]\nid='s'\n{}{}", bearing("l"), bearing("r"));
    file::parse(&text, "m.toml").unwrap()
}

/// Twelve harmonics of a rate, of this amplitude.
fn strikes(rate_hz: f64, amplitude: f64) -> Vec<f64> {
    lines((1..=12).map(|h| f64::from(h) * rate_hz), amplitude)
}

fn lines(frequencies_hz: impl Iterator<Item = f64> + Clone, amplitude: f64) -> Vec<f64> {
    let line = |f: f64, i: u32| amplitude * (TAU * f * f64::from(i) / RATE_HZ + f * f).cos();
    (0..N).map(|i| frequencies_hz.clone().map(|f| line(f, i)).sum()).collect()
}

/// The combs of ten seconds of unit noise in all four channels, and what is heard in each besides.
fn combs(seed: u64, heard: [&[f64]; 4]) -> Vec<Comb> {
    let channels: Vec<Vec<f32>> = (0..4)
        .map(|c: usize| {
            let noise = gaussian_noise(N as usize, seed * 4 + c as u64).into_iter().enumerate();
            noise.map(|(i, v)| f32::rounded(v + heard[c].get(i).unwrap_or(&0.0))).collect()
        })
        .collect();
    let mut plans = Plans::new();
    let trace = |(sensor, samples)| {
        let reading = SensorReading {
            sensor,
            channel: ChannelIndex(sensor),
            absent: None,
            doubts: Vec::new(),
            lost: Vec::new(),
            flaw: None,
            sample_range: (0, u64::from(N)),
        };
        let run = ChannelWindow { start: 0, time_s: 0.0, samples };
        Trace::new(&reading, run, Hz(RATE_HZ), &mut plans)
    };
    let channels = channels.iter().map(|c| &c[..]).enumerate();
    let traces: Vec<Trace<'_>> = channels.map(trace).collect();
    read(&machine(), FIRST, &traces.iter().collect::<Vec<_>>())
}

#[test]
fn strikes_are_found_where_the_race_slips_and_loudest_where_they_are() {
    let (loud, soft) = (strikes(BPFI_HZ, 0.3), strikes(BPFI_HZ, 0.1));
    let found = combs(1, [&loud, &loud, &soft, &soft]);
    let [left, right] = &found[..] else { unreachable!("one comb a bearing") };
    for comb in [left, right] {
        assert_eq!(comb.line, DefectLine::Bpfi);
        assert!((comb.frequency.0 - BPFI_HZ).abs() < 0.011, "{comb:?}");
        assert!(!comb.is_slower);
    }
    assert_eq!((left.bearing, left.pair), (BearingIndex(0), (ChannelIndex(0), ChannelIndex(1))));
    // Six of twelve lines of power 0.045 beside noise of power 1; noise in the same bins adds and takes away.
    let expected = 6.0 * 0.045 / (1.0 + 12.0 * 0.045);
    assert!((left.part / expected - 1.0).abs() < 0.05, "{} {expected}", left.part);
    assert!(left.lead > 100.0, "{left:?}");
    assert!((7.0..12.0).contains(&left.loudness), "{left:?}");
    assert!((left.loudness * right.loudness - 1.0).abs() < 0.05, "{right:?}");
}

#[test]
fn nothing_leads_in_noise() {
    for seed in 0..20 {
        for comb in combs(seed, [&[]; 4]) {
            assert!(comb.lead < 1.5 && comb.part < 1e-3, "{comb:?}");
        }
    }
}

#[test]
fn a_shaft_that_moves_in_sevenths_of_a_revolution_hides_strikes_and_feigns_none() {
    let sevenths = lines((1..=700).map(|k| f64::from(k) * FIRST.0 / 7.0), 0.3);
    let found = combs(2, [&sevenths; 4]);
    assert!(found.iter().all(|comb| comb.lead < 1.5), "{found:?}");
    let both: Vec<f64> = sevenths.iter().zip(strikes(BPFI_HZ, 0.3)).map(|(a, b)| a + b).collect();
    let found = combs(2, [&both, &both, &sevenths, &sevenths]);
    assert!(found[0].lead > 4.0 && (found[0].frequency.0 - BPFI_HZ).abs() < 0.011, "{found:?}");
    assert!(found[1].lead < 1.5, "{found:?}");
}

#[test]
fn multiples_of_something_slower_are_told() {
    for m in [2.0, 3.0] {
        let slow = lines((1..=40).map(|h| f64::from(h) * BPFI_HZ / m), 0.3);
        let found = combs(3, [&slow; 4]);
        assert!(found[0].lead > 10.0 && found[0].is_slower, "{found:?}");
    }
}

#[test]
fn few_harmonics_are_no_comb() {
    // Smooth motion at the rate: the lowest four harmonics stand alone.
    let smooth = lines((1..=4).map(|h| f64::from(h) * BPFI_HZ), 3.0);
    let found = combs(4, [&smooth; 4]);
    assert!(found.iter().all(|comb| comb.lead < 1.5 && comb.part < 1e-3), "{found:?}");
}

#[test]
fn side_lines_of_a_comb_do_not_stand_against_it() {
    // Each harmonic with side lines as high at all thirds of a turn: at other rates a third away there are as many lines.
    let beside = |h: u32| (-9..=9).map(move |k| (h, k));
    let third = |(h, k): (u32, i32)| f64::from(h) * BPFI_HZ + f64::from(k) * FIRST.0 / 3.0;
    let struck = lines((1..=12).flat_map(beside).map(third), 0.2);
    let found = combs(5, [&struck, &struck, &[], &[]]);
    assert!(found[0].lead > 4.0 && (found[0].frequency.0 - BPFI_HZ).abs() < 0.011, "{found:?}");
    // Nor do those of noise: it has no thirds, and leads as little as ever.
    assert!(found[1].lead < 1.5, "{found:?}");
}
