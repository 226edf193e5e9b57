//! The way of alarms out of the daemon: one thread a webhook, one task a broker of MQTT.
//!
//! Each follows the store's log of events, which is its queue, and keeps its place there. What is sent when is
//! decided by `notify`; here are the clock, the sockets and the waiting.

mod carrier;
mod webhook;
mod mqtt;
mod states;

use super::client::ClientError;
use super::keeper::Keeper;
use super::start_error::StartError;
use crate::api::view::EventsHandle;
use crate::api::view::MachineHandle;
use crate::api::view::ReceiverStatus;
use crate::api::view::ReceiverView;
use crate::config::Config;
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
use std::io;
use std::sync::Arc;
use tokio::runtime::Handle;
use tokio::sync::watch;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

/// Receivers before their threads start.
pub(super) struct NotifyPlan {
    webhooks: Vec<webhook::Sender>,
    brokers: Vec<mqtt::Publisher>,
}

impl std::fmt::Debug for NotifyPlan {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("NotifyPlan").finish_non_exhaustive()
    }
}

/// What receivers share.
struct Shared<'a> {
    log: &'a Arc<dyn EventLog>,
    receivers: &'a Arc<dyn Receivers>,
    metrics: &'a Metrics,
    status: &'a Arc<Status>,
}

/// A receiver that is new begins with what happens from now on; what is kept of those no longer configured is
/// forgotten.
pub(super) fn plan(
    config: &Config,
    keeper: &Keeper,
    metrics: &Metrics,
) -> Result<(EventsHandle, NotifyPlan), StartError> {
    let settings = &config.notify;
    let events = Arc::new(SqliteEvents::join(&config.store.directory)?);
    let log: &Arc<dyn EventLog> = &(Arc::clone(&events) as Arc<dyn EventLog>);
    let audit = Arc::clone(&events) as Arc<dyn AuditLog>;
    let receivers: &Arc<dyn Receivers> = &(events as Arc<dyn Receivers>);
    let (stored, clock) = (&keeper.stored, keeper.clock);
    let names: Vec<&str> = settings.names().collect();
    for name in receivers.forget_others(&names)? {
        tracing::warn!(receiver = name, "is no longer configured: what waited for it is not sent");
    }
    let shared = Shared { log, receivers, metrics, status: &keeper.status };
    let mut statuses = Vec::new();
    let (mut webhooks, mut brokers) = (Vec::new(), Vec::new());
    for webhook in &settings.webhooks {
        let begun = shared.begin(&webhook.name, "webhook", &mut statuses)?;
        let limits = (webhook.max_waiting, webhook.backoff);
        let follower = Follower::new(begun, &webhook.name, webhook.filter.clone(), limits);
        let sender = webhook::Sender::new(webhook.clone(), follower, stored.clone(), clock);
        webhooks.push(sender.map_err(|source| refused(&webhook.name, source))?);
    }
    for broker in &settings.brokers {
        let begun = shared.begin(&broker.name, "mqtt", &mut statuses)?;
        let limits = (broker.max_waiting, broker.backoff);
        let follower = Follower::new(begun, &broker.name, broker.filter.clone(), limits);
        let publisher = mqtt::Publisher::new(broker.clone(), follower, stored.clone(), clock);
        brokers.push(publisher.map_err(|source| refused(&broker.name, source))?);
    }
    let StreamMetrics { open, refused, stalled } = metrics.streams();
    let (log, stored, receivers) = (Arc::clone(log), stored.clone(), statuses.into());
    let handle = EventsHandle { log, audit, stored, open, refused, stalled, receivers };
    Ok((handle, NotifyPlan { webhooks, brokers }))
}

fn refused(receiver: &str, source: ClientError) -> StartError {
    StartError::Notify { receiver: receiver.to_owned(), source }
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

impl Shared<'_> {
    fn begin(
        &self,
        name: &str,
        kind: &'static str,
        statuses: &mut Vec<ReceiverStatus>,
    ) -> Result<Begun, StoreError> {
        let progress = self.receivers.begin(name)?;
        let (told, view) = watch::channel(ReceiverView::default());
        statuses.push(ReceiverStatus { name: name.to_owned(), kind, view });
        let metrics = self.metrics.receiver(name);
        let (log, receivers) = (Arc::clone(self.log), Arc::clone(self.receivers));
        let status = Arc::clone(self.status);
        Ok(Begun { log, receivers, progress, told, metrics, status })
    }
}

impl NotifyPlan {
    /// Threads that will be started.
    pub(super) fn n_threads(&self) -> usize {
        self.webhooks.len()
    }

    /// Starts everything, threads by `start`; gives the tasks.
    pub(super) fn start(
        self,
        runtime: &Handle,
        machines: &[MachineHandle],
        stop: &CancellationToken,
        mut start: impl FnMut(String, Box<dyn FnOnce() + Send>) -> io::Result<()>,
    ) -> io::Result<Vec<JoinHandle<()>>> {
        let mut tasks = Vec::new();
        for sender in self.webhooks {
            let (runtime, stop) = (runtime.clone(), stop.clone());
            let name = format!("notify-{}", sender.name());
            start(name, Box::new(move || sender.run(&runtime, &stop)))?;
        }
        for publisher in self.brokers {
            let (machines, stop) = (machines.to_vec(), stop.clone());
            tasks.push(runtime.spawn(async move { publisher.run(&machines, &stop).await }));
        }
        Ok(tasks)
    }
}

#[cfg(test)]
mod tests;
