//! With the limits that were in force the rerun raises what was raised; with others, what they would.

use super::history::Answer;
use super::history::Question;
use super::history::What;
use super::history::ask;
use crate::alarms::Act;
use crate::alarms::Action;
use crate::alarms::AlarmEngine;
use crate::alarms::AlarmEvent;
use crate::alarms::Moment;
use crate::alarms::Settings;
use crate::alarms::limit::Measured;
use crate::alarms::past::PastStream;
use crate::alarms::past::PastWindow;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::baseline::OperatingPoint;
use crate::diagnosis::baseline::Record;
use crate::diagnosis::baseline::Usual;
use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::BaselineUse;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::diagnosis::verdict::Coverage;
use crate::diagnosis::verdict::DataQuality;
use crate::diagnosis::verdict::Diagnosis;
use crate::diagnosis::verdict::OperatingState;
use crate::features::ChannelFeatures;
use crate::features::Feature;
use crate::machine::Machine;
use crate::machine::file;
use crate::signal::ChannelIndex;
use crate::signal::ChannelInfo;
use crate::signal::Timestamp;
use crate::store::Archive;
use crate::store::Batch;
use crate::store::StateStore;
use crate::store::StreamKey;
use crate::store::sqlite;
use crate::store::trends::Minute;
use crate::store::trends::Retention;
use crate::store::trends::SqliteTrendArchive;
use crate::store::trends::SqliteTrends;
use crate::store::trends::TrendStore;
use crate::units::Hz;
use crate::units::Unit;
use rand::RngExt;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use std::collections::BTreeMap;
use std::sync::Arc;
use tempfile::TempDir;

const START: Timestamp = Timestamp(1_795_341_600_000_000_000);
const HOP_S: f64 = 5.0;

fn machine(limits: &str) -> Arc<Machine> {
    let text = format!(
        "[machine]\nid = 'm'\n[[shaft]]\nid = 'main'\nspeed_hz = 10\n\
         [[bearing]]\nid = 'right'\nshaft = 'main'\nelements = 11\nelement_diameter_mm = 7.9375\n\
         pitch_diameter_mm = 33.5\n\
         [[sensor]]\nchannel = 'x'\nkind = 'accelerometer'\nunit = 'm/s^2'\nat = {{ bearing = 'right' }}\n\
         [[sensor]]\nchannel = 'y'\nkind = 'accelerometer'\nunit = 'm/s^2'\nat = {{ bearing = 'right' }}\n{limits}"
    );
    Arc::new(file::parse(&text, "m.toml").unwrap())
}

const LIMITS: &str = "
[[limits.alarm]]
id = 'rms'
kind = 'feature'
feature = 'rms'
warning_above = 1.0
damaged_above = 2.0
on_delay_s = 10.0
off_delay_s = 20.0
[[limits.alarm]]
id = 'crest'
kind = 'feature'
feature = 'crest'
channels = ['x']
warning_above = 4.0
latching = true
[[limits.alarm]]
id = 'both'
kind = 'vote'
of = ['rms', 'crest']
votes = 2
";

fn channels() -> Vec<ChannelInfo> {
    ["x", "y"]
        .map(|name| ChannelInfo {
            name: name.to_owned(),
            sample_rate: Hz(1000.0),
            unit: Unit::MetrePerSecondSquared,
            offset: 0.0,
            unit_conflict: None,
            full_scale: None,
        })
        .to_vec()
}

/// A machine's life: levels that wander, verdicts, channels that stay away, gaps, stops.
struct Life {
    random: Pcg64,
    rms: f64,
    time_s: f64,
}

