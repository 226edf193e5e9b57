//! Verdicts on recordings of real machines, against what is known of them.
//!
//! The recordings are no part of the project: `ROTORWATCH_DATA` names their folder, with `truth.csv`,
//! `machines/<dataset>.toml` and the captures. Without it these tests skip themselves.

#![expect(clippy::unwrap_used, reason = "a test may panic; clippy exempts only #[test] functions")]
#![expect(clippy::print_stdout, reason = "a verdict table is what people want to see")]

mod added;
mod recording;
mod varied;

use rand::RngExt;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use rotorwatch::diagnosis::baseline::Baseline;
use rotorwatch::diagnosis::fault::ComponentKind;
use rotorwatch::diagnosis::fault::FaultMode;
use rotorwatch::diagnosis::fault::State;
use rotorwatch::diagnosis::verdict::ComponentDiagnosis;
use rotorwatch::diagnosis::verdict::Diagnosis;
use rotorwatch::evaluation::score;
use rotorwatch::evaluation::score::Outcome;
use rotorwatch::evaluation::score::Score;
use rotorwatch::evaluation::truth::TruthRow;
use rotorwatch::evaluation::truth::TruthTable;
use rotorwatch::machine::file;
use rotorwatch::offline;
use rotorwatch::offline::Reference;
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Recordings of the published table (docs/accuracy.md).
const N_ROWS: usize = 26;

/// Of these the table has what their rows accept; of all others but [`MISSED`] it has the fault named at its place and nothing else, or
/// nothing accused of a healthy machine.
const ACCEPTED: [&str; 7] = [
    "adi_mfs/1800-GoB-BS-BaLo-WA-11lb.h5",
    "adi_mfs/1800-GoB-GS-BaLo-MA-11lb.h5",
    "cwru/118_12k_Drive_End_B007_0.h5",
    "cwru/197_12k_Drive_End_OR014at6_0.h5",
    "cwru/222_12k_Drive_End_B021_0.h5",
    "cwru/299_12k_Fan_End_OR007at3_1.h5",
    "openei_gearbox/b30hz0.h5",
];

/// Called healthy, which its row does not accept.
const MISSED: [&str; 1] = ["paderborn/N15_M07_F10_KI14_1.h5"];

/// Unbalances of one rig, light and heavy: the second must be told to be worse.
const LIGHT_AND_HEAVY: [&str; 2] =
    ["adi_mfs/1800-GoB-GS-VLIL-WA-11lb.h5", "adi_mfs/1800-GoB-GS-HImL-WA-11lb.h5"];

/// Clear faults, told in changed records as well ([`varied`]).
const MUST_BE_RIGHT: [&str; 8] = [
    "cwru/105_12k_Drive_End_IR007_0.h5",
    "cwru/130_12k_Drive_End_OR007at6_0.h5",
    "cwru/278_12k_Fan_End_IR007_0.h5",
    "mfpt/InnerRaceFault_vload_3.h5",
    "mfpt/OuterRaceFault_vload_3.h5",
    "hitsm/self_OR2_900.h5",
    "adi_mfs/1800-HIR-GS-BaLo-WA-11lb.h5",
    "paderborn/N15_M07_F10_KA04_1.h5",
];

/// Must be healthy as a whole, bearings included.
const MUST_BE_HEALTHY: [&str; 4] = [
    "cwru/097_normal_0.h5",
    "hitsm/self_Normal_900.h5",
    "paderborn/N15_M07_F10_K001_1.h5",
    "adi_mfs/1800-GoB-GS-BaLo-WA-11lb.h5",
];

/// Data sets whose bearings are known, each record of a length to be judged.
const WITH_BEARINGS: [&str; 5] = ["adi_mfs", "cwru", "hitsm", "mfpt", "paderborn"];

/// Machine files with other bearings that each of their records is held against.
const N_OTHERS: usize = 12;

/// The folder of the recordings, or why the test skips itself.
fn data(test: &str) -> Option<PathBuf> {
    let folder = std::env::var_os("ROTORWATCH_DATA").map(PathBuf::from);
    if folder.is_none() {
        println!("SKIPPED {test}: ROTORWATCH_DATA does not name the real recordings");
    }
    folder
}

