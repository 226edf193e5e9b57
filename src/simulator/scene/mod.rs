//! Scenes: what is simulated and what watches it, as a text of TOML (`docs/simulator.md`).
//!
//! `file` walks the document and gathers every mistake, `parts` and `sensors` know the tables, `errors`
//! and `lengths` word what is allowed, `builtin` holds the scenes that come with the program. All
//! lengths are m, angles rad, whatever the file's units were. Reads text, never a file; must not know how a
//! scene is computed.

mod errors;
mod lengths;
pub mod limits;
mod file;
mod shafts;
mod parts;
mod bearings;
mod gears;
mod sensors;
mod truth;
pub mod builtin;

pub use errors::SceneErrors;

use super::beam::Section;
use super::contact::{BallBearing, DefectPlace};
use super::mesh::{MeshDesign, ToothFault};
use super::rotor::{Disc, Place};
use super::speed::SpeedProfile;

/// Longest scene that is read, bytes: it goes into captures as one attribute, which holds 64 kB.
pub const MAX_TEXT_BYTES: usize = 60_000;

/// A scene, ready to be built.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Name for people and for the capture's truth.
    pub name: String,
    /// Name of the file it was read from, for messages.
    pub file_name: String,
    /// The text it was read from.
    pub text: String,
    /// Length of a record, s.
    pub duration_s: f64,
    /// The state at time 0.
    pub start: Start,
    /// Relative error of the motion that the steps are chosen for.
    pub accuracy: f64,
    /// Seed of the noise unless another is given.
    pub seed: u64,
    /// Direction of gravity, rad from x towards y; `None`: none.
    pub gravity_rad: Option<f64>,
    /// How the first shaft turns.
    pub speed: SpeedProfile,
    /// Shafts, one or two.
    pub shafts: Vec<SceneShaft>,
    /// Discs with their unbalance.
    pub discs: Vec<SceneDisc>,
    /// Bearings, at least two on each shaft.
    pub bearings: Vec<SceneBearing>,
    /// Gears, at most one.
    pub gears: Vec<SceneGear>,
    /// Residual bow.
    pub bow: Option<Bow>,
    /// Unbalances beside those of the discs.
    pub unbalances: Vec<Unbalance>,
    /// What is chosen about the modes.
    pub modes: ModeChoice,
    /// Sensors, at least one.
    pub sensors: Vec<SceneSensor>,
    /// The machine file of the capture.
    pub machine: Option<MachineText>,
    /// Where the tables stand: path, line, column.
    places: Vec<(String, usize, usize)>,
}

/// The state at time 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Start {
    /// At rest and straight, loads set in at once.
    Rest,
    /// Turning for ever: the steady motion.
    Rotating,
}

/// A shaft.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneShaft {
    /// Identifier.
    pub id: String,
    /// Its section.
    pub section: Section,
    /// Its length, m.
    pub length_m: f64,
}

/// A disc and the distance of its centre of mass from the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneDisc {
    /// Number of the shaft it is on.
    pub shaft: usize,
    /// The disc.
    pub disc: Disc,
    /// Eccentricity, m.
    pub eccentricity_m: f64,
    /// Its direction in the shaft, rad from the mark.
    pub eccentricity_rad: f64,
}

/// A bearing at its place.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneBearing {
    /// Identifier.
    pub id: String,
    /// Its place.
    pub place: Place,
    /// Mass of the ring that moves with the shaft, kg.
    pub ring_mass_kg: f64,
    /// Stiffness put into the modes, N/m.
    pub support_n_per_m: f64,
    /// What carries the shaft.
    pub kind: BearingKind,
}

/// What carries the shaft.
#[derive(Debug, Clone, PartialEq)]
pub enum BearingKind {
    /// Balls in Hertzian contact.
    Ball(SceneBall),
    /// F = −K·u − C·u̇.
    Linear {
        /// K [[xx, xy], [yx, yy]], N/m.
        stiffness_n_per_m: [[f64; 2]; 2],
        /// C, N·s/m.
        damping_n_s_per_m: [[f64; 2]; 2],
    },
}

/// A ball bearing, its size and its damage.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneBall {
    /// The bearing without its defects.
    pub bearing: BallBearing,
    /// Ball diameter, m.
    pub ball_diameter_m: f64,
    /// Pitch diameter, m.
    pub pitch_diameter_m: f64,
    /// Load of a ball at which its contact with the inner race yields, N; `None`: not known, the
    /// contact factor was given.
    pub yield_load_n: Option<f64>,
    /// Defects.
    pub defects: Vec<SceneDefect>,
}

