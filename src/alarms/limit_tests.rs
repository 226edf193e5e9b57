//! Limits: thresholds, hysteresis, votes, speeds, start-up, and their alarms.

use super::limit::LimitJudge;
use super::limit::Measured;
use super::limit::level;
use super::limit::vote;
use super::policy::Observation;
use super::tests::verdict;
use super::*;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::baseline::OperatingPoint;
use crate::diagnosis::baseline::Record;
use crate::diagnosis::baseline::Usual;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::OperatingState;
use crate::features::ChannelFeatures;
use crate::features::Feature;
use crate::machine::alarm_limit::Thresholds;
use crate::machine::file;
use crate::units::Hz;
use crate::units::Unit;
use Observation::{Accused, Healthy, NotJudged};
use proptest::prelude::*;

const W: Option<Level> = Some(Level::Warning);
const D: Option<Level> = Some(Level::Damaged);

/// A machine with two accelerometers at a bearing, a probe and a tacho, and what a test states.
pub(super) fn machine(rest: &str) -> Machine {
    let text = format!(
        "[machine]\nid = 'rig'\niso_group = '2-rigid'\n[[shaft]]\nid = 'main'\nspeed_hz = 10\n\
         [[bearing]]\nid = 'right'\nshaft = 'main'\ncatalogue = 'SKF 6205'\n\
         [[sensor]]\nchannel = 'x'\nkind = 'accelerometer'\nunit = 'm/s^2'\nat = {{ bearing = 'right' }}\n\
         [[sensor]]\nchannel = 'y'\nkind = 'accelerometer'\nunit = 'm/s^2'\nat = {{ bearing = 'right' }}\n\
         [[sensor]]\nchannel = 'z'\nkind = 'accelerometer'\nunit = 'm/s^2'\nat = {{ bearing = 'right' }}\n\
         [[sensor]]\nchannel = 'probe'\nkind = 'proximitor'\nunit = 'V'\nat = {{ shaft = 'main' }}\n{rest}"
    );
    file::parse(&text, "rig.toml").unwrap()
}

const CHANNELS: [&str; 4] = ["x", "y", "z", "probe"];

pub(super) fn channels() -> Vec<ChannelInfo> {
    let info = |name: &str| ChannelInfo {
        name: name.to_owned(),
        sample_rate: Hz(1000.0),
        unit: Unit::MetrePerSecondSquared,
        offset: 0.0,
        unit_conflict: None,
        full_scale: None,
    };
    CHANNELS.map(info).to_vec()
}

/// An engine that raises and returns at once unless a limit says otherwise.
pub(super) fn engine(rest: &str) -> AlarmEngine {
    let settings = Settings { off_delay_s: 0.0, ..Settings::default() };
    AlarmEngine::of_machine(&machine(rest), &channels(), settings)
}

fn feature(name: &str, value: f64, unit: Unit) -> Feature {
    Feature { name: name.into(), value, unit }
}

/// What one window says.
#[derive(Clone)]
pub(super) struct Seen {
    operating: OperatingState,
    speed: Option<Hz>,
    values: Vec<(usize, Feature)>,
    baseline: Baseline,
    absent: Vec<ChannelIndex>,
}

fn seen(values: Vec<(usize, Feature)>) -> Seen {
    Seen {
        operating: OperatingState::Running,
        speed: Some(Hz(10.0)),
        values,
        baseline: Baseline::default(),
        absent: Vec::new(),
    }
}

pub(super) fn velocity(values: &[f64]) -> Seen {
    let unit = Unit::MillimetrePerSecond;
    let feature = |v: &f64| feature("velocity_rms_10_1000_hz", *v, unit);
    seen(values.iter().map(feature).enumerate().collect())
}

impl Seen {
    /// Shows it to an engine; the verdict says nothing.
    pub(super) fn to(&self, engine: &mut AlarmEngine, time_s: f64) -> Vec<EventKind> {
        let channels: Vec<ChannelFeatures> = (0..CHANNELS.len())
            .map(|channel| ChannelFeatures {
                channel: ChannelIndex(channel),
                sample_range: (0, 1),
                values: self
                    .values
                    .iter()
                    .filter(|(of, _)| *of == channel)
                    .map(|(_, feature)| feature.clone())
                    .collect(),
            })
            .filter(|channel| !channel.values.is_empty())
            .collect();
        let measured = Measured {
            operating: self.operating,
            speed: self.speed,
            channels: &channels,
            baseline: &self.baseline,
        };
        let nothing = verdict(State::Undetermined, self.operating);
        let events = engine.observe_window(&nothing, time_s, Some(&measured), &self.absent);
        events.iter().map(|event| event.kind).collect()
    }
}

