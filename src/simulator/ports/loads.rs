//! What pushes a rotor at its ports: ball bearings and gear meshes, and when they touch.
//!
//! Ports come in this order: x and y of every ball bearing, then the flanks of every gear. What is
//! read of the motion: the displacement of every port, then the velocity of the gears' ports.

use super::balls::Balls;
use crate::simulator::linear::Still;
use crate::simulator::mesh::{self, Crossing, Mesh};
use crate::simulator::model::{MAX_SHAFTS, Model};
use pulp::Simd;

/// All loads.
#[derive(Debug, Clone, Default)]
pub(super) struct Loads {
    pub(super) seats: Vec<Seat>,
    pub(super) gears: Vec<Gear>,
    /// Turns of every shaft to one of the first; 0 of one that is not there.
    turns: [f64; MAX_SHAFTS],
}

/// A ball bearing with its two ports.
#[derive(Debug, Clone)]
pub(super) struct Seat {
    pub(super) balls: Balls,
    /// Stiffness that is in the linear part and is given back here, N/m.
    pub(super) given_back_n_per_m: [[f64; 2]; 2],
    /// Turns of the cage to one of the first shaft.
    cage_turns: f64,
}

/// A gear with a port for each flank that can touch: the direction in which its force pushes.
#[derive(Debug, Clone)]
pub(super) struct Gear {
    mesh: Mesh,
    /// Stiffness, N/m, and damping, N·s/m, of the drive flanks that are in the linear part and are
    /// given back here.
    given_back: (f64, f64),
    n_flanks: usize,
    /// Its first port, and where its first velocity is read.
    port: usize,
    velocity: usize,
}

/// Angles of shafts and cages at one moment.
#[derive(Debug, Clone)]
pub(super) struct Moment {
    /// Angle of the first shaft.
    pub(super) shaft_rad: f64,
    /// cos and sin of every shaft's angle.
    shafts: [(f64, f64); MAX_SHAFTS],
    /// The same of every cage's.
    cages: Vec<(f64, f64)>,
}

/// A motion as it is read, at one moment.
#[derive(Clone, Copy)]
pub(super) struct Look<'a> {
    pub(super) now: &'a Moment,
    pub(super) read: &'a [f64],
}

impl Moment {
    /// The angles of shafts and cages when the first shaft's is this.
    pub(super) fn at(shaft_rad: f64, loads: &Loads) -> Self {
        let mut moment = Self { shaft_rad, shafts: [(1.0, 0.0); MAX_SHAFTS], cages: Vec::new() };
        moment.set(shaft_rad, loads);
        moment
    }

    /// Goes on by these angles.
    #[inline(always)]
    pub(super) fn turn(&mut self, by: &Self) {
        let turned = |(c, s): (f64, f64), (dc, ds): (f64, f64)| (c * dc - s * ds, s * dc + c * ds);
        self.shaft_rad += by.shaft_rad;
        for (shaft, by) in self.shafts.iter_mut().zip(by.shafts) {
            *shaft = turned(*shaft, by);
        }
        for (cage, by) in self.cages.iter_mut().zip(&by.cages) {
            *cage = turned(*cage, *by);
        }
    }

    /// cos and sin of every shaft's angle.
    pub(super) fn shafts(&self) -> &[(f64, f64)] {
        &self.shafts
    }

    /// The moment at which the first shaft has this angle.
    pub(super) fn set(&mut self, shaft_rad: f64, loads: &Loads) {
        let unit = |angle: f64| {
            let (sin, cos) = angle.sin_cos();
            (cos, sin)
        };
        (self.shaft_rad, self.shafts) =
            (shaft_rad, loads.turns.map(|turns| unit(turns * shaft_rad)));
        self.cages.clear();
        self.cages.extend(loads.seats.iter().map(|seat| unit(seat.cage_turns * shaft_rad)));
    }

    /// Constant + cos and sin parts.
    #[inline(always)]
    pub(super) fn of(&self, still: &Still) -> f64 {
        let [constant, parts @ ..] = still;
        let turning = parts.chunks_exact(2).zip(&self.shafts);
        constant + turning.map(|(part, (cos, sin))| part[0] * cos + part[1] * sin).sum::<f64>()
    }
}