/// A localised defect as a file tells it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneDefect {
    /// Where.
    pub place: DefectPlace,
    /// Angle of its centre, rad.
    pub angle_rad: f64,
    /// Width along the race (on a ball: along its surface), m.
    pub width_m: f64,
    /// Depth, m.
    pub depth_m: f64,
    /// Shape.
    pub profile: ProfileKind,
    /// Radius its width is counted on, m; `None`: the race's (or the ball's) own.
    pub radius_m: Option<f64>,
}

/// Shape of a defect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ProfileKind {
    /// The whole depth at once.
    Step,
    /// Half a cosine wave.
    RaisedCosine,
    /// The path of the centre of a ball that rolls over the edge.
    Geometric,
}

/// A gear on the first shaft and its mate.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneGear {
    /// Identifier.
    pub id: String,
    /// Place along the shaft, m.
    pub at_m: f64,
    /// Its body.
    pub disc: Disc,
    /// The two gears and their fit, without faults.
    pub design: MeshDesign,
    /// Mean stiffness of the healthy mesh, N/m.
    pub mean_stiffness_n_per_m: f64,
    /// Direction of the force on the gear by its drive flanks, rad from x towards y.
    pub line_of_action_rad: f64,
    /// Load on the shaft, N·m, against forward rotation: it presses the drive flanks together.
    pub torque_n_m: f64,
    /// Where the load is, m.
    pub torque_at_m: f64,
    /// Whether shafts turn as a whole on the mesh.
    pub is_rigid: bool,
    /// What the mate does.
    pub mate: SceneMate,
    /// Faults of teeth.
    pub faults: Vec<ToothFault>,
}

/// What the mate of a gear does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SceneMate {
    /// It turns as the speed profile says, rigid, its centre at rest.
    Prescribed,
    /// It sits on the second shaft, which is driven through a coupling.
    Shaft(MateSeat),
}

/// The mate on the second shaft, and what drives that.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MateSeat {
    /// Its body; solid of its pitch diameter.
    pub disc: Disc,
    /// Place along the shaft at which a coupling turns it as the speed profile says, m.
    pub driven_at_m: f64,
    /// Stiffness of that coupling, N·m/rad.
    pub coupling_n_m_per_rad: f64,
}

/// A shaft that is bent at rest.
#[derive(Debug, Clone, PartialEq)]
pub struct Bow {
    /// Identifier of the shaft; `None`: the first.
    pub shaft: Option<String>,
    /// Its direction in the shaft, rad from the mark.
    pub angle_rad: f64,
    /// Its shape.
    pub shape: BowShape,
}

/// Shape of a bow.
#[derive(Debug, Clone, PartialEq)]
pub enum BowShape {
    /// Half a sine wave between the first and the last bearing, straight on beyond them.
    HalfSine {
        /// Largest deflection, m.
        amplitude_m: f64,
    },
    /// The free shaft bent elastically through points (place m, deflection m).
    Points(Vec<(f64, f64)>),
}

/// An unbalance of its own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unbalance {
    /// Its place.
    pub place: Place,
    /// Mass times distance from the axis, kg·m.
    pub kg_m: f64,
    /// Direction in the shaft, rad from the mark.
    pub angle_rad: f64,
}

/// What is chosen about the modes; `None`: chosen by the sensors' band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModeChoice {
    /// Modes of each plane.
    pub count: Option<usize>,
    /// Damping ratio of every shape.
    pub damping: f64,
    /// Whether each ball or linear bearing has a static attachment shape.
    pub attachment: bool,
    /// Elements between neighbouring places.
    pub elements_per_span: Option<u32>,
}

/// A sensor and its converter.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneSensor {
    /// Name of its channel.
    pub channel: String,
    /// Quantity.
    pub kind: SensorKind,
    /// Its place; of a tacho the shaft alone matters.
    pub place: Place,
    /// Sensitive direction, rad from x towards y.
    pub axis_rad: f64,
    /// Samples a second.
    pub rate_hz: f64,
    /// Corner of the anti-alias filter, Hz.
    pub corner_hz: f64,
    /// Unit of its values.
    pub unit: &'static str,
    /// Its values ÷ SI values.
    pub per_si: f64,
    /// One-sided noise density, unit/√Hz; 0: clean.
    pub noise_density: f64,
    /// Largest value from rest, unit.
    pub full_scale: f64,
    /// Bits of the converter.
    pub bits: u32,
    /// Number type of its samples.
    pub number: NumberKind,
    /// Slow drift, unit/s.
    pub drift_per_s: f64,
    /// What it reads at rest (a probe's gap), unit.
    pub rest: f64,
    /// Times between which it gives 0, s.
    pub dropouts_s: Vec<(f64, f64)>,
}

/// Kind of a sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SensorKind {
    /// Acceleration of the shaft at its place; with stiff housings that of the housing.
    Accelerometer,
    /// Displacement of the shaft.
    Proximitor,
    /// A mark once a turn, 0 to 5 V.
    Tacho,
}

