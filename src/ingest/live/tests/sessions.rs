//! Turns of a connection, and credit.

use super::*;

fn block_message(owned: &Owned) -> Message<'_> {
    Message::Block(owned.block())
}

#[test]
fn credit_shrinks_as_the_queue_fills_and_is_never_taken_back() {
    let mut session = Session::new(0.0);
    let greeting = Message::Hello(hello(1, vec![channel("x", SampleType::I16)]));
    session.frame(&greeting, 100, 0.1).unwrap();
    let welcome = session.welcome(Vec::new(), 0.0);
    assert_eq!(welcome.credit_bytes, CREDIT_BYTES);
    let owned = Owned::ramp(0, 0, 100, 0.0);
    let half = usize::try_from(CREDIT_BYTES / 2).unwrap();
    let frame = |session: &mut Session, n| session.frame(&block_message(&owned), n, 0.2).unwrap();
    assert!(frame(&mut session, half));
    session.settle(0, 1, 0.2);
    // Much has come: an ack at once; the queue is full: no more from here on. What was given stays.
    let ack = session.ack(0.95, 0.2).unwrap();
    assert_eq!((ack.credit_bytes, ack.progress.len()), (0, 1));
    assert!(frame(&mut session, half), "it was under way already");
    assert!(!frame(&mut session, 100), "this was not");
    assert_eq!(session.ack(0.95, 0.21), None, "nothing is settled");
    // There is room again: it is told without being asked.
    let ack = session.ack(0.1, 0.22).unwrap();
    assert_eq!(ack.credit_bytes, CREDIT_BYTES);
    assert!(frame(&mut session, 100));
    session.settle(0, 2, 0.3);
    assert_eq!(session.ack(0.6, 0.31), None, "a little waits for more");
    assert_eq!(session.ack(0.6, 0.36).unwrap().credit_bytes, CREDIT_BYTES / 4);
    assert_eq!(session.ack(0.0, 9.0), None);
    session.frame(&Message::Ping, 12, 9.0).unwrap();
    assert!(session.ack(0.0, 9.0).is_some(), "a ping is answered");
}

#[test]
fn frames_out_of_turn_and_senders_that_take_too_long_are_named() {
    let greeting = || Message::Hello(hello(1, vec![channel("x", SampleType::I16)]));
    let owned = Owned::ramp(0, 0, 100, 0.0);
    let mut session = Session::new(0.0);
    assert_eq!(code(session.frame(&block_message(&owned), 100, 0.0)), ErrorCode::Unexpected);
    assert_eq!(code(Session::new(0.0).frame(&Message::Ping, 12, 0.0)), ErrorCode::Unexpected);
    session.tick(false, HELLO_S).unwrap();
    assert_eq!(code(session.tick(true, HELLO_S + 0.1)), ErrorCode::Timeout);
    session.frame(&greeting(), 100, 1.0).unwrap();
    assert_eq!(code(session.frame(&greeting(), 100, 1.0)), ErrorCode::Unexpected);
    // A frame that comes byte by byte.
    session.tick(true, 2.0).unwrap();
    session.tick(true, 2.0 + FRAME_S).unwrap();
    assert_eq!(code(session.tick(true, 2.1 + FRAME_S)), ErrorCode::Timeout);
    // One that comes in time, then silence.
    session.frame(&Message::Ping, 12, 20.0).unwrap();
    session.tick(false, 20.0 + IDLE_S).unwrap();
    assert_eq!(code(session.tick(false, 20.1 + IDLE_S)), ErrorCode::Timeout);
    session.frame(&Message::Bye(Bye::End), 13, 30.0).unwrap();
    assert!(session.is_over() && session.ack(0.0, 30.0).is_some());
    assert_eq!(code(session.frame(&Message::Ping, 12, 30.0)), ErrorCode::Unexpected);
}
