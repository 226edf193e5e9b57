//! Which verdicts are news: a component, or the machine as a whole, changed its state or its fault.

use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::Diagnosis;
use std::collections::BTreeMap;

/// Who has a state: a component by kind and id, or the machine as a whole.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum Subject {
    /// The machine as a whole.
    Machine,
    /// One component.
    Component(ComponentKind, String),
}

/// A state, with the fault named.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Health {
    /// State.
    pub state: State,
    /// Fault; `None`: none, or its cause not proven.
    pub fault: Option<FaultMode>,
}

/// A change of health.
#[derive(Debug, Clone, PartialEq)]
pub struct HealthChange {
    /// Whose.
    pub subject: Subject,
    /// Stream time of the end of the window that shows it, s.
    pub time_s: f64,
    /// Health now.
    pub health: Health,
    /// State before; `None`: the first verdict.
    pub before: Option<State>,
    /// Effect size.
    pub severity: Option<f64>,
    /// Probability that state and fault are right.
    pub confidence: Option<f64>,
    /// Sentence of the verdict; empty for the machine.
    pub why: String,
}

/// The health of one machine's components as it was last told.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct HealthWatch {
    known: BTreeMap<Subject, Health>,
    told_until_s: f64,
}

impl HealthWatch {
    /// Goes on with what was told before a restart; `judged_until_s`: what the same stream says up to there
    /// is no news.
    #[must_use]
    pub fn new(known: BTreeMap<Subject, Health>, judged_until_s: Option<f64>) -> Self {
        Self { known, told_until_s: judged_until_s.unwrap_or(f64::NEG_INFINITY) }
    }

    /// Takes a verdict at stream time `time_s` in and gives what changed.
    pub fn observe(&mut self, diagnosis: &Diagnosis, time_s: f64) -> Vec<HealthChange> {
        if time_s <= self.told_until_s {
            return Vec::new();
        }
        let whole = HealthChange {
            subject: Subject::Machine,
            time_s,
            health: Health { state: diagnosis.state, fault: None },
            before: None,
            severity: None,
            confidence: None,
            why: String::new(),
        };
        let components = diagnosis.components.iter().map(|component| HealthChange {
            subject: Subject::Component(component.kind, component.id.clone()),
            time_s,
            health: Health { state: component.state, fault: component.fault },
            before: None,
            severity: component.severity,
            confidence: component.confidence,
            why: component.why.clone(),
        });
        let mut changes = Vec::new();
        for change in std::iter::once(whole).chain(components) {
            let before = self.known.insert(change.subject.clone(), change.health);
            if before != Some(change.health) {
                changes.push(HealthChange { before: before.map(|b| b.state), ..change });
            }
        }
        changes
    }
}
