//! The counters of a machine on its shard: what has been counted since they were told last.

use crate::alarms::Alarm;
use crate::alarms::Level;
use crate::buffer::RingStatus;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::Diagnosis;
use crate::signal::ChannelInfo;
use crate::telemetry::ChannelMetrics;
use crate::telemetry::ComponentMetrics;
use crate::telemetry::MachineMetrics;
use crate::telemetry::Metrics;
use std::collections::BTreeSet;

/// The machine's counters, and the counts they have been given.
#[derive(Debug)]
pub(super) struct Meters {
    pub(super) machine: MachineMetrics,
    channels: Vec<(ChannelMetrics, RingStatus)>,
    blocks_dropped: u64,
    id: String,
    components: ComponentMetrics,
    /// Kind and id of the components that are shown.
    shown: BTreeSet<(&'static str, String)>,
}

impl Meters {
    pub(super) fn new(metrics: &Metrics, machine: &str, channels: &[ChannelInfo]) -> Self {
        let counted = |channel: &ChannelInfo| {
            (metrics.channel(machine, &channel.name), RingStatus::default())
        };
        Self {
            machine: metrics.machine(machine),
            channels: channels.iter().map(counted).collect(),
            blocks_dropped: 0,
            id: machine.to_owned(),
            components: metrics.components(),
            shown: BTreeSet::new(),
        }
    }

    /// Counts for the channels of another stream.
    pub(super) fn take_channels(
        &mut self,
        metrics: &Metrics,
        machine: &str,
        channels: &[ChannelInfo],
    ) {
        self.channels = Self::new(metrics, machine, channels).channels;
    }

    /// Adds what was counted since the last time.
    pub(super) fn update(&mut self, rings: &[RingStatus], blocks_dropped: u64) {
        for ((counters, before), now) in self.channels.iter_mut().zip(rings) {
            counters.received.inc_by(now.received - before.received);
            counters.missing.inc_by(now.missing - before.missing);
            counters.duplicated.inc_by(now.duplicated - before.duplicated);
            *before = *now;
        }
        self.machine.blocks_dropped.inc_by(blocks_dropped - self.blocks_dropped);
        self.blocks_dropped = blocks_dropped;
    }

    /// Shows what is known of components, and forgets those that there are no more. `is_silent`: no data come, and nobody
    /// knows whether what was found healthy still is.
    pub(super) fn show(
        &mut self,
        diagnosis: Option<&Diagnosis>,
        alarms: &[Alarm],
        is_silent: bool,
    ) {
        let components = diagnosis.map_or(&[][..], |diagnosis| &diagnosis.components);
        let mut shown = BTreeSet::new();
        for one in components {
            let is_of = |alarm: &&Alarm| {
                alarm.kind == one.kind && alarm.component == one.id && alarm.silencing.is_none()
            };
            let asking = alarms.iter().filter(|alarm| alarm.state.is_active()).filter(is_of);
            let level = asking.map(|alarm| alarm.level).max();
            let alarm = level.map_or(0, |level| match level {
                Level::Warning => 1,
                Level::Damaged => 2,
            });
            let is_known = one.state != State::Healthy || !is_silent;
            let state = match one.state {
                State::Undetermined => 0,
                State::Healthy => i64::from(is_known),
                State::Warning => 2,
                State::Damaged => 3,
            };
            let of = (self.id.as_str(), one.kind.name(), one.id.as_str());
            self.components.show(of, state, one.severity.filter(|_| is_known), alarm);
            shown.insert((one.kind.name(), one.id.clone()));
        }
        for (kind, id) in self.shown.difference(&shown) {
            self.components.forget((&self.id, kind, id));
        }
        self.shown = shown;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::api::support::sample_diagnosis;

    #[test]
    fn nothing_is_metered_as_healthy_while_no_data_come() {
        let metrics = Metrics::new();
        let mut meters = Meters::new(&metrics, "rig-1", &[]);
        let mut diagnosis = sample_diagnosis();
        diagnosis.components.truncate(2);
        for (one, state) in diagnosis.components.iter_mut().zip([State::Healthy, State::Warning]) {
            (one.state, one.severity) = (state, Some(0.25));
        }
        let ids: Vec<String> = diagnosis.components.iter().map(|one| one.id.clone()).collect();
        let mut shown = |is_silent| {
            meters.show(Some(&diagnosis), &[], is_silent);
            let text = metrics.encode();
            let value = |metric: &str, id: &str| {
                let of_it = format!("component=\"{id}\"}} ");
                let mut lines = text.lines().filter(|line| line.starts_with(metric));
                lines.find_map(|line| Some(line.split_once(&of_it)?.1.to_owned())).unwrap()
            };
            [0, 1].map(|i| {
                let id = &ids[i];
                (value("rotorwatch_component_state", id), value("rotorwatch_component_severity", id))
            })
        };
        let own = |state: &str, severity: &str| (state.to_owned(), severity.to_owned());
        assert_eq!(shown(false), [own("1", "0.25"), own("2", "0.25")]);
        assert_eq!(shown(true), [own("0", "NaN"), own("2", "0.25")]);
    }
}
