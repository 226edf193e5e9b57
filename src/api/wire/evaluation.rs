//! The evaluation document, `rotorwatch.evaluation/1`: what `rotorwatch evaluate --format json` prints.

use super::finite;
use super::names::{FaultName, KindName, OutcomeName};
use crate::evaluation::interval::Rate;
use crate::evaluation::reliability::Bin;
use crate::evaluation::score::{Accusation, Finding, Outcome, Score};
use crate::evaluation::summary::{Counts, Found, Group, Mistake, Record, Summary};
use schemars::JsonSchema;
use serde::Serialize;

/// Name and version of the document.
pub const SCHEMA: &str = "rotorwatch.evaluation/1";

/// Verdicts on many records held against what is known of them.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct EvaluationDocument {
    /// `rotorwatch.evaluation/1`.
    #[schemars(extend("const" = SCHEMA))]
    pub schema: String,
    /// The truth table, or what else the records were scored against.
    pub truth: String,
    /// Version of the program.
    pub version: String,
    /// All records by outcome.
    pub total: CountsWire,
    /// Records by data set and label.
    pub groups: Vec<GroupWire>,
    /// Known faults by kind, each counted by what was said of it, whatever was said of other parts.
    pub found: Vec<FoundWire>,
    /// Shares with what they prove; what the table accepts counts as right.
    pub rates: RatesWire,
    /// Wrong accusations, those on healthy machines among them, the surest first.
    pub mistakes: Vec<MistakeWire>,
    /// Weaker faults named beside the known one of the same component; such a record is right.
    pub beside: Vec<MistakeWire>,
    /// Reliability of the confidence given.
    pub reliability: ReliabilityWire,
    /// Processor time of the diagnoses; null when none was measured.
    pub processor: Option<ProcessorWire>,
    /// Every record in the order of the table.
    pub records: Vec<RecordWire>,
}

/// Records by outcome; what the table accepts counts as right.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct CountsWire {
    /// Right.
    pub right: usize,
    /// Of these, right only because the table accepts them.
    pub accepted: usize,
    /// Accused without a cause.
    pub detected: usize,
    /// Not judged.
    pub undetermined: usize,
    /// Called healthy.
    pub missed: usize,
    /// Another fault or component accused.
    pub wrong_cause: usize,
    /// Accused though healthy.
    pub false_alarm: usize,
    /// No verdict: the record could not be read or scored.
    pub failed: usize,
}

/// Records of one data set and label.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct GroupWire {
    /// Data set.
    pub dataset: String,
    /// Label.
    pub label: String,
    /// By outcome.
    pub counts: CountsWire,
    /// Share that is right.
    pub right: RateWire,
}

/// Known faults of one kind.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct FoundWire {
    /// The fault.
    pub fault: String,
    /// Whether their lines stand over the noise; null where that is not known.
    pub visible: Option<bool>,
    /// Named at their place.
    pub named: usize,
    /// Accused at their place without a cause, or as the machine's level.
    pub detected: usize,
    /// Their place was not judged.
    pub undetermined: usize,
    /// Their place was called healthy.
    pub missed: usize,
}

/// A count and what it proves.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct RateWire {
    /// So many.
    pub count: usize,
    /// Of so many.
    pub of: usize,
    /// Their quotient; null of nothing.
    pub share: Option<f64>,
    /// Exact 95 % interval of the true share (Clopper and Pearson), of one side where `count` is 0 or `of`.
    pub interval: [f64; 2],
    /// One-sided 95 % bound: the true share is below.
    pub upper_bound: f64,
}

