//! The rotor on its bearings as oscillators under load, or two geared ones: the constant model of a run
//! (equations R6–R11, R36).
//!
//! Coordinates: the shapes of the plane of x, of all shafts, then those of y, then those of the torsion, if a
//! gear mesh asks for it. Must not know scenes or sensors.

use super::contact::Contacts;
use super::etd::{Load, Oscillators};
use super::mesh::{Crossing, Mesh, Moment};
use super::modes::Basis;
use super::rotor::{Place, Plane};
use super::speed::{SpeedProfile, Turning};
use super::torsion::Torsion;
use nalgebra::DVector;

/// A force that turns with the shaft, in the basis: what it is when the shaft angle is 0 along x,
/// and along y.
#[derive(Debug, Clone, PartialEq)]
pub struct Turned {
    along_x: Vec<f64>,
    along_y: Vec<f64>,
}

impl Turned {
    /// No force on `n` shapes.
    #[must_use]
    pub fn none(n: usize) -> Self {
        Self { along_x: vec![0.0; n], along_y: vec![0.0; n] }
    }

    /// Adds a modal force of this direction in the shaft, rad from its mark.
    pub fn add(&mut self, modal: &[f64], angle_rad: f64) {
        let (sin, cos) = angle_rad.sin_cos();
        for (i, force) in modal.iter().enumerate() {
            self.along_x[i] += force * cos;
            self.along_y[i] += force * sin;
        }
    }
}

/// Most shafts of a model.
pub const MAX_SHAFTS: usize = 2;

/// What turns with one of the shafts.
#[derive(Debug, Clone, PartialEq)]
pub struct TurningLoads {
    /// Turns of the shaft to one of the first; below 0 against it.
    pub turns: f64,
    /// Static unbalance Σ m·e·φ, kg·m in the basis.
    pub unbalance: Turned,
    /// Force of the residual bow, N in the basis.
    pub bow: Turned,
}

impl TurningLoads {
    /// A shaft without loads, of `n` shapes.
    #[must_use]
    pub fn none(n: usize, turns: f64) -> Self {
        Self { turns, unbalance: Turned::none(n), bow: Turned::none(n) }
    }
}

/// A bearing at its place.
#[derive(Debug, Clone, PartialEq)]
pub struct Seat {
    /// Row of Φ at the bearing.
    pub row: Vec<f64>,
    /// Stiffness of the support that is in the basis and is given back here, N/m.
    pub support_n_per_m: f64,
    /// The contacts.
    pub contacts: Contacts,
}

/// A linear bearing at its place: F = −K·u − C·u̇, beyond the support in the basis.
#[derive(Debug, Clone, PartialEq)]
pub struct LinearSeat {
    /// Row of Φ at the bearing.
    pub row: Vec<f64>,
    /// Stiffness beyond the basis [[xx, xy], [yx, yy]], N/m.
    pub stiffness_n_per_m: [[f64; 2]; 2],
    /// Damping, N·s/m.
    pub damping_n_s_per_m: [[f64; 2]; 2],
}

/// A gear at its place: it reads how far the flanks approach each other, and pushes them apart (R25).
#[derive(Debug, Clone, PartialEq)]
pub struct GearSeat {
    /// Row of Φ at the gear; where the mate moves, less the row at the mate.
    pub row: Vec<f64>,
    /// Base radius times the row of the torsion's shapes, m; where the mate turns, both added.
    pub turn: Vec<f64>,
    /// Direction of the force on the gear by its drive flanks (x, y); they turn it forward.
    pub drive: [f64; 2],
    /// The same by its back flanks; they turn it backward.
    pub back: [f64; 2],
    /// Mean stiffness that holds the torsion in its shapes and is given back here, N/m.
    pub held_n_per_m: f64,
    /// The teeth.
    pub mesh: Mesh,
}

impl GearSeat {
    /// Directions of drive and back force for a drive force at this angle, rad from x, and this
    /// pressure angle, rad.
    #[must_use]
    pub fn directions(drive_rad: f64, pressure_rad: f64) -> [[f64; 2]; 2] {
        // The mate lies 90° and the pressure angle behind; mirrored at the line of centres.
        let back_rad = drive_rad - std::f64::consts::PI - 2.0 * pressure_rad;
        [drive_rad, back_rad].map(|angle| [angle.cos(), angle.sin()])
    }

