//! A simulated source: its samples are the simulation's, its pace the clock's, its damage what was
//! asked for.

use super::*;
use crate::machine::file;
use crate::simulator::scenario::amplitude_m;

/// A bent shaft on linear bearings: exact, and a thousand times faster than real time.
const SCENE: &str = r#"
[scene]
name = "light"
duration_s = 1.0
start = "rotating"
[speed]
constant_hz = 20.0
[shaft]
length_mm = 500.0
diameter_mm = 16.0
[[disc]]
at_mm = 250.0
diameter_mm = 150.0
width_mm = 15.0
eccentricity_um = 20.0
[[bearing]]
id = "left"
kind = "linear"
at_mm = 50.0
stiffness_n_per_m = 1e8
damping_n_s_per_m = 100.0
[[bearing]]
id = "right"
kind = "linear"
at_mm = 450.0
stiffness_n_per_m = 1e8
damping_n_s_per_m = 100.0
[[sensor]]
channel = "probe"
kind = "proximitor"
at_mm = 250.0
rate_hz = 2000.0
full_scale = 1000.0
[[sensor]]
channel = "right_x"
kind = "accelerometer"
bearing = "right"
rate_hz = 1000.0
number = "float64"
"#;

const MACHINE: &str = "[machine]\nid = \"m\"\nname = \"M\"\n[[shaft]]\nid = \"main\"\nspeed_hz = 20.0\n\
     [[sensor]]\nchannel = \"probe\"\nkind = \"proximitor\"\nunit = \"um\"\nat = { shaft = \"main\" }\n";

fn settings(speed: Speed) -> Settings {
    let scene = Scene::parse(SCENE, "light.toml").unwrap();
    Settings { scene, seed: 3, speed, scenario: None }
}

fn source(speed: Speed) -> Source {
    Source::open(&settings(speed), &file::parse(MACHINE, "m.toml").unwrap()).unwrap()
}

fn named(name: &str) -> Wanted {
    Wanted::Combination(name.to_owned())
}

/// Runs for some blocks, with a clock that is never late.
fn run_blocks(source: &mut Source, n_blocks: usize) -> Vec<Block> {
    let n_channels = source.channels.len();
    let mut blocks = Vec::new();
    let ran = run(
        source,
        false,
        &mut |_| (),
        &mut || false,
        &mut |_| ControlFlow::Continue(0.0),
        &mut |step| {
            if let Step::Block(block) = step {
                blocks.push(block);
            }
            let enough = blocks.len() == n_blocks * n_channels;
            if enough { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        },
    );
    ran.unwrap();
    blocks
}

#[test]
fn blocks_are_the_simulation_cut_in_order_at_both_rates() {
    let mut live = source(Speed::Max);
    let blocks = run_blocks(&mut live, 20);
    let mut whole = Simulation::new(&settings(Speed::Max).scene, 3).unwrap();
    let scale = whole.channels().next().unwrap().scale;
    let mut expected = [Vec::new(), Vec::new()];
    let mut keep = |i: usize, samples: Samples<'_>| {
        match samples {
            Samples::Int16(counts) => {
                expected[i].extend(counts.iter().map(|c| f64::from(*c) * scale));
            }
            Samples::Float64(values) => expected[i].extend_from_slice(values),
            Samples::Float32(_) => panic!("none is asked for"),
        }
        Ok::<(), Infallible>(())
    };
    whole.advance(4000, &mut keep).unwrap();
    for (i, rate_hz) in [2000.0, 1000.0].into_iter().enumerate() {
        let of_channel = || blocks.iter().filter(|block| block.channel.0 == i);
        let mut next = 0;
        for block in of_channel() {
            assert_eq!((block.start.0, block.segment), (next, 0));
            assert!((block.time_s - next as f64 / rate_hz).abs() < 1e-12);
            assert!(block.samples.len() as f64 <= BLOCK_S * rate_hz);
            next = block.end().0;
        }
        let samples: Vec<f64> =
            of_channel().flat_map(|b| &b.samples).map(|x| f64::from(*x)).collect();
        assert_eq!(samples.len(), expected[i].len());
        let largest = expected[i].iter().fold(0.0_f64, |max, x| max.max(x.abs()));
        for (found, expected) in samples.iter().zip(&expected[i]) {
            // One rounding to f32 of values up to the largest.
            assert!((found - expected).abs() <= 1e-7 * largest, "{found} {expected}");
        }
    }
    assert_eq!(live.info().channels[0].unit, crate::units::Unit::Micrometre);
    assert_eq!(live.info().shaft_speed, Some(Hz(20.0)));
}

