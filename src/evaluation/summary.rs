//! Many scores counted: by data set and label, as rates with what they prove, and what went wrong one by one.

use super::interval::Rate;
use super::reliability;
use super::reliability::Bin;
use super::score::Accusation;
use super::score::Finding;
use super::score::Outcome;
use super::score::Score;
use super::truth::Known;
use super::truth::kind_of;
use crate::diagnosis::fault::ComponentKind;
use std::collections::BTreeMap;

/// One record that was to be scored.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// Name of the capture, as the truth table has it.
    pub file: String,
    /// Its data set.
    pub dataset: String,
    /// Its label as written.
    pub label: String,
    /// What the label says.
    pub known: Known,
    /// Whether the fault's lines stand over the noise, where that is known.
    pub is_visible: Option<bool>,
    /// How many times as high these lines are as in the same machine without the fault, where that is known (T11).
    pub over_sound: Option<f64>,
    /// The score, or why there is none.
    pub score: Result<Score, String>,
    /// Processor time of the diagnosis, reading included and baselines not, s.
    pub processor_s: Option<f64>,
}

impl Record {
    fn has_own_lines(&self) -> bool {
        self.over_sound.is_some_and(|ratio| ratio >= OWN)
    }

    fn is_healthy(&self) -> bool {
        self.known == Known::Faults(Vec::new())
    }

    fn is_fault(&self) -> bool {
        matches!(&self.known, Known::Faults(faults) if !faults.is_empty())
    }
}

/// How many times as high as in the same machine without the fault lines are that count as the fault's own: 6 dB, from
/// which a level is news (S2, T11).
pub const OWN: f64 = 2.0;

/// Records counted by their outcome.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// By outcome in the order of [`Outcome::ALL`]; what the table accepts counts as right.
    pub outcomes: [usize; Outcome::ALL.len()],
    /// Of the right ones, those that are right only because the table accepts them.
    pub accepted: usize,
    /// Records without a score.
    pub failed: usize,
}

impl Counts {
    /// Records with an outcome.
    #[must_use]
    pub fn of(&self, outcome: Outcome) -> usize {
        self.outcomes[outcome as usize]
    }

    /// Records with a score.
    #[must_use]
    pub fn scored(&self) -> usize {
        self.outcomes.iter().sum()
    }

    fn add(&mut self, record: &Record) {
        match &record.score {
            Ok(score) => {
                self.outcomes[score.counted() as usize] += 1;
                self.accepted += usize::from(score.accepted);
            }
            Err(_) => self.failed += 1,
        }
    }
}

/// Records of one data set and label.
#[derive(Debug, Clone, PartialEq)]
pub struct Group {
    /// Data set.
    pub dataset: String,
    /// Label.
    pub label: String,
    /// Their outcomes.
    pub counts: Counts,
    /// Right ones.
    pub right: Rate,
}

/// Known faults of one kind counted by what was said of each, whatever was said of other parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Found {
    /// Name of the fault.
    pub fault: &'static str,
    /// Whether their lines stand over the noise, where that is known.
    pub is_visible: Option<bool>,
    /// By outcome in the order of [`Outcome::ALL`]: named, accused without a cause, left open, called healthy.
    pub outcomes: [usize; Outcome::ALL.len()],
}

/// Shares over all records with a score; what the table accepts counts as right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rates {
    /// Right, of all.
    pub right: Rate,
    /// Right, of those with a known fault.
    pub right_of_faulty: Rate,
    /// Right, of those of which it is known that their fault's lines stand over the noise.
    pub right_of_visible: Rate,
    /// Bearing faults called a warning or damage, whether the cause was named or not, of those whose lines stand over
    /// the noise, whatever was said of other parts.
    pub found_of_visible: Rate,
    /// The same of those whose lines are [`OWN`] times as high as without the fault at least.
    pub found_of_own: Rate,
    /// Right or detected, of those with a known fault.
    pub found_of_faulty: Rate,
    /// Another cause named, of those with a known fault.
    pub wrong_cause: Rate,
    /// Of those the ones named with confidence of at least [`super::score::SURE`].
    pub sure_wrong_cause: Rate,
    /// Anything accused, of the healthy.
    pub false_alarm: Rate,
}

