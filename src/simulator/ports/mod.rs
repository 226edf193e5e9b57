//! A rotor at constant speed whose loads depend on its motion at a few ports only: the fast way
//! (equations R9, R32, R33).
//!
//! All that is linear — shaft, gyroscopic coupling, dampers, unbalance, bow, gravity — is propagated
//! exactly: the steady motion in closed form, the free motion in coordinates that each turn and
//! decay by themselves. Only the contacts are integrated, by the exponential Runge–Kutta method of
//! fourth order; they see and push the rotor at their ports, so the stages of a step need the
//! displacements of the ports and not the state. [`super::run::Run`] is the slow way and the
//! reference. Must not know scenes.

mod advance;
mod balls;
mod lanes;
mod loads;
mod spectrum;
mod step;

#[cfg(test)]
mod tests;

use super::linear::{LinearSystem, Seen, Steady};
use super::mesh::Mesh;
use super::model::{GearSeat, Model};
use super::run::Watch;
use lanes::{Rows, WIDTH};
use loads::{Loads, Look, Moment};
use nalgebra::DVector;
use pulp::{Arch, Simd, WithSimd};
use spectrum::Spectrum;
use step::{Ported, StepMap};

/// Grid steps between two exact evaluations of the angles.
const STRIDE: i64 = 64;

/// Edges closer to each other, or to the grid, than this part of a step are one.
const SAME_TIME: f64 = 1e-9;

/// The run by which the stiffness of the contacts is taken: looks, and steps between two.
const PILOT: (usize, usize) = (2000, 4);

/// Least stiffness of a ball bearing in the linear part, of the support's in the basis.
const LEAST_STIFFNESS: f64 = 0.05;

/// A model in motion at constant speed.
#[derive(Debug, Clone)]
pub struct PortRun {
    arch: Arch,
    model: Model,
    system: LinearSystem,
    spectrum: Spectrum,
    steady: Steady,
    ported: Ported,
    loads: Loads,
    /// Steady part of what is read: constant, cos and sin part.
    still: Vec<[f64; 3]>,
    watched: Watched,
    grid: StepMap,
    odd: StepMap,
    speed_rad_per_s: f64,
    step_s: f64,
    /// Whether steps are cut where balls touch or leave.
    cuts_at_contact: bool,
    n_steps: i64,
    /// Angles at the next step, if the last one ended there.
    now: Option<Moment>,
    /// Whether the next step must ask which balls are over defects.
    is_stale: bool,
    /// The free motion.
    list: Vec<f64>,
    work: Work,
    kept: Kept,
}

/// What a step changes, to take it back.
#[derive(Debug, Clone)]
struct Kept {
    list: Vec<f64>,
    read: Vec<f64>,
    now: Moment,
}

/// What is watched, as rows over the free motion, forces and steady motion.
#[derive(Debug, Clone)]
struct Watched {
    rows: Rows,
    /// Effect of the force at each port, [watch·n_in + port].
    direct: Vec<f64>,
    steady: Vec<[f64; 3]>,
}

/// Lists that steps need.
#[derive(Debug, Clone, Default)]
struct Work {
    /// What is read at the start of the step: see [`loads`].
    now: Vec<f64>,
    /// The same of the free motion in the middle and at the end; and what is watched.
    free: Vec<[f64; WIDTH]>,
    seen: Vec<[f64; WIDTH]>,
    stage: Vec<f64>,
    /// What is read in the middle of the last step.
    middle: Vec<f64>,
    /// Forces at the ports: start, first and second of the middle, end; and what they amount to.
    forces: [Vec<f64>; 4],
    amounts: Vec<f64>,
    angles: Vec<f64>,
    edges_s: Vec<f64>,
    /// Pieces of a step that are still to go, the next last.
    ahead_s: Vec<f64>,
}

impl Work {
    fn new((n_in, n_out): (usize, usize), n_watches: usize) -> Self {
        let blocks = |n_rows: usize| vec![[0.0; WIDTH]; n_rows.div_ceil(WIDTH)];
        Self {
            now: vec![0.0; n_out],
            stage: vec![0.0; n_out],
            middle: vec![0.0; n_out],
            free: blocks(2 * n_out),
            seen: blocks(n_watches),
            forces: std::array::from_fn(|_| vec![0.0; n_in]),
            amounts: vec![0.0; 3 * n_in],
            ..Self::default()
        }
    }
}

impl PortRun {
    /// A run from rest, or from the state given (displacements and velocities of all coordinates),
    /// in steps of `step_s`, the next of which is `first_step`. `None` where this way is not open:
    /// speed not constant, no steady motion, overdamped or nearly defective linear part.
    #[must_use]
    pub fn new(
        model: &Model,
        watches: &[Watch],
        step_s: f64,
        first_step: i64,
        state: Option<(&[f64], &[f64])>,
    ) -> Option<Self> {
        let support = |seat: &super::model::Seat| {
            let k = seat.support_n_per_m;
            [[k, 0.0], [0.0, k]]
        };
        let supports: Vec<_> = model.seats.iter().map(support).collect();
        let start = (first_step, state);
        let mut pilot = Self::about(model, &[], step_s, start, &supports)?;
        let stiffness = pilot.mean_stiffness_n_per_m();
        let run = Self::about(model, watches, step_s, start, &stiffness);
        run.or_else(|| Self::about(model, watches, step_s, start, &supports))
    }

