//! What came of an evaluation, as tables for people.

use crate::bench::table;
use crate::bench::table::Cell;
use crate::bench::table::Column;
use crate::cli::terminal::Page;
use crate::cli::terminal::columns;
use crate::evaluation::interval::Rate;
use crate::evaluation::reliability::Bin;
use crate::evaluation::score::Accusation;
use crate::evaluation::score::Outcome;
use crate::evaluation::score::SURE;
use crate::evaluation::summary::Counts;
use crate::evaluation::summary::Record;
use crate::evaluation::summary::Summary;

/// How far lines below a heading are set in.
const INDENT: usize = 2;

/// Lines of a list at most; the document of `--format json` has all.
const LINES_MAX: usize = 60;

/// Sets an evaluation as text; ends with a line break.
pub(super) fn of(records: &[Record], summary: &Summary<'_>, truth: &str, page: &Page) -> String {
    let mut out = String::new();
    page.paragraph(&mut out, 0, &format!("{} records of {truth}", records.len()));
    confusion(&mut out, summary);
    found(&mut out, summary);
    rates(&mut out, summary);
    mistakes(&mut out, summary, page);
    weak(&mut out, records, page);
    open(&mut out, summary, page);
    lives(&mut out, records, page);
    reliability(&mut out, summary);
    failed(&mut out, records, page);
    if let Some(time) = summary.processor {
        out.push_str(&format!(
            "\nprocessor time of a diagnosis: median {:.3} s, longest {:.3} s, all {:.1} s\n",
            time.median_s, time.max_s, time.total_s
        ));
    }
    out
}

/// Outcomes by data set and label.
fn confusion(out: &mut String, summary: &Summary<'_>) {
    let groups = || summary.groups.iter();
    let widest = |texts: &mut dyn Iterator<Item = usize>| texts.max().unwrap_or(0);
    let heading = [
        ("data set", widest(&mut groups().map(|g| columns(&g.dataset)))),
        ("label", widest(&mut groups().map(|g| columns(&g.label)))),
        ("n", 5),
        ("right", 5),
        ("accepted", 8),
        ("detected", 8),
        ("undetermined", 12),
        ("missed", 6),
        ("wrong cause", 11),
        ("false alarm", 11),
        ("no verdict", 10),
        ("right, 95 %", 11),
    ];
    let heading = heading.map(|(name, width)| Column { name, width });
    let row = |dataset: &str, label: &str, counts: &Counts| {
        let number = |n: usize| Cell::Plain(n as f64, 0);
        let right = Rate::new(counts.of(Outcome::Right), counts.scored());
        vec![
            Cell::Text(dataset.to_owned()),
            Cell::Text(label.to_owned()),
            number(counts.scored() + counts.failed),
            number(counts.of(Outcome::Right)),
            number(counts.accepted),
            number(counts.of(Outcome::Detected)),
            number(counts.of(Outcome::Undetermined)),
            number(counts.of(Outcome::Missed)),
            number(counts.of(Outcome::WrongCause)),
            number(counts.of(Outcome::FalseAlarm)),
            number(counts.failed),
            Cell::Text(interval(right.interval)),
        ]
    };
    out.push('\n');
    out.push_str(&table::heading(&heading));
    for group in groups() {
        out.push_str(&table::text_row(&heading, &row(&group.dataset, &group.label, &group.counts)));
    }
    out.push_str(&table::text_row(&heading, &row("all", "", &summary.total)));
    out.push_str(
        "accepted: right only because the table accepts the verdict; counted under right\n",
    );
}

