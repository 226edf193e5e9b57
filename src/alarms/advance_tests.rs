//! Silence in advance: from the first, with its time, its end, over restarts and other settings.

use super::super::life_tests::at;
use super::super::life_tests::kept;
use super::super::life_tests::kinds;
use super::super::limit_tests::VELOCITY;
use super::super::limit_tests::channels;
use super::super::limit_tests::engine;
use super::super::limit_tests::machine;
use super::super::limit_tests::velocity;
use super::super::state::ShownState;
use super::super::*;
use super::*;

fn wanted(subject: Subject, silence: Silence, for_s: Option<f64>) -> Announcement {
    let (author, comment) = ("M. Ito".to_owned(), "being painted".to_owned());
    let ends = for_s.map_or(Ends::ByHand, Ends::After);
    Announcement { subject, silence, ends, author, comment }
}

fn limit() -> Subject {
    Subject::Limit("v".to_owned())
}

#[test]
fn an_alarm_that_was_silenced_in_advance_is_silent_from_the_first_and_asks_for_nothing() {
    let mut engine = engine(VELOCITY);
    let (said, events) =
        engine.announce(&wanted(limit(), Silence::Suppressed, None), at(1.0)).unwrap();
    assert_eq!((said.number, events.len()), (1, 0));
    assert_eq!(velocity(&[3.0]).to(&mut engine, 10.0), [EventKind::Raised]);
    let alarm = engine.standing().remove(0);
    assert_eq!(alarm.shown(), ShownState::Suppressed);
    let silencing = alarm.silencing.clone().unwrap();
    assert_eq!(
        (silencing.author.as_str(), silencing.comment.as_str()),
        ("M. Ito", "being painted")
    );
    assert_eq!(engine.history()[0].alarm, alarm, "told as silent");
    assert_eq!(load::of(engine.history(), &engine.standing(), 10.0), load::Load::default());
    // Its life goes on behind it.
    assert_eq!(velocity(&[5.0]).to(&mut engine, 20.0), [EventKind::Escalated]);
    let (_, events) = engine.revoke(1, ("A. Berg", "dry"), at(21.0)).unwrap();
    assert_eq!(kinds(&events), [EventKind::Unsuppressed]);
    assert_eq!(events[0].by.as_ref().unwrap().author, "A. Berg");
    assert_eq!(engine.standing()[0].shown(), ShownState::Unacknowledged);
    assert!(engine.advance().is_empty());
    assert_eq!(engine.revoke(1, ("A", ""), at(22.0)), Err(AdvanceError::Unknown { number: 1 }));
}

#[test]
fn it_ends_by_its_time_and_with_it_the_silence_of_what_was_raised() {
    let mut engine = engine(VELOCITY);
    engine.announce(&wanted(limit(), Silence::OutOfService, Some(60.0)), at(1.0)).unwrap();
    velocity(&[3.0]).to(&mut engine, 10.0);
    assert_eq!(engine.standing()[0].shown(), ShownState::OutOfService);
    assert!(engine.tick(at(60.9), DataFlow::Flowing, None).is_empty());
    assert_eq!(
        kinds(&engine.tick(at(61.0), DataFlow::Flowing, None)),
        [EventKind::ReturnedToService]
    );
    assert_eq!(engine.standing()[0].shown(), ShownState::Unacknowledged);
    assert!(engine.advance().is_empty());
}

#[test]
fn what_stands_is_silenced_with_it() {
    let mut engine = engine(VELOCITY);
    velocity(&[3.0]).to(&mut engine, 10.0);
    let (_, events) =
        engine.announce(&wanted(limit(), Silence::Suppressed, None), at(11.0)).unwrap();
    assert_eq!(kinds(&events), [EventKind::Suppressed]);
    assert_eq!(engine.standing()[0].shown(), ShownState::Suppressed);
}

#[test]
fn it_survives_a_restart_and_other_settings_as_long_as_there_is_such_a_thing() {
    let mut before = engine(VELOCITY);
    before.announce(&wanted(limit(), Silence::Suppressed, None), at(1.0)).unwrap();
    let mut after = engine(VELOCITY);
    after.restore(kept(&before, None), at(2.0));
    assert_eq!(after.advance(), before.advance());
    velocity(&[3.0]).to(&mut after, 10.0);
    assert_eq!(after.standing()[0].shown(), ShownState::Suppressed);
    let settings = after.settings().clone();
    let strict = format!("{VELOCITY}warning_above = 1.0\ndamaged_above = 9.0\n");
    let (next, _) = after.renewed(&machine(&strict), &channels(), settings.clone(), at(11.0));
    assert_eq!(next.advance(), before.advance());
    let (mut gone, _) = next.renewed(&machine(""), &channels(), settings, at(12.0));
    assert!(gone.advance().is_empty());
    // Its number is not used again.
    let channel = Subject::Channel("x".to_owned());
    let (said, _) = gone.announce(&wanted(channel, Silence::Suppressed, None), at(13.0)).unwrap();
    assert_eq!(said.number, 2);
}

fn maintained(for_s: f64) -> Announcement {
    wanted(Subject::Machine, Silence::OutOfService, Some(for_s))
}

