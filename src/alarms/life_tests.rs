//! Operators' acts, shelving by time, what comes from the shell, and restarts.

use super::tests::act;
use super::tests::verdict;
use super::*;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::OperatingState;
use crate::signal::Timestamp;
use proptest::prelude::*;
use state::ShownState;

const RUNNING: OperatingState = OperatingState::Running;

/// Both clocks at the same number of seconds, the wall clock an hour ahead.
pub(super) fn at(time_s: f64) -> Moment {
    let utc = Timestamp::default().plus_seconds(3600.0 + time_s);
    Moment { stream_s: time_s, monotonic_s: time_s, utc }
}

fn engine() -> AlarmEngine {
    let settings = Settings { off_delay_s: 0.0, ..Settings::default() };
    AlarmEngine::new("rig", settings)
}

/// An engine with one unacknowledged alarm, raised at 10 s.
fn alarmed() -> AlarmEngine {
    let mut engine = engine();
    engine.observe(&verdict(State::Warning, RUNNING), 10.0);
    engine
}

fn does(engine: &mut AlarmEngine, action: Action, time_s: f64) -> Result<Vec<EventKind>, String> {
    let done = act(engine, 1, action, ("M. Ito", "why"), at(time_s));
    done.map(|(_, events)| kinds(&events)).map_err(|error| error.to_string())
}

pub(super) fn kinds(events: &[AlarmEvent]) -> Vec<EventKind> {
    events.iter().map(|event| event.kind).collect()
}

fn shown(engine: &AlarmEngine) -> Option<ShownState> {
    engine.standing().first().map(Alarm::shown)
}

#[test]
fn a_shelf_is_left_by_time_and_what_was_acknowledged_is_seen_anew() {
    let mut engine = alarmed();
    does(&mut engine, Action::Acknowledge, 11.0).unwrap();
    let shelve = Action::Shelve { for_s: 60.0 };
    assert_eq!(does(&mut engine, shelve, 12.0), Ok(vec![EventKind::Shelved]));
    assert_eq!(shown(&engine), Some(ShownState::Shelved));
    let silencing = engine.standing()[0].silencing.clone().unwrap();
    assert_eq!((silencing.author.as_str(), silencing.comment.as_str()), ("M. Ito", "why"));
    assert_eq!(silencing.until.unwrap().utc, Timestamp::default().plus_seconds(3600.0 + 72.0));
    assert!(engine.tick(at(71.9), DataFlow::Flowing, None).is_empty());
    let events = engine.tick(at(72.0), DataFlow::Flowing, None);
    assert_eq!(kinds(&events), [EventKind::Unshelved]);
    assert_eq!(events[0].by, None, "time did it");
    assert_eq!(shown(&engine), Some(ShownState::Unacknowledged));
    assert!(engine.tick(at(73.0), DataFlow::Flowing, None).is_empty(), "once");
}

#[test]
fn a_wall_clock_that_is_set_moves_no_shelf() {
    for step_s in [-3600.0, 3600.0] {
        let mut engine = alarmed();
        does(&mut engine, Action::Shelve { for_s: 60.0 }, 12.0).unwrap();
        let moved = |time_s: f64| Moment { utc: at(time_s).utc.plus_seconds(step_s), ..at(time_s) };
        assert!(engine.tick(moved(71.0), DataFlow::Flowing, None).is_empty());
        assert_eq!(engine.tick(moved(72.0), DataFlow::Flowing, None).len(), 1);
    }
}

#[test]
fn what_comes_and_goes_behind_a_silence_is_recorded_and_waits() {
    let mut engine = alarmed();
    does(&mut engine, Action::TakeOutOfService, 11.0).unwrap();
    let events = engine.observe(&verdict(State::Healthy, RUNNING), 20.0);
    assert_eq!(kinds(&events), [EventKind::Returned]);
    let events = engine.observe(&verdict(State::Damaged, RUNNING), 30.0);
    assert_eq!(kinds(&events), [EventKind::Raised]);
    assert_eq!(shown(&engine), Some(ShownState::OutOfService));
    assert_eq!(
        does(&mut engine, Action::ReturnToService, 31.0),
        Ok(vec![EventKind::ReturnedToService])
    );
    assert_eq!(shown(&engine), Some(ShownState::Unacknowledged));
    assert_eq!(engine.standing()[0].level, Level::Damaged);
}

#[test]
fn an_alarm_that_ends_while_silent_stands_until_the_silence_ends() {
    let mut engine = alarmed();
    does(&mut engine, Action::Acknowledge, 11.0).unwrap();
    does(&mut engine, Action::Suppress, 12.0).unwrap();
    let events = engine.observe(&verdict(State::Healthy, RUNNING), 20.0);
    assert_eq!(kinds(&events), [EventKind::Cleared]);
    assert_eq!(shown(&engine), Some(ShownState::Suppressed));
    assert_eq!(does(&mut engine, Action::Unsuppress, 21.0), Ok(vec![EventKind::Unsuppressed]));
    assert!(engine.standing().is_empty());
}

