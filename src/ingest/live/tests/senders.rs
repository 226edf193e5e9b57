//! Who may send what, and where it lies.

use super::*;

#[test]
fn a_sender_that_comes_back_goes_on_and_one_that_begins_anew_is_placed_by_its_time() {
    let mut intake = intake();
    let greeting = hello(7, vec![channel("x", SampleType::I16)]);
    let admitted = admit(&mut intake, 1, 0.0, &greeting).unwrap();
    assert!(admitted.opened.is_some());
    let first = take(&mut intake, 1, &Owned::ramp(0, 0, 100, 100.0), 200.0).unwrap();
    assert!((first.blocks[0].time_s - 100.0).abs() < 1e-9);
    assert!(intake.leave(1));
    let admitted = admit(&mut intake, 2, 200.0, &greeting).unwrap();
    assert_eq!((admitted.wanted[0].sequence, admitted.wanted[0].index), (1, 100));
    assert_eq!(admitted.opened, None);
    // Its stamp says another time now: inside an epoch the index is the clock.
    let second = take(&mut intake, 2, &Owned::ramp(1, 100, 100, 103.0), 200.0).unwrap();
    let (start, time_s) = (second.blocks[0].start.0, second.blocks[0].time_s);
    assert_eq!((start, second.blocks[0].segment), (100, first.blocks[0].segment));
    assert!((time_s - 100.1).abs() < 1e-9, "{time_s}");
    assert_eq!(intake.status()[0].ledger.lost, 0);

    // Another epoch, ten seconds later: its own counts, its own place, a new segment, no sample lost.
    assert!(intake.leave(2));
    let greeting = hello(8, vec![channel("x", SampleType::I16)]);
    let admitted = admit(&mut intake, 3, 200.0, &greeting).unwrap();
    assert_eq!((admitted.wanted[0].sequence, admitted.wanted[0].index), (0, 0));
    let third = take(&mut intake, 3, &Owned::ramp(0, 0, 100, 110.2), 200.0).unwrap();
    // The last sample ended at 100.2 s: 10 s are 10 000 samples.
    assert_eq!(third.blocks[0].start.0, 200 + 10_000);
    assert!((third.blocks[0].time_s - 110.2).abs() < 1e-9);
    assert!(third.blocks[0].segment > second.blocks[0].segment);
    // One whose clock was set back goes on where stream time is.
    assert!(intake.leave(3));
    let greeting = hello(9, vec![channel("x", SampleType::I16)]);
    admit(&mut intake, 4, 200.0, &greeting).unwrap();
    let fourth = take(&mut intake, 4, &Owned::ramp(0, 0, 100, 50.0), 200.0).unwrap();
    assert!((fourth.blocks[0].time_s - 110.3).abs() < 1e-9, "{}", fourth.blocks[0].time_s);
    let ledger = intake.status()[0].ledger;
    assert_eq!((ledger.used, ledger.lost), (400, 0));
}

#[test]
fn a_channel_has_one_sender_but_the_same_sender_may_come_again() {
    let mut intake = intake();
    admit(&mut intake, 1, 0.0, &hello(1, vec![channel("x", SampleType::I16)])).unwrap();
    take(&mut intake, 1, &Owned::ramp(0, 0, 10, 0.0), 1.0).unwrap();
    let refused = admit(&mut intake, 2, 0.0, &hello(2, vec![channel("x", SampleType::I16)]));
    let refused = refused.unwrap_err();
    assert_eq!(refused.code, ErrorCode::ChannelTaken);
    assert!(refused.text.contains("here") && refused.text.contains("\"x\""), "{}", refused.text);
    // The first is not disturbed.
    take(&mut intake, 1, &Owned::ramp(1, 10, 10, 0.01), 1.0).unwrap();
    // Its connection broke without a word: the new one goes on, the old one is told.
    let again = admit(&mut intake, 3, 1.0, &hello(1, vec![channel("x", SampleType::I16)])).unwrap();
    assert_eq!(again.wanted[0].sequence, 2);
    assert_eq!(
        code(take(&mut intake, 1, &Owned::ramp(2, 20, 10, 0.02), 1.0)),
        ErrorCode::ChannelTaken
    );
    take(&mut intake, 3, &Owned::ramp(2, 20, 10, 0.02), 1.0).unwrap();
    assert!(!intake.leave(1), "the other is still there");
    assert!(intake.leave(3));
    assert_eq!(intake.status()[0].ledger.used, 30);
}

