//! What is shown of a machine: the snapshot published to HTTP after each change.
//!
//! Must not know what changed it.

use super::Monitored;
use crate::alarms::load::Load;
use crate::api::view::MachineView;
use crate::api::view::SourceState;
use crate::buffer::RingStatus;
use crate::diagnosis::verdict::Diagnosis;
use crate::machine::Machine;
use crate::pipeline::Monitor;
use std::sync::Arc;

impl Monitored {
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
