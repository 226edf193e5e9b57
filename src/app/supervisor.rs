//! The service manager (systemd): told when the daemon is ready, that it lives, and that it ends. Without one nothing is told.
//!
//! It is told that the daemon lives only while every shard comes round: one that hangs is started anew.

use sd_notify::NotifyState;
use std::sync::Arc;
use std::time::Duration;
use tokio_util::sync::CancellationToken;

/// Says whether every shard comes round.
pub(super) type Moves = Arc<dyn Fn() -> bool + Send + Sync>;

/// The daemon answers and its sources run.
pub(super) fn ready(status: &str) {
    tell(&[NotifyState::Ready, NotifyState::Status(status)]);
}

/// The daemon ends.
pub(super) fn stopping() {
    tell(&[NotifyState::Stopping]);
}

/// Says that the daemon lives until the stop, three times in the time that the manager waits for it.
pub(super) async fn feed(moves: Moves, stop: CancellationToken) {
    let Some(limit) = sd_notify::watchdog_enabled() else { return };
    loop {
        tokio::select! {
            () = stop.cancelled() => return,
            () = tokio::time::sleep(interval(limit)) => {}
        }
        if moves() {
            tell(&[NotifyState::Watchdog]);
        } else {
            tracing::error!(
                "a shard does not come round; the service manager will start the daemon anew"
            );
        }
    }
}

fn interval(limit: Duration) -> Duration {
    limit / 3
}

fn tell(states: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(states) {
        tracing::warn!(%error, "the service manager cannot be told");
    }
}