/// The level of the one alarm whose condition is present.
pub(super) fn stands(engine: &AlarmEngine) -> Option<Level> {
    let standing = engine.standing();
    standing.iter().find(|alarm| alarm.state.is_active()).map(|alarm| alarm.level)
}

/// The levels after each of some windows, 10 s apart.
fn levels(rest: &str, windows: &[Seen]) -> Vec<Option<Level>> {
    let mut engine = engine(rest);
    let mut at = 0.0;
    let step = |window: &Seen| {
        at += 10.0;
        window.to(&mut engine, at);
        stands(&engine)
    };
    windows.iter().map(step).collect()
}

pub(super) const VELOCITY: &str =
    "[[limits.alarm]]\nid = 'v'\nkind = 'velocity_rms'\nchannels = ['x']\n";

#[test]
fn zones_of_the_group_are_the_limits_and_a_boundary_is_on_the_better_side() {
    // Group 2 rigid: 2.8 and 4.5 mm/s; hysteresis 5 %: 2.66 and 4.275.
    let windows = [2.8, 2.81, 2.67, 2.65, 4.6, 4.3, 4.2, 2.6].map(|v| velocity(&[v]));
    assert_eq!(levels(VELOCITY, &windows), [None, W, W, None, D, D, W, None]);
}

#[test]
fn a_known_level_sets_the_warning_by_the_standards_rule() {
    let stated = format!("{VELOCITY}baseline_mm_per_s = 0.9\nhysteresis_percent = 0\n");
    let windows = [1.59, 1.61, 4.51].map(|v| velocity(&[v]));
    assert_eq!(levels(&stated, &windows), [None, W, D], "0.9 + 0.7 = 1.6; C/D 4.5");
}

#[test]
fn votes_are_counted_over_channels_and_what_is_absent_has_none() {
    let stated =
        "[[limits.alarm]]\nid = 'v'\nkind = 'velocity_rms'\nvotes = 2\nhysteresis_percent = 0\n";
    let windows = [
        velocity(&[3.0, 1.0, 1.0]),
        velocity(&[3.0, 3.0, 1.0]),
        velocity(&[5.0, 3.0, 1.0]),
        velocity(&[5.0, 3.0, 5.0]),
        velocity(&[5.0]),      // the other two are absent and could decide
        velocity(&[1.0, 1.0]), // the third cannot
    ];
    assert_eq!(levels(stated, &windows), [None, W, W, D, D, None]);
}

#[test]
fn every_vote_of_three_has_its_place() {
    let (w, d) = (Accused(Level::Warning), Accused(Level::Damaged));
    for (observed, expected) in [
        ([Healthy, Healthy, Healthy], [Healthy, Healthy, Healthy]),
        ([w, Healthy, Healthy], [w, Healthy, Healthy]),
        ([w, d, Healthy], [d, w, Healthy]),
        ([d, d, d], [d, d, d]),
        ([NotJudged, w, Healthy], [w, NotJudged, Healthy]),
        ([NotJudged, Healthy, Healthy], [NotJudged, Healthy, Healthy]),
        ([NotJudged, NotJudged, d], [d, NotJudged, NotJudged]),
    ] {
        for (votes, expected) in (1..=3).zip(expected) {
            assert_eq!(vote(observed.into_iter(), votes), expected, "{votes} of {observed:?}");
        }
    }
    assert_eq!(vote(std::iter::empty(), 1), NotJudged);
}

