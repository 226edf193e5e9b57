//! The other end: a sender that comes back after a break and goes on where the daemon wants it to.
//!
//! It keeps what is not settled, so that nothing is lost while the daemon is away, as long as there is room.

use super::line::Address;
use super::line::Line;
use crate::app::now;
use crate::causes::with_causes;
use crate::wire;
use crate::wire::Block;
use crate::wire::Bye;
use crate::wire::ErrorCode;
use crate::wire::Frames;
use crate::wire::Hello;
use crate::wire::Message;
use rustls::ClientConfig;
use std::collections::BTreeMap;
use std::collections::VecDeque;
use std::io;
use std::sync::Arc;
use std::thread;
use std::time::Duration;
use std::time::Instant;

/// Longest wait for an answer before the connection counts as broken.
const PATIENCE: Duration = Duration::from_secs(30);

/// First and longest wait before the next attempt.
const BACK_OFF: (Duration, Duration) = (Duration::from_millis(100), Duration::from_secs(5));

/// How long a connection may be tried in vain.
const GIVE_UP: Duration = Duration::from_secs(60);

/// Why a sender gives up.
#[derive(Debug, thiserror::Error)]
pub enum SendError {
    /// The daemon cannot be reached.
    #[error("{address}: no connection for {} s", GIVE_UP.as_secs())]
    Unreachable {
        /// Where it was looked for.
        address: String,
        /// The last failure.
        source: io::Error,
    },
    /// The daemon's certificate is not accepted.
    #[error(
        "{address}: its certificate or TLS is not accepted; --ca-file names the authority to trust"
    )]
    Untrusted {
        /// Where it was looked for.
        address: String,
        /// Why.
        source: io::Error,
    },
    /// The daemon refuses, and will again.
    #[error("the daemon refuses ({}): {text}", code.name())]
    Refused {
        /// Why.
        code: ErrorCode,
        /// Its words.
        text: String,
    },
    /// What the daemon says cannot be understood.
    #[error("{address}: this is not what a daemon says")]
    Wire {
        /// Where it is.
        address: String,
        /// Why.
        source: wire::WireError,
    },
}

impl SendError {
    /// Whether what is refused now may be granted in a while.
    fn may_pass(&self) -> bool {
        matches!(self, Self::Refused { code: ErrorCode::ChannelTaken, .. })
    }
}

/// A block that is not settled.
#[derive(Debug)]
struct Kept {
    stream: u16,
    sequence: u64,
    frame: Vec<u8>,
    is_sent: bool,
}

/// A connection under way.
#[derive(Debug)]
struct Way {
    line: Line,
    frames: Frames,
    credit_bytes: usize,
}

/// A sender.
#[derive(Debug)]
pub struct Sender {
    address: Address,
    /// Whose certificates are accepted.
    trust: Option<Arc<ClientConfig>>,
    hello: Hello,
    way: Option<Way>,
    kept: VecDeque<Kept>,
    /// Bytes of frames sent and not settled, and of all that are not settled.
    under_way: usize,
    kept_bytes: usize,
    n_reconnects: u64,
}

impl Sender {
    /// A sender to a daemon, which connects at once.
    ///
    /// # Errors
    /// When the daemon cannot be reached or refuses.
    pub fn connect(
        address: &Address,
        trust: Option<Arc<ClientConfig>>,
        hello: Hello,
    ) -> Result<Self, SendError> {
        let address = address.clone();
        let (way, kept) = (None, VecDeque::new());
        let mut sender =
            Self { address, trust, hello, way, kept, under_way: 0, kept_bytes: 0, n_reconnects: 0 };
        sender.reconnect()?;
        sender.n_reconnects = 0;
        Ok(sender)
    }

    /// Times that the connection was lost and made again.
    #[must_use]
    pub fn n_reconnects(&self) -> u64 {
        self.n_reconnects
    }

    /// Sends a block, as far as there is credit; waits for it while more than `max_kept` bytes are not settled.
    ///
    /// # Errors
    /// When the daemon is gone for long, or refuses.
    pub fn send(&mut self, block: &Block<'_>, max_kept: usize) -> Result<(), SendError> {
        let mut frame = Vec::with_capacity(block.samples.bytes().len() + 64);
        self.wire(wire::encode(&Message::Block(*block), &mut frame))?;
        let (stream, sequence) = (block.stream, block.sequence);
        self.kept_bytes += frame.len();
        self.kept.push_back(Kept { stream, sequence, frame, is_sent: false });
        loop {
            self.pump(Duration::ZERO)?;
            if self.kept_bytes <= max_kept {
                return Ok(());
            }
            self.pump(Duration::from_millis(20))?;
        }
    }

