//! What the handlers share.

use super::error::ApiError;
use super::handles::{
    BaselineHandle, CaptureHandle, EventsHandle, FeedbackHandle, IngestOpen, MachineHandle,
    StoreHandle, TrendHandle,
};
use super::recent::Recent;
use super::view::{ConfigurationView, MachineView, ShardRequest};
use super::waiting;
use crate::access::{Door, Token};
use crate::signal::{ChannelInfo, Timestamp};
use crate::store::{Archive, StoreError};
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::{Semaphore, oneshot, watch};

/// Limits and facts of the daemon.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Address the listener is bound to, with its real port.
    pub bound: SocketAddr,
    /// Names by which it is asked besides those of this computer, with a port where only that one is meant.
    pub hosts: Vec<String>,
    /// Origins whose pages may ask, too.
    pub cors_origins: Vec<String>,
    /// Whether connections are encrypted.
    pub is_encrypted: bool,
    /// What is open that should not be, for people.
    pub warnings: Vec<String>,
    /// Spectra and scalograms computed at a time; more are refused.
    pub max_computations: usize,
    /// Requests answered at a time; more are refused.
    pub max_requests: usize,
    /// Streams of events open at a time; more are refused.
    pub max_streams: usize,
    /// Longest silence on a stream of events.
    pub heartbeat: Duration,
    /// Longest wait for a shard's reply.
    pub reply_timeout: Duration,
    /// Longest time a request may take.
    pub request_timeout: Duration,
    /// When the daemon started, wall clock.
    pub started_at: Option<Timestamp>,
}

impl Settings {
    /// The usual limits for a listener bound to `bound`.
    #[must_use]
    pub fn new(bound: SocketAddr) -> Self {
        Self {
            bound,
            hosts: Vec::new(),
            cors_origins: Vec::new(),
            is_encrypted: false,
            warnings: Vec::new(),
            max_computations: 2,
            max_requests: 128,
            max_streams: 32,
            heartbeat: Duration::from_secs(15),
            reply_timeout: Duration::from_secs(2),
            request_timeout: Duration::from_secs(10),
            started_at: None,
        }
    }
}

/// Gives the metrics as OpenMetrics text.
pub type MetricsText = Arc<dyn Fn() -> String + Send + Sync>;

/// Gives reasons why the daemon does not do its work that only its clock can tell, e.g. a pipeline
/// that has not moved for a while.
pub type ReadinessCheck = Arc<dyn Fn() -> Vec<String> + Send + Sync>;

/// What the handlers share, behind one `Arc`: a clone counts twenty references up, which several threads do not do in parallel.
#[derive(Clone)]
pub struct ApiState {
    /// Machines by id.
    pub(super) machines: Arc<BTreeMap<String, MachineHandle>>,
    /// Who comes in.
    pub(super) door: Arc<Door>,
    /// Whose token it was; `None`: nobody needs one.
    pub(super) caller: Option<Arc<Token>>,
    pub(super) settings: Arc<Settings>,
    pub(super) metrics: MetricsText,
    pub(super) readiness: ReadinessCheck,
    /// What survives a restart; `None`: nothing does.
    pub(super) store: Option<StoreHandle>,
    /// Baselines; `None`: there is no store for them.
    pub(super) baselines: Option<BaselineHandle>,
    /// What people found of verdicts; `None`: there is no store for it.
    pub(super) feedback: Option<FeedbackHandle>,
    /// What is pushed; `None`: nothing is.
    pub(super) events: Option<EventsHandle>,
    /// One permit a stream of events.
    pub(super) streams: Arc<Semaphore>,
    /// The history of trends; `None`: there is none.
    pub(super) trends: Option<TrendHandle>,
    pub(super) captures: Option<CaptureHandle>,
    /// Folder of recordings; `None`: there is no store for them.
    pub(super) recordings: Option<PathBuf>,
    /// The configuration that holds; `None`: it is unknown.
    pub(super) configuration: Option<watch::Receiver<ConfigurationView>>,
    /// The newest lines of the log, at most so many.
    pub(super) log: fn(usize) -> Vec<String>,
    /// Lets senders of samples in; `None`: no source has any.
    pub(super) ingest: Option<IngestOpen>,
    /// One permit a computation.
    pub(super) computations: Arc<Semaphore>,
    /// One permit a request.
    pub(super) requests: Arc<Semaphore>,
    /// One permit a KiB of the answers that wait for their readers.
    pub(super) waiting: Arc<Semaphore>,
    /// Spectra that were just computed.
    pub(super) recent: Recent,
    /// One permit for a capture that is judged again.
    pub(super) rejudging: Arc<Semaphore>,
    /// One permit for baselines that are learned of recordings.
    pub(super) learning: Arc<Semaphore>,
}

