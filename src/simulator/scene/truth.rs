//! The faults of a scene as text, for the truth of a capture.

use super::{BearingKind, Bow, BowShape, ProfileKind, Scene, SceneBall, SceneDefect};
use crate::simulator::contact::DefectPlace;

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
    format!(
        "[[fault]]\ncomponent = \"shaft\"\nfault = \"bow\"\namplitude_m = {amplitude_m}\nangle_deg = {}\n",
        bow.angle_rad.to_degrees()
    )
}
