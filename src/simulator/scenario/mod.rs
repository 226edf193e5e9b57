//! Scenarios: what is to be damaged in a scene, by a name of the combinations or part by part, and
//! how damage grows from one to the next.
//!
//! A name or a list becomes [`Faults`], which [`super::simulation::Simulation::set_faults`] takes. Must
//! not know who asks, or the clock.

mod check;
mod growth;

pub use growth::between;

use super::contact::DefectPlace;
use super::mesh::{Fault, Member, ToothFault};
use super::scene::{BearingKind, Bow, BowShape, Faults, ProfileKind, Scene, SceneDefect};

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
    Bow { shaft: None, angle_rad: 0.0, shape: BowShape::HalfSine { amplitude_m: 8.0 * 25.4e-6 } };

/// The worn tooth of a bad gear `BG`: half a mil off the flank of tooth 23.
const BAD_GEAR: ToothFault = ToothFault {
    member: Member::Gear,
    tooth: 22,
    fault: Fault::Worn { depth_m: 0.5 * 25.4e-6, stiffness_factor: 1.0 },
};

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
/// A bad bearing is the last ball bearing of the scene, a bad gear its last gear; the sizes are those
/// of the rig.
///
/// # Errors
///
/// [`ScenarioError`]: an unknown name, a part the scene lacks, a number out of its range.
pub fn faults(scene: &Scene, wanted: &Wanted) -> Result<Faults, ScenarioError> {
    match wanted {
        Wanted::Combination(name) => combination(scene, name),
        Wanted::Faults(faults) => {
            check::check(scene, faults)?;
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
    Ok(meant(scene, name))
}

/// The faults of a combination the scene can have.
fn meant(scene: &Scene, name: &str) -> Faults {
    let bearing = scene.ball_bearings().last().filter(|_| name.ends_with("_BB"));
    let gear = scene.gears.last().filter(|_| name.starts_with("BG_"));
    Faults {
        defects: bearing.map(|(id, _)| (id.to_owned(), BAD_BEARING)).into_iter().collect(),
        bow: name.contains("_BS_").then_some(BAD_SHAFT),
        teeth: gear.map(|gear| (gear.id.clone(), BAD_GEAR)).into_iter().collect(),
    }
}

/// What a combination needs and the scene lacks.
fn missing(scene: &Scene, name: &str) -> Option<&'static str> {
    if name.starts_with("BG_") {
        match scene.gears.last() {
            None => return Some("a gear"),
            Some(gear) if gear.design.gear.teeth <= BAD_GEAR.tooth => {
                return Some("a gear of at least 23 teeth");
            }
            Some(_) => {}
        }
    }
    (name.ends_with("_BB") && scene.ball_bearings().next().is_none()).then_some("a ball bearing")
}

/// The combination whose faults these are, if there is one.
#[must_use]
pub fn name_of(scene: &Scene, faults: &Faults) -> Option<&'static str> {
    possible(scene).find(|name| meant(scene, name) == *faults)
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
    for gear in &mut scene.gears {
        let own = faults.teeth.iter().filter(|(id, _)| *id == gear.id);
        gear.faults = own.map(|(_, fault)| *fault).collect();
    }
    scene.bow.clone_from(&faults.bow);
    scene
}

#[cfg(test)]
mod tests;
