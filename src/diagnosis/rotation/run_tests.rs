//! Bow and unbalance by the law of a run: vectors in closed form, with noise, against a healthy run.

use super::cause::Cause;
use super::tests::Signs;
use super::tests::channels;
use super::tests::features;
use super::tests::machine;
use super::*;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::baseline::Record;
use crate::features::ChannelFeatures;
use crate::features::Feature;
use crate::features::run_up;
use crate::features::run_up::Known;
use crate::features::run_up::ShaftLaw;
use crate::features::run_up::VectorAt;
use crate::features::speed::Speed;
use crate::features::speed::SpeedSource;
use crate::machine::Machine;
use crate::signal::ChannelIndex;
use crate::units::Hz;
use crate::units::Unit;
use rustfft::num_complex::Complex;
use std::sync::Arc;

const CRITICAL_HZ: f64 = 117.0;
const MAIN: ShaftIndex = ShaftIndex(1);

/// What a probe of the main shaft sees from 5 to `top` Hz: bow b, eccentricity e, scatter of about 0.2 µm.
fn run(b: Complex<f64>, e: Complex<f64>, top_hz: f64) -> ShaftLaw {
    run_of(Known::Vectors, (b, e), top_hz)
}

/// The same, by vectors or by lengths alone.
fn run_of(known: Known, (b, e): (Complex<f64>, Complex<f64>), top_hz: f64) -> ShaftLaw {
    let mut state = 12_345_u64;
    let mut scatter = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        0.7 * ((state >> 33) as f64 / (1_u64 << 31) as f64 - 0.5)
    };
    let vectors: Vec<VectorAt> = (0..24_u32)
        .map(|i| {
            let speed_hz = 5.0 + (top_hz - 5.0) * f64::from(i) / 23.0;
            let r = speed_hz / CRITICAL_HZ;
            // Damping of 2 %, which the law leaves out.
            let raised = Complex::new(1.0 - r * r, 0.04 * r).inv();
            let vector = (b + e * r * r) * raised + Complex::new(scatter(), scatter());
            VectorAt { speed_hz, vector, weight: 1.0 }
        })
        .collect();
    let law = run_up::speed_law(&vectors, known, Some(CRITICAL_HZ)).unwrap();
    ShaftLaw { shaft: MAIN, channel: ChannelIndex(0), law }
}

/// A run-out of 1 µm and an eccentricity of 5 µm, in good health.
fn healthy(top_hz: f64) -> ShaftLaw {
    run(polar(1.0, 10.0), polar(5.0, 100.0), top_hz)
}

fn polar(amplitude: f64, lag_deg: f64) -> Complex<f64> {
    Complex::from_polar(amplitude, lag_deg.to_radians())
}

/// What a baseline keeps of a run.
fn kept(law: &ShaftLaw) -> Vec<ChannelFeatures> {
    let fit = law.law.fits[0];
    let feature =
        |name: String, value| Feature { name: Arc::from(name), value, unit: Unit::Micrometre };
    let values = vec![
        feature(run_up::bow_name("main"), fit.bow.vector.norm()),
        feature(run_up::unbalance_name("main"), fit.unbalance.vector.norm()),
    ];
    vec![ChannelFeatures { channel: law.channel, sample_range: (0, 1), values }]
}

/// A window of the run, or, with the signs of its lines, at a steady speed after it.
fn window(laws: Vec<ShaftLaw>, steady: Option<(f64, Signs)>) -> WindowFeatures {
    let speed = Speed {
        first: Some(Hz(steady.map_or(20.0, |(speed_hz, _)| speed_hz))),
        source: Some(SpeedSource::Tacho),
        confidence: 1.0,
        excursion: if steady.is_some() { 0.0 } else { 0.4 },
        ..Speed::unknown()
    };
    let signs = steady.map_or(Signs::HEALTHY, |(_, signs)| signs);
    WindowFeatures { speed, laws, ..tests::window(features(signs)) }
}