#[test]
fn a_gap_has_limits_on_both_sides_and_is_judged_at_standstill() {
    let stated = "[[limits.alarm]]\nid = 'gap'\nkind = 'gap'\nunit = 'V'\nwarning_above = -9.0\n\
                  damaged_above = -8.0\nwarning_below = -11.0\ndamaged_below = -12.0\n\
                  hysteresis_percent = 0\n";
    let gap = |v: f64| Seen {
        operating: OperatingState::Stopped,
        ..seen(vec![(3, feature("mean", v, Unit::Volt))])
    };
    let windows = [-10.0, -8.9, -7.9, -11.1, -12.1, -9.0].map(gap);
    assert_eq!(levels(stated, &windows), [None, W, D, W, D, None]);
    let mut engine = engine(stated);
    gap(-7.0).to(&mut engine, 10.0);
    let alarm = &engine.standing()[0];
    assert_eq!((alarm.kind, alarm.component.as_str()), (ComponentKind::Shaft, "main"));
    assert_eq!(alarm.source, AlarmSource::Limit("gap".to_owned()));
    assert_eq!(
        alarm.why,
        "limit `gap`: -7.0000 V in probe (limits: above -9.0000, -8.0000; below -12.0000, -11.0000)"
    );
}

#[test]
fn hysteresis_is_a_part_of_the_limits_size_on_either_side() {
    let gap = Thresholds {
        warning_above: Some(-9.0),
        warning_below: Some(-11.0),
        ..Thresholds::default()
    };
    // 10 % of 9 and 11: an alarm above ends at −9.9, one below at −9.9 too.
    for (was, value, expected) in
        [(None, -9.1, None), (W, -9.8, W), (W, -9.95, W), (None, -10.9, None), (None, -9.95, None)]
    {
        assert_eq!(level(value, &gap, 1.0, 0.1, was), expected, "{value}");
    }
}

#[test]
fn orders_bands_and_the_rest_without_1x_are_values_of_their_own() {
    let stated = "[[limits.alarm]]\nid = 'o'\nkind = 'order'\norder = 0.5\nunit = 'm/s^2'\n\
                  channels = ['x']\nwarning_above = 1.0\n\
                  [[limits.alarm]]\nid = 'b'\nkind = 'band'\nband_hz = [100, 250]\nunit = 'g'\n\
                  channels = ['y']\ndamaged_above = 1.0\n\
                  [[limits.alarm]]\nid = 'n'\nkind = 'not_1x'\nunit = 'm/s^2'\nchannels = ['z']\n\
                  warning_above = 1.0\n";
    let unit = Unit::MetrePerSecondSquared;
    let window = |half: f64, band: f64, rms: f64| {
        seen(vec![
            (0, feature("line_0.5x_main", half, unit)),
            (1, feature("rms_100_250_hz", band, unit)),
            (2, feature("rms", rms, unit)),
            (2, feature("line_1x_main", 2.0, unit)),
        ])
    };
    let mut engine = engine(stated);
    // √(1.7² − 2²/2) = 0.94; √(1.8² − 2) = 1.11; 1 g is 9.80665 m/s².
    window(0.9, 9.8, 1.7).to(&mut engine, 10.0);
    assert!(engine.standing().is_empty());
    window(1.1, 9.81, 1.8).to(&mut engine, 20.0);
    let raised: Vec<_> = engine.standing().into_iter().map(|a| (a.source, a.level)).collect();
    let limit = |id: &str| AlarmSource::Limit(id.to_owned());
    let (warning, damaged) = (Level::Warning, Level::Damaged);
    let expected = [(limit("n"), warning), (limit("b"), damaged), (limit("o"), warning)];
    assert_eq!(raised, expected);
    assert_eq!(engine.standing()[0].component, "right");
}

#[test]
fn a_ratio_to_the_baseline_and_a_change_from_a_reference_count_either_way() {
    let record = |value: f64| Record {
        name: "healthy".to_owned(),
        point: OperatingPoint { speed: Some(Hz(10.0)), load: None },
        usual: [(("x".to_owned(), "kurtosis".to_owned()), Usual::of_value(value))].into(),
        ..Record::default()
    };
    let stated = "[[limits.alarm]]\nid = 'k'\nkind = 'feature'\nfeature = 'kurtosis'\n\
                  relative_to = 'baseline'\nchannels = ['x']\nwarning_above = 2.0\n";
    let kurtosis = |v: f64| Seen {
        baseline: Baseline { records: vec![record(3.0)], provisional: false },
        ..seen(vec![(0, feature("kurtosis", v, Unit::One))])
    };
    assert_eq!(levels(stated, &[kurtosis(5.9), kurtosis(6.1)]), [None, W]);
    let without = Seen { baseline: Baseline::default(), ..kurtosis(9.0) };
    assert_eq!(levels(stated, &[without]), [None], "nothing to compare with: not judged");
    // A quarter of B/C = 2.8 mm/s, up or down.
    let stated = "[[limits.alarm]]\nid = 'c'\nkind = 'velocity_change'\nreference_mm_per_s = 2.0\n\
                  channels = ['x']\nhysteresis_percent = 0\n";
    let windows = [2.69, 2.71, 1.31, 1.29].map(|v| velocity(&[v]));
    assert_eq!(levels(stated, &windows), [None, W, None, W]);
}