/// Processor time of the diagnoses, s.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProcessorTime {
    /// Middle one.
    pub median_s: f64,
    /// Longest.
    pub max_s: f64,
    /// All together.
    pub total_s: f64,
}

/// A wrong verdict: a stray accusation, or an alarm on a healthy machine.
#[derive(Debug, Clone, PartialEq)]
pub struct Mistake<'r> {
    /// The record.
    pub record: &'r Record,
    /// What was said.
    pub accusation: &'r Accusation,
}

/// Components left open, with the reason, where the outcome is undetermined.
#[derive(Debug, Clone, PartialEq)]
pub struct LeftOpen<'r> {
    /// The record.
    pub record: &'r Record,
    /// Component.
    pub component: &'r str,
    /// Why.
    pub why: &'r str,
}

/// Everything that is told of many records.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary<'r> {
    /// By data set and label, sorted.
    pub groups: Vec<Group>,
    /// All of them.
    pub total: Counts,
    /// Known faults by kind.
    pub found: Vec<Found>,
    /// Shares.
    pub rates: Rates,
    /// Accusations that are wrong, those on healthy machines among them, surest first.
    pub mistakes: Vec<Mistake<'r>>,
    /// Weaker faults named beside the known one of the same component.
    pub beside: Vec<Mistake<'r>>,
    /// Undetermined, with reasons.
    pub open: Vec<LeftOpen<'r>>,
    /// Reliability of the confidence of accusations.
    pub accusing: Vec<Bin>,
    /// Reliability of the confidence of healthy verdicts.
    pub acquitting: Vec<Bin>,
    /// `None` when no time was measured.
    pub processor: Option<ProcessorTime>,
}

impl<'r> Summary<'r> {
    /// Counts records.
    #[must_use]
    pub fn of(records: &'r [Record]) -> Self {
        let mut groups: BTreeMap<(&str, &str), Counts> = BTreeMap::new();
        let mut total = Counts::default();
        for record in records {
            groups.entry((&record.dataset, &record.label)).or_default().add(record);
            total.add(record);
        }
        let group = |((dataset, label), counts): ((&str, &str), Counts)| Group {
            dataset: dataset.to_owned(),
            label: label.to_owned(),
            counts,
            right: Rate::new(counts.of(Outcome::Right), counts.scored()),
        };
        let scores = || records.iter().filter_map(|r| r.score.as_ref().ok());
        let judgements = || scores().map(|s| &s.judgements[..]);
        Self {
            groups: groups.into_iter().map(group).collect(),
            total,
            found: found(records),
            rates: Rates::of(records),
            mistakes: mistakes(records, |a| a.stray && !a.beside),
            beside: mistakes(records, |a| a.stray && a.beside),
            open: open(records),
            accusing: reliability::table(judgements(), |j| j.accused),
            acquitting: reliability::table(judgements(), |j| !j.accused),
            processor: processor(records),
        }
    }
}

impl Rates {
    fn of(records: &[Record]) -> Self {
        let rate = |of: &dyn Fn(&Record) -> bool, counted: &dyn Fn(&Score) -> bool| {
            let cases = records.iter().filter(|r| of(r)).filter_map(|r| r.score.as_ref().ok());
            let (mut n, mut count) = (0, 0);
            for score in cases {
                n += 1;
                count += usize::from(counted(score));
            }
            Rate::new(count, n)
        };
        let is = |outcome: Outcome| move |score: &Score| score.counted() == outcome;
        let is_found = |s: &Score| matches!(s.counted(), Outcome::Right | Outcome::Detected);
        let is_sure = |s: &Score| {
            let mut wrong = s.accusations.iter().filter(|a| !a.beside);
            s.counted() == Outcome::WrongCause && wrong.any(Accusation::is_surely_wrong)
        };
        Self {
            right: rate(&|_| true, &is(Outcome::Right)),
            right_of_faulty: rate(&Record::is_fault, &is(Outcome::Right)),
            right_of_visible: rate(&|r| r.is_visible == Some(true), &is(Outcome::Right)),
            found_of_visible: found_of_visible(records, |_| true),
            found_of_own: found_of_visible(records, Record::has_own_lines),
            found_of_faulty: rate(&Record::is_fault, &is_found),
            wrong_cause: rate(&Record::is_fault, &is(Outcome::WrongCause)),
            sure_wrong_cause: rate(&Record::is_fault, &is_sure),
            false_alarm: rate(&Record::is_healthy, &is(Outcome::FalseAlarm)),
        }
    }
}

