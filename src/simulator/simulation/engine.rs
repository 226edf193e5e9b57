//! What carries the motion of a scene on: the cheapest way that is open to it.

use crate::simulator::build::Plan;
use crate::simulator::linear::{LinearRun, LinearSystem};
use crate::simulator::model::Model;
use crate::simulator::ports::PortRun;
use crate::simulator::run::{Run, Watch};
use crate::simulator::scene::{Scene, Start};
use crate::simulator::simulation::step_choice::{self, Choice};
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
    Ported(Box<PortRun>),
    /// Anything.
    Stepped(Box<Stepped>),
}

/// The general way, with what it shows.
#[derive(Debug)]
pub(super) struct Stepped {
    run: Run,
    watches: Vec<Watch>,
}

/// What a motion with contacts or changing speed begins with.
#[derive(Clone, Copy)]
struct Begin<'a> {
    scene: &'a Scene,
    model: &'a Model,
    watches: &'a [Watch],
    plan: &'a Plan,
}

type State = (Vec<f64>, Vec<f64>);

impl Begin<'_> {
    /// From sample `begin` of the fastest channel on, from rest or from the state given, with the step
    /// that keeps the accuracy.
    fn chosen(self, begin: i64, state: Option<State>) -> (Engine, Option<Choice>) {
        let given = state.as_ref().map(|(q, v)| (&q[..], &v[..]));
        let at = (self.plan.rate_hz, begin);
        match step_choice::choose(self.scene, self.model, self.watches, at, given) {
            Some((run, choice)) => (Engine::Ported(Box::new(run)), Some(choice)),
            None => (self.general(begin, state), None),
        }
    }

    /// The same with the step of the plan.
    fn planned(self, begin: i64, state: Option<State>) -> Engine {
        let given = state.as_ref().map(|(q, v)| (&q[..], &v[..]));
        let begin_step = begin * i64::from(self.plan.steps_per_sample);
        match PortRun::new(self.model, self.watches, self.plan.step_s(), begin_step, given) {
            Some(run) => Engine::Ported(Box::new(run)),
            None => self.general(begin, state),
        }
    }

    fn general(self, begin: i64, state: Option<State>) -> Engine {
        let begin_step = begin * i64::from(self.plan.steps_per_sample);
        let run = Run::new(self.model.clone(), self.plan.step_s(), state).beginning_at(begin_step);
        Engine::Stepped(Box::new(Stepped { run, watches: self.watches.to_vec() }))
    }
}

fn steps(n_samples: i64, steps_per_sample: u32) -> usize {
    usize::try_from(n_samples).unwrap_or(0) * steps_per_sample as usize
}

impl Engine {
    /// The motion at time 0, with the step chosen if there was a choice; `None` if there is no steady motion to begin with.
    pub(super) fn new(
        scene: &Scene,
        model: &Model,
        plan: &Plan,
        watches: &[Watch],
    ) -> Option<(Self, Option<Choice>)> {
        let at_start = scene.speed.at(0.0);
        if plan.is_linear {
            let speed_hz = at_start.speed_rad_per_s / TAU;
            let zero = vec![0.0; 2 * model.basis.len()];
            let rest = (scene.start == Start::Rest).then_some((&zero[..], &zero[..]));
            let run = LinearRun::new(model, speed_hz, watches, plan.rate_hz, rest)?;
            return Some((Self::Linear(Box::new(run)), None));
        }
        let begin = Begin { scene, model, watches, plan };
        if scene.start == Start::Rest {
            return Some(begin.chosen(0, None));
        }
        let system = LinearSystem::new(model, at_start.speed_rad_per_s);
        let steady = system.steady(model)?;
        if model.seats.is_empty() && model.gears.is_empty() {
            let state = steady.at(&system, at_start.angle_rad);
            return Some(begin.chosen(0, Some(state)));
        }
        #[expect(clippy::cast_possible_truncation, reason = "ten thousands")]
        let n_samples = |seconds: f64| (seconds * plan.rate_hz).round() as i64;
        let mut relaxed = model.clone();
        relaxed.damp_at_least(RUN_IN_DAMPING);
        let (first, second) = (n_samples(RUN_IN_S.0), n_samples(RUN_IN_S.1));
        let from = scene.speed.at(-(first + second) as f64 / plan.rate_hz);
        let state = steady.at(&system, from.angle_rad);
        let run_in = Begin { model: &relaxed, watches: &[], ..begin };
        let mut run_in = run_in.planned(-(first + second), Some(state));
        run_in.fill(steps(first, plan.steps_per_sample), &mut []);
        let (mut run, choice) = begin.chosen(-second, run_in.state());
        let n_steps = choice.map_or(plan.steps_per_sample, |choice| choice.steps_per_sample);
        run.fill(steps(second, n_steps), &mut vec![Vec::new(); watches.len()]);
        Some((run, choice))
    }

    fn state(&self) -> Option<State> {
        match self {
            Self::Linear(run) => Some(run.state()),
            Self::Ported(run) => Some(run.state()),
            Self::Stepped(stepped) => {
                let (q, v) = stepped.run.state();
                Some((q.to_vec(), v.to_vec()))
            }
        }
    }

    /// Takes `n` steps and leaves in `motion` what each watch sees at the beginning of each.
    pub(super) fn fill(&mut self, n: usize, motion: &mut [Vec<f64>]) {
        motion.iter_mut().for_each(Vec::clear);
        match self {
            Self::Linear(run) => run.fill(n, motion),
            Self::Ported(run) => run.fill(n, motion),
            Self::Stepped(stepped) => {
                for _ in 0..n {
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
    pub(super) fn change(&mut self, model: &Model, watches: &[Watch]) -> bool {
        match self {
            Self::Linear(run) => run.set_loads(model, watches),
            Self::Ported(run) => run.change(model, watches),
            Self::Stepped(stepped) => {
                stepped.run.change(|running| {
                    running.bow = model.bow.clone();
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
            Self::Ported(run) => run.is_finite(),
            Self::Stepped(stepped) => stepped.run.state().0.iter().all(|q| q.is_finite()),
        }
    }

    /// Largest load of a ball of every ball bearing so far, N.
    pub(super) fn peak_loads_n(&self) -> Vec<f64> {
        match self {
            Self::Linear(_) => Vec::new(),
            Self::Ported(run) => run.peak_loads_n().collect(),
            Self::Stepped(stepped) => {
                let seats = &stepped.run.model().seats;
                seats.iter().map(|seat| seat.contacts.peak_force_n()).collect()
            }
        }
    }
}
