//! From a scene to a model: what is chosen automatically, and what is refused.

mod gears;
mod shafts;

use super::contact::{Contacts, Defect, Profile};
use super::linear::LinearSystem;
use super::model::{LinearSeat, Model, Seat, Turned, TurningLoads};
use super::modes::{Basis, BasisError};
use super::reduction::expected_error;
use super::rotor::{Place, Plane};
use super::scene::{BearingKind, Faults, ProfileKind, Scene, SceneBall};
use super::scene::{SceneBearing, SceneDefect, SceneErrors, SensorKind};
use super::speed::SpeedProfile;
use shafts::{beside, bow_shape, flanks_at, rotors};
use std::f64::consts::TAU;

/// Errors of the integrator, measured on the rig with a step defect (set A, bearing 3): at steps of
/// 10 µs; it falls with the fourth power.
const ERROR_AT_10_US: f64 = 2e-5;

/// The same with gears: the largest of the eight combinations of faults, from rest.
const ERROR_AT_10_US_GEARS: f64 = 2e-4;

/// Longest and shortest step, s.
const STEPS_S: (f64, f64) = (20e-6, 0.5e-6);

/// Steps a sample of the fastest channel, at least: what the anti-alias filter needs.
const LEAST_STEPS: f64 = 4.0;

/// Modes up to this multiple of the sensors' band are kept at an accuracy of 1e-4 and looser, and up to this one at a
/// tighter one; below 1e-6 it rises with a power of 1/accuracy. Measured (`bench simulator`, table `shapes`): 14 + 2 shapes (2.4
/// times) err 5e-5, 20 + 2 (5.4 times) 9e-7, those between no less than 14 + 2.
const BAND_MARGINS: (f64, f64) = (2.4, 5.4);

/// That power: 28 + 2 shapes (15 times) are followed to 1e-7 and better.
const BAND_POWER: f64 = 0.25;

/// Modes closer than this factor are kept or left out together: a shaft that is alike on both sides has
/// pairs, and half a pair (19 + 2 shapes) errs a hundred times more than the whole (20 + 2).
const PAIR: f64 = 1.05;

/// Fewest and most modes a shaft that are chosen automatically.
const MODES: (usize, usize) = (4, 40);

/// Elements of a whole shaft, at least, if chosen automatically.
const ELEMENTS: usize = 24;

/// Degrees of freedom for each mode, at least.
const DOF_PER_MODE: usize = 4;

/// The gyroscopic coupling is left out below this part of the accuracy.
const GYROSCOPIC_PART: f64 = 0.1;

/// Standard gravity, m/s².
const GRAVITY_M_PER_S2: f64 = 9.806_65;

/// What was chosen for a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Samples a second of the fastest channel.
    pub rate_hz: f64,
    /// Steps a sample of it; 1 in a linear scene.
    pub steps_per_sample: u32,
    /// Whether motion is computed exactly: no contacts, constant speed.
    pub is_linear: bool,
    /// Whether anti-alias filters are part of what is computed, or not needed; else they take points
    /// of every step.
    pub is_filtered: bool,
    /// Expected relative error of the motion.
    pub expected_error: f64,
    /// Whether that was measured on the scene's first moments, and not taken from set A.
    pub is_error_measured: bool,
    /// Whether steps are cut where balls touch or leave.
    pub cuts_at_contact: bool,
    /// Modes of each plane.
    pub n_modes: usize,
    /// Attachment shapes of each plane.
    pub n_attachments: usize,
    /// Natural frequency of the highest mode kept, Hz.
    pub highest_hz: f64,
    /// Lowest natural frequencies, Hz, up to four.
    pub lowest_hz: Vec<f64>,
    /// Degrees of freedom of each plane before the reduction.
    pub n_dof: usize,
    /// Largest relative shift of a frequency by the gyroscopic coupling, estimated.
    pub gyroscopic_effect: f64,
    /// Whether it is modelled.
    pub has_gyroscopic: bool,
    /// Shapes of the torsion; 0: left out.
    pub n_torsion: usize,
    /// Lowest frequency of the torsion on the mesh, Hz.
    pub torsion_hz: f64,
}