impl Life {
    fn window(&mut self) -> (Diagnosis, Vec<ChannelFeatures>, Vec<ChannelIndex>) {
        let random = &mut self.random;
        self.time_s += if random.random_bool(0.02) { 60.0 } else { HOP_S };
        self.rms = (self.rms * (0.6 * (random.random::<f64>() - 0.5)).exp()).clamp(0.2, 4.0);
        let feature = |name: &str, value: f64, unit| Feature { name: name.into(), value, unit };
        let mut measured = Vec::new();
        let mut absent = Vec::new();
        for channel in 0..2 {
            if random.random_bool(0.1) {
                absent.push(ChannelIndex(channel));
                continue;
            }
            let rms = self.rms * (1.0 + 0.2 * random.random::<f64>());
            let crest = 3.0 + 1.5 * random.random::<f64>();
            let values = vec![
                feature("rms", rms, Unit::MetrePerSecondSquared),
                feature("crest", crest, Unit::One),
            ];
            let channel = ChannelIndex(channel);
            measured.push(ChannelFeatures { channel, sample_range: (0, 1), values });
        }
        let severity = random.random::<f64>();
        let (state, fault) = match random.random_range(0..10) {
            0 => (State::Undetermined, None),
            1..7 if severity < 0.6 => (State::Healthy, None),
            1..8 => (State::Warning, Some(FaultMode::InnerRace)),
            _ => (State::Damaged, Some(FaultMode::OuterRace)),
        };
        let known = (state != State::Undetermined).then_some(severity);
        let component = ComponentDiagnosis {
            state,
            fault,
            severity: known,
            confidence: known.map(|s| 0.5 + 0.4 * s),
            ..ComponentDiagnosis::undetermined(
                "right",
                ComponentKind::Bearing,
                format!("{severity}"),
            )
        };
        let operating = match random.random_range(0..20) {
            0 => OperatingState::Stopped,
            1 => OperatingState::Transient,
            _ => OperatingState::Running,
        };
        (diagnosis(component, operating), measured, absent)
    }
}

fn diagnosis(component: ComponentDiagnosis, operating_state: OperatingState) -> Diagnosis {
    Diagnosis {
        machine: "m".to_owned(),
        duration_s: 10.0,
        samples_used: 0,
        samples_rejected: 0,
        rejected_because: Vec::new(),
        shaft_speed: Some(Hz(10.0)),
        shaft_speeds: Vec::new(),
        speed_source: None,
        speed_confidence: 1.0,
        operating_state,
        state: component.state,
        coverage: Coverage::default(),
        data_quality: DataQuality::Ok,
        components: vec![component],
        warnings: Vec::new(),
        notes: Vec::new(),
        baselines: Vec::new(),
        provisional_baseline: None,
        timeline: None,
        first_warning_s: None,
        first_damaged_s: None,
        sample_ranges: Vec::new(),
    }
}

/// A live stream, judged by one configuration.
fn key(start: Timestamp) -> StreamKey {
    let judged_by = Some("limits".to_owned());
    StreamKey { identity: None, start: Some(start), judged_by }
}

/// Lives `n` windows through the engine of the daemon; everything is stored.
struct Lived {
    folder: TempDir,
    raised: Vec<AlarmEvent>,
    end_s: f64,
}

fn live(machine: &Arc<Machine>, settings: &Settings, n: usize, with_acts: bool) -> Lived {
    let folder = TempDir::new().unwrap();
    let (mut state, _) = sqlite::open(folder.path()).unwrap();
    let mut trends = SqliteTrends::open(folder.path(), Retention::default()).unwrap();
    let channels = channels();
    let mut engine = AlarmEngine::of_machine(machine, &channels, settings.clone());
    let stream = Arc::new(PastStream {
        machine: "m".to_owned(),
        name: "live 1".to_owned(),
        start: Some(START),
        begun: START,
        channels: channels.iter().map(|channel| channel.name.clone()).collect(),
    });
    let mut life = Life { random: Pcg64::seed_from_u64(20261122), rms: 0.5, time_s: 0.0 };
    let (mut minutes, mut raised): (Vec<Minute>, Vec<AlarmEvent>) = (Vec::new(), Vec::new());
    for place in 0..n {
        let (diagnosis, features, absent) = life.window();
        let baseline = Baseline::default();
        let measured = Measured {
            operating: diagnosis.operating_state,
            speed: diagnosis.shaft_speed,
            channels: &features,
            baseline: &baseline,
        };
        let mut events = engine.observe_window(&diagnosis, life.time_s, Some(&measured), &absent);
        let now = Moment {
            stream_s: life.time_s + 1.0,
            monotonic_s: life.time_s,
            utc: START.plus_seconds(life.time_s + 1.0),
        };
        if with_acts && place % 7 == 0 {
            for alarm in engine.standing() {
                let action = if place % 2 == 0 { Action::Acknowledge } else { Action::Reset };
                let (author, comment) = ("M. Ito".to_owned(), String::new());
                let act = Act { alarm: alarm.id, action, author, comment };
                events.extend(engine.act(&act, now).map(|(_, events)| events).unwrap_or_default());
            }
        }
        let minute = Minute::of(&stream, life.time_s);
        if minutes.last().is_none_or(|last| last.minute != minute) {
            minutes.push(Minute::new(Arc::clone(&stream), minute));
        }
        let window = PastWindow::of(&diagnosis, life.time_s, &absent, START);
        minutes.last_mut().unwrap().push(window, &features);
        raised.extend(events.iter().cloned());
        state
            .keep(&[Batch {
                stream: key(START),
                now,
                judged_until_s: engine.judged_until_s(),
                decisions: Some(engine.decisions()),
                ..Batch::new("m", events)
            }])
            .unwrap();
    }
    trends.keep(&minutes, START).unwrap();
    Lived { folder, raised, end_s: life.time_s }
}

