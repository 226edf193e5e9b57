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
mod filter;
mod linearise;
mod loads;
mod step;
mod watched;

#[cfg(test)]
mod tests;

use super::lanes::{self, Block, Turning, WIDTH};
use super::linear::{LinearSystem, Steady};
use super::mesh::Mesh;
use super::model::Model;
use super::run::Watch;
use super::spectrum::Spectrum;
use linearise::{Ports, linearised};
use loads::{Loads, Look, Moment};
use nalgebra::Complex;
use pulp::{Arch, Simd, WithSimd};
use step::{Ported, StepMap};
use watched::Watched;

/// Grid steps between two exact evaluations of the angles.
const STRIDE: i64 = 64;

/// Edges closer to each other, or to the grid, than this part of a step are one.
const SAME_TIME: f64 = 1e-9;

/// In how many parts steps are taken where balls touch or leave, whose force no polynomial follows, and
/// while teeth are apart or have just met or parted: the linear part holds a mesh that is closed, and what it
/// then gives back is large.
const PARTS_OF_EVENTS: u32 = 2;

/// For how long after teeth met or parted steps are taken in parts, s: the mesh's own motion has then
/// died away.
const RESTLESS_S: f64 = 1e-3;

/// The run by which the stiffness of the contacts is taken: looks, and steps between two.
const PILOT: (usize, usize) = (2000, 4);

/// Least stiffness of a ball bearing in the linear part, of the support's in the basis.
const LEAST_STIFFNESS: f64 = 0.05;

/// Displacements and velocities of all coordinates.
pub type StateRef<'a> = (&'a [f64], &'a [f64]);

/// What is watched, and the corner of the anti-alias filter before it, Hz; `None`: no filter.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensed {
    /// What is watched.
    pub watch: Watch,
    /// Corner of a Butterworth low-pass of eighth order.
    pub corner_hz: Option<f64>,
}

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
    /// Steady part of what is read.
    still: Turning,
    watched: Watched,
    grid: StepMap,
    /// The same of a part of a step: see `parts_of_events`.
    fine: StepMap,
    odd: StepMap,
    /// Length for which `odd` is set, s.
    odd_s: f64,
    /// Half a step of the fine maps.
    fine_turn: Moment,
    /// Half a step of the odd maps.
    odd_turn: Moment,
    speed_rad_per_s: f64,
    step_s: f64,
    /// Steps from one that is watched to the next.
    watched_every: i64,
    /// Whether steps are cut where balls touch or leave.
    cuts_at_contact: bool,
    /// In how many parts a step is taken in which balls touch, or while teeth are restless, and up to
    /// which step they are.
    parts_of_events: u32,
    restless_until: i64,
    /// In how many steps balls touched or left so far.
    n_touches: u64,
    n_steps: i64,
    /// Angles at the next step, if the last one ended there.
    now: Option<Moment>,
    /// Whether the next step must ask which balls are over defects.
    is_stale: bool,
    /// The free motion, and the filters.
    list: Vec<f64>,
    work: Work,
    kept: Kept,
}

/// What a step changes, to take it back.
#[derive(Debug, Clone)]
struct Kept {
    list: Vec<f64>,
    read: Vec<Block>,
    now: Moment,
}

/// Lists that steps need.
#[derive(Debug, Clone, Default)]
struct Work {
    /// What is read at the start of the step: see [`loads`].
    now: Vec<Block>,
    /// The same of the free motion in the middle, behind it at the end; and what is watched.
    free: Vec<Block>,
    seen: Vec<Block>,
    stage: Vec<Block>,
    /// What is read in the middle of the last step.
    middle: Vec<Block>,
    /// Forces at the ports: start, first and second of the middle, end; and two sums of them.
    forces: [Vec<Block>; 4],
    sums: [Vec<Block>; 2],
    angles: Vec<f64>,
    edges_s: Vec<f64>,
    /// Pieces of a step that are still to go, the next last.
    ahead_s: Vec<f64>,
}

impl Work {
    fn new((n_in, n_out): (usize, usize)) -> Self {
        let blocks = |n: usize| vec![[0.0; WIDTH]; n.div_ceil(WIDTH)];
        Self {
            now: blocks(n_out),
            stage: blocks(n_out),
            middle: blocks(n_out),
            // Whole blocks are taken from where the second half begins.
            free: blocks(2 * n_out + WIDTH),
            forces: std::array::from_fn(|_| blocks(n_in)),
            sums: [blocks(n_in), blocks(n_in)],
            ..Self::default()
        }
    }
}