fn truth(data: &Path) -> Vec<TruthRow> {
    let text = fs::read_to_string(data.join("truth.csv")).unwrap();
    TruthTable::parse(&text, "truth.csv").unwrap().rows
}

/// Diagnoses a capture of a data set by nothing but its samples and attributes.
fn diagnose(data: &Path, row: &TruthRow, capture: &Path) -> Diagnosis {
    diagnose_beside(data, row, capture, "")
}

/// The same of a machine with something `more` in its file.
fn diagnose_beside(data: &Path, row: &TruthRow, capture: &Path, more: &str) -> Diagnosis {
    let machine_file = data.join("machines").join(format!("{}.toml", row.dataset));
    let text = fs::read_to_string(&machine_file).unwrap() + more;
    let machine = file::parse(&text, &row.dataset).unwrap();
    let mut reference = Reference { machine: Some(Arc::new(machine)), ..Reference::default() };
    let learn = |file: &String| offline::learn(&data.join(file), &reference, &mut |_| ()).unwrap();
    let records = row.baseline.iter().map(learn).collect();
    reference.baseline = Baseline { records, provisional: false };
    offline::diagnose(capture, &reference, &mut |_| ()).unwrap()
}

/// Sensor faults do not count.
fn scored(diagnosis: &Diagnosis) -> impl Iterator<Item = &ComponentDiagnosis> {
    diagnosis.components.iter().filter(|c| c.kind != ComponentKind::Sensor)
}

/// What is said of each component, for the table.
struct Verdicts<'d>(&'d Diagnosis);

impl fmt::Display for Verdicts<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:", self.0.state.name())?;
        for component in scored(self.0) {
            let fault = component.fault.map_or("", FaultMode::name);
            write!(f, " {}={}", component.id, component.state.name())?;
            if component.state.is_accusation() {
                let severity = component.severity.unwrap_or(f64::NAN);
                let confidence = component.confidence.unwrap_or(f64::NAN);
                write!(f, "({fault} {severity:.2} at {confidence:.2})")?;
            }
        }
        Ok(())
    }
}

/// Whether a row came out worse than the published table has it; better is never wrong.
fn is_worse(file: &str, found: &Score) -> bool {
    if MISSED.contains(&file) {
        found.counted() > Outcome::Missed
    } else if ACCEPTED.contains(&file) {
        found.counted() > Outcome::Right
    } else {
        found.outcome > Outcome::Right
    }
}

#[test]
#[ignore = "needs the real recordings: set ROTORWATCH_DATA"]
fn causes_are_right_or_not_named() {
    let Some(data) = data("causes_are_right_or_not_named") else { return };
    let rows = truth(&data);
    let (mut mistakes, mut unbalances) = (Vec::new(), [None; 2]);
    for row in &rows {
        let diagnosis = diagnose(&data, row, &data.join(&row.file));
        let found = score::score(&row.known, &row.acceptable, &diagnosis).unwrap();
        let remark = match (found.outcome, found.accepted) {
            (Outcome::Right, _) => "",
            (_, true) => " (acceptable)",
            (_, false) => " (open)",
        };
        println!("{:<52} {:<17} {}{remark}", row.file, row.label, found.outcome.name());
        println!("{:<52} {}", "", Verdicts(&diagnosis));
        let file = row.file.as_str();
        let why: Vec<String> = scored(&diagnosis).map(|c| format!("{}: {}", c.id, c.why)).collect();
        if is_worse(file, &found) {
            mistakes.push(format!("{file}: {}, worse than it was: {why:#?}", found.outcome.name()));
        }
        let mut bearings = scored(&diagnosis).filter(|c| c.kind == ComponentKind::Bearing);
        let healthy =
            diagnosis.state == State::Healthy && bearings.all(|c| c.state == State::Healthy);
        if MUST_BE_HEALTHY.contains(&file) && !healthy {
            mistakes.push(format!("{file}: not healthy: {why:#?}"));
        }
        if let Some(at) = LIGHT_AND_HEAVY.iter().position(|f| *f == file) {
            let unbalance = scored(&diagnosis).find(|c| c.fault == Some(FaultMode::Unbalance));
            unbalances[at] = unbalance.and_then(|c| c.severity);
        }
    }
    assert_eq!(rows.len(), N_ROWS, "the published table has as many");
    for file in ACCEPTED.iter().chain(&MISSED).chain(&MUST_BE_RIGHT).chain(&MUST_BE_HEALTHY) {
        assert!(rows.iter().any(|row| row.file == *file), "{file} is not in truth.csv");
    }
    assert!(mistakes.is_empty(), "{}", mistakes.join("\n"));
    let [light, heavy] = unbalances;
    assert!(light.zip(heavy).is_some_and(|(light, heavy)| heavy > light), "{unbalances:?}");
}

