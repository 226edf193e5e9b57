//! What came of a rerun, for people and as a document.

use super::history::Answer;
use super::history::Change;
use super::history::Question;
use crate::api::wire::rerun::RerunAlarmWire;
use crate::api::wire::rerun::RerunChangeWire;
use crate::api::wire::rerun::RerunDocument;
use crate::api::wire::rfc3339;
use crate::signal::Timestamp;

fn at(time: Timestamp) -> String {
    rfc3339(Some(time), 0.0)
}

/// The document.
pub(super) fn document(question: &Question, answer: &Answer) -> RerunDocument {
    let list = |changes: &[Change]| changes.iter().map(wire).collect();
    RerunDocument {
        schema: "rotorwatch.replay-alarms/1".to_owned(),
        machine: question.machine.id.clone(),
        from: at(question.span.0),
        to: at(question.span.1),
        windows: answer.n_windows,
        standing: answer.standing.iter().map(RerunAlarmWire::new).collect(),
        would: list(&answer.would),
        was: list(&answer.was),
        only_would: list(&answer.only_would),
        only_was: list(&answer.only_was),
        gaps: answer.gaps.iter().map(|(from, to)| [at(*from), at(*to)]).collect(),
        notes: answer.notes.clone(),
    }
}

fn wire(change: &Change) -> RerunChangeWire {
    RerunChangeWire {
        at: at(change.at),
        event: change.what.name().to_owned(),
        alarm: RerunAlarmWire::new(&change.alarm),
    }
}

/// A change on one line.
fn line(change: &Change) -> String {
    let alarm = &change.alarm;
    let source = match alarm.source.limit() {
        Some(limit) => format!("limit {limit}"),
        None => alarm.source.name().to_owned(),
    };
    let fault = alarm.fault.map_or(String::new(), |fault| format!(" {}", fault.name()));
    format!(
        "{}  {:<12} {:<8} {} {}  {source}{fault}\n",
        at(change.at),
        change.what.name(),
        alarm.level.name(),
        alarm.kind.name(),
        alarm.component,
    )
}

/// The text.
pub(super) fn of(question: &Question, answer: &Answer) -> String {
    let (from, to) = question.span;
    let mut text = format!(
        "{}: {} windows from {} to {}\n",
        question.machine.id,
        answer.n_windows,
        at(from),
        at(to)
    );
    let mut section = |title: &str, changes: &[Change]| {
        text.push_str(&format!("\n{title}: {}\n", changes.len()));
        changes.iter().for_each(|change| text.push_str(&format!("  {}", line(change))));
    };
    section("Would have been raised", &answer.would);
    section("Only with these limits", &answer.only_would);
    section("Was raised, and would not have been", &answer.only_was);
    if answer.only_would.is_empty() && answer.only_was.is_empty() {
        text.push_str("\nNo difference from what was raised.\n");
    }
    if !answer.standing.is_empty() {
        text.push_str("\nStanding at the beginning:\n");
        for alarm in &answer.standing {
            let (kind, component) = (alarm.kind.name(), &alarm.component);
            text.push_str(&format!("  {} {kind} {component}\n", alarm.level.name()));
        }
    }
    text.push_str("\nNot told by the history:\n");
    answer.notes.iter().for_each(|note| text.push_str(&format!("  {note}\n")));
    text
}
