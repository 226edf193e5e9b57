//! The faults of a scene as text, for the truth of a capture.

use super::{BearingKind, Bow, BowShape, ProfileKind, Scene, SceneBall, SceneDefect, SceneGear};
use crate::simulator::contact::DefectPlace;
use crate::simulator::mesh::{Fault, Member, ToothFault};

/// One `[[fault]]` of TOML for each fault.
pub(super) fn listed(scene: &Scene) -> String {
    let mut text = String::new();
    for bearing in &scene.bearings {
        if let BearingKind::Ball(ball) = &bearing.kind {
            let tables = ball.defects.iter().map(|defect| table(&bearing.id, ball, defect));
            text.extend(tables);
        }
    }
    text.extend(scene.bow.as_ref().map(bow));
    for gear in &scene.gears {
        text.extend(gear.faults.iter().map(|fault| tooth(gear, fault)));
    }
    text
}

fn table(id: &str, ball: &SceneBall, defect: &SceneDefect) -> String {
    let (fault, number) = match defect.place {
        DefectPlace::InnerRace => ("inner_race", None),
        DefectPlace::OuterRace => ("outer_race", None),
        DefectPlace::Element(number) => ("rolling_element", Some(number)),
    };
    let profile = match defect.profile {
        ProfileKind::Step => "step",
        ProfileKind::RaisedCosine => "raised_cosine",
        ProfileKind::Geometric => "geometric",
    };
    let number = number.map_or(String::new(), |number| format!("ball = {number}\n"));
    format!(
        "[[fault]]\ncomponent = \"bearing\"\nid = \"{id}\"\nfault = \"{fault}\"\n{number}width_m = {}\n\
         depth_m = {}\nradius_m = {}\nangle_deg = {}\nprofile = \"{profile}\"\n",
        defect.width_m,
        defect.depth_m,
        ball.radius_m(defect),
        defect.angle_rad.to_degrees(),
    )
}

fn bow(bow: &Bow) -> String {
    let amplitude_m = match &bow.shape {
        BowShape::HalfSine { amplitude_m } => *amplitude_m,
        BowShape::Points(points) => points.iter().map(|(_, d)| d.abs()).fold(0.0, f64::max),
    };
    let id = bow.shaft.as_ref().map_or(String::new(), |id| format!("id = \"{id}\"\n"));
    format!(
        "[[fault]]\ncomponent = \"shaft\"\n{id}fault = \"bow\"\namplitude_m = {amplitude_m}\nangle_deg = {}\n",
        bow.angle_rad.to_degrees()
    )
}

fn tooth(gear: &SceneGear, fault: &ToothFault) -> String {
    // Under a forward torque the mate drives.
    let is_driven = (fault.member == Member::Gear) == (gear.torque_n_m >= 0.0);
    let member = if is_driven { "driven" } else { "driving" };
    let (kind, sizes) = match fault.fault {
        Fault::Worn { depth_m, stiffness_factor } => {
            ("worn", format!("depth_m = {depth_m:?}\nstiffness_factor = {stiffness_factor:?}\n"))
        }
        Fault::Cracked(crack) => {
            let angle = crack.angle_rad.to_degrees();
            ("cracked", format!("depth_m = {:?}\ncrack_angle_deg = {angle:?}\n", crack.depth_m))
        }
        Fault::Missing => ("missing", String::new()),
        Fault::Profile { slope_m, form_m } => {
            ("profile_error", format!("slope_m = {slope_m:?}\nform_m = {form_m:?}\n"))
        }
        Fault::Pitch { offset_m } => ("pitch_error", format!("offset_m = {offset_m:?}\n")),
    };
    let angle = gear.tooth_angle_deg(fault);
    let angle = angle.map_or(String::new(), |angle| format!("angle_deg = {angle:?}\n"));
    format!(
        "[[fault]]\ncomponent = \"gear\"\nid = \"{}\"\nfault = \"tooth_damage\"\nkind = \"{kind}\"\n\
         member = \"{member}\"\ntooth = {}\n{angle}{sizes}",
        gear.id,
        fault.tooth + 1,
    )
}
