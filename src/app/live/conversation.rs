//! A connection from its first byte to its last, on a thread of its own.

use super::Hub;
use super::Port;
use super::Seat;
use super::port::Became;
use super::port::stopping;
use crate::access::Token;
use crate::ingest::live::Refusal;
use crate::ingest::live::session::Session;
use crate::wire;
use crate::wire::Bye;
use crate::wire::Frames;
use crate::wire::Message;
use crate::wire::Problem;
use std::io;
use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

/// Longest wait for bytes before the clock is looked at.
pub(super) const POLL: Duration = Duration::from_millis(20);

/// Wait for room in a queue.
const WAIT: Duration = Duration::from_millis(2);

/// Time between two looks whether a sender's token still holds, s.
const CHECK_S: f64 = 0.5;

/// Where frames come from and go to.
pub(super) trait Transport {
    /// Waits for bytes, at most [`POLL`]; `None`: no more will come.
    fn receive(&mut self, frames: &mut Frames) -> Result<Option<usize>, Ending>;

    /// Sends frames; gives up when they are not taken for long.
    fn send(&mut self, bytes: &[u8]) -> io::Result<()>;
}

/// How a conversation ends.
pub(super) enum Ending {
    /// The sender ended it, or is gone.
    Gone,
    /// The daemon ended it.
    Refused(Refusal),
    /// The daemon ended it because of a message with so many samples.
    Lost(Refusal, u64),
}

impl From<io::Error> for Ending {
    fn from(_: io::Error) -> Self {
        Self::Gone
    }
}

impl From<Refusal> for Ending {
    fn from(refusal: Refusal) -> Self {
        Self::Refused(refusal)
    }
}

/// How it is known who a sender is.
pub(super) enum Who {
    /// By the token in its hello, from this address.
    Asked(IpAddr),
    /// It was asked already; `None`: nobody needs a token.
    Known(Option<Arc<Token>>),
}

/// A connection under way.
struct Conversation<'a, T> {
    hub: &'a Hub,
    who: Who,
    /// When it was last seen to that who sends may, s.
    checked_s: f64,
    id: u64,
    peer: &'a str,
    transport: &'a mut T,
    session: Session,
    port: Option<Arc<Port>>,
    has_ended: bool,
    out: Vec<u8>,
}

/// Listens to a sender until one of both ends it.
pub(super) fn run(seat: &Seat, peer: &str, who: Who, transport: &mut impl Transport) {
    let hub = &*seat.hub;
    let session = Session::new(hub.clock.elapsed_s());
    let mut conversation = Conversation {
        hub,
        who,
        checked_s: 0.0,
        id: seat.session,
        peer,
        transport,
        session,
        port: None,
        has_ended: false,
        out: Vec::new(),
    };
    let ending = conversation.listen();
    conversation.leave();
    let (refusal, n_samples) = match ending {
        Ok(()) | Err(Ending::Gone) => return,
        Err(Ending::Refused(refusal)) => (refusal, 0),
        Err(Ending::Lost(refusal, n_samples)) => (refusal, n_samples),
    };
    hub.note_refusal(peer, &refusal);
    hub.note_lost(&refusal, n_samples);
    refuse(conversation.transport, &refusal);
}

/// Should the conversation panic, its channels are free again all the same.
impl<T> Drop for Conversation<'_, T> {
    fn drop(&mut self) {
        self.leave();
    }
}

/// Tells a sender why it is not listened to.
pub(super) fn refuse(transport: &mut impl Transport, refusal: &Refusal) {
    let mut out = Vec::new();
    let problem = Message::Problem(Problem::new(refusal.code, &refusal.text));
    if wire::encode(&problem, &mut out).is_ok() {
        // It may be gone already.
        let _gone = transport.send(&out);
    }
}

impl<T> Conversation<'_, T> {
    /// Gives up the channels, if it has any.
    fn leave(&mut self) {
        if let Some(port) = self.port.take() {
            port.leave(self.id, self.has_ended);
            tracing::info!(machine = port.machine(), peer = self.peer, "a sender has gone");
        }
    }
}