fn rerun(lived: &Lived, machine: &Arc<Machine>, settings: &Settings, span_s: (f64, f64)) -> Answer {
    let archive = sqlite::read_only(lived.folder.path()).unwrap().unwrap();
    let question = Question {
        machine: Arc::clone(machine),
        settings: settings.clone(),
        span: (START.plus_seconds(span_s.0), START.plus_seconds(span_s.1)),
        records: BTreeMap::new(),
    };
    let trends = SqliteTrendArchive::new(lived.folder.path());
    ask(&question, &archive, &trends).unwrap()
}

#[test]
fn unchanged_limits_raise_exactly_what_was_raised() {
    let (machine, settings) =
        (machine(LIMITS), Settings { off_delay_s: 30.0, ..Settings::default() });
    let lived = live(&machine, &settings, 4000, false);
    let answer = rerun(&lived, &machine, &settings, (0.0, lived.end_s + 1.0));
    assert_eq!(answer.n_windows, 4000);
    assert!(answer.only_would.is_empty(), "{:?}", answer.only_would.first());
    assert!(answer.only_was.is_empty(), "{:?}", answer.only_was.first());
    // Not only of the same kind: the same events with the same alarms, in the same order.
    let told: Vec<_> = lived.raised.iter().map(|e| (e.kind, e.alarm.id, e.alarm.level)).collect();
    assert!(told.len() > 300, "{}", told.len());
    assert_eq!(answer.would.len(), answer.was.len());
    assert!(answer.would.len() > 300);
    for (would, was) in answer.would.iter().zip(&answer.was) {
        assert_eq!((would.what, would.alarm.id), (was.what, was.alarm.id));
        assert_eq!(
            (would.alarm.severity, would.alarm.confidence),
            (was.alarm.severity, was.alarm.confidence)
        );
        assert_eq!((would.alarm.fault, &would.alarm.why), (was.alarm.fault, &was.alarm.why));
        assert_eq!(would.alarm.occurrences, was.alarm.occurrences);
    }
    for source in ["diagnosis", "limit", "data"] {
        assert!(answer.would.iter().any(|c| c.alarm.source.name() == source), "{source}");
    }
    assert!(!answer.gaps.is_empty() && answer.notes[0].contains("gaps"), "{:?}", answer.notes);
}

#[test]
fn what_operators_did_is_done_again() {
    let (machine, settings) = (machine(LIMITS), Settings::default());
    let lived = live(&machine, &settings, 3000, true);
    let acts = lived.raised.iter().filter(|event| event.by.is_some()).count();
    assert!(acts > 20, "{acts}");
    let answer = rerun(&lived, &machine, &settings, (0.0, lived.end_s + 1.0));
    assert!(answer.only_would.is_empty(), "{:?}", answer.only_would.first());
    assert!(answer.only_was.is_empty(), "{:?}", answer.only_was.first());
    let latched = |answer: &Answer| answer.would.iter().any(|c| c.alarm.latching);
    assert!(latched(&answer));
}

#[test]
fn a_part_of_the_history_says_the_same_of_its_own_time() {
    let (machine, settings) =
        (machine(LIMITS), Settings { off_delay_s: 30.0, ..Settings::default() });
    let lived = live(&machine, &settings, 4000, false);
    let span_s = (0.5 * lived.end_s, 0.75 * lived.end_s);
    let answer = rerun(&lived, &machine, &settings, span_s);
    let latches = |change: &&super::history::Change| !change.alarm.latching;
    assert_eq!(answer.only_would.iter().filter(latches).count(), 0);
    assert_eq!(answer.only_was.iter().filter(latches).count(), 0);
    assert!(answer.would.len() > 50 && answer.n_windows < 2000);
}

