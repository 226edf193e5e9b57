//! `[[gear]]` with `[[gear.fault]]`.

use super::lengths::{Span, angle, has_length, length, length_keys, number_or};
use super::limits;
use super::parts::{self, MAX_M, POISSON, YOUNG_GPA};
use super::shafts::Shafts;
use super::{MateSeat, SceneGear, SceneMate};
use crate::machine::file::general::ID;
use crate::machine::file::range::NumberRange;
use crate::machine::file::reader::{Ids, Need, Section};
use crate::simulator::mesh::{
    Crack, Fault, GearShape, Member, Mesh, MeshDesign, Root, Steel, ToothFault, ToothModel,
    design_error,
};
use crate::simulator::rotor::Disc;
use std::f64::consts::{PI, TAU};

/// Pressure angles, degrees.
const PRESSURE_DEG: NumberRange = NumberRange::closed(10.0, 35.0);
const PRESSURE_DEFAULT_DEG: f64 = 20.0;

/// Direction of the force of the drive flanks unless another is given, degrees.
const LINE_DEFAULT_DEG: f64 = 20.0;

/// Steel, unless another is given.
const YOUNG_DEFAULT_GPA: f64 = 206.8;
const POISSON_DEFAULT: f64 = 0.3;
const DENSITY_DEFAULT: f64 = 7833.4;
const DENSITY: NumberRange = NumberRange::positive_up_to(30_000.0);

/// Backlash along the line of action unless given, modules.
const BACKLASH_DEFAULT: f64 = 0.05;

/// Damping of the mesh unless given, of critical damping of the gear's own inertia on it: measured
/// values lie from 0.03 to 0.17.
const DAMPING_RATIO_DEFAULT: f64 = 0.1;
const DAMPING_RATIO: NumberRange = NumberRange::closed(0.0, 2.0);
const DAMPING: NumberRange = NumberRange::closed(0.0, 1e9);

/// Torques, N·m.
const TORQUE: NumberRange = NumberRange::closed(-1e7, 1e7);

/// Identifiers of all gears.
pub(super) fn ids<'s>(sections: &mut [Section<'s>]) -> Ids<'s> {
    Ids::read("gear", "id", sections, &ID)
}

/// Stiffness of the coupling of a second shaft unless given, of the shaft's own: as good as clamped.
const COUPLING_DEFAULT: f64 = 1000.0;
const COUPLING: NumberRange = NumberRange::positive_up_to(1e12);

#[derive(Clone, Copy, PartialEq)]
enum Drive {
    Prescribed,
    Shaft,
}

