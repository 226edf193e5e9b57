//! 2× and 3× that rise while 1× does not.

use super::tests::Signs;
use super::tests::by_tacho;
use super::tests::channels;
use super::tests::judged_against;
use super::tests::judged_with;
use super::tests::machine;
use super::tests::of;
use super::tests::window;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::features::ChannelFeatures;
use crate::features::Feature;
use crate::features::WindowFeatures;
use crate::features::speed::Speed;
use crate::features::speed::SpeedSource;
use crate::machine::Machine;
use crate::machine::ShaftIndex;
use crate::machine::motor::Motor;
use crate::machine::sensor::SensorKind;
use crate::signal::ChannelIndex;
use crate::units::Hz;
use crate::units::Unit;
use std::sync::Arc;

/// A shaft without gear and probe, and how it is heard.
struct Heard {
    machine: Machine,
    first: Hz,
    /// Power of its 2× over the noise.
    over_noise: f64,
    /// Of the speed.
    source: SpeedSource,
    confidence: f64,
}

impl Heard {
    fn by(kind: SensorKind) -> Self {
        let mut machine = machine(false);
        machine.sensors[1].kind = kind;
        let (first, source) = (Hz(10.0), SpeedSource::Tacho);
        Self { machine, first, over_noise: 1000.0, source, confidence: 1.0 }
    }

    fn features(lines: [f64; 3]) -> Vec<ChannelFeatures> {
        let names = ["line_1x_main", "line_2x_main", "line_3x_main"].into_iter().zip(lines);
        let rest = ("rms_beside_shafts", 1.0);
        let feature =
            |(name, value): (&str, f64)| Feature { name: Arc::from(name), value, unit: Unit::One };
        let values = names.chain([rest]).map(feature).collect();
        vec![ChannelFeatures { channel: ChannelIndex(1), sample_range: (0, 1), values }]
    }

    /// The verdict on the shaft by 1×, 2× and 3×, in good health and now.
    fn judged(&self, healthy: [f64; 3], now: [f64; 3]) -> ComponentDiagnosis {
        let (source, confidence) = (Some(self.source), self.confidence);
        let speed = Speed { source, confidence, ..by_tacho(self.first) };
        let mut features = WindowFeatures { speed, ..window(Self::features(now)) };
        for line in features.shaft_lines.iter_mut().filter(|line| line.order == 2) {
            line.power_ratio = self.over_noise;
        }
        judged_against(&self.machine, &channels(), Self::features(healthy), &features)
    }
}

#[test]
fn a_second_harmonic_that_rises_by_itself_accuses_without_a_cause() {
    for kind in [SensorKind::Accelerometer, SensorKind::Velocity] {
        let shaft = Heard::by(kind).judged([1.0, 0.5, 0.1], [1.1, 4.0, 0.1]);
        assert_eq!((shaft.state, shaft.fault), (State::Warning, None), "{}", shaft.why);
        assert!(
            shaft.why.starts_with("2× on the housing is 8.0 times its baseline"),
            "{}",
            shaft.why
        );
        assert!(shaft.why.ends_with("cause not proven"), "{}", shaft.why);
        let evidence = shaft.evidence.iter().find(|e| e.order == Some(2.0)).unwrap();
        assert!((evidence.frequency.unwrap().0 - 20.0).abs() < 1e-12);
    }
    let third = Heard::by(SensorKind::Accelerometer).judged([1.0, 0.1, 0.5], [1.1, 0.1, 4.0]);
    assert!(third.why.starts_with("3× on the housing"), "{}", third.why);
}

#[test]
fn one_that_is_small_or_noise_or_the_mains_accuses_nobody() {
    let accelerometer = || Heard::by(SensorKind::Accelerometer);
    let state = |heard: Heard, healthy, now| heard.judged(healthy, now).state;
    // Ten times what it was, and 0.4/2 of 1× as velocity: a fifth; as a velocity itself it is two fifths.
    let (before, small) = ([1.0, 0.04, 0.1], [1.0, 0.4, 0.1]);
    assert_eq!(state(accelerometer(), before, small), State::Healthy);
    assert_eq!(state(Heard::by(SensorKind::Velocity), before, small), State::Warning);
    let (before, large) = ([1.0, 0.5, 0.1], [1.0, 4.0, 0.1]);
    assert_eq!(state(Heard { over_noise: 5.0, ..accelerometer() }, before, large), State::Healthy);
    // 2× of 25.02 Hz lies within 0.2 Hz + 0.2 % of 50 Hz; that of 24 Hz does not.
    assert_eq!(state(Heard { first: Hz(25.02), ..accelerometer() }, before, large), State::Healthy);
    assert_eq!(state(Heard { first: Hz(24.0), ..accelerometer() }, before, large), State::Warning);
    let written = Heard { source: SpeedSource::Machine, confidence: 0.5, ..accelerometer() };
    assert_eq!(state(written, before, large), State::Healthy, "read beside the line, perhaps");
}