    /// Approaches of drive and back flanks for displacements (or, of velocities, their rates).
    fn approaches(&self, qx: &[f64], qy: &[f64], qt: &[f64]) -> [f64; 2] {
        let (x, y, turn) = (dot(&self.row, qx), dot(&self.row, qy), dot(&self.turn, qt));
        let along = |direction: [f64; 2]| x * direction[0] + y * direction[1];
        [-along(self.drive) - turn, -along(self.back) + turn]
    }
}

/// The constant part of a run, with the contacts' present side.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// The basis of one plane.
    pub basis: Basis,
    /// Damping ratio of each shape.
    pub damping: Vec<f64>,
    /// How the first shaft turns.
    pub speed: SpeedProfile,
    /// What turns with each shaft, one to [`MAX_SHAFTS`].
    pub shafts: Vec<TurningLoads>,
    /// Constant forces along x and y, N in the basis.
    pub constant: [Vec<f64>; 2],
    /// Ball bearings.
    pub seats: Vec<Seat>,
    /// Linear bearings.
    pub linear_seats: Vec<LinearSeat>,
    /// Torsion; `None`: nothing turns the shaft unevenly.
    pub torsion: Option<Torsion>,
    /// Gear meshes.
    pub gears: Vec<GearSeat>,
    /// Gyroscopic matrix, row by row; empty: left out.
    gyroscopic: Vec<f64>,
    /// A time within the present step: which side of a bend of the speed it lies on, s.
    side_s: Option<f64>,
}

impl Model {
    /// A model of one shaft without forces or bearings beyond the supports in the basis.
    #[must_use]
    pub fn new(basis: Basis, damping_ratio: f64, speed: SpeedProfile) -> Self {
        let n = basis.len();
        let gyroscopic = (0..n * n).map(|i| basis.gyroscopic[(i / n, i % n)]).collect();
        Self {
            damping: vec![damping_ratio; n],
            speed,
            shafts: vec![TurningLoads::none(n, 1.0)],
            constant: [vec![0.0; n], vec![0.0; n]],
            seats: Vec::new(),
            linear_seats: Vec::new(),
            torsion: None,
            gears: Vec::new(),
            gyroscopic,
            side_s: None,
            basis,
        }
    }

    /// Leaves the gyroscopic coupling out.
    pub fn without_gyroscopic(&mut self) {
        self.gyroscopic.clear();
    }

    /// Adds an unbalance m·e, kg·m, at a place, its direction in the shaft in rad.
    ///
    /// # Panics
    ///
    /// If there is no such shaft.
    pub fn add_unbalance(
        &mut self,
        plane: &Plane,
        place: impl Into<Place>,
        kg_m: f64,
        angle_rad: f64,
    ) {
        let place = place.into();
        let row = self.basis.row(plane.displacement_at(place));
        let modal: Vec<f64> = row.iter().map(|phi| phi * kg_m).collect();
        self.shafts[place.shaft].unbalance.add(&modal, angle_rad);
    }

    /// Adds a residual bow of a shaft: displacement, m, and slope of every node, 0 on others, in the
    /// direction of this angle in the shaft, rad. Its force is that of the free shaft (R6).
    ///
    /// # Panics
    ///
    /// If the bow does not have one entry a degree of freedom, or there is no such shaft.
    pub fn add_bow(&mut self, plane: &Plane, shaft: usize, bow: &DVector<f64>, angle_rad: f64) {
        let modal = self.basis.project(&(&plane.shaft_stiffness * bow));
        self.shafts[shaft].bow.add(&modal, angle_rad);
    }