impl Plan {
    /// Length of a step, s.
    #[must_use]
    pub fn step_s(&self) -> f64 {
        1.0 / (self.rate_hz * f64::from(self.steps_per_sample))
    }
}

/// A model with the plane it was reduced from.
#[derive(Debug, Clone)]
pub(in crate::simulator) struct Built {
    pub(super) plane: Plane,
    pub(super) model: Model,
    pub(super) plan: Plan,
}

/// Builds a scene.
pub(in crate::simulator) fn build(scene: &Scene) -> Result<Built, SceneErrors> {
    let coarse = rotors(scene, 1);
    let n_spans = coarse.iter().map(|rotor| rotor.assemble().nodes_m.len() - 1).min();
    let chosen = u32::try_from(ELEMENTS.div_ceil(n_spans.unwrap_or(1))).unwrap_or(1);
    let mut elements = scene.modes.elements_per_span.unwrap_or(chosen);
    let mut rotors_of_it = rotors(scene, elements);
    let mut plane = beside(scene, &rotors_of_it);
    let n_modes = choose_modes(scene, &plane)?;
    while scene.modes.elements_per_span.is_none() && plane.n_dof() < DOF_PER_MODE * n_modes {
        elements *= 2;
        rotors_of_it = rotors(scene, elements);
        plane = beside(scene, &rotors_of_it);
    }
    let stations: Vec<usize> = if scene.modes.attachment {
        let bearings = scene.bearings.iter().map(|bearing| bearing.place);
        let places = bearings.chain(scene.gears.iter().flat_map(flanks_at));
        places.map(|place| plane.displacement_at(place)).collect()
    } else {
        Vec::new()
    };
    let modes = basis(scene, &plane, n_modes, &[])?;
    let basis = basis(scene, &plane, n_modes, &stations)?;
    let mut plan = plan(scene, &plane, &modes, &basis);
    check_band(scene, &plan)?;
    let mut model = Model::new(basis, scene.modes.damping, scene.speed.clone());
    let further = (1..scene.shafts.len()).map(|shaft| scene.turns(shaft));
    let n = model.basis.len();
    model.shafts.extend(further.map(|turns| TurningLoads::none(n, turns)));
    plan.gyroscopic_effect = gyroscopic_effect(&model, scene.speed.fastest_rad_per_s());
    plan.has_gyroscopic = plan.gyroscopic_effect >= GYROSCOPIC_PART * scene.accuracy;
    if !plan.has_gyroscopic {
        model.without_gyroscopic();
    }
    load(scene, &plane, &mut model);
    seat(scene, &plane, &mut model);
    gears::seat(scene, &rotors_of_it, &plane, &mut model)?;
    if let Some(torsion) = &model.torsion {
        plan.n_torsion = torsion.len();
        plan.torsion_hz = torsion.basis.omega_rad_per_s[0] / TAU;
    }
    let mut built = Built { plane, model, plan };
    set_faults(scene, &built.plane, &mut built.model, &scene.faults())?;
    check_stability(scene, &built.model)?;
    Ok(built)
}

fn basis(
    scene: &Scene,
    plane: &Plane,
    n_modes: usize,
    stations: &[usize],
) -> Result<Basis, SceneErrors> {
    Basis::new(plane, n_modes, stations).map_err(|error| match error {
        BasisError::Free => {
            scene.mistake("bearing[0]", "bearings that leave the shaft free", error.to_string())
        }
        BasisError::TooMany { available, .. } => scene.mistake(
            "modes",
            format!("{n_modes} modes of {available} degrees of freedom"),
            "fewer modes (count) or more elements_per_span",
        ),
    })
}

