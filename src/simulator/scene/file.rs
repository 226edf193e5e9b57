//! The document as a whole: order of reading, `[scene]`, `[speed]`, `[modes]`, `[machine]`.

use super::lengths::number_or;
use super::shafts::Shafts;
use super::{
    BearingKind, MAX_TEXT_BYTES, MachineText, ModeChoice, Scene, SceneBearing, SceneErrors, Start,
};
use super::{bearings, gears, parts, sensors};
use crate::machine::file;
use crate::machine::file::errors::Log;
use crate::machine::file::general::NAME;
use crate::machine::file::range::NumberRange;
use crate::machine::file::reader::{Need, Section, TextRule};
use crate::simulator::speed::SpeedProfile;

/// Longest record, s.
const DURATION_S: NumberRange = NumberRange::positive_up_to(1e6);

/// Speeds, Hz.
const SPEED_HZ: f64 = 10_000.0;

/// Accuracies that the steps can be chosen for.
const ACCURACY: NumberRange = NumberRange::closed(1e-8, 1e-2);

/// Damping ratios of modes.
const DAMPING: NumberRange = NumberRange::from_to_below(0.0, 1.0);

/// Damping ratio unless another is given.
const DAMPING_DEFAULT: f64 = 0.01;

/// Rule of texts that may have several lines.
const TEXT: TextRule = TextRule { keeps: |text| !text.trim().is_empty(), allowed: "a text" };

pub(super) fn parse(text: &str, file_name: &str) -> Result<Scene, SceneErrors> {
    let mut log = Log::new(text, file_name, "a scene");
    if text.len() > MAX_TEXT_BYTES {
        let found = format!("{} bytes", text.len());
        log.report(0, String::new(), found, format!("up to {MAX_TEXT_BYTES} bytes"));
        return Err(log.into_errors().into());
    }
    let Some(document) = file::parse_document(text, &mut log) else {
        return Err(log.into_errors().into());
    };
    let scene = read(Section::root(&document, &log), (text, file_name));
    match scene {
        Some(scene) if log.is_empty() => Ok(scene),
        _ => Err(log.into_errors().into()),
    }
}

/// `[scene]`.
struct Head {
    name: String,
    duration_s: f64,
    start: Start,
    accuracy: f64,
    seed: u64,
    gravity_rad: Option<f64>,
}

/// Reads the whole document; `None` only where mistakes were reported.
fn read(mut root: Section<'_>, (text, file_name): (&str, &str)) -> Option<Scene> {
    let mut places = Vec::new();
    let mut place = |section: &Section<'_>| {
        let (line, column) = section.log().place(section.start());
        places.push((section.path().to_owned(), line, column));
    };
    let head = root.table("scene", Need::Required).and_then(read_head);
    let speed = root.table("speed", Need::Required).and_then(|section| {
        place(&section);
        read_speed(section)
    });
    let shafts = Shafts::read(&mut root);
    let discs: Vec<_> = root
        .tables("disc", Need::Optional)
        .into_iter()
        .map(|section| parts::disc(section, &shafts))
        .collect();
    let mut sections = root.tables("bearing", Need::Required);
    let ids = bearings::ids(&mut sections);
    if sections.len() == 1 {
        root.refuse("bearing", "at least 2 tables [[bearing]]: one support leaves the shaft free");
    }
    sections.iter().for_each(&mut place);
    let bearings: Vec<_> = sections
        .into_iter()
        .enumerate()
        .map(|(i, section)| bearings::read(section, ids.get(i), &shafts))
        .collect();
    refuse_same_place(&root, &bearings, &shafts);
    let mut sections = root.tables("gear", Need::Optional);
    let ids = gears::ids(&mut sections);
    if sections.len() > 1 {
        root.refuse("gear", "one table [[gear]]: two meshes would fight over the shaft");
    }
    sections.iter().for_each(&mut place);
    let gears: Vec<_> = sections
        .into_iter()
        .enumerate()
        .map(|(i, section)| gears::read(section, ids.get(i), &shafts))
        .collect();
    shafts.check(&root, &bearings, &gears);
    let bow = root.table("bow", Need::Optional).map(|section| parts::bow(section, &shafts));
    let unbalances: Vec<_> = root
        .tables("unbalance", Need::Optional)
        .into_iter()
        .map(|section| parts::unbalance(section, &shafts))
        .collect();
    let modes = root.table("modes", Need::Optional).map(|section| {
        place(&section);
        read_modes(section)
    });
    let known: Vec<_> = bearings.iter().flatten().map(|b| (b.id.clone(), b.place)).collect();
    let sensors = sensors::read(&mut root, (&known, &shafts), &mut place);
    let machine = root.table("machine", Need::Optional).map(read_machine);
    root.finish();
    let modes = transpose(modes)?.unwrap_or(ModeChoice {
        count: None,
        damping: DAMPING_DEFAULT,
        attachment: true,
        elements_per_span: None,
    });
    let head = head?;
    let mut scene = Scene {
        speed: speed?,
        shafts: shafts.all()?,
        discs: discs.into_iter().collect::<Option<_>>()?,
        bearings: bearings.into_iter().collect::<Option<_>>()?,
        gears: gears.into_iter().collect::<Option<_>>()?,
        bow: transpose(bow)?,
        unbalances: unbalances.into_iter().collect::<Option<_>>()?,
        modes,
        sensors: sensors?,
        machine: transpose(machine)?,
        places,
        name: head.name,
        file_name: file_name.to_owned(),
        text: text.to_owned(),
        duration_s: head.duration_s,
        start: head.start,
        accuracy: head.accuracy,
        seed: head.seed,
        gravity_rad: head.gravity_rad,
    };
    turn_bearings(&mut scene);
    Some(scene)
}