#[test]
fn a_vector_may_change_though_its_size_falls() {
    // 3 at 40° to 2.5 at 180° is a change of 5.17 (ISO 20816-1's example, mm/s).
    let stated = |limit: f64| {
        format!(
            "[[limits.alarm]]\nid = 'c'\nkind = 'vector_change'\nreference = 3.0\n\
             reference_phase_deg = 40\nunit = 'm/s^2'\nchannels = ['x']\nwarning_above = {limit}\n"
        )
    };
    let unit = Unit::MetrePerSecondSquared;
    let vector = |amplitude: f64, degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        seen(vec![
            (0, feature("vector_1x_cos", amplitude * cos, unit)),
            (0, feature("vector_1x_sin", amplitude * sin, unit)),
        ])
    };
    assert_eq!(levels(&stated(5.16), &[vector(3.0, 40.0), vector(2.5, 180.0)]), [None, W]);
    assert_eq!(levels(&stated(5.18), &[vector(2.5, 180.0)]), [None]);
}

#[test]
fn limits_may_depend_on_speed_and_state() {
    let stated = "[[limits.alarm]]\nid = 'v'\nkind = 'velocity_rms'\nchannels = ['x']\n\
                  by_speed = [[5, 15, 1.0, 2.0], [15, 30, 3.0, 4.0]]\nhysteresis_percent = 0\n";
    let at = |speed: f64, v: f64| Seen { speed: Some(Hz(speed)), ..velocity(&[v]) };
    let transient = Seen { operating: OperatingState::Transient, ..at(10.0, 0.1) };
    let windows = [at(10.0, 1.5), at(15.0, 1.5), at(15.0, 3.5), at(40.0, 9.0), transient];
    assert_eq!(levels(stated, &windows), [W, None, W, W, W], "what is not judged holds");
}

#[test]
fn a_start_up_multiplies_only_where_it_is_declared_and_as_long() {
    let stated = "[limits.startup]\nspeed_hz = [5, 40]\nmax_s = 20\n[[limits.alarm]]\nid = 'v'\n\
                  kind = 'velocity_rms'\nchannels = ['x']\nstartup_multiply = 3\n\
                  states = ['running', 'transient']\nhysteresis_percent = 0\n";
    let at = |operating, speed: f64| Seen { operating, speed: Some(Hz(speed)), ..velocity(&[5.0]) };
    let transient = |speed| at(OperatingState::Transient, speed);
    // 5 mm/s: above C/D 4.5, below 3 × 2.8.
    let windows = [transient(10.0), transient(20.0), transient(30.0), transient(35.0)];
    assert_eq!(levels(stated, &windows), [None, None, None, D], "30 s after its begin");
    assert_eq!(levels(stated, &[transient(50.0)]), [D], "not declared for this speed");
    assert_eq!(levels(stated, &[at(OperatingState::Running, 20.0)]), [D], "no transient");
}

#[test]
fn and_and_or_of_conditions_are_votes_of_limits() {
    let stated = |votes: u32| {
        format!(
            "[[limits.alarm]]\nid = 'a'\nkind = 'velocity_rms'\nchannels = ['x']\nraises_alarm = false\n\
             [[limits.alarm]]\nid = 'b'\nkind = 'velocity_rms'\nchannels = ['y']\nraises_alarm = false\n\
             [[limits.alarm]]\nid = 'both'\nkind = 'vote'\nof = ['a', 'b']\nvotes = {votes}\n"
        )
    };
    let windows = [velocity(&[3.0, 1.0]), velocity(&[3.0, 5.0]), velocity(&[1.0, 1.0])];
    assert_eq!(levels(&stated(2), &windows), [None, W, None], "AND");
    assert_eq!(levels(&stated(1), &windows), [W, D, None], "OR");
}