/// What is said of a window of a machine, with a healthy run and a healthy record at its speed or without both.
fn told<T>(
    machine: &Machine,
    features: &WindowFeatures,
    with_baseline: bool,
    say: impl FnOnce(&Context<'_>) -> T,
) -> T {
    let channels = channels();
    let of_run = Record::of_windows("run", &[(None, kept(&healthy(50.0)))], &channels);
    let healthy = tests::features(Signs::HEALTHY);
    let at_speed = Record::of_windows("h", &[(features.speed.first, healthy)], &channels);
    let of = |record: Record| {
        let records = if with_baseline { vec![record] } else { Vec::new() };
        Baseline { records, provisional: false }
    };
    say(&Context {
        machine,
        channels: &channels,
        channel_of_sensor: &[Some(ChannelIndex(0)), Some(ChannelIndex(1))],
        baseline: &of(at_speed),
        runs: &of(of_run),
        offered_baselines: usize::from(with_baseline),
        void_baselines: None,
        false_alarm_probability: crate::diagnosis::confidence::FALSE_ALARM_PROBABILITY,
    })
}

/// The verdict on the main shaft.
fn judged(law: ShaftLaw, with_baseline: bool, steady: Option<(f64, Signs)>) -> ComponentDiagnosis {
    let features = window(vec![law], steady);
    let verdicts =
        told(&machine(false), &features, with_baseline, |context| judge(&features, &[], context));
    verdicts.into_iter().find(|c| c.id == "main").unwrap()
}

/// The cause that laws tell in a window of the run up to 50 Hz.
fn cause_in(machine: &Machine, shaft: ShaftIndex, laws: Vec<ShaftLaw>) -> Cause {
    let features = window(laws, None);
    told(machine, &features, true, |context| cause::cause(shaft, Hz(50.0), &features, context))
}

/// State and fault in a window of the run.
fn in_run(b: Complex<f64>, e: Complex<f64>, top_hz: f64) -> (State, Option<FaultMode>) {
    let verdict = judged(run(b, e, top_hz), true, None);
    (verdict.state, verdict.fault)
}

#[test]
fn a_run_names_a_bow_an_unbalance_and_neither() {
    let (small, large) = (polar(1.0, 40.0), polar(5.0, 250.0));
    for top_hz in [35.0, 50.0, 80.0] {
        let bow = in_run(polar(60.0, 40.0), large, top_hz);
        assert_eq!((bow.0.is_accusation(), bow.1), (true, Some(FaultMode::Bow)), "{top_hz}");
        let unbalance = in_run(small, polar(150.0, 250.0), top_hz);
        assert_eq!((unbalance.0.is_accusation(), unbalance.1), (true, Some(FaultMode::Unbalance)));
        assert_eq!(in_run(small, large, top_hz), (State::Healthy, None));
        // At the highest speed e·r² is as large as b: neither leads.
        let r = top_hz / CRITICAL_HZ;
        let both = in_run(polar(60.0, 40.0), polar(60.0 / (r * r), 130.0), top_hz);
        assert_eq!((both.0.is_accusation(), both.1), (true, None));
    }
}

#[test]
fn a_run_that_reaches_too_few_speeds_names_nothing() {
    // From 5 to 9 Hz an eccentricity of 5 mm shows up to 30 µm and a bow of 30 µm as much.
    let verdict = judged(run(polar(30.0, 0.0), polar(2000.0, 180.0), 9.0), true, None);
    assert_eq!(verdict.fault, None, "{}", verdict.why);
}

#[test]
fn without_a_healthy_run_a_changing_speed_stays_undetermined_and_shows_its_parts() {
    let verdict = judged(run(polar(60.0, 40.0), polar(5.0, 0.0), 50.0), false, None);
    assert_eq!((verdict.state, verdict.fault), (State::Undetermined, None));
    assert!(verdict.why.starts_with("the speed changes by 40.0 %"), "{}", verdict.why);
    let bow = verdict.evidence.iter().find(|e| e.indicator == "bow_part_1x").unwrap();
    // 60/(1 − (50/117)²); critical speeds a tenth off fit nearly as well.
    assert!((bow.value / 73.4 - 1.0).abs() < 0.05, "{}", bow.value);
}

#[test]
fn at_its_speed_a_shaft_is_judged_by_the_run_it_made() {
    let at = |b: Complex<f64>, e: Complex<f64>, displacement: f64, higher: f64| {
        let signs =
            Signs { displacement: Some(displacement), higher: Some(higher), ..Signs::HEALTHY };
        judged(run(b, e, 60.0), true, Some((60.0, signs)))
    };
    // At 60 Hz, half the critical speed, one speed alone names nothing.
    let (bow, unbalance) = (polar(60.0, 40.0), polar(150.0, 250.0));
    let small = polar(1.0, 0.0);
    let named = at(bow, small, 40.0, 1.0);
    assert_eq!(named.fault, Some(FaultMode::Bow), "{}", named.why);
    let named = at(small, unbalance, 30.0, 1.0);
    assert_eq!(named.fault, Some(FaultMode::Unbalance), "{}", named.why);
    assert!(named.confidence.unwrap() > 0.8, "a bow is excluded");
    // 2× and 3× rise by as much: something else.
    assert_eq!(at(small, unbalance, 30.0, 30.0).fault, None);
    assert_eq!(at(bow, small, 40.0, 40.0).fault, None);
    let r = 60.0 / CRITICAL_HZ;
    let both = at(bow, polar(60.0 / (r * r), 130.0), 55.0, 1.0);
    assert_eq!((both.state.is_accusation(), both.fault), (true, None), "{}", both.why);
    // 1× is now five times what the run's law says: another thing than was there in the run.
    assert_eq!(at(bow, small, 200.0, 1.0).fault, None);
    // The law names; it does not accuse what is not up.
    assert_eq!(at(bow, small, 1.2, 1.0).state, State::Healthy);
}

#[test]
fn two_probes_that_contradict_each_other_name_nothing() {
    let bow = run(polar(60.0, 40.0), polar(5.0, 0.0), 50.0);
    let unbalance =
        ShaftLaw { channel: ChannelIndex(1), ..run(polar(1.0, 0.0), polar(150.0, 0.0), 50.0) };
    let cause = |shaft, laws| cause_in(&machine(false), shaft, laws);
    assert_eq!(cause(MAIN, vec![bow.clone(), unbalance]), Cause::Both);
    assert_eq!(cause(MAIN, vec![bow.clone()]), Cause::Bow);
    assert_eq!(cause(ShaftIndex(0), vec![bow]), Cause::Open, "not its probe");
}

#[test]
fn a_bow_wants_a_declared_critical_speed_for_above_it_an_unbalance_looks_alike() {
    let mut machine = machine(false);
    machine.shafts[1].first_critical = None;
    let undeclared = |law: ShaftLaw| {
        let vectors: Vec<VectorAt> = (0..24_u32)
            .map(|i| {
                let speed_hz = 5.0 + 45.0 * f64::from(i) / 23.0;
                let fit = &law.law.fits[0];
                let vector = fit.bow.vector + fit.unbalance.vector * run_up::rise(Hz(speed_hz));
                VectorAt { speed_hz, vector, weight: 1.0 }
            })
            .collect();
        ShaftLaw { law: run_up::speed_law(&vectors, Known::Vectors, None).unwrap(), ..law }
    };
    let cause = |law: ShaftLaw| cause_in(&machine, MAIN, vec![undeclared(law)]);
    assert_eq!(cause(run(polar(60.0, 40.0), polar(5.0, 0.0), 50.0)), Cause::Open);
    assert_eq!(cause(run(polar(1.0, 0.0), polar(150.0, 0.0), 50.0)), Cause::Unbalance);
}

#[test]
fn noise_and_a_law_of_another_kind_name_nothing() {
    let read = |vector: &dyn Fn(f64, f64) -> Complex<f64>| {
        let mut state = 77_u64;
        let mut scatter = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 33) as f64 / (1_u64 << 31) as f64 - 0.5
        };
        let vectors: Vec<VectorAt> = (0..24_u32)
            .map(|i| {
                let speed_hz = 5.0 + 2.0 * f64::from(i);
                VectorAt { speed_hz, vector: vector(speed_hz, scatter()), weight: 1.0 }
            })
            .collect();
        let law = run_up::speed_law(&vectors, Known::Vectors, Some(CRITICAL_HZ)).unwrap();
        let law = ShaftLaw { shaft: MAIN, channel: ChannelIndex(0), law };
        cause_in(&machine(false), MAIN, vec![law])
    };
    assert_eq!(read(&|_, noise| polar(10.0, 9000.0 * noise)), Cause::Open);
    // A foundation that resonates at 30 Hz.
    let resonant =
        |f: f64, noise: f64| Complex::new(1.0 - (f / 30.0).powi(2), 0.1).inv() * 20.0 + noise;
    assert_eq!(read(&resonant), Cause::Open);
}

