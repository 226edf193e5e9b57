//! The stream of events (SSE): transitions and changes of health, from the store's log and then live.
//!
//! Nothing is buffered for a reader: each asks the log for what follows its place when it can take more. One
//! that takes nothing any more is cut off by the server beneath.

use super::error::ApiError;
use super::extract::{Query, State};
use super::handles::EventsHandle;
use super::live::Live;
use super::state::ApiState;
use super::wire::events::{HappenedWire, PlaceWire};
use super::wire::problem::ProblemWire;
use crate::store::StoreError;
use crate::store::events::{EventLog, Extent, LogEntry};
use axum::http::HeaderMap;
use axum::response::sse::{Event, Sse};
use futures_util::stream::{self, Stream};
use prometheus_client::metrics::gauge::Gauge;
use serde::Deserialize;
use std::collections::VecDeque;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{OwnedSemaphorePermit, watch};
use utoipa::IntoParams;

/// Entries read at a time.
const PAGE: usize = 100;

/// Time after which a reader whose stream ended shall come again.
const RETRY: Duration = Duration::from_secs(2);

/// Which events.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct FollowQuery {
    /// Of this machine only.
    machine: Option<String>,
    /// Events after this `id`; the header `Last-Event-ID` is the same and wins. Without either: from now on.
    last_event_id: Option<String>,
    /// Names of features, with commas between, or `all`: what is measured in each window of `machine`, as it is judged.
    features: Option<String>,
}

/// Streams what happens: `alarm` (a transition), `health` (a verdict changed), `configuration` (one was read), `maintenance` (it began or ended), `features` (those of the newest window, if asked for), `begin` (the place at which the
/// stream begins), `reset` (what is between the place asked for and the one in `data` is not all there).
#[utoipa::path(
    get,
    path = "/api/v1/events",
    tag = "events",
    params(
        FollowQuery,
        ("Last-Event-ID" = Option<String>, Header, description = "`id` of the last event received"),
    ),
    responses(
        (status = OK, body = String, content_type = "text/event-stream",
         description = "Server-sent events that do not end; `id` is the place in the store"),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire, content_type = "application/problem+json",
         description = "Too many streams are open, or the store cannot be read"),
    )
)]
pub(super) async fn follow(
    State(state): State<ApiState>,
    Query(query): Query<FollowQuery>,
    headers: HeaderMap,
) -> Result<Sse<impl Stream<Item = Result<Event, Infallible>>>, ApiError> {
    if let Some(machine) = &query.machine {
        state.machine(machine)?;
    }
    let comes_again = query.last_event_id.is_some() || headers.contains_key("last-event-id");
    let features = (query.machine.as_deref(), query.features.as_deref());
    let live = Live::of(&state, features, comes_again)?;
    let Some(events) = state.events.clone() else {
        return Err(ApiError::NotFound("this service has no store of events".to_owned()));
    };
    let from = place(headers.get("last-event-id").map(|id| id.as_bytes()), query.last_event_id)?;
    let Ok(permit) = Arc::clone(&state.streams).try_acquire_owned() else {
        events.refused.inc();
        return Err(ApiError::Busy("as many streams of events as may be are open"));
    };
    let extent = read(&events.log, |log| log.extent()).await?;
    let (begin, place) = beginning(from, extent);
    let mut pending = VecDeque::new();
    pending.extend(event(begin, place.min(extent.newest), &PlaceWire { place }));
    let follower = Follower {
        place,
        pending,
        machine: query.machine,
        live,
        seen: Arc::clone(&state),
        stored: events.stored.clone(),
        log: Arc::clone(&events.log),
        heartbeat: state.settings.heartbeat,
        _open: Open::new(&events, permit),
    };
    Ok(Sse::new(stream::unfold(follower, Follower::next)))
}

/// The place asked for.
fn place(header: Option<&[u8]>, query: Option<String>) -> Result<Option<u64>, ApiError> {
    let text = match header {
        Some(header) => Some(String::from_utf8_lossy(header).into_owned()),
        None => query,
    };
    // A browser that has received nothing sends an empty one.
    let Some(text) = text.filter(|text| !text.is_empty()) else { return Ok(None) };
    text.parse().map(Some).map_err(|_| {
        let found: String = text.chars().take(50).collect();
        ApiError::Invalid(format!("last_event_id is {found:?}, allowed is the id of an event"))
    })
}

