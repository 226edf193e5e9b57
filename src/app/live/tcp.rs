//! Senders over TCP: a listener, and a thread for each of them.

use super::Hub;
use super::conversation;
use super::conversation::Ending;
use super::conversation::POLL;
use super::conversation::Transport;
use super::conversation::Who;
use crate::app::stop::Stop;
use crate::app::tls::Tls;
use crate::wire::Frames;
use rustls::ServerConnection;
use rustls::StreamOwned;
use std::io;
use std::io::Read;
use std::io::Write;
use std::net::Shutdown;
use std::net::SocketAddr;
use std::net::TcpListener;
use std::net::TcpStream;
use std::sync::Arc;
use std::thread;
use std::time::Duration;

/// How long a sender may not take an answer.
const PATIENCE: Duration = Duration::from_secs(5);

/// Stack of a connection's thread, bytes.
const STACK_BYTES: usize = 256 << 10;

/// Time between two looks for new connections.
const ACCEPT_EVERY: Duration = Duration::from_millis(10);

/// How long connections may take to end when the daemon does.
const GRACE: Duration = Duration::from_millis(1500);

/// A connection, encrypted or not.
enum Tcp {
    Plain(TcpStream),
    Encrypted(Box<StreamOwned<ServerConnection, TcpStream>>),
}

impl Tcp {
    fn new(stream: TcpStream, tls: Option<&Tls>) -> Result<Self, rustls::Error> {
        let Some(tls) = tls else { return Ok(Self::Plain(stream)) };
        let connection = ServerConnection::new(tls.config())?;
        Ok(Self::Encrypted(Box::new(StreamOwned::new(connection, stream))))
    }

    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Plain(stream) => stream.read(bytes),
            Self::Encrypted(stream) => stream.read(bytes),
        }
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Plain(stream) => stream.write_all(bytes),
            Self::Encrypted(stream) => {
                stream.write_all(bytes)?;
                stream.flush()
            }
        }
    }

    /// Says that nothing more will be written.
    fn end(&mut self) {
        let stream = match self {
            Self::Plain(stream) => stream,
            Self::Encrypted(stream) => {
                stream.conn.send_close_notify();
                // It may be gone already.
                let _gone = stream.flush();
                &mut stream.sock
            }
        };
        let _gone = stream.shutdown(Shutdown::Write);
    }
}

impl Transport for Tcp {
    fn receive(&mut self, frames: &mut Frames) -> Result<Option<usize>, Ending> {
        match self.read(frames.space()) {
            Ok(0) => Ok(None),
            Ok(n) => {
                frames.filled(n);
                Ok(Some(n))
            }
            Err(error) if is_waiting(&error) => Ok(Some(0)),
            Err(error) => Err(error.into()),
        }
    }

    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.write_all(bytes)
    }
}

fn is_waiting(error: &io::Error) -> bool {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), WouldBlock | TimedOut | Interrupted)
}

/// Takes connections until the stop, then waits for them to end.
pub(in crate::app) fn run(listener: &TcpListener, hub: &Arc<Hub>, stop: &Stop) {
    loop {
        match listener.accept() {
            Ok((stream, peer)) => meet(stream, peer, hub),
            Err(error) => {
                if !is_waiting(&error) {
                    // Such as too many open files: told, and tried again.
                    tracing::warn!(%error, "a sender's connection cannot be taken");
                }
                if stop.wait_until(crate::app::now() + ACCEPT_EVERY) {
                    break;
                }
            }
        }
        if stop.is_set() {
            break;
        }
    }
    let deadline = crate::app::now() + GRACE;
    while hub.n_connections() > 0 && crate::app::now() < deadline {
        thread::sleep(ACCEPT_EVERY);
    }
    hub.finish();
}

/// Starts the conversation with a sender, or says why there is none.
fn meet(stream: TcpStream, address: SocketAddr, hub: &Arc<Hub>) {
    let peer = address.to_string();
    let prepared = stream
        .set_nonblocking(false)
        .and_then(|()| stream.set_read_timeout(Some(POLL)))
        .and_then(|()| stream.set_write_timeout(Some(PATIENCE)))
        .and_then(|()| stream.set_nodelay(true));
    if prepared.is_err() {
        return; // it is gone already
    }
    let mut transport = match Tcp::new(stream, hub.tls.as_ref()) {
        Ok(transport) => transport,
        Err(error) => return tracing::error!(%error, "a sender's connection cannot be encrypted"),
    };
    let seat = match hub.enter() {
        Ok(seat) => seat,
        Err(refusal) => {
            hub.note_refusal(&peer, &refusal);
            // A few bytes: they fit into the socket's buffer, so that this waits for nobody.
            conversation::refuse(&mut transport, &refusal);
            return;
        }
    };
    let name = format!("sender-{}", seat.session);
    let started = thread::Builder::new().name(name).stack_size(STACK_BYTES).spawn(move || {
        conversation::run(&seat, &peer, Who::Asked(address.ip()), &mut transport);
        // What is still under way is read and thrown away, so that the last words reach the sender.
        linger(&mut transport);
    });
    if let Err(error) = started {
        tracing::error!(%error, "a thread for a sender cannot be started");
    }
}

/// Ends a connection so that what was written last is not lost to a reset: reads until the sender closes, for a moment.
fn linger(stream: &mut Tcp) {
    stream.end();
    let mut sink = [0; 4096];
    let deadline = crate::app::now() + Duration::from_millis(300);
    while crate::app::now() < deadline {
        match stream.read(&mut sink) {
            Ok(0) => return,
            Ok(_) => {}
            Err(error) if is_waiting(&error) => {}
            Err(_) => return,
        }
    }
}