/// Highest frequency the sensors let through, Hz.
pub(super) fn band_hz(scene: &Scene) -> f64 {
    let watching = scene.sensors.iter().filter(|sensor| sensor.kind != SensorKind::Tacho);
    watching.map(|sensor| sensor.corner_hz).fold(0.0, f64::max)
}

/// Expected error of the accelerations that sensors see, from the shapes left out (R31); `None` if the
/// scene cannot be built.
pub(super) fn reduction_error(scene: &Scene) -> Option<f64> {
    let Built { plane, model, .. } = build(scene).ok()?;
    let whole = Basis::new(&plane, plane.n_dof(), &[]).ok()?;
    let pushed: Vec<usize> =
        scene.bearings.iter().map(|bearing| plane.displacement_at(bearing.place)).collect();
    let watching = scene.sensors.iter().filter(|sensor| sensor.kind != SensorKind::Tacho);
    let seen: Vec<usize> = watching.map(|sensor| plane.displacement_at(sensor.place)).collect();
    Some(expected_error(&whole, &model.basis, &pushed, &seen, band_hz(scene)))
}

fn choose_modes(scene: &Scene, plane: &Plane) -> Result<usize, SceneErrors> {
    if let Some(count) = scene.modes.count {
        return Ok(count);
    }
    let (fewest, most) = (MODES.0 * scene.shafts.len(), MODES.1 * scene.shafts.len());
    let all = basis(scene, plane, most.min(plane.n_dof()), &[])?;
    let margin = if scene.accuracy >= 1e-4 {
        BAND_MARGINS.0
    } else {
        BAND_MARGINS.1 * (1e-6 / scene.accuracy).powf(BAND_POWER).max(1.0)
    };
    let wanted = TAU * band_hz(scene) * margin;
    let below = all.omega_rad_per_s.iter().take_while(|omega| **omega < wanted).count();
    let mut count = (below + 1).clamp(fewest, most).min(all.len());
    let is_of_pair = |n: usize| all.omega_rad_per_s[n] < PAIR * all.omega_rad_per_s[n - 1];
    while count < all.len() && is_of_pair(count) {
        count += 1;
    }
    Ok(count)
}

fn plan(scene: &Scene, plane: &Plane, modes: &Basis, basis: &Basis) -> Plan {
    let rate_hz = scene.sensors.iter().map(|sensor| sensor.rate_hz).fold(0.0, f64::max);
    let is_constant = matches!(scene.speed, SpeedProfile::Constant(_));
    let is_linear = is_constant && !scene.has_contacts();
    let error = if scene.gears.is_empty() { ERROR_AT_10_US } else { ERROR_AT_10_US_GEARS };
    let wanted_s = 10e-6 * (scene.accuracy / error).powf(0.25);
    let steps = (1.0 / (rate_hz * wanted_s.clamp(STEPS_S.1, STEPS_S.0)) - 1e-9).ceil();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "4 to 200 000")]
    let steps_per_sample = if is_linear { 1 } else { steps.max(LEAST_STEPS) as u32 };
    let step_s = 1.0 / (rate_hz * f64::from(steps_per_sample));
    let hz = |omega: &f64| omega / TAU;
    Plan {
        rate_hz,
        steps_per_sample,
        is_linear,
        expected_error: if is_linear { 1e-12 } else { error * (step_s / 10e-6).powi(4) },
        is_filtered: is_linear,
        is_error_measured: false,
        cuts_at_contact: false,
        n_modes: modes.len(),
        n_attachments: basis.len() - modes.len(),
        highest_hz: modes.omega_rad_per_s.last().map_or(0.0, hz),
        lowest_hz: modes.omega_rad_per_s.iter().take(4).map(hz).collect(),
        n_dof: plane.n_dof(),
        gyroscopic_effect: 0.0,
        has_gyroscopic: true,
        n_torsion: 0,
        torsion_hz: 0.0,
    }
}