/// Orders of a bearing's races and elements: BPFO, BPFI, 2·BSF.
fn orders(elements: f64, ratio: f64) -> [f64; 3] {
    [elements / 2.0 * (1.0 - ratio), elements / 2.0 * (1.0 + ratio), 1.0 / ratio - ratio]
}

/// A machine file whose bearings are others, drawn, with no rate within 4 % of one of these or of a multiple up to the sixth.
fn with_other_bearings(text: &str, real: &[[f64; 3]], draw: &mut impl FnMut() -> f64) -> String {
    let is_apart = |order: f64| {
        let mut multiples =
            real.iter().flatten().flat_map(|r| (1..=6).map(move |h| f64::from(h) * r));
        multiples.all(|real| (order / real - 1.0).abs() >= 0.04)
    };
    let mut other = || loop {
        let (elements, ratio) = (6.0 + (13.0 * draw()).floor(), 0.12 + 0.2 * draw());
        // The elements have room on the pitch circle.
        if elements * ratio < 2.9 && orders(elements, ratio).into_iter().all(is_apart) {
            return (elements, ratio);
        }
    };
    let mut drawn = (0.0, 0.0);
    let lines = text.lines().map(|line| match line.split(" = ").next().unwrap_or_default() {
        "elements" => {
            drawn = other();
            format!("elements = {}\n", drawn.0)
        }
        "element_diameter_mm" => format!("element_diameter_mm = {}\n", 30.0 * drawn.1),
        "pitch_diameter_mm" => "pitch_diameter_mm = 30.0\n".to_owned(),
        _ => format!("{line}\n"),
    });
    lines.collect()
}

#[test]
#[ignore = "needs the real recordings: set ROTORWATCH_DATA"]
fn a_slow_shaft_in_the_machine_file_hides_no_bearing() {
    let Some(data) = data("a_slow_shaft_in_the_machine_file_hides_no_bearing") else { return };
    let mut mistakes = Vec::new();
    for row in truth(&data) {
        let file = row.file.as_str();
        let is_damaged = MUST_BE_RIGHT.contains(&file);
        if !is_damaged && !MUST_BE_HEALTHY.contains(&file) {
            continue;
        }
        let first = file::parse(
            &fs::read_to_string(data.join("machines").join(format!("{}.toml", row.dataset)))
                .unwrap(),
            &row.dataset,
        );
        let first = first.unwrap().shafts[0].id.clone();
        for ratio in [0.1113, 0.0517, 0.0213] {
            let slow = format!(
                "\n[[shaft]]\nid = \"slow\"\nratio_to = {{ shaft = \"{first}\", ratio = {ratio} }}\n"
            );
            let diagnosis = diagnose_beside(&data, &row, &data.join(&row.file), &slow);
            let outcome = score::score(&row.known, &row.acceptable, &diagnosis).unwrap().outcome;
            let bearings = scored(&diagnosis).filter(|c| c.kind == ComponentKind::Bearing);
            let is_open = bearings.filter(|c| c.state == State::Undetermined).count() > 0;
            println!("{:<52} {ratio} {}", row.file, Verdicts(&diagnosis));
            if outcome != Outcome::Right || is_open && !is_damaged {
                mistakes.push(format!("{file}, {ratio}: {}", Verdicts(&diagnosis)));
            }
        }
    }
    assert!(mistakes.is_empty(), "{mistakes:#?}");
}

