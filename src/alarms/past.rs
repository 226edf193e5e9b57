//! The past through the same engine: what other limits and delays would have raised.
//!
//! A [`PastWindow`] is what the engine was told of one window, without the samples. [`Rerun`] tells it
//! again, in the order of time, to an engine with a machine's limits as they are now. It is the
//! daemon's engine; a restart of the daemon is a restart here too. Must not know where windows are kept.

use super::Act;
use super::Action;
use super::Alarm;
use super::AlarmEngine;
use super::AlarmEvent;
use super::EventKind;
use super::Kept;
use super::Moment;
use super::Settings;
use super::limit::Measured;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::baseline::is_ratio;
use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::BaselineUse;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::diagnosis::verdict::Coverage;
use crate::diagnosis::verdict::DataQuality;
use crate::diagnosis::verdict::Diagnosis;
use crate::diagnosis::verdict::OperatingState;
use crate::features::ChannelFeatures;
use crate::features::Feature;
use crate::machine::Machine;
use crate::signal::ChannelIndex;
use crate::signal::ChannelInfo;
use crate::signal::Timestamp;
use crate::units::Hz;
use crate::units::Unit;
use std::sync::Arc;

/// A stream of a machine, as it was.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct PastStream {
    /// Machine id.
    pub machine: String,
    /// What tells it from the machine's other streams.
    pub name: String,
    /// UTC of stream time 0; `None`: unknown, times count from 1970-01-01.
    pub start: Option<Timestamp>,
    /// When it was first seen, UTC; the newer of two streams replaces the older.
    pub begun: Timestamp,
    /// Its channels, in their order.
    pub channels: Vec<String>,
}

impl PastStream {
    /// UTC of a stream time, counted from 1970-01-01 without a start.
    #[must_use]
    pub fn utc(&self, time_s: f64) -> Timestamp {
        self.start.unwrap_or_default().plus_seconds(time_s)
    }
}

/// A verdict on a component.
#[derive(Debug, Clone, PartialEq)]
pub struct PastVerdict {
    /// Component's kind.
    pub kind: ComponentKind,
    /// Component's id.
    pub id: String,
    /// Its state.
    pub state: State,
    /// Its strongest fault.
    pub fault: Option<FaultMode>,
    /// 0…1.
    pub severity: Option<f64>,
    /// 0…1.
    pub confidence: Option<f64>,
    /// The sentence of an accusation; empty for the rest.
    pub why: String,
}

/// What alarms depend on in a window besides features.
#[derive(Debug, Clone, PartialEq)]
pub struct PastWindow {
    /// Its end, s of stream time.
    pub time_s: f64,
    /// Its length, s.
    pub duration_s: f64,
    /// Start of the daemon that judged it, UTC.
    pub run: Timestamp,
    /// Whether the machine ran.
    pub operating: OperatingState,
    /// Speed of the first shaft.
    pub speed: Option<Hz>,
    /// Records of baselines that were used: id of the signed baseline, name of the record.
    pub baselines: Vec<(Option<String>, String)>,
    /// Channels of which the window held too little, by their places.
    pub absent: Vec<usize>,
    /// The verdicts.
    pub verdicts: Vec<PastVerdict>,
}

impl PastWindow {
    /// Takes what counts out of a verdict on the window that ends at `time_s`.
    #[must_use]
    pub fn of(diagnosis: &Diagnosis, time_s: f64, absent: &[ChannelIndex], run: Timestamp) -> Self {
        let used = |used: &BaselineUse| {
            used.used.then(|| (used.id.as_deref().map(str::to_owned), used.name.clone()))
        };
        let verdict = |component: &ComponentDiagnosis| PastVerdict {
            kind: component.kind,
            id: component.id.clone(),
            state: component.state,
            fault: component.fault,
            severity: component.severity,
            confidence: component.confidence,
            why: if component.state.is_accusation() {
                component.why.clone()
            } else {
                String::new()
            },
        };
        Self {
            time_s,
            duration_s: diagnosis.duration_s,
            run,
            operating: diagnosis.operating_state,
            speed: diagnosis.shaft_speed,
            baselines: diagnosis.baselines.iter().filter_map(used).collect(),
            absent: absent.iter().map(|channel| channel.0).collect(),
            verdicts: diagnosis.components.iter().map(verdict).collect(),
        }
    }