    /// Adds a uniform acceleration along x and y, m/s², such as gravity.
    pub fn add_acceleration(&mut self, plane: &Plane, along_m_per_s2: [f64; 2]) {
        let shift = DVector::from_fn(plane.n_dof(), |i, _| if i % 2 == 0 { 1.0 } else { 0.0 });
        let modal = self.basis.project(&(&plane.mass * shift));
        for (constant, acceleration) in self.constant.iter_mut().zip(along_m_per_s2) {
            for (sum, force) in constant.iter_mut().zip(&modal) {
                *sum += acceleration * force;
            }
        }
    }

    /// Real and imaginary part of the force that turns with a shaft at its constant speed, both planes:
    /// the force is Re(F·e^{iφ}), φ the angle of that shaft.
    #[must_use]
    pub fn turning_force(shaft: &TurningLoads, speed_rad_per_s: f64) -> (Vec<f64>, Vec<f64>) {
        let square = speed_rad_per_s * speed_rad_per_s;
        let sum = |unbalance: &[f64], bow: &[f64]| -> Vec<f64> {
            unbalance.iter().zip(bow).map(|(u, b)| square * u + b).collect()
        };
        let x = sum(&shaft.unbalance.along_x, &shaft.bow.along_x);
        let y = sum(&shaft.unbalance.along_y, &shaft.bow.along_y);
        let minus: Vec<f64> = x.iter().map(|x| -x).collect();
        ([&x[..], &y[..]].concat(), [&y[..], &minus[..]].concat())
    }

    /// The oscillators of both planes and of the torsion.
    #[must_use]
    pub fn oscillators(&self) -> Oscillators {
        let (omega, damping) = (&self.basis.omega_rad_per_s[..], &self.damping[..]);
        let torsion = self.torsion.as_ref();
        let (turning, turning_damping) =
            torsion.map_or((&[][..], &[][..]), |t| (&t.basis.omega_rad_per_s[..], &t.damping[..]));
        Oscillators {
            omega_rad_per_s: [omega, omega, turning].concat(),
            damping: [damping, damping, turning_damping].concat(),
        }
    }

    /// Number of coordinates: both planes and the torsion.
    #[must_use]
    pub fn n_coordinates(&self) -> usize {
        2 * self.basis.len() + self.torsion.as_ref().map_or(0, Torsion::len)
    }

    /// Displacements and velocities of all coordinates from those given, or at rest; of a state of both
    /// planes alone the torsion rests under its torque.
    ///
    /// # Panics
    ///
    /// If the state does not have one entry a coordinate then.
    #[must_use]
    pub fn beginning(&self, state: Option<(Vec<f64>, Vec<f64>)>) -> (Vec<f64>, Vec<f64>) {
        let n = self.n_coordinates();
        let (mut q, mut v) = state.unwrap_or_else(|| (vec![0.0; n], vec![0.0; n]));
        if let Some(torsion) = self.torsion.as_ref().filter(|t| q.len() + t.len() == n) {
            q.extend(torsion.rest());
            v.resize(q.len(), 0.0);
        }
        assert!(q.len() == n && v.len() == n, "one entry a coordinate");
        (q, v)
    }

    /// Raises every damping ratio to at least this.
    pub fn damp_at_least(&mut self, ratio: f64) {
        let turning = self.torsion.iter_mut().flat_map(|torsion| &mut torsion.damping);
        for damping in self.damping.iter_mut().chain(turning) {
            *damping = damping.max(ratio);
        }
    }

    /// Appends the times in (`from_s`, `to_s`] at which the load has an edge.
    pub fn edges(&self, from_s: f64, to_s: f64, angles: &mut Vec<f64>, times_s: &mut Vec<f64>) {
        // Where the speed reverses, the angle comes back: each side is searched by itself.
        let (mut begin_s, end_s) = (from_s, to_s);
        while let Some(reversal_s) = self.speed.reversal(begin_s, end_s) {
            self.edges_one_way(begin_s, reversal_s, angles, times_s);
            times_s.push(reversal_s);
            begin_s = reversal_s;
        }
        self.edges_one_way(begin_s, end_s, angles, times_s);
        if let SpeedProfile::Table(points) = &self.speed {
            times_s.extend(points.iter().map(|p| p.0).filter(|t| *t > from_s && *t <= to_s));
        }
    }

