//! Simulated sources as JSON: what is damaged, what shall be, and whether the pace is kept.
//!
//! Where a scenario's faults change their form: a new kind of fault is a variant of [`FaultWire`]
//! and a line in each of its two conversions.

use super::finite;
use super::machines::source_text;
use super::rfc3339;
use super::tooth::ToothWire;
use crate::api::view::MachineView;
use crate::ingest::simulated::Status;
use crate::simulator::contact::DefectPlace;
use crate::simulator::scenario::Wanted;
use crate::simulator::scenario::amplitude_m;
use crate::simulator::scene::Bow;
use crate::simulator::scene::BowShape;
use crate::simulator::scene::Faults;
use crate::simulator::scene::ProfileKind;
use crate::simulator::scene::SceneDefect;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Speeds at which a simulated shaft may be told to turn, Hz.
const SPEEDS_HZ: (f64, f64) = (1.0, 60.0);

/// Longest growth, s of simulated time.
pub const MAX_GROW_S: f64 = 86_400.0;

/// Most faults of a scenario.
pub const MAX_FAULTS: usize = 32;

/// Another scenario: by name, or fault by fault.
#[derive(Debug, Clone, PartialEq, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ScenarioBody {
    /// Machine id; needed where several machines are simulated.
    pub machine: Option<String>,
    /// A combination: gear, shaft and bearing, good (G) or bad (B), such as `GG_BS_BB`. Either this
    /// or `faults`.
    pub scenario: Option<String>,
    /// All faults there shall be; an empty list heals everything.
    pub faults: Option<Vec<FaultWire>>,
    /// Simulated time over which the damage grows from what it is now, s.
    #[serde(default)]
    #[schema(minimum = 0.0, maximum = 86400.0)]
    pub grow_s: f64,
    /// Speed of the shaft, Hz, of a scene with one speed: the scene begins anew at it with the damage that it has; samples go
    /// on. May be given alone.
    #[schema(minimum = 1.0, maximum = 60.0)]
    pub shaft_speed_hz: Option<f64>,
}

/// A fault of a simulated machine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema, ToSchema)]
#[serde(tag = "fault", rename_all = "snake_case", deny_unknown_fields)]
pub enum FaultWire {
    /// A defect of the inner race; turns with the shaft.
    InnerRace(DefectWire),
    /// A defect of the outer race; stands.
    OuterRace(DefectWire),
    /// A defect of one ball.
    RollingElement(BallDefectWire),
    /// A bent shaft.
    Bow(BowWire),
    /// Damage of a gear's tooth.
    ToothDamage(ToothWire),
}

/// Size and place of a defect of a race.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct DefectWire {
    /// Id of a ball bearing of the scene.
    pub bearing: String,
    /// Width along the race.
    pub width_mm: f64,
    /// Depth.
    pub depth_um: f64,
    /// Angle of its centre: on the inner race from the shaft's mark, on the outer one from the x
    /// axis.
    #[serde(default)]
    pub angle_deg: f64,
    /// Shape of its edges.
    #[serde(default)]
    pub profile: ProfileName,
}

/// Size and place of a defect of a ball.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BallDefectWire {
    /// Id of a ball bearing of the scene.
    pub bearing: String,
    /// Which ball, counted from 0.
    #[serde(default)]
    pub ball: u32,
    /// Width along the ball's surface.
    pub width_mm: f64,
    /// Depth.
    pub depth_um: f64,
    /// Angle of its centre, from the point that touches the outer race at shaft angle 0.
    #[serde(default)]
    pub angle_deg: f64,
    /// Shape of its edges.
    #[serde(default)]
    pub profile: ProfileName,
}

/// Size and direction of a bow: half a sine wave between the outermost bearings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct BowWire {
    /// Id of a shaft of the scene; absent: the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shaft: Option<String>,
    /// Largest deflection.
    pub amplitude_um: f64,
    /// Direction in the shaft, from its mark.
    #[serde(default)]
    pub angle_deg: f64,
}

/// Shape of a defect's edges.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema, ToSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum ProfileName {
    /// The path of the centre of a ball that rolls over the edge.
    #[default]
    Geometric,
    /// The whole depth at once.
    Step,
    /// Half a cosine wave.
    RaisedCosine,
}

/// The simulated sources.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct SimulationListWire {
    /// One entry a simulated machine, in the order of the ids.
    pub items: Vec<SimulationWire>,
}