    /// The verdict again, with what the engine reads.
    fn diagnosis(&self, machine: &str) -> Diagnosis {
        let component = |past: &PastVerdict| ComponentDiagnosis {
            state: past.state,
            fault: past.fault,
            severity: past.severity,
            confidence: past.confidence,
            ..ComponentDiagnosis::undetermined(&past.id, past.kind, past.why.clone())
        };
        Diagnosis {
            machine: machine.to_owned(),
            duration_s: self.duration_s,
            samples_used: 0,
            samples_rejected: 0,
            rejected_because: Vec::new(),
            shaft_speed: self.speed,
            shaft_speeds: Vec::new(),
            speed_source: None,
            speed_confidence: 0.0,
            operating_state: self.operating,
            state: State::Undetermined,
            coverage: Coverage::default(),
            data_quality: DataQuality::Ok,
            components: self.verdicts.iter().map(component).collect(),
            warnings: Vec::new(),
            notes: Vec::new(),
            baselines: Vec::new(),
            provisional_baseline: None,
            timeline: None,
            first_warning_s: None,
            first_damaged_s: None,
            sample_ranges: Vec::new(),
        }
    }
}

/// The features of a past window in one channel: name, unit, value.
pub type PastFeatures<'a> = (usize, Vec<(&'a Arc<str>, Unit, f32)>);

/// Features as the engine takes them. Ratios that are only shown beside the features take no part, as in
/// the daemon.
#[must_use]
pub fn features(channels: &[PastFeatures<'_>]) -> Vec<ChannelFeatures> {
    let of = |(channel, values): &PastFeatures<'_>| {
        let known = values.iter().filter(|(name, _, value)| !value.is_nan() && !is_ratio(name));
        let feature = |(name, unit, value): &(&Arc<str>, Unit, f32)| Feature {
            name: Arc::clone(name),
            value: f64::from(*value),
            unit: *unit,
        };
        let values = known.map(feature).collect();
        ChannelFeatures { channel: ChannelIndex(*channel), sample_range: (0, 0), values }
    };
    let mut found: Vec<ChannelFeatures> = channels.iter().map(of).collect();
    found.sort_by_key(|channel| channel.channel);
    found
}

/// An event of the rerun, with the stream whose time it counts.
#[derive(Debug, Clone, PartialEq)]
pub struct PastEvent {
    /// When, UTC; counted from 1970-01-01 in a stream without a start.
    pub at: Timestamp,
    /// The event.
    pub event: AlarmEvent,
}

/// An act of an operator on an alarm, found again by what raised it.
#[derive(Debug, Clone, PartialEq)]
pub struct PastAct {
    /// When, UTC.
    pub at: Timestamp,
    /// What was done.
    pub action: Action,
    /// The alarm it was done to.
    pub alarm: Alarm,
}

impl PastAct {
    /// The act behind an event, if it moves an alarm's life: an acknowledgement or a reset. What silences
    /// an alarm raises and clears none.
    #[must_use]
    pub fn of(event: &AlarmEvent, at: Timestamp) -> Option<Self> {
        let action = match event.kind {
            EventKind::Acknowledged => Action::Acknowledge,
            EventKind::Reset => Action::Reset,
            EventKind::Raised
            | EventKind::Escalated
            | EventKind::DeEscalated
            | EventKind::Returned
            | EventKind::Latched
            | EventKind::Cleared
            | EventKind::Shelved
            | EventKind::Unshelved
            | EventKind::Suppressed
            | EventKind::Unsuppressed
            | EventKind::RemovedFromService
            | EventKind::ReturnedToService
            | EventKind::ConfigurationRemoved => return None,
        };
        Some(Self { at, action, alarm: event.alarm.clone() })
    }
}

/// Where the rerun stands.
#[derive(Debug)]
struct Place {
    stream: PastStream,
    run: Timestamp,
    /// Stream time of the newest window, s.
    newest_s: f64,
}

/// Tells the past to an engine.
#[derive(Debug)]
pub struct Rerun {
    machine: Arc<Machine>,
    settings: Settings,
    engine: AlarmEngine,
    place: Option<Place>,
    n_restarts: usize,
}

impl Rerun {
    /// Begins with no alarm, with the limits of `machine`.
    #[must_use]
    pub fn new(machine: Arc<Machine>, settings: Settings) -> Self {
        let engine = AlarmEngine::new(&machine.id, settings.clone());
        Self { machine, settings, engine, place: None, n_restarts: 0 }
    }

    /// Takes in the next window with what was measured in it and the baseline it was held against.
    pub fn observe(
        &mut self,
        stream: &PastStream,
        window: &PastWindow,
        measured: &[ChannelFeatures],
        baseline: &Baseline,
    ) -> Vec<PastEvent> {
        let mut events = self.go_to(stream, window);
        let diagnosis = window.diagnosis(&self.machine.id);
        let absent: Vec<_> = window.absent.iter().copied().map(ChannelIndex).collect();
        let measured = Measured {
            operating: window.operating,
            speed: window.speed,
            channels: measured,
            baseline,
        };
        let time_s = window.time_s;
        events.extend(self.engine.observe_window(&diagnosis, time_s, Some(&measured), &absent));
        events.into_iter().map(|event| PastEvent { at: stream.utc(event.time_s), event }).collect()
    }

