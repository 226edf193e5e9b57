//! One connection of the HTTP server: encrypted or not, with bounded patience for who reads nothing, and for who says nothing.

use prometheus_client::metrics::counter::Counter;
use std::io;
use std::pin::Pin;
use std::task::Context;
use std::task::Poll;
use std::time::Duration;
use tokio::io::AsyncRead;
use tokio::io::AsyncWrite;
use tokio::io::ReadBuf;
use tokio::net::TcpStream;
use tokio::sync::OwnedSemaphorePermit;
use tokio::time::Instant;
use tokio::time::Sleep;
use tokio_rustls::Accept;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::server::TlsStream;

/// How long a handshake may take.
const HANDSHAKE: Duration = Duration::from_secs(10);

/// A connection with bounded patience.
#[derive(Debug)]
pub struct Connection {
    stream: Stream,
    patience: Duration,
    stalled: Counter,
    /// Runs while the reader takes nothing.
    since: Option<Pin<Box<Sleep>>>,
    /// Ends it when there was nothing to say for long.
    idle: Pin<Box<Sleep>>,
    idle_limit: Duration,
    said_at: Instant,
    /// Its place among those that may be open.
    _place: OwnedSemaphorePermit,
}

/// How long what may take.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    /// Until a reader takes something of what is written to it.
    pub(super) patience: Duration,
    /// Until there is something to say again.
    pub(super) idle: Duration,
}

impl Connection {
    /// A connection that was just taken.
    pub(super) fn new(
        stream: TcpStream,
        tls: Option<&TlsAcceptor>,
        limits: Limits,
        stalled: Counter,
        place: OwnedSemaphorePermit,
    ) -> Self {
        // Who comes greets itself while others are served: the handshake is a part of the first read.
        let stream = match tls {
            None => Stream::Plain(stream),
            Some(acceptor) => Stream::Greeting(Box::new(Greeting {
                accept: acceptor.accept(stream),
                limit: Box::pin(tokio::time::sleep(HANDSHAKE)),
            })),
        };
        let Limits { patience, idle: idle_limit } = limits;
        let idle = Box::pin(tokio::time::sleep(idle_limit));
        let said_at = Instant::now();
        Self { stream, patience, stalled, since: None, idle, idle_limit, said_at, _place: place }
    }

    /// Whether nothing was said for so long that nobody is there, or only somebody who holds a place. A stream of events
    /// has its heartbeat, a sender its acknowledgements, a request its answer.
    fn is_idle(&mut self, context: &mut Context<'_>) -> bool {
        while self.idle.as_mut().poll(context).is_ready() {
            let due = self.said_at + self.idle_limit;
            if due <= Instant::now() {
                return true;
            }
            self.idle.as_mut().reset(due);
        }
        false
    }

    /// Lets a write that cannot go on wait only so long.
    fn bounded<T>(
        &mut self,
        context: &mut Context<'_>,
        done: Poll<io::Result<T>>,
    ) -> Poll<io::Result<T>> {
        if done.is_ready() {
            self.since = None;
            self.said_at = Instant::now();
            return done;
        }
        let patience = self.patience;
        let since = self.since.get_or_insert_with(|| Box::pin(tokio::time::sleep(patience)));
        if since.as_mut().poll(context).is_pending() {
            return Poll::Pending;
        }
        self.stalled.inc();
        tracing::warn!("a connection was cut off: its reader takes nothing");
        Poll::Ready(Err(io::ErrorKind::TimedOut.into()))
    }
}

/// The stream of a connection.
enum Stream {
    Plain(TcpStream),
    Greeting(Box<Greeting>),
    Encrypted(Box<TlsStream<TcpStream>>),
    Failed,
}

impl std::fmt::Debug for Stream {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Plain(_) => "Plain",
            Self::Greeting(_) => "Greeting",
            Self::Encrypted(_) => "Encrypted",
            Self::Failed => "Failed",
        })
    }
}

/// A handshake under way, and how long it may take.
struct Greeting {
    accept: Accept<TcpStream>,
    limit: Pin<Box<Sleep>>,
}

