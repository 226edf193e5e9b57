//! A rotor at constant speed whose loads depend on its motion at a few ports only: the fast way
//! (equations R9, R18, R19).
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
mod spectrum;
mod step;

#[cfg(test)]
mod tests;

use super::linear::{LinearSystem, Seen, Steady};
use super::model::{LinearSeat, Model};
use super::run::Watch;
use balls::Balls;
use lanes::{Rows, WIDTH};
use nalgebra::DVector;
use pulp::{Arch, Simd, WithSimd};
use spectrum::Spectrum;
use step::{Ported, StepMap};

/// Most grid steps between two exact evaluations of the angles.
const STRIDE: usize = 64;

/// Edges closer to each other, or to the grid, than this part of a step are one.
const SAME_TIME: f64 = 1e-9;

/// A model in motion at constant speed.
#[derive(Debug, Clone)]
pub struct PortRun {
    arch: Arch,
    model: Model,
    system: LinearSystem,
    spectrum: Spectrum,
    steady: Steady,
    ported: Ported,
    seats: Vec<Seat>,
    /// Steady displacement of every port: constant, cos and sin part.
    port_steady: Vec<[f64; 3]>,
    watched: Watched,
    grid: StepMap,
    odd: StepMap,
    speed_rad_per_s: f64,
    step_s: f64,
    n_steps: i64,
    /// The free motion.
    list: Vec<f64>,
    work: Work,
}

/// A ball bearing with its two ports.
#[derive(Debug, Clone)]
struct Seat {
    balls: Balls,
    support_n_per_m: f64,
    cage_ratio: f64,
}

/// What is watched, as rows over the free motion, forces and steady motion.
#[derive(Debug, Clone)]
struct Watched {
    rows: Rows,
    /// Effect of the force at each port, [watch·n_ports + port].
    direct: Vec<f64>,
    steady: Vec<[f64; 3]>,
}

/// Lists that steps need.
#[derive(Debug, Clone, Default)]
struct Work {
    /// Displacements of the ports at the start of the step.
    now_m: Vec<f64>,
    /// Free displacements in the middle and at the end; and what is watched.
    free: Vec<[f64; WIDTH]>,
    seen: Vec<[f64; WIDTH]>,
    stage_m: Vec<f64>,
    /// Forces at the ports: start, first and second of the middle, end; and what they amount to.
    forces: [Vec<f64>; 4],
    amounts: Vec<f64>,
    angles: Vec<f64>,
    edges_s: Vec<f64>,
}