/// Reads a gear on the first shaft.
pub(super) fn read(
    mut section: Section<'_>,
    id: Option<&str>,
    shafts: &Shafts,
) -> Option<SceneGear> {
    let s = &mut section;
    let first = shafts.carrier(0);
    let (length_m, shaft_m) = (first.length_m, first.diameter_m);
    let at_m = parts::at(s, Need::Required, length_m);
    let torque_n_m = s.number("torque_nm", Need::Required, TORQUE);
    let torque_at =
        length(s, length_keys!("torque_at"), Need::Optional, Span::FromZero(length_m.min(MAX_M)));
    let drives = [("prescribed", Drive::Prescribed), ("shaft", Drive::Shaft)];
    let drive = s.choice("drive", Need::Optional, &drives);
    let drive = if s.has("drive") { drive } else { Some(Drive::Prescribed) };
    let line_rad =
        number_or(s, "line_of_action_deg", NumberRange::closed(-360.0, 360.0), LINE_DEFAULT_DEG);
    let torsions = [("rod", false), ("rigid", true)];
    let rigid = s.choice("torsion", Need::Optional, &torsions);
    let rigid = if s.has("torsion") { rigid } else { Some(false) };
    let shapes = shapes(s, shaft_m);
    let disc = body(s, at_m, shapes.map(|(gear, _)| gear));
    let mate = mate(s, drive, shapes.map(|(_, mate)| mate), shafts);
    let model = model(s);
    let ratio = s.number("contact_ratio", Need::Optional, NumberRange::closed(1.0, 3.0));
    let backlash = length(s, length_keys!("backlash"), Need::Optional, Span::FromZero(0.1));
    let first_tooth = angle(s, "tooth_1_at_deg");
    let ratio_of_damping = s.number("damping_ratio", Need::Optional, DAMPING_RATIO);
    let damping = s.number("damping_n_s_per_m", Need::Optional, DAMPING);
    if s.has("damping_ratio") && s.has("damping_n_s_per_m") {
        s.refuse("damping_ratio", "either damping_ratio or damping_n_s_per_m");
    }
    let sections = s.tables("fault", Need::Optional);
    let faults: Vec<_> = sections.into_iter().map(read_fault).collect();
    section.finish();
    let ((gear, mate_gear), disc, torque_n_m) = (shapes?, disc?, torque_n_m?);
    let path = path(&section, gear, mate_gear, ratio)?;
    let mut design = MeshDesign {
        gear,
        mate: mate_gear,
        model: model?,
        path,
        backlash_m: backlash.unwrap_or(BACKLASH_DEFAULT * gear.module_m),
        damping_n_s_per_m: damping.unwrap_or(0.0),
        first_tooth_rad: first_tooth?,
    };
    let faults = faults.into_iter().collect::<Option<Vec<_>>>()?;
    if let Some(error) = design_error(&design, &faults) {
        section.log().report(
            section.start(),
            section.path().to_owned(),
            error,
            "gears that can mesh",
        );
        return None;
    }
    let mean = Mesh::new(design.clone(), &[]).mean_stiffness_n_per_m();
    if damping.is_none() {
        let mass_kg = disc.polar_kg_m2 / (gear.base_radius_m() * gear.base_radius_m());
        let part = ratio_of_damping.unwrap_or(DAMPING_RATIO_DEFAULT);
        design.damping_n_s_per_m = 2.0 * part * (mean * mass_kg).sqrt();
    }
    Some(SceneGear {
        id: id?.to_owned(),
        at_m: at_m?,
        disc,
        design,
        mean_stiffness_n_per_m: mean,
        line_of_action_rad: line_rad?.to_radians(),
        torque_n_m,
        torque_at_m: torque_at.unwrap_or(if at_m? < 0.5 * length_m { length_m } else { 0.0 }),
        is_rigid: rigid?,
        mate: mate?,
        faults,
    })
}

/// What the mate does, and its keys.
fn mate(
    s: &mut Section<'_>,
    drive: Option<Drive>,
    gear: Option<GearShape>,
    shafts: &Shafts,
) -> Option<SceneMate> {
    if drive? == Drive::Prescribed {
        return Some(SceneMate::Prescribed);
    }
    if !shafts.are_two() {
        s.refuse("drive", "\"prescribed\": a mate on a shaft needs two tables [[shaft]]");
        return None;
    }
    let length_m = shafts.carrier(1).length_m;
    let along = Span::FromZero(length_m.min(MAX_M));
    let at = length(s, length_keys!("mate_at"), Need::Required, along);
    let driven_at = length(s, length_keys!("mate_driven_at"), Need::Optional, along);
    let density = number_or(s, "density_kg_per_m3", DENSITY, DENSITY_DEFAULT);
    let coupling = s.number("coupling_nm_per_rad", Need::Optional, COUPLING);
    let (at_m, gear, second) = (at?, gear?, shafts.second()?);
    let beam = second.section;
    let shear_pa = 0.5 * beam.young_pa / (1.0 + beam.poisson);
    let own_n_m = shear_pa * PI / 32.0 * beam.diameter_m.powi(4) / second.length_m;
    let far_end_m = if at_m < 0.5 * second.length_m { second.length_m } else { 0.0 };
    let pitch_m = 2.0 * gear.pitch_radius_m();
    Some(SceneMate::Shaft(MateSeat {
        disc: Disc::solid(at_m, pitch_m, gear.bore_m.min(pitch_m), gear.face_m, density?),
        driven_at_m: driven_at.unwrap_or(far_end_m),
        coupling_n_m_per_rad: coupling.unwrap_or(COUPLING_DEFAULT * own_n_m),
    }))
}

