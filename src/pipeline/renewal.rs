//! A monitor that goes on with another description of its machine or other settings, between two windows.

use super::Monitor;
use super::Settings;
use super::fitting;
use crate::alarms::AlarmEvent;
use crate::alarms::Moment;
use crate::diagnosis::drift;
use crate::machine::Machine;
use std::sync::Arc;

/// How far a monitor is made anew.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Renewal {
    /// Limits, delays and thresholds: what was measured and learned stays.
    Judged,
    /// The machine is described otherwise: what was measured of it means something else. Rings stay.
    Rebuilt,
}

impl Monitor {
    /// Judges from the next window on by `machine` and `settings`; gives what that alone does to alarms. Windows
    /// lie and rings reach as before. When rebuilt, the baseline is that of the settings.
    ///
    /// The machine's sensors must have the channels and units of before.
    pub fn renew(
        &mut self,
        machine: &Arc<Machine>,
        settings: &Settings,
        renewal: Renewal,
        now: Moment,
    ) -> Vec<AlarmEvent> {
        // Held against what the channels made of these settings: only windows that were lengthened lengthen delays.
        self.settings = self.settings.renewed(&fitting(&self.channels, settings));
        self.machine = Arc::clone(machine);
        self.extractor.describe(Arc::clone(machine));
        let alarms = self.settings.alarms.clone();
        let (alarms, ended) = self.alarms.renewed(machine, &self.channels, alarms, now);
        self.alarms = alarms;
        // What was judged otherwise cannot be judged again by these.
        self.trail.clear();
        if renewal == Renewal::Rebuilt {
            self.run_up.clear();
            self.drift = drift::Watch::default();
            self.provisional.clear();
            self.baseline = Arc::new(self.settings.baseline.in_units_of(&self.channels));
        }
        ended
    }
}
