//! Senders over real sockets, into a queue that somebody empties or not.

use super::client::SendError;
use super::client::Sender;
use super::conversation;
use super::conversation::Who;
use super::line::Address;
use super::played::N;
use super::played::Raw;
use super::played::frame;
use super::played::guarded;
use super::played::hello;
use super::played::running;
use super::played::send;
use super::played::wait_for;
use crate::access::Counters;
use crate::access::Door;
use crate::access::Role;
use crate::access::Secret;
use crate::access::Token;
use crate::access::Tokens;
use crate::app::link::Input;
use crate::app::queue::Popped;
use crate::app::tls::Tls;
use crate::config::Identity;
use crate::config::Ingest;
use crate::signal::Timestamp;
use crate::wire;
use crate::wire::Block;
use crate::wire::Bye;
use crate::wire::Channel;
use crate::wire::ErrorCode;
use crate::wire::Frames;
use crate::wire::Hello;
use crate::wire::Message;
use crate::wire::NO_TIME;
use crate::wire::SampleType;
use crate::wire::Samples;
use std::io::Write;
use std::net::TcpListener;
use std::net::TcpStream;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

#[test]
fn a_sender_that_keeps_to_its_credit_loses_nothing_while_the_analysis_stands_still() {
    // Room for three blocks: two bytes and as single precision and as they came.
    let running = running(300_000, Ingest::default());
    let mut sender =
        Sender::connect(&Address::Tcp(running.address.to_string(), false), None, hello(1)).unwrap();
    for sequence in 0..200 {
        send(&mut sender, sequence).unwrap();
    }
    // Nobody takes anything out: what has come waits in the queue, the rest at the sender.
    wait_for(|| running.ledger().used >= 3 * N);
    assert!(running.queue.bytes() <= 300_000);
    let finishing = thread::spawn(move || sender.finish(Bye::End));
    let mut n = 0;
    wait_for(|| {
        n += running.drain();
        n == 200 * N
    });
    finishing.join().unwrap().unwrap();
    let ledger = running.ledger();
    assert_eq!((ledger.received, ledger.used, ledger.lost), (200 * N, 200 * N, 0));
    assert!(ledger.is_conserved());
    running.end();
}

#[test]
fn a_sender_that_ignores_its_credit_loses_its_newest_blocks_and_they_are_counted() {
    let running = running(300_000, Ingest::default());
    let mut raw = Raw::greeted(running.address, 1);
    // With nothing taken out, what is within the credit given before waits; the queue is full, no more is given.
    let mut writing = raw.stream.try_clone().unwrap();
    let n_sent = 400;
    let flood = thread::spawn(move || {
        for sequence in 0..n_sent {
            writing.write_all(&frame(sequence)).unwrap();
        }
    });
    thread::sleep(Duration::from_millis(50));
    // As slow as an analysis that falls behind: some is taken out at times.
    let mut n = 0;
    wait_for(|| {
        if let Popped::Item((0, Input::Block(block, _))) = running.queue.pop(crate::app::now()) {
            n += block.samples.len() as u64;
        }
        running.port.view().channels.first().is_some_and(|c| c.ledger.received == n_sent * N)
    });
    flood.join().unwrap();
    raw.say(&Message::Ping);
    let settled = raw.until(|message| {
        let Message::Ack(ack) = message else { return None };
        ack.progress.iter().map(|p| p.sequence).max().filter(|s| *s == n_sent)
    });
    assert_eq!(settled, n_sent, "what was dropped is settled: it is not wanted again");
    n += running.drain();
    let ledger = running.ledger();
    assert_eq!(ledger.used, n);
    assert_eq!(ledger.used + ledger.dropped, n_sent * N);
    assert!(ledger.is_conserved());
    running.end();
}

#[test]
fn a_broken_connection_goes_on_where_it_was_and_a_wrong_checksum_costs_no_sample() {
    let running = running(1 << 30, Ingest::default());
    let mut raw = Raw::greeted(running.address, 5);
    raw.stream.write_all(&frame(0)).unwrap();
    let mut damaged = frame(1);
    damaged[100] ^= 1;
    raw.stream.write_all(&damaged).unwrap();
    assert_eq!(raw.problem(), ErrorCode::Checksum);
    assert_eq!(running.refusals(ErrorCode::Checksum), 1);
    // Cut off in the middle of a frame.
    let mut raw = Raw::greeted(running.address, 5);
    raw.stream.write_all(&frame(1)).unwrap();
    raw.stream.write_all(&frame(2)[..500]).unwrap();
    wait_for(|| running.ledger().used == 2 * N);
    drop(raw);
    let mut raw = Raw::connect(running.address);
    raw.say(&Message::Hello(hello(5)));
    let wanted = raw.until(|message| {
        let Message::Welcome(welcome) = message else { return None };
        Some(welcome.wanted[0])
    });
    assert_eq!((wanted.sequence, wanted.index), (2, 2 * N));
    raw.stream.write_all(&frame(2)).unwrap();
    // A replayed one changes nothing but a count.
    raw.stream.write_all(&frame(0)).unwrap();
    wait_for(|| running.ledger().duplicate == N);
    assert_eq!((running.ledger().used, running.ledger().lost), (3 * N, 0));
    running.end();
}

