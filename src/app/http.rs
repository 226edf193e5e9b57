//! The HTTP server: the API's router on a listener, ended in bounded time.

use crate::api::view::MachineHandle;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;

/// How long open connections may finish what they do when the daemon stops. A client that listens
/// to an endless stream is cut off after it.
pub const GRACE: Duration = Duration::from_secs(1);

/// Gives the metrics as text.
pub type MetricsText = Arc<dyn Fn() -> String + Send + Sync>;

/// Gives what keeps the daemon from its work, as only its clock can tell.
pub type ReadinessCheck = Arc<dyn Fn() -> Vec<String> + Send + Sync>;

/// Makes the routes: the one place where the daemon meets the API.
pub fn router(
    _machines: Vec<MachineHandle>,
    _bound: SocketAddr,
    metrics: MetricsText,
    readiness: ReadinessCheck,
) -> axum::Router {
    // Stands in for `api::router(ApiState::new(machines, Settings::new(bound), metrics, readiness))`.
    use axum::http::StatusCode;
    use axum::routing::get;
    let ready = move || async move {
        let reasons = readiness();
        let status =
            if reasons.is_empty() { StatusCode::OK } else { StatusCode::SERVICE_UNAVAILABLE };
        (status, reasons.join("\n"))
    };
    axum::Router::new()
        .route("/livez", get(|| async { "ok" }))
        .route("/readyz", get(ready))
        .route("/metrics", get(move || async move { metrics() }))
}

/// Serves until `stop`, then for [`GRACE`] at most.
pub async fn serve(listener: TcpListener, router: axum::Router, stop: CancellationToken) {
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
