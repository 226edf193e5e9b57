//! A diagnosis for an engineer at a terminal.
//!
//! The whole first, then one paragraph a component, the accused ones before the others. Only text:
//! nothing is judged here, and nothing but the page is asked where it will stand.

mod evidence;
mod timeline;

use super::terminal::Page;
use super::terminal::clean;
use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::GearSide;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::diagnosis::verdict::DataQuality;
use crate::diagnosis::verdict::Diagnosis;
use crate::diagnosis::verdict::GearFinding;
use crate::diagnosis::verdict::OperatingState;
use crate::features::speed::SpeedSource;
use crate::html::numbers;

/// How far paragraphs of a component are set in.
const INDENT: usize = 2;

/// What is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// The page.
    pub page: Page,
    /// Evidence of every component, not only of those accused.
    pub all_evidence: bool,
}

/// Sets a diagnosis of `capture` as text; ends with a line break.
#[must_use]
pub fn text(diagnosis: &Diagnosis, capture: &str, layout: &Layout) -> String {
    let page = &layout.page;
    let mut out = String::new();
    let state = page.paint(diagnosis.state, &state_word(diagnosis.state));
    out.push_str(&format!("{}: {state}\n", clean(capture)));
    whole(&mut out, diagnosis, page);
    let parts = ordered(diagnosis, |kind| kind != ComponentKind::Sensor);
    for component in parts {
        out.push('\n');
        paragraph(&mut out, component, layout);
    }
    let sensors = ordered(diagnosis, |kind| kind == ComponentKind::Sensor);
    for component in &sensors {
        out.push('\n');
        paragraph(&mut out, component, layout);
    }
    timeline::append(&mut out, diagnosis, page);
    baselines(&mut out, diagnosis, page);
    if !(diagnosis.notes.is_empty() && diagnosis.warnings.is_empty()) {
        out.push('\n');
    }
    for note in &diagnosis.notes {
        page.hanging(&mut out, 0, INDENT, &clean(&format!("note: {note}")));
    }
    for warning in &diagnosis.warnings {
        page.hanging(&mut out, 0, INDENT, &format!("warning: {warning}"));
    }
    out
}

/// One line on the worst that was found: `bearing right, inner race, severity 0.62, confidence
/// 0.97`; `None` when nothing is accused.
#[must_use]
pub fn accusation(diagnosis: &Diagnosis) -> Option<String> {
    let worst = ordered(diagnosis, |kind| kind != ComponentKind::Sensor).into_iter().next()?;
    if !worst.state.is_accusation() {
        return None;
    }
    let mut text = format!("{} {}, {}", worst.kind.name(), clean(&worst.id), fault_words(worst));
    if let Some(severity) = worst.severity {
        text.push_str(&format!(", severity {severity:.2}"));
    }
    if let Some(confidence) = worst.confidence {
        text.push_str(&format!(", confidence {confidence:.2}"));
    }
    Some(text)
}

/// Components of a kind, worst state first (undetermined last), the accused by falling severity;
/// otherwise as they come.
fn ordered(
    diagnosis: &Diagnosis,
    wanted: impl Fn(ComponentKind) -> bool,
) -> Vec<&ComponentDiagnosis> {
    let mut found: Vec<_> = diagnosis.components.iter().filter(|c| wanted(c.kind)).collect();
    let severity = |c: &ComponentDiagnosis| {
        if c.state.is_accusation() { c.severity.unwrap_or(0.0) } else { 0.0 }
    };
    found.sort_by(|a, b| b.state.cmp(&a.state).then_with(|| severity(b).total_cmp(&severity(a))));
    found
}

fn whole(out: &mut String, diagnosis: &Diagnosis, page: &Page) {
    let d = diagnosis;
    let mut line = format!(
        "machine: {}, {} s, {} samples",
        d.machine,
        numbers::seconds(d.duration_s),
        numbers::count(d.samples_used)
    );
    match d.operating_state {
        OperatingState::Running | OperatingState::Unknown => {}
        OperatingState::Stopped => line.push_str(", not running"),
        OperatingState::Transient => line.push_str(", speed changing"),
    }
    if d.samples_rejected > 0 {
        let why = d.rejected_because.join("; ");
        line.push_str(&format!(
            "; {} samples rejected ({why})",
            numbers::count(d.samples_rejected)
        ));
    }
    page.hanging(out, 0, INDENT, &line);
    page.hanging(out, 0, INDENT, &speed(d));
    page.hanging(out, 0, INDENT, &coverage(d));
    page.hanging(out, 0, INDENT, &sensors(d));
}