#[test]
fn other_limits_raise_others_and_nothing_that_cannot_be_known() {
    let (old, settings) = (machine(LIMITS), Settings::default());
    let lived = live(&old, &settings, 2000, false);
    let strict = machine(&LIMITS.replace("warning_above = 1.0", "warning_above = 0.5"));
    let span_s = (0.0, lived.end_s + 1.0);
    let answer = rerun(&lived, &strict, &settings, span_s);
    let raised = |changes: &[super::history::Change], limit: &str| {
        let of = |c: &&super::history::Change| c.alarm.source.limit() == Some(limit);
        changes.iter().filter(of).filter(|c| matches!(c.what, What::Came(_))).count()
    };
    assert!(raised(&answer.only_would, "rms") > 0);
    assert_eq!(raised(&answer.only_would, "crest"), 0, "what was not changed is as it was");
    let none = rerun(&lived, &machine(""), &settings, span_s);
    assert_eq!(none.would.iter().filter(|c| c.alarm.source.limit().is_some()).count(), 0);
    assert_eq!(
        none.only_was.len(),
        none.was.iter().filter(|c| c.alarm.source.limit().is_some()).count()
    );
    let unmeasured = machine(
        "[[limits.alarm]]\nid = 'new'\nkind = 'feature'\nfeature = 'kurtosis'\nwarning_above = 4\n",
    );
    let answer = rerun(&lived, &unmeasured, &settings, span_s);
    assert_eq!(raised(&answer.would, "new"), 0);
    let told =
        answer.notes.iter().any(|note| note.contains("\"new\"") && note.contains("kurtosis"));
    assert!(told, "{:?}", answer.notes);
    let slow = Settings { on_delay_s: 1e6, ..settings };
    let answer = rerun(&lived, &machine(""), &slow, span_s);
    let diagnosed = answer.would.iter().filter(|c| c.alarm.source.name() == "diagnosis").count();
    assert_eq!(diagnosed, 0, "an on-delay longer than the history raises nothing");
}

#[test]
fn a_restart_of_a_live_stream_is_one_here_too() {
    let (machine, settings) = (machine(LIMITS), Settings::default());
    let lived = live(&machine, &settings, 500, false);
    let (mut state, archive) = sqlite::open(lived.folder.path()).unwrap();
    // The daemon starts again on another stream, two minutes later, and goes on with what stands.
    let channels = channels();
    let start = START.plus_seconds(lived.end_s + 120.0);
    let key = key(start);
    let moment = |stream_s: f64| Moment {
        stream_s,
        monotonic_s: stream_s,
        utc: start.plus_seconds(stream_s),
    };
    let mut engine = AlarmEngine::of_machine(&machine, &channels, settings.clone());
    let kept = archive.load("m", &key, moment(0.0), 1000).unwrap();
    assert!(!kept.alarms.is_empty());
    let mut raised = engine.restore(kept, moment(0.0));
    let stream = Arc::new(PastStream {
        machine: "m".to_owned(),
        name: "live 2".to_owned(),
        start: Some(start),
        begun: start,
        channels: channels.iter().map(|channel| channel.name.clone()).collect(),
    });
    let mut life = Life { random: Pcg64::seed_from_u64(7), rms: 0.5, time_s: 0.0 };
    let mut trends = SqliteTrends::open(lived.folder.path(), Retention::default()).unwrap();
    for _ in 0..1000 {
        let (diagnosis, features, absent) = life.window();
        let baseline = Baseline::default();
        let measured = Measured {
            operating: diagnosis.operating_state,
            speed: diagnosis.shaft_speed,
            channels: &features,
            baseline: &baseline,
        };
        raised.extend(engine.observe_window(&diagnosis, life.time_s, Some(&measured), &absent));
        let mut minute = Minute::new(Arc::clone(&stream), Minute::of(&stream, life.time_s));
        minute.push(PastWindow::of(&diagnosis, life.time_s, &absent, start), &features);
        trends.keep(&[minute], start).unwrap();
    }
    let batch = Batch {
        stream: key,
        now: moment(life.time_s),
        judged_until_s: engine.judged_until_s(),
        ..Batch::new("m", raised)
    };
    state.keep(&[batch]).unwrap();
    drop(state);
    let answer = rerun(&lived, &machine, &settings, (0.0, lived.end_s + 120.0 + life.time_s + 1.0));
    assert_eq!(answer.n_windows, 1500);
    assert!(answer.only_would.is_empty(), "{:?}", answer.only_would.first());
    assert!(answer.only_was.is_empty(), "{:?}", answer.only_was.first());
    assert!(
        answer.notes.iter().any(|note| note.contains("restarted 1 times")),
        "{:?}",
        answer.notes
    );
}

