//! The way of alarms out of the daemon: one thread a webhook, one task a broker of MQTT.
//!
//! Each follows the store's log of events, which is its queue, and keeps its place there. What is sent when is
//! decided by `notify`; here are the clock, the sockets and the waiting.

mod carrier;
mod webhook;
mod mqtt;
mod states;

use super::Clock;
use super::broker;
use super::keeper::Keeper;
use super::start_error::StartError;
use crate::api::handles::EventsHandle;
use crate::api::handles::MachineHandle;
use crate::api::handles::ReceiverStatus;
use crate::api::handles::ReceiverView;
use crate::causes::with_causes;
use crate::config::Config;
use crate::notify::settings::Broker;
use crate::notify::settings::Settings;
use crate::notify::settings::Webhook;
use crate::store::StoreError;
use crate::store::audit::AuditLog;
use crate::store::events::EventLog;
use crate::store::events::Receivers;
use crate::store::events::SqliteEvents;
use crate::store::writer::Status;
use crate::telemetry::Metrics;
use crate::telemetry::ReceiverMetrics;
use crate::telemetry::StreamMetrics;
use carrier::Follower;
use std::collections::BTreeMap;
use std::io;
use std::sync::Arc;
use std::thread;
use tokio::runtime::Handle;
use tokio::sync::oneshot;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

/// All receivers: starts them, ends them, exchanges them.
pub(super) struct Notifier {
    way: Way,
    /// Built, but not started.
    built: Vec<Built>,
    running: BTreeMap<String, Running>,
    told: watch::Sender<Arc<[ReceiverStatus]>>,
    /// What they are started with; `None`: before the start.
    stage: Option<Stage>,
}

impl std::fmt::Debug for Notifier {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Notifier").field("running", &self.running.keys()).finish_non_exhaustive()
    }
}

/// What receivers share.
struct Way {
    log: Arc<dyn EventLog>,
    receivers: Arc<dyn Receivers>,
    metrics: Arc<Metrics>,
    status: Arc<Status>,
    stored: watch::Receiver<u64>,
    clock: Clock,
}

/// What receivers are started with.
struct Stage {
    runtime: Handle,
    machines: Vec<MachineHandle>,
    stop: CancellationToken,
}

/// A receiver's settings.
#[derive(Debug, Clone, PartialEq)]
enum Receiver {
    Webhook(Box<Webhook>),
    Broker(Box<Broker>),
}

/// A receiver that can be started.
struct Built {
    receiver: Receiver,
    status: ReceiverStatus,
    work: Work,
}

enum Work {
    Post(Box<webhook::Sender>),
    Publish(Box<mqtt::Publisher>),
}

/// A receiver that runs.
struct Running {
    receiver: Receiver,
    status: ReceiverStatus,
    stop: CancellationToken,
    /// Ends with it.
    ended: oneshot::Receiver<()>,
}

/// A receiver that is new begins with what happens from now on; what is kept of those no longer configured is
/// forgotten.
pub(super) fn plan(
    config: &Config,
    keeper: &Keeper,
    metrics: &Arc<Metrics>,
) -> Result<(EventsHandle, Notifier), StartError> {
    let events = Arc::new(SqliteEvents::join(&config.store.directory)?);
    let log: Arc<dyn EventLog> = Arc::clone(&events) as Arc<dyn EventLog>;
    let audit = Arc::clone(&events) as Arc<dyn AuditLog>;
    let way = Way {
        log: Arc::clone(&log),
        receivers: events,
        metrics: Arc::clone(metrics),
        status: Arc::clone(&keeper.status),
        stored: keeper.stored.clone(),
        clock: keeper.clock,
    };
    way.forget_others(&config.notify)?;
    let built = receivers(&config.notify).map(|receiver| way.build(receiver));
    let built = built.collect::<Result<Vec<_>, _>>()?;
    let (told, receivers) =
        watch::channel(built.iter().map(|built| built.status.clone()).collect());
    let StreamMetrics { open, refused, stalled } = metrics.streams();
    let stored = keeper.stored.clone();
    let handle = EventsHandle { log, audit, stored, open, refused, stalled, receivers };
    Ok((handle, Notifier { way, built, running: BTreeMap::new(), told, stage: None }))
}

/// The receivers of a configuration.
fn receivers(settings: &Settings) -> impl Iterator<Item = Receiver> + '_ {
    let webhooks = settings.webhooks.iter();
    let brokers = settings.brokers.iter();
    webhooks
        .map(|webhook| Receiver::Webhook(Box::new(webhook.clone())))
        .chain(brokers.map(|broker| Receiver::Broker(Box::new(broker.clone()))))
}

/// What a follower begins with.
pub(super) struct Begun {
    log: Arc<dyn EventLog>,
    receivers: Arc<dyn Receivers>,
    progress: crate::notify::Progress,
    told: watch::Sender<ReceiverView>,
    metrics: ReceiverMetrics,
    status: Arc<Status>,
}

impl Receiver {
    fn name(&self) -> &str {
        match self {
            Self::Webhook(webhook) => &webhook.name,
            Self::Broker(broker) => &broker.name,
        }
    }

    /// Sees whether what it needs of this computer is there.
    fn check(&self) -> Result<(), StartError> {
        let checked = match self {
            Self::Webhook(webhook) => webhook::agent(webhook).map(drop),
            Self::Broker(one) => broker::transport(&one.connection).map(drop),
        };
        checked.map_err(|source| StartError::Notify { receiver: self.name().to_owned(), source })
    }
}