#[test]
fn a_disk_that_takes_its_time_delays_nothing_that_answers() {
    let running = running(1 << 30, Ingest::default());
    let mut raw = Raw::greeted(running.address, 1);
    // As if the recorder stood in a write: whoever sends waits, who asks does not.
    let writing = running.port.recorder();
    raw.stream.write_all(&frame(0)).unwrap();
    assert_eq!(running.port.view().n_senders, 1);
    running.port.count(&running.metrics);
    assert_eq!(running.ledger().received, 0, "it waits for the recorder");
    drop(writing);
    wait_for(|| running.ledger().used == N);
    running.end();
}

/// Says hello, then falls over.
struct Falling(bool);

impl conversation::Transport for Falling {
    fn receive(&mut self, frames: &mut Frames) -> Result<Option<usize>, conversation::Ending> {
        assert!(!std::mem::replace(&mut self.0, true), "as a mistake of ours would");
        let mut bytes = Vec::new();
        wire::encode(&Message::Hello(hello(1)), &mut bytes).unwrap();
        frames.push(&bytes);
        Ok(Some(bytes.len()))
    }

    fn send(&mut self, _: &[u8]) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_conversation_that_panics_gives_its_channels_up() {
    let running = running(1 << 30, Ingest::default());
    let seat = running.hub.enter().unwrap();
    let talk = thread::spawn(move || {
        conversation::run(&seat, "here", Who::Known(None), &mut Falling(false))
    });
    assert!(talk.join().is_err());
    assert_eq!(running.port.view().n_senders, 0);
    assert_eq!(running.hub.n_connections(), 0);
    Raw::greeted(running.address, 2);
    running.end();
}

#[test]
fn a_sender_that_comes_back_waits_for_its_channel_and_one_that_is_new_is_told() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = Address::Tcp(listener.local_addr().unwrap().to_string(), false);
    let daemon = thread::spawn(move || {
        let welcome = || {
            let wanted = vec![wire::Wanted { sequence: 0, index: 0 }];
            Message::Welcome(wire::Welcome { credit_bytes: 1 << 20, wanted })
        };
        let taken =
            || Message::Problem(wire::Problem::new(ErrorCode::ChannelTaken, "by another one"));
        let greet = |answer: Message<'_>| {
            let mut raw = Raw { stream: listener.accept().unwrap().0, frames: Frames::default() };
            raw.until(|message| matches!(message, Message::Hello(_)).then_some(()));
            raw.say(&answer);
            raw
        };
        drop(greet(taken()));
        drop(greet(welcome()));
        // The line broke, and somebody else has the channel, twice.
        drop((greet(taken()), greet(taken())));
        let mut raw = greet(welcome());
        raw.until(|message| matches!(message, Message::Block(_)).then_some(()));
        let progress = vec![wire::Progress { stream: 0, sequence: 1 }];
        raw.say(&Message::Ack(wire::Ack { credit_bytes: 1 << 20, progress }));
        raw.until(|message| matches!(message, Message::Bye(_)).then_some(()));
    });
    let refused = Sender::connect(&address, None, hello(1)).unwrap_err();
    assert!(matches!(refused, SendError::Refused { code: ErrorCode::ChannelTaken, .. }));
    let mut sender = Sender::connect(&address, None, hello(1)).unwrap();
    send(&mut sender, 0).unwrap();
    sender.finish(Bye::End).unwrap();
    daemon.join().unwrap();
}

