//! Gear meshes.
//!
//! Equations K8–K11 of `docs/theory.md`.

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
    /// Gives the gear-mesh frequency GMF = teeth · f of the driving gear's shaft speed (K9).
    #[must_use]
    pub fn mesh_frequency(&self, driving_shaft_speed: Hz) -> Hz {
        Hz(f64::from(self.driving.teeth) * driving_shaft_speed.0)
    }

    /// Speed of the driven gear's shaft divided by that of the driving one: N₁/N₂ (K8).
    #[must_use]
    pub fn speed_ratio(&self) -> f64 {
        f64::from(self.driving.teeth) / f64::from(self.driven.teeth)
    }

    /// Hunting-tooth frequency GMF·gcd(N₁, N₂)/(N₁·N₂): how often the same two teeth meet (K11).
    #[must_use]
    pub fn hunting_tooth_frequency(&self, driving_shaft_speed: Hz) -> Hz {
        // GMF/N₁ is the driving speed itself.
        let common = gcd(self.driving.teeth, self.driven.teeth);
        Hz(driving_shaft_speed.0 * f64::from(common) / f64::from(self.driven.teeth))
    }
}

/// Greatest common divisor, by Euclid; gcd(a, 0) = a.
fn gcd(mut a: u32, mut b: u32) -> u32 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mesh(driving: u32, driven: u32) -> GearMesh {
        let member =
            |shaft, teeth| GearMember { shaft: ShaftIndex(shaft), teeth, tooth_1_at_deg: None };
        GearMesh { id: "mesh".into(), driving: member(0, driving), driven: member(1, driven) }
    }

    #[test]
    fn rig_mesh_runs_at_280_hz() {
        // 28 teeth at 10 Hz; equal teeth meet again every turn.
        assert_eq!(mesh(28, 28).mesh_frequency(Hz(10.0)), Hz(280.0));
        assert_eq!(mesh(28, 28).hunting_tooth_frequency(Hz(10.0)), Hz(10.0));
    }

    #[test]
    fn the_same_two_teeth_meet_after_the_least_common_multiple() {
        for (driving, driven) in [(32, 80), (48, 64), (17, 41), (1, 30), (7, 7)] {
            let gears = mesh(driving, driven);
            // Slow reference: count teeth until both wheels are back where they began.
            let period = (1..=driving * driven)
                .find(|teeth| teeth % driving == 0 && teeth % driven == 0)
                .unwrap();
            let expected = gears.mesh_frequency(Hz(30.0)).0 / f64::from(period);
            let found = gears.hunting_tooth_frequency(Hz(30.0)).0;
            // Two divisions in another order: a few roundings.
            assert!((found - expected).abs() <= 1e-14 * expected.abs(), "{driving}:{driven}");
        }
    }
}
