//! Gears and torsion of a model.

use super::super::mesh::{Mesh, ToothFault, design_error};
use super::super::model::{GearSeat, Model};
use super::super::modes::BasisError;
use super::super::rotor::{Place, Plane, Rotor};
use super::super::scene::{Faults, MateSeat, Scene, SceneErrors, SceneGear, SceneMate};
use super::super::torsion::{Arm, Rod, Torsion};
use super::{BAND_MARGINS, MODES, band_hz};
use std::f64::consts::TAU;

/// Puts the gears of a scene, without their faults, and the torsion they need into a model.
pub(super) fn seat(
    scene: &Scene,
    rotors: &[Rotor],
    plane: &Plane,
    model: &mut Model,
) -> Result<(), SceneErrors> {
    for gear in &scene.gears {
        let mate = match gear.mate {
            SceneMate::Prescribed => None,
            SceneMate::Shaft(mate) => Some(mate),
        };
        let (torsion, arms) = torsion(scene, (gear, mate.as_ref()), rotors, plane)?;
        let mut row = model.basis.row(plane.displacement_at(gear.at_m));
        if let Some(mate) = mate {
            let of_mate = model.basis.row(plane.displacement_at(seat_of(&mate)));
            row.iter_mut().zip(of_mate).for_each(|(phi, mate)| *phi -= mate);
        }
        let pressure_rad = gear.design.gear.pressure_rad;
        let [drive, back] = GearSeat::directions(gear.line_of_action_rad, pressure_rad);
        model.gears.push(GearSeat {
            row,
            turn: turn(&torsion, &arms),
            drive,
            back,
            held_n_per_m: gear.mean_stiffness_n_per_m,
            mesh: Mesh::new(gear.design.clone(), &[]),
        });
        model.torsion = Some(torsion);
    }
    Ok(())
}

/// Place of a mate.
fn seat_of(mate: &MateSeat) -> Place {
    Place { shaft: 1, at_m: mate.disc.at_m }
}

/// How far the flanks come apart for a unit of each shape of the torsion, m (R36).
fn turn(torsion: &Torsion, arms: &[Arm]) -> Vec<f64> {
    let mut turn = vec![0.0; torsion.len()];
    for (node, base_m) in arms {
        for (sum, phi) in turn.iter_mut().zip(torsion.basis.row(*node)) {
            *sum += base_m * phi;
        }
    }
    turn
}

/// The torsion of the shafts that a gear joins, and where its flanks push.
fn torsion(
    scene: &Scene,
    (gear, mate): (&SceneGear, Option<&MateSeat>),
    rotors: &[Rotor],
    plane: &Plane,
) -> Result<(Torsion, Vec<Arm>), SceneErrors> {
    let of_shaft =
        |(i, rotor): (usize, &Rotor)| (Rod::new(rotor, &rotor.assemble()), scene.turns(i));
    let mut rod = Rod::beside(&rotors.iter().enumerate().map(of_shaft).collect::<Vec<_>>());
    let mut arms = vec![(plane.node_at(gear.at_m), gear.design.gear.base_radius_m())];
    if let Some(mate) = mate {
        arms.push((plane.node_at(seat_of(mate)), gear.design.mate.base_radius_m()));
        let driven = plane.node_at(Place { shaft: 1, at_m: mate.driven_at_m });
        rod.couple(driven, mate.coupling_n_m_per_rad);
    }
    let held = gear.mean_stiffness_n_per_m;
    let basis = if gear.is_rigid {
        rod.rigid(&arms, held)
    } else {
        let highest = TAU * BAND_MARGINS.0 * band_hz(scene);
        rod.basis(&arms, held, highest, MODES.1)
    };
    let basis = basis.map_err(|error| refused(scene, error))?;
    let mut torsion = Torsion::new(&rod, basis, scene.modes.damping);
    torsion.add_torque(plane.node_at(gear.torque_at_m), -gear.torque_n_m);
    Ok((torsion, arms))
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