    /// A run with these stiffnesses of the ball bearings in the linear part.
    fn about(
        model: &Model,
        watches: &[Watch],
        step_s: f64,
        (first_step, state): (i64, Option<(&[f64], &[f64])>),
        stiffness_n_per_m: &[[[f64; 2]; 2]],
    ) -> Option<Self> {
        let speed_rad_per_s = model.speed.constant_rad_per_s()?;
        let system = linearised(model, speed_rad_per_s, stiffness_n_per_m);
        let steady = system.steady(model)?;
        let spectrum = Spectrum::of(system.matrix())?;
        let loads = Loads::new(model, stiffness_n_per_m);
        let ports = Ports::new(model, &system);
        let inputs: Vec<_> = ports.inputs.iter().map(|input| spectrum.input(input)).collect();
        let outputs: Vec<_> = ports.outputs.iter().map(|row| spectrum.output(row)).collect();
        let ported = Ported::new(&spectrum.values, &inputs, &outputs);
        let arch = Arch::new();
        let mut grid = StepMap::new(&ported);
        arch.dispatch(SetStep { map: &mut grid, ported: &ported, step_s });
        let mut run = Self {
            arch,
            kept: Kept { list: Vec::new(), read: Vec::new(), now: Moment::at(0.0, &loads) },
            loads,
            still: ports.outputs.iter().map(|row| steady.seen_by(row)).collect(),
            watched: watched(&system, &steady, &spectrum, &ports, watches),
            odd: StepMap::new(&ported),
            model: model.clone(),
            list: vec![0.0; lanes::list_len(spectrum.values.len())],
            n_steps: first_step,
            work: Work::new((ported.n_in, ported.n_out), watches.len()),
            system,
            spectrum,
            steady,
            ported,
            grid,
            speed_rad_per_s,
            step_s,
            cuts_at_contact: false,
            now: None,
            is_stale: true,
        };
        run.begin(state);
        Some(run)
    }

    /// Runs a while and tells the mean tangent stiffness of every ball bearing, N/m: about it, what
    /// is left to integrate varies least. Never below a small part of the support, so that the
    /// linear part holds the shaft.
    fn mean_stiffness_n_per_m(&mut self) -> Vec<[[f64; 2]; 2]> {
        let mut sums = vec![[0.0; 3]; self.loads.seats.len()];
        for _ in 0..PILOT.0 {
            self.fill(PILOT.1, &mut []);
            let now = Moment::at(self.shaft_rad(self.time_s()), &self.loads);
            let look = Look { now: &now, read: &self.work.now };
            for (sum, now) in sums.iter_mut().zip(self.loads.stiffness_n_per_m(look)) {
                sum.iter_mut().zip(now).for_each(|(sum, now)| *sum += now / PILOT.0 as f64);
            }
        }
        let of = |(seat, [xx, xy, yy]): (&loads::Seat, [f64; 3])| {
            let least = LEAST_STIFFNESS * seat.given_back_n_per_m[0][0];
            let softest = 0.5 * (xx + yy) - (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
            let missing = (least - softest).max(0.0);
            [[xx + missing, xy], [xy, yy + missing]]
        };
        self.loads.seats.iter().zip(sums).map(of).collect()
    }

    /// The same run with another step; the next one, with which it begins, is `first_step`. To be
    /// used before the first step.
    #[must_use]
    pub fn with_step(mut self, step_s: f64, first_step: i64) -> Self {
        let set = SetStep { map: &mut self.grid, ported: &self.ported, step_s };
        self.arch.dispatch(set);
        (self.step_s, self.n_steps) = (step_s, first_step);
        self
    }

    /// The same run with other watches.
    #[must_use]
    pub fn watching(&self, watches: &[Watch]) -> Self {
        let mut run = self.clone();
        let ports = Ports::new(&run.model, &run.system);
        run.watched = watched(&run.system, &run.steady, &run.spectrum, &ports, watches);
        run.work.seen = vec![[0.0; WIDTH]; watches.len().div_ceil(WIDTH)];
        run
    }

    /// Number of watches.
    #[must_use]
    pub fn n_watches(&self) -> usize {
        self.watched.steady.len()
    }

    /// Cuts steps where balls touch or leave, which keeps the order of four.
    #[must_use]
    pub fn cutting_at_contact(mut self, cuts: bool) -> Self {
        self.cuts_at_contact = cuts;
        self
    }

    /// Begins at rest, or with the state given; of a state of both planes alone the torsion rests under
    /// its torque.
    fn begin(&mut self, state: Option<(&[f64], &[f64])>) {
        let n = self.model.n_coordinates();
        let (mut q, mut v) =
            state.map_or((vec![0.0; n], vec![0.0; n]), |(q, v)| (q.to_vec(), v.to_vec()));
        if let Some(torsion) = self.model.torsion.as_ref().filter(|t| q.len() + t.len() == n) {
            q.extend(torsion.rest());
            v.resize(q.len(), 0.0);
        }
        self.set_state((&q, &v));
    }

    fn set_state(&mut self, (q, v): (&[f64], &[f64])) {
        let free = self.system.state(q, v) - self.steady.state(self.shaft_rad(self.time_s()));
        self.list = lanes::list(&self.spectrum.input(&free));
        (self.now, self.is_stale) = (None, true);
    }

    /// Time at which the next step begins, s.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.n_steps as f64 * self.step_s
    }

