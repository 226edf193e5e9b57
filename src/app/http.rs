//! The HTTP server: the API's router on a listener, ended in bounded time.

use super::connection::Connection;
use super::connection::Limits;
use super::tls::Tls;
use crate::api;
use crate::api::entry::Peer;
use crate::api::state;
use crate::dashboard;
use crate::telemetry::HttpMetrics;
use axum::extract::MatchedPath;
use axum::extract::Request;
use axum::extract::connect_info::Connected;
use axum::http::Method;
use axum::middleware::Next;
use axum::middleware::from_fn;
use axum::serve::IncomingStream;
use axum::serve::Listener;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::gauge::Gauge;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::Semaphore;
use tokio_rustls::TlsAcceptor;
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

/// The same, with each answer counted and its time taken.
pub fn measured(router: axum::Router, metrics: HttpMetrics) -> axum::Router {
    router.layer(from_fn(move |request: Request, next: Next| {
        let metrics = metrics.clone();
        async move {
            let begun = super::now();
            let method = method_name(request.method());
            let route = request.extensions().get::<MatchedPath>().cloned();
            metrics.in_flight.inc();
            let answering = Answering(metrics.in_flight.clone());
            let response = next.run(request).await;
            drop(answering);
            let route = route.as_ref().map_or("none", MatchedPath::as_str);
            let took = super::now().saturating_duration_since(begun);
            metrics.count((method, route, response.status().as_u16()), took.as_secs_f64());
            response
        }
    }))
}

/// A request that is being answered, or was given up by who asked.
struct Answering(Gauge);

impl Drop for Answering {
    fn drop(&mut self) {
        self.0.dec();
    }
}

/// Methods that somebody made up are one.
fn method_name(method: &Method) -> &'static str {
    match *method {
        Method::GET => "GET",
        Method::HEAD => "HEAD",
        Method::POST => "POST",
        Method::DELETE => "DELETE",
        Method::OPTIONS => "OPTIONS",
        _ => "other",
    }
}

/// How long a reader may take nothing of what is written to it.
pub const PATIENCE: Duration = Duration::from_secs(30);

/// How long there may be nothing to say to who is connected: longer than the silence of a stream of events or a sender.
pub const IDLE: Duration = Duration::from_secs(75);

/// A listener whose connections break when their reader takes nothing for [`PATIENCE`], or has nothing done for [`IDLE`]:
/// nobody holds a stream of events, the memory of an answer, or a place, without using it.
pub struct Patient {
    listener: TcpListener,
    tls: Option<TlsAcceptor>,
    limits: Limits,
    places: Arc<Semaphore>,
    stalled: Counter,
    refused: Counter,
}

impl std::fmt::Debug for Patient {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Patient").field("listener", &self.listener).finish_non_exhaustive()
    }
}

impl Patient {
    /// Counts what it breaks in `stalled`; so many connections are open at a time, others are closed at once.
    #[must_use]
    pub fn new(listener: TcpListener, stalled: Counter, max_connections: usize) -> Self {
        let limits = Limits { patience: PATIENCE, idle: IDLE };
        let places = Arc::new(Semaphore::new(max_connections));
        Self { listener, tls: None, limits, places, stalled, refused: Counter::default() }
    }

    /// Counts those for whom there is no place.
    #[must_use]
    pub fn counting_refused(self, refused: Counter) -> Self {
        Self { refused, ..self }
    }

    /// Encrypts.
    #[must_use]
    pub fn with_tls(self, tls: Option<&Tls>) -> Self {
        Self { tls: tls.map(|tls| TlsAcceptor::from(tls.config())), ..self }
    }

    /// Waits for other times, and has so many places.
    #[cfg(test)]
    fn with_limits(self, limits: Limits, n_places: usize) -> Self {
        Self { limits, places: Arc::new(Semaphore::new(n_places)), ..self }
    }
}

impl Listener for Patient {
    type Io = Connection;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Connection, SocketAddr) {
        loop {
            let (stream, address) = Listener::accept(&mut self.listener).await;
            let Ok(place) = Arc::clone(&self.places).try_acquire_owned() else {
                let n = self.refused.inc() + 1;
                if n <= 10 || n.is_power_of_two() {
                    tracing::warn!(%address, n, "no place for another connection");
                }
                continue;
            };
            let stalled = self.stalled.clone();
            let tls = self.tls.as_ref();
            return (Connection::new(stream, tls, self.limits, stalled, place), address);
        }
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

impl Connected<IncomingStream<'_, Patient>> for Peer {
    fn connect_info(stream: IncomingStream<'_, Patient>) -> Self {
        Self(*stream.remote_addr())
    }
}

/// Serves until `stop`, then for [`GRACE`] at most.
pub async fn serve(listener: Patient, router: axum::Router, stop: CancellationToken) {
    let service = router.into_make_service_with_connect_info::<Peer>();
    let server = axum::serve(listener, service)
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
            let patience = Duration::from_millis(300);
            Patient::new(listener, stalled.clone(), 2)
                .with_limits(Limits { patience, idle: IDLE }, 2)
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

    #[test]
    fn who_has_nothing_done_loses_its_place_and_more_than_there_are_places_for_are_refused() {
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().unwrap();
        let (refused, stop) = (Counter::default(), CancellationToken::new());
        let bound = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let address = bound.local_addr().unwrap();
        bound.set_nonblocking(true).unwrap();
        let limits = Limits { patience: PATIENCE, idle: Duration::from_millis(500) };
        let listener = {
            let _context = runtime.enter();
            let listener = TcpListener::from_std(bound).unwrap();
            Patient::new(listener, Counter::default(), 1)
                .counting_refused(refused.clone())
                .with_limits(limits, 1)
        };
        let router = axum::Router::new().route("/", axum::routing::get(async || "here"));
        runtime.spawn(serve(listener, router, stop.clone()));
        let connect = || std::net::TcpStream::connect(address).unwrap();
        let end = |mut stream: std::net::TcpStream| {
            let mut rest = Vec::new();
            let _cut = stream.read_to_end(&mut rest);
            rest
        };
        let mut silent = connect();
        silent.write_all(b"GET / HT").unwrap();
        assert_eq!(end(connect()), b"", "there is one place, and it is taken");
        assert_eq!(refused.get(), 1);
        assert_eq!(end(silent), b"", "a head that does not come to its end");
        // The place is free again, soon after its last holder has heard of its end.
        let is_answered = |_: &u32| {
            let mut next = connect();
            let _cut = next.write_all(b"GET / HTTP/1.1\r\nhost: x\r\n\r\n");
            end(next).ends_with(b"here")
        };
        assert!((0..1000).find(is_answered).is_some(), "and is closed after it was quiet");
        stop.cancel();
    }
}