/// Known faults by kind, each by what was said of it.
fn found(out: &mut String, summary: &Summary<'_>) {
    let heading = [
        ("fault", 20),
        ("lines stand out", 15),
        ("n", 5),
        ("named", 5),
        ("detected", 8),
        ("undetermined", 12),
        ("missed", 6),
    ];
    let heading = heading.map(|(name, width)| Column { name, width });
    out.push('\n');
    out.push_str(&table::heading(&heading));
    for found in &summary.found {
        let of = |outcome: Outcome| Cell::Plain(found.outcomes[outcome as usize] as f64, 0);
        let visible = match found.is_visible {
            Some(true) => "yes",
            Some(false) => "no",
            None => "-",
        };
        out.push_str(&table::text_row(
            &heading,
            &[
                Cell::Text(found.fault.to_owned()),
                Cell::Text(visible.to_owned()),
                Cell::Plain(found.outcomes.iter().sum::<usize>() as f64, 0),
                of(Outcome::Right),
                of(Outcome::Detected),
                of(Outcome::Undetermined),
                of(Outcome::Missed),
            ],
        ));
    }
    out.push_str("each known fault by itself, whatever was said of other parts\n");
}

/// Shares of all records.
fn rates(out: &mut String, summary: &Summary<'_>) {
    let rates = &summary.rates;
    let sure = format!("wrong cause at confidence {SURE} or more");
    let lines: [(&str, &Rate); 9] = [
        ("right, of all", &rates.right),
        ("right, of those with a fault", &rates.right_of_faulty),
        ("right, of those whose lines stand out", &rates.right_of_visible),
        ("bearing accused, of those whose lines stand out", &rates.found_of_visible),
        ("the same, twice as high as without the defect", &rates.found_of_own),
        ("right or detected, of those with a fault", &rates.found_of_faulty),
        ("wrong cause, of those", &rates.wrong_cause),
        (&sure, &rates.sure_wrong_cause),
        ("false alarm, of the healthy", &rates.false_alarm),
    ];
    let width = lines.iter().map(|(name, _)| columns(name)).max().unwrap_or(0);
    let heading =
        [("share", width), ("count", 5), ("of", 5), ("share", 6), ("95 %", 13), ("below", 6)];
    let heading = heading.map(|(name, width)| Column { name, width });
    out.push('\n');
    out.push_str(&table::heading(&heading));
    for (name, rate) in lines.into_iter().filter(|(_, rate)| rate.of > 0) {
        out.push_str(&table::text_row(
            &heading,
            &[
                Cell::Text(name.to_owned()),
                Cell::Plain(rate.count as f64, 0),
                Cell::Plain(rate.of as f64, 0),
                rate.share().map_or(Cell::Text("-".to_owned()), |share| Cell::Plain(share, 3)),
                Cell::Text(interval(rate.interval)),
                Cell::Plain(rate.upper_bound, 4),
            ],
        ));
    }
    out.push_str("95 %: exact interval of the true share; below: its one-sided 95 % bound\n");
}

/// Accusations that are wrong, the sure ones apart.
fn mistakes(out: &mut String, summary: &Summary<'_>, page: &Page) {
    let (sure, unsure): (Vec<_>, Vec<_>) =
        summary.mistakes.iter().partition(|m| m.accusation.is_surely_wrong());
    let about = [
        (format!("wrong accusations at confidence {SURE} or more"), sure),
        (format!("wrong accusations at confidence below {SURE}"), unsure),
        ("weaker faults beside the right one".to_owned(), summary.beside.iter().collect()),
    ];
    for (title, mistakes) in about {
        let lines = mistakes.iter().map(|m| {
            let (file, label) = (&m.record.file, &m.record.label);
            format!("{file} ({label}): {}", accusation(m.accusation))
        });
        list(out, &title, lines, page);
    }
}

/// Faults that were called healthy, or accused without a cause; accepted or not.
fn weak(out: &mut String, records: &[Record], page: &Page) {
    for outcome in [Outcome::Missed, Outcome::Detected] {
        let lines = records.iter().filter_map(|record| {
            let score = record.score.as_ref().ok().filter(|s| s.outcome == outcome)?;
            let accepted = if score.accepted { ", accepted" } else { "" };
            let said: Vec<String> = score.accusations.iter().map(accusation).collect();
            let said =
                if said.is_empty() { String::new() } else { format!(": {}", said.join("; ")) };
            Some(format!("{} ({}{accepted}){said}", record.file, record.label))
        });
        list(out, outcome.name(), lines.collect::<Vec<_>>().into_iter(), page);
    }
}

