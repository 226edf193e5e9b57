//! Senders over a WebSocket: its task moves messages, a thread listens to them as it does to TCP.

use super::Hub;
use super::conversation;
use super::conversation::Ending;
use super::conversation::POLL;
use super::conversation::Transport;
use super::conversation::Who;
use crate::access::Token;
use crate::api::handles::IngestOpen;
use crate::api::handles::IngestPipe;
use crate::api::handles::NotUnderstood;
use crate::causes::with_causes;
use crate::ingest::live::Refusal;
use crate::wire::ErrorCode;
use crate::wire::Frames;
use std::io;
use std::sync::Arc;
use std::sync::mpsc::Receiver;
use std::sync::mpsc::RecvTimeoutError;
use std::sync::mpsc::sync_channel;
use std::thread;
use std::time::Duration;
use tokio::sync::mpsc;

/// Messages under way in each direction.
const MESSAGES: usize = 4;

/// How long a sender may not take an answer.
const PATIENCE: Duration = Duration::from_secs(5);

/// Stack of a connection's thread, bytes.
const STACK_BYTES: usize = 256 << 10;

/// The thread's end.
struct Pipe {
    come: Receiver<Result<Vec<u8>, NotUnderstood>>,
    go: mpsc::Sender<Vec<u8>>,
}

impl Transport for Pipe {
    fn receive(&mut self, frames: &mut Frames) -> Result<Option<usize>, Ending> {
        match self.come.recv_timeout(POLL) {
            Ok(Ok(bytes)) => {
                frames.push(&bytes);
                Ok(Some(bytes.len()))
            }
            Ok(Err(NotUnderstood { refusal, n_samples })) => Err(Ending::Lost(refusal, n_samples)),
            Err(RecvTimeoutError::Timeout) => Ok(Some(0)),
            Err(RecvTimeoutError::Disconnected) => Ok(None),
        }
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        let deadline = crate::app::now() + PATIENCE;
        let mut bytes = bytes.to_vec();
        loop {
            match self.go.try_send(bytes) {
                Ok(()) => return Ok(()),
                Err(mpsc::error::TrySendError::Closed(_)) => {
                    return Err(io::ErrorKind::BrokenPipe.into());
                }
                Err(mpsc::error::TrySendError::Full(back)) => bytes = back,
            }
            if crate::app::now() >= deadline {
                return Err(io::ErrorKind::TimedOut.into());
            }
            thread::sleep(Duration::from_millis(1));
        }
    }
}

/// The API's way to the hub.
#[must_use]
pub fn handle(hub: Arc<Hub>) -> IngestOpen {
    Arc::new(move |peer, token| open(&hub, peer, token))
}

/// Starts a conversation over a WebSocket.
///
/// # Errors
/// When there are too many.
fn open(hub: &Arc<Hub>, peer: String, token: Option<Arc<Token>>) -> Result<IngestPipe, Refusal> {
    let seat = hub.enter().inspect_err(|refusal| hub.note_refusal(&peer, refusal))?;
    let (to_thread, come) = sync_channel(MESSAGES);
    let (go, from_thread) = mpsc::channel(MESSAGES);
    let name = format!("sender-{}", seat.session);
    let started = thread::Builder::new().name(name).stack_size(STACK_BYTES).spawn(move || {
        conversation::run(&seat, &peer, Who::Known(token), &mut Pipe { come, go });
    });
    started.map_err(|error| {
        let text = format!("a thread cannot be started: {}", with_causes(&error));
        Refusal::new(ErrorCode::TooManyConnections, text)
    })?;
    Ok(IngestPipe { to_daemon: to_thread, from_daemon: from_thread })
}