    /// Does what an operator did, if the alarm stands here too and the act fits its state.
    pub fn act(&mut self, act: &PastAct) -> Vec<PastEvent> {
        let Some(place) = &self.place else { return Vec::new() };
        let is_it = |alarm: &Alarm| {
            alarm.source == act.alarm.source
                && alarm.kind == act.alarm.kind
                && alarm.component == act.alarm.component
        };
        let Some(alarm) = self.engine.standing().into_iter().find(is_it) else {
            return Vec::new();
        };
        let seconds = act.at.0.saturating_sub(place.stream.start.unwrap_or_default().0) as f64;
        let now = Moment { stream_s: seconds * 1e-9, monotonic_s: 0.0, utc: act.at };
        let (author, comment) = ("history".to_owned(), String::new());
        let act = Act { alarm: alarm.id, action: act.action, author, comment };
        let done = self.engine.act(&act, now).map(|(_, events)| events).unwrap_or_default();
        done.into_iter().map(|event| PastEvent { at: now.utc, event }).collect()
    }

    /// All alarms that stand, newest first.
    #[must_use]
    pub fn standing(&self) -> Vec<Alarm> {
        self.engine.standing()
    }

    /// Starts of the daemon in the history, the first one left out.
    #[must_use]
    pub fn n_restarts(&self) -> usize {
        self.n_restarts
    }

    /// Restarts the engine where another stream began. A daemon that was restarted within a stream, which
    /// only a replayed capture survives, judged it again from its last event on: that is told, not redone.
    fn go_to(&mut self, stream: &PastStream, window: &PastWindow) -> Vec<AlarmEvent> {
        let mut events = Vec::new();
        match &mut self.place {
            Some(place)
                if place.stream.name == stream.name && place.stream.channels == stream.channels =>
            {
                self.n_restarts += usize::from(place.run != window.run);
                (place.run, place.newest_s) = (window.run, window.time_s);
                return events;
            }
            Some(place) => {
                // One that has other channels from here on is no restart.
                self.n_restarts += usize::from(place.stream.name != stream.name);
                let old = place.stream.start.zip(stream.start);
                let shift_s =
                    old.map_or(0.0, |(old, new)| old.0.saturating_sub(new.0) as f64 * 1e-9);
                let newest_s = place.newest_s + shift_s;
                events = self.restart(stream, shift_s, newest_s);
            }
            None => self.engine = self.engine_for(stream),
        }
        let (stream, run, newest_s) = (stream.clone(), window.run, window.time_s);
        self.place = Some(Place { stream, run, newest_s });
        events
    }

    /// An engine for the channels of a stream.
    fn engine_for(&self, stream: &PastStream) -> AlarmEngine {
        let info = |name: &String| ChannelInfo {
            name: name.clone(),
            sample_rate: Hz(1.0),
            unit: Unit::Unknown,
            offset: 0.0,
            unit_conflict: None,
            full_scale: None,
        };
        let channels: Vec<ChannelInfo> = stream.channels.iter().map(info).collect();
        AlarmEngine::of_machine(&self.machine, &channels, self.settings.clone())
    }

    /// What the daemon does when it starts on another stream: a new engine goes on with the alarms that
    /// stand, their times counted from the start of that stream.
    fn restart(&mut self, stream: &PastStream, shift_s: f64, now_s: f64) -> Vec<AlarmEvent> {
        let engine = self.engine_for(stream);
        let before = std::mem::replace(&mut self.engine, engine);
        let goes_on = self.place.as_ref().is_some_and(|place| place.stream.name == stream.name);
        let kept = Kept {
            alarms: before.standing().into_iter().map(|alarm| moved(alarm, shift_s)).collect(),
            history: Vec::new(),
            last_id: before.last_id(),
            last_sequence: before.last_sequence(),
            judged_until_s: before.judged_until_s().filter(|_| goes_on),
            decisions: Some(before.decisions()),
            ..Kept::default()
        };
        let now = Moment { stream_s: now_s, monotonic_s: 0.0, utc: stream.utc(now_s) };
        self.engine.restore(kept, now)
    }
}

/// An alarm whose times count from another start.
fn moved(alarm: Alarm, shift_s: f64) -> Alarm {
    Alarm {
        raised_at_s: alarm.raised_at_s + shift_s,
        active_since_s: alarm.active_since_s + shift_s,
        changed_at_s: alarm.changed_at_s + shift_s,
        ..alarm
    }
}