/// Shares over all records.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct RatesWire {
    /// Right, of all.
    pub right: RateWire,
    /// Right, of records with a known fault.
    pub right_of_faulty: RateWire,
    /// Right, of records of which it is known that the fault's lines stand over the noise.
    pub right_of_visible: RateWire,
    /// Bearing faults accused, the cause named or not, of those whose lines stand over the noise, whatever was said of
    /// other parts.
    pub found_of_visible: RateWire,
    /// The same of those whose lines are twice as high as in the same machine without the fault at least.
    pub found_of_own: RateWire,
    /// Right or detected, of records with a known fault.
    pub found_of_faulty: RateWire,
    /// Wrong cause, of records with a known fault.
    pub wrong_cause: RateWire,
    /// Wrong cause given with confidence of at least 0.9, of records with a known fault.
    pub sure_wrong_cause: RateWire,
    /// False alarm, of healthy records.
    pub false_alarm: RateWire,
}

/// A wrong accusation.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct MistakeWire {
    /// The record.
    pub file: String,
    /// Its label.
    pub label: String,
    /// What was said.
    pub said: AccusationWire,
    /// Whether it was given with confidence of at least 0.9.
    pub sure: bool,
}

/// Something a diagnosis says is wrong.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct AccusationWire {
    /// Component.
    pub component: String,
    /// Its kind.
    pub kind: KindName,
    /// The fault; null: cause not proven.
    pub fault: Option<FaultName>,
    /// Its severity.
    pub severity: Option<f64>,
    /// Its confidence.
    pub confidence: Option<f64>,
    /// Whether it is neither the known fault nor a hint at it.
    pub stray: bool,
    /// Whether it is a weaker fault beside the known one of the same component.
    pub beside: bool,
}

/// Reliability of the confidence: of verdicts given 0.9, nine in ten should be right.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct ReliabilityWire {
    /// Of warnings and damage.
    pub accusing: Vec<BinWire>,
    /// Of healthy components.
    pub acquitting: Vec<BinWire>,
}

/// Verdicts of about equal confidence.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct BinWire {
    /// Lowest and highest confidence.
    pub confidence: [f64; 2],
    /// Mean confidence given; null in an empty bin.
    pub mean: Option<f64>,
    /// Share that was right.
    pub right: RateWire,
}

/// Processor time of the diagnoses, reading included, baselines not.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct ProcessorWire {
    /// Middle one, s.
    pub median_s: f64,
    /// Longest, s.
    pub max_s: f64,
    /// All together, s.
    pub total_s: f64,
}

/// One record.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct RecordWire {
    /// Capture, as the table names it.
    pub file: String,
    /// Data set.
    pub dataset: String,
    /// Label as written.
    pub label: String,
    /// The outcome, whether accepted or not; null without a verdict.
    pub outcome: Option<OutcomeName>,
    /// Whether the table accepts the outcome, so that it counts as right.
    pub accepted: bool,
    /// What was said of each known fault.
    pub findings: Vec<FindingWire>,
    /// Everything accused.
    pub accused: Vec<AccusationWire>,
    /// Components that could not be judged: of a healthy machine any, else those labelled.
    pub open: Vec<OpenWire>,
    /// Of a run to failure: the first alarm as a part of its length.
    pub first_alarm: Option<f64>,
    /// Why there is no verdict.
    pub error: Option<String>,
    /// Whether the fault's lines stand over the noise; null where that is not known.
    pub visible: Option<bool>,
    /// How many times as high these lines are as in the same machine without the fault; null where that is not known.
    pub over_sound: Option<f64>,
    /// Processor time, s.
    pub processor_s: Option<f64>,
}

/// What was said of one known fault, whatever was said of others.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct FindingWire {
    /// The component; null if the truth does not name it.
    pub component: Option<String>,
    /// The fault.
    pub fault: FaultName,
    /// Right if it is named at its place, detected, undetermined or missed.
    pub outcome: OutcomeName,
}

/// A component that could not be judged.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct OpenWire {
    /// Component.
    pub component: String,
    /// Why.
    pub why: String,
}