/// A simulated source: what it simulates is the truth, which no diagnosis reads.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema, ToSchema)]
pub struct SimulationWire {
    /// Machine id.
    pub machine: String,
    /// starting, running or failed.
    pub source: String,
    /// Name of the scene.
    pub scene: String,
    /// The combination asked for; null if the faults are none of them.
    pub scenario: Option<String>,
    /// Combinations the scene can have.
    pub scenarios: Vec<String>,
    /// Faults asked for.
    pub faults: Vec<FaultWire>,
    /// Faults at present; differ from `faults` while they grow.
    pub present: Vec<FaultWire>,
    /// When they were asked for, in stream time.
    pub since: String,
    /// The same in seconds of simulated time.
    pub since_s: f64,
    /// Whether they still grow.
    pub growing: bool,
    /// Simulated time at which they are fully grown, s.
    pub grown_at_s: f64,
    /// Simulated time so far, s.
    pub simulated_s: f64,
    /// Speed of the shaft, Hz; null: the scene has a profile of speeds.
    pub shaft_speed_hz: Option<f64>,
    /// Simulated seconds a second; null: as fast as they are taken.
    pub speed: Option<f64>,
    /// How late the newest block was, s of the clock.
    pub lag_s: Option<f64>,
    /// Lag given up since the start: simulated time is behind the clock by this for good.
    pub lag_given_up_s: Option<f64>,
    /// Whether the pace is kept: no lag was given up in the last ten seconds of simulated time.
    pub keeps_pace: bool,
    /// What went beyond the scene's model so far.
    pub warnings: Vec<String>,
}

impl ScenarioBody {
    /// What is wanted, `None` if only another speed is, and over which simulated time it grows, s.
    ///
    /// # Errors
    /// What is wrong, and what is allowed.
    pub fn wanted(&self) -> Result<(Option<Wanted>, f64), String> {
        let (slowest, fastest) = SPEEDS_HZ;
        if let Some(speed) = self.shaft_speed_hz.filter(|hz| !(slowest..=fastest).contains(hz)) {
            return Err(format!("shaft_speed_hz is {speed}, allowed: {slowest} to {fastest}"));
        }
        if !(0.0..=MAX_GROW_S).contains(&self.grow_s) {
            return Err(format!("grow_s is {}, allowed: 0 to {MAX_GROW_S}", self.grow_s));
        }
        let wanted = match (&self.scenario, &self.faults) {
            (Some(name), None) => Some(Wanted::Combination(name.clone())),
            (None, Some(list)) => Some(Wanted::Faults(faults(list)?)),
            (None, None) if self.shaft_speed_hz.is_some() => None,
            (Some(_), Some(_)) => {
                return Err("both scenario and faults are given, one of them is allowed".to_owned());
            }
            (None, None) => {
                return Err(
                    "neither scenario nor faults nor shaft_speed_hz is given, one of them is needed".to_owned()
                );
            }
        };
        Ok((wanted, self.grow_s))
    }
}

/// A list as the simulator takes it.
fn faults(list: &[FaultWire]) -> Result<Faults, String> {
    if list.len() > MAX_FAULTS {
        return Err(format!("{} faults are given, at most {MAX_FAULTS} are allowed", list.len()));
    }
    let mut faults = Faults::default();
    for fault in list {
        match fault {
            FaultWire::InnerRace(d) => faults.defects.push(d.defect(DefectPlace::InnerRace)),
            FaultWire::OuterRace(d) => faults.defects.push(d.defect(DefectPlace::OuterRace)),
            FaultWire::RollingElement(d) => faults.defects.push(d.defect()),
            FaultWire::Bow(_) if faults.bow.is_some() => {
                return Err("two bows are given, a shaft has one".to_owned());
            }
            FaultWire::Bow(bow) => {
                let shape = BowShape::HalfSine { amplitude_m: bow.amplitude_um * 1e-6 };
                let angle_rad = bow.angle_deg.to_radians();
                faults.bow = Some(Bow { shaft: bow.shaft.clone(), angle_rad, shape });
            }
            FaultWire::ToothDamage(tooth) => faults.teeth.push(tooth.fault()?),
        }
    }
    Ok(faults)
}

/// The simulator's faults as a list.
fn listed(faults: &Faults) -> Vec<FaultWire> {
    let defects = faults.defects.iter().map(|(id, defect)| FaultWire::of_defect(id, defect));
    let bow = faults.bow.as_ref().map(|bow| {
        FaultWire::Bow(BowWire {
            shaft: bow.shaft.clone(),
            amplitude_um: tidy(amplitude_m(&bow.shape) * 1e6),
            angle_deg: tidy(bow.angle_rad.to_degrees()),
        })
    });
    let teeth = faults.teeth.iter();
    let teeth = teeth.map(|(id, fault)| FaultWire::ToothDamage(ToothWire::new(id, fault)));
    defects.chain(bow).chain(teeth).collect()
}

impl DefectWire {
    fn defect(&self, place: DefectPlace) -> (String, SceneDefect) {
        let size = (self.width_mm, self.depth_um, self.angle_deg);
        (self.bearing.clone(), defect(place, size, self.profile))
    }
}