    /// [`Model::edges`] of a time in which the speed keeps its sense.
    fn edges_one_way(&self, from_s: f64, to_s: f64, angles: &mut Vec<f64>, times_s: &mut Vec<f64>) {
        angles.clear();
        let (from, to) = (self.speed.at(from_s).angle_rad, self.speed.at(to_s).angle_rad);
        for seat in &self.seats {
            seat.contacts.edges(from, to, angles);
        }
        for gear in &self.gears {
            gear.mesh.edges(from, to, angles);
        }
        times_s.extend(angles.iter().filter_map(|a| self.speed.passes(*a, from_s, to_s)));
    }

    /// A bound of the frequency at which the stiffest bearing moves what the shapes lend it of mass, rad/s: √(k·Σφ²), wherever
    /// it comes to within `step_s` (R37).
    #[must_use]
    pub fn contact_rate_bound(&self, (q, v): (&[f64], &[f64]), step_s: f64) -> f64 {
        let n = self.basis.len();
        let square = |seat: &Seat| {
            let length = |x: &[f64]| dot(&seat.row, &x[..n]).hypot(dot(&seat.row, &x[n..2 * n]));
            let at_m = length(q) + step_s * length(v);
            seat.contacts.stiffness_bound_n_per_m(at_m) * dot(&seat.row, &seat.row)
        };
        self.seats.iter().map(square).fold(0.0, f64::max).sqrt()
    }

    /// Decides on which side of every edge a step lies, by its middle.
    pub fn set_side(&mut self, middle_s: f64) {
        self.side_s = Some(middle_s);
        let angle = self.speed.at(middle_s).angle_rad;
        for seat in &mut self.seats {
            seat.contacts.set_side(angle);
        }
        for gear in &mut self.gears {
            gear.mesh.set_side(angle);
        }
    }

    /// What a gear sees of a state.
    fn moment(&self, gear: &GearSeat, (time_s, q, v): (f64, &[f64], &[f64])) -> Moment {
        let n = self.basis.len();
        let seen = |x: &[f64]| gear.approaches(&x[..n], &x[n..2 * n], &x[2 * n..]);
        let gear_rad = self.speed.at(time_s).angle_rad;
        Moment { gear_rad, approach_m: seen(q), rate_m_per_s: seen(v) }
    }

    /// Keeps the teeth that touch in a state touching, and the others apart, for a step from there.
    pub fn hold(&mut self, state: (f64, &[f64], &[f64])) {
        for i in 0..self.gears.len() {
            let moment = self.moment(&self.gears[i], state);
            self.gears[i].mesh.hold(&moment);
        }
    }

    /// The first pair of teeth that meets or parts between two states, and its gear.
    #[must_use]
    pub fn crossing(
        &self,
        from: (f64, &[f64], &[f64]),
        to: (f64, &[f64], &[f64]),
    ) -> Option<(usize, Crossing)> {
        let of_gear = |(i, gear): (usize, &GearSeat)| {
            let (begin, end) = (self.moment(gear, from), self.moment(gear, to));
            gear.mesh.crossing(&begin, &end, to.0 - from.0).map(|crossing| (i, crossing))
        };
        let all = self.gears.iter().enumerate().filter_map(of_gear);
        all.min_by(|a, b| a.1.part.total_cmp(&b.1.part))
    }

    /// Loads that depend on time alone.
    fn turning_loads(&self, turning: Turning, fx: &mut [f64], fy: &mut [f64]) {
        fx.copy_from_slice(&self.constant[0]);
        fy.copy_from_slice(&self.constant[1]);
        for TurningLoads { turns, unbalance, bow } in &self.shafts {
            let (sin, cos) = (turns * turning.angle_rad).sin_cos();
            let speed_rad_per_s = turns * turning.speed_rad_per_s;
            let square = speed_rad_per_s * speed_rad_per_s;
            let rising = turns * turning.acceleration_rad_per_s2;
            // Of an unbalance u at angle φ: Ω²·(u turned by φ) and Ω̇·(u turned by φ − 90°).
            let (forward, sideways) = (square * cos + rising * sin, square * sin - rising * cos);
            for i in 0..fx.len() {
                let (ux, uy) = (unbalance.along_x[i], unbalance.along_y[i]);
                let (bx, by) = (bow.along_x[i], bow.along_y[i]);
                fx[i] += forward * ux - sideways * uy + cos * bx - sin * by;
                fy[i] += sideways * ux + forward * uy + sin * bx + cos * by;
            }
        }
    }

