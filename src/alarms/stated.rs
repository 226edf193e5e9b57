//! What the machine file states: its limits and its channels, each with a slot for an alarm.

use super::Alarm;
use super::AlarmSource;
use super::EventKind;
use super::limit::LimitJudge;
use super::limit::Measured;
use super::limit::StartupClock;
use super::policy::Level;
use super::policy::LevelTracker;
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
use std::collections::BTreeSet;

/// A limit with its delays.
#[derive(Debug, Clone)]
struct Limit {
    judge: LimitJudge,
    settings: Settings,
    slot: Slot,
}

/// What the levels of the next window rest on beside the window, in the order of the machine file.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct StatedDecisions {
    pub(super) startup_since_s: Option<f64>,
    /// Of each limit its delays and the levels of its sensors.
    pub(super) limits: Vec<(LevelTracker, Vec<Option<Level>>)>,
    pub(super) channels: Vec<LevelTracker>,
}

/// A channel that should come.
#[derive(Debug, Clone)]
struct Channel {
    /// Its place in the stream; `None`: it is not in it, which the diagnosis tells.
    index: Option<ChannelIndex>,
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
    /// What the diagnosis may judge; `None`: anything.
    components: Option<BTreeSet<(ComponentKind, String)>>,
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
        let sensors = machine.sensors.iter().map(|sensor| {
            let index = channels.iter().position(|channel| channel.name == sensor.channel);
            let (index, name) = (index.map(ChannelIndex), sensor.channel.clone());
            Channel { index, name, slot: Slot::default() }
        });
        Self {
            observed: vec![Observation::NotJudged; limits.len()],
            limits,
            startup: machine.alarm_limits.startup,
            clock: StartupClock::default(),
            channels: sensors.collect(),
            components: Some(components(machine)),
            missing: Settings {
                on_delay_s: settings.missing_after_s,
                off_delay_s: 0.0,
                ..settings.clone()
            },
        }
    }

    /// Whether the machine has a component.
    pub(super) fn has(&self, kind: ComponentKind, id: &str) -> bool {
        let components = self.components.as_ref();
        components.is_none_or(|known| known.contains(&(kind, id.to_owned())))
    }

    /// Whether the machine file has a limit that raises alarms.
    pub(super) fn has_limit(&self, id: &str) -> bool {
        self.limits.iter().any(|one| one.judge.limit().id == id && one.judge.limit().raises)
    }

    /// Whether a sensor of the machine file has this channel.
    pub(super) fn has_channel(&self, name: &str) -> bool {
        self.channels.iter().any(|channel| channel.name == name)
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

    /// What the next window's levels rest on beside the window.
    pub(super) fn decisions(&self) -> StatedDecisions {
        let of_limit = |limit: &Limit| (limit.slot.tracker, limit.judge.levels());
        StatedDecisions {
            startup_since_s: self.clock.since_s(),
            limits: self.limits.iter().map(of_limit).collect(),
            channels: self.channels.iter().map(|channel| channel.slot.tracker).collect(),
        }
    }

    /// Goes on with what [`Self::decisions`] gave; false: it is of another machine.
    pub(super) fn resume(&mut self, kept: &StatedDecisions) -> bool {
        let fits =
            kept.limits.len() == self.limits.len() && kept.channels.len() == self.channels.len();
        self.clock = StartupClock::running_since(kept.startup_since_s);
        for (channel, tracker) in self.channels.iter_mut().zip(&kept.channels) {
            channel.slot.tracker = *tracker;
        }
        let limits = self.limits.iter_mut().zip(&kept.limits);
        limits.fold(fits, |fits, (limit, (tracker, levels))| {
            limit.slot.tracker = *tracker;
            limit.judge.resume(levels) && fits
        })
    }

    /// Takes up what was kept before a restart, if it is of these limits and channels.
    pub(super) fn go_on(&mut self, kept: &StatedDecisions, is_same: bool) {
        if kept.channels.len() == self.channels.len() {
            for (channel, tracker) in self.channels.iter_mut().zip(&kept.channels) {
                channel.slot.go_on(*tracker);
            }
        }
        if kept.limits.len() == self.limits.len() {
            for (limit, (tracker, levels)) in self.limits.iter_mut().zip(&kept.limits) {
                limit.slot.go_on(*tracker);
                limit.judge.resume(levels);
            }
        }
        if is_same {
            self.clock = StartupClock::running_since(kept.startup_since_s);
        }
    }

    /// Takes up delays and levels of the same stream with other settings: those of channels, and those of limits that
    /// are what they were.
    pub(super) fn renew(&mut self, before: &Self) {
        for channel in &mut self.channels {
            let was = before.channels.iter().find(|was| was.name == channel.name);
            was.into_iter().for_each(|was| channel.slot.tracker = was.slot.tracker);
        }
        for limit in &mut self.limits {
            let is_it = |was: &&Limit| was.judge.is_same(&limit.judge);
            if let Some(was) = before.limits.iter().find(is_it) {
                limit.slot.tracker = was.slot.tracker;
                limit.judge.resume(&was.judge.levels());
            }
        }
        if self.startup == before.startup {
            self.clock = StartupClock::running_since(before.clock.since_s());
        }
    }

    /// The limits and channels that are above their level, in words, with it.
    pub(super) fn raised(&self) -> Vec<(String, Level)> {
        let limits = self.limits.iter().filter(|limit| limit.judge.limit().raises);
        let limits = limits.map(|limit| (format!("limit {}", limit.judge.limit().id), &limit.slot));
        let channels = self.channels.iter().map(|c| (format!("channel {}", c.name), &c.slot));
        let level = |(name, slot): (String, &Slot)| Some((name, slot.tracker.level()?));
        limits.chain(channels).filter_map(level).collect()
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
            let Some(index) = index else { continue };
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

/// Every component of a machine, as verdicts name them.
fn components(machine: &Machine) -> BTreeSet<(ComponentKind, String)> {
    let bearings = machine.bearings.iter().map(|part| (ComponentKind::Bearing, &part.id));
    let shafts = machine.shafts.iter().map(|part| (ComponentKind::Shaft, &part.id));
    let gears = machine.gears.iter().map(|part| (ComponentKind::Gear, &part.id));
    let sensors = machine.sensors.iter().map(|part| (ComponentKind::Sensor, &part.channel));
    let whole = std::iter::once((ComponentKind::Machine, &machine.id));
    let all = bearings.chain(shafts).chain(gears).chain(sensors).chain(whole);
    all.map(|(kind, id)| (kind, id.clone())).collect()
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
