//! One diagnosis against what is known of its record.
//!
//! Bearings, shafts, gears and the machine count; sensors do not. An accusation either *names* a known fault at its
//! place, or *hints* at it (its component without a cause, or the abnormal level of the whole machine, which
//! blames no part), or is *stray*. One stray accusation makes a verdict wrong, however right the rest; but a
//! weaker fault beside a known one of the same component does not: it is counted apart.

use super::reliability::Judgement;
use super::truth::Acceptable;
use super::truth::Known;
use super::truth::KnownFault;
use super::truth::kind_of;
use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::diagnosis::verdict::Diagnosis;

/// From this confidence on, a wrong cause is listed apart.
pub const SURE: f64 = 0.9;

/// How a verdict compares with the truth, best first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Outcome {
    /// The known fault at its place and nothing else; or healthy, and nothing accused.
    Right,
    /// Its place, or the machine's level, without a cause.
    Detected,
    /// Its place could not be judged, nothing accused.
    Undetermined,
    /// Its place called healthy, nothing accused.
    Missed,
    /// Another fault or component accused.
    WrongCause,
    /// Anything accused on a healthy machine.
    FalseAlarm,
}

impl Outcome {
    /// All of them, best first.
    pub const ALL: [Self; 6] = [
        Self::Right,
        Self::Detected,
        Self::Undetermined,
        Self::Missed,
        Self::WrongCause,
        Self::FalseAlarm,
    ];

    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Right => "right",
            Self::Detected => "detected",
            Self::Undetermined => "undetermined",
            Self::Missed => "missed",
            Self::WrongCause => "wrong_cause",
            Self::FalseAlarm => "false_alarm",
        }
    }

    /// The outcome of a name; a blank does for the underscore.
    #[must_use]
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|outcome| outcome.name() == name.replace(' ', "_"))
    }
}

/// Something a diagnosis says is wrong.
#[derive(Debug, Clone, PartialEq)]
pub struct Accusation {
    /// Component.
    pub component: String,
    /// Its kind.
    pub kind: ComponentKind,
    /// The fault; `None`: cause not proven.
    pub fault: Option<FaultMode>,
    /// Its severity.
    pub severity: Option<f64>,
    /// Its confidence.
    pub confidence: Option<f64>,
    /// Whether it is neither known nor a hint at what is known.
    pub stray: bool,
    /// Whether it is a weaker fault beside the component's strongest, which is known.
    pub beside: bool,
}

impl Accusation {
    /// Whether it is stray and given with a confidence of at least [`SURE`].
    #[must_use]
    pub fn is_surely_wrong(&self) -> bool {
        self.stray && self.confidence.is_some_and(|confidence| confidence >= SURE)
    }
}

/// A component that could not be judged, and why.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Open {
    /// Component.
    pub component: String,
    /// The diagnosis' reason.
    pub why: String,
}

/// What was said of one known fault, whatever was said of others.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// The component, if the truth names it.
    pub component: Option<String>,
    /// The fault.
    pub fault: FaultMode,
    /// One of the first four of [`Outcome::ALL`]: `Right` if it is named at its place.
    pub outcome: Outcome,
}

/// The score of one record.
#[derive(Debug, Clone, PartialEq)]
pub struct Score {
    /// As the contract defines it.
    pub outcome: Outcome,
    /// Whether the truth table accepts this outcome, so that it counts as right.
    pub accepted: bool,
    /// What was said of each known fault; empty for a run to failure.
    pub findings: Vec<Finding>,
    /// Everything accused.
    pub accusations: Vec<Accusation>,
    /// Components left open that the outcome depends on: those labelled, all of a healthy machine.
    pub open: Vec<Open>,
    /// Verdicts that carry a confidence.
    pub judgements: Vec<Judgement>,
    /// Of a run to failure: when the first alarm comes, as a part of its length.
    pub first_alarm: Option<f64>,
}

impl Score {
    /// The outcome as it is counted.
    #[must_use]
    pub fn counted(&self) -> Outcome {
        if self.accepted { Outcome::Right } else { self.outcome }
    }
}

/// Why a diagnosis cannot be held against a row.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ScoreError {
    /// The labelled component is not part of the machine.
    #[error("the truth names component `{component}`, the machine has {known}")]
    NoSuchComponent {
        /// As labelled.
        component: String,
        /// What there is.
        known: String,
    },
    /// A run to failure in one window.
    #[error(
        "a run to failure needs a capture of several windows or segments, this one has no timeline"
    )]
    NoTimeline,
}

