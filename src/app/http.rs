//! The HTTP server: the API's router on a listener, ended in bounded time.

use crate::api;
use crate::api::state;
use crate::dashboard;
use axum::serve::Listener;
use prometheus_client::metrics::counter::Counter;
use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::sync::Arc;
use std::task::Context;
use std::task::Poll;
use std::time::Duration;
use tokio::io::AsyncRead;
use tokio::io::AsyncWrite;
use tokio::io::ReadBuf;
use tokio::net::TcpListener;
use tokio::net::TcpStream;
use tokio::time::Sleep;
use tokio_util::sync::CancellationToken;

/// How long open connections may finish what they do when the daemon stops. A client that listens
/// to an endless stream is cut off after it.
pub const GRACE: Duration = Duration::from_secs(1);

/// Gives the metrics as text.
pub type MetricsText = Arc<dyn Fn() -> String + Send + Sync>;

/// Gives what keeps the daemon from its work, as only its clock can tell.
pub type ReadinessCheck = Arc<dyn Fn() -> Vec<String> + Send + Sync>;

/// Makes the routes: the one place where the daemon meets the API.
pub fn router(state: state::ApiState) -> axum::Router {
    api::router(state, dashboard::router())
}

/// How long a reader may take nothing of what is written to it.
pub const PATIENCE: Duration = Duration::from_secs(30);

/// A listener whose connections break when their reader takes nothing for [`PATIENCE`]: nobody holds a stream
/// of events, or the memory of an answer, without reading it.
#[derive(Debug)]
pub struct Patient {
    listener: TcpListener,
    patience: Duration,
    stalled: Counter,
}

impl Patient {
    /// Counts what it breaks in `stalled`.
    #[must_use]
    pub fn new(listener: TcpListener, stalled: Counter) -> Self {
        Self { listener, patience: PATIENCE, stalled }
    }

    /// Waits for another time.
    #[must_use]
    pub fn with_patience(self, patience: Duration) -> Self {
        Self { patience, ..self }
    }
}

impl Listener for Patient {
    type Io = Connection;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Connection, SocketAddr) {
        let (stream, address) = Listener::accept(&mut self.listener).await;
        let (patience, stalled) = (self.patience, self.stalled.clone());
        (Connection { stream, patience, stalled, since: None }, address)
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

/// A connection with bounded patience.
#[derive(Debug)]
pub struct Connection {
    stream: TcpStream,
    patience: Duration,
    stalled: Counter,
    /// Runs while the reader takes nothing.
    since: Option<Pin<Box<Sleep>>>,
}

impl Connection {
    /// Lets a write that cannot go on wait only so long.
    fn bounded<T>(
        &mut self,
        context: &mut Context<'_>,
        done: Poll<io::Result<T>>,
    ) -> Poll<io::Result<T>> {
        if done.is_ready() {
            self.since = None;
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

impl AsyncRead for Connection {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl AsyncWrite for Connection {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let done = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.bounded(context, done)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let done = Pin::new(&mut self.stream).poll_write_vectored(context, slices);
        self.bounded(context, done)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let done = Pin::new(&mut self.stream).poll_flush(context);
        self.bounded(context, done)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let done = Pin::new(&mut self.stream).poll_shutdown(context);
        self.bounded(context, done)
    }
}

/// Serves until `stop`, then for [`GRACE`] at most.
pub async fn serve(listener: Patient, router: axum::Router, stop: CancellationToken) {
    let server = axum::serve(listener, router)
        .with_graceful_shutdown(stop.clone().cancelled_owned())
        .into_future();
    let cut_off = async {
        stop.cancelled().await;
        tokio::time::sleep(GRACE).await;
    };
    tokio::select! {
        done = server => {
            if let Err(error) = done {
                tracing::error!(%error, "http server failed");
            }
        }
        () = cut_off => tracing::info!("open connections were cut off"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::body::Body;
    use axum::body::Bytes;
    use std::io::Read;
    use std::io::Write;

    /// A body that never ends.
    fn endless() -> Body {
        let chunk = Bytes::from(vec![b'x'; 64 * 1024]);
        Body::from_stream(futures_util::stream::repeat_with(move || {
            Ok::<_, std::convert::Infallible>(chunk.clone())
        }))
    }

    #[test]
    fn a_reader_that_takes_nothing_is_cut_off_and_counted_and_a_slow_one_is_not() {
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().unwrap();
        let (stalled, stop) = (Counter::default(), CancellationToken::new());
        let bound = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let address = bound.local_addr().unwrap();
        bound.set_nonblocking(true).unwrap();
        let listener = {
            let _context = runtime.enter();
            let listener = TcpListener::from_std(bound).unwrap();
            Patient::new(listener, stalled.clone()).with_patience(Duration::from_millis(300))
        };
        let router = axum::Router::new().route("/", axum::routing::get(async || endless()));
        runtime.spawn(serve(listener, router, stop.clone()));
        let ask = || {
            let mut stream = std::net::TcpStream::connect(address).unwrap();
            stream.write_all(b"GET / HTTP/1.1\r\nhost: x\r\n\r\n").unwrap();
            stream
        };
        let mut slow = ask();
        let mut still = ask();
        // Reads all the while, far more than any buffer holds; the other reads nothing.
        let mut buffer = vec![0; 64 * 1024];
        while stalled.get() == 0 {
            slow.read_exact(&mut buffer).unwrap();
        }
        slow.read_exact(&mut buffer).unwrap();
        assert_eq!(stalled.get(), 1);
        // What was on its way arrives, then the end.
        let ended =
            std::iter::repeat_with(|| still.read(&mut buffer)).find(|n| !matches!(n, Ok(1..)));
        assert!(ended.is_some());
        stop.cancel();
    }
}
