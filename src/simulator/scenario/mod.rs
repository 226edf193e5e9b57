//! Scenarios: what is to be damaged in a scene, by a name of the combinations or part by part, and
//! how damage grows from one to the next.
//!
//! A name or a list becomes [`Faults`], which [`super::simulation::Simulation::set_faults`] takes. Must
//! not know who asks, or the clock.

use super::contact::DefectPlace;
use super::scene::{
    BearingKind, Bow, BowShape, Faults, ProfileKind, Scene, SceneBall, SceneDefect,
};
use std::f64::consts::{PI, TAU};

/// The defect of a bad bearing `BB`: inner race, 0.05 in wide, 4 mil deep.
const BAD_BEARING: SceneDefect = SceneDefect {
    place: DefectPlace::InnerRace,
    angle_rad: 0.0,
    width_m: 0.05 * 0.0254,
    depth_m: 4.0 * 25.4e-6,
    profile: ProfileKind::Geometric,
    radius_m: None,
};

/// The bow of a bad shaft `BS`: half a sine wave of 8 mil.
const BAD_SHAFT: Bow =
    Bow { angle_rad: 0.0, shape: BowShape::HalfSine { amplitude_m: 8.0 * 25.4e-6 } };

/// Deepest defect, m, and largest bow, m, as in a scene's file.
const LARGEST_M: f64 = 0.1;

/// The combinations: gear, shaft and bearing, good (G) or bad (B) each.
pub const COMBINATIONS: [&str; 8] = [
    "GG_GS_GB", "GG_GS_BB", "GG_BS_GB", "GG_BS_BB", "BG_GS_GB", "BG_GS_BB", "BG_BS_GB", "BG_BS_BB",
];

/// What somebody wants to be damaged.
#[derive(Debug, Clone, PartialEq)]
pub enum Wanted {
    /// One of [`COMBINATIONS`].
    Combination(String),
    /// These faults and no others.
    Faults(Faults),
}

/// Why a scene cannot have a scenario.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ScenarioError {
    /// No such combination.
    #[error("no scenario has the name {name:?}; this scene can have {possible}")]
    Unknown {
        /// As asked for.
        name: String,
        /// The names.
        possible: String,
    },
    /// The scene lacks the part.
    #[error(
        "the scenario {name} needs {part}, which the scene does not have; it can have {possible}"
    )]
    Impossible {
        /// As asked for.
        name: String,
        /// What is missing.
        part: &'static str,
        /// The names it can have.
        possible: String,
    },
    /// A fault's number or place is not allowed.
    #[error("{place}: found {found}, allowed: {allowed}")]
    Fault {
        /// Which fault and key, such as `inner_race of right, width_mm`.
        place: String,
        /// What was found.
        found: String,
        /// What is allowed.
        allowed: String,
    },
    /// The simulation refuses it.
    #[error("{0}")]
    Refused(String),
}

/// Names of the combinations a scene can have.
pub fn possible(scene: &Scene) -> impl Iterator<Item = &'static str> {
    COMBINATIONS.into_iter().filter(|name| missing(scene, name).is_none())
}

/// The faults somebody wants, checked against the scene.
///
/// A bad bearing is the last ball bearing of the scene; the sizes are those of the rig.
///
/// # Errors
///
/// [`ScenarioError`]: an unknown name, a part the scene lacks, a number out of its range.
pub fn faults(scene: &Scene, wanted: &Wanted) -> Result<Faults, ScenarioError> {
    match wanted {
        Wanted::Combination(name) => combination(scene, name),
        Wanted::Faults(faults) => {
            check(scene, faults)?;
            Ok(faults.clone())
        }
    }
}

fn combination(scene: &Scene, name: &str) -> Result<Faults, ScenarioError> {
    let listed = || possible(scene).collect::<Vec<_>>().join(", ");
    if !COMBINATIONS.contains(&name) {
        return Err(ScenarioError::Unknown { name: name.to_owned(), possible: listed() });
    }
    if let Some(part) = missing(scene, name) {
        let name = name.to_owned();
        return Err(ScenarioError::Impossible { name, part, possible: listed() });
    }
    let bearing = scene.ball_bearings().last().filter(|_| name.ends_with("_BB"));
    Ok(Faults {
        defects: bearing.map(|(id, _)| (id.to_owned(), BAD_BEARING)).into_iter().collect(),
        bow: name.contains("_BS_").then_some(BAD_SHAFT),
        ..Faults::default()
    })
}

