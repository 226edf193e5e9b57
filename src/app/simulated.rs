//! A simulated source's thread: runs a scene by the clock, answers scenarios, shows how it is doing.

use super::link::Link;
use super::outlet::Outlet;
use super::recording::Recording;
use super::stop::Stop;
use crate::api::handles::NotTaken;
use crate::api::handles::ScenarioRequest;
use crate::api::handles::SimulationHandle;
use crate::api::view::SourceState;
use crate::causes::with_causes;
use crate::ingest::simulated;
use crate::ingest::simulated::Source;
use crate::ingest::simulated::Status;
use crate::telemetry::SimulationMetrics;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::mpsc;
use tokio::sync::watch;

/// Scenarios that may wait for the end of a block.
const MAX_WAITING: usize = 4;

/// The daemon's end of the way to HTTP.
#[derive(Debug)]
pub struct Desk {
    requests: mpsc::Receiver<ScenarioRequest>,
    publisher: watch::Sender<Arc<Status>>,
    metrics: SimulationMetrics,
}

impl Desk {
    /// Makes it with HTTP's end.
    #[must_use]
    pub fn new(source: &Source, metrics: SimulationMetrics) -> (Self, SimulationHandle) {
        let (sender, requests) = mpsc::sync_channel(MAX_WAITING);
        let (publisher, view) = watch::channel(Arc::new(source.status()));
        let submit = Arc::new(move |request| {
            sender.try_send(request).map_err(|refused| match refused {
                mpsc::TrySendError::Full(_) => NotTaken::Busy,
                mpsc::TrySendError::Disconnected(_) => NotTaken::Ended,
            })
        });
        (Self { requests, publisher, metrics }, SimulationHandle { view, submit })
    }

    /// Answers what waits and shows how the source is doing.
    fn serve(&self, machine: &str, source: &mut Source) {
        while let Ok(request) = self.requests.try_recv() {
            let ScenarioRequest { wanted, grow_s, turn_hz, reply } = request;
            // The damage first: a speed that is refused is told, and the damage holds.
            let damaged = wanted.map_or(Ok(()), |wanted| source.change(&wanted, grow_s));
            let changed = damaged.and_then(|()| turn_hz.map_or(Ok(()), |hz| source.turn(hz)));
            let status = Arc::new(source.status());
            if changed.is_ok() {
                let scenario = status.scenario.unwrap_or("faults");
                tracing::info!(
                    machine,
                    scenario,
                    grow_s,
                    turn_hz,
                    "scenario of the simulation changed"
                );
            }
            self.publisher.send_replace(Arc::clone(&status));
            // Who asked may have gone.
            let _gone = reply.send(changed.map(|()| status));
        }
        self.show(machine, source);
    }

    fn show(&self, machine: &str, source: &Source) {
        let status = Arc::new(source.status());
        self.metrics.simulated_s.set(status.simulated_s);
        self.metrics.lag_s.set(status.lag.now_s);
        self.metrics.given_up_s.set(status.lag.given_up_s);
        let before = self.publisher.send_replace(Arc::clone(&status));
        if status.lag.n_given_up > before.lag.n_given_up && before.keeps_pace {
            let given_up_s = status.lag.given_up_s;
            tracing::warn!(machine, given_up_s, "the simulation does not keep up with its pace");
        }
    }
}

/// Runs until an error or the stop, and tells the shard which.
pub fn run(
    machine: &str,
    source: &mut Source,
    desk: &Desk,
    link: &Link,
    stop: &Stop,
    (recording, is_captured): (Option<Recording>, bool),
) {
    let is_received = recording.is_some() || is_captured;
    Outlet::new(link, stop, recording, is_captured).run(|outlet| {
        let mut wait = |due_s: f64| {
            let late_s = outlet.elapsed_s() - due_s;
            match outlet.wait(due_s) {
                ControlFlow::Continue(()) => ControlFlow::Continue(late_s),
                ControlFlow::Break(()) => ControlFlow::Break(()),
            }
        };
        let ran = simulated::run(
            source,
            is_received,
            &mut |source| desk.serve(machine, source),
            &mut || stop.is_set(),
            &mut wait,
            &mut |step| outlet.take(step),
        );
        match ran {
            Ok(()) => None,
            Err(error) => Some(SourceState::Failed(with_causes(&error))),
        }
    });
}
