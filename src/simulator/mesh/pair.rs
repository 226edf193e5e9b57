//! Two teeth in contact, and the faults of teeth: stiffness and gap as functions of the place on the
//! path of contact (R20, R24).

use super::curve::Curve;
use super::gear::{GearShape, Path};
use super::tooth::{self, Crack, Tooth, ToothModel, ToothState};
use std::f64::consts::PI;

/// The two gears, how their compliance is counted, and their fit.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshDesign {
    /// The gear whose motion is followed; its tip meets first when it turns forward.
    pub gear: GearShape,
    /// Its mate: same module and pressure angle.
    pub mate: GearShape,
    /// What is counted of the teeth.
    pub model: ToothModel,
    /// Path of contact.
    pub path: Path,
    /// Backlash along the line of action, m; infinite: no back flanks.
    pub backlash_m: f64,
    /// Damping of a flank in contact, N·s/m.
    pub damping_n_s_per_m: f64,
    /// Angle of the gear at which its first tooth is at the pitch point, rad.
    pub first_tooth_rad: f64,
}

/// One of the two gears.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Member {
    /// The gear that is followed.
    Gear,
    /// Its mate.
    Mate,
}

/// Which flanks touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Flank {
    /// The one that drives the gear forward.
    Drive,
    /// The other.
    Back,
}

/// What is wrong with a tooth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fault {
    /// A layer gone from its drive flank, and a factor on the stiffness of its pair.
    Worn {
        /// Layer, m.
        depth_m: f64,
        /// Factor; 1: the layer's own effect only.
        stiffness_factor: f64,
    },
    /// A crack from the root, open under load on the drive flank.
    Cracked(Crack),
    /// Gone: its pair carries nothing.
    Missing,
    /// A drive flank that lacks material: at the tip (linear to the root), and in the middle of the
    /// path (half a cosine wave).
    Profile {
        /// At the tip, m; below 0: too much.
        slope_m: f64,
        /// In the middle, m; below 0: too much.
        form_m: f64,
    },
    /// The tooth stands off its place, away from the mate's drive flank.
    Pitch {
        /// By this much, m.
        offset_m: f64,
    },
}

/// A fault of one tooth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ToothFault {
    /// Whose tooth.
    pub member: Member,
    /// Its number from 0, in the order in which teeth pass the pitch point.
    pub tooth: u32,
    /// What is wrong.
    pub fault: Fault,
}

/// A tooth with all its faults.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Condition {
    state: ToothState,
    factor: f64,
    is_missing: bool,
    slope_m: f64,
    form_m: f64,
    offset_m: f64,
}

impl Default for Condition {
    fn default() -> Self {
        Self {
            state: ToothState::default(),
            factor: 1.0,
            is_missing: false,
            slope_m: 0.0,
            form_m: 0.0,
            offset_m: 0.0,
        }
    }
}

impl Condition {
    /// The condition of a tooth under these faults.
    pub(super) fn of(faults: impl Iterator<Item = Fault>) -> Self {
        let mut condition = Self::default();
        for fault in faults {
            match fault {
                Fault::Worn { depth_m, stiffness_factor } => {
                    condition.state.worn_m += depth_m;
                    condition.factor *= stiffness_factor;
                }
                Fault::Cracked(crack) => condition.state.crack = Some(crack),
                Fault::Missing => condition.is_missing = true,
                Fault::Profile { slope_m, form_m } => {
                    condition.slope_m += slope_m;
                    condition.form_m += form_m;
                }
                Fault::Pitch { offset_m } => condition.offset_m += offset_m,
            }
        }
        condition
    }
}

/// Material missing from a pair of flanks along the path: the approach must first close it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Gap {
    offset_m: f64,
    gear_slope_m: f64,
    mate_slope_m: f64,
    form_m: f64,
}

impl Gap {
    /// Gap, m, at a place ξ on the path, −1 where a pair meets and 1 where it parts (R24).
    pub(super) fn at(&self, xi: f64) -> f64 {
        let mut gap = self.offset_m;
        if self.gear_slope_m.abs() + self.mate_slope_m.abs() + self.form_m.abs() > 0.0 {
            gap += 0.5 * (self.gear_slope_m * (1.0 - xi) + self.mate_slope_m * (1.0 + xi));
            gap += 0.5 * self.form_m * (1.0 + (PI * xi).cos());
        }
        gap
    }
}

/// A pair of teeth of given conditions.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Pair {
    /// Whether both teeth are there.
    pub(super) carries: bool,
    /// Stiffness, N/m, on the drive flank by the place s on the path, m; of the back flank by −s.
    pub(super) stiffness: [Curve; 2],
    /// Gap on the drive and on the back flank.
    pub(super) gap: [Gap; 2],
}

/// Prepares pairs of a design.
#[derive(Debug)]
pub(super) struct Pairs<'a> {
    design: &'a MeshDesign,
    gear: Tooth,
    mate: Tooth,
}

impl<'a> Pairs<'a> {
    pub(super) fn new(design: &'a MeshDesign) -> Self {
        let tooth = |gear| Tooth::new(gear, design.model);
        Self { design, gear: tooth(design.gear), mate: tooth(design.mate) }
    }

    /// Roll angles of both teeth at a place on the path (R19).
    fn rolls(&self, at_m: f64) -> (f64, f64) {
        let tan = self.design.gear.pressure_rad.tan();
        let (gear, mate) = (self.design.gear.base_radius_m(), self.design.mate.base_radius_m());
        (tan - at_m / gear, tan + at_m / mate)
    }

