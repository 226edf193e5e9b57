//! A diagnosis as one page for people: what was found, how surely, and the pictures that show why.
//!
//! One HTML document without scripts, fonts or anything else from elsewhere, readable light and dark. [`page`] sets it
//! from a diagnosis, the machine and the samples the verdict rests on. Nothing is judged here. Must not know
//! files, the clock or the command line.

mod envelope;
mod figures;
pub mod numbers;
mod parts;
pub mod recording;

use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::diagnosis::verdict::Diagnosis;
use crate::machine::GearIndex;
use crate::machine::Machine;
use crate::machine::sensor::Location;
use crate::machine::sensor::Sensor;
use crate::machine::sensor::SensorKind;
use crate::plot::escaped;
use envelope::Figure;
pub use parts::state;
use recording::Track;

/// Colours and sizes of every page.
pub const STYLE: &str = include_str!("style.css");

/// Channels of which spectrum and waveform are shown at most.
const CHANNELS_MAX: usize = 4;

/// What a page is made of.
#[derive(Debug, Clone, Copy)]
pub struct Subject<'a> {
    /// Name of the capture.
    pub name: &'a str,
    /// What was said of it.
    pub diagnosis: &'a Diagnosis,
    /// The machine it was judged by.
    pub machine: &'a Machine,
    /// The samples the verdict rests on; without them there are no pictures.
    pub tracks: &'a [Track],
    /// Paragraphs above the verdict, as HTML.
    pub above: &'a str,
}

/// A whole document around a body of HTML.
#[must_use]
pub fn document(title: &str, body: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{}</title>\n\
         <style>\n{STYLE}</style>\n</head>\n<body>\n{body}</body>\n</html>\n",
        escaped(title)
    )
}

/// A table; heading and cells are text and HTML.
#[must_use]
pub fn table(heading: &[&str], rows: impl Iterator<Item = Vec<String>>) -> String {
    let cells = |cells: &mut dyn Iterator<Item = String>, tag: &str| {
        cells.map(|cell| format!("<{tag}>{cell}</{tag}>")).collect::<String>()
    };
    let mut out = "<div class=\"wide\"><table>\n".to_owned();
    let heading = cells(&mut heading.iter().map(|h| escaped(h)), "th");
    out.push_str(&format!("<tr>{heading}</tr>\n"));
    for row in rows {
        out.push_str(&format!("<tr>{}</tr>\n", cells(&mut row.into_iter(), "td")));
    }
    out + "</table></div>\n"
}

/// The page of a diagnosis.
#[must_use]
pub fn page(subject: &Subject<'_>) -> String {
    let d = subject.diagnosis;
    let mut body = parts::head(subject);
    let shaft_hz = d.shaft_speed.map(|speed| speed.0);
    let mut parts: Vec<&ComponentDiagnosis> =
        d.components.iter().filter(|c| c.kind != ComponentKind::Sensor).collect();
    parts.sort_by_key(|c| std::cmp::Reverse(c.state));
    for component in &parts {
        let figure = of_component(component, subject);
        body.push_str(&parts::component(component, figure.as_ref()));
    }
    for component in d.components.iter().filter(|c| c.kind == ComponentKind::Sensor) {
        body.push_str(&parts::component(component, None));
    }
    body.push_str(&parts::timeline(d));
    body.push_str("<h2>Signals</h2>\n");
    for track in shown(&parts, subject) {
        for figure in [figures::waveform(track, shaft_hz), figures::spectrum(track, shaft_hz)] {
            body.push_str(&figure.map_or(String::new(), |figure| parts::figure(&figure)));
        }
    }
    for orbit in figures::orbits(subject.machine, shaft_hz, subject.tracks) {
        body.push_str(&parts::figure(&orbit));
    }
    body.push_str(&parts::foot(d));
    document(&format!("{}: {}", subject.name, d.state.name()), &body)
}

/// The picture that shows a component's verdict.
fn of_component(component: &ComponentDiagnosis, subject: &Subject<'_>) -> Option<Figure> {
    let speeds = &subject.diagnosis.shaft_speeds;
    let machine = subject.machine;
    let speed_of = |shaft: crate::machine::ShaftIndex| {
        let id = &machine.shafts.get(shaft.0)?.id;
        speeds.iter().find(|(name, _)| name == id).map(|(_, speed)| speed.0)
    };
    match component.kind {
        ComponentKind::Bearing => {
            let bearing = machine.bearings.iter().find(|b| b.id == component.id)?;
            envelope::figure(component, machine, speed_of(bearing.shaft)?, subject.tracks)
        }
        ComponentKind::Gear => {
            let at = machine.gears.iter().position(|gear| gear.id == component.id)?;
            let mesh = &machine.gears[at];
            let turns = (speed_of(mesh.driving.shaft)?, speed_of(mesh.driven.shaft)?);
            let mut figure =
                figures::wavelet_map(mesh, turns, hearing(GearIndex(at), component, subject)?)?;
            if component.state == State::Undetermined {
                figure.caption.push_str(OPEN);
            }
            Some(figure)
        }
        ComponentKind::Shaft | ComponentKind::Sensor | ComponentKind::Machine => None,
    }
}

/// What is said of the map of a gear that was not judged.
const OPEN: &str = " It was not judged: what sound teeth leave comes back so, too.";

/// The channel to show of a gear: one that its evidence names, else of a sensor at the mesh, else of any on a housing.
fn hearing<'t>(
    gear: GearIndex,
    component: &ComponentDiagnosis,
    subject: &Subject<'t>,
) -> Option<&'t Track> {
    let is_at = |sensor: &&Sensor| sensor.at == Some(Location::Gear(gear));
    let is_housing =
        |sensor: &&Sensor| matches!(sensor.kind, SensorKind::Accelerometer | SensorKind::Velocity);
    let housings = || subject.machine.sensors.iter().filter(is_housing);
    let sensors = housings().filter(is_at).chain(housings());
    let named = component.evidence.iter().map(|evidence| evidence.channel.as_str());
    let mut names = named.chain(sensors.map(|sensor| sensor.channel.as_str()));
    names.find_map(|name| recording::find(subject.tracks, name))
}

/// Channels worth showing: those the evidence names, then other vibration.
fn shown<'t>(parts: &[&ComponentDiagnosis], subject: &Subject<'t>) -> Vec<&'t Track> {
    let machine = subject.machine;
    let mut names: Vec<&str> = Vec::new();
    let evidence = parts.iter().flat_map(|c| &c.evidence).flat_map(|e| e.channel.split('+'));
    let vibrates = machine.sensors.iter().filter(|s| s.kind.is_vibration());
    for name in evidence.chain(vibrates.map(|s| s.channel.as_str())) {
        if !names.contains(&name) {
            names.push(name);
        }
    }
    let tracks = names.into_iter().filter_map(|name| recording::find(subject.tracks, name));
    tracks.take(CHANNELS_MAX).collect()
}

#[cfg(test)]
mod tests;
