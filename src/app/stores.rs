//! What is kept under the store's folder, opened before any thread starts.

use super::baselines;
use super::build::configuration_hash;
use super::captures;
use super::captures::Capturer;
use super::captures::Captures;
use super::capturing::Capturing;
use super::fitted;
use super::fitted::Fitted;
use super::keeper::Keeper;
use super::keeper::KeeperPlan;
use super::notify;
use super::notify::Notifier;
use super::recording;
use super::room::CapturesGiveWay;
use super::room::Room;
use super::start_error::StartError;
use super::trending;
use super::trending::TrendKeeper;
use super::trending::TrendPlan;
use crate::api::handles::BaselineHandle;
use crate::api::handles::EventsHandle;
use crate::api::handles::FeedbackHandle;
use crate::api::handles::TrendHandle;
use crate::capture::recording::store::Store as Recordings;
use crate::capture::writer::CaptureHeader;
use crate::causes::with_causes;
use crate::config::Config;
use crate::config::MachineConfig;
use crate::evidence::kept::Judged;
use crate::ingest::replay::StreamInfo;
use crate::machine::Machine;
use crate::store::ConfigurationEntry;
use crate::store::StateStore;
use crate::store::feedback::SqliteFeedback;
use crate::store::sqlite;
use crate::telemetry::Metrics;
use std::sync::Arc;
use std::sync::Mutex;

/// All stores; their threads end when the ways to them are dropped.
#[derive(Debug)]
pub(super) struct Stores {
    pub(super) keeper: Keeper,
    pub(super) keeping: KeeperPlan,
    pub(super) baselines: BaselineHandle,
    pub(super) feedback: FeedbackHandle,
    pub(super) events: EventsHandle,
    pub(super) notify: Notifier,
    pub(super) recordings: Option<Arc<Mutex<Recordings>>>,
    pub(super) trend_keeper: TrendKeeper,
    pub(super) trending: TrendPlan,
    pub(super) trends: TrendHandle,
    pub(super) captures: Option<Captures>,
}

impl Stores {
    /// Opens them for the streams there are.
    ///
    /// # Errors
    /// When one cannot be used or is too small.
    pub(super) fn open(
        config: &Config,
        streams: &[(&Machine, &StreamInfo)],
        metrics: &Arc<Metrics>,
    ) -> Result<Self, StartError> {
        let (keeper, keeping) = open_keeper(config, metrics)?;
        let baselines = baselines::handle(config)?;
        let feedback = Arc::new(SqliteFeedback::join(&config.store.directory)?);
        let feedback = FeedbackHandle { store: feedback, wall_clock: super::wall_clock };
        let (events, notify) = notify::plan(config, &keeper, metrics)?;
        let recordings = recording::open_store(config);
        let n_channels = streams.iter().map(|(_, info)| info.channels.len()).sum();
        let (trend_keeper, mut trending, trends) =
            trending::open(config, n_channels, metrics, recordings.clone())?;
        let waiting = streams.iter().map(|(machine, info)| {
            let settings = Fitted::of(config, machine, info).captures;
            captures::waiting_bytes(settings, &info.received)
        });
        let (troubles, give_way) = (keeper.troubles.clone(), Arc::<CapturesGiveWay>::default());
        trending.room = Some(Room {
            root: config.store.directory.clone(),
            recordings: recordings.clone(),
            captures: Arc::clone(&give_way),
            troubles: troubles.clone(),
            metrics: metrics.room(),
        });
        let counted = (metrics.captures(), metrics.room());
        let captures = captures::open(config, waiting.sum(), counted, (troubles, give_way))?;
        Ok(Self {
            keeper,
            keeping,
            baselines,
            feedback,
            events,
            notify,
            recordings,
            trend_keeper,
            trending,
            trends,
            captures,
        })
    }
}

/// Opens the store and notes the configuration in it.
fn open_keeper(config: &Config, metrics: &Metrics) -> Result<(Keeper, KeeperPlan), StartError> {
    let (mut store, archive) = sqlite::open(&config.store.directory)?;
    let entry = ConfigurationEntry {
        hash: configuration_hash(config),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        since: super::wall_clock(),
    };
    // A disk that is full now may have room later: alarms are raised all the same.
    if let Err(error) = store.note_configuration(&entry) {
        tracing::error!(error = with_causes(&error), "the configuration's hash is not stored");
    }
    Ok(Keeper::new(Box::new(store), Arc::new(archive), metrics.store()))
}

/// What a machine's captures need; `None`: none are made.
pub(super) fn capturing(
    config: &Config,
    entry: &MachineConfig,
    info: &StreamInfo,
    capturer: Capturer,
) -> Option<Capturing> {
    let header = CaptureHeader {
        start_time: info.start_time,
        machine: Some(entry.text.0.to_string()),
        shaft_speed: info.shaft_speed,
    };
    let Fitted { settings, captures } = Fitted::of(config, &entry.machine, info);
    let judged = Judged {
        received: info.received.clone(),
        channels: info.channels.clone(),
        hints: fitted::hints(info),
        settings,
    };
    let by = (judged, configuration_hash(config));
    Some(Capturing::new(&entry.machine.id, captures?, capturer, header, by))
}