/// Largest relative shift of a natural frequency: Ω·|H_ij|/(ω_i + ω_j).
fn gyroscopic_effect(model: &Model, speed_rad_per_s: f64) -> f64 {
    let (basis, n) = (&model.basis, model.basis.len());
    let omega = &basis.omega_rad_per_s;
    let part = |i: usize, j: usize| basis.gyroscopic[(i, j)].abs() / (omega[i] + omega[j]);
    let all = (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
    speed_rad_per_s * all.map(|(i, j)| part(i, j)).fold(0.0, f64::max)
}

fn load(scene: &Scene, plane: &Plane, model: &mut Model) {
    for disc in &scene.discs {
        let kg_m = disc.disc.mass_kg * disc.eccentricity_m;
        let place = Place { shaft: disc.shaft, at_m: disc.disc.at_m };
        model.add_unbalance(plane, place, kg_m, disc.eccentricity_rad);
    }
    for unbalance in &scene.unbalances {
        model.add_unbalance(plane, unbalance.place, unbalance.kg_m, unbalance.angle_rad);
    }
    if let Some(direction) = scene.gravity_rad {
        let (sin, cos) = direction.sin_cos();
        model.add_acceleration(plane, [GRAVITY_M_PER_S2 * cos, GRAVITY_M_PER_S2 * sin]);
    }
}

fn seat(scene: &Scene, plane: &Plane, model: &mut Model) {
    for bearing in &scene.bearings {
        let row = model.basis.row(plane.displacement_at(bearing.place));
        let support = bearing.support_n_per_m;
        match &bearing.kind {
            BearingKind::Ball(ball) => {
                let contacts = Contacts::new(ball.bearing.clone());
                model.seats.push(Seat { row, support_n_per_m: support, contacts });
            }
            BearingKind::Linear { stiffness_n_per_m: k, damping_n_s_per_m } => {
                let beyond = [[k[0][0] - support, k[0][1]], [k[1][0], k[1][1] - support]];
                let is_in_basis = beyond.iter().flatten().all(|x| x.abs() <= 0.0)
                    && damping_n_s_per_m.iter().flatten().all(|x| x.abs() <= 0.0);
                if !is_in_basis {
                    model.linear_seats.push(LinearSeat {
                        row,
                        stiffness_n_per_m: beyond,
                        damping_n_s_per_m: *damping_n_s_per_m,
                    });
                }
            }
        }
    }
}

/// Puts faults into a model in place of those it has; the contacts keep their bearings.
pub(super) fn set_faults(
    scene: &Scene,
    plane: &Plane,
    model: &mut Model,
    faults: &Faults,
) -> Result<(), SceneErrors> {
    let balls: Vec<(&str, &SceneBall)> = scene.ball_bearings().collect();
    if let Some((id, _)) = faults.defects.iter().find(|(id, _)| balls.iter().all(|b| b.0 != id)) {
        let names: Vec<&str> = balls.iter().map(|(id, _)| *id).collect();
        let allowed = format!("the id of a ball bearing: {}", names.join(", "));
        return Err(scene.mistake("bearing", format!("a defect of \"{id}\""), allowed));
    }
    for (seat, (id, ball)) in model.seats.iter_mut().zip(&balls) {
        let of_this = faults.defects.iter().filter(|(of, _)| of == id);
        let defects: Vec<SceneDefect> = of_this.map(|(_, defect)| *defect).collect();
        seat.contacts = Contacts::new(ball.with_defects(&defects));
    }
    gears::set_faults(scene, model, faults)?;
    let n = model.basis.len();
    model.shafts.iter_mut().for_each(|shaft| shaft.bow = Turned::none(n));
    if let Some(bow) = &faults.bow {
        let shaft = scene.shaft_of(bow).ok_or_else(|| {
            let names: Vec<&str> = scene.shafts.iter().map(|shaft| shaft.id.as_str()).collect();
            let found = format!("a bow of {:?}", bow.shaft);
            scene.mistake("bow", found, format!("the id of a shaft: {}", names.join(", ")))
        })?;
        let shape = bow_shape(scene, plane, shaft, &bow.shape)
            .ok_or_else(|| scene.mistake("bow", "points", "a shape the free shaft can take"))?;
        model.add_bow(plane, shaft, &shape, bow.angle_rad);
    }
    Ok(())
}

impl SceneBall {
    /// A defect as the contacts need it.
    pub(super) fn defect(&self, defect: &SceneDefect) -> Defect {
        let radius_m = self.radius_m(defect);
        let race_m = 0.5 * (self.pitch_diameter_m - self.ball_diameter_m);
        let outer_m = 0.5 * (self.pitch_diameter_m + self.ball_diameter_m);
        let ball_per_m = 2.0 / self.ball_diameter_m;
        let curvature_per_m = match defect.place {
            super::contact::DefectPlace::OuterRace => ball_per_m - 1.0 / outer_m,
            super::contact::DefectPlace::InnerRace | super::contact::DefectPlace::Element(_) => {
                ball_per_m + 1.0 / race_m
            }
        };
        let (depth_m, half_width_m) = (defect.depth_m, 0.5 * defect.width_m);
        Defect {
            place: defect.place,
            angle_rad: defect.angle_rad,
            half_width_rad: half_width_m / radius_m,
            profile: match defect.profile {
                ProfileKind::Step => Profile::Step { depth_m },
                ProfileKind::RaisedCosine => Profile::RaisedCosine { depth_m },
                ProfileKind::Geometric => {
                    Profile::Geometric { depth_m, half_width_m, curvature_per_m }
                }
            },
        }
    }
}

/// Refuses speeds whose ball passes or meshing teeth lie beyond what the modes can follow.
fn check_band(scene: &Scene, plan: &Plan) -> Result<(), SceneErrors> {
    let of_bearing = |bearing: &SceneBearing| match &bearing.kind {
        BearingKind::Ball(ball) => {
            let passes = f64::from(ball.bearing.balls) * (1.0 - ball.bearing.cage_ratio);
            passes * ball.bearing.turns.abs()
        }
        BearingKind::Linear { .. } => scene.turns(bearing.place.shaft).abs(),
    };
    let of_teeth = scene.gears.iter().map(|gear| gear.design.gear.z());
    let order = scene.bearings.iter().map(of_bearing).chain(of_teeth).fold(1.0, f64::max);
    let fastest_hz = scene.speed.fastest_rad_per_s() / TAU;
    if order * fastest_hz <= plan.highest_hz {
        return Ok(());
    }
    let found = format!("{fastest_hz} Hz, which excites {:.0} Hz", order * fastest_hz);
    let allowed = format!(
        "excitation below the highest mode kept, {:.0} Hz: a lower speed or more modes (count)",
        plan.highest_hz
    );
    Err(scene.mistake("speed", found, allowed))
}

/// Refuses linear bearings that feed motion.
fn check_stability(scene: &Scene, model: &Model) -> Result<(), SceneErrors> {
    if model.linear_seats.is_empty() {
        return Ok(());
    }
    let fastest = scene.speed.fastest_rad_per_s();
    let highest = model.basis.omega_rad_per_s.last().copied().unwrap_or(0.0);
    for speed in [0.0, fastest] {
        let growth = LinearSystem::new(model, speed).growth_rad_per_s();
        // Eigenvalues are exact to rounding of the largest.
        if growth > 1e-10 * highest {
            let linear =
                |bearing: &SceneBearing| matches!(bearing.kind, BearingKind::Linear { .. });
            let at = scene.bearings.iter().position(linear).unwrap_or(0);
            let found = format!(
                "stiffness and damping under which motion grows {growth:.3} a second at {:.1} Hz",
                speed / TAU
            );
            let allowed = "bearings under which it dies out: more damping, or less cross-coupling";
            return Err(scene.mistake(&format!("bearing[{at}]"), found, allowed));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;

#[cfg(test)]
mod shaft_tests;
