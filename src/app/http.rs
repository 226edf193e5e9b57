//! The HTTP server: the API's router on a listener, ended in bounded time.

use crate::api;
use crate::api::state;
use crate::dashboard;
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
pub fn router(state: state::ApiState) -> axum::Router {
    api::router(state, dashboard::router())
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