/// The two gears.
fn shapes(s: &mut Section<'_>, shaft_m: Option<f64>) -> Option<(GearShape, GearShape)> {
    let teeth = s.whole("teeth", Need::Required, 8..=1000);
    let mate_teeth = s.whole("mate_teeth", Need::Optional, 8..=1000);
    let module_mm = s.number("module_mm", Need::Optional, NumberRange::positive_up_to(100.0));
    let per_inch =
        s.number("diametral_pitch_per_in", Need::Optional, NumberRange::positive_up_to(1000.0));
    if s.has("module_mm") == s.has("diametral_pitch_per_in") {
        s.missing("module_mm", "either module_mm or diametral_pitch_per_in");
    }
    let module_m = module_mm.map(|mm| 1e-3 * mm).or(per_inch.map(|p| 0.025_4 / p));
    let face = length(s, length_keys!("face_width"), Need::Required, Span::Positive(10.0));
    let pressure = number_or(s, "pressure_angle_deg", PRESSURE_DEG, PRESSURE_DEFAULT_DEG);
    let bore = length(s, length_keys!("bore"), Need::Optional, Span::Positive(MAX_M)).or(shaft_m);
    let mate_bore =
        length(s, length_keys!("mate_bore"), Need::Optional, Span::Positive(MAX_M)).or(bore);
    let mate_teeth = if s.has("mate_teeth") { mate_teeth } else { teeth };
    let shape = |teeth: u32, bore_m: f64| {
        Some(GearShape::standard(teeth, module_m?, pressure?.to_radians(), face?, bore_m))
    };
    Some((shape(teeth?, bore?)?, shape(mate_teeth?, mate_bore?)?))
}

/// The gear as a disc: by its inertia, or solid of its pitch diameter.
fn body(s: &mut Section<'_>, at_m: Option<f64>, gear: Option<GearShape>) -> Option<Disc> {
    let density = number_or(s, "density_kg_per_m3", DENSITY, DENSITY_DEFAULT);
    if s.has("mass_kg") || s.has("polar_kg_m2") || s.has("diametral_kg_m2") {
        return parts::by_inertia(s, at_m);
    }
    let _known = s.number("mass_kg", Need::Optional, NumberRange::positive_up_to(1e6));
    let (at_m, gear) = (at_m?, gear?);
    let pitch_m = 2.0 * gear.pitch_radius_m();
    Some(Disc::solid(at_m, pitch_m, gear.bore_m.min(pitch_m), gear.face_m, density?))
}

fn model(s: &mut Section<'_>) -> Option<ToothModel> {
    let young = number_or(s, "young_gpa", YOUNG_GPA, YOUNG_DEFAULT_GPA);
    let poisson = number_or(s, "poisson", POISSON, POISSON_DEFAULT);
    let roots = [("root_circle", Root::RootCircle), ("base_circle", Root::BaseCircle)];
    let root = s.choice("root", Need::Optional, &roots);
    let root = if s.has("root") { root } else { Some(Root::RootCircle) };
    let foundation = s.flag("foundation").unwrap_or(true);
    let steel = Steel { young_pa: young? * 1e9, poisson: poisson? };
    Some(ToothModel { steel, root: root?, foundation })
}

/// The path of contact, shortened to a contact ratio that is given.
fn path(
    s: &Section<'_>,
    gear: GearShape,
    mate: GearShape,
    ratio: Option<f64>,
) -> Option<crate::simulator::mesh::Path> {
    let whole = gear.path(&mate);
    let most = whole.contact_ratio();
    match ratio {
        // Figures in print are rounded.
        Some(ratio) if ratio > most * 1.001 => {
            s.refuse("contact_ratio", format!("at most {most:.4}, that of these gears' geometry"));
            None
        }
        Some(ratio) => Some(whole.with_contact_ratio(ratio.min(most))),
        None => Some(whole),
    }
}

