//! The eight combinations of gear, shaft and bearing at 10 Hz against what tells them apart.

use super::super::scene::builtin;
use super::*;
use std::convert::Infallible;

const RATE_HZ: f64 = 10_000.0;

/// Two seconds of every channel, by name.
fn record(name: &str, seed: u64) -> Vec<(String, Vec<f64>)> {
    let scene = Scene::parse(builtin::text(name).unwrap(), name).unwrap();
    let mut simulation = Simulation::new(&scene, seed).unwrap();
    let infos: Vec<SimulatedChannel> = simulation.channels().cloned().collect();
    let mut out = vec![Vec::new(); infos.len()];
    let mut take = |channel: usize, samples: Samples<'_>| {
        if let Samples::Int16(list) = samples {
            let (scale, offset) = (infos[channel].scale, infos[channel].offset);
            out[channel].extend(list.iter().map(|x| f64::from(*x) * scale + offset));
        }
        Ok::<(), Infallible>(())
    };
    simulation.advance(20_000, &mut take).unwrap();
    assert!(simulation.warnings().is_empty(), "{name}: {:?}", simulation.warnings());
    infos.into_iter().map(|info| info.name).zip(out).collect()
}

/// A channel without its mean.
fn channel(record: &[(String, Vec<f64>)], name: &str) -> Vec<f64> {
    let (_, x) = record.iter().find(|(known, _)| known == name).unwrap();
    let mean = x.iter().sum::<f64>() / x.len() as f64;
    x.iter().map(|x| x - mean).collect()
}

fn absolute(record: &[(String, Vec<f64>)], bearing: &str) -> Vec<f64> {
    let (x, y) =
        (channel(record, &format!("{bearing}_x")), channel(record, &format!("{bearing}_y")));
    let absolute: Vec<f64> = x.iter().zip(&y).map(|(x, y)| x.hypot(*y)).collect();
    let mean = absolute.iter().sum::<f64>() / absolute.len() as f64;
    absolute.iter().map(|x| x - mean).collect()
}

fn amplitude(x: &[f64], frequency_hz: f64) -> f64 {
    let mut sum = (0.0, 0.0);
    for (i, x) in x.iter().enumerate() {
        let (sin, cos) = (TAU * frequency_hz * i as f64 / RATE_HZ).sin_cos();
        sum = (sum.0 + x * cos, sum.1 - x * sin);
    }
    2.0 / x.len() as f64 * f64::hypot(sum.0, sum.1)
}

/// Lines of one combination.
struct Lines {
    bpfi: f64,
    middle: f64,
    mesh: f64,
    beside_mesh: f64,
    localised: f64,
}

fn lines(name: &str) -> Lines {
    let record = record(name, 3);
    let left = channel(&record, "left_x");
    // Kurtosis of one revolution, averaged over the record.
    let turn: Vec<f64> =
        (0..1000).map(|i| left.iter().skip(i).step_by(1000).sum::<f64>() / 20.0).collect();
    let moment = |power: i32| turn.iter().map(|x| x.powi(power)).sum::<f64>() / 1000.0;
    Lines {
        bpfi: amplitude(&absolute(&record, "right"), 68.0),
        middle: amplitude(&channel(&record, "mid_x"), 10.0),
        mesh: amplitude(&left, 280.0),
        beside_mesh: amplitude(&left, 275.0),
        localised: moment(4) / (moment(2) * moment(2)),
    }
}

#[test]
fn each_fault_shows_in_its_own_signal_in_all_eight_combinations() {
    let names = [
        "GG_GS_GB", "GG_GS_BB", "GG_BS_GB", "GG_BS_BB", "BG_GS_GB", "BG_GS_BB", "BG_BS_GB",
        "BG_BS_BB",
    ];
    let found: Vec<Lines> = names.iter().map(|name| lines(name)).collect();
    for pair in found.chunks(2) {
        // An independent study asks for 5.
        assert!(pair[1].bpfi > 5.0 * pair[0].bpfi, "{} {}", pair[0].bpfi, pair[1].bpfi);
    }
    let straight = found[0].middle;
    for (name, lines) in names.iter().zip(&found) {
        let ratio = lines.middle / straight;
        if name.contains("BS") {
            assert!(ratio > 50.0, "{name}: {ratio}");
        } else {
            assert!(ratio < 3.0, "{name}: {ratio}");
        }
        // The noise of 2 s is some 1.2e-3 m/s² a bin, and twice that at times.
        assert!(
            lines.mesh > 5.0 * lines.beside_mesh,
            "{name}: {} {}",
            lines.mesh,
            lines.beside_mesh
        );
        let is_localised = lines.localised > 10.0;
        assert_eq!(is_localised, name.starts_with("BG"), "{name}: {}", lines.localised);
    }
}