#[test]
fn a_machine_that_is_maintained_raises_nothing_that_asks_until_its_time() {
    let mut engine = engine(VELOCITY);
    velocity(&[3.0]).to(&mut engine, 10.0);
    let (said, events) = engine.announce(&maintained(100.0), at(11.0)).unwrap();
    assert!(said.is_maintenance());
    assert_eq!(kinds(&events), [EventKind::RemovedFromService], "what stands, too");
    // The stream stops and a channel does not come: neither asks for anybody.
    let raised = engine.tick(at(40.0), DataFlow::SilentFor(30.0), Some("disk full"));
    assert_eq!(kinds(&raised), [EventKind::Raised, EventKind::Raised]);
    let shown = |engine: &AlarmEngine| -> Vec<_> {
        let standing = engine.standing();
        standing.iter().map(|alarm| (alarm.source.clone(), alarm.shown())).collect()
    };
    let out = ShownState::OutOfService;
    let expected = [
        (AlarmSource::Store, ShownState::Unacknowledged),
        (AlarmSource::Data, out),
        (AlarmSource::Limit("v".to_owned()), out),
    ];
    assert_eq!(shown(&engine), expected, "a store that fails is of no machine");
    assert!(engine.take_ended_maintenances().is_empty());
    let back = engine.tick(at(111.0), DataFlow::Flowing, Some("disk full"));
    assert_eq!(back.iter().filter(|e| e.kind == EventKind::ReturnedToService).count(), 2);
    assert!(engine.standing().iter().all(|alarm| alarm.silencing.is_none()));
    assert_eq!(engine.take_ended_maintenances(), [said]);
    assert!(engine.take_ended_maintenances().is_empty() && engine.maintenance().is_none());
}

#[test]
fn what_was_silent_on_its_own_stays_so_after_a_maintenance() {
    let mut engine = engine(VELOCITY);
    engine.announce(&wanted(limit(), Silence::Suppressed, None), at(1.0)).unwrap();
    engine.announce(&maintained(100.0), at(2.0)).unwrap();
    velocity(&[3.0]).to(&mut engine, 10.0);
    assert_eq!(engine.standing()[0].shown(), ShownState::OutOfService, "the stronger one");
    let (_, events) = engine.revoke(2, ("A. Berg", "done"), at(11.0)).unwrap();
    assert_eq!(kinds(&events), [EventKind::ReturnedToService, EventKind::Suppressed]);
    assert_eq!(engine.standing()[0].shown(), ShownState::Suppressed);
    // And what somebody took out of service alone is not returned by the end of a maintenance.
    engine.revoke(1, ("A. Berg", ""), at(12.0)).unwrap();
    let id = engine.standing()[0].id;
    let (author, comment) = ("K. Lund".to_owned(), "sensor off".to_owned());
    let act = Act { alarm: id, action: Action::TakeOutOfService, author, comment };
    engine.act(&act, at(13.0)).unwrap();
    let (said, events) = engine.announce(&maintained(5.0), at(14.0)).unwrap();
    assert!(events.is_empty());
    engine.revoke(said.number, ("A. Berg", "done"), at(15.0)).unwrap();
    assert_eq!(engine.standing()[0].silencing.as_ref().unwrap().author, "K. Lund");
}

#[test]
fn a_maintenance_may_be_given_another_time_and_needs_a_reason() {
    let mut engine = engine(VELOCITY);
    velocity(&[3.0]).to(&mut engine, 10.0);
    engine.announce(&maintained(10.0), at(11.0)).unwrap();
    let until = at(111.0).utc;
    let longer = Announcement { ends: Ends::At(until), ..maintained(1.0) };
    let (said, events) = engine.announce(&longer, at(12.0)).unwrap();
    assert_eq!((said.number, kinds(&events)), (2, vec![EventKind::RemovedFromService]));
    assert_eq!(engine.advance(), std::slice::from_ref(&said));
    assert_eq!(said.until.unwrap().utc, until);
    assert!(engine.tick(at(22.0), DataFlow::Flowing, None).is_empty(), "not the first one's time");
    assert_eq!(
        kinds(&engine.tick(at(111.0), DataFlow::Flowing, None)),
        [EventKind::ReturnedToService]
    );
    for refused in [
        Announcement { comment: " ".to_owned(), ..maintained(1.0) },
        Announcement { ends: Ends::ByHand, ..maintained(1.0) },
        Announcement { ends: Ends::At(until), ..maintained(1.0) },
        Announcement { silence: Silence::Suppressed, ..maintained(1.0) },
    ] {
        let told = engine.announce(&refused, at(112.0));
        assert!(matches!(told, Err(AdvanceError::NotAllowed(_))), "{told:?}");
    }
}

#[test]
fn what_cannot_be_is_refused_in_words() {
    let mut engine = engine(VELOCITY);
    let unknown = [
        Subject::Limit("w".to_owned()),
        Subject::Channel("w".to_owned()),
        Subject::Component(ComponentKind::Bearing, "left".to_owned()),
    ];
    let refused = |engine: &mut AlarmEngine, wanted: &Announcement| {
        engine.announce(wanted, at(1.0)).unwrap_err().to_string()
    };
    for subject in unknown {
        let words = subject.words();
        let told = refused(&mut engine, &wanted(subject, Silence::Suppressed, None));
        assert!(told.contains(&words), "{told}");
    }
    let told = refused(&mut engine, &wanted(limit(), Silence::Shelved, None));
    assert!(told.contains("only suppressed and out_of_service"), "{told}");
    for for_s in [0.0, -1.0, f64::NAN, f64::INFINITY, 4e7] {
        let told = refused(&mut engine, &wanted(limit(), Silence::Suppressed, Some(for_s)));
        assert!(told.contains("within 31536000 s"), "{told}");
    }
    let nobody =
        Announcement { author: " ".to_owned(), ..wanted(limit(), Silence::Suppressed, None) };
    assert!(refused(&mut engine, &nobody).contains("must not be empty"));
    assert!(engine.advance().is_empty());
    engine.announce(&wanted(limit(), Silence::Suppressed, None), at(1.0)).unwrap();
    let told = refused(&mut engine, &wanted(limit(), Silence::OutOfService, None));
    assert!(told.contains("by M. Ito: end silence 1 first"), "{told}");
}
