//! The linear part of a model with contacts, and the ports at which contacts see and push it.

use super::loads;
use crate::simulator::linear::LinearSystem;
use crate::simulator::model::{GearSeat, Model};
use nalgebra::DVector;

/// The linear part: with these stiffnesses of the ball bearings in place of the supports in the
/// basis, their dampers, and the mean stiffness and the damper of the gears in place of what holds
/// the torsion in its shapes.
pub(super) fn linearised(
    model: &Model,
    speed_rad_per_s: f64,
    stiffness_n_per_m: &[[[f64; 2]; 2]],
) -> LinearSystem {
    let mut system = LinearSystem::new(model, speed_rad_per_s);
    for (seat, stiffness) in model.seats.iter().zip(stiffness_n_per_m) {
        let (support, damping) = (seat.support_n_per_m, seat.contacts.bearing().damping_n_s_per_m);
        let rows = [0, 1].map(|plane| lateral(model, &seat.row, plane));
        for (i, push) in rows.iter().enumerate() {
            for (j, see) in rows.iter().enumerate() {
                let (k, d) = if i == j { (support, damping) } else { (0.0, 0.0) };
                system.stiffen(push, see, stiffness[i][j] - k, d);
            }
        }
    }
    for gear in &model.gears {
        let turn = turning(model, &gear.turn);
        system.stiffen(&turn, &turn, -gear.held_n_per_m, 0.0);
        let [drive, _] = flanks(model, gear);
        let (stiffness, damping) = loads::held(&gear.mesh);
        system.stiffen(&drive, &drive, stiffness, damping);
    }
    system
}

/// A row of one plane as a row over all coordinates.
fn lateral(model: &Model, row: &[f64], plane: usize) -> Vec<f64> {
    let mut whole = vec![0.0; model.n_coordinates()];
    whole[plane * row.len()..(plane + 1) * row.len()].copy_from_slice(row);
    whole
}

/// A row of the torsion as a row over all coordinates.
fn turning(model: &Model, row: &[f64]) -> Vec<f64> {
    let mut whole = vec![0.0; model.n_coordinates()];
    whole[2 * model.basis.len()..].copy_from_slice(row);
    whole
}

/// Rows along which drive and back flanks of a gear push.
fn flanks(model: &Model, gear: &GearSeat) -> [Vec<f64>; 2] {
    let planes = [0, 1].map(|plane| lateral(model, &gear.row, plane));
    let turn = turning(model, &gear.turn);
    [(gear.drive, 1.0), (gear.back, -1.0)].map(|(direction, sense)| {
        let along =
            |i: usize| direction[0] * planes[0][i] + direction[1] * planes[1][i] + sense * turn[i];
        (0..turn.len()).map(along).collect()
    })
}

/// Where forces come in, and what is read of the motion: see [`super::loads`].
pub(super) struct Ports {
    pub(super) rows: Vec<Vec<f64>>,
    pub(super) inputs: Vec<DVector<f64>>,
    pub(super) outputs: Vec<DVector<f64>>,
}

impl Ports {
    pub(super) fn new(model: &Model, system: &LinearSystem) -> Self {
        let of_seat =
            |seat: &crate::simulator::model::Seat| [0, 1].map(|p| lateral(model, &seat.row, p));
        let mut rows: Vec<Vec<f64>> = model.seats.iter().flat_map(of_seat).collect();
        let n_lateral = rows.len();
        for gear in &model.gears {
            rows.extend(flanks(model, gear).into_iter().take(gear.mesh.n_flanks()));
        }
        let displacements = rows.iter().map(|row| system.displacement(row));
        let velocities = rows[n_lateral..].iter().map(|row| system.velocity(row));
        Self {
            inputs: rows.iter().map(|row| system.input(row)).collect(),
            outputs: displacements.chain(velocities).collect(),
            rows,
        }
    }
}
