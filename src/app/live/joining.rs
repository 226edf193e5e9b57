//! A machine with live senders, joined to its shard and the stores before any sender has come.

use super::Port;
use super::PortPlan;
use super::Room;
use super::opening::Opener;
use crate::alarms::AlarmEngine;
use crate::api::handles::MachineHandle;
use crate::api::handles::Submit;
use crate::api::view::RecordingView;
use crate::api::view::SourceState;
use crate::app::baselines;
use crate::app::build::Joined;
use crate::app::build::configuration_hash;
use crate::app::build::restore;
use crate::app::keeper::MachineKeeper;
use crate::app::link::Link;
use crate::app::monitored::Monitored;
use crate::app::monitored::Opened;
use crate::app::renewal::InForce;
use crate::app::start_error::StartError;
use crate::app::stores::Stores;
use crate::config::Config;
use crate::config::MachineConfig;
use crate::notify::HealthWatch;
use crate::store::StreamKey;
use crate::telemetry::Metrics;
use std::sync::Arc;
use tokio::sync::watch;

/// Joins a machine to the way of its senders and to the stores. `tells_store`: it tells when the store fails.
pub(in crate::app) fn join(
    config: &Config,
    entry: &MachineConfig,
    link: Link,
    (stores, metrics, room): (&Stores, &Arc<Metrics>, &Arc<Room>),
    tells_store: bool,
) -> Result<Joined, StartError> {
    let id = &entry.machine.id;
    let in_force = InForce::of(config, entry);
    let (config, keeper) = (Arc::clone(&in_force.config), &stores.keeper);
    let (in_force, holds) = watch::channel(in_force);
    let origin = super::unknown_stream().start_time.unwrap_or_default();
    let judged_by = Some(configuration_hash(&config));
    let key = StreamKey { identity: None, start: Some(origin), judged_by };
    let mut alarms = AlarmEngine::of_machine(&entry.machine, &[], config.monitor.alarms.clone());
    let (alarm_events, kept) = restore(&mut alarms, id, &key, &*keeper.archive, keeper.clock)?;
    let opener = Opener {
        config: Arc::clone(&config),
        entry: entry.clone(),
        baseline: baselines::named(entry)?,
        signed: Arc::clone(&stores.baselines.store),
        trends: stores.trend_keeper.clone(),
        key: key.clone(),
        capturer: stores.captures.as_ref().map(|captures| captures.capturer.clone()),
        metrics: Arc::clone(metrics),
        kept,
        waiting_bytes: 0,
    };
    let opened = Opened {
        configuration: configuration_hash(&config).into(),
        monitor: None,
        source: SourceState::Starting,
        start_time: Some(origin),
        is_live: true,
        alarms,
        alarm_events,
        health: HealthWatch::new(stores.events.log.health(id)?, None),
        keeper: MachineKeeper::new(keeper.clone(), id, key, tells_store),
        trending: None,
        opener: Some(opener),
    };
    let traffic = Arc::clone(link.traffic());
    let machine = Arc::clone(&entry.machine);
    let (monitored, view) = Monitored::new(Arc::clone(&machine), opened, None, (traffic, metrics));
    let (recorded, recording) = watch::channel(RecordingView::default());
    let recordings = stores.recordings.clone();
    let recording = recordings.as_ref().map(|_| recording);
    let asked = link.clone();
    let port = Arc::new(Port::new(PortPlan {
        in_force: holds,
        origin,
        link,
        room: Arc::clone(room),
        recordings,
        recorded,
        recording_metrics: metrics.recording(id),
        troubles: keeper.troubles.clone(),
    }));
    let shown = Arc::clone(&port);
    let submit: Submit = Arc::new(move |request| asked.ask(request));
    let handle = MachineHandle {
        id: id.clone(),
        view,
        recording,
        simulation: None,
        ingest: Some(Arc::new(move || shown.view())),
        submit,
    };
    Ok(Joined { monitored, source: None, port: Some(port), handle, in_force })
}
