//! Faults somebody lists, against the scene: places that are there, sizes that can be.
//!
//! Limits are those of a scene's file. Must not know the names of combinations.

use super::super::contact::DefectPlace;
use super::super::mesh::{Crack, Fault, Member, ToothFault, design_error};
use super::super::scene::{Faults, Scene, SceneBall, SceneDefect, SceneGear, limits};
use super::growth::is_same_tooth;
use super::{ScenarioError, amplitude_m};
use std::f64::consts::{PI, TAU};

/// Deepest defect, m, and largest bow, m.
const LARGEST_M: f64 = 0.1;

/// The first fault the scene cannot have.
pub(super) fn check(scene: &Scene, faults: &Faults) -> Result<(), ScenarioError> {
    for (id, defect) in &faults.defects {
        check_defect(scene, id, defect)?;
    }
    for (i, (id, fault)) in faults.teeth.iter().enumerate() {
        check_tooth(scene, id, fault)?;
        let is_same = |(other, b): &&(String, ToothFault)| other == id && is_same_tooth(b, fault);
        if faults.teeth[..i].iter().any(|b| is_same(&b)) {
            let found = format!("two faults of the same kind of tooth {}", fault.tooth + 1);
            let allowed = "one of each kind a tooth".to_owned();
            return Err(ScenarioError::Fault { place: of_gear(id, "kind"), found, allowed });
        }
    }
    for gear in &scene.gears {
        let own = faults.teeth.iter().filter(|(id, _)| *id == gear.id);
        let own: Vec<ToothFault> = own.map(|(_, fault)| *fault).collect();
        if let Some(found) = design_error(&gear.design, &own) {
            let place = of_gear(&gear.id, "depth_um");
            let allowed = "teeth that keep a tenth of their thickness".to_owned();
            return Err(ScenarioError::Fault { place, found, allowed });
        }
    }
    if let Some(bow) = &faults.bow {
        let amplitude_m = amplitude_m(&bow.shape);
        let found = format!("{} um", amplitude_m * 1e6);
        inside(amplitude_m, LARGEST_M, "bow, amplitude_um", found)?;
        finite(bow.angle_rad, "bow, angle_deg")?;
        if scene.shaft_of(bow).is_none() {
            let names: Vec<&str> = scene.shafts.iter().map(|shaft| shaft.id.as_str()).collect();
            return Err(ScenarioError::Fault {
                place: "bow, shaft".to_owned(),
                found: format!("{:?}", bow.shaft.as_deref().unwrap_or_default()),
                allowed: format!("the id of a shaft of the scene: {}", names.join(", ")),
            });
        }
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

/// Where a fault of a tooth is told.
fn of_gear(id: &str, key: &str) -> String {
    format!("tooth_damage of {id}, {key}")
}

fn check_tooth(scene: &Scene, id: &str, fault: &ToothFault) -> Result<(), ScenarioError> {
    let Some(gear) = scene.gears.iter().find(|gear| gear.id == id) else {
        let known: Vec<&str> = scene.gears.iter().map(|gear| gear.id.as_str()).collect();
        let allowed = match &known[..] {
            [] => "no gear: the scene has none".to_owned(),
            known => format!("the id of a gear of the scene: {}", known.join(", ")),
        };
        let found = format!("{id:?}");
        return Err(ScenarioError::Fault { place: of_gear(id, "gear"), found, allowed });
    };
    let teeth = teeth(gear, fault.member);
    if fault.tooth >= teeth {
        return Err(ScenarioError::Fault {
            place: of_gear(id, "tooth"),
            found: (u64::from(fault.tooth) + 1).to_string(),
            allowed: format!("1 to {teeth}"),
        });
    }
    let um = |m: f64| m * 1e6;
    let within = |value: f64, (low, high): (f64, f64), key: &str| {
        if value >= low && value <= high {
            return Ok(());
        }
        // To a millionth: what a change of units leaves is no information.
        let found = ((value * 1e6).round() / 1e6).to_string();
        let allowed = format!("{low} to {high}");
        Err(ScenarioError::Fault { place: of_gear(id, key), found, allowed })
    };
    let small_um = um(limits::TOOTH_M);
    match fault.fault {
        Fault::Missing => Ok(()),
        Fault::Worn { depth_m, stiffness_factor } => {
            within(um(depth_m), (0.0, small_um), "depth_um")?;
            within(stiffness_factor, limits::STIFFNESS_FACTOR, "stiffness_factor")
        }
        Fault::Cracked(Crack { depth_m, angle_rad }) => {
            if depth_m <= 0.0 {
                let (found, allowed) = (um(depth_m).to_string(), "above 0".to_owned());
                return Err(ScenarioError::Fault {
                    place: of_gear(id, "depth_um"),
                    found,
                    allowed,
                });
            }
            within(um(depth_m), (0.0, um(limits::CRACK_M)), "depth_um")?;
            within(angle_rad.to_degrees(), limits::CRACK_DEG, "crack_angle_deg")
        }
        Fault::Profile { slope_m, form_m } => {
            within(um(slope_m), (-small_um, small_um), "slope_um")?;
            within(um(form_m), (-small_um, small_um), "form_um")
        }
        Fault::Pitch { offset_m } => within(um(offset_m), (-small_um, small_um), "offset_um"),
    }
}

fn teeth(gear: &SceneGear, member: Member) -> u32 {
    match member {
        Member::Gear => gear.design.gear.teeth,
        Member::Mate => gear.design.mate.teeth,
    }
}
