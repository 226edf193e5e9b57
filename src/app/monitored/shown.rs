//! What is shown of a machine: the snapshot published to HTTP after each change.
//!
//! Must not know what changed it.

use super::Monitored;
use crate::alarms::load::Load;
use crate::api::view::End;
use crate::api::view::MAX_WAVEFORM_SAMPLES;
use crate::api::view::MachineView;
use crate::api::view::SourceState;
use crate::api::view::Waveform;
use crate::buffer::RingStatus;
use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::fault::State;
use crate::diagnosis::summary::whole_state;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::diagnosis::verdict::Coverage;
use crate::diagnosis::verdict::Diagnosis;
use crate::machine::Machine;
use crate::pipeline::Monitor;
use crate::signal::ChannelIndex;
use crate::signal::SampleIndex;
use std::sync::Arc;

/// Why a component that was not there at the newest verdict is undetermined.
const NEW: &str = "new in the machine file since the newest verdict: judged in the next window";

impl Monitored {
    /// Shows the components that the machine has by its new description: without those that are gone, and with those that are
    /// new, which nobody has judged yet.
    pub(in crate::app) fn show_as_described(&mut self) {
        let Some(old) = &self.diagnosis else { return };
        let described = Arc::new(as_described(old, &self.machine));
        let stream_s = self.stream_time_s();
        self.state_since_s = since(Some(old), &self.state_since_s, &described, stream_s);
        self.diagnosis = Some(Arc::clone(&described));
        let is_silent = self.alarms().no_data().is_some();
        let changes = self.health.renew(&described, is_silent, stream_s);
        self.keep(Vec::new(), changes);
    }

    /// The newest contiguous samples of a channel before `end`, at most `max_samples`.
    pub(super) fn waveform(
        &self,
        channel: usize,
        end: End,
        max_samples: usize,
    ) -> Option<Waveform> {
        let monitor = self.monitor.as_ref().filter(|_| channel < self.channels.len())?;
        let ring = monitor.ring(ChannelIndex(channel));
        let end = match end {
            End::Newest => ring.newest_before(SampleIndex(u64::MAX)),
            End::Before(index) => ring.newest_before(SampleIndex(index)),
            End::At(time_s) => ring.end_at(time_s),
        }?;
        let (start, len) = ring.contiguous_before(end, max_samples.min(MAX_WAVEFORM_SAMPLES));
        let mut samples = vec![0.0; len];
        let start_time_s = ring.time_of(start)?;
        ring.copy(start, &mut samples).then_some(Waveform { start: start.0, start_time_s, samples })
    }

    /// Publishes a snapshot.
    pub fn publish(&mut self, queue_bytes: usize) {
        let rings = self.monitor.as_ref().map(Monitor::ring_status).unwrap_or_default();
        let dropped = self.traffic.lost();
        self.meters.update(&rings, dropped.0);
        let alarms = self.alarms().standing();
        let is_silent = self.alarms().no_data().is_some();
        self.meters.show(self.diagnosis.as_deref(), &alarms, is_silent);
        self.meters.machine.sample_age_s.set(self.alarming.silent_s());
        let stream_time_s = self.stream_time_of(&rings);
        let alarm_load = self.alarming.load(self.alarms(), &alarms, stream_time_s);
        self.publisher.send_replace(Arc::new(MachineView {
            machine: Arc::clone(&self.machine),
            judged_by: Arc::clone(&self.judged_by),
            source: self.source.clone(),
            stream_time_s,
            start_time: self.start_time,
            channels: Arc::clone(&self.channels),
            rings,
            diagnosis: self.diagnosis.clone(),
            state_since_s: self.state_since_s.clone(),
            features: Arc::clone(&self.features),
            window_end_s: self.window_end_s,
            alarms: Arc::new(alarms),
            advance: self.alarms().advance().into(),
            alarm_load,
            queue_bytes,
            queue_wait_s: self.queue_wait_s,
            dropped,
        }));
    }
}

/// Stream time one past the newest sample of any channel, s.
pub(super) fn newest_time_s(rings: &[RingStatus]) -> f64 {
    rings.iter().map(|ring| ring.newest_time_s).fold(0.0, f64::max)
}

/// Since when each component of `new`, and then the whole, has its state, s of stream time.
pub(super) fn since(
    old: Option<&Diagnosis>,
    old_since_s: &[f64],
    new: &Diagnosis,
    now_s: f64,
) -> Vec<f64> {
    let component_since = new.components.iter().map(|component| {
        let components = old.map_or(&[][..], |old| &old.components);
        let at = components.iter().position(|o| {
            o.kind == component.kind && o.id == component.id && o.state == component.state
        });
        at.and_then(|at| old_since_s.get(at).copied()).unwrap_or(now_s)
    });
    let whole = old.filter(|old| old.state == new.state).and_then(|_| old_since_s.last().copied());
    component_since.chain([whole.unwrap_or(now_s)]).collect()
}

/// A verdict as it stands for the machine as it is described now.
fn as_described(old: &Diagnosis, machine: &Machine) -> Diagnosis {
    let shafts = machine.shafts.iter().map(|shaft| (ComponentKind::Shaft, &shaft.id));
    let bearings = machine.bearings.iter().map(|bearing| (ComponentKind::Bearing, &bearing.id));
    let gears = machine.gears.iter().map(|gear| (ComponentKind::Gear, &gear.id));
    let parts: Vec<(ComponentKind, &String)> = bearings.chain(gears).chain(shafts).collect();
    let is_there = |one: &&ComponentDiagnosis| match one.kind {
        ComponentKind::Bearing | ComponentKind::Shaft | ComponentKind::Gear => {
            parts.contains(&(one.kind, &one.id))
        }
        // Other channels wait for a restart.
        ComponentKind::Sensor | ComponentKind::Machine => true,
    };
    let is_new = |(kind, id): &&(ComponentKind, &String)| {
        !old.components.iter().any(|one| one.kind == *kind && one.id == **id)
    };
    let new = parts.iter().filter(is_new);
    let new = new.map(|(kind, id)| ComponentDiagnosis::undetermined(id, *kind, NEW.to_owned()));
    let mut components: Vec<_> = old.components.iter().filter(is_there).cloned().collect();
    components.extend(new);
    let judged = components.iter().filter(|one| one.kind != ComponentKind::Sensor);
    let (open, judged): (Vec<_>, Vec<_>) = judged.partition(|one| one.state == State::Undetermined);
    let undetermined = open.into_iter().map(|one| one.id.clone()).collect();
    let coverage = Coverage { judged: judged.len(), undetermined };
    Diagnosis { state: whole_state(&components), coverage, components, ..old.clone() }
}

/// What is shown before anything is known.
pub(super) fn empty(machine: &Arc<Machine>, configuration: &Arc<str>) -> MachineView {
    MachineView {
        machine: Arc::clone(machine),
        judged_by: Arc::clone(configuration),
        source: SourceState::Starting,
        stream_time_s: 0.0,
        start_time: None,
        channels: Arc::default(),
        rings: Vec::new(),
        diagnosis: None,
        state_since_s: Vec::new(),
        features: Arc::default(),
        window_end_s: None,
        alarms: Arc::default(),
        advance: Arc::new([]),
        alarm_load: Load::default(),
        queue_bytes: 0,
        queue_wait_s: None,
        dropped: (0, 0),
    }
}
