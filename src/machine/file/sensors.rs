//! `[[sensor]]`: what a channel measures, where and in which direction.

use super::general::is_plain;
use super::parts::ANGLE_DEG;
use super::range::NumberRange;
use super::reader::{Ids, Need, Section, TextRule};
use crate::machine::nearest::suggestion;
use crate::machine::sensor::{Direction, Location, Sensor, SensorKind, TachoEdge, TachoMark};
use crate::machine::{BearingIndex, GearIndex, ShaftIndex};
use crate::units::{Hz, SourceUnit, Unit};

/// Frequencies of a usable band.
const USABLE_HZ: NumberRange = NumberRange::closed(0.0, 1e7);

/// Volts per unit, either polarity; zero is refused apart.
const SENSITIVITY: NumberRange = NumberRange::closed(-1e6, 1e6);

/// Gap voltages of probes.
const GAP_V: NumberRange = NumberRange::closed(-100.0, 100.0);

const MAX_PULSES_PER_REV: u32 = 100_000;

/// Rule of the units of process values, which the monitor only shows.
const PROCESS_UNIT: TextRule =
    TextRule { keeps: |text| is_plain(text, 32), allowed: "any unit, 1 to 32 characters" };

/// Any text: the rule of units is worded by kind.
const ANY_TEXT: TextRule = TextRule { keeps: |_| true, allowed: "a unit as text" };

/// The identifiers a sensor's place may name.
pub(super) struct Places<'p, 's> {
    pub(super) shafts: &'p Ids<'s>,
    pub(super) bearings: &'p Ids<'s>,
    pub(super) gears: &'p Ids<'s>,
}

pub(super) fn read<'s>(
    mut section: Section<'s>,
    channel: Option<&'s str>,
    places: &Places<'_, 's>,
) -> Option<Sensor> {
    let kind = section.choice("kind", Need::Required, SensorKind::SPELLINGS);
    let unit = read_unit(&mut section, kind);
    let at = read_place(&mut section, kind, places);
    let axis_deg = section.number("axis_deg", Need::Optional, ANGLE_DEG);
    let directions = [("radial", Direction::Radial), ("axial", Direction::Axial)];
    let direction = section.choice("direction", Need::Optional, &directions);
    let usable = section.interval("usable_hz", USABLE_HZ);
    let sensitivity = section.number("sensitivity_v_per_unit", Need::Optional, SENSITIVITY);
    let gap_v = section.interval("gap_v", GAP_V);
    let tacho = read_tacho(&mut section, kind);
    if let Some(kind) = kind {
        check_gap(&section, kind, unit.as_ref());
        check_direction(&section, kind, direction);
        check_sensitivity(&section, kind, unit.as_ref(), sensitivity);
    }
    section.finish();
    Some(Sensor {
        channel: channel?.to_owned(),
        kind: kind?,
        unit,
        at,
        axis_deg,
        direction,
        usable: usable.map(|(low, high)| (Hz(low), Hz(high))),
        sensitivity_v_per_unit: sensitivity,
        gap_v,
        tacho,
    })
}

/// Units of [`SourceUnit::ACCEPTED`] that fit a kind; `None`: any text does.
fn fitting_units(kind: SensorKind) -> Option<Vec<&'static str>> {
    let physical = match kind {
        SensorKind::Load | SensorKind::Temperature | SensorKind::Process => return None,
        SensorKind::Accelerometer
        | SensorKind::Velocity
        | SensorKind::Proximitor
        | SensorKind::Speed
        | SensorKind::Tacho => kind.canonical_unit(),
    };
    let fits = |name: &&str| {
        let unit = SourceUnit::parse(name).map(|unit| unit.canonical);
        unit == Some(Unit::Volt) || (unit.is_some() && unit == physical)
    };
    Some(SourceUnit::ACCEPTED.iter().copied().filter(fits).collect())
}

fn read_unit(section: &mut Section<'_>, kind: Option<SensorKind>) -> Option<(String, SourceUnit)> {
    let Some(fitting) = kind.map_or_else(|| Some(SourceUnit::ACCEPTED.to_vec()), fitting_units)
    else {
        let text = section.text("unit", Need::Optional, &PROCESS_UNIT)?;
        return Some((text.to_owned(), SourceUnit::parse(text).unwrap_or(SourceUnit::UNKNOWN)));
    };
    let text = section.text("unit", Need::Optional, &ANY_TEXT)?;
    let unit = SourceUnit::parse(text).filter(|_| fitting.contains(&text));
    // Without a valid kind, a wrong unit may be a right one of the kind that was meant.
    if unit.is_none() && kind.is_some() {
        let of_kind = kind.map_or("", SensorKind::name);
        let hint = suggestion(text, fitting.iter().copied());
        section.refuse("unit", format!("for kind {of_kind}: {}{hint}", fitting.join(", ")));
    }
    unit.map(|unit| (text.to_owned(), unit))
}