impl Loads {
    /// Takes the loads of a model, with what of the bearings' stiffness the linear part holds.
    pub(super) fn new(model: &Model, stiffness_n_per_m: &[[[f64; 2]; 2]]) -> Self {
        let seat = |(seat, stiffness): (&crate::simulator::model::Seat, &[[f64; 2]; 2])| Seat {
            cage_turns: seat.contacts.bearing().cage_turns(),
            given_back_n_per_m: *stiffness,
            balls: Balls::new(seat.contacts.clone()),
        };
        let seats: Vec<Seat> = model.seats.iter().zip(stiffness_n_per_m).map(seat).collect();
        let n_ports =
            2 * seats.len() + model.gears.iter().map(|g| g.mesh.n_flanks()).sum::<usize>();
        let (mut port, mut velocity) = (2 * seats.len(), n_ports);
        let gears = model.gears.iter().map(|gear| {
            let n_flanks = gear.mesh.n_flanks();
            let here = (port, velocity);
            (port, velocity) = (port + n_flanks, velocity + n_flanks);
            Gear {
                given_back: held(&gear.mesh),
                mesh: gear.mesh.clone(),
                n_flanks,
                port: here.0,
                velocity: here.1,
            }
        });
        let mut turns = [0.0; MAX_SHAFTS];
        turns.iter_mut().zip(&model.shafts).for_each(|(turns, shaft)| *turns = shaft.turns);
        Self { gears: gears.collect(), seats, turns }
    }

    /// Exchanges bearings and teeth for those of a model with the same ports.
    pub(super) fn exchange(&mut self, model: &Model) {
        for (seat, new) in self.seats.iter_mut().zip(&model.seats) {
            seat.balls.exchange(new.contacts.clone());
        }
        for (gear, new) in self.gears.iter_mut().zip(&model.gears) {
            gear.mesh = new.mesh.clone();
        }
    }

    /// Appends the shaft angles between two, the first excluded, at which a load has an edge.
    pub(super) fn edges(&self, from_rad: f64, to_rad: f64, out: &mut Vec<f64>) {
        for seat in &self.seats {
            seat.balls.contacts().edges(from_rad, to_rad, out);
        }
        for gear in &self.gears {
            gear.mesh.edges(from_rad, to_rad, out);
        }
    }

    /// Decides on which side of every edge a step lies, by the shaft angle in its middle.
    pub(super) fn set_side(&mut self, middle_rad: f64) {
        self.seats.iter_mut().for_each(|seat| seat.balls.set_side(middle_rad));
        self.gears.iter_mut().for_each(|gear| gear.mesh.set_side(middle_rad));
    }

    /// Forces at all ports, at the start of a step or inside it.
    #[inline(always)]
    pub(super) fn forces<S: Simd>(
        &mut self,
        simd: S,
        look: Look<'_>,
        is_start: bool,
        out: &mut [f64],
    ) {
        let Look { now, read } = look;
        let ports = read.chunks_exact(2).zip(out.chunks_exact_mut(2));
        for ((seat, cage), (at, out)) in self.seats.iter_mut().zip(&now.cages).zip(ports) {
            let force = seat.balls.force(simd, now.shaft_rad, *cage, [at[0], at[1]], is_start);
            let [[xx, xy], [yx, yy]] = seat.given_back_n_per_m;
            out[0] = force[0] + xx * at[0] + xy * at[1];
            out[1] = force[1] + yx * at[0] + yy * at[1];
        }
        for gear in &mut self.gears {
            gear.force(look, out);
        }
    }

    /// Keeps the teeth that touch touching, and the others apart, for a step from here.
    pub(super) fn hold(&mut self, look: Look<'_>) {
        for gear in &mut self.gears {
            let moment = gear.moment(look);
            gear.mesh.hold(&moment);
        }
    }

    /// Whether drive flanks of a gear are held apart.
    pub(super) fn are_teeth_apart(&self) -> bool {
        self.gears.iter().any(|gear| gear.mesh.is_apart())
    }