#[test]
fn received_samples_come_before_their_block_and_are_the_same_run() {
    let mut live = source(Speed::Max);
    let mut last: Option<Received> = None;
    let mut n_pairs = 0;
    let ran = run(
        &mut live,
        true,
        &mut |_| (),
        &mut || false,
        &mut |_| ControlFlow::Continue(0.0),
        &mut |step| {
            match step {
                Step::Received(received) => last = Some(received),
                Step::Block(block) => {
                    let raw = last.take().unwrap();
                    assert_eq!((raw.channel, raw.start), (block.channel, block.start));
                    assert_eq!(raw.raw.len(), block.samples.len());
                    n_pairs += 1;
                }
                Step::Rejected { .. } | Step::End => panic!("{step:?}"),
            }
            if n_pairs == 6 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        },
    );
    ran.unwrap();
}

/// Due times of some blocks when each wait is as late as told, and the state after them.
fn paced(factor: f64, late_s: &[f64]) -> (Vec<f64>, Status) {
    let mut live = source(Speed::Times(factor));
    let (mut due, mut late) = (Vec::new(), late_s.iter());
    let ran = run(
        &mut live,
        false,
        &mut |_| (),
        &mut || false,
        &mut |due_s| {
            due.push(due_s);
            late.next().map_or(ControlFlow::Break(()), |late_s| ControlFlow::Continue(*late_s))
        },
        &mut |_| ControlFlow::Continue(()),
    );
    ran.unwrap();
    (due, live.status())
}

#[test]
fn blocks_are_due_by_the_clock_and_a_long_lag_is_given_up_and_counted() {
    let (due, status) = paced(1.0, &[-0.1, -0.1]);
    let close = |found: &[f64], expected: &[f64]| {
        found.len() == expected.len()
            && found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9)
    };
    assert!(close(&due, &[0.1, 0.2, 0.3]), "{due:?}");
    assert!(status.keeps_pace && status.lag == Lag::default(), "{:?}", status.lag);
    // Twice as fast: the same samples in half of the time.
    assert!(close(&paced(2.0, &[0.0]).0, &[0.05, 0.1]));
    // Slower: shorter blocks, as long on the clock.
    assert!(close(&paced(0.5, &[0.0]).0, &[0.1, 0.2]));
    let (due, status) = paced(1.0, &[0.4]);
    assert!(close(&due, &[0.1, 0.2]) && status.keeps_pace);
    assert!((status.lag.now_s - 0.4).abs() < 1e-12 && status.lag.n_given_up == 0);
    let (due, status) = paced(1.0, &[0.0, 2.5, 0.2]);
    assert!(close(&due, &[0.1, 0.2, 2.8, 2.9]), "{due:?}");
    assert!(!status.keeps_pace && status.lag.n_given_up == 1);
    assert!((status.lag.given_up_s - 2.5).abs() < 1e-12 && (status.lag.now_s - 0.2).abs() < 1e-12);
    let (_, status) = paced(1.0, &[&[2.5][..], &[0.0; 110]].concat());
    assert!(status.keeps_pace, "11 s later it counts as held again");
}

#[test]
fn a_scenario_grows_block_by_block_and_is_seen_in_the_samples() {
    let mut live = source(Speed::Max);
    let swing_um = |blocks: &[Block]| {
        let probe = blocks.iter().filter(|b| b.channel.0 == 0).flat_map(|b| &b.samples);
        let ends = probe.fold((f32::MAX, f32::MIN), |(a, b), x| (a.min(*x), b.max(*x)));
        f64::from(ends.1 - ends.0)
    };
    let straight_um = swing_um(&run_blocks(&mut live, 10));
    live.change(&named("GG_BS_GB"), 2.0).unwrap();
    let asked = live.status();
    assert_eq!(asked.scenario, Some("GG_BS_GB"));
    assert!((asked.since_s - 1.0).abs() < 1e-9 && (asked.grown_at_s - 3.0).abs() < 1e-9);
    assert_eq!(asked.present, Faults::default());
    run_blocks(&mut live, 10);
    let half = live.status().present.bow.unwrap();
    // At the middle of the tenth of twenty blocks: 0.95 s of 2 s.
    assert!((amplitude_m(&half.shape) - 0.475 * 203.2e-6).abs() < 1e-12);
    run_blocks(&mut live, 11);
    assert_eq!(live.status().present, live.status().wanted);
    run_blocks(&mut live, 40);
    // 8 mil each way where the probe stands, at mid-span; resonance above 20 Hz raises the part of
    // the unbalance and lets a bow exceed its amplitude a little.
    let bent_um = swing_um(&run_blocks(&mut live, 10));
    assert!(bent_um > 400.0 && bent_um < 1000.0 && straight_um < 40.0, "{bent_um} {straight_um}");
    live.change(&named("GG_GS_GB"), 0.0).unwrap();
    assert_eq!(live.status().present, Faults::default());
}