#[test]
fn acts_that_do_not_fit_are_refused_in_words_and_change_nothing() {
    let mut engine = alarmed();
    let before = engine.standing();
    for (action, words) in [
        (Action::Unshelve, "is not shelved"),
        (Action::Unsuppress, "is not suppressed"),
        (Action::ReturnToService, "is not out of service"),
        (Action::Reset, "cannot be reset: its condition is present"),
        (Action::Shelve { for_s: 0.0 }, "at most 86400 s"),
        (Action::Shelve { for_s: 86_401.0 }, "at most 86400 s"),
        (Action::Shelve { for_s: f64::NAN }, "at most 86400 s"),
    ] {
        let found = does(&mut engine, action, 11.0).unwrap_err();
        assert!(found.contains(words), "{action:?}: {found}");
    }
    assert_eq!(engine.standing(), before);
    assert_eq!(engine.history().len(), 1);
    does(&mut engine, Action::TakeOutOfService, 12.0).unwrap();
    let found = does(&mut engine, Action::Shelve { for_s: 1.0 }, 13.0).unwrap_err();
    assert!(found.contains("is out of service already"), "{found}");
}

#[test]
fn missing_data_raise_an_alarm_of_their_own_and_clear_no_other() {
    let mut engine = alarmed();
    assert!(engine.tick(at(15.0), DataFlow::SilentFor(9.9), None).is_empty());
    let events = engine.tick(at(15.1), DataFlow::SilentFor(10.0), None);
    assert_eq!(kinds(&events), [EventKind::Raised]);
    let missing = &engine.standing()[0];
    assert_eq!((missing.id, &missing.source), (2, &AlarmSource::Data));
    assert_eq!(missing.why, "no data have come for 10 s");
    assert_eq!(engine.standing()[1].state, AlarmState::Unacknowledged);
    assert!(engine.tick(at(15.5), DataFlow::Unknown, None).is_empty(), "it stands as it stood");
    let events = engine.tick(at(16.0), DataFlow::Flowing, None);
    assert_eq!(kinds(&events), [EventKind::Returned]);
    let events = engine.tick(at(17.0), DataFlow::Failed("disk on fire"), None);
    assert_eq!(kinds(&events), [EventKind::Raised]);
    assert!(engine.standing()[0].why.ends_with("disk on fire"), "{:?}", engine.standing()[0]);
}

#[test]
fn a_store_that_fails_is_an_alarm_that_recovers() {
    let mut engine = engine();
    let events = engine.tick(at(1.0), DataFlow::Flowing, Some("the disk is full"));
    assert_eq!(kinds(&events), [EventKind::Raised]);
    assert_eq!(engine.standing()[0].source, AlarmSource::Store);
    assert!(engine.tick(at(2.0), DataFlow::Flowing, Some("the disk is full")).is_empty());
    let events = engine.tick(at(3.0), DataFlow::Flowing, None);
    assert_eq!(kinds(&events), [EventKind::Returned]);
}

pub(super) fn kept(engine: &AlarmEngine, judged_until_s: Option<f64>) -> Kept {
    Kept {
        alarms: engine.standing(),
        history: engine.history().iter().cloned().collect(),
        last_id: engine.next_id - 1,
        last_sequence: engine.next_sequence - 1,
        judged_until_s,
        decisions: Some(engine.decisions()),
        advance: engine.advance().to_vec(),
        last_advance: engine.last_advance(),
    }
}

fn delayed() -> AlarmEngine {
    let settings = Settings { on_delay_s: 600.0, off_delay_s: 25.0, ..Settings::default() };
    AlarmEngine::new("rig-1", settings)
}

#[test]
fn an_on_delay_longer_than_the_time_between_two_restarts_is_reached() {
    // Each life is a stream of its own and sees 54 windows of 10 s; a quarter of an hour is between them.
    let mut engine = delayed();
    let mut raised = Vec::new();
    for life in 0..3 {
        if life > 0 {
            let kept = kept(&engine, None);
            engine = delayed();
            engine.restore(kept, at(0.0));
        }
        for n in 1..=54 {
            let events = engine.observe(&verdict(State::Warning, RUNNING), 10.0 * f64::from(n));
            raised.extend(events.into_iter().map(|event| (life, event.time_s)));
        }
    }
    // 530 s are seen in the first life; the first window of the second adds nothing, the eighth the last 10 s.
    assert_eq!(raised, [(1, 80.0)]);
    // Without what was kept, it would never be.
    let mut engine = delayed();
    for _ in 0..3 {
        let kept = Kept { decisions: None, ..kept(&engine, None) };
        engine = delayed();
        engine.restore(kept, at(0.0));
        for n in 1..=54 {
            let time_s = 10.0 * f64::from(n);
            assert!(engine.observe(&verdict(State::Warning, RUNNING), time_s).is_empty());
        }
    }
}

