//! How the daemon is doing: version, configuration, what its store takes, clocks, lag and losses of every stage.

use super::extract::State;
use super::handles::{MachineHandle, ReceiverStatus, StoreHandle, StoreSizes, TrendHandle};
use super::state::{ApiState, newest};
use super::view::{ConfigurationView, MachineView, RecordingView};
use super::wire::finite;
use super::wire::machines::source_and_reason;
use super::wire::rfc3339;
use super::wire::system::{
    ConfigurationStateWire, EventStreamsWire, ReceiverWire, RecordingWire, SecurityWire,
    StorePartWire, StoreSizesWire, StoreWire, StreamWire, SystemWire, TrendStoreWire,
};
use axum::Json;

/// Gives version, configuration, what the store takes and for how long there is room, and clocks, lag and losses of every
/// stream.
#[utoipa::path(
    get,
    path = "/api/v1/system",
    tag = "service",
    responses((status = OK, body = SystemWire))
)]
pub(super) async fn system(State(state): State<ApiState>) -> Json<SystemWire> {
    let mut configuration = state.configuration.as_ref().map(|view| view.borrow().clone());
    // What waits or was refused may name any machine, and so may receivers.
    if state.is_restricted() {
        configuration = configuration.map(|view| ConfigurationView {
            restart: Vec::new(),
            rejected: view.rejected.map(|(at, _)| (at, Vec::new())),
            ..view
        });
    }
    let receivers = state.events.iter().filter(|_| !state.is_restricted());
    let caller = state.caller.as_ref();
    Json(SystemWire {
        name: env!("CARGO_PKG_NAME").to_owned(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        configuration_hash: configuration.as_ref().map(|view| view.hash.clone()),
        configuration: configuration.as_ref().map(configuration_wire),
        started_at: state.settings.started_at.map(|started| rfc3339(Some(started), 0.0)),
        store: state.store.as_ref().map(store),
        sizes: state.trends.as_ref().map(|trends| sizes(&trends.sizes.borrow())),
        security: SecurityWire {
            tokens: !state.door.is_open(),
            encrypted: state.settings.is_encrypted,
            warnings: state.settings.warnings.clone(),
            you: caller.map(|token| token.label().to_owned()),
            role: caller.map(|token| token.role().name().to_owned()),
        },
        receivers: receivers
            .flat_map(|events| events.receivers.borrow().iter().map(receiver).collect::<Vec<_>>())
            .collect(),
        event_streams: state.events.as_ref().map(|events| EventStreamsWire {
            open: events.open.get(),
            refused: events.refused.get(),
            stalled: events.stalled.get(),
        }),
        trends: state.trends.as_ref().map(trends),
        streams: state.machines.values().map(stream).collect(),
    })
}

fn stream(handle: &MachineHandle) -> StreamWire {
    let view = newest(handle);
    let (source, reason) = source_and_reason(&view);
    let lag = handle.simulation.as_ref().map(|simulation| simulation.view.borrow().lag);
    let senders = handle.ingest.as_ref().map(|status| status());
    let sum = |count: fn(&crate::buffer::RingStatus) -> u64| view.rings.iter().map(count).sum();
    StreamWire {
        machine: handle.id.clone(),
        source: source.to_owned(),
        reason,
        queue_bytes: view.queue_bytes,
        queue_wait_s: view.queue_wait_s.and_then(finite),
        verdict_lag_s: verdict_lag_s(&view),
        clock_drift_ppm: senders.as_ref().and_then(|s| finite(s.drift_ppm()?)),
        clock_offset_s: senders.as_ref().and_then(|s| finite(s.clock_offset_s()?)),
        sample_age_s: senders.as_ref().and_then(|s| finite(s.sample_age_s()?)),
        dropped_blocks: view.dropped.0,
        dropped_samples: view.dropped.1,
        received: sum(|ring| ring.received),
        missing: sum(|ring| ring.missing),
        gaps: sum(|ring| ring.gaps),
        duplicated: sum(|ring| ring.duplicated),
        clipped: sum(|ring| ring.clipped),
        simulation_lag_s: lag.and_then(|lag| finite(lag.now_s)),
        simulation_lag_given_up_s: lag.and_then(|lag| finite(lag.given_up_s)),
        recording: handle.recording.as_ref().map(|view| recording(&view.borrow())),
    }
}

/// How far the newest verdict is behind the newest sample, s of stream time; `None`: there is no verdict.
fn verdict_lag_s(view: &MachineView) -> Option<f64> {
    finite((view.stream_time_s - view.window_end_s?).max(0.0))
}

fn store(store: &StoreHandle) -> StoreWire {
    let pace = store.status.pace();
    StoreWire {
        failure: store.status.failure(),
        stored: store.status.n_stored(),
        waiting: store.status.n_waiting(),
        lost: store.status.n_lost(),
        waiting_since: pace.waiting_since.map(|at| rfc3339(Some(at), 0.0)),
        committed_at: pace.committed.map(|(at, _)| rfc3339(Some(at), 0.0)),
        commit_s: pace.committed.and_then(|(_, took_s)| finite(took_s)),
    }
}

fn sizes(sizes: &StoreSizes) -> StoreSizesWire {
    let parts = sizes.parts.iter().map(|part| StorePartWire {
        name: part.name.to_owned(),
        bytes: part.bytes,
        limit_bytes: part.limit_bytes,
        growth_bytes_per_day: part.growth_bytes_per_day.and_then(finite),
        days_to_limit: part.days_to_limit.and_then(finite),
    });
    StoreSizesWire {
        measured_s: sizes.measured_s,
        free_bytes: sizes.free_bytes,
        parts: parts.collect(),
    }
}

fn trends(trends: &TrendHandle) -> TrendStoreWire {
    let holdings = *trends.holdings.borrow();
    TrendStoreWire {
        failure: trends.status.failure(),
        stored: trends.status.n_stored(),
        waiting: trends.status.n_waiting(),
        lost: trends.status.n_lost(),
        files: holdings.n_files,
        bytes: holdings.bytes,
        removed: holdings.n_removed,
        set_aside: holdings.n_set_aside,
    }
}

fn configuration_wire(view: &ConfigurationView) -> ConfigurationStateWire {
    ConfigurationStateWire {
        since: rfc3339(Some(view.since), 0.0),
        waiting_for_restart: view.restart.clone(),
        rejected_at: view.rejected.as_ref().map(|(at, _)| rfc3339(Some(*at), 0.0)),
        rejected_because: view.rejected.iter().flat_map(|(_, why)| why.iter().cloned()).collect(),
    }
}

fn receiver(status: &ReceiverStatus) -> ReceiverWire {
    let view = status.view.borrow().clone();
    ReceiverWire {
        name: status.name.clone(),
        kind: status.kind.to_owned(),
        failure: view.failure,
        waiting: view.n_waiting,
        waiting_since: view.waiting_since.map(|at| rfc3339(Some(at), 0.0)),
        delivered: view.progress.n_delivered,
        refused: view.progress.n_refused,
        given_up: view.progress.n_given_up,
        last_delivered_at: view.last_delivered.map(|at| rfc3339(Some(at), 0.0)),
    }
}

fn recording(view: &RecordingView) -> RecordingWire {
    RecordingWire {
        file: view.file.clone(),
        failure: view.failure.clone(),
        files: view.n_files,
        bytes: view.bytes,
        recorded: view.n_recorded,
        lost: view.n_lost,
        failures: view.n_failures,
        removed: view.n_removed,
    }
}