/// What could not be judged, with reasons.
fn open(out: &mut String, summary: &Summary<'_>, page: &Page) {
    let lines = summary.open.iter().map(|open| {
        let score = open.record.score.as_ref().ok();
        let accepted = if score.is_some_and(|s| s.accepted) { ", accepted" } else { "" };
        let (file, label) = (&open.record.file, &open.record.label);
        format!("{file} ({label}{accepted}): {}: {}", open.component, open.why)
    });
    list(out, "undetermined, and of healthy machines what was not judged", lines, page);
}

/// When runs to failure were first warned of.
fn lives(out: &mut String, records: &[Record], page: &Page) {
    let lines = records.iter().filter(|r| r.label == "run_to_failure").filter_map(|record| {
        let score = record.score.as_ref().ok()?;
        let alarm = match score.first_alarm {
            Some(part) => format!("first alarm at {:.1} % of its length", 100.0 * part),
            None => "no alarm".to_owned(),
        };
        Some(format!("{}: {}, {alarm}", record.file, score.outcome.name()))
    });
    list(out, "runs to failure", lines.collect::<Vec<_>>().into_iter(), page);
}

/// The confidence given against the share that was right.
fn reliability(out: &mut String, summary: &Summary<'_>) {
    let heading = [
        ("verdicts", 8),
        ("confidence", 11),
        ("n", 5),
        ("mean given", 10),
        ("share right", 11),
        ("95 %", 13),
        ("mean inside", 11),
    ];
    let heading = heading.map(|(name, width)| Column { name, width });
    out.push('\n');
    out.push_str(&table::heading(&heading));
    for (name, bins) in [("accused", &summary.accusing), ("healthy", &summary.acquitting)] {
        for bin in bins.iter().filter(|bin| bin.right.of > 0) {
            out.push_str(&table::text_row(&heading, &bin_row(name, bin)));
        }
    }
}

fn bin_row(name: &str, bin: &Bin) -> Vec<Cell> {
    let number = |value: Option<f64>| match value {
        Some(value) => Cell::Plain(value, 3),
        None => Cell::Text("-".to_owned()),
    };
    let (low, high) = bin.confidence;
    vec![
        Cell::Text(name.to_owned()),
        Cell::Text(format!("{low:.2}…{high:.2}")),
        Cell::Plain(bin.right.of as f64, 0),
        number(bin.mean),
        number(bin.right.share()),
        Cell::Text(interval(bin.right.interval)),
        Cell::Flag(bin.is_calibrated().unwrap_or(true)),
    ]
}

/// Records without a verdict.
fn failed(out: &mut String, records: &[Record], page: &Page) {
    let lines = records.iter().filter_map(|record| {
        let error = record.score.as_ref().err()?;
        Some(format!("{}: {error}", record.file))
    });
    list(out, "no verdict", lines.collect::<Vec<_>>().into_iter(), page);
}

/// A heading with lines below it; nothing at all without lines, but for wrong accusations.
fn list(out: &mut String, title: &str, lines: impl ExactSizeIterator<Item = String>, page: &Page) {
    let n = lines.len();
    if n == 0 && !title.starts_with("wrong") {
        return;
    }
    out.push_str(&format!(
        "\n{title}: {}\n",
        if n == 0 { "none".to_owned() } else { n.to_string() }
    ));
    for line in lines.take(LINES_MAX) {
        page.hanging(out, INDENT, 2 * INDENT, &line);
    }
    if n > LINES_MAX {
        out.push_str(&format!("  … and {} more, see --format json\n", n - LINES_MAX));
    }
}

/// `bearing de: outer_race, severity 0.62, confidence 0.97`.
fn accusation(accusation: &Accusation) -> String {
    let fault = accusation.fault.map_or("cause not proven", |fault| fault.name());
    let mut text = format!("{} {}: {fault}", accusation.kind.name(), accusation.component);
    if let Some(severity) = accusation.severity {
        text.push_str(&format!(", severity {severity:.2}"));
    }
    if let Some(confidence) = accusation.confidence {
        text.push_str(&format!(", confidence {confidence:.2}"));
    }
    text
}

fn interval((low, high): (f64, f64)) -> String {
    format!("{low:.3}…{high:.3}")
}