impl std::fmt::Debug for ApiState {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ApiState")
            .field("machines", &self.machines.keys())
            .field("settings", &self.settings)
            .finish_non_exhaustive()
    }
}

impl ApiState {
    /// Makes the state for `machines`.
    #[must_use]
    pub fn new(
        machines: Vec<MachineHandle>,
        settings: Settings,
        metrics: MetricsText,
        readiness: ReadinessCheck,
    ) -> Self {
        Self {
            machines: Arc::new(
                machines.into_iter().map(|handle| (handle.id.clone(), handle)).collect(),
            ),
            computations: Arc::new(Semaphore::new(settings.max_computations)),
            requests: Arc::new(Semaphore::new(settings.max_requests)),
            streams: Arc::new(Semaphore::new(settings.max_streams)),
            waiting: Arc::new(Semaphore::new(waiting::MAX_WAITING_KIB)),
            rejudging: Arc::new(Semaphore::new(1)),
            learning: Arc::new(Semaphore::new(1)),
            recent: Recent::default(),
            door: Arc::new(Door::open()),
            caller: None,
            settings: Arc::new(settings),
            metrics,
            readiness,
            store: None,
            baselines: None,
            feedback: None,
            events: None,
            trends: None,
            captures: None,
            recordings: None,
            configuration: None,
            log: |_| Vec::new(),
            ingest: None,
        }
    }

    /// Lets in who may.
    #[must_use]
    pub fn with_door(self, door: Arc<Door>) -> Self {
        Self { door, ..self }
    }

    /// As somebody sees it: machines that a token is not of are not there.
    pub(super) fn seen_by(&self, caller: Arc<Token>) -> Self {
        let mut seen = self.clone();
        if caller.is_restricted() {
            let all = self.machines.iter().filter(|(id, _)| caller.sees(id));
            seen.machines = Arc::new(all.map(|(id, one)| (id.clone(), one.clone())).collect());
        }
        Self { caller: Some(caller), ..seen }
    }

    /// The machines that are there for the caller; `None`: all that were ever.
    pub(super) fn visible(&self) -> Option<Vec<String>> {
        self.caller.as_ref().filter(|token| token.is_restricted()).map(|t| t.machines().to_vec())
    }

    /// Whether a machine, of now or before, is there for the caller.
    pub(super) fn sees(&self, machine: &str) -> bool {
        self.caller.as_ref().is_none_or(|token| token.sees(machine))
    }

    /// Whether the caller is of some machines only.
    pub(super) fn is_restricted(&self) -> bool {
        self.caller.as_ref().is_some_and(|token| token.is_restricted())
    }

    /// Who acts: the label of the caller's token, else the name that is given.
    pub(super) fn author(&self, given: String) -> String {
        self.caller.as_ref().map_or(given, |token| token.label().to_owned())
    }

    /// Reads older trends.
    #[must_use]
    pub fn with_trends(self, trends: TrendHandle) -> Self {
        Self { trends: Some(trends), ..self }
    }

    /// Shows captures, if any are made.
    #[must_use]
    pub fn with_captures(self, captures: Option<CaptureHandle>) -> Self {
        Self { captures, ..self }
    }

    /// Shows the recordings in a folder.
    #[must_use]
    pub fn with_recordings(self, root: PathBuf) -> Self {
        Self { recordings: Some(root), ..self }
    }

    /// Lets senders of samples in, if a source has any.
    #[must_use]
    pub fn with_ingest(self, ingest: Option<IngestOpen>) -> Self {
        Self { ingest, ..self }
    }

    /// Shows the configuration that holds.
    #[must_use]
    pub fn with_configuration(self, configuration: watch::Receiver<ConfigurationView>) -> Self {
        Self { configuration: Some(configuration), ..self }
    }

    /// Keeps baselines.
    #[must_use]
    pub fn with_baselines(self, baselines: BaselineHandle) -> Self {
        Self { baselines: Some(baselines), ..self }
    }