#[test]
fn a_restart_goes_on_where_it_stood() {
    let mut before = alarmed();
    does(&mut before, Action::Acknowledge, 11.0).unwrap();
    does(&mut before, Action::Shelve { for_s: 60.0 }, 12.0).unwrap();
    let mut after = engine();
    assert!(after.restore(kept(&before, None), at(0.0)).is_empty());
    assert_eq!(after.standing(), before.standing());
    assert_eq!(after.history(), before.history());
    // The shelf is left by its time, a new condition gets a new id and the next number.
    assert_eq!(after.tick(at(72.0), DataFlow::Flowing, None)[0].sequence, 4);
    let events = after.tick(at(73.0), DataFlow::Failed("gone"), None);
    assert_eq!((events[0].sequence, events[0].alarm.id), (5, 2));
    // Warning stands: the same verdict is no news, a worse one is.
    assert!(after.observe(&verdict(State::Warning, RUNNING), 80.0).is_empty());
    let events = after.observe(&verdict(State::Damaged, RUNNING), 90.0);
    assert_eq!(kinds(&events), [EventKind::Escalated]);
}

#[test]
fn a_stream_that_is_played_again_says_nothing_new_up_to_where_it_was_judged() {
    let states = [State::Warning, State::Healthy, State::Damaged, State::Healthy, State::Damaged];
    let play = |engine: &mut AlarmEngine| {
        let at = |n: usize| 10.0 * (n as f64 + 1.0);
        let verdicts = states.iter().enumerate();
        verdicts.flat_map(|(n, s)| engine.observe(&verdict(*s, RUNNING), at(n))).collect::<Vec<_>>()
    };
    let mut whole = engine();
    let events = play(&mut whole);
    let mut killed = engine();
    for (n, state) in states[..3].iter().enumerate() {
        killed.observe(&verdict(*state, RUNNING), 10.0 * (n as f64 + 1.0));
    }
    let mut again = engine();
    again.restore(kept(&killed, Some(30.0)), at(0.0));
    assert_eq!(play(&mut again), events[3..], "sequence numbers and alarms as if never killed");
    assert_eq!(again.standing(), whole.standing());
    assert_eq!(again.history(), whole.history());
}

