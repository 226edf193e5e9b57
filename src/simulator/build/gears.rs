//! Gears and torsion of a model.

use super::super::mesh::{Mesh, ToothFault, design_error};
use super::super::model::{GearSeat, Model};
use super::super::modes::BasisError;
use super::super::rotor::{Plane, Rotor};
use super::super::scene::{Faults, Scene, SceneErrors, SceneGear};
use super::super::torsion::{Rod, Torsion};
use super::{BAND_MARGIN, MODES, band_hz};
use std::f64::consts::TAU;

/// Puts the gears of a scene, without their faults, and the torsion they need into a model.
pub(super) fn seat(
    scene: &Scene,
    rotor: &Rotor,
    plane: &Plane,
    model: &mut Model,
) -> Result<(), SceneErrors> {
    for gear in &scene.gears {
        let base_m = gear.design.gear.base_radius_m();
        let held = gear.mean_stiffness_n_per_m;
        let rod = Rod::new(rotor, plane);
        let node = rod.node_at(gear.at_m);
        let held_n_m = held * base_m * base_m;
        let basis = if gear.is_rigid {
            rod.rigid(held_n_m)
        } else {
            let highest = TAU * BAND_MARGIN.0 * band_hz(scene);
            rod.basis(node, held_n_m, highest, MODES.1).map_err(|error| refused(scene, error))?
        };
        let mut torsion = Torsion::new(&rod, basis, scene.modes.damping);
        torsion.add_torque(rod.node_at(gear.torque_at_m), -gear.torque_n_m);
        let pressure_rad = gear.design.gear.pressure_rad;
        let [drive, back] = GearSeat::directions(gear.line_of_action_rad, pressure_rad);
        model.gears.push(GearSeat {
            row: model.basis.row(plane.displacement_at(gear.at_m)),
            turn: torsion.basis.row(node).iter().map(|phi| base_m * phi).collect(),
            drive,
            back,
            held_n_per_m: held,
            mesh: Mesh::new(gear.design.clone(), &[]),
        });
        model.torsion = Some(torsion);
    }
    Ok(())
}

fn refused(scene: &Scene, error: BasisError) -> SceneErrors {
    scene.mistake("gear[0]", "a torsion that cannot be reduced", error.to_string())
}

/// Puts faults of teeth into a model in place of those it has.
pub(super) fn set_faults(
    scene: &Scene,
    model: &mut Model,
    faults: &Faults,
) -> Result<(), SceneErrors> {
    let unknown = |(id, _): &&(String, ToothFault)| scene.gears.iter().all(|g| g.id != *id);
    if let Some((id, _)) = faults.teeth.iter().find(unknown) {
        let names: Vec<&str> = scene.gears.iter().map(|gear| gear.id.as_str()).collect();
        let allowed = format!("the id of a gear: {}", names.join(", "));
        return Err(scene.mistake("gear", format!("a fault of \"{id}\""), allowed));
    }
    for (i, (seat, gear)) in model.gears.iter_mut().zip(&scene.gears).enumerate() {
        let its = its_faults(gear, faults);
        if let Some(error) = design_error(&gear.design, &its) {
            return Err(scene.mistake(&format!("gear[{i}]"), error, "gears that can mesh"));
        }
        seat.mesh = Mesh::new(gear.design.clone(), &its);
    }
    Ok(())
}

fn its_faults(gear: &SceneGear, faults: &Faults) -> Vec<ToothFault> {
    faults.teeth.iter().filter(|(id, _)| *id == gear.id).map(|(_, fault)| *fault).collect()
}
