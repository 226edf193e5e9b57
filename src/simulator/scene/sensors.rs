//! `[[sensor]]`: what watches, in which unit, with which faults of its own.

use super::lengths::{angle, has_length, length_keys, number_or};
use super::parts;
use super::shafts::{Carrier, Shafts};
use super::{NumberKind, SceneSensor, SensorKind};
use crate::machine::file::general::CHANNEL;
use crate::machine::file::range::NumberRange;
use crate::machine::file::reader::{Ids, Need, Section, TextRule};
use crate::simulator::rotor::Place;

/// Acceleration of gravity by which a g is counted, m/s².
pub(crate) const STANDARD_GRAVITY: f64 = 9.806_65;

/// Samples a second unless others are given.
const RATE_DEFAULT_HZ: f64 = 10_000.0;

/// Corner of the anti-alias filter ÷ rate, unless given.
const CORNER_DEFAULT: f64 = 0.4;

/// Noise unless another is given: of accelerometers µg/√Hz, of probes µm RMS.
const NOISE_UG_DEFAULT: f64 = 100.0;
const NOISE_UM_DEFAULT: f64 = 0.1;

/// Largest values, unless given: of accelerometers m/s², of probes m, of a tacho V.
const FULL_SCALE_DEFAULT: [f64; 3] = [500.0, 500e-6, 10.0];

/// Rule of identifiers that are looked up by hand.
const ANY: TextRule =
    TextRule { keeps: |text| !text.is_empty(), allowed: "the id of a [[bearing]]" };

