//! Faults of teeth as JSON: the keys of a scene's `[[gear.fault]]`, lengths in µm.

use super::simulation::tidy;
use crate::simulator::mesh::Crack;
use crate::simulator::mesh::Fault;
use crate::simulator::mesh::Member;
use crate::simulator::mesh::ToothFault;
use crate::simulator::scene::limits::CRACK_DEFAULT_DEG;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// Damage of one tooth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema, ToSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum ToothWire {
    /// A layer gone from the drive flank.
    Worn(WornWire),
    /// A crack from the root, open under load on the drive flank.
    Cracked(CrackedWire),
    /// The tooth is gone.
    Missing(MissingWire),
    /// A drive flank that lacks material at the tip or in the middle.
    ProfileError(ProfileErrorWire),
    /// A tooth off its place.
    PitchError(PitchErrorWire),
}

/// Whose tooth.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema, ToSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum MemberName {
    /// The gear on the shaft.
    #[default]
    Gear,
    /// Its mate.
    Mate,
}

/// A worn tooth: a depth, a stiffness factor, or both.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct WornWire {
    /// Id of a gear of the scene.
    pub gear: String,
    /// Whose tooth.
    #[serde(default)]
    pub member: MemberName,
    /// Which tooth, counted from 1 in the order in which they pass the pitch point.
    pub tooth: u32,
    /// Layer gone, normal to the flank; 0 unless given.
    pub depth_um: Option<f64>,
    /// Factor on the stiffness of the tooth's pair; 1 unless given.
    pub stiffness_factor: Option<f64>,
}

/// A cracked tooth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct CrackedWire {
    /// Id of a gear of the scene.
    pub gear: String,
    /// Whose tooth.
    #[serde(default)]
    pub member: MemberName,
    /// Which tooth, counted from 1 in the order in which they pass the pitch point.
    pub tooth: u32,
    /// Length of the crack.
    pub depth_um: f64,
    /// Its angle to the centre line of the tooth.
    #[serde(default = "crack_deg")]
    pub crack_angle_deg: f64,
}

/// A tooth that is gone.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct MissingWire {
    /// Id of a gear of the scene.
    pub gear: String,
    /// Whose tooth.
    #[serde(default)]
    pub member: MemberName,
    /// Which tooth, counted from 1 in the order in which they pass the pitch point.
    pub tooth: u32,
}

/// A flank that lacks material: a slope, a form, or both.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ProfileErrorWire {
    /// Id of a gear of the scene.
    pub gear: String,
    /// Whose tooth.
    #[serde(default)]
    pub member: MemberName,
    /// Which tooth, counted from 1 in the order in which they pass the pitch point.
    pub tooth: u32,
    /// Missing at the tip, linear to the root; below 0: too much. 0 unless given.
    pub slope_um: Option<f64>,
    /// Missing in the middle; below 0: too much. 0 unless given.
    pub form_um: Option<f64>,
}

/// A tooth off its place.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct PitchErrorWire {
    /// Id of a gear of the scene.
    pub gear: String,
    /// Whose tooth.
    #[serde(default)]
    pub member: MemberName,
    /// Which tooth, counted from 1 in the order in which they pass the pitch point.
    pub tooth: u32,
    /// Away from the mate; below 0: towards it.
    pub offset_um: f64,
}

fn crack_deg() -> f64 {
    CRACK_DEFAULT_DEG
}

impl ToothWire {
    /// The fault as the simulator takes it, with the gear's id.
    ///
    /// # Errors
    /// What is wrong, and what is allowed.
    pub(super) fn fault(&self) -> Result<(String, ToothFault), String> {
        let (gear, member, tooth, fault) = match self {
            Self::Worn(w) => (&w.gear, w.member, w.tooth, w.fault()?),
            Self::Cracked(c) => (&c.gear, c.member, c.tooth, c.fault()),
            Self::Missing(m) => (&m.gear, m.member, m.tooth, Fault::Missing),
            Self::ProfileError(p) => (&p.gear, p.member, p.tooth, p.fault()?),
            Self::PitchError(p) => {
                (&p.gear, p.member, p.tooth, Fault::Pitch { offset_m: p.offset_um * 1e-6 })
            }
        };
        let Some(tooth) = tooth.checked_sub(1) else {
            return Err(format!("tooth_damage of {gear}, tooth: found 0, allowed: 1 or more"));
        };
        let member = match member {
            MemberName::Gear => Member::Gear,
            MemberName::Mate => Member::Mate,
        };
        Ok((gear.clone(), ToothFault { member, tooth, fault }))
    }

    /// A fault of the simulator.
    pub(super) fn new(id: &str, fault: &ToothFault) -> Self {
        let (gear, tooth) = (id.to_owned(), fault.tooth.saturating_add(1));
        let member = match fault.member {
            Member::Gear => MemberName::Gear,
            Member::Mate => MemberName::Mate,
        };
        let um = |m: f64| tidy(m * 1e6);
        match fault.fault {
            Fault::Worn { depth_m, stiffness_factor } => {
                let depth_um = Some(um(depth_m));
                let stiffness_factor = Some(tidy(stiffness_factor));
                Self::Worn(WornWire { gear, member, tooth, depth_um, stiffness_factor })
            }
            Fault::Cracked(Crack { depth_m, angle_rad }) => {
                let (depth_um, crack_angle_deg) = (um(depth_m), tidy(angle_rad.to_degrees()));
                Self::Cracked(CrackedWire { gear, member, tooth, depth_um, crack_angle_deg })
            }
            Fault::Missing => Self::Missing(MissingWire { gear, member, tooth }),
            Fault::Profile { slope_m, form_m } => {
                let (slope_um, form_um) = (Some(um(slope_m)), Some(um(form_m)));
                Self::ProfileError(ProfileErrorWire { gear, member, tooth, slope_um, form_um })
            }
            Fault::Pitch { offset_m } => {
                let offset_um = um(offset_m);
                Self::PitchError(PitchErrorWire { gear, member, tooth, offset_um })
            }
        }
    }
}

impl WornWire {
    fn fault(&self) -> Result<Fault, String> {
        if self.depth_um.is_none() && self.stiffness_factor.is_none() {
            return Err(format!(
                "tooth_damage of {}: neither depth_um nor stiffness_factor is given, one of them or \
                 both are needed",
                self.gear
            ));
        }
        let depth_m = self.depth_um.unwrap_or(0.0) * 1e-6;
        Ok(Fault::Worn { depth_m, stiffness_factor: self.stiffness_factor.unwrap_or(1.0) })
    }
}

impl CrackedWire {
    fn fault(&self) -> Fault {
        let angle_rad = self.crack_angle_deg.to_radians();
        Fault::Cracked(Crack { depth_m: self.depth_um * 1e-6, angle_rad })
    }
}

impl ProfileErrorWire {
    fn fault(&self) -> Result<Fault, String> {
        if self.slope_um.is_none() && self.form_um.is_none() {
            return Err(format!(
                "tooth_damage of {}: neither slope_um nor form_um is given, one of them or both are \
                 needed",
                self.gear
            ));
        }
        let m = |um: Option<f64>| um.unwrap_or(0.0) * 1e-6;
        Ok(Fault::Profile { slope_m: m(self.slope_um), form_m: m(self.form_um) })
    }
}