    /// Stiffness of a pair by integration, N/m.
    pub(super) fn stiffness(&self, gear: ToothState, mate: ToothState, at_m: f64) -> f64 {
        let (gear_roll, mate_roll) = self.rolls(at_m);
        let face_m = self.design.gear.face_m.min(self.design.mate.face_m);
        let sum = self.gear.compliance(gear, gear_roll).sum()
            + self.mate.compliance(mate, mate_roll).sum()
            + tooth::hertz(self.design.model.steel, face_m);
        1.0 / sum
    }

    /// Ends of the path and what bends the stiffness in between.
    fn marks(&self, gear: ToothState, mate: ToothState) -> Vec<f64> {
        let Path { begin_m, end_m, .. } = self.design.path;
        let tan = self.design.gear.pressure_rad.tan();
        let of_gear = gear.crack.and_then(|crack| self.gear.crack_ends(crack));
        let of_mate = mate.crack.and_then(|crack| self.mate.crack_ends(crack));
        let bends = [
            of_gear.map(|roll| (tan - roll) * self.design.gear.base_radius_m()),
            of_mate.map(|roll| (roll - tan) * self.design.mate.base_radius_m()),
        ];
        let apart = 1e-6 * (end_m - begin_m);
        let inside = |s: &f64| *s > begin_m + apart && *s < end_m - apart;
        let mut marks = vec![begin_m, end_m];
        marks.extend(bends.into_iter().flatten().filter(inside));
        marks.sort_by(f64::total_cmp);
        marks.dedup_by(|b, a| *b - *a < apart);
        marks
    }

    /// A pair of teeth.
    pub(super) fn pair(&self, gear: &Condition, mate: &Condition) -> Pair {
        let carries = !gear.is_missing && !mate.is_missing;
        let fit = |gear: ToothState, mate: ToothState| {
            Curve::fit(&self.marks(gear, mate), |s| self.stiffness(gear, mate, s))
        };
        let factor = gear.factor * mate.factor;
        // Under load on the back flank a crack of the drive flank's root is closed.
        let closed = |condition: &Condition| ToothState { crack: None, ..condition.state };
        let drive = fit(gear.state, mate.state).times(factor);
        let back = fit(closed(gear), closed(mate)).times(factor);
        let offset_m = gear.offset_m + mate.offset_m;
        let drive_gap = Gap {
            offset_m: offset_m + gear.state.worn_m + mate.state.worn_m,
            gear_slope_m: gear.slope_m,
            mate_slope_m: mate.slope_m,
            form_m: gear.form_m + mate.form_m,
        };
        let back_gap = Gap { offset_m: -offset_m, ..Gap::default() };
        Pair { carries, stiffness: [drive, back], gap: [drive_gap, back_gap] }
    }
}

/// Smallest part of its healthy thickness a tooth may have left.
const LEAST_LEFT: f64 = 0.1;

/// Why a mesh with these faults cannot be; `None`: it can.
#[must_use]
pub fn design_error(design: &MeshDesign, faults: &[ToothFault]) -> Option<String> {
    for gear in [&design.gear, &design.mate] {
        let h = 2.0 * gear.root_radius_m() / gear.bore_m;
        let half_rad = gear.half_root_rad();
        let (ratios, angles) = tooth::FOUNDATION_VALID;
        let inside =
            (ratios[0]..=ratios[1]).contains(&h) && (angles[0]..=angles[1]).contains(&half_rad);
        if h <= 1.0 {
            return Some(format!(
                "a bore of {:.4} m in a root circle of {:.4} m",
                gear.bore_m,
                2.0 * gear.root_radius_m()
            ));
        }
        if design.model.foundation && !inside {
            return Some(format!(
                "a gear with root radius ÷ bore radius {h:.2} and {half_rad:.4} rad of half a tooth at its root, where \
                 the polynomials of the foundation hold from 1.4 to 7 and from 0.01 to 0.12; foundation = false \
                 leaves them out"
            ));
        }
    }
    let ratio = design.path.contact_ratio();
    if !(1.0..3.0).contains(&ratio) {
        return Some(format!("a contact ratio of {ratio:.3}, not from 1 to below 3"));
    }
    faults.iter().find_map(|fault| fault_error(design, faults, fault))
}

fn fault_error(design: &MeshDesign, all: &[ToothFault], fault: &ToothFault) -> Option<String> {
    let gear = match fault.member {
        Member::Gear => design.gear,
        Member::Mate => design.mate,
    };
    let number = fault.tooth + 1;
    if fault.tooth >= gear.teeth {
        return Some(format!("tooth {number} of a gear with {} teeth", gear.teeth));
    }
    let of_tooth = all.iter().filter(|f| f.member == fault.member && f.tooth == fault.tooth);
    let condition = Condition::of(of_tooth.map(|f| f.fault));
    let tooth = Tooth::new(gear, design.model);
    let whole = tooth.least_thickness_m(ToothState::default());
    let left = tooth.least_thickness_m(condition.state);
    (left < LEAST_LEFT * whole).then(|| {
        format!(
            "tooth {number} worn and cracked down to {:.0} % of its least thickness, {whole:.5} m",
            100.0 * left / whole
        )
    })
}