/// A unit of a kind of sensor: name, and its values ÷ SI values.
type Units = &'static [(&'static str, (&'static str, f64))];

const ACCELERATION: Units = &[
    ("m/s^2", ("m/s^2", 1.0)),
    ("g", ("g", 1.0 / STANDARD_GRAVITY)),
    ("in/s^2", ("in/s^2", 1.0 / 0.0254)),
];

const DISPLACEMENT: Units = &[
    ("um", ("um", 1e6)),
    ("mm", ("mm", 1e3)),
    ("mil", ("mil", 1.0 / 25.4e-6)),
    ("in", ("in", 1.0 / 0.0254)),
];

const VOLTAGE: Units = &[("V", ("V", 1.0))];

/// Reads all sensors, at least one; their rates must be whole parts of the fastest.
pub(super) fn read<'s>(
    root: &mut Section<'s>,
    known: (&[(String, Place)], &Shafts),
    place: &mut impl FnMut(&Section<'_>),
) -> Option<Vec<SceneSensor>> {
    let mut sections = root.tables("sensor", Need::Required);
    let channels = Ids::read("sensor", "channel", &mut sections, &CHANNEL);
    let mut sensors = Vec::with_capacity(sections.len());
    for (i, section) in sections.iter_mut().enumerate() {
        place(section);
        sensors.push(sensor(section, channels.get(i), known));
    }
    let fastest = sensors.iter().flatten().map(|s| s.rate_hz).fold(0.0, f64::max);
    for (section, sensor) in sections.iter().zip(&sensors) {
        let Some(sensor) = sensor else { continue };
        let ratio = fastest / sensor.rate_hz;
        if (ratio - ratio.round()).abs() > 1e-9 {
            section.refuse("rate_hz", format!("a whole part of the fastest rate, {fastest} Hz"));
        }
    }
    sensors.into_iter().collect()
}

fn sensor(
    s: &mut Section<'_>,
    channel: Option<&str>,
    known: (&[(String, Place)], &Shafts),
) -> Option<SceneSensor> {
    let kinds = [
        ("accelerometer", SensorKind::Accelerometer),
        ("proximitor", SensorKind::Proximitor),
        ("tacho", SensorKind::Tacho),
    ];
    let kind = s.choice("kind", Need::Required, &kinds)?;
    let units = match kind {
        SensorKind::Accelerometer => ACCELERATION,
        SensorKind::Proximitor => DISPLACEMENT,
        SensorKind::Tacho => VOLTAGE,
    };
    let unit = s.choice("unit", Need::Optional, units);
    let (unit, per_si) = if s.has("unit") { unit? } else { units[0].1 };
    let place = at(s, kind, known);
    let axis_rad = angle(s, "axis_deg");
    let rates = NumberRange::closed(10.0, 1_000_000.0);
    let rate_hz = number_or(s, "rate_hz", rates, RATE_DEFAULT_HZ);
    let corners = NumberRange::closed(1.0, 0.5 * rate_hz.unwrap_or(1e6));
    let corner_hz =
        number_or(s, "corner_hz", corners, CORNER_DEFAULT * rate_hz.unwrap_or(RATE_DEFAULT_HZ));
    let noise = noise(s, kind, per_si, rate_hz);
    let scale = FULL_SCALE_DEFAULT[kind as usize] * per_si;
    let full_scale = number_or(s, "full_scale", NumberRange::positive_up_to(1e9), scale);
    let bits = s.whole("bits", Need::Optional, 8..=16);
    let number = s.choice(
        "number",
        Need::Optional,
        &[
            ("int16", NumberKind::Int16),
            ("float32", NumberKind::Float32),
            ("float64", NumberKind::Float64),
        ],
    );
    let number = if s.has("number") { number? } else { NumberKind::Int16 };
    let signed = NumberRange::closed(-1e9, 1e9);
    let drift_per_s = number_or(s, "drift_per_s", signed, 0.0);
    let rest = number_or(s, "rest", signed, 0.0);
    let dropouts = dropouts(s);
    s.finish();
    Some(SceneSensor {
        channel: channel?.to_owned(),
        kind,
        place: place?,
        axis_rad: axis_rad?,
        rate_hz: rate_hz?,
        corner_hz: corner_hz?,
        unit,
        per_si,
        noise_density: noise?,
        full_scale: full_scale?,
        bits: bits.unwrap_or(16),
        number,
        drift_per_s: drift_per_s?,
        rest: rest?,
        dropouts_s: dropouts?,
    })
}

fn at(
    s: &mut Section<'_>,
    kind: SensorKind,
    (bearings, shafts): (&[(String, Place)], &Shafts),
) -> Option<Place> {
    let carrier = shafts.of(s);
    let Carrier { number: shaft, length_m, .. } = carrier.unwrap_or(shafts.carrier(0));
    let id = s.text("bearing", Need::Optional, &ANY);
    let by_length = has_length(s, length_keys!("at"));
    let need =
        if s.has("bearing") || kind == SensorKind::Tacho { Need::Optional } else { Need::Required };
    let at_m = parts::at(s, need, length_m);
    if s.has("bearing") && by_length {
        s.refuse("bearing", "either bearing or a place such as at_mm");
        return None;
    }
    let Some(id) = id else {
        let at_m = if kind == SensorKind::Tacho { Some(at_m.unwrap_or(0.0)) } else { at_m };
        return carrier.and(at_m).map(|at_m| Place { shaft, at_m });
    };
    if s.has("shaft") {
        s.refuse("shaft", "either bearing or shaft with a place such as at_mm");
    }
    let known = bearings.iter().find(|(known, _)| known == id).map(|(_, place)| *place);
    if known.is_none() {
        let names: Vec<&str> = bearings.iter().map(|(known, _)| known.as_str()).collect();
        s.refuse("bearing", format!("the id of a [[bearing]]: {}", names.join(", ")));
    }
    known
}

/// One-sided noise density in the sensor's unit/√Hz.
fn noise(s: &mut Section<'_>, kind: SensorKind, per_si: f64, rate_hz: Option<f64>) -> Option<f64> {
    let clean = s.flag("clean").unwrap_or(false);
    let range = NumberRange::closed(0.0, 1e9);
    let (density, key) = match kind {
        SensorKind::Accelerometer => {
            let key = "noise_ug_per_sqrt_hz";
            let density = number_or(s, key, range, NOISE_UG_DEFAULT)?;
            (density * 1e-6 * STANDARD_GRAVITY * per_si, key)
        }
        SensorKind::Proximitor => {
            let key = "noise_rms_um";
            let rms = number_or(s, key, range, NOISE_UM_DEFAULT)? * 1e-6 * per_si;
            (rms / (0.5 * rate_hz?).sqrt(), key)
        }
        SensorKind::Tacho => {
            let key = "noise_rms_v";
            (number_or(s, key, range, 0.0)? / (0.5 * rate_hz?).sqrt(), key)
        }
    };
    if clean && s.has(key) {
        s.refuse(key, "either clean = true or a noise");
    }
    Some(if clean { 0.0 } else { density })
}

fn dropouts(s: &mut Section<'_>) -> Option<Vec<(f64, f64)>> {
    let allowed = "[[from_s, to_s], …], each to after its from";
    if !s.has("dropouts_s") {
        let _known = s.rows("dropouts_s", Need::Optional, 2, allowed);
        return Some(Vec::new());
    }
    let rows = s.rows("dropouts_s", Need::Optional, 2, allowed)?;
    if rows.iter().any(|row| row[1] <= row[0]) {
        s.refuse("dropouts_s", allowed);
        return None;
    }
    Some(rows.iter().map(|row| (row[0], row[1])).collect())
}