#[test]
fn the_field_of_a_synchronous_motor_accuses_no_shaft() {
    // Of four poles at 12.5 Hz: fed with 25 Hz, which is 2×.
    let state = |poles: u32| {
        let mut heard = Heard { first: Hz(12.5), ..Heard::by(SensorKind::Accelerometer) };
        let shaft = heard.machine.shafts.iter().position(|shaft| shaft.id == "main").unwrap();
        let shaft = ShaftIndex(shaft);
        heard.machine.motors =
            vec![Motor { shaft, poles, line_frequency: None, synchronous: true }];
        heard.judged([1.0, 0.5, 0.1], [1.1, 4.0, 0.1]).state
    };
    assert_eq!((state(4), state(6)), (State::Healthy, State::Warning));
}

#[test]
fn velocity_tells_of_1x_as_acceleration_does() {
    let heard = Heard::by(SensorKind::Velocity);
    let unbalance = heard.judged([1.0, 0.1, 0.1], [8.0, 1.0, 1.0]);
    assert_eq!(unbalance.fault, Some(FaultMode::Unbalance), "{}", unbalance.why);
    // A quarter of 1×, and ten times what it was: of a velocity as much as that of the shaft's motion.
    assert_eq!(heard.judged([1.0, 0.2, 0.1], [8.0, 2.0, 0.1]).fault, None);
}

#[test]
fn what_a_shaft_of_another_speed_may_do_accuses_nobody() {
    // 2× of the shaft is 1× of one that turns twice as fast, or 6× of one that turns a third as fast.
    for (ratio, state) in
        [(2.0, State::Healthy), (1.0 / 3.0, State::Healthy), (2.3, State::Warning)]
    {
        let mut heard = Heard::by(SensorKind::Accelerometer);
        let other = heard.machine.shafts.iter().position(|shaft| shaft.id != "main").unwrap();
        heard.machine.shafts[other].ratio_to_first = Some(ratio);
        let shaft = heard.judged([1.0, 0.5, 0.1], [1.1, 4.0, 0.1]);
        assert_eq!(shaft.state, state, "{ratio}: {}", shaft.why);
    }
}

/// The verdict on the probed shaft where 2× and 3× are so many times as large as they were.
fn probed(displacement: f64, higher: f64, with_gear: bool) -> ComponentDiagnosis {
    let local = with_gear.then_some(1.0);
    let (displacement, higher) = (Some(displacement), Some(higher));
    let signs = Signs { displacement, higher, local, ..Signs::HEALTHY };
    of(&judged_with(signs, with_gear, true, Vec::new()), "main").clone()
}

#[test]
fn a_probe_that_sees_2x_rise_accuses_unless_a_gear_may_do_it() {
    let alone = probed(1.0, 5.0, false);
    assert_eq!((alone.state, alone.fault), (State::Warning, None), "{}", alone.why);
    assert!(alone.why.contains("× displacement is 5.0 times its baseline"), "{}", alone.why);
    let geared = probed(1.0, 5.0, true);
    assert_eq!(geared.state, State::Undetermined, "{}", geared.why);
    assert!(geared.why.ends_with("so may its gear: not accused"), "{}", geared.why);
    assert!(geared.evidence.iter().any(|e| e.order == Some(2.0) || e.order == Some(3.0)));
    assert_eq!(probed(1.0, 2.5, false).state, State::Healthy);
}

#[test]
fn no_bow_is_named_by_its_size_where_2x_rose_with_it() {
    assert_eq!(probed(200.0, 1.0, true).fault, Some(FaultMode::Bow));
    let with_others = probed(200.0, 150.0, true);
    assert_eq!(
        (with_others.state, with_others.fault),
        (State::Damaged, None),
        "{}",
        with_others.why
    );
}