#[test]
#[ignore = "needs the real recordings: set ROTORWATCH_DATA"]
fn no_bearing_is_accused_that_is_not_there() {
    let Some(data) = data("no_bearing_is_accused_that_is_not_there") else { return };
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let (mut mistakes, mut n_judged) = (Vec::new(), 0);
    for row in truth(&data).iter().filter(|row| WITH_BEARINGS.contains(&&*row.dataset)) {
        let machine_file = data.join("machines").join(format!("{}.toml", row.dataset));
        let text = fs::read_to_string(&machine_file).unwrap();
        let machine = file::parse(&text, &row.dataset).unwrap();
        let real = machine.bearings.iter().filter_map(|b| b.fault_orders());
        let real: Vec<[f64; 3]> = real.map(|o| [o.bpfo, o.bpfi, o.two_bsf()]).collect();
        for _ in 0..N_OTHERS {
            let other = with_other_bearings(&text, &real, &mut || random.random());
            let machine = Some(Arc::new(file::parse(&other, &row.dataset).unwrap()));
            let reference = Reference { machine, ..Reference::default() };
            let capture = data.join(&row.file);
            let diagnosis = offline::diagnose(&capture, &reference, &mut |_| ()).unwrap();
            for bearing in scored(&diagnosis).filter(|c| c.kind == ComponentKind::Bearing) {
                n_judged += 1;
                if bearing.state.is_accusation() {
                    mistakes.push(format!("{}: {}\n{other}", row.file, bearing.why));
                }
            }
        }
    }
    println!("{n_judged} bearings that are not there, {} accused", mistakes.len());
    assert!(n_judged >= 21 * N_OTHERS && mistakes.is_empty(), "{}", mistakes.join("\n"));
}

#[test]
#[ignore = "needs the real recordings: set ROTORWATCH_DATA"]
fn names_and_order_of_files_do_not_matter() {
    let Some(data) = data("names_and_order_of_files_do_not_matter") else { return };
    let folder = tempfile::tempdir().unwrap();
    let rows: Vec<TruthRow> = truth(&data)
        .into_iter()
        .filter(|row| MUST_BE_RIGHT.contains(&&*row.file) || MUST_BE_HEALTHY.contains(&&*row.file))
        .collect();
    assert_eq!(rows.len(), MUST_BE_RIGHT.len() + MUST_BE_HEALTHY.len());
    let first: Vec<Diagnosis> =
        rows.iter().map(|row| diagnose(&data, row, &data.join(&row.file))).collect();
    // Last first, under names that say something else.
    for (at, (row, expected)) in rows.iter().zip(&first).enumerate().rev() {
        let renamed = folder.path().join(format!("{at}_healthy_outer_race_normal.h5"));
        fs::copy(data.join(&row.file), &renamed).unwrap();
        assert_eq!(&diagnose(&data, row, &renamed), expected, "{}", row.file);
        fs::remove_file(&renamed).unwrap();
    }
}

#[test]
#[ignore = "needs the real recordings: set ROTORWATCH_DATA"]
fn a_bearing_run_to_failure_warns_late_and_before_the_end() {
    let Some(data) = data("a_bearing_run_to_failure_warns_late_and_before_the_end") else { return };
    let rows = truth(&data);
    let rows: Vec<&TruthRow> = rows.iter().filter(|row| row.label == "run_to_failure").collect();
    assert!(!rows.is_empty());
    for row in rows {
        let diagnosis = diagnose(&data, row, &data.join(&row.file));
        let timeline = diagnosis.timeline.as_ref().unwrap();
        let life_s = *timeline.time_s.last().unwrap();
        let warned_s = diagnosis.first_warning_s.unwrap();
        println!("{}: first warning at {:.1} % of life", row.file, 100.0 * warned_s / life_s);
        assert!(warned_s > 0.5 * life_s, "{warned_s} s of {life_s} s");
        assert!(diagnosis.state.is_accusation(), "{}", Verdicts(&diagnosis));
        assert!(diagnosis.provisional_baseline.is_some());
    }
}
