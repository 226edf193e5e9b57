//! The turning parts: `[[shaft]]`, `[[bearing]]`, `[[motor]]`, `[[gear]]`, and the train they form.

use super::general::is_plain;
use super::range::NumberRange;
use super::reader::{Ids, Need, Section, TextRule};
use crate::machine::ShaftIndex;
use crate::machine::bearing::{Bearing, BearingGeometry, MIN_ELEMENTS, RotatingRing};
use crate::machine::catalogue;
use crate::machine::gear::{GearMember, GearMesh};
use crate::machine::motor::Motor;
use crate::machine::shaft::{Rotation, Shaft};
use crate::machine::train::{self, Link, TrainConflict};
use crate::machine::uncertainty::OrderBands;
use crate::units::Hz;

const SPEED_HZ: NumberRange = NumberRange::positive_up_to(10_000.0);
const FREQUENCY_HZ: NumberRange = NumberRange::positive_up_to(100_000.0);
const RATIO: NumberRange = NumberRange::closed(1e-4, 1e4);
const DIAMETER_MM: NumberRange = NumberRange::positive_up_to(20_000.0);
const CONTACT_ANGLE_DEG: NumberRange = NumberRange::from_to_below(0.0, 90.0);
pub(super) const ANGLE_DEG: NumberRange = NumberRange::closed(-360.0, 360.0);

const MAX_ELEMENTS: u32 = 1000;
const MAX_TEETH: u32 = 10_000;
const MAX_POLES: u32 = 1000;

/// Keys of a geometry, all needed if one is there.
const GEOMETRY_KEYS: [&str; 3] = ["elements", "element_diameter_mm", "pitch_diameter_mm"];

const CATALOGUE: TextRule = TextRule {
    keeps: |text| is_plain(text, 100),
    allowed: "a maker's designation, e.g. \"SKF 6205\", 1 to 100 characters",
};

/// A shaft as the file states it, before the train is solved.
pub(super) struct ShaftDraft<'s> {
    section: Section<'s>,
    shaft: Option<Shaft>,
    stated: Option<Hz>,
    link: Option<Link>,
}

/// A mesh as link of the train, with the table that states it.
pub(super) struct GearLink<'s> {
    section: Section<'s>,
    link: Link,
}

pub(super) fn read_shaft<'s>(
    mut section: Section<'s>,
    index: usize,
    shafts: &Ids<'s>,
) -> ShaftDraft<'s> {
    let rotations = [("ccw", Rotation::Ccw), ("cw", Rotation::Cw)];
    let stated = section.number("speed_hz", Need::Optional, SPEED_HZ).map(Hz);
    let rotation = section.choice("rotation", Need::Optional, &rotations);
    let first_critical = section.number("first_critical_hz", Need::Optional, FREQUENCY_HZ);
    let running_above = section.table("running", Need::Optional).and_then(|mut running| {
        let above = NumberRange::closed(0.0, 10_000.0);
        let above_hz = running.number("above_hz", Need::Required, above);
        running.finish();
        above_hz
    });
    let link = section.table("ratio_to", Need::Optional).and_then(|mut ratio_to| {
        let from = ratio_to.reference("shaft", Need::Required, shafts);
        let ratio = ratio_to.number("ratio", Need::Required, RATIO);
        if from == Some(index) {
            ratio_to.refuse("shaft", "the id of another [[shaft]]");
        }
        ratio_to.finish();
        let from = from.filter(|&from| from != index)?;
        Some(Link { from: ShaftIndex(from), to: ShaftIndex(index), ratio: ratio? })
    });
    section.finish();
    let shaft = shafts.get(index).map(|id| Shaft {
        id: id.to_owned(),
        ratio_to_first: None,
        nominal_speed: None,
        rotation,
        first_critical: first_critical.map(Hz),
        running_above: running_above.map(Hz),
    });
    ShaftDraft { section, shaft, stated, link }
}

