//! The words and tables of a page.

use super::Subject;
use super::envelope::Figure;
use super::numbers;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::diagnosis::verdict::Diagnosis;
use crate::diagnosis::verdict::Evidence;
use crate::plot::Words;
use crate::plot::chart::Chart;
use crate::plot::chart::Cursor;
use crate::plot::chart::Scale;
use crate::plot::escaped;
use crate::units::Unit;

/// Stands where there is no value.
const NOTHING: &str = "–";

/// A state as a word in its colour.
#[must_use]
pub fn state(state: State) -> String {
    format!("<span class=\"state {0}\">{0}</span>", state.name())
}

/// A picture with what is to be said of it.
pub(super) fn figure(figure: &Figure) -> String {
    format!(
        "<figure>\n{}<figcaption>{}</figcaption>\n</figure>\n",
        figure.svg,
        escaped(&figure.caption)
    )
}

/// The whole: name, state, speed, what was judged.
pub(super) fn head(subject: &Subject<'_>) -> String {
    let d = subject.diagnosis;
    let mut out = format!("<h1>{}</h1>\n{}", escaped(subject.name), subject.above);
    out.push_str(&format!("<p>Machine {}: {}</p>\n", escaped(&d.machine), state(d.state)));
    let speed = match (d.shaft_speed, d.speed_source) {
        (Some(speed), Some(source)) => format!(
            "shaft at {:.3} Hz ({:.1} r/min), from: {}, confidence {:.2}",
            speed.0,
            speed.to_rpm().0,
            source.name(),
            d.speed_confidence
        ),
        (Some(_), None) | (None, _) => "speed not known".to_owned(),
    };
    let n_parts = d.coverage.judged + d.coverage.undetermined.len();
    out.push_str(&format!(
        "<p class=\"soft\">{} s, {} samples; {speed}; {}; {} of {n_parts} parts judged; data {}</p>\n",
        numbers::seconds(d.duration_s),
        numbers::count(d.samples_used),
        d.operating_state.name(),
        d.coverage.judged,
        d.data_quality.name()
    ));
    out.push_str(
        "<details><summary>How to read this page</summary>\n<p>Each part of the machine is looked at on its own. \
         <b>Healthy</b>: every fault its sensors can show was looked for and not found. <b>Warning</b> and <b>damaged</b>: \
         a fault stands out of chance and is large enough to matter; a cause that is not proven is not named. \
         <b>Undetermined</b>: the data cannot tell, and the reason is given. Severity, 0 to 1, says how large the effect \
         is; confidence how probable it is that state and fault are right. In the tables a value is held against its \
         threshold, and the false-alarm probability says how often noise alone would do the same, after all that was searched; \
         both must speak before a part is accused.</p></details>\n",
    );
    out
}

/// A component with its numbers and its picture.
pub(super) fn component(c: &ComponentDiagnosis, picture: Option<&Figure>) -> String {
    let fault = match (c.fault, c.state.is_accusation()) {
        (Some(fault), _) => format!(", {}", fault.words()),
        (None, true) => ", cause not proven".to_owned(),
        (None, false) => String::new(),
    };
    let mut out = format!(
        "<section class=\"part\">\n<h2>{} {}: {}{fault}</h2>\n",
        c.kind.name(),
        escaped(&c.id),
        state(c.state)
    );
    if let (Some(severity), Some(confidence)) = (c.severity, c.confidence) {
        out.push_str(&format!(
            "<p class=\"soft\">severity {severity:.2}, confidence {confidence:.2}</p>\n"
        ));
    }
    out.push_str(&format!("<p>{}</p>\n", escaped(&c.why)));
    for other in &c.other_faults {
        out.push_str(&format!(
            "<p>Also {}, severity {:.2}, confidence {:.2}: {}</p>\n",
            other.fault.words(),
            other.severity,
            other.confidence,
            escaped(&other.why)
        ));
    }
    if let Some(gear) = &c.gear
        && let Some(angle) = gear.angle_deg
    {
        let tooth = gear.tooth.map_or(String::new(), |tooth| format!(", tooth {tooth}"));
        out.push_str(&format!("<p>At {angle:.1}° after the tacho mark{tooth}.</p>\n"));
    }
    out.push_str(&evidence(&c.evidence));
    out.push_str(&picture.map_or(String::new(), figure));
    out.push_str("</section>\n");
    out
}