/// Holds a diagnosis against what is known.
///
/// Of several known faults the worst found counts; all must be named for `right`.
///
/// # Errors
/// When a labelled component is not in the diagnosis, or a run to failure has no timeline.
pub fn score(
    known: &Known,
    acceptable: &[Acceptable],
    diagnosis: &Diagnosis,
) -> Result<Score, ScoreError> {
    match known {
        Known::Faults(faults) => score_faults(faults, acceptable, diagnosis),
        Known::RunToFailure => score_life(acceptable, diagnosis),
    }
}

/// Components that count.
fn scored(diagnosis: &Diagnosis) -> impl Iterator<Item = &ComponentDiagnosis> {
    diagnosis.components.iter().filter(|c| c.kind != ComponentKind::Sensor)
}

/// Whether a component is, or may be, the one labelled.
fn is_place(known: &KnownFault, id: &str, kind: ComponentKind) -> bool {
    match &known.component {
        Some(component) => component == id,
        None => kind_of(known.fault) == Some(kind),
    }
}

/// What an accusation says of one known fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Said {
    Named,
    Hinted,
    Nothing,
}

fn said(known: &KnownFault, accusation: &Accusation) -> Said {
    let at_place = is_place(known, &accusation.component, accusation.kind);
    match accusation.fault {
        Some(fault) if fault == known.fault && at_place => Said::Named,
        None if at_place => Said::Hinted,
        Some(FaultMode::AbnormalLevel) if at_place || accusation.kind == ComponentKind::Machine => {
            Said::Hinted
        }
        Some(_) | None => Said::Nothing,
    }
}

/// Everything a diagnosis accuses.
fn accusations(diagnosis: &Diagnosis, faults: &[KnownFault]) -> Vec<Accusation> {
    let mut found = Vec::new();
    for c in scored(diagnosis).filter(|c| c.state.is_accusation()) {
        let first = (c.fault, c.severity, c.confidence);
        let others =
            c.other_faults.iter().map(|o| (Some(o.fault), Some(o.severity), Some(o.confidence)));
        let mut beside = false;
        for (fault, severity, confidence) in std::iter::once(first).chain(others) {
            let (component, kind, stray) = (c.id.clone(), c.kind, false);
            let mut accusation =
                Accusation { component, kind, fault, severity, confidence, stray, beside };
            let said = |what: Said| faults.iter().any(|f| said(f, &accusation) == what);
            beside |= found.iter().all(|a: &Accusation| a.component != c.id) && said(Said::Named);
            accusation.stray = !said(Said::Named) && !said(Said::Hinted);
            found.push(accusation);
        }
    }
    found
}

fn score_faults(
    faults: &[KnownFault],
    acceptable: &[Acceptable],
    diagnosis: &Diagnosis,
) -> Result<Score, ScoreError> {
    refuse_strangers(faults, diagnosis)?;
    let accusations = accusations(diagnosis, faults);
    let finding = |known: &KnownFault| Finding {
        component: known.component.clone(),
        fault: known.fault,
        outcome: outcome_of(known, &accusations, diagnosis),
    };
    let findings: Vec<Finding> = faults.iter().map(finding).collect();
    let outcome = if faults.is_empty() {
        if accusations.is_empty() { Outcome::Right } else { Outcome::FalseAlarm }
    } else if accusations.iter().any(|a| a.stray && !a.beside) {
        Outcome::WrongCause
    } else {
        findings.iter().map(|f| f.outcome).max().unwrap_or(Outcome::Right)
    };
    let is_open = |c: &&ComponentDiagnosis| {
        c.state == State::Undetermined
            && (faults.is_empty() || faults.iter().any(|f| is_place(f, &c.id, c.kind)))
    };
    let open = scored(diagnosis).filter(is_open);
    let open =
        open.map(|c| Open { component: c.id.clone(), why: c.why.clone() }).collect::<Vec<_>>();
    let accepts = |acceptable: &Acceptable| match acceptable {
        Acceptable::Outcome(accepted) => *accepted == outcome,
        Acceptable::Fault(fault) => accepts_fault(*fault, faults, &accusations),
    };
    Ok(Score {
        outcome,
        accepted: outcome != Outcome::Right && acceptable.iter().any(accepts),
        judgements: judgements(faults, &accusations, diagnosis),
        findings,
        accusations,
        open,
        first_alarm: None,
    })
}

/// Whether nothing is accused but labelled components, of nothing but labelled faults and this one.
fn accepts_fault(fault: FaultMode, faults: &[KnownFault], accusations: &[Accusation]) -> bool {
    let fits = |a: &Accusation| {
        !a.stray
            || a.fault == Some(fault) && faults.iter().any(|f| is_place(f, &a.component, a.kind))
    };
    accusations.iter().any(|a| a.fault == Some(fault)) && accusations.iter().all(fits)
}