/// Findings of all records with a score, and whether the record's lines stand over the noise, which is said of faults
/// of bearings only.
fn findings(records: &[Record]) -> impl Iterator<Item = (&Finding, Option<bool>)> {
    records.iter().flat_map(|record| {
        let findings = record.score.as_ref().map_or(&[][..], |score| &score.findings);
        findings.iter().map(|finding| {
            let is_bearing = kind_of(finding.fault) == Some(ComponentKind::Bearing);
            (finding, record.is_visible.filter(|_| is_bearing))
        })
    })
}

fn found(records: &[Record]) -> Vec<Found> {
    let mut counts: BTreeMap<(&str, Option<bool>), [usize; Outcome::ALL.len()]> = BTreeMap::new();
    for (finding, is_visible) in findings(records) {
        let outcomes = counts.entry((finding.fault.name(), is_visible)).or_default();
        outcomes[finding.outcome as usize] += 1;
    }
    let found = |((fault, is_visible), outcomes)| Found { fault, is_visible, outcomes };
    counts.into_iter().map(found).collect()
}

/// Bearing faults accused, of those of `wanted` records whose lines stand over the noise.
fn found_of_visible(records: &[Record], wanted: impl Fn(&Record) -> bool) -> Rate {
    let (mut n, mut count) = (0, 0);
    for record in records.iter().filter(|record| wanted(record)) {
        let visible =
            findings(std::slice::from_ref(record)).filter(|(_, seen)| *seen == Some(true));
        for (finding, _) in visible {
            n += 1;
            count += usize::from(matches!(finding.outcome, Outcome::Right | Outcome::Detected));
        }
    }
    Rate::new(count, n)
}

/// Accusations that are `wanted`, the surest first; none of records that the table accepts.
fn mistakes(records: &[Record], wanted: impl Fn(&Accusation) -> bool) -> Vec<Mistake<'_>> {
    let mut found: Vec<Mistake<'_>> = Vec::new();
    for record in records {
        let Some(score) = record.score.as_ref().ok().filter(|score| !score.accepted) else {
            continue;
        };
        let stray = score.accusations.iter().filter(|a| wanted(a));
        found.extend(stray.map(|accusation| Mistake { record, accusation }));
    }
    let sureness = |m: &Mistake<'_>| m.accusation.confidence.unwrap_or(0.0);
    found.sort_by(|a, b| sureness(b).total_cmp(&sureness(a)));
    found
}

/// Reasons of every record whose outcome, accepted or not, is undetermined, and of healthy machines of which
/// nothing at all was judged.
fn open(records: &[Record]) -> Vec<LeftOpen<'_>> {
    let mut found = Vec::new();
    for record in records {
        let Ok(score) = &record.score else { continue };
        if score.outcome == Outcome::Undetermined || record.is_healthy() {
            found.extend(score.open.iter().map(|open| LeftOpen {
                record,
                component: &open.component,
                why: &open.why,
            }));
        }
    }
    found
}

fn processor(records: &[Record]) -> Option<ProcessorTime> {
    let mut times_s: Vec<f64> = records.iter().filter_map(|r| r.processor_s).collect();
    times_s.sort_by(f64::total_cmp);
    Some(ProcessorTime {
        median_s: *times_s.get(times_s.len() / 2)?,
        max_s: *times_s.last()?,
        total_s: times_s.iter().sum(),
    })
}

#[cfg(test)]
mod tests {
    use super::super::reliability::Judgement;
    use super::super::score::Open;
    use super::super::truth::KnownFault;
    use super::*;
    use crate::diagnosis::fault::FaultMode;

    fn score(outcome: Outcome, accepted: bool, stray: Option<f64>) -> Score {
        let accusation = |confidence| Accusation {
            component: "de".to_owned(),
            kind: ComponentKind::Bearing,
            fault: Some(FaultMode::Cage),
            severity: Some(0.6),
            confidence: Some(confidence),
            stray: true,
            beside: false,
        };
        // What was said of one fault is one of the first four outcomes.
        let of_fault = if stray.is_some() { Outcome::Missed } else { outcome };
        let finding = Finding { component: None, fault: FaultMode::OuterRace, outcome: of_fault };
        Score {
            outcome,
            accepted,
            findings: vec![finding],
            accusations: stray.map(accusation).into_iter().collect(),
            open: vec![Open { component: "fe".to_owned(), why: "too slow".to_owned() }],
            judgements: stray
                .map(|confidence| Judgement { confidence, right: false, accused: true })
                .into_iter()
                .collect(),
            first_alarm: None,
        }
    }