#[test]
fn a_run_without_a_mark_names_by_amplitudes_what_one_with_a_mark_names() {
    let (small, large) = (polar(1.0, 40.0), polar(5.0, 250.0));
    for top_hz in [35.0, 50.0, 80.0] {
        let told = |b, e| judged(run_of(Known::Lengths, (b, e), top_hz), true, None);
        let bow = told(polar(60.0, 40.0), large);
        // To 0.68 of the critical speed, one a tenth off fits lengths nearly as well, with an unbalance beside the bow.
        let named = (top_hz < 80.0).then_some(FaultMode::Bow);
        assert_eq!((bow.state.is_accusation(), bow.fault), (true, named), "{top_hz}: {}", bow.why);
        assert!(bow.why.contains("by amplitudes alone"), "{}", bow.why);
        let unbalance = told(small, polar(150.0, 250.0));
        assert_eq!(unbalance.fault, Some(FaultMode::Unbalance), "{top_hz}: {}", unbalance.why);
        let healthy = told(small, large);
        assert!(!healthy.state.is_accusation(), "{top_hz}: {}", healthy.why);
        let r = top_hz / CRITICAL_HZ;
        let both = told(polar(60.0, 40.0), polar(60.0 / (r * r), 130.0));
        assert_eq!((both.state.is_accusation(), both.fault), (true, None), "{}", both.why);
    }
}