#[test]
fn delays_and_latching_are_the_limits_own() {
    let stated = format!("{VELOCITY}on_delay_s = 10\noff_delay_s = 20\nlatching = true\n");
    let mut engine = engine(&stated);
    let mut play = |v: f64, time_s: f64| velocity(&[v]).to(&mut engine, time_s);
    assert_eq!(play(5.0, 10.0), []);
    assert_eq!(play(5.0, 20.0), [EventKind::Raised]);
    assert_eq!(play(3.0, 30.0), []);
    assert_eq!(play(3.0, 50.0), [], "a latching alarm keeps its highest level");
    let author = || ("a".to_owned(), String::new());
    let act = |engine: &mut AlarmEngine, action| {
        let (author, comment) = author();
        engine.act(&Act { alarm: 1, action, author, comment }, Moment::of_stream(55.0))
    };
    assert!(act(&mut engine, Action::Reset).is_err(), "still present");
    let mut play = |v: f64, time_s: f64| velocity(&[v]).to(&mut engine, time_s);
    assert_eq!(play(1.0, 60.0), []);
    assert_eq!(play(1.0, 70.0), []);
    assert_eq!(play(1.0, 80.0), [EventKind::Returned]);
    act(&mut engine, Action::Acknowledge).unwrap();
    let standing = engine.standing();
    assert_eq!((standing[0].state, standing[0].level), (AlarmState::Latched, Level::Damaged));
    act(&mut engine, Action::Reset).unwrap();
    assert!(engine.standing().is_empty());
}

#[test]
fn an_uncalibrated_or_missing_channel_is_not_judged_and_clears_nothing() {
    let mut engine = engine(VELOCITY);
    velocity(&[5.0]).to(&mut engine, 10.0);
    let volts = seen(vec![(0, feature("velocity_rms_10_1000_hz", 0.0, Unit::Volt))]);
    for (n, window) in [volts, seen(Vec::new()), velocity(&[f64::NAN])].iter().enumerate() {
        assert_eq!(window.to(&mut engine, 20.0 + n as f64), []);
        assert_eq!(stands(&engine), D);
    }
}

#[test]
fn a_channel_that_stays_away_is_an_alarm_and_its_coming_back_proves_nothing_else() {
    let mut engine = engine(VELOCITY);
    velocity(&[5.0, 1.0]).to(&mut engine, 10.0);
    let without = Seen { absent: vec![ChannelIndex(1)], ..velocity(&[5.0]) };
    let mut events = Vec::new();
    for time_s in [20.0, 25.0, 30.0, 35.0] {
        events.extend(without.to(&mut engine, time_s));
    }
    // First missed at 20 s; `missing_after_s` is 10 s.
    assert_eq!(events, [EventKind::Raised]);
    let missing = &engine.standing()[0];
    assert_eq!((missing.component.as_str(), missing.kind), ("y", ComponentKind::Sensor));
    assert_eq!(missing.source, AlarmSource::Data);
    assert_eq!(velocity(&[5.0, 1.0]).to(&mut engine, 40.0), [EventKind::Returned]);
    assert_eq!(stands(&engine), D, "the limit's alarm still stands");
}

