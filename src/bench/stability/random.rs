//! Scenes at random: none may diverge, free motion of stable systems may not grow, steps keep to the reference.

use super::Search;
use super::drawn::{self, Class};
use super::rows::Row;
use crate::bench::BenchError;
use crate::bench::gaps::largest;
use crate::bench::records::{Exact, ported};
use crate::simulator::reference::scene::Setting;
use crate::simulator::run::{Quantity, Watch};
use crate::simulator::scene::{Scene, Start};
use crate::simulator::simulation::{AdvanceError, Samples, Simulation};
use std::convert::Infallible;
use std::f64::consts::TAU;
use std::num::NonZero;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;

/// Every so manieth scene with contacts is compared with the reference.
const COMPARED_EVERY: u64 = 50;

/// Length of the record that is compared, s, and of the one whose largest value errors are relative to: as when the step is
/// chosen.
const COMPARED_S: f64 = 0.01;
const SIZE_S: f64 = 0.1;

/// Displacements and velocities.
type State = (Vec<f64>, Vec<f64>);

/// Longest step of the scenes that are compared and steps of the record at most: keeps the reference short.
const MAX_COMPARED_STEPS: f64 = 5000.0;

/// What came of a scene.
enum Outcome {
    /// It ran; growth of its free motion, and what came of the comparison, where they were looked for.
    Ran { growth: Option<f64>, error: Option<Compared> },
    /// It was refused, with a reason.
    Refused,
    /// It failed.
    Failed(String),
}

/// What came of a comparison.
#[derive(Clone, Copy)]
enum Compared {
    /// Error in units of the accuracy asked for.
    Error(f64),
    /// The reference needs too much to follow such a motion.
    TooDear,
}

/// What came of a class.
#[derive(Default)]
struct Tally {
    n_ran: usize,
    n_refused: usize,
    n_failed: usize,
    n_grown: usize,
    growth: f64,
    n_compared: usize,
    n_too_dear: usize,
    error: f64,
}

/// What came of every scene, in their order: made by all processors at once, for none knows of another.
fn outcomes(search: &Search) -> Vec<(u64, Class, Outcome)> {
    let next = AtomicU64::new(search.first_seed);
    let last = search.first_seed.saturating_add(search.n_scenes);
    let work = || {
        let mut found = Vec::new();
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            if number >= last {
                return found;
            }
            let drawn = drawn::scene(number);
            let is_compared = number.is_multiple_of(COMPARED_EVERY);
            let outcome = catch_unwind(AssertUnwindSafe(|| outcome(&drawn, is_compared)));
            let outcome = outcome.unwrap_or_else(|_| Outcome::Failed("panicked".to_owned()));
            found.push((number, drawn.class, outcome));
        }
    };
    let workers = thread::available_parallelism().map_or(1, NonZero::get);
    let mut found: Vec<_> = thread::scope(|scope| {
        let workers: Vec<_> = (0..workers).map(|_| scope.spawn(work)).collect();
        let joined =
            workers.into_iter().map(|worker| worker.join().unwrap_or_else(|e| resume_unwind(e)));
        joined.flatten().collect()
    });
    found.sort_by_key(|(number, ..)| *number);
    found
}

/// Runs the scenes and gives three rows a class, and one for each that failed (the first 20).
///
/// # Errors
///
/// None yet: a scene that cannot be computed is a row.
pub fn scenes(search: &Search) -> Result<Vec<Row>, BenchError> {
    let mut tallies = Class::ALL.map(|class| (class, Tally::default()));
    let mut rows = Vec::new();
    for (number, class, outcome) in outcomes(search) {
        let Some((_, tally)) = tallies.iter_mut().find(|(of, _)| *of == class) else {
            continue;
        };
        match outcome {
            Outcome::Ran { growth, error } => {
                tally.n_ran += 1;
                if let Some(growth) = growth {
                    tally.n_grown += 1;
                    tally.growth = tally.growth.max(growth);
                }
                match error {
                    Some(Compared::Error(error)) => {
                        tally.n_compared += 1;
                        tally.error = tally.error.max(error);
                    }
                    Some(Compared::TooDear) => tally.n_too_dear += 1,
                    None => {}
                }
                if let Some(miss) = missed(growth, error).filter(|_| rows.len() < 20) {
                    rows.push(failure(number, class, miss));
                }
            }
            Outcome::Refused => tally.n_refused += 1,
            Outcome::Failed(why) => {
                tally.n_failed += 1;
                if rows.len() < 20 {
                    rows.push(failure(number, class, why));
                }
            }
        }
    }
    let mut all: Vec<Row> =
        tallies.iter().flat_map(|(class, tally)| summary(*class, tally)).collect();
    all.append(&mut rows);
    Ok(all)
}

