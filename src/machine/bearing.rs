//! Rolling bearings and their fault rates.

use super::ShaftIndex;

/// Which ring turns with the shaft.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RotatingRing {
    /// Inner ring turns, outer ring stands.
    Inner,
    /// Outer ring turns, inner ring stands.
    Outer,
}

/// Internal geometry of a rolling bearing; constructed only through validation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BearingGeometry {
    /// Number of rolling elements n, ≥ 3.
    pub elements: u32,
    /// Rolling-element diameter d, m.
    pub element_diameter_m: f64,
    /// Pitch diameter D, m, > d/cos φ… so that d/D·cos φ < 1.
    pub pitch_diameter_m: f64,
    /// Contact angle φ, rad, 0 ≤ φ < π/2.
    pub contact_angle_rad: f64,
}

/// Fault orders of a bearing: rates divided by the relative ring speed |f_i − f_o|.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FaultOrders {
    /// Cage: FTF.
    pub ftf: f64,
    /// Outer race: BPFO.
    pub bpfo: f64,
    /// Inner race: BPFI.
    pub bpfi: f64,
    /// Ball spin: BSF. The defect line of a rolling element is 2·BSF.
    pub bsf: f64,
}

/// One bearing of the machine.
#[derive(Debug, Clone, PartialEq)]
pub struct Bearing {
    /// Identifier.
    pub id: String,
    /// Shaft it carries.
    pub shaft: ShaftIndex,
    /// Maker's designation as written; resolving it needs the catalogue.
    pub catalogue: Option<String>,
    /// Geometry; `None` when only a designation is given.
    pub geometry: Option<BearingGeometry>,
    /// Which ring turns.
    pub rotating_ring: RotatingRing,
}