#[test]
fn a_pinions_worn_tooth_strikes_once_a_turn_of_its_own_shaft() {
    let record = record("reducer-10hz", 3);
    let (near, own) = (channel(&record, "pinion_left_x"), 10.0 * 48.0 / 19.0);
    // Mesh at 480 Hz on both shafts; side bands of the pinion's turns, not of the main shaft's.
    let beside = |spacing_hz: f64| {
        let sides = [-2.0, -1.0, 1.0, 2.0].map(|k| amplitude(&near, 480.0 + k * spacing_hz));
        sides.iter().map(|a| a * a).sum::<f64>().sqrt()
    };
    let (of_pinion, of_main) = (beside(own), beside(10.0));
    assert!(of_pinion > 10.0 * of_main, "{of_pinion} {of_main}");
    let tacho = channel(&record, "pinion_tacho");
    let marks = tacho.windows(2).filter(|pair| pair[0] < 0.0 && pair[1] >= 0.0).count();
    // 2 s at 25.26 Hz; one more or less by where they begin.
    assert!((50..=51).contains(&marks), "{marks}");
}

#[test]
fn a_gear_scene_is_the_same_bit_by_bit_and_its_faults_come_and_go() {
    assert_eq!(record("seed-gear-10hz", 4), record("seed-gear-10hz", 4));
    let read = |name: &str| Scene::parse(builtin::text(name).unwrap(), name).unwrap();
    let (healthy, damaged) = (read("GG_GS_GB"), read("BG_GS_GB"));
    assert!(damaged.truth().contains("fault = \"tooth_damage\""));
    let truth: toml::Table = damaged.truth().parse().unwrap();
    let fault = truth["fault"][0].as_table().unwrap();
    assert_eq!(fault["tooth"].as_integer(), Some(23));
    assert_eq!(fault["member"].as_str(), Some("driven"));
    let angle = fault["angle_deg"].as_float().unwrap();
    assert!((angle - 22.0 * 360.0 / 28.0).abs() < 1e-9, "{angle}");
    let mut simulation = Simulation::new(&healthy, 1).unwrap();
    let rms = |simulation: &mut Simulation| {
        let (mut sum, mut n) = (0.0, 0.0);
        let mut take = |channel: usize, samples: Samples<'_>| {
            if let (0, Samples::Int16(list)) = (channel, samples) {
                sum += list.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>();
                n += list.len() as f64;
            }
            Ok::<(), Infallible>(())
        };
        simulation.advance(3000, &mut take).unwrap();
        (sum / n).sqrt()
    };
    let before = rms(&mut simulation);
    simulation.set_faults(&damaged.faults()).unwrap();
    let during = rms(&mut simulation);
    simulation.set_faults(&Faults::default()).unwrap();
    rms(&mut simulation);
    let after = rms(&mut simulation);
    assert!(during > 1.5 * before && after < 1.1 * before, "{before} {during} {after}");
    let mut unknown = damaged.faults();
    unknown.teeth[0].0 = "mesh-2".to_owned();
    let text = simulation.set_faults(&unknown).unwrap_err().to_string();
    assert!(text.contains("the id of a gear: mesh-1"), "{text}");
    unknown.teeth[0].0 = "mesh-1".to_owned();
    unknown.teeth[0].1.tooth = 40;
    let text = simulation.set_faults(&unknown).unwrap_err().to_string();
    assert!(text.contains("tooth 41 of a gear with 28 teeth"), "{text}");
}