impl PortRun {
    /// A run from rest, or from the state given (displacements and velocities of all coordinates),
    /// in steps of `step_s`, the next of which is `first_step`, watched nowhere yet. `None` where this
    /// way is not open: speed not constant, no steady motion, nearly defective linear
    /// part.
    #[must_use]
    pub fn new(
        model: &Model,
        step_s: f64,
        first_step: i64,
        state: Option<StateRef<'_>>,
    ) -> Option<Self> {
        let support = |seat: &super::model::Seat| {
            let k = seat.support_n_per_m;
            [[k, 0.0], [0.0, k]]
        };
        let supports: Vec<_> = model.seats.iter().map(support).collect();
        let start = (first_step, state);
        let mut pilot = Self::about(model, step_s, start, &supports)?;
        let stiffness = pilot.mean_stiffness_n_per_m();
        let run = Self::about(model, step_s, start, &stiffness);
        run.or_else(|| Self::about(model, step_s, start, &supports))
    }

    /// A run with these stiffnesses of the ball bearings in the linear part.
    fn about(
        model: &Model,
        step_s: f64,
        (first_step, state): (i64, Option<StateRef<'_>>),
        stiffness_n_per_m: &[[[f64; 2]; 2]],
    ) -> Option<Self> {
        let speed_rad_per_s = model.speed.constant_rad_per_s()?;
        let system = linearised(model, speed_rad_per_s, stiffness_n_per_m);
        let steady = system.steady(model)?;
        let spectrum = Spectrum::of(system.matrix())?;
        let loads = Loads::new(model, stiffness_n_per_m);
        let ports = Ports::new(model, &system);
        if ports.rows.is_empty() {
            return None;
        }
        let watched = Watched::new((&system, &steady, &spectrum), &ports, &[]);
        let ported = ported(&spectrum, &ports, &watched);
        let mut run = Self {
            arch: Arch::new(),
            kept: Kept { list: Vec::new(), read: Vec::new(), now: Moment::at(0.0, &loads) },
            odd_turn: Moment::at(0.0, &loads),
            fine_turn: Moment::at(0.0, &loads),
            loads,
            still: still(&ports, &steady),
            watched,
            grid: StepMap::new(&ported),
            fine: StepMap::new(&ported),
            odd: StepMap::new(&ported),
            odd_s: 0.0,
            model: model.clone(),
            list: vec![0.0; lanes::list_len(spectrum.values.len())],
            n_steps: first_step,
            work: Work::new((ported.n_in, ported.n_out)),
            system,
            spectrum,
            steady,
            ported,
            speed_rad_per_s,
            step_s,
            watched_every: 1,
            cuts_at_contact: false,
            parts_of_events: PARTS_OF_EVENTS,
            restless_until: i64::MIN,
            n_touches: 0,
            now: None,
            is_stale: true,
        };
        run.set_grid();
        let (q, v) = model.beginning(state.map(|(q, v)| (q.to_vec(), v.to_vec())));
        run.set_state((&q, &v));
        Some(run)
    }

    fn set_grid(&mut self) {
        let set = SetStep { map: &mut self.grid, ported: &self.ported, step_s: self.step_s };
        self.arch.dispatch(set);
        let step_s = self.step_s / f64::from(self.parts_of_events);
        let set = SetStep { map: &mut self.fine, ported: &self.ported, step_s };
        self.arch.dispatch(set);
        self.fine_turn.set(0.5 * self.speed_rad_per_s * step_s, &self.loads);
        self.odd_s = 0.0;
    }

    /// Runs a while and tells the mean tangent stiffness of every ball bearing, N/m: about it, what
    /// is left to integrate varies least. Never below a small part of the support, so that the
    /// linear part holds the shaft.
    fn mean_stiffness_n_per_m(&mut self) -> Vec<[[f64; 2]; 2]> {
        let mut sums = vec![[0.0; 3]; self.loads.seats.len()];
        for _ in 0..PILOT.0 {
            self.fill(PILOT.1, &mut []);
            let now = Moment::at(self.shaft_rad(self.time_s()), &self.loads);
            let look = Look { now: &now, read: self.work.now.as_flattened() };
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
        (self.step_s, self.n_steps) = (step_s, first_step);
        self.set_grid();
        self
    }

    /// The same run watched so, at the beginning of every `every`-th step from number 0 on; filters
    /// begin empty. To be used before the first step.
    #[must_use]
    pub fn watching(mut self, sensed: &[Sensed], every: u32) -> Self {
        self.watched_every = i64::from(every.max(1));
        self.set_watches(sensed);
        let empty = vec![Complex::new(0.0, 0.0); self.watched.n_states()];
        self.begin_filters(&empty);
        self
    }

    /// The motion's coordinates.
    fn motion(&self) -> Vec<Complex<f64>> {
        lanes::numbers(&self.list, self.spectrum.values.len())
    }

    /// Lets the filters go on from these states.
    fn begin_filters(&mut self, states: &[Complex<f64>]) {
        let motion = self.motion();
        let filters = self.watched.begun(states, &motion, &self.turn());
        self.list.truncate(lanes::list_len(motion.len()));
        self.list.extend(filters);
        self.kept.list = self.list.clone();
    }

    fn set_watches(&mut self, sensed: &[Sensed]) {
        let ports = Ports::new(&self.model, &self.system);
        let linear = (&self.system, &self.steady, &self.spectrum);
        self.watched = Watched::new(linear, &ports, sensed);
        self.ported = ported(&self.spectrum, &ports, &self.watched);
        self.grid = StepMap::new(&self.ported);
        self.fine = StepMap::new(&self.ported);
        self.odd = StepMap::new(&self.ported);
        self.set_grid();
        self.work.seen = vec![[0.0; WIDTH]; sensed.len().div_ceil(WIDTH)];
    }

    /// e^{iφ} of every shaft at the next step's beginning.
    fn turn(&self) -> Vec<Complex<f64>> {
        let first_rad = self.shaft_rad(self.time_s());
        let angles = self.model.shafts.iter().map(|shaft| shaft.turns * first_rad);
        angles.map(|angle| Complex::from_polar(1.0, angle)).collect()
    }

    /// Number of watches.
    #[must_use]
    pub fn n_watches(&self) -> usize {
        self.watched.still.len()
    }

    /// Takes steps in so many parts, not in two, where balls touch or teeth are restless. To be used
    /// before the first step.
    #[cfg(test)]
    #[must_use]
    fn with_parts_of_events(mut self, parts: u32) -> Self {
        self.parts_of_events = parts.max(1);
        self.set_grid();
        self
    }

    /// In how many steps balls touched or left so far.
    #[must_use]
    pub fn n_touches(&self) -> u64 {
        self.n_touches
    }

    /// Cuts steps where balls touch or leave, which keeps the order of four.
    #[must_use]
    pub fn cutting_at_contact(mut self, cuts: bool) -> Self {
        self.cuts_at_contact = cuts;
        self
    }

    fn set_state(&mut self, (q, v): (&[f64], &[f64])) {
        let free = self.system.state(q, v) - self.steady.state(self.shaft_rad(self.time_s()));
        self.list = lanes::list(&self.spectrum.input(&free));
        self.kept.list = self.list.clone();
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
        let free = self.spectrum.state(&self.motion());
        self.system.coordinates(&(free + self.steady.state(self.shaft_rad(self.time_s()))))
    }

    /// Exchanges loads and contacts for those of a model that differs in nothing else; the motion and
    /// what is in the filters go on. `false`, and nothing changed, if there is no steady motion under
    /// them.
    pub fn change(&mut self, model: &Model, sensed: &[Sensed]) -> bool {
        let Some(steady) = self.system.steady(model) else { return false };
        let (q, v) = self.state();
        let in_filters = self.watched.states(&self.list, &self.motion(), &self.turn());
        self.loads.exchange(model);
        self.steady = steady;
        self.model = model.clone();
        self.set_watches(sensed);
        let ports = Ports::new(model, &self.system);
        self.still = still(&ports, &self.steady);
        self.set_state((&q, &v));
        self.begin_filters(&in_filters);
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
    /// beginning of each that is watched.
    ///
    /// # Panics
    ///
    /// If `out` does not have one list a watch.
    pub fn fill(&mut self, n: usize, out: &mut [Vec<f64>]) {
        assert_eq!(out.len(), self.watched.still.len(), "one list a watch");
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

/// The coordinates of the motion with the ports, and the filters' poles.
fn ported(spectrum: &Spectrum, ports: &Ports, watched: &Watched) -> Ported {
    let inputs: Vec<Vec<_>> = ports.inputs.iter().map(|input| spectrum.input(input)).collect();
    let outputs: Vec<_> = ports.outputs.iter().map(|row| spectrum.output(row)).collect();
    Ported::new(&spectrum.values, &inputs, &outputs, &watched.poles)
}

/// Steady part of what is read.
fn still(ports: &Ports, steady: &Steady) -> Turning {
    let parts: Vec<_> = ports.outputs.iter().map(|row| steady.seen_by(row)).collect();
    Turning::new(&parts, steady.n_shafts())
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