#[test]
fn channels_of_several_senders_rates_and_starts_are_on_one_axis() {
    let mut intake = intake();
    admit(&mut intake, 1, 0.0, &hello(1, vec![channel("x", SampleType::I16)])).unwrap();
    let x = take(&mut intake, 1, &Owned::ramp(0, 5000, 100, 20.0), 30.0).unwrap();
    // A slower one of another sender, which began 2.5 s later, makes it another stream; both go on.
    let slow = Channel { rate_hz: 100.0, ..channel("y", SampleType::I16) };
    let admitted = admit(&mut intake, 2, 30.0, &hello(2, vec![slow])).unwrap();
    let info = admitted.opened.unwrap();
    let names: Vec<&str> = info.channels.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["x", "y"]);
    let y = take(&mut intake, 2, &Owned::ramp(0, 0, 100, 22.5), 30.0).unwrap();
    let x_on = take(&mut intake, 1, &Owned::ramp(1, 5100, 100, 20.1), 30.0).unwrap();
    assert!((x.blocks[0].time_s - 20.0).abs() < 1e-9);
    assert!((y.blocks[0].time_s - 22.5).abs() < 1e-9 && y.blocks[0].channel.0 == 1);
    assert!((x_on.blocks[0].time_s - 20.1).abs() < 1e-9 && x_on.blocks[0].channel.0 == 0);
    assert_eq!(x_on.blocks[0].segment, y.blocks[0].segment);
    assert_eq!(intake.status().iter().map(|c| c.ledger.used).sum::<u64>(), 300);
    // The first one goes and comes with another rate: the other is not disturbed.
    intake.leave(1);
    let fast = Channel { rate_hz: 2000.0, ..channel("x", SampleType::I16) };
    let admitted = admit(&mut intake, 3, 30.0, &hello(3, vec![fast])).unwrap();
    assert_eq!(admitted.opened.unwrap().channels.len(), 2);
    assert_eq!(intake.status().iter().map(|c| c.ledger.used).sum::<u64>(), 300, "counts go on");
    let y = take(&mut intake, 2, &Owned::ramp(1, 100, 100, 23.5), 30.0).unwrap();
    assert_eq!((y.blocks[0].channel.0, y.blocks[0].start.0), (0, 100));
}

#[test]
fn times_and_indices_of_the_future_are_refused() {
    let mut intake = intake();
    admit(&mut intake, 1, 0.0, &hello(1, vec![channel("x", SampleType::I16)])).unwrap();
    let refused = take(&mut intake, 1, &Owned::ramp(0, 0, 10, 11.0), 0.0);
    assert_eq!(code(refused), ErrorCode::TimeAhead);
    take(&mut intake, 1, &Owned::ramp(0, 0, 10, 0.0), 0.0).unwrap();
    // 20 s of samples within a second of the clock.
    let refused = take(&mut intake, 1, &Owned::ramp(1, 20_000, 10, 0.01), 1.0);
    assert_eq!(code(refused), ErrorCode::TimeAhead);
    let ledger = intake.status()[0].ledger;
    assert_eq!((ledger.used, ledger.lost), (10, 0), "nothing has changed");
    // A clock that runs 1 % fast is no hostile one, however long it runs.
    take(&mut intake, 1, &Owned::ramp(1, 10_100_000, 10, 10_000.0), 10_000.0).unwrap();
}