/// A stream that can be read and written.
enum Open<'a> {
    Plain(&'a mut TcpStream),
    Encrypted(&'a mut TlsStream<TcpStream>),
}

impl Stream {
    /// Ends the handshake, if one is under way.
    fn ready(&mut self, context: &mut Context<'_>) -> Poll<io::Result<Open<'_>>> {
        if let Self::Greeting(greeting) = self {
            let done = Pin::new(&mut greeting.accept).poll(context);
            let is_late = greeting.limit.as_mut().poll(context).is_ready();
            *self = match done {
                Poll::Ready(Ok(stream)) => Self::Encrypted(Box::new(stream)),
                Poll::Ready(Err(error)) => {
                    tracing::debug!(%error, "a connection could not be encrypted");
                    Self::Failed
                }
                Poll::Pending if is_late => Self::Failed,
                Poll::Pending => return Poll::Pending,
            };
        }
        match self {
            Self::Plain(stream) => Poll::Ready(Ok(Open::Plain(stream))),
            Self::Encrypted(stream) => Poll::Ready(Ok(Open::Encrypted(stream))),
            Self::Greeting(_) | Self::Failed => {
                Poll::Ready(Err(io::ErrorKind::ConnectionAborted.into()))
            }
        }
    }
}

impl AsyncRead for Connection {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let read = match self.stream.ready(context) {
            Poll::Ready(Ok(Open::Plain(stream))) => Pin::new(stream).poll_read(context, buffer),
            Poll::Ready(Ok(Open::Encrypted(stream))) => Pin::new(stream).poll_read(context, buffer),
            Poll::Ready(Err(error)) => Poll::Ready(Err(error)),
            Poll::Pending => Poll::Pending,
        };
        if read.is_pending() && self.is_idle(context) {
            return Poll::Ready(Err(io::ErrorKind::TimedOut.into()));
        }
        read
    }
}

impl AsyncWrite for Connection {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let done = match self.stream.ready(context) {
            Poll::Ready(Ok(Open::Plain(stream))) => Pin::new(stream).poll_write(context, bytes),
            Poll::Ready(Ok(Open::Encrypted(stream))) => Pin::new(stream).poll_write(context, bytes),
            Poll::Ready(Err(error)) => Poll::Ready(Err(error)),
            Poll::Pending => Poll::Pending,
        };
        self.bounded(context, done)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let done = match self.stream.ready(context) {
            Poll::Ready(Ok(Open::Plain(stream))) => {
                Pin::new(stream).poll_write_vectored(context, slices)
            }
            Poll::Ready(Ok(Open::Encrypted(stream))) => {
                Pin::new(stream).poll_write_vectored(context, slices)
            }
            Poll::Ready(Err(error)) => Poll::Ready(Err(error)),
            Poll::Pending => Poll::Pending,
        };
        self.bounded(context, done)
    }

    fn is_write_vectored(&self) -> bool {
        match &self.stream {
            Stream::Plain(stream) => stream.is_write_vectored(),
            Stream::Encrypted(stream) => stream.is_write_vectored(),
            Stream::Greeting(_) | Stream::Failed => false,
        }
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let done = match self.stream.ready(context) {
            Poll::Ready(Ok(Open::Plain(stream))) => Pin::new(stream).poll_flush(context),
            Poll::Ready(Ok(Open::Encrypted(stream))) => Pin::new(stream).poll_flush(context),
            Poll::Ready(Err(error)) => Poll::Ready(Err(error)),
            Poll::Pending => Poll::Pending,
        };
        self.bounded(context, done)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let done = match &mut self.stream {
            Stream::Plain(stream) => Pin::new(stream).poll_shutdown(context),
            Stream::Encrypted(stream) => Pin::new(stream).poll_shutdown(context),
            // Nothing was said yet: there is nothing to end.
            Stream::Greeting(_) | Stream::Failed => Poll::Ready(Ok(())),
        };
        self.bounded(context, done)
    }
}
