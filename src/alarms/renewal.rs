//! An engine that goes on with other settings: what stands, stands; what is judged as before goes on where it was.
//!
//! The new engine is made for the machine as it is configured now. A limit of which nothing has changed keeps its delays
//! and levels; a changed one begins anew, at the level of its alarm. Must not know why the settings are others.

use super::AlarmEngine;
use super::AlarmEvent;
use super::Moment;
use super::Settings;
use crate::machine::Machine;
use crate::signal::ChannelInfo;

impl AlarmEngine {
    /// An engine of the same machine and stream with the limits, sensors and components of `machine`, and what the
    /// change itself causes: alarms of what is no longer there are over.
    #[must_use]
    pub fn renewed(
        &self,
        machine: &Machine,
        channels: &[ChannelInfo],
        settings: Settings,
        now: Moment,
    ) -> (Self, Vec<AlarmEvent>) {
        let mut next = Self::of_machine(machine, channels, settings);
        next.next_id = self.next_id;
        next.next_sequence = self.next_sequence;
        next.judged_until_s = self.judged_until_s;
        next.last_verdict_s = self.last_verdict_s;
        next.over.clone_from(&self.over);
        next.history = self.history.clone();
        next.bound_history();
        next.take_over_advance(self.advance.clone(), self.last_advance);
        let ended = next.take_over(self.standing(), now.stream_s);
        for (key, slot) in &self.components {
            if next.stated.has(key.0, &key.1) {
                let renewed = next.components.entry(key.clone()).or_default();
                (renewed.tracker, renewed.cause) = (slot.tracker, slot.cause);
            }
        }
        next.stated.renew(&self.stated);
        (next, ended)
    }
}

#[cfg(test)]
#[path = "renewal_tests.rs"]
mod tests;