impl<T: Transport> Conversation<'_, T> {
    fn listen(&mut self) -> Result<(), Ending> {
        let mut frames = Frames::default();
        loop {
            while let Some((message, n_bytes)) = frames.take().map_err(Refusal::from)? {
                self.take(&message, n_bytes)?;
            }
            self.acknowledge()?;
            if self.session.is_over() {
                return Ok(());
            }
            if self.hub.stop.is_set() {
                return Err(stopping().into());
            }
            self.check()?;
            let came = self.transport.receive(&mut frames)?;
            self.session.tick(frames.is_within(), self.hub.clock.elapsed_s())?;
            if let Some(port) = self.port.as_ref().filter(|_| came == Some(0)) {
                port.tick();
            }
            if came.is_none() {
                return Ok(());
            }
        }
    }

    fn take(&mut self, message: &Message<'_>, n_bytes: usize) -> Result<(), Ending> {
        let now_s = self.hub.clock.elapsed_s();
        let n_samples = match message {
            Message::Block(block) => block.samples.len() as u64,
            Message::Hello(_) | Message::Welcome(_) | Message::Ack(_) => 0,
            Message::Problem(_) | Message::Bye(_) | Message::Ping => 0,
        };
        let lost = |refusal| Ending::Lost(refusal, n_samples);
        let within_credit = self.session.frame(message, n_bytes, now_s).map_err(lost)?;
        match message {
            Message::Hello(hello) => self.greet(hello)?,
            Message::Block(block) => {
                let Some(port) = self.port.clone() else { return Ok(()) };
                let sequence = loop {
                    let arrived = self.hub.clock.arrived();
                    let taken = port.block(self.id, (block, n_bytes), arrived, within_credit);
                    match taken.map_err(lost)? {
                        Became::Settled(sequence) => break sequence,
                        Became::Wait => self.wait()?,
                    }
                };
                // Waiting for room is the daemon's doing.
                self.session.heard(self.hub.clock.elapsed_s());
                self.session.settle(block.stream, sequence, now_s);
            }
            Message::Bye(bye) => self.has_ended = *bye == Bye::End,
            Message::Ping | Message::Welcome(_) | Message::Ack(_) | Message::Problem(_) => {}
        }
        Ok(())
    }

    /// Ends it when its token does.
    fn check(&mut self) -> Result<(), Ending> {
        let now_s = self.hub.clock.elapsed_s();
        if let Who::Known(token) = &self.who
            && now_s - self.checked_s > CHECK_S
        {
            self.checked_s = now_s;
            self.hub.check(token.as_ref())?;
        }
        Ok(())
    }

    fn greet(&mut self, hello: &wire::Hello) -> Result<(), Ending> {
        let token = match &self.who {
            Who::Asked(peer) => self.hub.authorise(&hello.token, Some(*peer))?,
            Who::Known(token) => token.clone(),
        };
        let port = Arc::clone(self.hub.port(&hello.machine, token.as_deref())?);
        self.who = Who::Known(token);
        let wanted = loop {
            let arrived = self.hub.clock.arrived();
            match port.hello(self.id, (self.peer, arrived), hello)? {
                Some(wanted) => break wanted,
                None => self.wait()?,
            }
        };
        let welcome = Message::Welcome(self.session.welcome(wanted, port.fill()));
        self.port = Some(port);
        self.send(&welcome)
    }

    /// Waits for room in the queue. What is settled is told meanwhile.
    fn wait(&mut self) -> Result<(), Ending> {
        self.acknowledge()?;
        if self.hub.stop.wait_until(crate::app::now() + WAIT) {
            return Err(stopping().into());
        }
        Ok(())
    }

    fn acknowledge(&mut self) -> Result<(), Ending> {
        let Some(port) = &self.port else { return Ok(()) };
        match self.session.ack(port.fill(), self.hub.clock.elapsed_s()) {
            Some(ack) => self.send(&Message::Ack(ack)),
            None => Ok(()),
        }
    }

    fn send(&mut self, message: &Message<'_>) -> Result<(), Ending> {
        self.out.clear();
        wire::encode(message, &mut self.out).map_err(Refusal::from)?;
        Ok(self.transport.send(&self.out)?)
    }
}