/// What a combination needs and the scene lacks.
fn missing(scene: &Scene, name: &str) -> Option<&'static str> {
    if name.starts_with("BG") {
        return Some("a gear");
    }
    (name.ends_with("_BB") && !scene.has_contacts()).then_some("a ball bearing")
}

/// The combination whose faults these are, if there is one.
#[must_use]
pub fn name_of(scene: &Scene, faults: &Faults) -> Option<&'static str> {
    possible(scene).find(|name| combination(scene, name).is_ok_and(|known| known == *faults))
}

fn check(scene: &Scene, faults: &Faults) -> Result<(), ScenarioError> {
    for (id, defect) in &faults.defects {
        check_defect(scene, id, defect)?;
    }
    if let Some(bow) = &faults.bow {
        let amplitude_m = amplitude_m(&bow.shape);
        let found = format!("{} um", amplitude_m * 1e6);
        inside(amplitude_m, LARGEST_M, "bow, amplitude_um", found)?;
        finite(bow.angle_rad, "bow, angle_deg")?;
    }
    Ok(())
}

fn check_defect(scene: &Scene, id: &str, defect: &SceneDefect) -> Result<(), ScenarioError> {
    let fault = match defect.place {
        DefectPlace::InnerRace => "inner_race",
        DefectPlace::OuterRace => "outer_race",
        DefectPlace::Element(_) => "rolling_element",
    };
    let place = |key: &str| format!("{fault} of {id}, {key}");
    let Some((_, ball)) = scene.ball_bearings().find(|(known, _)| *known == id) else {
        let known: Vec<&str> = scene.ball_bearings().map(|(id, _)| id).collect();
        let allowed = match &known[..] {
            [] => "no bearing: the scene has no ball bearings".to_owned(),
            known => format!("the id of a ball bearing of the scene: {}", known.join(", ")),
        };
        let found = format!("{id:?}");
        return Err(ScenarioError::Fault { place: place("bearing"), found, allowed });
    };
    if let DefectPlace::Element(number) = defect.place
        && number >= ball.bearing.balls
    {
        return Err(ScenarioError::Fault {
            place: place("ball"),
            found: number.to_string(),
            allowed: format!("0 to {}", ball.bearing.balls - 1),
        });
    }
    let widest_m = widest_m(ball, defect);
    let found = |m: f64, unit: &str, per_m: f64| format!("{} {unit}", m * per_m);
    inside(defect.width_m, widest_m, &place("width_mm"), found(defect.width_m, "mm", 1e3))?;
    inside(defect.depth_m, LARGEST_M, &place("depth_um"), found(defect.depth_m, "um", 1e6))?;
    finite(defect.angle_rad, &place("angle_deg"))
}

/// Width that a defect stays below, m: the space between two balls, on a ball a quarter of it.
fn widest_m(ball: &SceneBall, defect: &SceneDefect) -> f64 {
    let widest_rad = match defect.place {
        DefectPlace::InnerRace | DefectPlace::OuterRace => TAU / f64::from(ball.bearing.balls),
        DefectPlace::Element(_) => 0.5 * PI,
    };
    widest_rad * ball.radius_m(defect)
}

fn inside(value_m: f64, limit_m: f64, place: &str, found: String) -> Result<(), ScenarioError> {
    if value_m > 0.0 && value_m < limit_m {
        return Ok(());
    }
    let limit = if place.ends_with("_mm") {
        format!("{:.3} mm", limit_m * 1e3)
    } else {
        format!("{:.0} um", limit_m * 1e6)
    };
    let allowed = format!("above 0 and below {limit}");
    Err(ScenarioError::Fault { place: place.to_owned(), found, allowed })
}

fn finite(angle_rad: f64, place: &str) -> Result<(), ScenarioError> {
    if angle_rad.is_finite() && angle_rad.abs() <= 1e3 * TAU {
        return Ok(());
    }
    let found = format!("{}", angle_rad.to_degrees());
    let allowed = "an angle, degrees".to_owned();
    Err(ScenarioError::Fault { place: place.to_owned(), found, allowed })
}

