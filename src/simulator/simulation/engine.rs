//! What carries the motion of a scene on: the cheapest way that is open to it.

use crate::simulator::build::Plan;
use crate::simulator::linear::{LinearRun, LinearSystem, Steady};
use crate::simulator::model::Model;
use crate::simulator::ports::{PortRun, Sensed};
use crate::simulator::run::{Run, Watch};
use crate::simulator::scene::{Scene, Start};
use crate::simulator::simulation::step_choice::{self, Choice, Chosen};
use std::f64::consts::TAU;

/// Run-in of a scene with contacts that begins rotating: with raised damping, then with its own, s.
const RUN_IN_S: (f64, f64) = (0.4, 0.2);

/// Damping ratio of the first part of the run-in.
const RUN_IN_DAMPING: f64 = 0.1;

/// A motion that goes on.
#[derive(Debug)]
pub(super) enum Engine {
    /// Exactly, sample by sample: no contacts, constant speed.
    Linear(Box<LinearRun>),
    /// Contacts at constant speed.
    Ported(Box<Ported>),
    /// Anything.
    Stepped(Box<Stepped>),
}

/// The fast way with contacts, and its steps a sample.
#[derive(Debug)]
pub(super) struct Ported {
    run: PortRun,
    every: u32,
}

/// The general way, with what it shows and its steps a sample.
#[derive(Debug)]
pub(super) struct Stepped {
    run: Run,
    watches: Vec<Watch>,
    every: u32,
}

/// What a motion with contacts or changing speed begins with.
#[derive(Clone, Copy)]
struct Begin<'a> {
    scene: &'a Scene,
    model: &'a Model,
    sensed: &'a [Sensed],
    plan: &'a Plan,
    /// By how much the usual steps are too long for the motion: a power of two.
    divisor: u32,
}

type State = (Vec<f64>, Vec<f64>);

/// A motion that was begun, with the step chosen if there was a choice.
type Begun = (Engine, Option<Choice>);

/// Why a scene cannot be brought to time 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Refusal {
    /// There is no steady motion to begin with.
    NoSteady,
    /// The shortest step is too long for it: the motion grows without bound.
    TooFast,
}

/// Length of the beginning in which a step of the general way must stay a number and near its half, s.
const STABLE_S: f64 = 0.02;

/// Largest difference of a step and its half that is no instability, of the largest coordinate.
const STABLE: f64 = 0.5;