/// Reads `at`. A tacho or speed sensor sits at a shaft: the first unless another is named.
fn read_place<'s>(
    section: &mut Section<'s>,
    kind: Option<SensorKind>,
    places: &Places<'_, 's>,
) -> Option<Location> {
    let observes_shaft = matches!(kind, Some(SensorKind::Tacho | SensorKind::Speed));
    let vibrates = kind.is_some_and(SensorKind::is_vibration);
    let need = if vibrates { Need::Required } else { Need::Optional };
    let Some(mut at) = section.table("at", need) else {
        let default = observes_shaft && !section.has("at");
        return default.then_some(Location::Shaft(ShaftIndex(0)));
    };
    let shaft = at.reference("shaft", Need::Optional, places.shafts);
    let (bearing, gear) = if observes_shaft {
        (None, None)
    } else {
        (
            at.reference("bearing", Need::Optional, places.bearings),
            at.reference("gear", Need::Optional, places.gears),
        )
    };
    let named = ["shaft", "bearing", "gear"].iter().filter(|key| at.has(key)).count();
    if named != 1 && !observes_shaft {
        let found = if named == 0 { "no place" } else { "several places" };
        let allowed = "one of { bearing = \"id\" }, { shaft = \"id\" }, { gear = \"id\" }";
        at.log().report_derived(section.at("at"), at.path().to_owned(), found, allowed);
    } else if observes_shaft && !at.has("shaft") {
        at.missing("shaft", "the id of the [[shaft]] whose turns it observes");
    }
    at.finish();
    let shaft = shaft.map(|index| Location::Shaft(ShaftIndex(index)));
    let bearing = bearing.map(|index| Location::Bearing(BearingIndex(index)));
    shaft.or(bearing).or(gear.map(|index| Location::Gear(GearIndex(index))))
}

/// Reads the keys of a tacho, which are no keys of any other kind.
fn read_tacho(section: &mut Section<'_>, kind: Option<SensorKind>) -> Option<TachoMark> {
    let edges = [("rising", TachoEdge::Rising), ("falling", TachoEdge::Falling)];
    let pulses = section.whole("pulses_per_rev", Need::Optional, 1..=MAX_PULSES_PER_REV);
    let edge = section.choice("edge", Need::Optional, &edges);
    let offset_deg = section.number("offset_deg", Need::Optional, ANGLE_DEG);
    match kind {
        Some(SensorKind::Tacho) => Some(TachoMark {
            pulses_per_rev: pulses.unwrap_or(1),
            edge: edge.unwrap_or(TachoEdge::Rising),
            offset_deg: offset_deg.unwrap_or(0.0),
        }),
        Some(other) => {
            for key in ["pulses_per_rev", "edge", "offset_deg"] {
                refuse_if_present(section, key, other, "only for kind tacho");
            }
            None
        }
        None => None,
    }
}

fn check_direction(section: &Section<'_>, kind: SensorKind, direction: Option<Direction>) {
    if !kind.is_vibration() {
        for key in ["axis_deg", "direction"] {
            let reason = "only for kinds accelerometer, velocity and proximitor";
            refuse_if_present(section, key, kind, reason);
        }
    } else if direction == Some(Direction::Axial) && section.has("axis_deg") {
        let allowed =
            "no such key beside direction = \"axial\": it lies in the plane normal to the shaft";
        section.refuse("axis_deg", allowed);
    }
}

fn check_sensitivity(
    section: &Section<'_>,
    kind: SensorKind,
    unit: Option<&(String, SourceUnit)>,
    sensitivity: Option<f64>,
) {
    const KEY: &str = "sensitivity_v_per_unit";
    if !section.has(KEY) {
        return;
    }
    let Some(physical) = kind.canonical_unit() else {
        refuse_if_present(section, KEY, kind, "only for kinds with a physical unit of their own");
        return;
    };
    let volts = unit.is_some_and(|(_, unit)| unit.canonical == Unit::Volt);
    let unit_refused = unit.is_none() && section.has("unit");
    if sensitivity == Some(0.0) {
        section.refuse(KEY, format!("a number other than 0, V per {}", physical.symbol()));
    } else if !volts && !unit_refused {
        section.refuse(KEY, "only beside unit = \"V\"");
    }
}

fn check_gap(section: &Section<'_>, kind: SensorKind, unit: Option<&(String, SourceUnit)>) {
    const KEY: &str = "gap_v";
    let volts = unit.is_some_and(|(_, unit)| unit.canonical == Unit::Volt);
    let unit_refused = unit.is_none() && section.has("unit");
    if kind != SensorKind::Proximitor {
        refuse_if_present(section, KEY, kind, "only for kind proximitor");
    } else if section.has(KEY) && !volts && !unit_refused {
        section.refuse(KEY, "only beside unit = \"V\"");
    }
}

fn refuse_if_present(section: &Section<'_>, key: &str, kind: SensorKind, reason: &str) {
    if section.has(key) {
        section.refuse(key, format!("no such key for kind {} ({reason})", kind.name()));
    }
}
