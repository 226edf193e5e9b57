//! SIGINT and SIGTERM while a grid is tried: the first ends it in order, so that what was tried is told; the next ends the process.

use std::process;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering;
use std::thread;
use tokio::signal::unix::SignalKind;
use tokio::signal::unix::signal;

/// Exit code of who was ended by SIGINT, as shells give it.
const EXIT_INTERRUPTED: i32 = 130;

/// Whether somebody asked to stop.
#[derive(Debug, Clone, Default)]
pub(super) struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Listens for the signals from a thread of its own, as long as the process lives. Where that fails they end the process at once, as
    /// they do without it.
    pub(super) fn on_signals() -> Self {
        let stop = Self::default();
        let asked = stop.clone();
        let waiting = thread::Builder::new().name("signals".to_owned()).spawn(move || {
            if let Err(error) = asked.wait() {
                tracing::warn!(%error, "what was tried will not be told if this is stopped");
            }
        });
        if let Err(error) = waiting {
            tracing::warn!(%error, "what was tried will not be told if this is stopped");
        }
        stop
    }

    pub(super) fn is_asked(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    pub(super) fn ask(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    fn wait(&self) -> std::io::Result<()> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_io().build()?;
        runtime.block_on(async {
            let mut interrupt = signal(SignalKind::interrupt())?;
            let mut terminate = signal(SignalKind::terminate())?;
            loop {
                tokio::select! {
                    _ = interrupt.recv() => (),
                    _ = terminate.recv() => (),
                }
                if self.is_asked() {
                    process::exit(EXIT_INTERRUPTED);
                }
                self.ask();
                tracing::info!("stopping; what was tried so far is told when the trials in work are done, a second signal ends at once");
            }
        })
    }
}
