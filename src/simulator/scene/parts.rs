//! `[[disc]]`, `[bow]`, `[[unbalance]]`.

use super::lengths::{Span, angle, has_length, length, length_keys, number_or};
use super::shafts::{Carrier, Shafts};
use super::{Bow, BowShape, SceneDisc, Unbalance};
use crate::machine::file::range::NumberRange;
use crate::machine::file::reader::{Need, Section};
use crate::simulator::rotor::{Disc, Place};

/// Largest machine, m.
pub(super) const MAX_M: f64 = 100.0;

/// Young's moduli, GPa.
pub(super) const YOUNG_GPA: NumberRange = NumberRange::positive_up_to(1200.0);

/// Poisson's ratios.
pub(super) const POISSON: NumberRange = NumberRange::from_to_below(0.0, 0.5);

const DENSITY: NumberRange = NumberRange::positive_up_to(30_000.0);

/// Masses, kg, and inertias, kg·m².
const MASS: NumberRange = NumberRange::positive_up_to(1e6);

/// Steel, unless another is given.
const DENSITY_DEFAULT: f64 = 7833.4;

/// Reads a place along a shaft of this length, m.
pub(super) fn at(section: &mut Section<'_>, need: Need, length_m: f64) -> Option<f64> {
    length(section, length_keys!("at"), need, Span::FromZero(length_m.min(MAX_M)))
}

/// Reads the place of a part on the shaft it names.
pub(super) fn place(section: &mut Section<'_>, shafts: &Shafts) -> Option<Place> {
    let carrier = shafts.of(section);
    let at_m = at(section, Need::Required, carrier.map_or(f64::MAX, |carrier| carrier.length_m));
    Some(Place { shaft: carrier?.number, at_m: at_m? })
}

/// Reads a disc; its bore is the shaft unless given.
pub(super) fn disc(mut section: Section<'_>, shafts: &Shafts) -> Option<SceneDisc> {
    let s = &mut section;
    let carrier = shafts.of(s);
    let Carrier { number, length_m, diameter_m } = carrier.unwrap_or(shafts.carrier(0));
    let at_m = at(s, Need::Required, length_m);
    let by_mass = s.has("mass_kg");
    let disc = if by_mass { by_inertia(s, at_m) } else { by_size(s, at_m, diameter_m) };
    let eccentricity = length(s, length_keys!("eccentricity"), Need::Optional, Span::FromZero(0.1));
    let eccentricity_rad = angle(s, "eccentricity_deg");
    section.finish();
    carrier?;
    Some(SceneDisc {
        shaft: number,
        disc: disc?,
        eccentricity_m: eccentricity.unwrap_or(0.0),
        eccentricity_rad: eccentricity_rad?,
    })
}

pub(super) fn by_inertia(s: &mut Section<'_>, at_m: Option<f64>) -> Option<Disc> {
    let mass_kg = s.number("mass_kg", Need::Required, MASS);
    let diametral = s.number("diametral_kg_m2", Need::Required, MASS);
    let polar = s.number("polar_kg_m2", Need::Required, MASS);
    let (at_m, mass_kg, diametral, polar) = (at_m?, mass_kg?, diametral?, polar?);
    if polar > 2.0 * diametral * (1.0 + 1e-9) {
        s.refuse("polar_kg_m2", "at most twice diametral_kg_m2: no body has more");
        return None;
    }
    Some(Disc { at_m, mass_kg, diametral_kg_m2: diametral, polar_kg_m2: polar })
}

fn by_size(s: &mut Section<'_>, at_m: Option<f64>, shaft_m: Option<f64>) -> Option<Disc> {
    let outer = length(s, length_keys!("diameter"), Need::Required, Span::Positive(MAX_M));
    let width = length(s, length_keys!("width"), Need::Required, Span::Positive(MAX_M));
    let bore = length(s, length_keys!("bore"), Need::Optional, Span::FromZero(MAX_M)).or(shaft_m);
    let density = number_or(s, "density_kg_per_m3", DENSITY, DENSITY_DEFAULT);
    // Named so that a misspelt one is told.
    let _known = s.number("mass_kg", Need::Optional, MASS);
    let (at_m, outer, width, bore) = (at_m?, outer?, width?, bore?);
    if bore >= outer {
        let key = if has_length(s, length_keys!("bore")) { "bore" } else { "diameter" };
        let at = s.path_of(key);
        let found = format!("an outer diameter of {outer} m on a bore of {bore} m");
        s.log().report(s.start(), at, found, "a disc wider than its bore");
        return None;
    }
    Some(Disc::solid(at_m, outer, bore, width, density?))
}

/// Reads a residual bow.
pub(super) fn bow(mut section: Section<'_>, shafts: &Shafts) -> Option<Bow> {
    #[derive(Clone, Copy, PartialEq)]
    enum Shape {
        HalfSine,
        Points,
    }
    let s = &mut section;
    let carrier = shafts.of(s)?;
    let id = s.text("shaft", Need::Optional, &super::shafts::ANY).map(str::to_owned);
    let shapes = [("half_sine", Shape::HalfSine), ("points", Shape::Points)];
    let shape = s.choice("shape", Need::Optional, &shapes);
    let angle_rad = angle(s, "angle_deg");
    let shape = if s.has("shape") { shape? } else { Shape::HalfSine };
    let shape = match shape {
        Shape::HalfSine => {
            let keys = length_keys!("amplitude");
            let amplitude_m = length(s, keys, Need::Required, Span::Positive(0.1));
            amplitude_m.map(|amplitude_m| BowShape::HalfSine { amplitude_m })
        }
        Shape::Points => points(s, carrier.length_m).map(BowShape::Points),
    };
    section.finish();
    Some(Bow { shaft: id, angle_rad: angle_rad?, shape: shape? })
}

fn points(s: &mut Section<'_>, length_m: f64) -> Option<Vec<(f64, f64)>> {
    let allowed =
        "[[place, deflection], …] in one unit: at least 3 points, places rising along the shaft";
    let metric = s.rows("points_mm", Need::Optional, 2, allowed).map(|rows| (rows, 1e-3));
    let inch = s.rows("points_in", Need::Optional, 2, allowed).map(|rows| (rows, 0.0254));
    let key = if s.has("points_in") { "points_in" } else { "points_mm" };
    if s.has("points_in") == s.has("points_mm") {
        s.missing(key, "either points_mm or points_in");
        return None;
    }
    let (rows, unit_m) = metric.or(inch)?;
    let points: Vec<(f64, f64)> = rows.iter().map(|p| (p[0] * unit_m, p[1] * unit_m)).collect();
    let rising = points.windows(2).all(|pair| pair[1].0 - pair[0].0 > 1e-6);
    let inside = points.iter().all(|(at, _)| (0.0..=length_m).contains(at));
    let small = points.iter().all(|(_, deflection)| deflection.abs() <= 0.1);
    if points.len() < 3 || !rising || !inside || !small {
        s.refuse(key, allowed);
        return None;
    }
    Some(points)
}

/// Reads an unbalance.
pub(super) fn unbalance(mut section: Section<'_>, shafts: &Shafts) -> Option<Unbalance> {
    let s = &mut section;
    let place = place(s, shafts);
    let g_mm = s.number("amount_g_mm", Need::Required, NumberRange::closed(0.0, 1e9));
    let angle_rad = angle(s, "angle_deg");
    section.finish();
    Some(Unbalance { place: place?, kg_m: g_mm? * 1e-6, angle_rad: angle_rad? })
}
