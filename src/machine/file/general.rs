//! The document as a whole: `[machine]`, `[limits]`, `[capture.map]`, and the order of reading.

use std::collections::BTreeMap;

use super::limits;
use super::parts::{self, ShaftDraft};
use super::range::NumberRange;
use super::reader::{Ids, Need, Section, TextRule};
use super::sensors;
use crate::machine::Machine;
use crate::machine::limits::IsoGroup;
use crate::machine::sensor::Sensor;

/// Rule of identifiers: they appear in paths of the HTTP interface and in file names.
pub(crate) const ID: TextRule = TextRule {
    keeps: |text| {
        let allowed = |char: char| char.is_ascii_alphanumeric() || "-_.".contains(char);
        text.len() <= 64
            && text.starts_with(|char: char| char.is_ascii_alphanumeric())
            && text.chars().all(allowed)
    },
    allowed: "an id: 1 to 64 letters, digits, '-', '_' or '.', beginning with a letter or digit",
};

/// Rule of texts for people.
pub(crate) const NAME: TextRule = TextRule {
    keeps: |text| is_plain(text, 200),
    allowed: "1 to 200 characters, no control characters",
};

/// Rule of channel names: they are names of HDF5 data sets.
pub(crate) const CHANNEL: TextRule = TextRule {
    keeps: |text| {
        is_plain(text, 128)
            && !text.contains('/')
            && text.trim() == text
            && text != "."
            && text != ".."
    },
    allowed: "a channel name: 1 to 128 characters without '/', control characters or outer spaces, not '.' or '..'",
};

/// Rule of the places of `[capture.map]`.
const MAP_PLACE: TextRule = TextRule {
    keeps: |text| is_plain(text, 1000) && text.starts_with('/'),
    allowed: "\"/path[,column=K][,rate=HZ][,unit=U]\", up to 1000 characters",
};

/// Whether a text has 1 to `max_chars` characters and no control characters.
pub(super) fn is_plain(text: &str, max_chars: usize) -> bool {
    !text.is_empty()
        && text.len() <= 4 * max_chars
        && text.chars().count() <= max_chars
        && !text.chars().any(char::is_control)
}

/// Reads the whole document; `None` only where mistakes were reported.
///
/// The notes of the machine are left empty.
pub(super) fn read(mut root: Section<'_>) -> Option<Machine> {
    let head = root.table("machine", Need::Required).map(read_head);
    let mut shaft_sections = root.tables("shaft", Need::Required);
    let mut bearing_sections = root.tables("bearing", Need::Optional);
    let motor_sections = root.tables("motor", Need::Optional);
    let mut gear_sections = root.tables("gear", Need::Optional);
    let mut sensor_sections = root.tables("sensor", Need::Optional);
    let limits = root.table("limits", Need::Optional);
    let capture = root.table("capture", Need::Optional);
    let capture_map = capture.map(read_capture).unwrap_or_default();
    root.finish();

    let shaft_ids = Ids::read("shaft", "id", &mut shaft_sections, &ID);
    let bearing_ids = Ids::read("bearing", "id", &mut bearing_sections, &ID);
    let gear_ids = Ids::read("gear", "id", &mut gear_sections, &ID);
    let channels = Ids::read("sensor", "channel", &mut sensor_sections, &CHANNEL);

    let drafts: Vec<ShaftDraft> = shaft_sections
        .into_iter()
        .enumerate()
        .map(|(index, section)| parts::read_shaft(section, index, &shaft_ids))
        .collect();
    let bearings = each(bearing_sections, &bearing_ids, |section, id| {
        parts::read_bearing(section, id, &shaft_ids)
    });
    let motors: Vec<_> =
        motor_sections.into_iter().map(|section| parts::read_motor(section, &shaft_ids)).collect();
    let mut gear_links = Vec::new();
    let gears = each(gear_sections, &gear_ids, |section, id| {
        parts::read_gear(section, id, &shaft_ids, &mut gear_links)
    });
    let places = sensors::Places { shafts: &shaft_ids, bearings: &bearing_ids, gears: &gear_ids };
    let sensors: Vec<Option<Sensor>> = each(sensor_sections, &channels, |section, channel| {
        sensors::read(section, channel, &places)
    });
    let shafts = parts::join_train(drafts, gear_links);

    let parts = limits::Parts {
        shafts: &shaft_ids,
        channels: &channels,
        sensors: &sensors,
        iso_group: head.as_ref().and_then(|(_, _, iso_group, _)| *iso_group),
        speed: shafts.as_ref().and_then(|all| all.first()?.nominal_speed),
    };
    let (limits, alarm_limits) =
        limits.map(|section| limits::read(section, &parts)).unwrap_or_default();

    let (id, name, iso_group, power_kw) = head?;
    let id = id?;
    Some(Machine {
        name: name.unwrap_or_else(|| id.clone()),
        id,
        iso_group,
        power_kw,
        shafts: shafts?,
        bearings: bearings.into_iter().collect::<Option<_>>()?,
        motors: motors.into_iter().collect::<Option<_>>()?,
        gears: gears.into_iter().collect::<Option<_>>()?,
        sensors: sensors.into_iter().collect::<Option<_>>()?,
        limits,
        alarm_limits,
        capture_map,
        notes: Vec::new(),
    })
}

/// Reads every section with its identifier.
fn each<'s, T>(
    sections: Vec<Section<'s>>,
    ids: &Ids<'s>,
    mut read: impl FnMut(Section<'s>, Option<&'s str>) -> Option<T>,
) -> Vec<Option<T>> {
    sections.into_iter().enumerate().map(|(index, section)| read(section, ids.get(index))).collect()
}

/// `[machine]`: id, name, ISO group, power.
type Head = (Option<String>, Option<String>, Option<IsoGroup>, Option<f64>);

fn read_head(mut section: Section<'_>) -> Head {
    let id = section.text("id", Need::Required, &ID).map(str::to_owned);
    let name = section.text("name", Need::Optional, &NAME).map(str::to_owned);
    let iso_group = section.choice("iso_group", Need::Optional, IsoGroup::SPELLINGS);
    let power = NumberRange::positive_up_to(1e7);
    let power_kw = section.number("power_kw", Need::Optional, power);
    section.finish();
    (id, name, iso_group, power_kw)
}

fn read_capture(mut section: Section<'_>) -> BTreeMap<String, String> {
    let map = section.table("map", Need::Optional);
    section.finish();
    map.map(|map| map.texts(&CHANNEL, &MAP_PLACE)).unwrap_or_default()
}