/// Most that free motion may grow, and most error in units of the accuracy asked for.
const GROWTH: f64 = 2.0;
const ERROR: f64 = 10.0;

fn missed(growth: Option<f64>, error: Option<Compared>) -> Option<String> {
    let growth = growth.filter(|growth| *growth > GROWTH);
    let error = match error {
        Some(Compared::Error(error)) => Some(error).filter(|error| *error > ERROR),
        Some(Compared::TooDear) | None => None,
    };
    growth
        .map(|growth| format!("grows {growth:.3e}"))
        .or(error.map(|error| format!("errs {error:.3e} times the accuracy")))
}

fn failure(number: u64, class: Class, why: String) -> Row {
    let again = format!("--scenes 1 --first-seed {number}: {}, {why}", class.name());
    Row::below("scene at random that failed", again, 1.0, 0.0)
        .in_terms_of("scenes")
        .because("none may")
}

fn summary(class: Class, tally: &Tally) -> Vec<Row> {
    let Tally { n_ran, n_refused, n_failed, n_grown, growth, n_compared, n_too_dear, error } =
        tally;
    let n = n_ran + n_refused + n_failed;
    if n == 0 {
        return Vec::new();
    }
    let parameters = format!("{}: {n_ran} ran, {n_refused} refused", class.name());
    let mut rows = vec![
        Row::below("scenes at random: no number, panic", parameters, *n_failed as f64, 0.0)
            .in_terms_of("scenes")
            .because("every motion is finite or was refused with a reason"),
    ];
    if *n_grown > 0 {
        rows.push(
            Row::below("scenes at random: growth", format!("{n_grown} linear"), *growth, GROWTH)
                .in_terms_of("last ÷ first quarter of free motion")
                .because("beats of two equal modes; what grows does so by orders"),
        );
    }
    if *n_compared + *n_too_dear > 0 {
        let mut parameters = format!("{}: {n_compared} compared", class.name());
        if *n_too_dear > 0 {
            parameters.push_str(&format!(", {n_too_dear} out of the reference's reach"));
        }
        rows.push(
            Row::below("scenes at random: error", parameters, *error, ERROR)
                .in_terms_of("error ÷ accuracy asked for")
                .because("the step is chosen by half-step differences, of the run-in's second part where there is one"),
        );
    }
    rows
}

fn outcome(drawn: &drawn::Drawn, is_compared: bool) -> Outcome {
    let Ok(scene) = Scene::parse(&drawn.text, "drawn") else { return Outcome::Refused };
    let Ok(mut simulation) = Simulation::new(&scene, 1) else { return Outcome::Refused };
    let step_s = simulation.plan().step_s();
    let is_exact = simulation.plan().is_linear;
    let beginning = simulation.state();
    if let Err(why) = motion(&mut simulation) {
        return Outcome::Failed(why);
    }
    let growth = (drawn.class == Class::Linear).then(|| growth(&scene)).flatten();
    // A motion that parts whatever the step (balls that rattle without load) is told as such.
    let is_promised = simulation.plan().expected_error <= scene.accuracy;
    let error = (is_compared && is_promised && !is_exact && drawn.class != Class::RunUp)
        .then(|| error(&scene, beginning, (step_s, simulation.plan().cuts_at_contact)))
        .flatten();
    Outcome::Ran { growth, error }
}

/// Samples of every channel, all of them finite.
fn motion(simulation: &mut Simulation) -> Result<Vec<Vec<f64>>, String> {
    let n = simulation.scene().duration_s * simulation.rate_hz();
    let n_samples = crate::bench::records::steps(n, 1.0) as u64;
    let mut lists = vec![Vec::new(); simulation.scene().sensors.len()];
    let done = simulation.advance(n_samples, &mut |channel, samples| {
        if let Samples::Float64(samples) = samples {
            lists[channel].extend_from_slice(samples);
        }
        Ok::<(), Infallible>(())
    });
    match done {
        Ok(()) if lists.iter().flatten().all(|x| x.is_finite()) => Ok(lists),
        Ok(()) => Err("a sample is no number".to_owned()),
        Err(AdvanceError::Diverged { time_s }) => Err(format!("diverged before {time_s} s")),
        Err(AdvanceError::Sink(never)) => match never {},
    }
}