    /// The first pair of teeth that meets or parts in a step of `step_s` between two looks, and its
    /// gear.
    pub(super) fn crossing(
        &self,
        from: Look<'_>,
        to: Look<'_>,
        step_s: f64,
    ) -> Option<(usize, Crossing)> {
        let of_gear = |(i, gear): (usize, &Gear)| {
            let crossing = gear.mesh.crossing(&gear.moment(from), &gear.moment(to), step_s);
            crossing.map(|crossing| (i, crossing))
        };
        let all = self.gears.iter().enumerate().filter_map(of_gear);
        all.min_by(|a, b| a.1.part.total_cmp(&b.1.part))
    }

    /// Lets the pair of a crossing touch or part.
    pub(super) fn cross(&mut self, (gear, crossing): (usize, Crossing)) {
        self.gears[gear].mesh.cross(crossing);
    }

    /// The part of a step after which a ball first touches or leaves, from looks at its start, middle
    /// and end; `None` if none does.
    pub(super) fn first_touch(&mut self, looks: [Look<'_>; 3]) -> Option<f64> {
        let mut first: Option<f64> = None;
        for (i, seat) in self.seats.iter_mut().enumerate() {
            if !seat.balls.has_touched() {
                continue;
            }
            let of = |look: &Look<'_>| {
                let place = [look.read[2 * i], look.read[2 * i + 1]];
                (look.now.shaft_rad, look.now.cages[i], place)
            };
            if let Some(part) = seat.balls.first_touch(looks.each_ref().map(of)) {
                first = Some(first.map_or(part, |first| first.min(part)));
            }
        }
        first
    }

    /// Whether a ball has touched or left since the start of the step.
    pub(super) fn has_touched(&self) -> bool {
        self.seats.iter().any(|seat| seat.balls.has_touched())
    }

    /// Tangent stiffness of every ball bearing, N/m: xx, xy, yy.
    pub(super) fn stiffness_n_per_m(&self, look: Look<'_>) -> impl Iterator<Item = [f64; 3]> {
        let places = look.read.chunks_exact(2);
        self.seats
            .iter()
            .zip(&look.now.cages)
            .zip(places)
            .map(|((seat, cage), at)| seat.balls.stiffness_n_per_m(*cage, [at[0], at[1]]))
    }

    /// Largest load of a ball of every bearing so far, N.
    pub(super) fn peak_loads_n(&self) -> impl Iterator<Item = f64> {
        self.seats.iter().map(|seat| seat.balls.peak_force_n())
    }

    /// The meshes.
    pub(super) fn meshes(&self) -> impl Iterator<Item = &Mesh> {
        self.gears.iter().map(|gear| &gear.mesh)
    }
}

/// Stiffness, N/m, and damping, N·s/m, of a mesh that the linear part holds.
pub(super) fn held(mesh: &Mesh) -> (f64, f64) {
    (mesh.mean_stiffness_n_per_m(), mesh.design().damping_n_s_per_m)
}

impl Gear {
    /// What the mesh sees: a port's motion is away from the flank.
    #[inline]
    fn moment(&self, look: Look<'_>) -> mesh::Moment {
        let mut moment = mesh::Moment {
            gear_rad: look.now.shaft_rad,
            approach_m: [0.0; 2],
            rate_m_per_s: [0.0; 2],
        };
        for flank in 0..self.n_flanks {
            moment.approach_m[flank] = -look.read[self.port + flank];
            moment.rate_m_per_s[flank] = -look.read[self.velocity + flank];
        }
        moment
    }

    #[inline]
    fn force(&mut self, look: Look<'_>, out: &mut [f64]) {
        let moment = self.moment(look);
        let forces = self.mesh.force(moment.gear_rad, moment.approach_m, moment.rate_m_per_s);
        out[self.port..self.port + self.n_flanks].copy_from_slice(&forces[..self.n_flanks]);
        let (stiffness, damping) = self.given_back;
        out[self.port] -= stiffness * moment.approach_m[0] + damping * moment.rate_m_per_s[0];
    }
}
