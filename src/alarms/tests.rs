//! Life of alarms, from verdicts at stream times.

use super::*;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::diagnosis::verdict::{Coverage, DataQuality, OperatingState};
use proptest::prelude::*;

const H: State = State::Healthy;
const U: State = State::Undetermined;
const W: State = State::Warning;
const D: State = State::Damaged;

pub(super) fn component(id: &str, state: State) -> ComponentDiagnosis {
    ComponentDiagnosis {
        id: id.to_owned(),
        kind: ComponentKind::Bearing,
        state,
        fault: state.is_accusation().then_some(FaultMode::InnerRace),
        severity: (state != U).then_some(0.3),
        confidence: (state != U).then_some(0.9),
        why: format!("{id} is {}", state.name()),
        evidence: Vec::new(),
        other_faults: Vec::new(),
        gear: None,
    }
}

pub(super) fn verdict(state: State, operating_state: OperatingState) -> Diagnosis {
    Diagnosis {
        machine: "rig".to_owned(),
        duration_s: 10.0,
        samples_used: 0,
        samples_rejected: 0,
        rejected_because: Vec::new(),
        shaft_speed: None,
        shaft_speeds: Vec::new(),
        speed_source: None,
        speed_confidence: 0.0,
        operating_state,
        state,
        coverage: Coverage::default(),
        data_quality: DataQuality::Ok,
        components: vec![component("right", state)],
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

/// Acknowledges an alarm at a stream time.
fn acknowledge(
    engine: &mut AlarmEngine,
    alarm: u64,
    author: &str,
    comment: &str,
    time_s: f64,
) -> Result<(Alarm, Vec<AlarmEvent>), ActionError> {
    act(engine, alarm, Action::Acknowledge, (author, comment), Moment::of_stream(time_s))
}

pub(super) fn act(
    engine: &mut AlarmEngine,
    alarm: u64,
    action: Action,
    (author, comment): (&str, &str),
    now: Moment,
) -> Result<(Alarm, Vec<AlarmEvent>), ActionError> {
    let (author, comment) = (author.to_owned(), comment.to_owned());
    engine.act(&Act { alarm, action, author, comment }, now)
}

/// Feeds states, one verdict every `hop_s`, and gives (time, event) pairs.
fn play(engine: &mut AlarmEngine, hop_s: f64, states: &[State]) -> Vec<(f64, EventKind)> {
    let from = engine.last_verdict_s.unwrap_or(0.0);
    let mut events = Vec::new();
    for (n, state) in states.iter().enumerate() {
        let time_s = from + hop_s * (n as f64 + 1.0);
        events.extend(engine.observe(&verdict(*state, OperatingState::Running), time_s));
    }
    events.iter().map(|event| (event.time_s, event.kind)).collect()
}

fn engine(on_delay_s: f64, off_delay_s: f64) -> AlarmEngine {
    AlarmEngine::new("rig", Settings { on_delay_s, off_delay_s, ..Settings::default() })
}

#[test]
fn one_window_of_a_short_replay_raises_with_the_defaults() {
    let mut engine = AlarmEngine::new("rig", Settings::default());
    let events = engine.observe(&verdict(D, OperatingState::Running), 10.0);
    assert_eq!(events.len(), 1);
    assert_eq!(events[0].kind, EventKind::Raised);
    let alarm = &engine.standing()[0];
    assert_eq!(
        (alarm.id, alarm.level, alarm.state),
        (1, Level::Damaged, AlarmState::Unacknowledged)
    );
    assert_eq!((alarm.component.as_str(), alarm.fault), ("right", Some(FaultMode::InnerRace)));
    assert_eq!(alarm.why, "right is damaged");
}

#[test]
fn a_verdict_that_flickers_every_window_raises_one_alarm_only() {
    let mut engine = AlarmEngine::new("rig", Settings::default());
    let states: Vec<State> = (0..1000).map(|n| if n % 2 == 0 { W } else { H }).collect();
    assert_eq!(play(&mut engine, 5.0, &states), [(5.0, EventKind::Raised)]);
}

#[test]
fn life_of_an_acknowledged_alarm() {
    let mut engine = engine(0.0, 20.0);
    assert_eq!(
        play(&mut engine, 10.0, &[H, W, D]),
        [(20.0, EventKind::Raised), (30.0, EventKind::Escalated)]
    );
    let (alarm, events) = acknowledge(&mut engine, 1, " M. Ito ", "ordered", 31.0).unwrap();
    assert_eq!(alarm.state, AlarmState::Acknowledged);
    assert_eq!(alarm.acknowledgement.unwrap().author, "M. Ito");
    assert_eq!(events.len(), 1);
    // Below damaged from 40 s: steps down after 20 s; healthy from 70 s: over after 20 s.
    assert_eq!(
        play(&mut engine, 10.0, &[W, W, W, H, H, H]),
        [(60.0, EventKind::DeEscalated), (90.0, EventKind::Cleared)]
    );
    assert!(engine.standing().is_empty());
    // A new occurrence is a new alarm.
    assert_eq!(play(&mut engine, 10.0, &[D]), [(100.0, EventKind::Raised)]);
    assert_eq!(engine.standing()[0].id, 2);
}

#[test]
fn escalation_asks_for_a_new_acknowledgement_and_a_step_down_does_not() {
    let mut engine = engine(0.0, 0.0);
    play(&mut engine, 10.0, &[W]);
    acknowledge(&mut engine, 1, "a", "", 11.0).unwrap();
    play(&mut engine, 10.0, &[D]);
    assert_eq!(engine.standing()[0].state, AlarmState::Unacknowledged);
    acknowledge(&mut engine, 1, "a", "", 21.0).unwrap();
    play(&mut engine, 10.0, &[W]);
    assert_eq!(engine.standing()[0].state, AlarmState::Acknowledged);
}

#[test]
fn an_alarm_that_returned_waits_for_its_acknowledgement_or_comes_again() {
    let mut engine = engine(0.0, 0.0);
    assert_eq!(
        play(&mut engine, 10.0, &[W, H, H, D]),
        [(10.0, EventKind::Raised), (20.0, EventKind::Returned), (40.0, EventKind::Raised)]
    );
    let alarm = &engine.standing()[0];
    assert_eq!((alarm.id, alarm.occurrences, alarm.level), (1, 2, Level::Damaged));
    play(&mut engine, 10.0, &[H]);
    let (alarm, events) = acknowledge(&mut engine, 1, "a", "seen", 51.0).unwrap();
    assert_eq!(alarm.state, AlarmState::Normal);
    let kinds: Vec<EventKind> = events.iter().map(|event| event.kind).collect();
    assert_eq!(kinds, [EventKind::Acknowledged, EventKind::Cleared]);
    assert!(engine.standing().is_empty());
}

#[test]
fn an_alarm_keeps_the_reason_of_the_last_accusation() {
    let mut engine = engine(0.0, 60.0);
    play(&mut engine, 10.0, &[D, W, H, U]);
    assert_eq!(engine.standing()[0].why, "right is warning");
    assert_eq!(engine.standing()[0].level, Level::Damaged);
}

#[test]
fn nothing_but_observed_health_clears() {
    let mut engine = engine(0.0, 20.0);
    play(&mut engine, 10.0, &[D]);
    play(&mut engine, 10.0, &[U; 100]);
    for _ in 0..100 {
        let time_s = engine.last_verdict_s.unwrap() + 10.0;
        assert!(engine.observe(&verdict(H, OperatingState::Stopped), time_s).is_empty());
        let mut absent = verdict(H, OperatingState::Running);
        absent.components.clear();
        assert!(engine.observe(&absent, time_s + 10.0).is_empty());
    }
    // An hour without data between two healthy windows of 10 s proves 10 s of health, not an hour.
    let time_s = engine.last_verdict_s.unwrap();
    assert!(engine.observe(&verdict(H, OperatingState::Running), time_s + 10.0).is_empty());
    assert!(engine.observe(&verdict(H, OperatingState::Running), time_s + 3610.0).is_empty());
    let events = engine.observe(&verdict(H, OperatingState::Running), time_s + 3620.0);
    assert_eq!(events[0].kind, EventKind::Returned);
}

#[test]
fn refusals_change_nothing() {
    let mut engine = engine(0.0, 0.0);
    play(&mut engine, 10.0, &[W]);
    let long = "x".repeat(MAX_TEXT_CHARS + 1);
    assert_eq!(acknowledge(&mut engine, 7, "a", "", 0.0), Err(ActionError::UnknownAlarm { id: 7 }));
    assert_eq!(acknowledge(&mut engine, 1, " ", "", 0.0), Err(ActionError::NoAuthor));
    assert!(matches!(
        acknowledge(&mut engine, 1, "a", &long, 0.0),
        Err(ActionError::TextTooLong { field: "comment", found: 2001 })
    ));
    assert_eq!(engine.history().len(), 1);
    acknowledge(&mut engine, 1, "a", "", 11.0).unwrap();
    assert_eq!(
        acknowledge(&mut engine, 1, "b", "", 12.0),
        Err(ActionError::AlreadyAcknowledged { id: 1, author: "a".to_owned() })
    );
    assert_eq!(engine.standing()[0].acknowledgement.as_ref().unwrap().author, "a");
}

#[test]
fn history_is_bounded_and_counts_what_fell_out() {
    let mut engine = AlarmEngine::new(
        "rig",
        Settings { on_delay_s: 0.0, off_delay_s: 0.0, history_len: 10, ..Settings::default() },
    );
    let states: Vec<State> = (0..100).map(|n| if n % 2 == 0 { W } else { H }).collect();
    assert_eq!(play(&mut engine, 10.0, &states).len(), 100);
    assert_eq!((engine.history().len(), engine.history_dropped()), (10, 90));
    assert_eq!(engine.history()[0].sequence, 91);
}

#[test]
fn components_of_one_name_and_two_kinds_have_an_alarm_each() {
    let mut engine = engine(0.0, 0.0);
    let mut both = verdict(W, OperatingState::Running);
    both.components
        .push(ComponentDiagnosis { kind: ComponentKind::Shaft, ..component("right", D) });
    engine.observe(&both, 10.0);
    let kinds: Vec<ComponentKind> = engine.standing().iter().map(|alarm| alarm.kind).collect();
    assert_eq!(kinds, [ComponentKind::Shaft, ComponentKind::Bearing]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// A scenario that changes on a coarse grid gives the same transitions whether verdicts come on
    /// that grid or three times as often, up to one fine step: delays count stream time, not calls.
    #[test]
    fn delays_count_stream_time_not_verdicts(
        scenario in prop::collection::vec(0_u8..4, 1..30),
        on_steps in 0_u8..4,
        off_steps in 0_u8..4,
    ) {
        let states: Vec<State> =
            scenario.iter().map(|n| [H, U, W, D][usize::from(*n)]).collect();
        // Delays just below a multiple of the hop, so that rounding of times cannot decide.
        let delay = |steps: u8| (f64::from(steps) * 3.0 - 0.5).max(0.0);
        let mut coarse = engine(delay(on_steps), delay(off_steps));
        let mut fine = coarse.clone();
        // Same level held for 1 fine step after each coarse verdict, then the next state begins.
        let coarse_events = play(&mut coarse, 3.0, &states);
        let repeated: Vec<State> = states.iter().flat_map(|s| [*s; 3]).collect();
        let fine_events = play(&mut fine, 1.0, &repeated);
        prop_assert!(coarse.standing().len() <= 1 && fine.standing().len() <= 1);
        if !states.contains(&U) {
            for (time_s, kind) in &coarse_events {
                let near = |(t, k): &(f64, EventKind)| k == kind && (t - time_s).abs() <= 3.0;
                prop_assert!(fine_events.iter().any(near), "{coarse_events:?} {fine_events:?}");
            }
        }
    }

    /// Events tell the whole story: replaying their kinds gives the state, and sequence numbers
    /// have no holes.
    #[test]
    fn events_are_consistent_with_standing_alarms(
        steps in prop::collection::vec((0_u8..5, 0.0_f64..30.0), 1..80),
        on_delay_s in 0.0_f64..30.0,
        off_delay_s in 0.0_f64..30.0,
    ) {
        let mut engine = engine(on_delay_s, off_delay_s);
        let (mut time_s, mut standing, mut n) = (0.0, None, 0);
        for (step, dt) in steps {
            time_s += dt;
            let events = match step {
                4 => {
                    let id = engine.standing().first().map_or(0, |alarm| alarm.id);
                    acknowledge(&mut engine, id, "a", "", time_s).map(|(_, e)| e).unwrap_or_default()
                }
                state => engine.observe(
                    &verdict([H, U, W, D][usize::from(state)], OperatingState::Running),
                    time_s,
                ),
            };
            for event in events {
                n += 1;
                prop_assert_eq!(event.sequence, n);
                let over = event.alarm.state == AlarmState::Normal;
                standing = (!over).then_some(event.alarm);
            }
            let now = engine.standing().first().map(|a| (a.id, a.state, a.level));
            prop_assert_eq!(now, standing.as_ref().map(|a| (a.id, a.state, a.level)));
        }
    }
}

/// The cause the only alarm names after a verdict at `time_s`.
fn cause_after(
    engine: &mut AlarmEngine,
    time_s: f64,
    state: State,
    fault: Option<FaultMode>,
) -> Option<FaultMode> {
    let mut diagnosis = verdict(state, OperatingState::Running);
    diagnosis.components[0].fault = fault;
    engine.observe(&diagnosis, time_s);
    engine.standing()[0].fault
}

#[test]
fn a_named_cause_outlasts_a_window_that_mixes_two_conditions() {
    let (bow, unbalance) = (Some(FaultMode::Bow), Some(FaultMode::Unbalance));
    let mut engine = engine(0.0, 20.0);
    assert_eq!(cause_after(&mut engine, 10.0, D, None), None);
    assert_eq!(cause_after(&mut engine, 20.0, D, bow), bow, "a name is taken at once");
    assert_eq!(cause_after(&mut engine, 30.0, D, None), bow);
    assert_eq!(cause_after(&mut engine, 40.0, D, bow), bow, "counts anew");
    assert_eq!(cause_after(&mut engine, 50.0, D, unbalance), bow);
    assert_eq!(cause_after(&mut engine, 60.0, H, None), bow);
    assert_eq!(cause_after(&mut engine, 70.0, D, None), None, "20 s of other answers");
    assert_eq!(cause_after(&mut engine, 80.0, W, unbalance), unbalance);
}

#[test]
fn a_worse_or_a_new_condition_brings_its_own_cause() {
    let (bow, unbalance) = (Some(FaultMode::Bow), Some(FaultMode::Unbalance));
    let mut engine = engine(0.0, 20.0);
    assert_eq!(cause_after(&mut engine, 10.0, W, unbalance), unbalance);
    assert_eq!(cause_after(&mut engine, 20.0, D, bow), bow, "escalated");
    assert_eq!(cause_after(&mut engine, 30.0, H, None), bow);
    assert_eq!(cause_after(&mut engine, 40.0, H, None), bow);
    assert_eq!(cause_after(&mut engine, 50.0, H, None), bow, "returned");
    assert_eq!(engine.standing()[0].state, AlarmState::ReturnedUnacknowledged);
    assert_eq!(cause_after(&mut engine, 60.0, W, unbalance), unbalance, "raised again");
}
