//! The first page of an evaluation's folder: the tables, and a link to the page of each record.

use crate::diagnosis::fault::State;
use crate::evaluation::interval::Rate;
use crate::evaluation::reliability::Bin;
use crate::evaluation::score::Outcome;
use crate::evaluation::summary::Counts;
use crate::evaluation::summary::Summary;
use crate::html;
use crate::plot::Words;
use crate::plot::chart::Chart;
use crate::plot::chart::Scale;
use crate::plot::escaped;

/// A record as the index lists it.
#[derive(Debug)]
pub(super) struct Listed {
    /// Name of the capture.
    pub(super) file: String,
    /// Its page, relative to the index; `None` without a diagnosis.
    pub(super) page: Option<String>,
    /// Data set and label.
    pub(super) dataset: String,
    pub(super) label: String,
    /// Outcome, and whether the table accepts it; or why there is none.
    pub(super) outcome: Result<(Outcome, bool), String>,
    /// State of the whole.
    pub(super) state: Option<State>,
    /// What is accused, in words.
    pub(super) said: String,
}

/// The page.
pub(super) fn page(truth: &str, summary: &Summary<'_>, records: &[Listed]) -> String {
    let mut body = format!("<h1>Evaluation of {}</h1>\n", escaped(truth));
    body.push_str(&format!(
        "<p class=\"soft\">rotorwatch {}, {} records. What the table accepts counts as right.</p>\n",
        env!("CARGO_PKG_VERSION"),
        records.len()
    ));
    body.push_str("<h2>Outcomes</h2>\n");
    body.push_str(&confusion(summary));
    body.push_str("<h2>Shares</h2>\n");
    body.push_str(&rates(summary));
    body.push_str("<h2>Confidence</h2>\n");
    body.push_str(&reliability(summary));
    body.push_str("<h2>Records</h2>\n");
    body.push_str(&list(records));
    html::document(&format!("Evaluation of {truth}"), &body)
}

fn confusion(summary: &Summary<'_>) -> String {
    let heading = [
        "data set",
        "label",
        "n",
        "right",
        "accepted",
        "detected",
        "undetermined",
        "missed",
        "wrong cause",
        "false alarm",
        "no verdict",
    ];
    let row = |dataset: &str, label: &str, counts: &Counts| {
        let mut row = vec![escaped(dataset), escaped(label)];
        let numbers = [
            counts.scored() + counts.failed,
            counts.of(Outcome::Right),
            counts.accepted,
            counts.of(Outcome::Detected),
            counts.of(Outcome::Undetermined),
            counts.of(Outcome::Missed),
            counts.of(Outcome::WrongCause),
            counts.of(Outcome::FalseAlarm),
            counts.failed,
        ];
        row.extend(numbers.map(|n| if n == 0 { "·".to_owned() } else { n.to_string() }));
        row
    };
    let groups = summary.groups.iter().map(|g| row(&g.dataset, &g.label, &g.counts));
    html::table(&heading, groups.chain([row("all", "", &summary.total)]))
}

fn rates(summary: &Summary<'_>) -> String {
    let rates = &summary.rates;
    let lines = [
        ("right, of all", &rates.right),
        ("right, of those with a fault", &rates.right_of_faulty),
        ("right, of those whose lines stand over the noise", &rates.right_of_visible),
        ("bearing accused, of those whose lines stand over the noise", &rates.found_of_visible),
        ("the same, of lines twice as high as without the defect", &rates.found_of_own),
        ("right or detected, of those with a fault", &rates.found_of_faulty),
        ("wrong cause, of those with a fault", &rates.wrong_cause),
        ("wrong cause at confidence 0.9 or more", &rates.sure_wrong_cause),
        ("false alarm, of the healthy", &rates.false_alarm),
    ];
    let row = |(name, rate): (&str, &Rate)| {
        let (low, high) = rate.interval;
        vec![
            name.to_owned(),
            format!("{} of {}", rate.count, rate.of),
            rate.share().map_or("–".to_owned(), |share| format!("{share:.3}")),
            format!("{low:.3}…{high:.3}"),
        ]
    };
    html::table(
        &["share", "count", "value", "exact 95 %"],
        lines.into_iter().filter(|(_, rate)| rate.of > 0).map(row),
    )
}

/// The reliability diagram: mean confidence against the share that was right.
fn reliability(summary: &Summary<'_>) -> String {
    let filled = |bins: &[Bin]| -> Vec<(f64, f64, (f64, f64))> {
        let point = |bin: &Bin| Some((bin.mean?, bin.right.share()?, bin.right.interval));
        bins.iter().filter_map(point).collect()
    };
    let mut out = String::new();
    for (title, bins) in
        [("Verdicts that accuse", &summary.accusing), ("Verdicts of health", &summary.acquitting)]
    {
        let points = filled(bins);
        let mut lines = vec![("guide", vec![(0.0, 0.0), (1.0, 1.0)])];
        lines.extend(
            points.iter().map(|(x, _, (low, high))| ("line", vec![(*x, *low), (*x, *high)])),
        );
        lines.push(("line", points.iter().map(|(x, y, _)| (*x, *y)).collect()));
        let chart = Chart {
            words: Words { title, x: "confidence given", y: "share right" },
            size: (420.0, 408.0),
            x: (0.0, 1.0),
            y: Scale::Linear(0.0, 1.0),
            lines,
            cursors: Vec::new(),
        };
        let caption = "Classes of confidence with 95 % intervals, by drawing records again and exact ones together; calibrated verdicts lie on the dashed line, and such as say too little above it.";
        if let Some(svg) = chart.svg().filter(|_| !points.is_empty()) {
            out.push_str(&format!(
                "<figure>\n{svg}<figcaption>{caption}</figcaption>\n</figure>\n"
            ));
        }
    }
    out
}

fn list(records: &[Listed]) -> String {
    let row = |record: &Listed| {
        let file = escaped(&record.file);
        let outcome = match &record.outcome {
            Ok((outcome, accepted)) => {
                let accepted = if *accepted { " (accepted)" } else { "" };
                format!("{}{accepted}", outcome.name().replace('_', " "))
            }
            Err(why) => format!("no verdict: {}", escaped(why)),
        };
        vec![
            match &record.page {
                Some(page) => format!("<a href=\"{}\">{file}</a>", escaped(page)),
                None => file,
            },
            escaped(&record.dataset),
            escaped(&record.label),
            outcome,
            record.state.map_or(String::new(), html::state),
            escaped(&record.said),
        ]
    };
    html::table(
        &["capture", "data set", "label", "outcome", "state", "said"],
        records.iter().map(row),
    )
}
