//! Gear meshes.

use super::ShaftIndex;
use crate::units::Hz;

/// One wheel of a mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct GearMember {
    /// Shaft it sits on.
    pub shaft: ShaftIndex,
    /// Number of teeth, ≥ 1.
    pub teeth: u32,
    /// Shaft angle after the tacho mark at which tooth 1 is at the pitch point, degrees.
    pub tooth_1_at_deg: Option<f64>,
}

/// A pair of gears in mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct GearMesh {
    /// Identifier.
    pub id: String,
    /// The driving gear.
    pub driving: GearMember,
    /// The driven gear.
    pub driven: GearMember,
}

impl GearMesh {
    /// Gives the gear-mesh frequency GMF = teeth · f of the driving gear's shaft speed.
    #[must_use]
    pub fn mesh_frequency(&self, driving_shaft_speed: Hz) -> Hz {
        Hz(f64::from(self.driving.teeth) * driving_shaft_speed.0)
    }
}