/// The name of the first event and the place after which events follow. Who comes from a place that is not there,
/// as after an older copy of the store was put in place, or before what is held, must look at the whole anew.
fn beginning(from: Option<u64>, extent: Extent) -> (&'static str, u64) {
    match from {
        None => ("begin", extent.newest),
        Some(from) if from > extent.newest => ("reset", extent.newest),
        Some(from) if from < extent.removed_until => ("reset", from),
        Some(from) => ("begin", from),
    }
}

/// Reads from a part of the store beside the event loop.
pub(super) async fn read<L: ?Sized + Send + Sync + 'static, T: Send + 'static>(
    log: &Arc<L>,
    work: impl FnOnce(&L) -> Result<T, StoreError> + Send + 'static,
) -> Result<T, ApiError> {
    let log = Arc::clone(log);
    let done = tokio::task::spawn_blocking(move || work(&*log)).await;
    let read = done.map_err(|error| {
        tracing::error!(%error, "reading the events panicked");
        ApiError::Internal
    })?;
    Ok(read?)
}

fn event(name: &str, id: u64, data: &PlaceWire) -> Option<Event> {
    let event = Event::default().event(name).id(id.to_string()).retry(RETRY);
    event.json_data(data).ok()
}

/// Counts an open stream as long as it is.
struct Open {
    open: Gauge,
    _permit: OwnedSemaphorePermit,
}

impl Open {
    fn new(events: &EventsHandle, permit: OwnedSemaphorePermit) -> Self {
        events.open.inc();
        Self { open: events.open.clone(), _permit: permit }
    }
}

impl Drop for Open {
    fn drop(&mut self) {
        self.open.dec();
    }
}

/// One reader.
struct Follower {
    place: u64,
    pending: VecDeque<Event>,
    machine: Option<String>,
    /// What is measured; nothing of it is kept for a reader that was away.
    live: Option<Live>,
    /// What is there for the reader.
    seen: Arc<ApiState>,
    stored: watch::Receiver<u64>,
    log: Arc<dyn EventLog>,
    heartbeat: Duration,
    _open: Open,
}

impl Follower {
    async fn next(mut self) -> Option<(Result<Event, Infallible>, Self)> {
        loop {
            if let Some(event) = self.pending.pop_front() {
                return Some((Ok(event), self));
            }
            // Whose token was revoked, or is over, is told nothing any more.
            if !self.seen.door.holds(self.seen.caller.as_ref()) {
                return None;
            }
            self.stored.mark_unchanged();
            let place = self.place;
            // An end makes the reader come again, with its place.
            let entries = read(&self.log, move |log| log.after(place, PAGE)).await.ok()?;
            if entries.is_empty() {
                let next = tokio::time::timeout(self.heartbeat, self.wake());
                match next.await {
                    // The place goes with it, so that one who is told little does not begin far back.
                    Err(_) => {
                        let beat = Event::default().comment("").id(self.place.to_string());
                        return Some((Ok(beat), self));
                    }
                    Ok(None) => return None,
                    Ok(Some(measured)) => self.pending.extend(measured),
                }
            }
            for entry in entries {
                self.place = entry.place;
                self.pending.extend(self.event(&entry));
            }
        }
    }

    /// Waits for whatever comes first: something that is stored, or a window. `None`: there will be nothing any more.
    async fn wake(&mut self) -> Option<Option<Event>> {
        let Some(live) = self.live.as_mut() else {
            return self.stored.changed().await.ok().map(|()| None);
        };
        tokio::select! {
            stored = self.stored.changed() => stored.ok().map(|()| None),
            window = live.next() => window.map(|wire| {
                // The place goes with it; a window that was missed is in the trend.
                let event = Event::default().event("features").id(self.place.to_string());
                event.json_data(wire).ok()
            }),
        }
    }

    fn event(&self, entry: &LogEntry) -> Option<Event> {
        // What concerns the daemon as a whole may name any machine, and is of no machine: a token of some does not see it.
        let is_other = self.machine.as_ref().is_some_and(|machine| *machine != entry.machine);
        if is_other || !self.seen.sees(&entry.machine) {
            return None;
        }
        let wire = HappenedWire::new(entry);
        let text = wire.text().ok()?;
        Some(Event::default().event(wire.name()).id(entry.place.to_string()).data(text))
    }
}
