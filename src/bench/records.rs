//! Errors of time integration: a motion in steps against the reference of the same scene.

use super::gaps::{largest, relative};
use crate::simulator::ports::{PortRun, Sensed};
use crate::simulator::reference::Reference;
use crate::simulator::reference::scene::Setting;
use crate::simulator::run::{Run, Watch};

/// Displacements of the bearings at every step, and samples of the sensors.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    /// m, by bearing and axis, then by step.
    pub bearings: Vec<Vec<f64>>,
    /// SI, by sensor, then by sample.
    pub sensors: Vec<Vec<f64>>,
}

/// The motion followed to a tolerance and looked at every `grid_s`; samples are made of any of its
/// coarser grids.
#[derive(Debug, Clone)]
pub struct Exact<'a> {
    setting: &'a Setting,
    grid_s: f64,
    values: Vec<Vec<f64>>,
}

impl<'a> Exact<'a> {
    /// Follows `seconds`, looks every `grid_s`.
    #[must_use]
    pub fn new(setting: &'a Setting, grid_s: f64, seconds: f64, tolerance: f64) -> Self {
        Self::follow(setting.reference(grid_s, tolerance), setting, grid_s, seconds)
    }

    /// The same with so many evaluations of the forces at most: `None` if they do not reach to the end.
    #[must_use]
    pub fn within(
        setting: &'a Setting,
        grid_s: f64,
        seconds: f64,
        (tolerance, max_forces): (f64, u64),
    ) -> Option<Self> {
        let reference = setting.reference(grid_s, tolerance).within(max_forces);
        let exact = Self::follow(reference, setting, grid_s, seconds);
        (exact.n_steps() == steps(seconds, grid_s)).then_some(exact)
    }

    /// Follows as far as the reference goes.
    fn follow(mut reference: Reference, setting: &'a Setting, grid_s: f64, seconds: f64) -> Self {
        let watches: Vec<&Watch> = setting.bearings.iter().chain(&setting.sensors).collect();
        let mut values = vec![Vec::new(); watches.len()];
        for _ in 0..steps(seconds, grid_s) {
            reference.step();
            if reference.is_spent() {
                break;
            }
            for (list, watch) in values.iter_mut().zip(&watches) {
                list.push(reference.observe(watch));
            }
        }
        Self { setting, grid_s, values }
    }

    /// Steps of the grid that were followed.
    fn n_steps(&self) -> usize {
        self.values.first().map_or(0, Vec::len)
    }

    /// The record that a run in steps of this length should give.
    ///
    /// # Panics
    ///
    /// If that is no multiple of the grid.
    #[must_use]
    pub fn at(&self, step_s: f64) -> Record {
        let every = steps(step_s, self.grid_s);
        assert!((step_s / self.grid_s - every as f64).abs() < 1e-6, "{step_s} {}", self.grid_s);
        let thin = |list: &Vec<f64>| list.iter().step_by(every).copied().collect();
        record(self.setting, step_s, self.values.iter().map(thin).collect())
    }
}

/// The motion in steps, cut at the edges of defects (`is_aligned`) or not.
#[must_use]
pub fn stepped(setting: &Setting, step_s: f64, seconds: f64, is_aligned: bool) -> Record {
    let mut run = Run::new(setting.model.clone(), step_s, setting.state.clone());
    if !is_aligned {
        run = run.without_cuts();
    }
    let watches: Vec<&Watch> = setting.bearings.iter().chain(&setting.sensors).collect();
    let mut values = vec![Vec::new(); watches.len()];
    for _ in 0..steps(seconds, step_s) {
        run.step();
        for (list, watch) in values.iter_mut().zip(&watches) {
            list.push(run.observe(watch));
        }
    }
    record(setting, step_s, values)
}

/// The motion in steps, the way of scenes with contacts at constant speed; `None` where that way is
/// not open.
#[must_use]
pub fn ported(setting: &Setting, step_s: f64, seconds: f64, cuts: bool) -> Option<Record> {
    let mut run = port_run(setting, step_s, cuts)?;
    let mut values = vec![Vec::new(); setting.bearings.len() + setting.sensors.len()];
    run.fill(steps(seconds, step_s), &mut values);
    Some(record(setting, step_s, values))
}

/// That way before its first step, watched by every bearing and sensor.
#[must_use]
pub fn port_run(setting: &Setting, step_s: f64, cuts: bool) -> Option<PortRun> {
    let state = setting.state.as_ref().map(|(q, v)| (&q[..], &v[..]));
    let all = setting.bearings.iter().chain(&setting.sensors);
    let watches: Vec<Sensed> =
        all.map(|watch| Sensed { watch: watch.clone(), corner_hz: None }).collect();
    let run = PortRun::new(&setting.model, step_s, 0, state)?;
    Some(run.watching(&watches, 1).cutting_at_contact(cuts))
}

fn record(setting: &Setting, step_s: f64, mut values: Vec<Vec<f64>>) -> Record {
    let sensors = values.split_off(setting.bearings.len());
    let sampled = |(i, values): (usize, &Vec<f64>)| {
        if setting.plan.is_linear {
            // Computed sample by sample: no filter.
            let every = steps(1.0 / setting.filters[i].0, step_s);
            return values.iter().step_by(every).copied().collect();
        }
        setting.sampled(i, step_s, values)
    };
    Record { bearings: values, sensors: sensors.iter().enumerate().map(sampled).collect() }
}

/// How many steps, rounded.
#[must_use]
pub fn steps(seconds: f64, step_s: f64) -> usize {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "up to 1e6")]
    let n = (seconds / step_s).round() as usize;
    n
}

/// Largest difference in a list of channels, each relative to the reference's largest value there ([`relative`]).
/// A channel that does not move in the reference must not move.
///
/// # Panics
///
/// If channels differ in length.
#[must_use]
pub fn worst(found: &[Vec<f64>], exact: &[Vec<f64>]) -> f64 {
    largest(found.iter().zip(exact).map(|(found, exact)| relative(found, exact)))
}

/// The accelerations of the right bearing from its displacement, each a mean over two steps: points of
/// an acceleration that jumps would fold what lies beyond the sensors into their band.
#[must_use]
pub fn mean_accelerations(setting: &Setting, step_s: f64, record: &Record) -> Record {
    let square = step_s * step_s;
    let sensor = |x: &Vec<f64>| {
        // At rest before time 0.
        let mut means = vec![(x[1] - 2.0 * x[0]) / square];
        means.extend(x.windows(3).map(|x| (x[2] - 2.0 * x[1] + x[0]) / square));
        setting.sampled(0, step_s, &means)
    };
    let right = &record.bearings[2..];
    Record { bearings: record.bearings.clone(), sensors: right.iter().map(sensor).collect() }
}