#[test]
fn the_alarm_of_a_limit_that_is_gone_is_over() {
    let mut engine = engine();
    let mut kept = kept(&alarmed(), None);
    kept.alarms[0].source = AlarmSource::Limit("gap".to_owned());
    let events = engine.restore(kept, at(0.0));
    assert_eq!(kinds(&events), [EventKind::ConfigurationRemoved]);
    assert!(events[0].alarm.position().is_over());
    assert!(engine.standing().is_empty());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever operators and verdicts do: the level follows the verdict behind every silence, only
    /// observed health ends a condition, a shelf ends by its time, numbers have no holes, and a restart
    /// at any place changes nothing that follows.
    #[test]
    fn no_order_of_acts_and_verdicts_loses_an_alarm(
        steps in prop::collection::vec((0_usize..12, 0.1_f64..40.0), 1..80),
        restart_at in 0_usize..80,
    ) {
        let mut engine = engine();
        let (mut time_s, mut accused, mut n) = (0.0, false, 0);
        for (place, (step, dt)) in steps.into_iter().enumerate() {
            time_s += dt;
            if place == restart_at {
                let kept = kept(&engine, None);
                let before = engine.standing();
                engine = self::engine();
                prop_assert!(engine.restore(kept, at(time_s)).is_empty());
                prop_assert_eq!(engine.standing(), before);
            }
            let states = [State::Healthy, State::Undetermined, State::Warning, State::Damaged];
            let actions = [
                Action::Acknowledge, Action::Shelve { for_s: 30.0 }, Action::Unshelve, Action::Suppress,
                Action::Unsuppress, Action::TakeOutOfService, Action::ReturnToService, Action::Reset,
            ];
            let ended = engine.tick(at(time_s), DataFlow::Flowing, None);
            for alarm in engine.standing() {
                let until = alarm.silencing.as_ref().and_then(|s| s.until);
                prop_assert!(until.is_none_or(|until| until.monotonic_s > time_s), "left by time");
            }
            let caused = match states.get(step) {
                Some(state) => {
                    accused = match state {
                        State::Healthy => false,
                        State::Undetermined => accused,
                        State::Warning | State::Damaged => true,
                    };
                    engine.observe(&verdict(*state, RUNNING), time_s)
                }
                None => {
                    let id = engine.standing().first().map_or(0, |alarm| alarm.id);
                    let done = act(&mut engine, id, actions[step - 4], ("a", ""), at(time_s));
                    done.map(|(_, events)| events).unwrap_or_default()
                }
            };
            for event in ended.into_iter().chain(caused) {
                n += 1;
                prop_assert_eq!(event.sequence, n);
            }
            let active = engine.standing().iter().any(|alarm| alarm.state.is_active());
            prop_assert_eq!(active, accused, "the condition is followed behind every silence");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// A stream that is judged on from where it was kept, delays and all, raises what it would have raised.
    #[test]
    fn a_restart_within_a_stream_changes_no_delay(
        states in prop::collection::vec(0_usize..4, 1..60),
        restart_at in 0_usize..60,
    ) {
        let settings = Settings { on_delay_s: 15.0, off_delay_s: 25.0, ..Settings::default() };
        let engine = || AlarmEngine::new("rig-1", settings.clone());
        let kinds = [State::Healthy, State::Undetermined, State::Warning, State::Damaged];
        let play = |engine: &mut AlarmEngine, n: usize| {
            let verdicts = states.iter().take(n).enumerate();
            let each = |(n, kind): (usize, &usize)| {
                engine.observe(&verdict(kinds[*kind], RUNNING), 10.0 * (n as f64 + 1.0))
            };
            verdicts.flat_map(each).collect::<Vec<_>>()
        };
        let whole = play(&mut engine(), states.len());
        let mut killed = engine();
        let mut told = play(&mut killed, restart_at);
        let mut again = engine();
        again.restore(kept(&killed, killed.judged_until_s()), at(0.0));
        told.extend(play(&mut again, states.len()));
        prop_assert_eq!(told, whole);
    }
}

fn event(kind: EventKind, time_s: f64, alarm: &Alarm) -> AlarmEvent {
    AlarmEvent { sequence: 1, kind, time_s, by: None, alarm: alarm.clone() }
}

#[test]
fn the_load_is_counted_by_the_standards_figures() {
    let alarm = alarmed().standing().remove(0);
    let raised = |n: u32, every_s: f64| -> VecDeque<AlarmEvent> {
        let other = |i: u32| Alarm { component: format!("b{i}"), ..alarm.clone() };
        (0..n).map(|i| event(EventKind::Raised, every_s * f64::from(i), &other(i))).collect()
    };
    // Ten in ten minutes are none, eleven are a flood; after an hour nothing is left.
    let load = |n, now_s| load::of(&raised(n, 60.0), &[], now_s);
    assert!(!load(10, 600.0).is_flood() && load(11, 600.0).is_flood());
    assert_eq!((load(11, 600.0).last_hour, load(11, 3660.0).last_hour), (11, 10));
    assert_eq!(load(11, 4300.0).last_hour, 0);
    // Three comings and goings in 60 s chatter, in 61 s they do not.
    let comes_and_goes = |every_s: f64| {
        let kinds = [EventKind::Raised, EventKind::Returned, EventKind::Raised];
        let times = kinds.into_iter().zip([0.0, every_s, 2.0 * every_s]);
        times.map(|(kind, time_s)| event(kind, time_s, &alarm)).collect::<VecDeque<_>>()
    };
    assert_eq!(load::of(&comes_and_goes(30.0), &[], 100.0).chattering, [1]);
    assert!(load::of(&comes_and_goes(30.5), &[], 100.0).chattering.is_empty());
    // Stale after a day; the first of what nobody acknowledged.
    let later = Alarm { id: 2, active_since_s: 20.0, ..alarm.clone() };
    let stands = [later.clone(), alarm.clone()];
    let none = VecDeque::new();
    assert_eq!(load::of(&none, &stands, 86_410.0).stale, Vec::<u64>::new());
    assert_eq!(load::of(&none, &stands, 86_415.0).stale, [1]);
    assert_eq!(load::of(&none, &stands, 30.0).first_out, Some(1));
    let seen = Alarm { state: AlarmState::Acknowledged, ..alarm.clone() };
    assert_eq!(load::of(&none, &[later, seen], 30.0).first_out, Some(2));
    // What is silent asks for nothing.
    let mut silenced = alarmed();
    does(&mut silenced, Action::Suppress, 11.0).unwrap();
    let silent = silenced.standing();
    let load = load::of(&[event(EventKind::Raised, 0.0, &silent[0])].into(), &silent, 1e6);
    assert_eq!(load, load::Load::default());
}