impl Begin<'_> {
    /// The motion at time 0 by the longest steps that follow it, from what `attempt` makes of a divisor of
    /// the usual ones.
    fn followed(
        self,
        attempt: impl Fn(Self) -> Result<Option<Begun>, Refusal>,
    ) -> Result<Begun, Refusal> {
        let mut begin = self;
        while self.plan.step_s() >= step_choice::SHORTEST_S * f64::from(begin.divisor) {
            if let Some(begun) = attempt(begin)? {
                return Ok(begun);
            }
            begin.divisor *= 2;
        }
        Err(Refusal::TooFast)
    }

    /// From sample `begin` of the fastest channel on, from rest or from the state given, with the step
    /// that keeps the accuracy; `None` if the longest does not follow the motion at all.
    fn chosen(self, begin: i64, state: Option<State>) -> Result<Option<Begun>, Refusal> {
        let given = state.as_ref().map(|(q, v)| (&q[..], &v[..]));
        let at = (self.plan.rate_hz, begin, self.divisor);
        match step_choice::choose(self.scene, self.model, self.sensed, at, given) {
            Some(Chosen::Lost) => Ok(None),
            Some(Chosen::Run(run, choice)) => {
                let ported = Ported { run: *run, every: choice.steps_per_sample };
                Ok(Some((Engine::Ported(Box::new(ported)), Some(choice))))
            }
            None => self.stable(begin, state).map(Some),
        }
    }

    /// The general way with the plan's step, or the longest of its halves that stays a number.
    fn stable(self, begin: i64, state: Option<State>) -> Result<Begun, Refusal> {
        let usual = self.plan.steps_per_sample;
        let step_s = |steps: u32| 1.0 / (self.plan.rate_hz * f64::from(steps));
        let mut steps = usual;
        loop {
            let error = self.parting(begin, &state, steps);
            if error <= STABLE {
                let cuts_at_contact = self.plan.cuts_at_contact;
                let choice = Choice { steps_per_sample: steps, cuts_at_contact, error };
                let choice = (steps != usual).then_some(choice);
                return Ok((self.general((begin, steps), state), choice));
            }
            if step_s(steps) < 2.0 * step_choice::SHORTEST_S {
                return Err(Refusal::TooFast);
            }
            steps *= 2;
        }
    }

    /// How far the beginning with a step and with its half are apart, of the largest coordinate; NaN if one of them is
    /// no number any more.
    fn parting(self, begin: i64, state: &Option<State>, steps: u32) -> f64 {
        let end = |steps: u32| {
            let step_s = 1.0 / (self.plan.rate_hz * f64::from(steps));
            let first = begin * i64::from(steps);
            let run = Run::new(self.model.clone(), step_s, state.clone());
            let mut run = run.beginning_at(first);
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "up to 1e5"
            )]
            let n = (STABLE_S / step_s).ceil() as u32;
            for _ in 0..n {
                run.step();
            }
            run.state().0.to_vec()
        };
        let (coarse, fine) = (end(steps), end(2 * steps));
        if coarse.iter().chain(&fine).any(|q| !q.is_finite()) {
            return f64::NAN;
        }
        let size = fine.iter().fold(0.0_f64, |most, q| most.max(q.abs()));
        let gaps = coarse.iter().zip(&fine).map(|(a, b)| (a - b).abs());
        let gap = gaps.fold(0.0_f64, f64::max);
        // At rest there is nothing to part.
        if size == 0.0 && gap == 0.0 { 0.0 } else { gap / size }
    }

    /// The same with the step of the plan, divided.
    fn planned(self, begin: i64, state: Option<State>) -> Result<Engine, Refusal> {
        let given = state.as_ref().map(|(q, v)| (&q[..], &v[..]));
        let every = self.divisor * self.plan.steps_per_sample;
        let step_s = 1.0 / (self.plan.rate_hz * f64::from(every));
        match PortRun::new(self.model, step_s, begin * i64::from(every), given) {
            Some(run) => {
                let run = run.watching(self.sensed, every);
                Ok(Engine::Ported(Box::new(Ported { run, every })))
            }
            None => self.stable(begin, state).map(|(engine, _)| engine),
        }
    }

    /// From the linear system's steady motion through the run-in to time 0; `None` if the longest step
    /// does not follow the motion at all.
    fn run_in(self, (system, steady): (&LinearSystem, &Steady)) -> Result<Option<Begun>, Refusal> {
        #[expect(clippy::cast_possible_truncation, reason = "ten thousands")]
        let n_samples = |seconds: f64| (seconds * self.plan.rate_hz).round() as i64;
        let mut relaxed = self.model.clone();
        relaxed.damp_at_least(RUN_IN_DAMPING);
        let (first, second) = (n_samples(RUN_IN_S.0), n_samples(RUN_IN_S.1));
        let from = self.scene.speed.at(-(first + second) as f64 / self.plan.rate_hz);
        let state = steady.at(system, from.angle_rad);
        let run_in = Begin { model: &relaxed, sensed: &[], ..self };
        let mut run_in = run_in.planned(-(first + second), Some(state))?;
        run_in.fill(usize::try_from(first).unwrap_or(0), &mut []);
        let Some((mut run, choice)) = self.chosen(-second, run_in.state())? else {
            return Ok(None);
        };
        let n = usize::try_from(second).unwrap_or(0);
        run.fill(n, &mut vec![Vec::new(); self.sensed.len()]);
        Ok(Some((run, choice)))
    }

    fn general(self, (begin, steps): (i64, u32), state: Option<State>) -> Engine {
        let step_s = 1.0 / (self.plan.rate_hz * f64::from(steps));
        let run = Run::new(self.model.clone(), step_s, state);
        Engine::Stepped(Box::new(Stepped {
            run: run.beginning_at(begin * i64::from(steps)),
            watches: watches(self.sensed),
            every: steps,
        }))
    }
}

fn watches(sensed: &[Sensed]) -> Vec<Watch> {
    sensed.iter().map(|sensed| sensed.watch.clone()).collect()
}