fn evidence(evidence: &[Evidence]) -> String {
    if evidence.is_empty() {
        return String::new();
    }
    let mut out = "<div class=\"wide\"><table>\n<tr><th>indicator</th><th>channel</th><th class=\"n\">Hz</th>\
                   <th class=\"n\">expected Hz</th><th class=\"n\">order</th><th class=\"n\">value</th>\
                   <th class=\"n\">threshold</th><th class=\"n\">false alarm</th></tr>\n"
        .to_owned();
    for e in evidence {
        let hertz = |f: Option<crate::units::Hz>| f.map(|f| format!("{:.2}", f.0));
        let unit =
            if e.unit == Unit::One { String::new() } else { format!(" {}", e.unit.symbol()) };
        let detector = e.detector.filter(|_| e.unit != Unit::One);
        let detector = detector.map_or(String::new(), |d| format!(" {}", d.name()));
        let numbers = [
            hertz(e.frequency),
            hertz(e.expected),
            e.order.map(|order| format!("{order:.3}")),
            Some(format!("{}{unit}{detector}", numbers::significant(e.value))),
            e.threshold.map(|t| format!("{}{unit}", numbers::significant(t))),
            e.false_alarm_probability.map(numbers::probability),
        ];
        let (indicator, channel) = (escaped(&e.indicator), escaped(&e.channel));
        out.push_str(&format!("<tr><td>{indicator}</td><td>{channel}</td>"));
        for number in numbers {
            let number = number.map_or(NOTHING.to_owned(), |n| escaped(&n));
            out.push_str(&format!("<td class=\"n\">{number}</td>"));
        }
        out.push_str("</tr>\n");
    }
    out + "</table></div>\n"
}

/// The state over time, for captures of several windows.
pub(super) fn timeline(d: &Diagnosis) -> String {
    let Some(timeline) = &d.timeline else { return String::new() };
    let (Some(first_s), Some(last_s)) = (timeline.time_s.first(), timeline.time_s.last()) else {
        return String::new();
    };
    let level = |state: &State| match state {
        State::Undetermined => 0.0,
        State::Healthy => 1.0,
        State::Warning => 2.0,
        State::Damaged => 3.0,
    };
    let points = timeline.time_s.iter().copied().zip(timeline.state.iter().map(level)).collect();
    let mark = |time_s: Option<f64>, label: &str| {
        time_s.map(|x| Cursor { x, label: label.to_owned(), class: "found" })
    };
    let svg = Chart {
        words: Words {
            title: "State over time",
            x: "time (s)",
            y: "0 open, 1 healthy, 2 warning, 3 damaged",
        },
        size: (860.0, 260.0),
        x: (*first_s, *last_s),
        y: Scale::Linear(-0.2, 3.2),
        lines: vec![("line", points)],
        cursors: [
            mark(d.first_warning_s, "first warning"),
            mark(d.first_damaged_s, "first damage"),
        ]
        .into_iter()
        .flatten()
        .collect(),
    }
    .svg();
    svg.map_or(String::new(), |svg| {
        let caption = format!(
            "{} windows; marked is where a warning, and damage, begins that lasts.",
            timeline.time_s.len()
        );
        figure(&Figure { svg, caption })
    })
}

/// Baselines, notes and warnings.
pub(super) fn foot(d: &Diagnosis) -> String {
    let mut lines: Vec<String> = Vec::new();
    for baseline in &d.baselines {
        let used = if baseline.used { "used" } else { "not used" };
        lines.push(format!("baseline {}: {used}, {}", baseline.name, baseline.reason));
    }
    lines.extend(d.provisional_baseline.iter().map(|name| format!("provisional baseline: {name}")));
    lines.extend(
        d.rejected_because
            .iter()
            .map(|why| format!("{} samples rejected: {why}", numbers::count(d.samples_rejected))),
    );
    lines.extend(d.warnings.iter().map(|warning| format!("warning: {warning}")));
    lines.extend(d.notes.iter().map(|note| format!("note: {note}")));
    if lines.is_empty() {
        return String::new();
    }
    let items: String = lines.iter().map(|line| format!("<li>{}</li>\n", escaped(line))).collect();
    format!("<h2>Remarks</h2>\n<ul class=\"soft\">\n{items}</ul>\n")
}
