//! Other settings in the middle of a stream: what stands, what goes on, what ends.

use super::super::limit_tests::VELOCITY;
use super::super::limit_tests::channels;
use super::super::limit_tests::engine;
use super::super::limit_tests::machine;
use super::super::limit_tests::stands;
use super::super::limit_tests::velocity;
use super::super::tests::verdict;
use super::super::*;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::OperatingState;
use proptest::prelude::*;

const W: Option<Level> = Some(Level::Warning);

fn renewed(engine: &AlarmEngine, rest: &str) -> (AlarmEngine, Vec<AlarmEvent>) {
    let now = Moment::of_stream(engine.judged_until_s().unwrap_or(0.0));
    engine.renewed(&machine(rest), &channels(), engine.settings().clone(), now)
}

fn delayed(id: &str, more: &str) -> String {
    format!(
        "[[limits.alarm]]\nid = '{id}'\nkind = 'velocity_rms'\nchannels = ['x']\non_delay_s = 20.0\n{more}"
    )
}

#[test]
fn an_alarm_stands_until_the_new_limit_says_otherwise() {
    let mut before = engine(VELOCITY);
    velocity(&[3.0]).to(&mut before, 10.0);
    let raised = format!("{VELOCITY}warning_above = 3.5\ndamaged_above = 9.0\n");
    let (mut after, events) = renewed(&before, &raised);
    assert!(events.is_empty());
    assert_eq!((stands(&after), after.standing()), (W, before.standing()));
    assert_eq!(velocity(&[3.0]).to(&mut after, 20.0), [EventKind::Returned]);
    // And the other way round: the level that was allowed is above the limit of now.
    let (mut strict, _) = renewed(&after, VELOCITY);
    assert_eq!(velocity(&[3.0]).to(&mut strict, 30.0), [EventKind::Raised]);
    let newest = strict.history().back().unwrap();
    assert_eq!(
        (newest.sequence, newest.alarm.occurrences),
        (3, 2),
        "the same alarm, no number twice"
    );
}

#[test]
fn the_alarm_of_a_limit_that_vanished_is_over_whatever_its_state() {
    let mut before = engine(VELOCITY);
    velocity(&[3.0]).to(&mut before, 10.0);
    let (author, comment) = ("M. Ito".to_owned(), String::new());
    let act = Act { alarm: 1, action: Action::Suppress, author, comment };
    before.act(&act, Moment::of_stream(11.0)).unwrap();
    let (after, events) = renewed(&before, "");
    let [event] = &events[..] else { panic!("{events:?}") };
    assert_eq!((event.kind, event.sequence), (EventKind::ConfigurationRemoved, 3));
    assert!(event.alarm.position().is_over() && event.by.is_none());
    assert!(after.standing().is_empty());
    // What the diagnosis says of components is judged on.
    let mut accused = engine(VELOCITY);
    accused.observe(&verdict(State::Warning, OperatingState::Running), 10.0);
    let (mut after, events) = renewed(&accused, "");
    assert!(events.is_empty());
    let healthy = after.observe(&verdict(State::Healthy, OperatingState::Running), 20.0);
    assert_eq!(healthy[0].kind, EventKind::Returned);
}

#[test]
fn delays_of_limits_that_are_as_they_were_go_on_and_of_others_begin_anew() {
    let run = |then: &str| {
        let mut before = engine(&delayed("v", ""));
        velocity(&[3.0]).to(&mut before, 10.0);
        velocity(&[3.0]).to(&mut before, 20.0);
        let (mut after, _) = renewed(&before, then);
        velocity(&[3.0]).to(&mut after, 30.0);
        stands(&after)
    };
    // Above it since 10 s: 20 s at 30 s.
    assert_eq!(run(&delayed("v", "")), W);
    // Found by its id, not by its place.
    let other = delayed("w", "warning_above = 99.0\ndamaged_above = 100.0\n");
    assert_eq!(run(&format!("{other}{}", delayed("v", ""))), W);
    assert_eq!(run(&delayed("v", "warning_above = 2.0\ndamaged_above = 9.0\n")), None);
    assert_eq!(run(&delayed("u", "")), None);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// The same settings once more, at any place, change nothing that follows.
    #[test]
    fn settings_that_are_the_same_change_nothing(
        values in prop::collection::vec(0.0_f64..6.0, 1..60),
        at in 0_usize..60,
    ) {
        let limits = format!("{VELOCITY}on_delay_s = 15.0\noff_delay_s = 25.0\n{}", delayed("w", ""));
        let mut plain = engine(&limits);
        let mut changed = engine(&limits);
        for (n, value) in values.iter().enumerate() {
            if n == at {
                let (next, events) = renewed(&changed, &limits);
                prop_assert!(events.is_empty());
                changed = next;
            }
            let time_s = 10.0 * (n as f64 + 1.0);
            let window = velocity(&[*value]);
            prop_assert_eq!(window.to(&mut plain, time_s), window.to(&mut changed, time_s));
        }
        prop_assert_eq!(plain.standing(), changed.standing());
        prop_assert_eq!(plain.history(), changed.history());
        prop_assert_eq!(plain.decisions(), changed.decisions());
    }
}