    /// Torque, inertia against a rising speed, and the gears (R25, R26).
    fn gear_forces(
        &mut self,
        turning: Turning,
        [qx, qy, qt]: [&[f64]; 3],
        [vx, vy, vt]: [&[f64]; 3],
        [fx, fy, ft]: [&mut [f64]; 3],
    ) {
        if let Some(torsion) = &self.torsion {
            let rising = turning.acceleration_rad_per_s2;
            for (i, force) in ft.iter_mut().enumerate() {
                *force = torsion.torque[i] - rising * torsion.inertia[i];
            }
        }
        for gear in &mut self.gears {
            let (approach, rate) = (gear.approaches(qx, qy, qt), gear.approaches(vx, vy, vt));
            let [drive, back] = gear.mesh.force(turning.angle_rad, approach, rate);
            push(fx, &gear.row, drive * gear.drive[0] + back * gear.back[0]);
            push(fy, &gear.row, drive * gear.drive[1] + back * gear.back[1]);
            let given_back = gear.held_n_per_m * dot(&gear.turn, qt);
            push(ft, &gear.turn, drive - back + given_back);
        }
    }
}

impl Load for Model {
    fn force(&mut self, time_s: f64, q: &[f64], v: &[f64], out: &mut [f64]) {
        let n = self.basis.len();
        let turning = self.speed.at_side(time_s, self.side_s.unwrap_or(time_s));
        let rising = turning.acceleration_rad_per_s2;
        let ((qx, rest_q), (vx, rest_v)) = (q.split_at(n), v.split_at(n));
        let ((qy, qt), (vy, vt)) = (rest_q.split_at(n), rest_v.split_at(n));
        let (fx, rest) = out.split_at_mut(n);
        let (fy, ft) = rest.split_at_mut(n);
        self.turning_loads(turning, fx, fy);
        if !self.gyroscopic.is_empty() {
            let rows = self.gyroscopic.chunks_exact(n);
            for (i, row) in rows.enumerate() {
                let (mut hx, mut hy) = (0.0, 0.0);
                for j in 0..n {
                    hx += row[j] * (turning.speed_rad_per_s * vx[j] + 0.5 * rising * qx[j]);
                    hy += row[j] * (turning.speed_rad_per_s * vy[j] + 0.5 * rising * qy[j]);
                }
                fx[i] -= hy;
                fy[i] += hx;
            }
        }
        for seat in &mut self.seats {
            let at = [dot(&seat.row, qx), dot(&seat.row, qy)];
            let moving = [dot(&seat.row, vx), dot(&seat.row, vy)];
            let [px, py] = seat.contacts.force(turning.angle_rad, at, moving);
            let given_back = seat.support_n_per_m;
            push(fx, &seat.row, px + given_back * at[0]);
            push(fy, &seat.row, py + given_back * at[1]);
        }
        for seat in &self.linear_seats {
            let at = [dot(&seat.row, qx), dot(&seat.row, qy)];
            let moving = [dot(&seat.row, vx), dot(&seat.row, vy)];
            let (k, c) = (&seat.stiffness_n_per_m, &seat.damping_n_s_per_m);
            let along = |i: usize| {
                k[i][0] * at[0] + k[i][1] * at[1] + c[i][0] * moving[0] + c[i][1] * moving[1]
            };
            push(fx, &seat.row, -along(0));
            push(fy, &seat.row, -along(1));
        }
        self.gear_forces(turning, [qx, qy, qt], [vx, vy, vt], [fx, fy, ft]);
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn push(force: &mut [f64], row: &[f64], amount: f64) {
    for (force, phi) in force.iter_mut().zip(row) {
        *force += amount * phi;
    }
}