#[test]
fn a_level_belongs_to_its_sensor_whatever_channels_a_stream_has() {
    let machine = machine(
        "[[limits.alarm]]\nid = 'v'\nkind = 'velocity_rms'\nchannels = ['x', 'y', 'z']\nwarning_above = 10.0\ndamaged_above = 20.0\n\
         hysteresis_percent = 10\n",
    );
    let of = |names: [&str; 2]| {
        let channels: Vec<ChannelInfo> = names
            .iter()
            .flat_map(|n| channels().into_iter().filter(move |c| c.name == **n))
            .collect();
        LimitJudge::new(&machine, &machine.alarm_limits.limits[0], &channels)
    };
    let observe = |judge: &mut LimitJudge, values: [f64; 2]| {
        let value = |(i, v): (usize, f64)| ChannelFeatures {
            channel: ChannelIndex(i),
            sample_range: (0, 1),
            values: vec![feature("velocity_rms_10_1000_hz", v, Unit::MillimetrePerSecond)],
        };
        let channels: Vec<ChannelFeatures> = values.into_iter().enumerate().map(value).collect();
        let measured = Measured {
            operating: OperatingState::Running,
            speed: Some(Hz(10.0)),
            channels: &channels,
            baseline: &Baseline::default(),
        };
        judge.observe(&measured, false, &[])
    };
    let mut first = of(["x", "y"]);
    assert_eq!(observe(&mut first, [11.0, 5.0]), Accused(Level::Warning));
    // The stream goes on without `x` and with `z`: 9.5 lies within the hysteresis of who was above, which nobody here was.
    let mut other = of(["y", "z"]);
    assert!(other.resume(&first.levels()));
    assert_eq!(observe(&mut other, [9.5, 9.5]), Healthy);
    // `x` comes back: it was above, and is not below the hysteresis.
    let mut back = of(["x", "y"]);
    assert!(back.resume(&other.levels()));
    assert_eq!(observe(&mut back, [9.5, 9.5]), Accused(Level::Warning));
    assert_eq!(observe(&mut back, [8.9, 9.5]), Healthy);
    assert!(!back.resume(&[None; 2]), "of another limit");
}

#[test]
fn a_limits_alarm_goes_on_after_a_restart() {
    let mut before = engine(VELOCITY);
    velocity(&[3.0]).to(&mut before, 10.0);
    let kept = Kept { alarms: before.standing(), last_id: 1, last_sequence: 1, ..Kept::default() };
    let mut after = engine(VELOCITY);
    assert!(after.restore(kept.clone(), Moment::of_stream(0.0)).is_empty());
    assert_eq!(velocity(&[3.0]).to(&mut after, 20.0), []);
    assert_eq!(velocity(&[5.0]).to(&mut after, 30.0), [EventKind::Escalated]);
    // Without the limit it is over.
    let mut gone = engine("");
    assert_eq!(gone.restore(kept, Moment::of_stream(0.0)).len(), 1);
}

#[test]
fn a_source_that_cannot_be_opened_clears_nothing_and_what_is_gone_from_the_file_does() {
    let mut before = engine(VELOCITY);
    let absent = Seen { absent: vec![ChannelIndex(1)], ..velocity(&[3.0]) };
    absent.to(&mut before, 10.0);
    absent.to(&mut before, 20.0);
    before.observe(&verdict(State::Warning, OperatingState::Running), 30.0);
    let kept = Kept { alarms: before.standing(), last_id: 3, last_sequence: 3, ..Kept::default() };
    assert_eq!(kept.alarms.len(), 3, "of a limit, of a channel, of the bearing `right`");
    let without_stream = |machine: &Machine| {
        let mut engine = AlarmEngine::of_machine(machine, &[], Settings::default());
        let events = engine.restore(kept.clone(), Moment::of_stream(0.0));
        (events.len(), engine.standing().iter().filter(|alarm| alarm.state.is_active()).count())
    };
    assert_eq!(without_stream(&machine(VELOCITY)), (0, 3));
    let other = "[machine]\nid = 'rig'\n[[shaft]]\nid = 'main'\nspeed_hz = 10\n";
    assert_eq!(without_stream(&file::parse(other, "rig.toml").unwrap()), (3, 0));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Hysteresis only ever holds what was reached: with it the level is at least that without, and at
    /// most the one before or that without.
    #[test]
    fn hysteresis_holds_and_never_raises(
        values in prop::collection::vec(-20.0_f64..20.0, 1..50),
        hysteresis in 0.0_f64..0.9,
    ) {
        let thresholds = Thresholds {
            warning_above: Some(5.0),
            damaged_above: Some(10.0),
            warning_below: Some(-5.0),
            damaged_below: Some(-10.0),
        };
        let mut was = None;
        for value in values {
            let now = level(value, &thresholds, 1.0, hysteresis, was);
            let without = level(value, &thresholds, 1.0, 0.0, None);
            prop_assert!(now >= without && now <= without.max(was));
            was = now;
        }
    }
}