#[test]
fn a_block_is_no_longer_than_what_may_be_judged_at_once() {
    let mut intake = intake();
    let slow = Channel { rate_hz: 0.01, ..channel("x", SampleType::I16) };
    admit(&mut intake, 1, 0.0, &hello(1, vec![slow])).unwrap();
    let refused = take(&mut intake, 1, &Owned::ramp(0, 0, 8, 0.0), 7000.0);
    assert_eq!(code(refused), ErrorCode::TooLarge);
    take(&mut intake, 1, &Owned::ramp(0, 0, 7, 0.0), 7000.0).unwrap();
}

#[test]
fn a_hello_that_cannot_be_used_is_refused_with_the_reason() {
    let bad = |channels: Vec<Channel>| {
        let refused = admit(&mut intake(), 1, 0.0, &hello(1, channels)).unwrap_err();
        assert_eq!(refused.code, ErrorCode::BadChannel, "{}", refused.text);
        refused.text
    };
    let x = || channel("x", SampleType::I16);
    assert!(bad(vec![]).contains("no channel"));
    assert!(bad(vec![x(), x()]).contains("twice"));
    assert!(bad(vec![channel("z", SampleType::I16)]).contains("x, y"));
    assert!(bad(vec![channel("x/y", SampleType::I16)]).contains('/'));
    for rate_hz in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e12] {
        assert!(bad(vec![Channel { rate_hz, ..x() }]).contains("samples a second"));
    }
    for scale in [0.0, f64::NAN, 1e300] {
        assert!(bad(vec![Channel { scale, ..x() }]).contains("scale"));
    }
    assert!(bad(vec![Channel { unit: "furlong".to_owned(), ..x() }]).contains("m/s^2"));
    assert!(bad(vec![Channel { range: Some((1.0, 1.0)), ..x() }]).contains("lowest"));
    // What does not fit is refused, and nothing of it stays.
    let mut intake = intake();
    let greeting = hello(1, vec![x()]);
    let full = &mut |_: &_| Err("no room".to_owned());
    let refused = intake.hello(1, ("here", Arrived(at(0.0))), &greeting, full);
    assert_eq!(code(refused), ErrorCode::NoRoom);
    assert_eq!((intake.n_senders(), intake.status().len()), (0, 0));
    // Nor may names be exchanged for ever: each leaves its counters behind.
    let many = |round: usize| {
        let named = |i: usize| channel(&format!("{round}-{i}"), SampleType::I16);
        let more = (0..4000).map(named).chain([x()]).collect();
        hello(round as u64, more)
    };
    let mut rotating = super::intake();
    for (round, expected) in [(1, true), (2, true), (3, false), (2, true)] {
        let admitted = admit(&mut rotating, 1, 0.0, &many(round));
        assert_eq!(admitted.is_ok(), expected, "{round}");
        assert!(admitted.err().is_none_or(|refusal| refusal.code == ErrorCode::NoRoom));
        rotating.leave(1);
    }
    // A block of a stream that is none, of another type, without samples, without a hello.
    admit(&mut intake, 1, 0.0, &greeting).unwrap();
    let block = || Owned::ramp(0, 0, 10, 0.0);
    let beyond = Owned { stream: 1, ..block() };
    assert_eq!(code(take(&mut intake, 1, &beyond, 0.0)), ErrorCode::Unexpected);
    let other = Owned { kind: SampleType::F32, bytes: vec![0; 8], ..block() };
    assert_eq!(code(take(&mut intake, 1, &other, 0.0)), ErrorCode::Malformed);
    let empty = Owned { bytes: Vec::new(), ..block() };
    assert_eq!(code(take(&mut intake, 1, &empty, 0.0)), ErrorCode::Malformed);
    assert_eq!(code(take(&mut intake, 9, &block(), 0.0)), ErrorCode::Unexpected);
}

