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
        self.regain(diagnosis, time_s)
    }

    /// Takes in that data come again at stream time `time_s`: the newest verdict holds. Gives what changed.
    pub fn regain(&mut self, diagnosis: &Diagnosis, time_s: f64) -> Vec<HealthChange> {
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

    /// Takes in that the machine is described otherwise from stream time `time_s` on: `diagnosis` has its components, and those
    /// that it has not are forgotten. Gives what changed; while no data come, nothing but that does.
    pub fn renew(
        &mut self,
        diagnosis: &Diagnosis,
        is_silent: bool,
        time_s: f64,
    ) -> Vec<HealthChange> {
        self.known.retain(|subject, _| match subject {
            Subject::Machine => true,
            Subject::Component(kind, id) => {
                diagnosis.components.iter().any(|one| one.kind == *kind && one.id == *id)
            }
        });
        if is_silent { Vec::new() } else { self.regain(diagnosis, time_s) }
    }

    /// Takes in that no data come at stream time `time_s`, for the reason `why`: nobody knows whether what was healthy
    /// still is, and what was accused stays so. Gives what changed.
    pub fn lose(&mut self, time_s: f64, why: &str) -> Vec<HealthChange> {
        let health = Health { state: State::Undetermined, fault: None };
        let mut changes = Vec::new();
        for (subject, known) in &mut self.known {
            if known.state != State::Healthy {
                continue;
            }
            *known = health;
            let why = match subject {
                Subject::Machine => String::new(),
                Subject::Component(..) => format!("{why}; found healthy before"),
            };
            changes.push(HealthChange {
                subject: subject.clone(),
                time_s,
                health,
                before: Some(State::Healthy),
                severity: None,
                confidence: None,
                why,
            });
        }
        changes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn known(states: [State; 3]) -> HealthWatch {
        let subjects = [
            Subject::Machine,
            Subject::Component(ComponentKind::Bearing, "left".to_owned()),
            Subject::Component(ComponentKind::Bearing, "right".to_owned()),
        ];
        let healths = states.map(|state| Health { state, fault: None });
        // What a stream says up to 100 s was told before a restart.
        HealthWatch::new(subjects.into_iter().zip(healths).collect(), Some(100.0))
    }

    #[test]
    fn without_data_what_was_healthy_is_undetermined_and_nothing_else_changes() {
        let mut watch = known([State::Damaged, State::Healthy, State::Damaged]);
        let [lost] = &watch.lose(7.0, "no data have come for 10 s")[..] else { panic!("one") };
        assert_eq!(lost.subject, Subject::Component(ComponentKind::Bearing, "left".to_owned()));
        assert_eq!((lost.health.state, lost.before), (State::Undetermined, Some(State::Healthy)));
        assert_eq!((lost.time_s, lost.severity, lost.confidence), (7.0, None, None));
        assert_eq!(lost.why, "no data have come for 10 s; found healthy before");
        assert!(watch.lose(8.0, "again").is_empty());

        let mut watch = known([State::Healthy, State::Healthy, State::Undetermined]);
        let lost = watch.lose(7.0, "why");
        assert_eq!(lost.len(), 2);
        assert_eq!((&lost[0].subject, lost[0].why.as_str()), (&Subject::Machine, ""));
    }
}