    fn record(label: &str, score: Result<Score, String>) -> Record {
        let fault = KnownFault { fault: FaultMode::OuterRace, component: None };
        let faults = if label == "healthy" { Vec::new() } else { vec![fault] };
        let score = score.map(|score| Score {
            findings: score.findings.into_iter().take(faults.len()).collect(),
            ..score
        });
        Record {
            file: "x.h5".to_owned(),
            dataset: "rig".to_owned(),
            label: label.to_owned(),
            known: Known::Faults(faults),
            is_visible: (label != "healthy").then_some(true),
            over_sound: (label == "outer_race").then_some(3.0),
            score,
            processor_s: Some(0.25),
        }
    }

    #[test]
    fn outcomes_are_counted_by_label_and_what_is_accepted_is_right() {
        let records = [
            record("healthy", Ok(score(Outcome::Right, false, None))),
            record("healthy", Ok(score(Outcome::FalseAlarm, false, Some(0.5)))),
            record("outer_race", Ok(score(Outcome::Undetermined, true, None))),
            record("outer_race", Ok(score(Outcome::Right, false, None))),
            record("outer_race", Ok(score(Outcome::WrongCause, false, Some(0.95)))),
            record("outer_race", Ok(score(Outcome::WrongCause, true, Some(0.97)))),
            record("outer_race", Ok(score(Outcome::Detected, false, None))),
            record("outer_race", Err("cannot be read".to_owned())),
        ];
        let summary = Summary::of(&records);
        assert_eq!(summary.groups.len(), 2);
        let faulty = &summary.groups[1];
        assert_eq!(
            (faulty.label.as_str(), faulty.counts.outcomes),
            ("outer_race", [3, 1, 0, 0, 1, 0])
        );
        assert_eq!((faulty.counts.accepted, faulty.counts.failed), (2, 1));
        assert_eq!(summary.total.outcomes, [4, 1, 0, 0, 1, 1]);
        let rates = &summary.rates;
        let counts = |rate: &Rate| (rate.count, rate.of);
        assert_eq!(counts(&rates.right), (4, 7));
        assert_eq!(counts(&rates.right_of_faulty), (3, 5));
        assert_eq!(counts(&rates.right_of_visible), (3, 5));
        assert_eq!(counts(&rates.found_of_visible), (2, 5), "whatever the table accepts");
        assert_eq!(counts(&rates.found_of_own), (2, 5));
        let without_the_fault_too = Record { over_sound: Some(1.9), ..records[3].clone() };
        let rates = Summary::of(&[without_the_fault_too, records[6].clone()]).rates;
        assert_eq!(
            (counts(&rates.found_of_visible), counts(&rates.found_of_own)),
            ((2, 2), (1, 1))
        );
        let rates = &summary.rates;
        let found =
            Found { fault: "outer_race", is_visible: Some(true), outcomes: [1, 1, 1, 2, 0, 0] };
        assert_eq!(summary.found, [found]);
        assert_eq!(counts(&rates.found_of_faulty), (4, 5));
        assert_eq!(counts(&rates.wrong_cause), (1, 5));
        assert_eq!(counts(&rates.sure_wrong_cause), (1, 5));
        assert_eq!(counts(&rates.false_alarm), (1, 2));
        // The accepted one is no mistake; the surest comes first.
        let sure: Vec<_> = summary.mistakes.iter().map(|m| m.accusation.confidence).collect();
        assert_eq!(sure, [Some(0.95), Some(0.5)]);
        // Two healthy ones and the undetermined one.
        assert_eq!(summary.open.len(), 3);
        assert_eq!(summary.accusing.iter().map(|b| b.right.of).sum::<usize>(), 3);
        let time = summary.processor.unwrap();
        assert!((time.total_s - 2.0).abs() < 1e-12 && (time.median_s - 0.25).abs() < 1e-12);
    }
}
