//! For tests of live senders: a listener in this process, a sender, and a connection that says what it wants.

use super::Hub;
use super::Port;
use super::PortPlan;
use super::Room;
use super::client::SendError;
use super::client::Sender;
use super::tcp;
use crate::access::Door;
use crate::app::link::Input;
use crate::app::link::Link;
use crate::app::link::ShardQueue;
use crate::app::queue::Popped;
use crate::app::renewal::InForce;
use crate::app::stop::Stop;
use crate::app::tests::machine;
use crate::app::tls::Tls;
use crate::app::trouble::Troubles;
use crate::config::Config;
use crate::config::FileText;
use crate::config::Ingest;
use crate::config::Live;
use crate::config::MachineConfig;
use crate::config::SourceConfig;
use crate::ingest::live::ledger::Ledger;
use crate::telemetry::Metrics;
use crate::wire;
use crate::wire::Block;
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
pub(super) struct Running {
    pub(super) address: SocketAddr,
    pub(super) port: Arc<Port>,
    pub(super) queue: Arc<ShardQueue>,
    pub(super) metrics: Arc<Metrics>,
    pub(super) hub: Arc<Hub>,
    pub(super) stop: Arc<Stop>,
    pub(super) listening: JoinHandle<()>,
}

pub(super) fn running(queue_bytes: usize, ingest: Ingest) -> Running {
    guarded(queue_bytes, ingest, (Arc::new(Door::open()), None))
}

pub(super) fn guarded(
    queue_bytes: usize,
    ingest: Ingest,
    guard: (Arc<Door>, Option<Tls>),
) -> Running {
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
        in_force: watch::channel(InForce::of(&config, &entry)).1,
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
    pub(super) fn end(self) {
        self.stop.set();
        self.queue.close();
        self.listening.join().unwrap();
    }

    pub(super) fn ledger(&self) -> Ledger {
        self.port.view().channels[0].ledger
    }

    pub(super) fn refusals(&self, code: ErrorCode) -> u64 {
        self.metrics.ingest().refused(code.name()).get()
    }

    /// Samples in blocks that are in the queue; takes them out.
    pub(super) fn drain(&self) -> u64 {
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

pub(super) fn hello(epoch: u64) -> Hello {
    Hello::new("rig-1", epoch, vec![Channel::new("x", 1e6, SampleType::I16, "")])
}

/// Samples of a block.
pub(super) const N: u64 = 10_000;

pub(super) fn frame(sequence: u64) -> Vec<u8> {
    let bytes = vec![1; 2 * usize::try_from(N).unwrap()];
    let samples = Samples::new(SampleType::I16, &bytes).unwrap();
    let first = sequence * N;
    let block = Block { stream: 0, sequence, first, time_ns: NO_TIME, samples };
    let mut frame = Vec::new();
    wire::encode(&Message::Block(block), &mut frame).unwrap();
    frame
}

pub(super) fn send(sender: &mut Sender, sequence: u64) -> Result<(), SendError> {
    let mut frames = Frames::default();
    frames.push(&frame(sequence));
    let (message, _) = frames.take().unwrap().unwrap();
    let Message::Block(block) = message else { panic!("a block") };
    sender.send(&block, 1 << 30)
}

/// A connection that says what it wants.
pub(super) struct Raw {
    pub(super) stream: TcpStream,
    pub(super) frames: Frames,
}

impl Raw {
    pub(super) fn connect(address: SocketAddr) -> Self {
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        Self { stream, frames: Frames::default() }
    }

    pub(super) fn greeted(address: SocketAddr, epoch: u64) -> Self {
        let mut raw = Self::connect(address);
        raw.say(&Message::Hello(hello(epoch)));
        raw.until(|message| matches!(message, Message::Welcome(_)).then_some(()));
        raw
    }

    pub(super) fn say(&mut self, message: &Message<'_>) {
        let mut frame = Vec::new();
        wire::encode(message, &mut frame).unwrap();
        self.stream.write_all(&frame).unwrap();
    }

    /// Reads until `is_it` gives something.
    pub(super) fn until<T>(&mut self, is_it: impl Fn(&Message<'_>) -> Option<T>) -> T {
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
    pub(super) fn problem(&mut self) -> ErrorCode {
        self.until(|message| {
            let Message::Problem(problem) = message else { return None };
            Some(problem.code)
        })
    }
}

pub(super) fn wait_for(mut is_so: impl FnMut() -> bool) {
    let deadline = crate::app::now() + Duration::from_secs(30);
    while !is_so() {
        assert!(crate::app::now() < deadline, "waited in vain");
        thread::sleep(Duration::from_millis(5));
    }
}