#[test]
fn hostile_senders_get_a_name_and_disturb_nobody() {
    let ingest = Ingest { max_connections: 8, ..Ingest::default() };
    let running = running(1 << 30, ingest);
    let mut good = Raw::greeted(running.address, 1);
    let told = |bytes: &[u8]| {
        let mut raw = Raw::connect(running.address);
        raw.stream.write_all(bytes).unwrap();
        raw.problem()
    };
    assert_eq!(told(b"GET / HTTP/1.1\r\n\r\n"), ErrorCode::Malformed);
    assert_eq!(told(b"RW\x09\x01"), ErrorCode::Version);
    assert_eq!(told(b"RW\x01\x01\xff\xff\xff\xff"), ErrorCode::TooLarge);
    assert_eq!(told(&frame(0)), ErrorCode::Unexpected);
    let said = |change: &dyn Fn(&mut Hello)| {
        let mut hello = hello(2);
        change(&mut hello);
        let mut frame = Vec::new();
        wire::encode(&Message::Hello(hello), &mut frame).unwrap();
        told(&frame)
    };
    assert_eq!(said(&|hello| hello.machine = "none".to_owned()), ErrorCode::UnknownMachine);
    assert_eq!(said(&|hello| hello.channels.clear()), ErrorCode::BadChannel);
    assert_eq!(said(&|_| ()), ErrorCode::ChannelTaken);
    let wide = |hello: &mut Hello| {
        hello.channels[0].rate_hz = 1e7;
        let channel = |i| Channel { name: format!("c{i}"), ..hello.channels[0].clone() };
        let more: Vec<Channel> = (0..4000).map(channel).collect();
        hello.channels = more;
        hello.channels.push(Channel { name: "y".to_owned(), ..hello.channels[0].clone() });
    };
    assert!(matches!(said(&wide), ErrorCode::NoRoom | ErrorCode::BadChannel));
    // A crowd: as many as may are held, all others are told at once.
    let crowd: Vec<TcpStream> =
        (0..200).map(|_| TcpStream::connect(running.address).unwrap()).collect();
    wait_for(|| running.refusals(ErrorCode::TooManyConnections) >= 190);
    drop(crowd);
    // The good one has noticed nothing.
    for sequence in 0..20 {
        good.stream.write_all(&frame(sequence)).unwrap();
    }
    wait_for(|| running.ledger().used == 20 * N);
    let counted = [
        ErrorCode::Malformed,
        ErrorCode::Version,
        ErrorCode::TooLarge,
        ErrorCode::Unexpected,
        ErrorCode::UnknownMachine,
        ErrorCode::ChannelTaken,
    ];
    for code in counted {
        assert_eq!(running.refusals(code), 1, "{code:?}");
    }
    running.end();
}

/// A door that knows three tokens: one may send, one may not, one may of another machine.
fn door() -> Arc<Door> {
    let mut tokens = Tokens::default();
    for (n, role, machine) in [
        (1, Role::Ingest, None),
        (2, Role::Operator, None),
        (3, Role::Ingest, Some("rig-2".to_owned())),
    ] {
        let machines: Vec<String> = machine.into_iter().collect();
        let token =
            Token::new(&Secret::of(&[n; 32]), (&n.to_string(), role), &machines, (None, None));
        tokens.add(token.unwrap()).unwrap();
    }
    Arc::new(Door::new(Some(tokens), Counters::default(), Arc::new(|| (Timestamp(0), 0.0))))
}

#[test]
fn a_token_is_asked_for_tells_nothing_of_machines_and_ends_what_it_began() {
    let identity = {
        let made = rcgen::generate_simple_self_signed(vec!["127.0.0.1".to_owned()]).unwrap();
        let (cert, key) = (made.cert.pem(), made.signing_key.serialize_pem());
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("ca.pem"), &cert).unwrap();
        let trust = crate::app::client::tls(Some(&dir.path().join("ca.pem"))).unwrap();
        (Identity::of_pem(&cert, &key).unwrap(), trust)
    };
    let (identity, trust) = identity;
    for tls in [None, Some(Tls::new(&identity).unwrap())] {
        let (encrypts, door) = (tls.is_some(), door());
        let running = guarded(1 << 30, Ingest::default(), (Arc::clone(&door), tls));
        let address = Address::Tcp(running.address.to_string(), encrypts);
        let connect = |token: &str, machine: &str| {
            let (token, machine) = (token.to_owned(), machine.to_owned());
            Sender::connect(
                &address,
                Some(Arc::clone(&trust)),
                Hello { token, machine, ..hello(1) },
            )
        };
        let secret = |n: u8| Secret::of(&[n; 32]).reveal().to_owned();
        for wrong in [String::new(), secret(9), secret(1).to_lowercase(), secret(2)] {
            let refused = connect(&wrong, "rig-1").unwrap_err();
            assert!(
                matches!(refused, SendError::Refused { code: ErrorCode::Unauthorised, .. }),
                "{refused}"
            );
        }
        // A machine that a token is not of, and one that there is not, are refused in the same words.
        let [other, none] =
            ["rig-1", "rig-9"].map(|id| connect(&secret(3), id).unwrap_err().to_string());
        assert_eq!(other.replace("rig-1", ""), none.replace("rig-9", ""));
        assert!(!format!("{:?}", Hello { token: secret(1), ..hello(1) }).contains(&secret(1)));
        let mut sender = connect(&secret(1), "rig-1").unwrap();
        let bytes = [0; 4];
        let samples = Samples::new(SampleType::I16, &bytes).unwrap();
        let block = |sequence| Block {
            stream: 0,
            sequence,
            first: 2 * sequence,
            time_ns: NO_TIME,
            samples,
        };
        sender.send(&block(0), 1 << 20).unwrap();
        door.set(Tokens::default());
        // Within a second it is out, and may not come again.
        let refused = (1..).find_map(|sequence| {
            thread::sleep(Duration::from_millis(5));
            sender.send(&block(sequence), 1 << 20).err()
        });
        let refused = refused.unwrap();
        assert!(
            matches!(refused, SendError::Refused { code: ErrorCode::Unauthorised, .. }),
            "{refused}"
        );
        running.end();
    }
}
