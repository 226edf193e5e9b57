//! Senders over real sockets, into a queue that somebody empties or not.

use super::Hub;
use super::Port;
use super::PortPlan;
use super::Room;
use super::client::SendError;
use super::client::Sender;
use super::conversation;
use super::conversation::Who;
use super::line::Address;
use super::tcp;
use crate::access::Counters;
use crate::access::Door;
use crate::access::Role;
use crate::access::Secret;
use crate::access::Token;
use crate::access::Tokens;
use crate::app::link::Input;
use crate::app::link::Link;
use crate::app::link::ShardQueue;
use crate::app::queue::Popped;
use crate::app::stop::Stop;
use crate::app::tests::machine;
use crate::app::tls::Tls;
use crate::app::trouble::Troubles;
use crate::config::Config;
use crate::config::FileText;
use crate::config::Identity;
use crate::config::Ingest;
use crate::config::Live;
use crate::config::MachineConfig;
use crate::config::SourceConfig;
use crate::ingest::live::ledger::Ledger;
use crate::signal::Timestamp;
use crate::telemetry::Metrics;
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
use std::io::Read;
use std::io::Write;
use std::net::SocketAddr;
use std::net::TcpListener;
use std::net::TcpStream;
use std::path::PathBuf;
use std::sync::Arc;
use std::thread;
use std::thread::JoinHandle;
use std::time::Duration;
use tokio::sync::watch;

/// A listener with one machine, `rig-1`, whose channel is `x`.
struct Running {
    address: SocketAddr,
    port: Arc<Port>,
    queue: Arc<ShardQueue>,
    metrics: Arc<Metrics>,
    hub: Arc<Hub>,
    stop: Arc<Stop>,
    listening: JoinHandle<()>,
}

fn running(queue_bytes: usize, ingest: Ingest) -> Running {
    guarded(queue_bytes, ingest, (Arc::new(Door::open()), None))
}

fn guarded(queue_bytes: usize, ingest: Ingest, guard: (Arc<Door>, Option<Tls>)) -> Running {
    let queue = Arc::new(ShardQueue::new(queue_bytes, 1));
    let metrics = Arc::new(Metrics::new());
    let entry = MachineConfig {
        file: PathBuf::new(),
        text: FileText::default(),
        machine: machine("rig-1"),
        baseline: Vec::new(),
        source: SourceConfig::Live(Live::listening()),
    };
    let config = Config { captures: None, ..Config::default() };
    let port = Arc::new(Port::new(PortPlan {
        room: Arc::new(Room::new(config.memory_limit_bytes)),
        config: Arc::new(config),
        entry,
        origin: super::unknown_stream().start_time.unwrap(),
        link: Link::new(Arc::clone(&queue), 0),
        recordings: None,
        recorded: watch::channel(Default::default()).0,
        recording_metrics: metrics.recording("rig-1"),
        troubles: Troubles::default(),
    }));
    let stop = Arc::new(Stop::default());
    let hub =
        Hub::new(&ingest, guard, vec![Arc::clone(&port)], metrics.ingest(), Arc::clone(&stop));
    let hub = Arc::new(hub);
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    listener.set_nonblocking(true).unwrap();
    let address = listener.local_addr().unwrap();
    let (stopped, listened) = (Arc::clone(&stop), Arc::clone(&hub));
    let listening = thread::spawn(move || tcp::run(&listener, &listened, &stopped));
    Running { address, port, queue, metrics, hub, stop, listening }
}

impl Running {
    fn end(self) {
        self.stop.set();
        self.queue.close();
        self.listening.join().unwrap();
    }

    fn ledger(&self) -> Ledger {
        self.port.view().channels[0].ledger
    }

    fn refusals(&self, code: ErrorCode) -> u64 {
        self.metrics.ingest().refused(code.name()).get()
    }

    /// Samples in blocks that are in the queue; takes them out.
    fn drain(&self) -> u64 {
        let mut n = 0;
        loop {
            match self.queue.pop(crate::app::now()) {
                Popped::Item((0, Input::Block(block, _))) => n += block.samples.len() as u64,
                Popped::Item(_) | Popped::Request(_) => {}
                Popped::Timeout | Popped::Closed => return n,
            }
        }
    }
}

fn hello(epoch: u64) -> Hello {
    Hello::new("rig-1", epoch, vec![Channel::new("x", 1e6, SampleType::I16, "")])
}

/// Samples of a block.
const N: u64 = 10_000;

fn frame(sequence: u64) -> Vec<u8> {
    let bytes = vec![1; 2 * usize::try_from(N).unwrap()];
    let samples = Samples::new(SampleType::I16, &bytes).unwrap();
    let first = sequence * N;
    let block = Block { stream: 0, sequence, first, time_ns: NO_TIME, samples };
    let mut frame = Vec::new();
    wire::encode(&Message::Block(block), &mut frame).unwrap();
    frame
}

fn send(sender: &mut Sender, sequence: u64) -> Result<(), SendError> {
    let mut frames = Frames::default();
    frames.push(&frame(sequence));
    let (message, _) = frames.take().unwrap().unwrap();
    let Message::Block(block) = message else { panic!("a block") };
    sender.send(&block, 1 << 30)
}

/// A connection that says what it wants.
struct Raw {
    stream: TcpStream,
    frames: Frames,
}

impl Raw {
    fn connect(address: SocketAddr) -> Self {
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        Self { stream, frames: Frames::default() }
    }

    fn greeted(address: SocketAddr, epoch: u64) -> Self {
        let mut raw = Self::connect(address);
        raw.say(&Message::Hello(hello(epoch)));
        raw.until(|message| matches!(message, Message::Welcome(_)).then_some(()));
        raw
    }

    fn say(&mut self, message: &Message<'_>) {
        let mut frame = Vec::new();
        wire::encode(message, &mut frame).unwrap();
        self.stream.write_all(&frame).unwrap();
    }

    /// Reads until `is_it` gives something.
    fn until<T>(&mut self, is_it: impl Fn(&Message<'_>) -> Option<T>) -> T {
        loop {
            while let Some((message, _)) = self.frames.take().unwrap() {
                if let Some(found) = is_it(&message) {
                    return found;
                }
                if let Message::Problem(problem) = message {
                    panic!("{problem:?}");
                }
            }
            let n = self.stream.read(self.frames.space()).unwrap();
            assert!(n > 0, "the daemon has closed");
            self.frames.filled(n);
        }
    }

    /// What it is told at the end.
    fn problem(&mut self) -> ErrorCode {
        self.until(|message| {
            let Message::Problem(problem) = message else { return None };
            Some(problem.code)
        })
    }
}

fn wait_for(mut is_so: impl FnMut() -> bool) {
    let deadline = crate::app::now() + Duration::from_secs(30);
    while !is_so() {
        assert!(crate::app::now() < deadline, "waited in vain");
        thread::sleep(Duration::from_millis(5));
    }
}

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
    fn receive(&mut self, frames: &mut Frames) -> std::io::Result<Option<usize>> {
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
