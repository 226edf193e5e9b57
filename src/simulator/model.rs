//! The rotor on its bearings as oscillators under load: the constant model of a run
//! (equations R6–R11).
//!
//! Coordinates: the shapes of the plane of x, then those of y, then those of the torsion, if a gear
//! mesh asks for it. Must not know scenes or sensors.

use super::contact::Contacts;
use super::etd::{Load, Oscillators};
use super::mesh::{Crossing, Mesh, Moment};
use super::modes::Basis;
use super::rotor::Plane;
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
    /// How the shaft turns.
    pub speed: SpeedProfile,
    /// Static unbalance Σ m·e·φ, kg·m in the basis.
    pub unbalance: Turned,
    /// Force of the residual bow, N in the basis.
    pub bow: Turned,
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
    /// A model without forces or bearings beyond the supports in the basis.
    #[must_use]
    pub fn new(basis: Basis, damping_ratio: f64, speed: SpeedProfile) -> Self {
        let n = basis.len();
        let gyroscopic = (0..n * n).map(|i| basis.gyroscopic[(i / n, i % n)]).collect();
        Self {
            damping: vec![damping_ratio; n],
            speed,
            unbalance: Turned::none(n),
            bow: Turned::none(n),
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
    pub fn add_unbalance(&mut self, plane: &Plane, at_m: f64, kg_m: f64, angle_rad: f64) {
        let row = self.basis.row(plane.displacement_at(at_m));
        let modal: Vec<f64> = row.iter().map(|phi| phi * kg_m).collect();
        self.unbalance.add(&modal, angle_rad);
    }

    /// Adds a residual bow: displacement, m, and slope of every node, in the direction of this angle
    /// in the shaft, rad. Its force is that of the free shaft (R6).
    ///
    /// # Panics
    ///
    /// If the bow does not have one entry a degree of freedom.
    pub fn add_bow(&mut self, plane: &Plane, bow: &DVector<f64>, angle_rad: f64) {
        let modal = self.basis.project(&(&plane.shaft_stiffness * bow));
        self.bow.add(&modal, angle_rad);
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

    /// Real and imaginary part of the force that turns with the shaft at constant speed, both planes:
    /// the force is Re(F·e^{iφ}).
    #[must_use]
    pub fn turning_force(&self, speed_rad_per_s: f64) -> (Vec<f64>, Vec<f64>) {
        let square = speed_rad_per_s * speed_rad_per_s;
        let sum = |unbalance: &[f64], bow: &[f64]| -> Vec<f64> {
            unbalance.iter().zip(bow).map(|(u, b)| square * u + b).collect()
        };
        let x = sum(&self.unbalance.along_x, &self.bow.along_x);
        let y = sum(&self.unbalance.along_y, &self.bow.along_y);
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
        let (sin, cos) = turning.angle_rad.sin_cos();
        let square = turning.speed_rad_per_s * turning.speed_rad_per_s;
        let rising = turning.acceleration_rad_per_s2;
        // Of an unbalance u at angle φ: Ω²·(u turned by φ) and Ω̇·(u turned by φ − 90°).
        let (forward, sideways) = (square * cos + rising * sin, square * sin - rising * cos);
        for i in 0..fx.len() {
            let (ux, uy) = (self.unbalance.along_x[i], self.unbalance.along_y[i]);
            let (bx, by) = (self.bow.along_x[i], self.bow.along_y[i]);
            fx[i] = self.constant[0][i] + forward * ux - sideways * uy + cos * bx - sin * by;
            fy[i] = self.constant[1][i] + sideways * ux + forward * uy + sin * bx + cos * by;
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
