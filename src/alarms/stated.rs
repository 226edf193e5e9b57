//! What the machine file states: its limits and its channels, each with a slot for an alarm.

use super::Alarm;
use super::AlarmSource;
use super::EventKind;
use super::limit::LimitJudge;
use super::limit::Measured;
use super::limit::StartupClock;
use super::policy::Level;
use super::policy::Observation;
use super::policy::Settings;
use super::slot::Finding;
use super::slot::Slot;
use super::slot::transition;
use crate::diagnosis::fault::ComponentKind;
use crate::machine::Machine;
use crate::machine::alarm_limit::Startup;
use crate::signal::ChannelIndex;
use crate::signal::ChannelInfo;

/// A limit with its delays.
#[derive(Debug, Clone)]
struct Limit {
    judge: LimitJudge,
    settings: Settings,
    slot: Slot,
}

/// A channel that should come.
#[derive(Debug, Clone)]
struct Channel {
    index: ChannelIndex,
    name: String,
    slot: Slot,
}

/// The limits and channels of a machine.
#[derive(Debug, Clone, Default)]
pub(super) struct Stated {
    limits: Vec<Limit>,
    /// What each limit gave in the window that is judged.
    observed: Vec<Observation>,
    startup: Option<Startup>,
    clock: StartupClock,
    channels: Vec<Channel>,
    /// Delays of missing data.
    missing: Settings,
}

impl Stated {
    pub(super) fn new(machine: &Machine, channels: &[ChannelInfo], settings: &Settings) -> Self {
        let limits = machine.alarm_limits.limits.iter().map(|limit| Limit {
            judge: LimitJudge::new(machine, limit, channels),
            settings: Settings {
                on_delay_s: limit.on_delay_s.unwrap_or(settings.on_delay_s),
                off_delay_s: limit.off_delay_s.unwrap_or(settings.off_delay_s),
                ..settings.clone()
            },
            slot: Slot::default(),
        });
        let limits: Vec<Limit> = limits.collect();
        let sensors = machine.sensors.iter().filter_map(|sensor| {
            let index = channels.iter().position(|channel| channel.name == sensor.channel)?;
            let (index, name) = (ChannelIndex(index), sensor.channel.clone());
            Some(Channel { index, name, slot: Slot::default() })
        });
        Self {
            observed: vec![Observation::NotJudged; limits.len()],
            limits,
            startup: machine.alarm_limits.startup,
            clock: StartupClock::default(),
            channels: sensors.collect(),
            missing: Settings {
                on_delay_s: settings.missing_after_s,
                off_delay_s: 0.0,
                ..settings.clone()
            },
        }
    }

    /// Puts an alarm of before a restart in its place; gives it back if there is none any more.
    pub(super) fn restore(&mut self, slot: Slot) -> Option<Slot> {
        let Some(alarm) = &slot.alarm else { return None };
        let place = match &alarm.source {
            AlarmSource::Limit(id) => {
                let is_it = |limit: &&mut Limit| {
                    limit.judge.limit().id == *id && limit.judge.limit().raises
                };
                self.limits.iter_mut().find(is_it).map(|limit| &mut limit.slot)
            }
            AlarmSource::Data => {
                let is_it = |channel: &&mut Channel| channel.name == alarm.component;
                self.channels.iter_mut().find(is_it).map(|channel| &mut channel.slot)
            }
            AlarmSource::Diagnosis | AlarmSource::Store => None,
        };
        match place {
            Some(place) => {
                *place = slot;
                None
            }
            None => Some(slot),
        }
    }

    pub(super) fn slots(&self) -> impl Iterator<Item = &Slot> {
        let limits = self.limits.iter().map(|limit| &limit.slot);
        limits.chain(self.channels.iter().map(|channel| &channel.slot))
    }

    pub(super) fn slots_mut(&mut self) -> impl Iterator<Item = &mut Slot> {
        let limits = self.limits.iter_mut().map(|limit| &mut limit.slot);
        limits.chain(self.channels.iter_mut().map(|channel| &mut channel.slot))
    }

    /// Judges the limits in a window that ends at `time_s` and adds `evidence_s`.
    pub(super) fn judge(
        &mut self,
        measured: &Measured<'_>,
        (time_s, evidence_s): (f64, f64),
        next_id: &mut u64,
        moved: &mut Vec<(EventKind, Alarm)>,
    ) {
        let is_startup = self.clock.observe(self.startup.as_ref(), measured, time_s);
        for (place, limit) in self.limits.iter_mut().enumerate() {
            let Limit { judge, settings, slot } = limit;
            let observation = judge.observe(measured, is_startup, &self.observed[..place]);
            self.observed[place] = observation;
            if !judge.limit().raises {
                continue;
            }
            let level = slot.tracker.observe(observation, evidence_s, settings);
            let finding = || of_limit(judge, measured);
            moved.extend(transition(&mut slot.alarm, level, time_s, next_id, &finding));
        }
    }

    /// Sees which channels did not come. A channel that came proves nothing but that.
    pub(super) fn watch(
        &mut self,
        absent: &[ChannelIndex],
        (time_s, evidence_s): (f64, f64),
        next_id: &mut u64,
        moved: &mut Vec<(EventKind, Alarm)>,
    ) {
        let missing_after_s = self.missing.on_delay_s;
        for Channel { index, name, slot } in &mut self.channels {
            let observation = if absent.contains(index) {
                Observation::Accused(Level::Warning)
            } else {
                Observation::Healthy
            };
            let level = slot.tracker.observe(observation, evidence_s, &self.missing);
            let finding = || Finding {
                component: name.clone(),
                kind: ComponentKind::Sensor,
                source: AlarmSource::Data,
                latching: false,
                fault: None,
                why: format!(
                    "no contiguous samples of `{name}` for {missing_after_s:.0} s while others come"
                ),
                severity: None,
                confidence: None,
            };
            moved.extend(transition(&mut slot.alarm, level, time_s, next_id, &finding));
        }
    }
}

fn of_limit(judge: &LimitJudge, measured: &Measured<'_>) -> Finding {
    let (kind, component) = judge.place();
    Finding {
        component: component.to_owned(),
        kind,
        source: AlarmSource::Limit(judge.limit().id.clone()),
        latching: judge.limit().latching,
        fault: None,
        why: judge.why(measured.speed),
        severity: None,
        confidence: None,
    }
}