#[test]
fn a_scenario_that_is_refused_changes_nothing() {
    let mut live = source(Speed::Max);
    live.change(&named("GG_BS_GB"), 0.0).unwrap();
    let before = live.status();
    for name in ["GG_GS_BB", "BG_GS_GB", "worn"] {
        assert!(live.change(&named(name), 0.0).is_err(), "{name}");
    }
    assert_eq!(live.status(), before);
}

#[test]
fn a_scenario_to_begin_with_is_there_at_the_first_sample() {
    let begins = |scenario: Option<Wanted>| {
        let settings = Settings { scenario, ..settings(Speed::Max) };
        Source::open(&settings, &file::parse(MACHINE, "m.toml").unwrap())
    };
    let status = begins(Some(named("GG_BS_GB"))).unwrap().status();
    assert_eq!((status.scenario, status.since_s), (Some("GG_BS_GB"), 0.0));
    assert!(status.present.bow.is_some());
    assert_eq!(begins(None).unwrap().status().scenario, Some("GG_GS_GB"));
    let refused = begins(Some(named("GG_GS_BB"))).unwrap_err();
    assert!(
        matches!(refused, OpenError::Scenario(ScenarioError::Impossible { .. })),
        "{refused:?}"
    );
}

#[test]
fn a_stop_ends_it_within_a_piece_and_within_a_wait() {
    let mut live = source(Speed::Max);
    let (mut looks, mut n_steps) = (0, 0);
    let mut interrupted = || {
        looks += 1;
        looks > 3
    };
    let mut sink = |_: Step| {
        n_steps += 1;
        ControlFlow::Continue(())
    };
    let mut wait = |_: f64| ControlFlow::Continue(0.0);
    run(&mut live, false, &mut |_| (), &mut interrupted, &mut wait, &mut sink).unwrap();
    // A look a piece, one piece a block of 200 samples: three blocks of two channels.
    assert_eq!((looks, n_steps), (4, 6));
}

/// Samples of the probe in the next `n_blocks` blocks, with the number of the first of each.
fn probe(source: &mut Source, n_blocks: usize) -> (Vec<u64>, Vec<f32>) {
    let (mut starts, mut samples) = (Vec::new(), Vec::new());
    for _ in 0..n_blocks {
        assert!(source.compute(&mut || false).unwrap());
        for i in 0..source.channels.len() {
            let done = hand_on(i, &mut source.channels[i], false, &mut |step| {
                if let Step::Block(block) = step
                    && block.channel.0 == 0
                {
                    starts.push(block.start.0);
                    samples.extend(block.samples);
                }
                ControlFlow::Continue(())
            });
            assert!(done.is_continue());
        }
    }
    (starts, samples)
}

/// Amplitude of a second of samples at a frequency.
fn amplitude(samples: &[f32], hz: f64) -> f64 {
    let angle = |i: usize| std::f64::consts::TAU * hz * i as f64 / samples.len() as f64;
    let sum = |part: fn(f64) -> f64| -> f64 {
        samples.iter().enumerate().map(|(i, x)| f64::from(*x) * part(angle(i))).sum()
    };
    2.0 * sum(f64::cos).hypot(sum(f64::sin)) / samples.len() as f64
}

#[test]
fn a_shaft_turns_at_another_speed_and_its_samples_go_on() {
    let mut source = source(Speed::Max);
    let (before, at_20) = probe(&mut source, 10);
    source.turn(13.0).unwrap();
    let (after, at_13) = probe(&mut source, 10);
    assert_eq!(source.status().shaft_speed_hz, Some(13.0));
    assert_eq!((before[0], before[9], after[0]), (0, 1800, 2000), "numbers go on");
    // The unbalance is at the speed of each second; of the other one there is what swings in alone.
    assert!(amplitude(&at_20, 20.0) > 3.0 * amplitude(&at_13, 20.0));
    assert!(amplitude(&at_13, 13.0) > 1.5 * amplitude(&at_20, 13.0));
    assert!((source.simulated_s() - 2.0).abs() < 1e-9);
    let first = probe(&mut source, 1).1;
    source.turn(13.0).unwrap();
    assert_ne!(probe(&mut source, 1).1, first, "not the same noise again");
}

#[test]
fn a_scene_with_a_profile_of_speeds_keeps_it() {
    let profile = SCENE.replace("constant_hz = 20.0", "points = [[0.0, 10.0], [1.0, 20.0]]");
    let scene = Scene::parse(&profile, "profile.toml").unwrap();
    let machine = file::parse(MACHINE, "m.toml").unwrap();
    let settings = Settings { scene, ..settings(Speed::Max) };
    let mut source = Source::open(&settings, &machine).unwrap();
    let refused = source.turn(15.0).unwrap_err().to_string();
    assert!(refused.contains("a profile of speeds"), "{refused}");
    assert_eq!(source.status().shaft_speed_hz, None);
}
