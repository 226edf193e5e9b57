//! The counters of a machine on its shard: what has been counted since they were told last.

use crate::alarms::Alarm;
use crate::alarms::Level;
use crate::api::view::accusations;
use crate::api::view::accused_state;
use crate::buffer::RingStatus;
use crate::diagnosis::fault::ComponentKind;
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
        let mut shown = BTreeSet::new();
        for (kind, id, state, severity) in known(diagnosis, alarms) {
            let is_of = |alarm: &&Alarm| {
                alarm.kind == kind && alarm.component == id && alarm.silencing.is_none()
            };
            let asking = alarms.iter().filter(|alarm| alarm.state.is_active()).filter(is_of);
            let level = asking.map(|alarm| alarm.level).max();
            let alarm = level.map_or(0, |level| match level {
                Level::Warning => 1,
                Level::Damaged => 2,
            });
            let is_known = state != State::Healthy || !is_silent;
            let state = match state {
                State::Undetermined => 0,
                State::Healthy => i64::from(is_known),
                State::Warning => 2,
                State::Damaged => 3,
            };
            let of = (self.id.as_str(), kind.name(), id);
            self.components.show(of, state, severity.filter(|_| is_known), alarm);
            shown.insert((kind.name(), id.to_owned()));
        }
        for (kind, id) in self.shown.difference(&shown) {
            self.components.forget((&self.id, kind, id));
        }
        self.shown = shown;
    }
}

/// A component by kind and id, its state and its severity.
type Known<'a> = (ComponentKind, &'a str, State, Option<f64>);

/// What is known of components: by the newest verdict, or, before there is one, by the alarms of those of before the start.
fn known<'a>(diagnosis: Option<&'a Diagnosis>, alarms: &'a [Alarm]) -> Vec<Known<'a>> {
    let Some(diagnosis) = diagnosis else {
        let of = |a: &'a Alarm| (a.kind, &*a.component, accused_state(a.level), a.severity);
        return accusations(alarms).into_iter().map(of).collect();
    };
    let components = diagnosis.components.iter();
    components.map(|one| (one.kind, &*one.id, one.state, one.severity)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::alarms::AlarmEngine;
    use crate::alarms::Settings;
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
                (
                    value("rotorwatch_component_state", id),
                    value("rotorwatch_component_severity", id),
                )
            })
        };
        let own = |state: &str, severity: &str| (state.to_owned(), severity.to_owned());
        assert_eq!(shown(false), [own("1", "0.25"), own("2", "0.25")]);
        assert_eq!(shown(true), [own("0", "NaN"), own("2", "0.25")]);
    }

    #[test]
    fn before_the_first_verdict_what_alarms_accuse_is_metered() {
        let metrics = Metrics::new();
        let mut meters = Meters::new(&metrics, "rig-1", &[]);
        let mut engine = AlarmEngine::new("rig-1", Settings::default());
        engine.observe(&sample_diagnosis(), 10.0);
        let alarms = engine.standing();
        meters.show(None, &alarms, true);
        let text = metrics.encode();
        let of_it = format!("component=\"{}\"", alarms[0].component);
        let line = text.lines().find(|line| line.starts_with("rotorwatch_component_state{"));
        assert!(line.is_some_and(|line| line.contains(&of_it) && line.ends_with(" 3")), "{text}");
    }
}