impl Way {
    fn forget_others(&self, settings: &Settings) -> Result<(), StoreError> {
        let names: Vec<&str> = settings.names().collect();
        for name in self.receivers.forget_others(&names)? {
            tracing::warn!(
                receiver = name,
                "is no longer configured: what waited for it is not sent"
            );
        }
        Ok(())
    }

    fn begin(&self, name: &str) -> Result<(Begun, watch::Receiver<ReceiverView>), StoreError> {
        let progress = self.receivers.begin(name)?;
        let (told, view) = watch::channel(ReceiverView::default());
        let metrics = self.metrics.receiver(name);
        let (log, receivers) = (Arc::clone(&self.log), Arc::clone(&self.receivers));
        let status = Arc::clone(&self.status);
        Ok((Begun { log, receivers, progress, told, metrics, status }, view))
    }

    fn build(&self, receiver: Receiver) -> Result<Built, StartError> {
        let name = receiver.name().to_owned();
        let (begun, view) = self.begin(&name)?;
        let (stored, clock) = (self.stored.clone(), self.clock);
        let refused = |source| StartError::Notify { receiver: name.clone(), source };
        let (kind, work) = match &receiver {
            Receiver::Webhook(webhook) => {
                let limits = (webhook.max_waiting, webhook.backoff);
                let follower = Follower::new(begun, &name, webhook.filter.clone(), limits);
                let sender =
                    webhook::Sender::new(webhook.as_ref().clone(), follower, stored, clock);
                ("webhook", Work::Post(Box::new(sender.map_err(refused)?)))
            }
            Receiver::Broker(broker) => {
                let limits = (broker.max_waiting, broker.backoff);
                let follower = Follower::new(begun, &name, broker.filter.clone(), limits);
                let publisher =
                    mqtt::Publisher::new(broker.as_ref().clone(), follower, stored, clock);
                ("mqtt", Work::Publish(Box::new(publisher.map_err(refused)?)))
            }
        };
        Ok(Built { receiver, status: ReceiverStatus { name, kind, view }, work })
    }
}

impl Stage {
    fn start(&self, built: Built) -> io::Result<Running> {
        let Built { receiver, status, work } = built;
        let stop = self.stop.child_token();
        let (over, ended) = oneshot::channel();
        let (runtime, stopped) = (self.runtime.clone(), stop.clone());
        match work {
            Work::Post(sender) => {
                let work = move || {
                    let _over = over;
                    sender.run(&runtime, &stopped);
                };
                let name = format!("notify-{}", receiver.name());
                let _detached = thread::Builder::new().name(name).spawn(work)?;
            }
            Work::Publish(publisher) => {
                let machines = self.machines.clone();
                let _detached = self.runtime.spawn(async move {
                    let _over = over;
                    publisher.run(&machines, &stopped).await;
                });
            }
        }
        Ok(Running { receiver, status, stop, ended })
    }
}

impl Notifier {
    /// Starts everything.
    pub(super) fn start(
        &mut self,
        runtime: &Handle,
        machines: &[MachineHandle],
        stop: &CancellationToken,
    ) -> io::Result<()> {
        let (machines, stop) = (machines.to_vec(), stop.clone());
        let stage = self.stage.insert(Stage { runtime: runtime.clone(), machines, stop });
        for built in self.built.drain(..) {
            let running = stage.start(built)?;
            self.running.insert(running.status.name.clone(), running);
        }
        Ok(())
    }

    /// Sees whether other receivers could be started.
    ///
    /// # Errors
    /// Which cannot, and why.
    pub(super) fn check(&self, settings: &Settings) -> Result<(), StartError> {
        let mut new = receivers(settings).filter(|receiver| !self.runs(receiver));
        new.try_for_each(|receiver| receiver.check())
    }

    fn runs(&self, receiver: &Receiver) -> bool {
        self.running.get(receiver.name()).is_some_and(|running| running.receiver == *receiver)
    }

    /// Exchanges the receivers that are others now. Each ends before it begins again where it was; those that stay
    /// notice nothing.
    pub(super) fn change(&mut self, settings: &Settings) {
        let wanted: Vec<Receiver> = receivers(settings).collect();
        let is_kept = |running: &Running| wanted.contains(&running.receiver);
        let (kept, gone): (BTreeMap<_, _>, _) =
            std::mem::take(&mut self.running).into_iter().partition(|(_, one)| is_kept(one));
        self.running = kept;
        gone.values().for_each(|running: &Running| running.stop.cancel());
        for (name, running) in gone {
            let _ended = running.ended.blocking_recv();
            self.way.metrics.receiver(&name).failing.set(0);
        }
        if let Err(error) = self.way.forget_others(settings) {
            tracing::error!(error = with_causes(&error), "receivers that are gone are kept");
        }
        let Some(stage) = &self.stage else { return };
        for receiver in wanted {
            let name = receiver.name().to_owned();
            if self.running.contains_key(&name) {
                continue;
            }
            let built = self.way.build(receiver).map_err(|error| with_causes(&error));
            let started = built.and_then(|built| {
                stage.start(built).map_err(|error| format!("its thread cannot be started: {error}"))
            });
            match started {
                Ok(running) => drop(self.running.insert(name, running)),
                Err(error) => tracing::error!(receiver = name, error, "cannot be told of alarms"),
            }
        }
        self.told.send_replace(self.running.values().map(|one| one.status.clone()).collect());
    }

    /// What ends when all have said goodbye.
    pub(super) fn endings(&mut self) -> Vec<oneshot::Receiver<()>> {
        std::mem::take(&mut self.running).into_values().map(|running| running.ended).collect()
    }
}

#[cfg(test)]
mod tests;