fn read_fault(mut section: Section<'_>) -> Option<ToothFault> {
    #[derive(Clone, Copy, PartialEq)]
    enum Kind {
        Worn,
        Cracked,
        Missing,
        Profile,
        Pitch,
    }
    let s = &mut section;
    let kinds = [
        ("worn", Kind::Worn),
        ("cracked", Kind::Cracked),
        ("missing", Kind::Missing),
        ("profile_error", Kind::Profile),
        ("pitch_error", Kind::Pitch),
    ];
    let kind = s.choice("kind", Need::Required, &kinds)?;
    let tooth = s.whole("tooth", Need::Required, 1..=1000);
    let members = [("gear", Member::Gear), ("mate", Member::Mate)];
    let member = s.choice("member", Need::Optional, &members);
    let member = if s.has("member") { member? } else { Member::Gear };
    let small = Span::Signed(limits::TOOTH_M);
    let fault = match kind {
        Kind::Worn => {
            let depth =
                length(s, length_keys!("depth"), Need::Optional, Span::FromZero(limits::TOOTH_M));
            let (low, high) = limits::STIFFNESS_FACTOR;
            let factor = number_or(s, "stiffness_factor", NumberRange::closed(low, high), 1.0);
            if !has_length(s, length_keys!("depth")) && !s.has("stiffness_factor") {
                s.missing(
                    "depth_um",
                    "a depth (depth_mm, depth_um, …), a stiffness_factor, or both",
                );
                return None;
            }
            factor.map(|stiffness_factor| Fault::Worn {
                depth_m: depth.unwrap_or(0.0),
                stiffness_factor,
            })
        }
        Kind::Cracked => {
            let depth =
                length(s, length_keys!("depth"), Need::Required, Span::Positive(limits::CRACK_M));
            let (low, high) = limits::CRACK_DEG;
            let range = NumberRange::closed(low, high);
            let angle = number_or(s, "crack_angle_deg", range, limits::CRACK_DEFAULT_DEG);
            let crack = depth
                .zip(angle)
                .map(|(depth_m, angle)| Crack { depth_m, angle_rad: angle.to_radians() });
            crack.map(Fault::Cracked)
        }
        Kind::Missing => Some(Fault::Missing),
        Kind::Profile => {
            let slope = length(s, length_keys!("slope"), Need::Optional, small);
            let form = length(s, length_keys!("form"), Need::Optional, small);
            if slope.is_none() && form.is_none() {
                s.missing("slope_um", "a slope (slope_um, …), a form (form_um, …), or both");
                return None;
            }
            Some(Fault::Profile { slope_m: slope.unwrap_or(0.0), form_m: form.unwrap_or(0.0) })
        }
        Kind::Pitch => {
            let offset = length(s, length_keys!("offset"), Need::Required, small);
            offset.map(|offset_m| Fault::Pitch { offset_m })
        }
    };
    section.finish();
    Some(ToothFault { member, tooth: tooth? - 1, fault: fault? })
}

impl SceneGear {
    /// Angle of the shaft at which a tooth is at the pitch point, degrees from 0 to 360; `None` for a
    /// tooth of a mate that meets another tooth of the gear each turn.
    #[must_use]
    pub fn tooth_angle_deg(&self, fault: &ToothFault) -> Option<f64> {
        let teeth = self.design.gear.teeth;
        let is_fixed = fault.member == Member::Gear || self.design.mate.teeth == teeth;
        let turned = self.design.first_tooth_rad / TAU + f64::from(fault.tooth) / f64::from(teeth);
        is_fixed.then(|| 360.0 * turned.rem_euclid(1.0))
    }
}