/// Number type of a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NumberKind {
    /// Counts of the converter.
    Int16,
    /// Physical values, single precision, no converter.
    Float32,
    /// Physical values, double precision, no converter.
    Float64,
}

/// The machine file that goes into the capture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum MachineText {
    /// Its text.
    Inline(String),
    /// Its path, as written: whoever reads files reads it.
    File(String),
}

/// What is damaged, by part; can be exchanged while a scene runs.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Faults {
    /// Defects of ball bearings, by the identifier of the bearing.
    pub defects: Vec<(String, SceneDefect)>,
    /// Residual bow.
    pub bow: Option<Bow>,
    /// Faults of teeth, by the identifier of the gear.
    pub teeth: Vec<(String, ToothFault)>,
}

impl Scene {
    /// Reads a scene; `file_name` only labels the mistakes.
    ///
    /// # Errors
    ///
    /// Every mistake, with line, column, key and what is allowed.
    pub fn parse(text: &str, file_name: &str) -> Result<Self, SceneErrors> {
        file::parse(text, file_name)
    }

    /// The faults the scene begins with.
    #[must_use]
    pub fn faults(&self) -> Faults {
        let of = |bearing: &SceneBearing| match &bearing.kind {
            BearingKind::Ball(ball) => {
                ball.defects.iter().map(|defect| (bearing.id.clone(), *defect)).collect()
            }
            BearingKind::Linear { .. } => Vec::new(),
        };
        let of_gear = |gear: &SceneGear| {
            gear.faults.iter().map(|fault| (gear.id.clone(), *fault)).collect::<Vec<_>>()
        };
        Faults {
            defects: self.bearings.iter().flat_map(of).collect(),
            bow: self.bow.clone(),
            teeth: self.gears.iter().flat_map(of_gear).collect(),
        }
    }

    /// The faults, one TOML table each, for the truth of a capture; empty for a healthy machine.
    #[must_use]
    pub fn truth(&self) -> String {
        truth::listed(self)
    }

    /// Turns of a shaft to one of the first: below 0 for the second, which its gear turns against it.
    #[must_use]
    pub fn turns(&self, shaft: usize) -> f64 {
        let ratio = |gear: &SceneGear| -gear.design.gear.z() / gear.design.mate.z();
        if shaft == 0 { 1.0 } else { self.gears.first().map_or(0.0, ratio) }
    }

    /// Number of the shaft a bow is of; `None` if there is no such shaft.
    #[must_use]
    pub fn shaft_of(&self, bow: &Bow) -> Option<usize> {
        let id = bow.shaft.as_ref();
        id.map_or(Some(0), |id| self.shafts.iter().position(|shaft| shaft.id == *id))
    }

    /// Whether some bearing has balls, or a gear has teeth.
    #[must_use]
    pub fn has_contacts(&self) -> bool {
        let has_balls = |bearing: &SceneBearing| matches!(bearing.kind, BearingKind::Ball(_));
        !self.gears.is_empty() || self.bearings.iter().any(has_balls)
    }

    /// The ball bearings with their identifiers, in the order of the scene.
    pub(super) fn ball_bearings(&self) -> impl Iterator<Item = (&str, &SceneBall)> {
        self.bearings.iter().filter_map(|bearing| match &bearing.kind {
            BearingKind::Ball(ball) => Some((bearing.id.as_str(), ball)),
            BearingKind::Linear { .. } => None,
        })
    }

    /// A mistake found after reading, at the table of this path.
    pub(super) fn mistake(
        &self,
        path: &str,
        found: impl Into<String>,
        allowed: impl Into<String>,
    ) -> SceneErrors {
        let place = self.places.iter().find(|(known, _, _)| known == path);
        let (line, column) = place.map_or((1, 1), |(_, line, column)| (*line, *column));
        SceneErrors::one(&self.file_name, (line, column), path, found.into(), allowed.into())
    }
}

impl SceneBall {
    /// The bearing with these defects in place of its own.
    #[must_use]
    pub fn with_defects(&self, defects: &[SceneDefect]) -> BallBearing {
        let mut bearing = self.bearing.clone();
        bearing.defects = defects.iter().map(|defect| self.defect(defect)).collect();
        bearing
    }

    /// Radius on which a defect's width is counted, m.
    #[must_use]
    pub fn radius_m(&self, defect: &SceneDefect) -> f64 {
        let (ball, pitch) = (self.ball_diameter_m, self.pitch_diameter_m);
        defect.radius_m.unwrap_or(match defect.place {
            DefectPlace::InnerRace => 0.5 * (pitch - ball),
            DefectPlace::OuterRace => 0.5 * (pitch + ball),
            DefectPlace::Element(_) => 0.5 * ball,
        })
    }
}

#[cfg(test)]
mod tests;