impl EvaluationDocument {
    /// Makes the document of scored records; `truth` names what they were scored against.
    #[must_use]
    pub fn new(records: &[Record], summary: &Summary<'_>, truth: &str) -> Self {
        let bins = |bins: &[Bin]| bins.iter().map(BinWire::new).collect();
        let rates = &summary.rates;
        Self {
            schema: SCHEMA.to_owned(),
            truth: truth.to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            total: CountsWire::new(&summary.total),
            groups: summary.groups.iter().map(GroupWire::new).collect(),
            found: summary.found.iter().map(FoundWire::new).collect(),
            rates: RatesWire {
                right: RateWire::new(&rates.right),
                right_of_faulty: RateWire::new(&rates.right_of_faulty),
                right_of_visible: RateWire::new(&rates.right_of_visible),
                found_of_visible: RateWire::new(&rates.found_of_visible),
                found_of_own: RateWire::new(&rates.found_of_own),
                found_of_faulty: RateWire::new(&rates.found_of_faulty),
                wrong_cause: RateWire::new(&rates.wrong_cause),
                sure_wrong_cause: RateWire::new(&rates.sure_wrong_cause),
                false_alarm: RateWire::new(&rates.false_alarm),
            },
            mistakes: summary.mistakes.iter().map(MistakeWire::new).collect(),
            beside: summary.beside.iter().map(MistakeWire::new).collect(),
            reliability: ReliabilityWire {
                accusing: bins(&summary.accusing),
                acquitting: bins(&summary.acquitting),
            },
            processor: summary.processor.map(|time| ProcessorWire {
                median_s: time.median_s,
                max_s: time.max_s,
                total_s: time.total_s,
            }),
            records: records.iter().map(RecordWire::new).collect(),
        }
    }
}

impl CountsWire {
    fn new(counts: &Counts) -> Self {
        Self {
            right: counts.of(Outcome::Right),
            accepted: counts.accepted,
            detected: counts.of(Outcome::Detected),
            undetermined: counts.of(Outcome::Undetermined),
            missed: counts.of(Outcome::Missed),
            wrong_cause: counts.of(Outcome::WrongCause),
            false_alarm: counts.of(Outcome::FalseAlarm),
            failed: counts.failed,
        }
    }
}

impl GroupWire {
    fn new(group: &Group) -> Self {
        Self {
            dataset: group.dataset.clone(),
            label: group.label.clone(),
            counts: CountsWire::new(&group.counts),
            right: RateWire::new(&group.right),
        }
    }
}

impl FoundWire {
    fn new(found: &Found) -> Self {
        let of = |outcome: Outcome| found.outcomes[outcome as usize];
        Self {
            fault: found.fault.to_owned(),
            visible: found.is_visible,
            named: of(Outcome::Right),
            detected: of(Outcome::Detected),
            undetermined: of(Outcome::Undetermined),
            missed: of(Outcome::Missed),
        }
    }
}

impl RateWire {
    fn new(rate: &Rate) -> Self {
        let (low, high) = rate.interval;
        Self {
            count: rate.count,
            of: rate.of,
            share: rate.share(),
            interval: [low, high],
            upper_bound: rate.upper_bound,
        }
    }
}

impl MistakeWire {
    fn new(mistake: &Mistake<'_>) -> Self {
        Self {
            file: mistake.record.file.clone(),
            label: mistake.record.label.clone(),
            said: AccusationWire::new(mistake.accusation),
            sure: mistake.accusation.is_surely_wrong(),
        }
    }
}

impl AccusationWire {
    fn new(accusation: &Accusation) -> Self {
        Self {
            component: accusation.component.clone(),
            kind: accusation.kind.into(),
            fault: accusation.fault.map(Into::into),
            severity: accusation.severity.and_then(finite),
            confidence: accusation.confidence.and_then(finite),
            stray: accusation.stray,
            beside: accusation.beside,
        }
    }
}

impl BinWire {
    fn new(bin: &Bin) -> Self {
        let (low, high) = bin.confidence;
        Self { confidence: [low, high], mean: bin.mean, right: RateWire::new(&bin.right) }
    }
}