/// Periods of the slowest shape in the record that is searched for growth, and the longest such record, s.
const GROWTH_PERIODS: f64 = 40.0;
const GROWTH_MAX_S: f64 = 10.0;

/// Motion from rest less the steady motion is free motion: its RMS in the last quarter over that in the first, both
/// directions at one place. `None` where one of the two does not exist, nothing is free, or the slowest shape is so slow
/// that a quarter holds less than some periods.
fn growth(scene: &Scene) -> Option<f64> {
    let omega = Setting::new(scene).ok()?.model.oscillators().omega_rad_per_s;
    let slowest_hz = omega.into_iter().reduce(f64::min)? / TAU;
    let mut scene = scene.clone();
    scene.duration_s = scene.duration_s.max(GROWTH_PERIODS / slowest_hz);
    if scene.duration_s > GROWTH_MAX_S {
        return None;
    }
    let mut from = |start| {
        scene.start = start;
        motion(&mut Simulation::new(&scene, 1).ok()?).ok()
    };
    let (motion, other) = (from(Start::Rest)?, from(Start::Rotating)?);
    // The two probes at one place together: what one direction loses another may gain.
    let probes = drawn::PROBES;
    let quarter = motion[probes[0]].len() / 4;
    let square = |i: usize| {
        let gap = |channel: &usize| motion[*channel][i] - other[*channel][i];
        probes.iter().map(|channel| gap(channel) * gap(channel)).sum::<f64>()
    };
    let rms =
        |range: std::ops::Range<usize>| (range.map(square).sum::<f64>() / quarter as f64).sqrt();
    let (first, last) = (rms(0..quarter), rms(3 * quarter..4 * quarter));
    let all = probes.iter().flat_map(|channel| motion[*channel].iter().chain(&other[*channel]));
    let largest = all.fold(0.0_f64, |m, x| m.max(x.abs()));
    // Rounding of the two motions.
    (first > 1e-9 * largest).then(|| last / first)
}

/// Evaluations of the forces that a reference may need: some seconds. Contacts that strike a thousand times in the record would take it an hour.
const MAX_FORCES: u64 = 10_000_000;

/// Largest error of what is promised (R34) at the motion's own beginning: displacements of ball bearings and probes, each over
/// its largest in [`SIZE_S`]. Accelerometers are left out: points of what jumps fold what lies beyond their filters into
/// their band. `None` where nothing moves, or the steps are too short.
fn error(scene: &Scene, beginning: Option<State>, (step_s, cuts): (f64, bool)) -> Option<Compared> {
    let mut setting = Setting { state: beginning, ..Setting::new(scene).ok()? };
    if COMPARED_S / step_s > MAX_COMPARED_STEPS {
        return None;
    }
    let balls = setting.model.seats.iter().flat_map(|seat| {
        [0.0, 0.25 * TAU].map(|axis_rad| Watch {
            row: seat.row.clone(),
            axis_rad,
            quantity: Quantity::Displacement,
        })
    });
    let sensors = std::mem::take(&mut setting.sensors);
    let probes = sensors.into_iter().filter(|watch| watch.quantity == Quantity::Displacement);
    setting.bearings = balls.chain(probes).collect();
    let found = ported(&setting, step_s, SIZE_S, cuts)?;
    let Some(exact) = Exact::within(&setting, step_s, COMPARED_S, (1e-11, MAX_FORCES)) else {
        return Some(Compared::TooDear);
    };
    let exact = exact.at(step_s);
    let of_channel = |(exact, found): (&Vec<f64>, &Vec<f64>)| {
        let size = largest(found.iter().copied());
        (size > 0.0).then(|| largest(exact.iter().zip(found).map(|(a, b)| a - b)) / size)
    };
    let errors = exact.bearings.iter().zip(&found.bearings).filter_map(of_channel);
    let errors: Vec<f64> = errors.collect();
    (!errors.is_empty()).then(|| Compared::Error(largest(errors) / scene.accuracy))
}