    /// Waits until everything is settled and says goodbye.
    ///
    /// # Errors
    /// When the daemon is gone for long, or refuses.
    pub fn finish(mut self, bye: Bye) -> Result<(), SendError> {
        while !self.kept.is_empty() {
            self.pump(Duration::from_millis(20))?;
        }
        let mut frame = Vec::new();
        self.wire(wire::encode(&Message::Bye(bye), &mut frame))?;
        if let Some(way) = &mut self.way {
            // The daemon closes after its last word; until then the bye may not have come.
            let _gone = way.line.write(&frame);
            let deadline = now() + PATIENCE;
            let wait = Duration::from_millis(50);
            while now() < deadline && matches!(way.line.receive(&mut way.frames, wait), Ok(Some(_)))
            {
            }
        }
        Ok(())
    }

    /// Sends what there is credit for, and takes in what the daemon says; comes back after a break.
    fn pump(&mut self, wait: Duration) -> Result<(), SendError> {
        if self.way.is_none() {
            return self.reconnect();
        }
        match self.exchange(wait) {
            Ok(()) => Ok(()),
            Err(Broken::Fatal(error)) => Err(error),
            Err(Broken::Line(_)) => {
                self.way = None;
                self.reconnect()
            }
        }
    }

    fn exchange(&mut self, wait: Duration) -> Result<(), Broken> {
        let Some(way) = &mut self.way else { return Ok(()) };
        for kept in self.kept.iter_mut().filter(|kept| !kept.is_sent) {
            let n = kept.frame.len();
            let is_alone = self.under_way == 0 && way.credit_bytes > 0;
            if self.under_way + n > way.credit_bytes && !is_alone {
                break;
            }
            way.line.write(&kept.frame)?;
            kept.is_sent = true;
            self.under_way += n;
        }
        way.line.receive(&mut way.frames, wait)?.ok_or(io::ErrorKind::UnexpectedEof)?;
        self.listen()
    }

    /// Takes in the frames that have come.
    fn listen(&mut self) -> Result<(), Broken> {
        let Self { way: Some(way), kept, under_way, kept_bytes, address, .. } = self else {
            return Ok(());
        };
        loop {
            let wrong = |source| SendError::Wire { address: address.url(), source };
            let Some((message, _)) = way.frames.take().map_err(wrong)? else { return Ok(()) };
            match message {
                Message::Ack(ack) => {
                    way.credit_bytes = usize::try_from(ack.credit_bytes).unwrap_or(usize::MAX);
                    let wanted = ack.progress.iter().map(|p| (p.stream, p.sequence)).collect();
                    settle(kept, (under_way, kept_bytes), &wanted);
                }
                Message::Problem(problem) => return Err(refused(problem)),
                Message::Hello(_)
                | Message::Welcome(_)
                | Message::Block(_)
                | Message::Bye(_)
                | Message::Ping => {}
            }
        }
    }

    /// Connects, with growing waits, until it works or there is no use.
    fn reconnect(&mut self) -> Result<(), SendError> {
        let (begun, mut wait) = (now(), BACK_OFF.0);
        self.n_reconnects += 1;
        let is_first = self.n_reconnects == 1 && self.kept.is_empty();
        loop {
            let error = match self.greet() {
                Ok(()) => return Ok(()),
                // Somebody was faster after a break, such as a connection of before it that the daemon has not missed yet.
                Err(Broken::Fatal(error)) if is_first || !error.may_pass() => return Err(error),
                Err(Broken::Fatal(error)) => error,
                Err(Broken::Line(source)) => {
                    SendError::Unreachable { address: self.address.url(), source }
                }
            };
            if now().saturating_duration_since(begun) > GIVE_UP {
                return Err(error);
            }
            if wait == BACK_OFF.0 {
                self.tell_of_waiting(&error);
            }
            thread::sleep(wait);
            wait = (2 * wait).min(BACK_OFF.1);
        }
    }

    /// Says that it does not work at first, so that nobody waits and does not know for what.
    fn tell_of_waiting(&self, error: &SendError) {
        let source = std::error::Error::source(error);
        let why = source.map_or_else(|| error.to_string(), with_causes);
        let (address, longest_s) = (self.address.url(), GIVE_UP.as_secs());
        tracing::warn!(address, why, "no connection yet, tried again for {longest_s} s");
    }

    /// Connects and asks where to go on.
    fn greet(&mut self) -> Result<(), Broken> {
        let line = Line::open(&self.address, self.trust.as_ref(), &self.hello.token);
        let line = line.map_err(|error| self.not_open(error))?;
        let mut way = Way { line, frames: Frames::default(), credit_bytes: 0 };
        let mut frame = Vec::new();
        self.wire(wire::encode(&Message::Hello(self.hello.clone()), &mut frame))?;
        way.line.write(&frame)?;
        let deadline = now() + PATIENCE;
        let wrong = |source| SendError::Wire { address: self.address.url(), source };
        let welcome = loop {
            match way.frames.take().map_err(wrong)? {
                Some((Message::Welcome(welcome), _)) => break welcome,
                Some((Message::Problem(problem), _)) => return Err(refused(problem)),
                Some(_) => {}
                None => {
                    way.line
                        .receive(&mut way.frames, Duration::from_millis(100))?
                        .ok_or(io::ErrorKind::UnexpectedEof)?;
                    if now() >= deadline {
                        return Err(io::Error::from(io::ErrorKind::TimedOut).into());
                    }
                }
            }
        };
        way.credit_bytes = usize::try_from(welcome.credit_bytes).unwrap_or(usize::MAX);
        self.under_way = 0;
        for kept in &mut self.kept {
            kept.is_sent = false;
        }
        let wanted = (0_u16..).zip(welcome.wanted.iter().map(|wanted| wanted.sequence)).collect();
        settle(&mut self.kept, (&mut self.under_way, &mut self.kept_bytes), &wanted);
        self.way = Some(way);
        Ok(())
    }