impl RecordWire {
    fn new(record: &Record) -> Self {
        let score: Option<&Score> = record.score.as_ref().ok();
        let open = |score: &Score| {
            let open = score.open.iter();
            open.map(|o| OpenWire { component: o.component.clone(), why: o.why.clone() }).collect()
        };
        let finding = |finding: &Finding| FindingWire {
            component: finding.component.clone(),
            fault: finding.fault.into(),
            outcome: finding.outcome.into(),
        };
        Self {
            file: record.file.clone(),
            dataset: record.dataset.clone(),
            label: record.label.clone(),
            outcome: score.map(|s| s.outcome.into()),
            accepted: score.is_some_and(|s| s.accepted),
            findings: score.map(|s| s.findings.iter().map(finding).collect()).unwrap_or_default(),
            accused: score
                .map(|s| s.accusations.iter().map(AccusationWire::new).collect())
                .unwrap_or_default(),
            open: score.map(open).unwrap_or_default(),
            first_alarm: score.and_then(|s| s.first_alarm).and_then(finite),
            error: record.score.as_ref().err().cloned(),
            visible: record.is_visible,
            over_sound: record.over_sound.and_then(finite),
            processor_s: record.processor_s.and_then(finite),
        }
    }
}

/// Gives the JSON Schema (2020-12) of [`EvaluationDocument`]; unknown keys stay allowed, because additions are.
#[must_use]
pub fn json_schema() -> serde_json::Value {
    let settings = schemars::generate::SchemaSettings::draft2020_12().for_serialize();
    settings.into_generator().into_root_schema_for::<EvaluationDocument>().to_value()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::api::support::{golden, sample_diagnosis};
    use crate::diagnosis::fault::FaultMode;
    use crate::evaluation::score;
    use crate::evaluation::truth::{Known, KnownFault};

    fn records() -> Vec<Record> {
        let fault = |fault| KnownFault { fault, component: Some("right".to_owned()) };
        let record = |label: &str, known: Known| Record {
            file: format!("{label}.h5"),
            dataset: "rig".to_owned(),
            label: label.to_owned(),
            score: score::score(&known, &[], &sample_diagnosis()).map_err(|e| e.to_string()),
            known,
            is_visible: None,
            over_sound: None,
            processor_s: Some(0.25),
        };
        let cage = vec![fault(FaultMode::Cage), fault(FaultMode::InnerRace)];
        let life = Known::RunToFailure;
        let mut records = vec![
            record("cage", Known::Faults(cage)),
            record("healthy", Known::Faults(Vec::new())),
            record("run_to_failure", life.clone()),
        ];
        let score = Err("no such file".to_owned());
        records.push(Record { score, processor_s: None, ..record("gone", life) });
        records
    }

    #[test]
    fn the_document_says_what_was_counted_and_validates() {
        let records = records();
        let document = EvaluationDocument::new(&records, &Summary::of(&records), "truth.csv");
        let document = serde_json::to_value(&document).unwrap();
        assert_eq!(document["total"]["right"], 1);
        assert_eq!(document["total"]["failed"], 1 + usize::from(records[2].score.is_err()));
        assert_eq!(document["records"][1]["outcome"], "false_alarm");
        assert_eq!(document["mistakes"][0]["sure"], true);
        assert_eq!(document["records"][3]["error"], "no such file");
        let validator = jsonschema::draft202012::new(&json_schema()).unwrap();
        let faults: Vec<String> = validator
            .iter_errors(&document)
            .map(|e| format!("{}: {e}", e.instance_path()))
            .collect();
        assert!(faults.is_empty(), "{faults:#?}");
        let mut wrong = document;
        wrong["records"][1]["outcome"] = "lucky".into();
        assert!(!validator.is_valid(&wrong));
    }

    #[test]
    fn committed_schema_is_current() {
        let text = serde_json::to_string_pretty(&json_schema()).unwrap() + "\n";
        golden("docs/schemas/evaluation-1.schema.json", &text);
    }
}