/// Solves the train and finishes the shafts; `None` after contradictions, which it reports.
pub(super) fn join_train(
    drafts: Vec<ShaftDraft<'_>>,
    gear_links: Vec<GearLink<'_>>,
) -> Option<Vec<Shaft>> {
    let stated: Vec<Option<Hz>> = drafts.iter().map(|draft| draft.stated).collect();
    let shaft_links =
        drafts.iter().filter_map(|draft| draft.link.map(|link| (&draft.section, "ratio_to", link)));
    let mesh_links = gear_links.iter().map(|mesh| (&mesh.section, "driving", mesh.link));
    let sources: Vec<(&Section<'_>, &str, Link)> = shaft_links.chain(mesh_links).collect();
    let links: Vec<Link> = sources.iter().map(|&(_, _, link)| link).collect();
    let solved = train::solve(&stated, &links);
    for conflict in solved.as_ref().err().into_iter().flatten() {
        report_conflict(conflict, &drafts, &sources);
    }
    let shafts = drafts.into_iter().map(|draft| draft.shaft).collect::<Option<Vec<_>>>();
    let (mut shafts, speeds) = (shafts?, solved.ok()?);
    for (shaft, speed) in shafts.iter_mut().zip(speeds) {
        shaft.ratio_to_first = speed.ratio_to_first;
        shaft.nominal_speed = speed.nominal;
    }
    Some(shafts)
}

fn report_conflict(
    conflict: &TrainConflict,
    drafts: &[ShaftDraft<'_>],
    sources: &[(&Section<'_>, &str, Link)],
) {
    let name = |shaft: ShaftIndex| {
        let shaft = drafts.get(shaft.0).and_then(|draft| draft.shaft.as_ref());
        shaft.map_or("?", |shaft| shaft.id.as_str())
    };
    match *conflict {
        TrainConflict::Ratio { link, stated, by_other_path } => {
            let (section, key, Link { from, to, .. }) = sources[link];
            section.log().report_derived(
                section.at(key),
                section.path_of(key),
                format!("a speed ratio {}/{} of {stated}", name(to), name(from)),
                format!("{by_other_path}, which the other ratios and gears make it"),
            );
        }
        TrainConflict::Extreme { link } => {
            let (section, key, _) = sources[link];
            section.log().report_derived(
                section.at(key),
                section.path_of(key),
                "a train whose shafts differ in speed beyond measure",
                format!("speed ratios up to {} in the whole machine", train::MAX_RATIO),
            );
        }
        TrainConflict::Speed { shaft, stated, believed, by_train } => {
            let section = &drafts[shaft.0].section;
            section.log().report_derived(
                section.at("speed_hz"),
                section.path_of("speed_hz"),
                stated.0.to_string(),
                format!(
                    "{} within 2 %, which follows from the speed of {} through ratios and gears",
                    by_train.0,
                    name(believed)
                ),
            );
        }
    }
}

pub(super) fn read_bearing<'s>(
    mut section: Section<'s>,
    id: Option<&'s str>,
    shafts: &Ids<'s>,
) -> Option<Bearing> {
    let rings = [("inner", RotatingRing::Inner), ("outer", RotatingRing::Outer)];
    let shaft = section.reference("shaft", Need::Required, shafts);
    let catalogue = section.text("catalogue", Need::Optional, &CATALOGUE);
    let ring = section.choice("rotating_ring", Need::Optional, &rings);
    let ring = ring.unwrap_or(RotatingRing::Inner);
    let stated = read_geometry(&mut section);
    let found = catalogue.and_then(|text| look_up(&section, text, stated.as_ref(), ring));
    section.finish();
    let (geometry, bands) = match (stated, found) {
        (Some(stated), _) => (Some(stated), OrderBands::default()),
        (None, Some((geometry, bands))) => (Some(geometry), bands),
        (None, None) => (None, OrderBands::default()),
    };
    Some(Bearing {
        id: id?.to_owned(),
        shaft: ShaftIndex(shaft?),
        catalogue: catalogue.map(str::to_owned),
        geometry,
        bands,
        rotating_ring: ring,
    })
}

/// Looks a designation up. Beside a stated geometry it only warns when the two disagree; alone it
/// gives the geometry and its limits, or is a mistake.
fn look_up(
    section: &Section<'_>,
    text: &str,
    stated: Option<&BearingGeometry>,
    ring: RotatingRing,
) -> Option<(BearingGeometry, OrderBands)> {
    let resolved = catalogue::resolve(text);
    let note = |remark: &str| section.log().note(section.at("catalogue"), section.path(), remark);
    match (resolved, stated) {
        (Ok(resolved), Some(stated)) => {
            if let Some(how) = resolved.disagreement(stated, ring) {
                note(&format!(
                    "the geometry differs from that of {} in the catalogue beyond its limits: {how}",
                    resolved.designation
                ));
            }
            None
        }
        (Err(_), Some(_)) => None,
        // What is wrong with the geometry has been told.
        (_, None) if GEOMETRY_KEYS.iter().any(|key| section.has(key)) => None,
        (Ok(resolved), None) => {
            note(&resolved.note(ring));
            Some((resolved.geometry, resolved.bands(ring)))
        }
        (Err(why), None) => {
            let keys = GEOMETRY_KEYS.join(", ");
            let allowed = format!(
                "a designation that `rotorwatch bearings` lists, or the geometry ({keys}): {why}"
            );
            section.refuse("catalogue", allowed);
            None
        }
    }
}

/// Reads the geometry: all of it, or none beside a catalogue designation.
fn read_geometry(section: &mut Section<'_>) -> Option<BearingGeometry> {
    let keys = GEOMETRY_KEYS;
    let stated = keys.iter().any(|key| section.has(key));
    let catalogue = section.has("catalogue");
    let need = if stated { Need::Required } else { Need::Optional };
    let elements = section.whole("elements", need, MIN_ELEMENTS..=MAX_ELEMENTS);
    let element_mm = section.number("element_diameter_mm", need, DIAMETER_MM);
    let pitch_mm = section.number("pitch_diameter_mm", need, DIAMETER_MM);
    let angle_deg = section.number("contact_angle_deg", Need::Optional, CONTACT_ANGLE_DEG);
    let angle_refused = section.has("contact_angle_deg") && angle_deg.is_none();
    if !stated && !catalogue {
        let allowed = format!("catalogue, or the geometry: {}", keys.join(", "));
        section.missing("elements", allowed);
    }
    let remark = match (stated, catalogue) {
        (true, true) => Some("the geometry is used, the catalogue designation is only a label"),
        (false, true) if section.has("contact_angle_deg") => {
            Some("contact_angle_deg is not used: the catalogue designation decides")
        }
        _ => None,
    };
    if let Some(remark) = remark {
        section.log().note(section.at("catalogue"), section.path(), remark);
    }
    let (elements, element_mm, pitch_mm) = (elements?, element_mm?, pitch_mm?);
    if angle_refused {
        return None;
    }
    let angle_rad = angle_deg.unwrap_or(0.0).to_radians();
    match BearingGeometry::new(elements, element_mm * 1e-3, pitch_mm * 1e-3, angle_rad) {
        Ok(geometry) => Some(geometry),
        Err(error) => {
            section.refuse("element_diameter_mm", format!("a smaller diameter: {error}"));
            None
        }
    }
}

pub(super) fn read_motor<'s>(mut section: Section<'s>, shafts: &Ids<'s>) -> Option<Motor> {
    let shaft = section.reference("shaft", Need::Required, shafts);
    let poles = section.whole("poles", Need::Required, 2..=MAX_POLES);
    if poles.is_some_and(|poles| poles % 2 == 1) {
        section.refuse("poles", format!("an even number from 2 to {MAX_POLES}"));
    }
    let line_frequency = section.number("line_frequency_hz", Need::Optional, SPEED_HZ).map(Hz);
    let synchronous = section.flag("synchronous").unwrap_or(false);
    if synchronous && section.has("line_frequency_hz") {
        section.refuse(
            "line_frequency_hz",
            "no such key beside synchronous = true, whose line frequency is poles/2 times the speed",
        );
    }
    section.finish();
    Some(Motor { shaft: ShaftIndex(shaft?), poles: poles?, line_frequency, synchronous })
}

pub(super) fn read_gear<'s>(
    mut section: Section<'s>,
    id: Option<&'s str>,
    shafts: &Ids<'s>,
    links: &mut Vec<GearLink<'s>>,
) -> Option<GearMesh> {
    let driving = section.table("driving", Need::Required);
    let driving = driving.and_then(|member| read_member(member, shafts));
    let driven_section = section.table("driven", Need::Required);
    let driven = driven_section.and_then(|member| read_member(member, shafts));
    section.finish();
    let (driving, driven) = (driving?, driven?);
    if driving.shaft == driven.shaft {
        section.log().report(
            section.at("driven"),
            section.path_of("driven.shaft"),
            "the shaft of the driving gear",
            "the id of another [[shaft]]",
        );
        return None;
    }
    let (from, to) = (driving.shaft, driven.shaft);
    let mesh = GearMesh { id: id?.to_owned(), driving, driven };
    links.push(GearLink { section, link: Link { from, to, ratio: mesh.speed_ratio() } });
    Some(mesh)
}

fn read_member<'s>(mut section: Section<'s>, shafts: &Ids<'s>) -> Option<GearMember> {
    let shaft = section.reference("shaft", Need::Required, shafts);
    let teeth = section.whole("teeth", Need::Required, 1..=MAX_TEETH);
    let tooth_1_at_deg = section.number("tooth_1_at_deg", Need::Optional, ANGLE_DEG);
    section.finish();
    Some(GearMember { shaft: ShaftIndex(shaft?), teeth: teeth?, tooth_1_at_deg })
}