#[test]
fn a_sender_that_was_away_while_another_one_came_goes_on_with_its_counts_and_place() {
    let mut intake = intake();
    let (of_x, of_y) = (
        hello(1, vec![channel("x", SampleType::I16)]),
        hello(2, vec![channel("y", SampleType::I16)]),
    );
    admit(&mut intake, 1, 0.0, &of_x).unwrap();
    for k in 0..3 {
        take(&mut intake, 1, &Owned::ramp(k, 100 * k, 100, 0.1 * k as f64), 1.0).unwrap();
    }
    // 400 to 500 is lost, so that what comes late later is known as such.
    take(&mut intake, 1, &Owned::ramp(4, 400, 100, 0.4), 1.0).unwrap();
    // Its line breaks, and before it is back another sender makes the stream another one.
    intake.leave(1);
    let admitted = admit(&mut intake, 2, 1.0, &of_y).unwrap();
    assert_eq!(admitted.opened.unwrap().channels.len(), 1);
    take(&mut intake, 2, &Owned::ramp(0, 0, 50, 0.5), 1.0).unwrap();
    let counted: Vec<(String, u64)> =
        intake.ledgers().map(|(name, ledger)| (name.to_owned(), ledger.used)).collect();
    assert_eq!(counted, [("y".to_owned(), 50), ("x".to_owned(), 400)], "nothing is forgotten");
    let back = admit(&mut intake, 3, 1.0, &of_x).unwrap();
    assert_eq!((back.wanted[0].sequence, back.wanted[0].index), (5, 500));
    let names: Vec<String> = back.opened.unwrap().channels.iter().map(|c| c.name.clone()).collect();
    assert_eq!(names, ["y", "x"]);
    // What it had sent and not seen settled comes again, and what was under way late.
    take(&mut intake, 3, &Owned::ramp(2, 200, 100, 0.2), 1.0).unwrap();
    take(&mut intake, 3, &Owned::ramp(3, 300, 100, 0.3), 1.0).unwrap();
    let on = take(&mut intake, 3, &Owned::ramp(5, 500, 100, 0.5), 1.0).unwrap();
    assert_eq!((on.blocks[0].start.0, on.blocks[0].channel.0), (500, 1));
    assert!((on.blocks[0].time_s - 0.5).abs() < 1e-9);
    let status = intake.status();
    let (y, x) = (&status[0], &status[1]);
    assert_eq!((x.ledger.used, x.ledger.duplicate, x.ledger.late), (500, 100, 100));
    assert_eq!((x.ledger.lost, x.ledger.received), (100, 700));
    assert!(x.ledger.is_conserved() && y.ledger.used == 50);
    // Described otherwise it has its counts, and lies behind what it was.
    intake.leave(3);
    intake.leave(2);
    admit(&mut intake, 4, 1.0, &of_y).unwrap();
    admit(&mut intake, 5, 1.0, &hello(1, vec![channel("x", SampleType::F32)])).unwrap();
    let x = intake.status().pop().unwrap();
    assert_eq!((x.name.as_str(), x.ledger.used), ("x", 500));
    let floats = Owned { kind: SampleType::F32, bytes: vec![0; 40], ..Owned::ramp(0, 0, 0, 0.9) };
    let taken = take(&mut intake, 5, &floats, 1.0).unwrap();
    assert!(taken.blocks[0].start.0 > 600, "{:?}", taken.blocks[0].start);
}

#[test]
fn another_hello_again_and_again_is_refused_and_changes_nothing() {
    let mut intake = intake();
    let described = |i: u32| {
        let mut channel = channel("x", SampleType::F32);
        channel.scale = 1.0 + f64::from(i);
        hello(1, vec![channel])
    };
    let refused =
        (0..).find_map(|i| Some((i, admit(&mut intake, u64::from(i), 0.0, &described(i)).err()?)));
    let (n, refusal) = refused.unwrap();
    assert_eq!((n, refusal.code), (128, ErrorCode::ReopenedTooOften), "{refusal}");
    // The sender that describes its channel as it is goes on.
    assert_eq!(admit(&mut intake, 1000, 1.0, &described(n - 1)).unwrap().opened, None);
}