/// Largest deflection of a bow, m.
#[must_use]
pub fn amplitude_m(shape: &BowShape) -> f64 {
    match shape {
        BowShape::HalfSine { amplitude_m } => *amplitude_m,
        BowShape::Points(points) => points.iter().map(|(_, d)| d.abs()).fold(0.0, f64::max),
    }
}

/// The scene with these faults in place of its own, so that it begins with them.
#[must_use]
pub fn with_faults(scene: &Scene, faults: &Faults) -> Scene {
    let mut scene = scene.clone();
    for bearing in &mut scene.bearings {
        if let BearingKind::Ball(ball) = &mut bearing.kind {
            let own = faults.defects.iter().filter(|(id, _)| *id == bearing.id);
            ball.defects = own.map(|(_, defect)| *defect).collect();
        }
    }
    scene.bow.clone_from(&faults.bow);
    scene
}

/// Faults on the way from one scenario to another; `part` 0 gives the first, 1 the second.
///
/// Width and depth of a defect that both have (same bearing, place, angle and profile) change in
/// proportion; one that only one of them has grows from nothing or shrinks to it. Bows of half a
/// sine wave add as vectors; one of another shape shrinks first, then the new one grows.
#[must_use]
pub fn between(from: &Faults, to: &Faults, part: f64) -> Faults {
    if part >= 1.0 {
        return to.clone();
    }
    if part <= 0.0 {
        return from.clone();
    }
    let sized = |(id, defect): &(String, SceneDefect), width_m: f64, depth_m: f64| {
        (width_m > 0.0 && depth_m > 0.0)
            .then(|| (id.clone(), SceneDefect { width_m, depth_m, ..*defect }))
    };
    let going = from.defects.iter().filter(|a| !to.defects.iter().any(|b| is_same(a, b)));
    let going =
        going.filter_map(|a| sized(a, (1.0 - part) * a.1.width_m, (1.0 - part) * a.1.depth_m));
    let coming = to.defects.iter().filter_map(|b| {
        let old = from.defects.iter().find(|a| is_same(a, b));
        let (width_m, depth_m) = old.map_or((0.0, 0.0), |a| (a.1.width_m, a.1.depth_m));
        let mixed = |old: f64, new: f64| old + part * (new - old);
        sized(b, mixed(width_m, b.1.width_m), mixed(depth_m, b.1.depth_m))
    });
    Faults {
        defects: going.chain(coming).collect(),
        bow: bow_between(from.bow.as_ref(), to.bow.as_ref(), part),
        ..Faults::default()
    }
}

fn is_same(a: &(String, SceneDefect), b: &(String, SceneDefect)) -> bool {
    let sizeless = |d: &SceneDefect| SceneDefect { width_m: 0.0, depth_m: 0.0, ..*d };
    a.0 == b.0 && sizeless(&a.1) == sizeless(&b.1)
}

fn bow_between(from: Option<&Bow>, to: Option<&Bow>, part: f64) -> Option<Bow> {
    let vector = |bow: Option<&Bow>| match bow {
        None => Some((0.0, 0.0)),
        Some(Bow { angle_rad, shape: BowShape::HalfSine { amplitude_m } }) => {
            Some((amplitude_m * angle_rad.cos(), amplitude_m * angle_rad.sin()))
        }
        Some(Bow { shape: BowShape::Points(_), .. }) => None,
    };
    if let (Some(a), Some(b)) = (vector(from), vector(to)) {
        let (x, y) = (a.0 + part * (b.0 - a.0), a.1 + part * (b.1 - a.1));
        let amplitude_m = x.hypot(y);
        let shape = BowShape::HalfSine { amplitude_m };
        return (amplitude_m > 0.0).then(|| Bow { angle_rad: y.atan2(x), shape });
    }
    let (bow, size) = if part < 0.5 { (from, 1.0 - 2.0 * part) } else { (to, 2.0 * part - 1.0) };
    bow.filter(|_| size > 0.0).map(|bow| scaled(bow, size))
}

fn scaled(bow: &Bow, by: f64) -> Bow {
    let shape = match &bow.shape {
        BowShape::HalfSine { amplitude_m } => BowShape::HalfSine { amplitude_m: by * amplitude_m },
        BowShape::Points(points) => {
            BowShape::Points(points.iter().map(|(at_m, d_m)| (*at_m, by * d_m)).collect())
        }
    };
    Bow { shape, ..*bow }
}

#[cfg(test)]
mod tests;