fn speed(d: &Diagnosis) -> String {
    let Some(speed) = d.shaft_speed else { return "speed: unknown".to_owned() };
    let source = match d.speed_source {
        Some(SpeedSource::Tacho) => "from the tacho",
        Some(SpeedSource::SpeedChannel) => "from the speed channel",
        Some(SpeedSource::Capture) => "nominal, from the capture",
        Some(SpeedSource::Machine) => "nominal, from the machine file",
        Some(SpeedSource::Option) => "nominal, from --speed",
        Some(SpeedSource::Estimated) => "estimated from shaft harmonics",
        None => "of unknown source",
    };
    let mut text = format!(
        "speed: {:.3} Hz ({:.0} r/min), {source}, confidence {:.2}",
        speed.0,
        speed.to_rpm().0,
        d.speed_confidence
    );
    // The first is the one above.
    for (id, speed) in d.shaft_speeds.iter().skip(1) {
        text.push_str(&format!("; {id} {:.3} Hz", speed.0));
    }
    text
}

fn coverage(d: &Diagnosis) -> String {
    let missing = &d.coverage.undetermined;
    let mut text =
        format!("judged: {} of {} parts", d.coverage.judged, d.coverage.judged + missing.len());
    if !missing.is_empty() {
        text.push_str(&format!("; not judged: {}", missing.join(", ")));
    }
    text
}

fn sensors(d: &Diagnosis) -> String {
    let flawed = d.components.iter().filter(|c| c.kind == ComponentKind::Sensor).count();
    match d.data_quality {
        DataQuality::Ok => "sensors: no flaw found".to_owned(),
        DataQuality::Degraded => format!("sensors: {flawed} with flaws, see below"),
        DataQuality::Bad => "sensors: none is usable, see below".to_owned(),
    }
}

/// State, fault, severity, confidence, why, and the numbers behind it.
fn paragraph(out: &mut String, c: &ComponentDiagnosis, layout: &Layout) {
    let page = &layout.page;
    let state = page.paint(c.state, &state_word(c.state));
    let mut head = format!("{} {}: {state}", c.kind.name(), clean(&c.id));
    if c.state.is_accusation() {
        head.push_str(&format!(", {}", fault_words(c)));
    }
    out.push_str(&head);
    out.push('\n');
    let mut figures = Vec::new();
    figures.extend(c.severity.map(|severity| format!("severity {severity:.2}")));
    figures.extend(c.confidence.map(|confidence| format!("confidence {confidence:.2}")));
    figures.extend(c.gear.as_ref().and_then(gear_words));
    page.paragraph(out, INDENT, &figures.join(", "));
    page.paragraph(out, INDENT, &c.why);
    for other in &c.other_faults {
        let text = format!(
            "also {}, severity {:.2}, confidence {:.2}: {}",
            other.fault.words(),
            other.severity,
            other.confidence,
            other.why
        );
        page.hanging(out, INDENT, 2 * INDENT, &text);
    }
    if layout.all_evidence || c.state.is_accusation() {
        evidence::append(out, &c.evidence, page);
    }
}

fn fault_words(c: &ComponentDiagnosis) -> String {
    c.fault.map_or("cause not proven".to_owned(), FaultMode::words)
}

fn state_word(state: State) -> String {
    match state {
        State::Damaged | State::Warning => state.name().to_uppercase(),
        State::Healthy | State::Undetermined => state.name().to_owned(),
    }
}

fn gear_words(gear: &GearFinding) -> Option<String> {
    let mut found = Vec::new();
    found.extend(gear.member.map(|member| match member {
        GearSide::Driving => "on the driving gear".to_owned(),
        GearSide::Driven => "on the driven gear".to_owned(),
    }));
    found.extend(gear.tooth.map(|tooth| format!("tooth {tooth}")));
    found.extend(gear.angle_deg.map(|angle| format!("{angle:.1}° after the tacho mark")));
    (!found.is_empty()).then(|| found.join(", "))
}

fn baselines(out: &mut String, d: &Diagnosis, page: &Page) {
    if d.baselines.is_empty() && d.provisional_baseline.is_none() {
        return;
    }
    out.push_str("\nbaselines\n");
    for baseline in &d.baselines {
        let used = if baseline.used { "used" } else { "not used" };
        let text = format!("{}: {used}, {}", baseline.name, baseline.reason);
        page.hanging(out, INDENT, 2 * INDENT, &text);
    }
    if let Some(provisional) = &d.provisional_baseline {
        let text = format!("provisional, {provisional}: it can prove change, not health");
        page.hanging(out, INDENT, 2 * INDENT, &text);
    }
}

#[cfg(test)]
mod tests;