impl Engine {
    /// The motion at time 0.
    pub(super) fn new(
        scene: &Scene,
        model: &Model,
        plan: &Plan,
        sensed: &[Sensed],
    ) -> Result<Begun, Refusal> {
        let at_start = scene.speed.at(0.0);
        if plan.is_linear {
            let speed_hz = at_start.speed_rad_per_s / TAU;
            let zero = vec![0.0; 2 * model.basis.len()];
            let rest = (scene.start == Start::Rest).then_some((&zero[..], &zero[..]));
            let run = LinearRun::new(model, speed_hz, &watches(sensed), plan.rate_hz, rest);
            let run = run.ok_or(Refusal::NoSteady)?;
            return Ok((Self::Linear(Box::new(run)), None));
        }
        let begin = Begin { scene, model, sensed, plan, divisor: 1 };
        if scene.start == Start::Rest {
            return begin.followed(|begin| begin.chosen(0, None));
        }
        let system = LinearSystem::new(model, at_start.speed_rad_per_s);
        let steady = system.steady(model).ok_or(Refusal::NoSteady)?;
        if model.seats.is_empty() && model.gears.is_empty() {
            let state = steady.at(&system, at_start.angle_rad);
            return begin.followed(|begin| begin.chosen(0, Some(state.clone())));
        }
        begin.followed(|begin| begin.run_in((&system, &steady)))
    }

    /// Displacements and velocities of all coordinates at the next sample.
    pub(super) fn state(&self) -> Option<State> {
        match self {
            Self::Linear(run) => Some(run.state()),
            Self::Ported(ported) => Some(ported.run.state()),
            Self::Stepped(stepped) => {
                let (q, v) = stepped.run.state();
                Some((q.to_vec(), v.to_vec()))
            }
        }
    }

    /// Whether what it shows went through the anti-alias filters or needs none: one value a sample,
    /// not one a step.
    pub(super) fn is_filtered(&self) -> bool {
        !matches!(self, Self::Stepped(_))
    }

    /// Goes on by `n` samples and leaves in `motion` what each watch sees at the beginning of each, or of
    /// each step if it is not filtered.
    pub(super) fn fill(&mut self, n: usize, motion: &mut [Vec<f64>]) {
        motion.iter_mut().for_each(Vec::clear);
        match self {
            Self::Linear(run) => run.fill(n, motion),
            Self::Ported(ported) => ported.run.fill(n * ported.every as usize, motion),
            Self::Stepped(stepped) => {
                for _ in 0..n * stepped.every as usize {
                    stepped.run.step();
                    for (list, watch) in motion.iter_mut().zip(&stepped.watches) {
                        list.push(stepped.run.observe(watch));
                    }
                }
            }
        }
    }

    /// Exchanges loads and contacts, the motion goes on; `false` if there is no steady motion under
    /// them, and nothing is changed then.
    pub(super) fn change(&mut self, model: &Model, sensed: &[Sensed]) -> bool {
        match self {
            Self::Linear(run) => run.set_loads(model, &watches(sensed)),
            Self::Ported(ported) => ported.run.change(model, sensed),
            Self::Stepped(stepped) => {
                stepped.run.change(|running| {
                    for (shaft, new) in running.shafts.iter_mut().zip(&model.shafts) {
                        shaft.bow = new.bow.clone();
                    }
                    for (seat, new) in running.seats.iter_mut().zip(&model.seats) {
                        seat.contacts = new.contacts.clone();
                    }
                    for (gear, new) in running.gears.iter_mut().zip(&model.gears) {
                        gear.mesh = new.mesh.clone();
                    }
                });
                true
            }
        }
    }

    /// Whether the motion is still a number.
    pub(super) fn is_finite(&self) -> bool {
        match self {
            Self::Linear(_) => true,
            Self::Ported(ported) => ported.run.is_finite(),
            Self::Stepped(stepped) => stepped.run.state().0.iter().all(|q| q.is_finite()),
        }
    }

    /// Largest load of a ball of every ball bearing so far, N.
    pub(super) fn peak_loads_n(&self) -> Vec<f64> {
        match self {
            Self::Linear(_) => Vec::new(),
            Self::Ported(ported) => ported.run.peak_loads_n().collect(),
            Self::Stepped(stepped) => {
                let seats = &stepped.run.model().seats;
                seats.iter().map(|seat| seat.contacts.peak_force_n()).collect()
            }
        }
    }
}