impl BallDefectWire {
    fn defect(&self) -> (String, SceneDefect) {
        let size = (self.width_mm, self.depth_um, self.angle_deg);
        (self.bearing.clone(), defect(DefectPlace::Element(self.ball), size, self.profile))
    }
}

/// A defect of width mm, depth µm and angle degrees.
fn defect(
    place: DefectPlace,
    (width_mm, depth_um, angle_deg): (f64, f64, f64),
    profile: ProfileName,
) -> SceneDefect {
    SceneDefect {
        place,
        angle_rad: angle_deg.to_radians(),
        width_m: width_mm * 1e-3,
        depth_m: depth_um * 1e-6,
        profile: match profile {
            ProfileName::Geometric => ProfileKind::Geometric,
            ProfileName::Step => ProfileKind::Step,
            ProfileName::RaisedCosine => ProfileKind::RaisedCosine,
        },
        radius_m: None,
    }
}

impl FaultWire {
    fn of_defect(id: &str, defect: &SceneDefect) -> Self {
        let bearing = id.to_owned();
        let (width_mm, depth_um) = (tidy(defect.width_m * 1e3), tidy(defect.depth_m * 1e6));
        let angle_deg = tidy(defect.angle_rad.to_degrees());
        let profile = match defect.profile {
            ProfileKind::Geometric => ProfileName::Geometric,
            ProfileKind::Step => ProfileName::Step,
            ProfileKind::RaisedCosine => ProfileName::RaisedCosine,
        };
        let of_race = |bearing| DefectWire { bearing, width_mm, depth_um, angle_deg, profile };
        match defect.place {
            DefectPlace::InnerRace => Self::InnerRace(of_race(bearing)),
            DefectPlace::OuterRace => Self::OuterRace(of_race(bearing)),
            DefectPlace::Element(ball) => Self::RollingElement(BallDefectWire {
                bearing,
                ball,
                width_mm,
                depth_um,
                angle_deg,
                profile,
            }),
        }
    }
}

