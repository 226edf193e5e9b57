//! Trials made on the fly instead of captures: made, diagnosed and scored by all processors at once.

use crate::cli::progress::Progress;
use crate::evaluation::score;
use crate::evaluation::summary::Record;
use crate::evaluation::truth::Known;
use crate::trials::Trial;
use crate::trials::grid;
use crate::trials::grid::Plan;
use crate::trials::grid::Task;
use cpu_time::ThreadTime;
use std::num::NonZero;
use std::path::Path;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering;
use std::sync::mpsc;
use std::thread;

/// Name of the grid in tables.
pub(super) fn name(plan: &Plan) -> String {
    let last = plan.first_seed + plan.n_seeds.max(1) - 1;
    format!("grid, seeds {} to {last}", plan.first_seed)
}

/// Parts that wait to be taken up at most.
const WAITING: usize = 16;

/// Scores every trial of a plan, in the plan's order.
pub(super) fn records(plan: &Plan, shows_progress: bool) -> Vec<Record> {
    let tasks = grid::tasks(plan);
    let next = AtomicUsize::new(0);
    let workers = thread::available_parallelism().map_or(1, NonZero::get);
    let mut scored = Vec::with_capacity(tasks.len());
    Progress::new(shows_progress).of(Path::new("grid"), |tell| {
        thread::scope(|scope| {
            let (done, finished) = mpsc::sync_channel(WAITING);
            for _ in 0..workers {
                let (done, next, tasks) = (done.clone(), &next, &tasks);
                scope.spawn(move || {
                    while let Some((at, task)) = take(next, tasks) {
                        if done.send((at, of_task(task))).is_err() {
                            return;
                        }
                    }
                });
            }
            drop(done);
            for part in finished {
                scored.push(part);
                tell(scored.len() as f64 / tasks.len() as f64);
            }
        });
    });
    scored.sort_by_key(|(at, _)| *at);
    scored.into_iter().flat_map(|(_, records)| records).collect()
}

/// The next part nobody has taken.
fn take<'t>(next: &AtomicUsize, tasks: &'t [Task]) -> Option<(usize, &'t Task)> {
    let at = next.fetch_add(1, Ordering::Relaxed);
    tasks.get(at).map(|task| (at, task))
}

fn of_task(task: &Task) -> Vec<Record> {
    let mut records = Vec::new();
    task.each(&mut |trial| records.push(trial.map_or_else(failed, |trial| of_trial(&trial))));
    records
}

/// A trial that could not be made.
fn failed(why: String) -> Record {
    Record {
        file: why.clone(),
        dataset: "not made".to_owned(),
        label: String::new(),
        known: Known::Faults(Vec::new()),
        is_visible: None,
        score: Err(why),
        processor_s: None,
    }
}

fn of_trial(trial: &Trial) -> Record {
    let start = ThreadTime::now();
    let diagnosis = trial.diagnose().map_err(|error| error.to_string());
    let processor_s = start.elapsed().as_secs_f64();
    let score = diagnosis
        .and_then(|diagnosis| diagnosis.ok_or_else(|| "there is nothing to judge".to_owned()))
        .and_then(|diagnosis| {
            score::score(&trial.known, &[], &diagnosis).map_err(|error| error.to_string())
        });
    Record {
        file: trial.name.clone(),
        dataset: trial.group.clone(),
        label: trial.label.clone(),
        known: trial.known.clone(),
        is_visible: trial.is_visible,
        score,
        processor_s: Some(processor_s),
    }
}
