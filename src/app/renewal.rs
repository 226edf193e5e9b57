//! A machine on its shard goes on with other settings, between two blocks.

use super::build::configuration_hash;
use super::learning::Seen;
use super::monitored::Monitored;
use crate::alarms::AlarmEngine;
use crate::alarms::AlarmEvent;
use crate::config::Config;
use crate::config::MachineConfig;
use crate::diagnosis::baseline::Baseline;
use crate::pipeline::Renewal;
use crate::pipeline::Settings;
use std::sync::Arc;
use std::sync::mpsc::SyncSender;

/// Other settings for a machine.
#[derive(Debug)]
pub struct Renewed {
    /// What holds now.
    pub config: Arc<Config>,
    /// Its hash, which is recorded in what follows.
    pub configuration: Arc<str>,
    /// The machine, as it is described now.
    pub entry: MachineConfig,
    /// How far that reaches; `None`: this machine is judged as before.
    pub renewal: Option<Renewal>,
    /// When rebuilt: the healthy captures that the configuration names, measured as it is described now.
    pub baseline: Baseline,
    /// Told when it is done.
    pub done: SyncSender<()>,
}

/// The settings of a machine that hold now, for those that are not on its shard.
#[derive(Debug, Clone)]
pub(super) struct InForce {
    /// What holds.
    pub(super) config: Arc<Config>,
    /// The machine, as it is described.
    pub(super) entry: MachineConfig,
    /// The configuration's hash.
    pub(super) configuration: Arc<str>,
}

impl InForce {
    /// Those of a start.
    pub(super) fn of(config: &Config, entry: &MachineConfig) -> Self {
        let configuration = configuration_hash(config).into();
        Self { config: Arc::new(config.clone()), entry: entry.clone(), configuration }
    }
}

impl Monitored {
    /// Takes the settings over and publishes; rings and sources are not touched.
    pub(super) fn renew(&mut self, renewed: &Renewed, queue_bytes: usize) {
        let Renewed { config, configuration, entry, renewal, baseline, done } = renewed;
        self.alarming.renew(configuration);
        self.configuration = Arc::clone(configuration);
        if let Some(opener) = &mut self.opener {
            opener.renew(config, entry, configuration, (*renewal, baseline));
        }
        if let Some(capturing) = &mut self.capturing {
            capturing.renew(&entry.text.0, &config.monitor, configuration);
        }
        if let Some(renewal) = *renewal {
            let settings = Settings { baseline: baseline.clone(), ..config.monitor.clone() };
            let events = self.renew_monitor(entry, &settings, renewal);
            self.machine = Arc::clone(&entry.machine);
            if renewal == Renewal::Rebuilt {
                // Nobody shall learn what is normal from windows that were measured otherwise.
                self.seen = Seen::default();
            }
            self.keep(events, Vec::new());
            if renewal == Renewal::Rebuilt {
                self.show_as_described();
            }
        }
        self.publish(queue_bytes);
        // Who asked may have gone.
        let _nobody_waits = done.try_send(());
    }

    fn renew_monitor(
        &mut self,
        entry: &MachineConfig,
        settings: &Settings,
        renewal: Renewal,
    ) -> Vec<AlarmEvent> {
        let now = self.alarming.moment(self.stream_time_s());
        if let Some(monitor) = &mut self.monitor {
            return monitor.renew(&entry.machine, settings, renewal, now);
        }
        let idle: &AlarmEngine = &self.idle_alarms;
        let (alarms, events) = idle.renewed(&entry.machine, &[], settings.alarms.clone(), now);
        self.idle_alarms = alarms;
        events
    }
}