/// Angles of shaft and cages at one moment.
#[derive(Debug, Clone)]
struct Moment {
    shaft_rad: f64,
    /// cos and sin of the shaft's angle.
    shaft: (f64, f64),
    /// The same of every cage's.
    cages: Vec<(f64, f64)>,
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
        let speed_rad_per_s = model.speed.constant_rad_per_s()?;
        let linear = with_dampers(model);
        let system = LinearSystem::new(&linear, speed_rad_per_s);
        let steady = system.steady(model)?;
        let spectrum = Spectrum::of(system.matrix())?;
        let ports = ports(model, &system);
        let inputs: Vec<_> = ports.iter().map(|port| spectrum.input(&port.input)).collect();
        let outputs: Vec<_> = ports.iter().map(|port| spectrum.output(&port.output)).collect();
        let ported = Ported::new(&spectrum.values, &inputs, &outputs);
        let n = ported.n_ports;
        let arch = Arch::new();
        let mut grid = StepMap::new(&ported);
        arch.dispatch(SetStep { map: &mut grid, ported: &ported, step_s });
        let seat = |seat: &super::model::Seat| Seat {
            cage_ratio: seat.contacts.bearing().cage_ratio,
            support_n_per_m: seat.support_n_per_m,
            balls: Balls::new(seat.contacts.clone()),
        };
        let len = lanes::list_len(spectrum.values.len());
        let blocks = |n_rows: usize| vec![[0.0; WIDTH]; n_rows.div_ceil(WIDTH)];
        let work = Work {
            now_m: vec![0.0; n],
            stage_m: vec![0.0; n],
            free: blocks(2 * n),
            seen: blocks(watches.len()),
            forces: std::array::from_fn(|_| vec![0.0; n]),
            amounts: vec![0.0; 3 * n],
            ..Work::default()
        };
        let mut run = Self {
            arch,
            seats: model.seats.iter().map(seat).collect(),
            port_steady: ports.iter().map(|port| steady.seen_by(&port.output)).collect(),
            watched: watched(&system, &steady, &spectrum, &ports, watches),
            odd: StepMap::new(&ported),
            model: model.clone(),
            list: vec![0.0; len],
            n_steps: first_step,
            system,
            spectrum,
            steady,
            ported,
            grid,
            speed_rad_per_s,
            step_s,
            work,
        };
        let zero = vec![0.0; 2 * model.basis.len()];
        run.set_state(state.unwrap_or((&zero, &zero)));
        Some(run)
    }

    fn set_state(&mut self, (q, v): (&[f64], &[f64])) {
        let free = self.system.state(q, v) - self.steady.state(self.shaft_rad(self.time_s()));
        self.list = lanes::list(&self.spectrum.input(&free));
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
        let ports = ports(model, &self.system);
        self.port_steady = ports.iter().map(|port| steady.seen_by(&port.output)).collect();
        self.watched = watched(&self.system, &steady, &self.spectrum, &ports, watches);
        for (seat, new) in self.seats.iter_mut().zip(&model.seats) {
            seat.balls.exchange(new.contacts.clone());
        }
        self.steady = steady;
        self.model = model.clone();
        self.set_state((&q, &v));
        true
    }

    /// Largest load of a ball of every bearing so far, N.
    pub fn peak_loads_n(&self) -> impl Iterator<Item = f64> {
        self.seats.iter().map(|seat| seat.balls.peak_force_n())
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
            let n_steps = left.min(STRIDE);
            arch.dispatch(Advance { run: self, n_steps, out });
            left -= n_steps;
        }
    }
}

/// The model with the dampers of its ball bearings as linear seats.
fn with_dampers(model: &Model) -> Model {
    let mut linear = model.clone();
    for seat in &model.seats {
        let damping = seat.contacts.bearing().damping_n_s_per_m;
        linear.linear_seats.push(LinearSeat {
            row: seat.row.clone(),
            stiffness_n_per_m: [[0.0; 2]; 2],
            damping_n_s_per_m: [[damping, 0.0], [0.0, damping]],
        });
    }
    linear
}

/// A direction at a place: what a force along it does to ẏ, and how y shows its displacement.
struct Port {
    row: Vec<f64>,
    input: DVector<f64>,
    output: DVector<f64>,
}

/// Two ports a ball bearing: x, y.
fn ports(model: &Model, system: &LinearSystem) -> Vec<Port> {
    let n = model.basis.len();
    let along = |row: &[f64], plane: usize| {
        let mut whole = vec![0.0; 2 * n];
        whole[plane * n..(plane + 1) * n].copy_from_slice(row);
        Port { input: system.input(&whole), output: system.displacement(&whole), row: whole }
    };
    model.seats.iter().flat_map(|seat| [0, 1].map(|plane| along(&seat.row, plane))).collect()
}

fn watched(
    system: &LinearSystem,
    steady: &Steady,
    spectrum: &Spectrum,
    ports: &[Port],
    watches: &[Watch],
) -> Watched {
    let mut rows = Rows::zero(watches.len(), lanes::list_len(spectrum.values.len()));
    let (mut direct, mut still) = (Vec::new(), Vec::new());
    for (i, watch) in watches.iter().enumerate() {
        let Seen { row, constant, phasor } = Seen::by(system, steady, watch);
        rows.set(i, &spectrum.output(&row));
        direct.extend(ports.iter().map(|port| system.direct(watch, &port.row)));
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