/// Tells every ball bearing how its shaft turns.
fn turn_bearings(scene: &mut Scene) {
    let turns: Vec<f64> = (0..scene.shafts.len()).map(|shaft| scene.turns(shaft)).collect();
    for bearing in &mut scene.bearings {
        if let BearingKind::Ball(ball) = &mut bearing.kind {
            ball.bearing.turns = turns[bearing.place.shaft];
        }
    }
}

/// Bearings nearer to each other than this part of the shaft are one support.
const APART: f64 = 1e-3;

/// Two bearings at one place hold the shaft at one place.
fn refuse_same_place(root: &Section<'_>, bearings: &[Option<SceneBearing>], shafts: &Shafts) {
    let known: Vec<&SceneBearing> = bearings.iter().flatten().collect();
    for (i, bearing) in known.iter().enumerate() {
        let apart_m = APART * shafts.carrier(bearing.place.shaft).length_m;
        let near = |other: &&&SceneBearing| {
            let (a, b) = (other.place, bearing.place);
            a.shaft == b.shaft && (a.at_m - b.at_m).abs() < apart_m
        };
        if let Some(other) = known[..i].iter().find(near) {
            let found = format!("bearings {} and {} at one place", other.id, bearing.id);
            let allowed = "bearings at least a thousandth of the shaft's length apart";
            root.log().report(root.at("bearing"), "bearing".to_owned(), found, allowed);
        }
    }
}

/// A table that may be absent but not wrong.
fn transpose<T>(table: Option<Option<T>>) -> Option<Option<T>> {
    match table {
        None => Some(None),
        Some(read) => read.map(Some),
    }
}

fn read_head(mut section: Section<'_>) -> Option<Head> {
    let name = section.text("name", Need::Required, &NAME).map(str::to_owned);
    let duration_s = section.number("duration_s", Need::Required, DURATION_S);
    let starts = [("rest", Start::Rest), ("rotating", Start::Rotating)];
    let start = section.choice("start", Need::Required, &starts);
    let accuracy = number_or(&mut section, "accuracy", ACCURACY, 1e-4);
    let seed = section.whole("seed", Need::Optional, 0..=u32::MAX);
    let gravity = section.flag("gravity");
    let direction =
        number_or(&mut section, "gravity_deg", NumberRange::closed(-360.0, 360.0), 270.0);
    if section.has("gravity_deg") && gravity != Some(true) {
        section.refuse("gravity_deg", "only with gravity = true");
    }
    section.finish();
    let gravity_rad = if gravity == Some(true) { Some(direction?.to_radians()) } else { None };
    let (name, duration_s, start, accuracy) = (name?, duration_s?, start?, accuracy?);
    Some(Head { name, duration_s, start, accuracy, seed: seed.map_or(1, u64::from), gravity_rad })
}

fn read_speed(mut section: Section<'_>) -> Option<SpeedProfile> {
    let range = NumberRange::closed(-SPEED_HZ, SPEED_HZ);
    let allowed =
        format!("[[time_s, hz], …], times rising from 0 on, speeds from -{SPEED_HZ} to {SPEED_HZ}");
    let constant = section.number("constant_hz", Need::Optional, range);
    let points = section.rows("points", Need::Optional, 2, &allowed);
    let both = section.has("constant_hz") && section.has("points");
    let neither = !section.has("constant_hz") && !section.has("points");
    if both {
        section.refuse("points", "either constant_hz or points");
    } else if neither {
        section.missing("constant_hz", "constant_hz or points");
    }
    let rising = |rows: &[Vec<f64>]| {
        rows.windows(2).all(|pair| pair[0][0] < pair[1][0])
            && rows.iter().all(|row| row[0] >= 0.0 && row[1].abs() <= SPEED_HZ)
    };
    if points.as_ref().is_some_and(|rows| !rising(rows)) {
        section.refuse("points", allowed);
        return None;
    }
    section.finish();
    let table = points.map(|rows| rows.iter().map(|row| (row[0], row[1])).collect());
    constant.map(SpeedProfile::Constant).or(table.map(SpeedProfile::Table))
}

fn read_modes(mut section: Section<'_>) -> Option<ModeChoice> {
    let count = section.whole("count", Need::Optional, 1..=200);
    let damping = number_or(&mut section, "damping", DAMPING, DAMPING_DEFAULT);
    let attachment = section.flag("attachment").unwrap_or(true);
    let elements_per_span = section.whole("elements_per_span", Need::Optional, 1..=64);
    section.finish();
    let count = count.map(|count| count as usize);
    Some(ModeChoice { count, damping: damping?, attachment, elements_per_span })
}

fn read_machine(mut section: Section<'_>) -> Option<MachineText> {
    let text = section.text("text", Need::Optional, &TEXT);
    let path = section.text("file", Need::Optional, &TEXT);
    if section.has("text") == section.has("file") {
        section.missing("text", "either text (a machine file) or file (its path)");
    }
    if let Some(text) = text
        && let Err(errors) = file::parse(text, "machine.text")
    {
        for mistake in errors.mistakes.iter().take(20) {
            section.refuse("text", format!("a machine file, but {mistake}"));
        }
        return None;
    }
    section.finish();
    let inline = text.map(|text| MachineText::Inline(text.to_owned()));
    inline.or(path.map(|path| MachineText::File(path.to_owned())))
}