#[test]
fn limits_relative_to_a_baseline_are_held_against_the_one_of_the_time() {
    let folder = TempDir::new().unwrap();
    let (_state, _) = sqlite::open(folder.path()).unwrap();
    let mut trends = SqliteTrends::open(folder.path(), Retention::default()).unwrap();
    let stream = Arc::new(PastStream {
        machine: "m".to_owned(),
        name: "live 1".to_owned(),
        start: Some(START),
        begun: START,
        channels: vec!["x".to_owned(), "y".to_owned()],
    });
    // Ten minutes: of the second half the level is three times the usual one.
    let mut life = Life { random: Pcg64::seed_from_u64(1), rms: 0.5, time_s: 0.0 };
    let mut minutes: Vec<Minute> = Vec::new();
    for n in 1..=120_u32 {
        let (diagnosis, mut features, _) = life.window();
        let time_s = 5.0 * f64::from(n);
        let used = BaselineUse {
            name: "healthy".to_owned(),
            used: true,
            reason: String::new(),
            id: Some("signed".into()),
            n_windows: 20,
        };
        let diagnosis = Diagnosis { baselines: vec![used], components: Vec::new(), ..diagnosis };
        let value = if n > 60 { 1.2 } else { 0.4 };
        let unit = Unit::MetrePerSecondSquared;
        let values = vec![Feature { name: "rms".into(), value, unit }];
        features.clear();
        features.push(ChannelFeatures { channel: ChannelIndex(0), sample_range: (0, 1), values });
        let minute = Minute::of(&stream, time_s);
        if minutes.last().is_none_or(|last| last.minute != minute) {
            minutes.push(Minute::new(Arc::clone(&stream), minute));
        }
        minutes.last_mut().unwrap().push(PastWindow::of(&diagnosis, time_s, &[], START), &features);
    }
    trends.keep(&minutes, START).unwrap();
    let record = Record {
        name: "healthy".to_owned(),
        baseline: Some("signed".into()),
        point: OperatingPoint::default(),
        usual: BTreeMap::from([(("x".to_owned(), "rms".to_owned()), Usual::of_value(0.4))]),
        n_windows: 20,
        ..Record::default()
    };
    let key = (Some("signed".to_owned()), "healthy".to_owned());
    let asked = |ratio: f64, records: BTreeMap<_, _>| {
        let limit = format!(
            "[[limits.alarm]]\nid = 'ratio'\nkind = 'feature'\nfeature = 'rms'\nchannels = ['x']\n\
             relative_to = 'baseline'\nwarning_above = {ratio}\n"
        );
        let question = Question {
            machine: machine(&limit),
            settings: Settings::default(),
            span: (START, START.plus_seconds(601.0)),
            records,
        };
        let archive = sqlite::read_only(folder.path()).unwrap().unwrap();
        ask(&question, &archive, &SqliteTrendArchive::new(folder.path())).unwrap()
    };
    let kept = || BTreeMap::from([(key.clone(), record.clone())]);
    let raised = |answer: &Answer| {
        let came = |change: &&super::history::Change| matches!(change.what, What::Came(_));
        answer.would.iter().filter(came).map(|change| change.at).collect::<Vec<_>>()
    };
    assert_eq!(raised(&asked(2.0, kept())), [START.plus_seconds(305.0)]);
    assert!(raised(&asked(3.5, kept())).is_empty());
    let without = asked(2.0, BTreeMap::new());
    assert!(raised(&without).is_empty(), "of no baseline nothing is said");
    assert!(without.notes.iter().any(|note| note.contains("healthy")), "{:?}", without.notes);
}