    /// Why there is no connection: what will not pass is told at once.
    fn not_open(&self, error: io::Error) -> Broken {
        let text = error.to_string();
        if error.kind() == io::ErrorKind::PermissionDenied {
            return Broken::Fatal(SendError::Refused { code: ErrorCode::Unauthorised, text });
        }
        // The TLS library reports whom it does not trust so.
        if error.kind() == io::ErrorKind::InvalidData {
            let address = self.address.url();
            return Broken::Fatal(SendError::Untrusted { address, source: error });
        }
        Broken::Line(error)
    }

    fn wire(&self, encoded: Result<(), wire::WireError>) -> Result<(), SendError> {
        encoded.map_err(|source| SendError::Wire { address: self.address.url(), source })
    }
}

/// Forgets the blocks before those that are wanted, by stream.
fn settle(
    kept: &mut VecDeque<Kept>,
    (under_way, kept_bytes): (&mut usize, &mut usize),
    wanted: &BTreeMap<u16, u64>,
) {
    kept.retain(|kept| {
        let is_settled = wanted.get(&kept.stream).is_some_and(|wanted| kept.sequence < *wanted);
        if is_settled {
            *kept_bytes = kept_bytes.saturating_sub(kept.frame.len());
        }
        if is_settled && kept.is_sent {
            *under_way = under_way.saturating_sub(kept.frame.len());
        }
        !is_settled
    });
}

/// Why a connection does not go on.
enum Broken {
    /// It may be made again.
    Line(io::Error),
    /// There is no use.
    Fatal(SendError),
}

impl From<io::Error> for Broken {
    fn from(error: io::Error) -> Self {
        Self::Line(error)
    }
}

impl From<io::ErrorKind> for Broken {
    fn from(kind: io::ErrorKind) -> Self {
        Self::Line(kind.into())
    }
}

impl From<SendError> for Broken {
    fn from(error: SendError) -> Self {
        Self::Fatal(error)
    }
}

/// Whether there is any use in trying again.
fn refused(problem: wire::Problem) -> Broken {
    match problem.code {
        ErrorCode::Checksum
        | ErrorCode::Timeout
        | ErrorCode::TooManyConnections
        | ErrorCode::ReopenedTooOften
        | ErrorCode::Stopping => Broken::Line(io::Error::other(problem.text)),
        ErrorCode::Version
        | ErrorCode::Malformed
        | ErrorCode::TooLarge
        | ErrorCode::Unexpected
        | ErrorCode::Unauthorised
        | ErrorCode::UnknownMachine
        | ErrorCode::BadChannel
        | ErrorCode::ChannelTaken
        | ErrorCode::NoRoom
        | ErrorCode::TimeAhead => {
            let wire::Problem { code, text } = problem;
            Broken::Fatal(SendError::Refused { code, text })
        }
    }
}

/// Waits until a moment, unless it has passed.
pub fn wait_until(due: Instant) {
    thread::sleep(due.saturating_duration_since(now()));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::Channel;
    use crate::wire::SampleType;
    use crate::wire::Welcome;
    use std::net::TcpListener;

    #[test]
    fn a_daemon_that_goes_without_a_word_is_not_waited_for_at_the_end() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let daemon = thread::spawn(move || {
            let (stream, _) = listener.accept().unwrap();
            let mut socket = tungstenite::accept(stream).unwrap();
            socket.read().unwrap(); // the hello
            let welcome = Welcome { credit_bytes: 1000, wanted: Vec::new() };
            let mut frame = Vec::new();
            wire::encode(&Message::Welcome(welcome), &mut frame).unwrap();
            socket.send(tungstenite::Message::binary(frame)).unwrap();
            socket.read().unwrap(); // the bye; nothing is closed as it should be
        });
        let hello = Hello::new("rig-1", 1, vec![Channel::new("x", 1.0, SampleType::I16, "")]);
        let address = Address::parse(&url).unwrap();
        let sender = Sender::connect(&address, None, hello).unwrap();
        let begun = now();
        sender.finish(Bye::End).unwrap();
        assert!(now().saturating_duration_since(begun) < PATIENCE / 3);
        daemon.join().unwrap();
    }
}