    fn shaft_rad(&self, time_s: f64) -> f64 {
        self.model.speed.at(time_s).angle_rad
    }

    /// Displacements and velocities of all coordinates at the next step's beginning.
    #[must_use]
    pub fn state(&self) -> (Vec<f64>, Vec<f64>) {
        let coordinates = lanes::numbers(&self.list, self.spectrum.values.len());
        let free = self.spectrum.state(&coordinates);
        self.system.coordinates(&(free + self.steady.state(self.shaft_rad(self.time_s()))))
    }

    /// Exchanges loads and contacts for those of a model that differs in nothing else; the motion
    /// goes on. `false`, and nothing changed, if there is no steady motion under them.
    pub fn change(&mut self, model: &Model, watches: &[Watch]) -> bool {
        let Some(steady) = self.system.steady(model) else { return false };
        let (q, v) = self.state();
        let ports = Ports::new(model, &self.system);
        self.still = ports.outputs.iter().map(|row| steady.seen_by(row)).collect();
        self.watched = watched(&self.system, &steady, &self.spectrum, &ports, watches);
        self.loads.exchange(model);
        self.steady = steady;
        self.model = model.clone();
        self.set_state((&q, &v));
        true
    }

    /// Largest load of a ball of every bearing so far, N.
    pub fn peak_loads_n(&self) -> impl Iterator<Item = f64> {
        self.loads.peak_loads_n()
    }

    /// The gear meshes.
    pub fn meshes(&self) -> impl Iterator<Item = &Mesh> {
        self.loads.meshes()
    }

    /// Whether the motion is still a number.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.list.iter().all(|x| x.is_finite())
    }

    /// Takes `n` steps of the grid and appends to each list of `out` what its watch sees at the
    /// beginning of each.
    ///
    /// # Panics
    ///
    /// If `out` does not have one list a watch.
    pub fn fill(&mut self, n: usize, out: &mut [Vec<f64>]) {
        assert_eq!(out.len(), self.watched.steady.len(), "one list a watch");
        let arch = self.arch;
        let mut left = n;
        while left > 0 {
            // Strides begin at the same steps however a run is cut into calls: same bits.
            let to_anchor = STRIDE - self.n_steps.rem_euclid(STRIDE);
            let n_steps = usize::try_from(to_anchor).unwrap_or(left).min(left);
            arch.dispatch(Advance { run: self, n_steps, out });
            left -= n_steps;
        }
    }
}

/// The linear part: with these stiffnesses of the ball bearings in place of the supports in the
/// basis, their dampers, and the mean stiffness and the damper of the gears in place of what holds
/// the torsion in its shapes.
fn linearised(
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

/// Where forces come in, and what is read of the motion: see [`loads`].
struct Ports {
    rows: Vec<Vec<f64>>,
    inputs: Vec<DVector<f64>>,
    outputs: Vec<DVector<f64>>,
}

impl Ports {
    fn new(model: &Model, system: &LinearSystem) -> Self {
        let of_seat = |seat: &super::model::Seat| [0, 1].map(|p| lateral(model, &seat.row, p));
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

fn watched(
    system: &LinearSystem,
    steady: &Steady,
    spectrum: &Spectrum,
    ports: &Ports,
    watches: &[Watch],
) -> Watched {
    let mut rows = Rows::zero(watches.len(), lanes::list_len(spectrum.values.len()));
    let (mut direct, mut still) = (Vec::new(), Vec::new());
    for (i, watch) in watches.iter().enumerate() {
        let Seen { row, constant, phasor } = Seen::by(system, steady, watch);
        rows.set(i, &spectrum.output(&row));
        direct.extend(ports.rows.iter().map(|row| system.direct(watch, row)));
        still.push([constant, phasor.0, -phasor.1]);
    }
    Watched { rows, direct, steady: still }
}

struct SetStep<'a> {
    map: &'a mut StepMap,
    ported: &'a Ported,
    step_s: f64,
}

impl WithSimd for SetStep<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.map.set(simd, self.ported, self.step_s);
    }
}

/// Some steps of the grid.
struct Advance<'a> {
    run: &'a mut PortRun,
    n_steps: usize,
    out: &'a mut [Vec<f64>],
}

impl WithSimd for Advance<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.run.stride(simd, self.n_steps, self.out);
    }
}
