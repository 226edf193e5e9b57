//! What a file of another layout says of the whole recording: start, speed, machine.
//!
//! `@start_time` and `@shaft_speed` of the map are used or refused; root attributes of our names are
//! used if they are right and noted if not.

use super::mapped::entry_error;
use super::places::{Places, Problem};
use super::spelling;
use crate::capture::error::CaptureError;
use crate::capture::hdf5::Attribute;
use crate::capture::layout::{MAX_SPEED_HZ, start_time_of};
use crate::capture::map::{self, ChannelMap, MapEntry, Place, TextAt};
use crate::capture::root;
use crate::machine::file;
use crate::signal::Timestamp;
use crate::units::{Hz, Rpm};

/// What holds for all channels.
pub(super) struct Facts {
    pub(super) start_time: Option<Timestamp>,
    pub(super) machine: Option<String>,
    pub(super) shaft_speed: Option<Hz>,
    /// Names of root attributes that are not used.
    pub(super) others: Vec<String>,
    /// Root attributes of our names that are wrong.
    pub(super) notes: Vec<String>,
}

/// Reads the facts.
pub(super) fn read(places: Places<'_>, map: &ChannelMap) -> Result<Facts, CaptureError> {
    const KNOWN: [&str; 3] = ["start_time", "machine", "shaft_speed_hz"];
    let mut facts = Facts {
        start_time: None,
        machine: None,
        shaft_speed: None,
        others: Vec::new(),
        notes: Vec::new(),
    };
    for name in root::attributes(places.checks.path)?.into_keys() {
        if !KNOWN.contains(&name.as_str()) {
            facts.others.push(name);
            continue;
        }
        let Ok(value) = places.attribute("/", &name) else { continue };
        if !facts.take(&name, &value) {
            let found = value.describe();
            facts.notes.push(format!("root attribute {name} is {found}: not used"));
        }
    }
    let mapped = |name: &str| map.get(name).map(|entry| (name.to_owned(), entry));
    if let Some((name, entry)) = mapped(map::SHAFT_SPEED) {
        let speed = shaft_speed(places, entry);
        let failed = |e| entry_error(places.checks, &entry.origin, &name, e);
        facts.shaft_speed = Some(speed.map_err(failed)?);
    }
    if let Some((name, entry)) = mapped(map::START_TIME) {
        let time = start_time(places, entry);
        let failed = |e| entry_error(places.checks, &entry.origin, &name, e);
        facts.start_time = Some(time.map_err(failed)?);
    }
    Ok(facts)
}

impl Facts {
    /// Uses a root attribute of one of our names, if it is right.
    fn take(&mut self, name: &str, value: &Attribute) -> bool {
        match (name, value) {
            ("start_time", Attribute::Text(text)) => self.start_time = start_time_of(text),
            ("machine", Attribute::Text(text)) if file::parse(text, "").is_ok() => {
                self.machine = Some(text.clone());
                return true;
            }
            ("shaft_speed_hz", Attribute::Number(speed))
                if (0.0..=MAX_SPEED_HZ).contains(speed) =>
            {
                self.shaft_speed = Some(Hz(*speed));
                return true;
            }
            _ => return false,
        }
        self.start_time.is_some()
    }
}

/// The place an entry of the whole recording names.
fn place(entry: &MapEntry) -> Result<Place, Problem> {
    Place::parse(&entry.path)
        .ok_or_else(|| format!("{}; expected /path or /path@attribute", entry.path).into())
}

fn shaft_speed(places: Places<'_>, entry: &MapEntry) -> Result<Hz, Problem> {
    let unit = match &entry.unit {
        None => "Hz".to_owned(),
        Some(TextAt::Value(text)) => text.clone(),
        Some(TextAt::At(at)) => places.text(at, None)?,
    };
    let place = place(entry)?;
    let value = places.number(&place, None)?;
    let speed = match spelling::unit(&unit) {
        Some("Hz") => Hz(value),
        Some("rpm") => Rpm(value).to_hz(),
        _ => return Err(format!("unit={unit}; a speed is in Hz or rpm").into()),
    };
    if (0.0..=MAX_SPEED_HZ).contains(&speed.0) {
        return Ok(speed);
    }
    Err(format!("{} Hz; expected 0 (standstill) to {MAX_SPEED_HZ}", speed.0).into())
}

fn start_time(places: Places<'_>, entry: &MapEntry) -> Result<Timestamp, Problem> {
    let place = place(entry)?;
    let text = places.text(&place, None)?;
    start_time_of(&text).ok_or_else(|| {
        let found = Attribute::Text(text).describe();
        format!("{found}; expected an RFC 3339 time such as 2026-03-01T12:00:00Z").into()
    })
}