    /// Keeps what people found of verdicts.
    #[must_use]
    pub fn with_feedback(self, feedback: FeedbackHandle) -> Self {
        Self { feedback: Some(feedback), ..self }
    }

    /// Pushes what happens.
    #[must_use]
    pub fn with_events(self, events: EventsHandle) -> Self {
        Self { events: Some(events), ..self }
    }

    /// Shows the newest lines of the log.
    #[must_use]
    pub fn with_log(self, log: fn(usize) -> Vec<String>) -> Self {
        Self { log, ..self }
    }

    /// Reads older events from `store`.
    #[must_use]
    pub fn with_store(self, store: StoreHandle) -> Self {
        Self { store: Some(store), ..self }
    }

    /// Finds a machine.
    pub(super) fn machine(&self, id: &str) -> Result<&MachineHandle, ApiError> {
        self.machines.get(id).ok_or_else(|| unknown("machine", id, self.machines.keys()))
    }

    /// Puts a question to a machine's shard and waits for the reply.
    pub(super) async fn ask<T>(
        &self,
        handle: &MachineHandle,
        question: impl FnOnce(oneshot::Sender<T>) -> ShardRequest,
    ) -> Result<T, ApiError> {
        let (reply, answer) = oneshot::channel();
        (handle.submit)(question(reply))
            .map_err(|_| ApiError::Busy("the machine's shard is busy"))?;
        match tokio::time::timeout(self.settings.reply_timeout, answer).await {
            Ok(Ok(answer)) => Ok(answer),
            Ok(Err(_)) => Err(ApiError::Busy("the machine's shard dropped the question")),
            Err(_) => Err(ApiError::Timeout),
        }
    }

    /// Reads from the store beside the event loop; `None` when there is none.
    pub(super) async fn read_store<T: Send + 'static>(
        &self,
        read: impl FnOnce(&dyn Archive) -> Result<T, StoreError> + Send + 'static,
    ) -> Result<Option<T>, ApiError> {
        let Some(store) = &self.store else { return Ok(None) };
        let archive = Arc::clone(&store.archive);
        let done = tokio::task::spawn_blocking(move || read(&*archive)).await;
        let read = done.map_err(|error| {
            tracing::error!(%error, "reading the store panicked");
            ApiError::Internal
        })?;
        Ok(Some(read?))
    }

    /// Runs `work` beside the event loop, if there is room.
    pub(super) async fn compute<T: Send + 'static>(
        &self,
        work: impl FnOnce() -> Result<T, ApiError> + Send + 'static,
    ) -> Result<T, ApiError> {
        let permit = Arc::clone(&self.computations)
            .try_acquire_owned()
            .map_err(|_| ApiError::Busy("other spectra are being computed"))?;
        let done = tokio::task::spawn_blocking(move || {
            // Held until the work is done, even when the client has gone.
            let _permit = permit;
            work()
        });
        done.await.map_err(|error| {
            tracing::error!(%error, "computation panicked");
            ApiError::Internal
        })?
    }
}

/// Newest snapshot of a machine.
pub(super) fn newest(handle: &MachineHandle) -> Arc<MachineView> {
    Arc::clone(&handle.view.borrow())
}

/// Finds a channel of the stream.
pub(super) fn channel<'v>(
    view: &'v MachineView,
    name: &str,
) -> Result<(usize, &'v ChannelInfo), ApiError> {
    view.channels
        .iter()
        .enumerate()
        .find(|(_, info)| info.name == name)
        .ok_or_else(|| unknown("channel", name, view.channels.iter().map(|info| &info.name)))
}

/// A 404 that says what there is.
fn unknown<'n>(what: &str, name: &str, known: impl Iterator<Item = &'n String>) -> ApiError {
    const MAX_LISTED: usize = 50;
    let mut known: Vec<&str> = known.map(String::as_str).collect();
    let n_known = known.len();
    known.truncate(MAX_LISTED);
    let list = match n_known {
        0 => "there is none yet".to_owned(),
        n if n > MAX_LISTED => format!("there are {n}: {}, …", known.join(", ")),
        _ => format!("there is: {}", known.join(", ")),
    };
    ApiError::NotFound(format!("no {what} {name:?}; {list}"))
}
