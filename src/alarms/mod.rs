//! Diagnosis → operator. Time is an argument.

use crate::diagnosis::verdict::Diagnosis;

/// Policy of the alarm engine.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Settings {}

/// A transition of an alarm.
#[derive(Debug, Clone, PartialEq)]
pub struct AlarmEvent {}

/// The alarms of one machine.
#[derive(Debug)]
pub struct AlarmEngine {}

impl AlarmEngine {
    /// An engine without alarms.
    #[must_use]
    pub fn new(_settings: Settings) -> Self {
        Self {}
    }

    /// Takes a verdict at stream time `time_s` in and gives the transitions it causes.
    pub fn observe(&mut self, _diagnosis: &Diagnosis, _time_s: f64) -> Vec<AlarmEvent> {
        Vec::new()
    }
}

/// One alarm.
#[derive(Debug, Clone, PartialEq)]
pub struct Alarm {}

/// Why an operator's action was refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ActionError {}