/// A length or angle to a millionth of its unit: what a change of units leaves is no information.
pub(super) fn tidy(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

impl SimulationWire {
    /// Makes the entry of a machine.
    #[must_use]
    pub fn new(machine: &str, status: &Status, view: &MachineView) -> Self {
        let paced = status.speed.is_some();
        Self {
            machine: machine.to_owned(),
            source: source_text(&view.source).0.to_owned(),
            scene: status.scene.clone(),
            scenario: status.scenario.map(str::to_owned),
            scenarios: status.possible.iter().map(|name| (*name).to_owned()).collect(),
            faults: listed(&status.wanted),
            present: listed(&status.present),
            since: rfc3339(view.start_time, status.since_s),
            since_s: status.since_s,
            growing: status.present != status.wanted,
            grown_at_s: status.grown_at_s,
            simulated_s: status.simulated_s,
            shaft_speed_hz: status.shaft_speed_hz.and_then(finite),
            speed: status.speed,
            lag_s: finite(status.lag.now_s).filter(|_| paced),
            lag_given_up_s: finite(status.lag.given_up_s).filter(|_| paced),
            keeps_pace: status.keeps_pace,
            warnings: status.warnings.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulator::mesh::{Fault, Member, ToothFault};
    use serde_json::json;

    fn body(value: serde_json::Value) -> Result<(Wanted, f64), String> {
        let body: ScenarioBody = serde_json::from_value(value).map_err(|e| e.to_string())?;
        body.wanted().map(|(wanted, grow_s)| (wanted.unwrap(), grow_s))
    }

    #[test]
    fn every_kind_of_fault_comes_back_as_it_was_given() {
        let list = json!([
            { "fault": "inner_race", "bearing": "right", "width_mm": 1.27, "depth_um": 101.6,
              "angle_deg": 0.0, "profile": "geometric" },
            { "fault": "outer_race", "bearing": "left", "width_mm": 0.5, "depth_um": 20.0,
              "angle_deg": 270.0, "profile": "step" },
            { "fault": "rolling_element", "bearing": "left", "ball": 3, "width_mm": 0.5,
              "depth_um": 20.0, "angle_deg": -12.5, "profile": "raised_cosine" },
            { "fault": "bow", "amplitude_um": 203.2, "angle_deg": 45.0 },
            { "fault": "tooth_damage", "kind": "worn", "gear": "mesh-1", "member": "gear",
              "tooth": 23, "depth_um": 12.7, "stiffness_factor": 0.8 },
            { "fault": "tooth_damage", "kind": "cracked", "gear": "mesh-1", "member": "mate",
              "tooth": 1, "depth_um": 900.0, "crack_angle_deg": 45.0 },
            { "fault": "tooth_damage", "kind": "missing", "gear": "mesh-1", "member": "gear",
              "tooth": 28 },
            { "fault": "tooth_damage", "kind": "profile_error", "gear": "mesh-1",
              "member": "gear", "tooth": 2, "slope_um": -3.0, "form_um": 4.0 },
            { "fault": "tooth_damage", "kind": "pitch_error", "gear": "mesh-1", "member": "gear",
              "tooth": 3, "offset_um": 8.0 },
        ]);
        let (wanted, grow_s) = body(json!({ "faults": list, "grow_s": 5 })).unwrap();
        let Wanted::Faults(faults) = wanted else { panic!("a list") };
        assert!((grow_s - 5.0).abs() < 1e-12);
        assert_eq!(serde_json::to_value(listed(&faults)).unwrap(), list);
        let (_, inner) = &faults.defects[0];
        assert!(
            (inner.width_m - 1.27e-3).abs() < 1e-15 && (inner.depth_m - 101.6e-6).abs() < 1e-15
        );
    }

    #[test]
    fn keys_of_teeth_have_the_defaults_of_a_scene() {
        let tooth = |value: serde_json::Value| {
            let (wanted, _) = body(json!({ "faults": [value] })).unwrap();
            let Wanted::Faults(faults) = wanted else { panic!("a list") };
            faults.teeth[0].clone()
        };
        let worn = json!({ "fault": "tooth_damage", "kind": "worn", "gear": "g", "tooth": 23,
            "depth_um": 12.5 });
        let fault = Fault::Worn { depth_m: 12.5 * 1e-6, stiffness_factor: 1.0 };
        let expected = ToothFault { member: Member::Gear, tooth: 22, fault };
        assert_eq!(tooth(worn), ("g".to_owned(), expected));
        let cracked = json!({ "fault": "tooth_damage", "kind": "cracked", "gear": "g", "tooth": 1,
            "depth_um": 500 });
        let Fault::Cracked(crack) = tooth(cracked).1.fault else { panic!("a crack") };
        assert!((crack.angle_rad.to_degrees() - 60.0).abs() < 1e-12);
    }

    #[test]
    fn bodies_that_say_too_much_or_too_little_are_refused() {
        let bow = json!({ "fault": "bow", "amplitude_um": 1.0 });
        let tooth = |kind: &str, more: serde_json::Value| {
            let mut fault =
                json!({ "fault": "tooth_damage", "kind": kind, "gear": "mesh-1", "tooth": 1 });
            fault.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
            fault
        };
        for (value, words) in [
            (json!({}), "neither scenario nor faults"),
            (json!({ "scenario": "GG_GS_GB", "faults": [] }), "both scenario and faults"),
            (json!({ "scenario": "GG_GS_GB", "grow_s": -1 }), "grow_s is -1"),
            (json!({ "scenario": "GG_GS_GB", "grow_s": 1e9 }), "0 to 86400"),
            (json!({ "scenario": 3 }), "expected a string"),
            (json!({ "scenario": "GG_GS_GB", "speed": 2 }), "unknown field `speed`"),
            (json!({ "faults": [{ "fault": "crack" }] }), "unknown variant `crack`"),
            (json!({ "faults": [{ "fault": "bow" }] }), "missing field `amplitude_um`"),
            (json!({ "faults": [{ "fault": "bow", "amplitude_um": 1, "width": 2 }] }), "`width`"),
            (json!({ "faults": [bow, bow] }), "two bows"),
            (
                json!({ "faults": [tooth("worn", json!({}))] }),
                "neither depth_um nor stiffness_factor",
            ),
            (json!({ "faults": [tooth("worn", json!({ "tooth": 0, "depth_um": 1 }))] }), "found 0"),
            (json!({ "faults": [tooth("worn", json!({ "depth_mil": 1 }))] }), "`depth_mil`"),
            (json!({ "faults": [tooth("cracked", json!({}))] }), "missing field `depth_um`"),
            (json!({ "faults": [tooth("missing", json!({ "depth_um": 1 }))] }), "`depth_um`"),
            (
                json!({ "faults": [tooth("profile_error", json!({}))] }),
                "neither slope_um nor form_um",
            ),
            (json!({ "faults": [tooth("pitch_error", json!({}))] }), "missing field `offset_um`"),
            (json!({ "faults": [tooth("bent", json!({}))] }), "unknown variant `bent`"),
            (json!({ "faults": [tooth("worn", json!({ "member": "pinion" }))] }), "`pinion`"),
            (json!({ "faults": vec![bow.clone(); 33] }), "at most 32"),
        ] {
            let told = body(value.clone()).unwrap_err();
            assert!(told.contains(words), "{value}: {told}");
        }
    }
}