/// Outcome of one known fault when nothing else is accused.
fn outcome_of(known: &KnownFault, accusations: &[Accusation], diagnosis: &Diagnosis) -> Outcome {
    let any = |what: Said| accusations.iter().any(|a| said(known, a) == what);
    let mut places = scored(diagnosis).filter(|c| is_place(known, &c.id, c.kind)).peekable();
    if any(Said::Named) {
        Outcome::Right
    } else if any(Said::Hinted) {
        Outcome::Detected
    } else if places.peek().is_none() || places.any(|c| c.state == State::Undetermined) {
        Outcome::Undetermined // A part that the machine file leaves out cannot be judged.
    } else {
        Outcome::Missed
    }
}

fn refuse_strangers(faults: &[KnownFault], diagnosis: &Diagnosis) -> Result<(), ScoreError> {
    let is_there = |id: &str| scored(diagnosis).any(|c| c.id == id);
    match faults.iter().filter_map(|f| f.component.as_deref()).find(|id| !is_there(id)) {
        None => Ok(()),
        Some(id) => {
            let known: Vec<&str> = scored(diagnosis).map(|c| c.id.as_str()).collect();
            let component = id.to_owned();
            Err(ScoreError::NoSuchComponent { component, known: known.join(", ") })
        }
    }
}

/// Verdicts with a confidence, right or wrong. A healthy verdict on a part that may or may not be the
/// labelled one is left out.
fn judgements(
    faults: &[KnownFault],
    accusations: &[Accusation],
    diagnosis: &Diagnosis,
) -> Vec<Judgement> {
    let accused = accusations.iter().filter_map(|a| {
        Some(Judgement { confidence: a.confidence?, right: !a.stray, accused: true })
    });
    let healthy = scored(diagnosis).filter(|c| c.state == State::Healthy).filter_map(|c| {
        let mut labelled = faults.iter().filter(|f| is_place(f, &c.id, c.kind)).peekable();
        let is_labelled = labelled.peek().is_some();
        let may_be_another = labelled.any(|f| f.component.is_none());
        if may_be_another {
            return None;
        }
        Some(Judgement { confidence: c.confidence?, right: !is_labelled, accused: false })
    });
    accused.chain(healthy).collect()
}

/// A run to failure: right if the first half of it is healthy and the first alarm comes after it, before
/// the last window.
fn score_life(acceptable: &[Acceptable], diagnosis: &Diagnosis) -> Result<Score, ScoreError> {
    let timeline = diagnosis.timeline.as_ref().ok_or(ScoreError::NoTimeline)?;
    let (Some(first_s), Some(last_s)) = (timeline.time_s.first(), timeline.time_s.last()) else {
        return Err(ScoreError::NoTimeline);
    };
    let part = |time_s: f64| (time_s - first_s) / (last_s - first_s);
    let windows = timeline.time_s.iter().zip(&timeline.state);
    let early = windows.filter(|(time_s, _)| part(**time_s) < 0.5);
    let (mut n_early, mut n_healthy) = (0_usize, 0_usize);
    for (_, state) in early {
        n_early += 1;
        n_healthy += usize::from(*state == State::Healthy);
    }
    let first_alarm = diagnosis.first_warning_s.map(part).filter(|part| part.is_finite());
    let outcome = match first_alarm {
        Some(part) if part < 0.5 => Outcome::FalseAlarm,
        // Most of the first half must have been judged: silence is no health.
        Some(part) if part < 1.0 && 2 * n_healthy >= n_early => Outcome::Right,
        Some(part) if part < 1.0 => Outcome::Undetermined,
        Some(_) | None => Outcome::Missed,
    };
    let open = scored(diagnosis).filter(|c| c.state == State::Undetermined);
    let open = open.map(|c| Open { component: c.id.clone(), why: c.why.clone() }).collect();
    // Whatever is accused at the end is what failed.
    let mut accusations = accusations(diagnosis, &[]);
    accusations.iter_mut().for_each(|a| a.stray = outcome == Outcome::FalseAlarm);
    Ok(Score {
        outcome,
        accepted: outcome != Outcome::Right && acceptable.contains(&Acceptable::Outcome(outcome)),
        findings: Vec::new(),
        accusations,
        open,
        judgements: Vec::new(),
        first_alarm,
    })
}

#[cfg(test)]
#[path = "score_tests.rs"]
mod tests;
