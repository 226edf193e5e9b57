//! Trials made on the fly instead of captures: made, diagnosed and scored by all processors at once. What was judged wrongly is
//! kept.

use super::EvaluateError;
use crate::cli::progress::Progress;
use crate::diagnosis::verdict::Diagnosis;
use crate::evaluation::score;
use crate::evaluation::score::Outcome;
use crate::evaluation::summary::Record;
use crate::evaluation::truth::Known;
use crate::trials::Measured;
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

/// A trial, diagnosed and scored.
struct Tried {
    record: Record,
    wrong: Option<Box<Wrong>>,
}

/// What a wrong cause or a false alarm was said of.
#[derive(Debug)]
pub(super) struct Wrong {
    pub(super) measured: Measured,
    pub(super) diagnosis: Diagnosis,
}

/// Takes what was judged wrongly; gives the name of its page, if it has one.
pub(super) type Keep<'k> =
    &'k mut dyn FnMut(&Record, &Wrong) -> Result<Option<String>, EvaluateError>;

/// Scores every trial of a plan, in the plan's order; with the names of their pages.
///
/// # Errors
/// When something cannot be kept.
pub(super) fn records(
    plan: &Plan,
    shows_progress: bool,
    keep: Keep<'_>,
) -> Result<Vec<(Record, Option<String>)>, EvaluateError> {
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
            for (at, tried) in finished {
                let mut with_page = |tried: Tried| {
                    let page = tried.wrong.map(|wrong| keep(&tried.record, &wrong)).transpose()?;
                    Ok((tried.record, page.flatten()))
                };
                let records: Result<Vec<_>, EvaluateError> =
                    tried.into_iter().map(&mut with_page).collect();
                scored.push((at, records?));
                tell(scored.len() as f64 / tasks.len() as f64);
            }
            Ok::<(), EvaluateError>(())
        })
    })?;
    scored.sort_by_key(|(at, _)| *at);
    Ok(scored.into_iter().flat_map(|(_, records)| records).collect())
}

/// The next part nobody has taken.
fn take<'t>(next: &AtomicUsize, tasks: &'t [Task]) -> Option<(usize, &'t Task)> {
    let at = next.fetch_add(1, Ordering::Relaxed);
    tasks.get(at).map(|task| (at, task))
}

fn of_task(task: &Task) -> Vec<Tried> {
    let mut tried = Vec::new();
    task.each(&mut |trial| tried.push(trial.map_or_else(failed, of_trial)));
    tried
}

/// A trial that could not be made.
fn failed(why: String) -> Tried {
    let record = Record {
        file: why.clone(),
        dataset: "not made".to_owned(),
        label: String::new(),
        known: Known::Faults(Vec::new()),
        is_visible: None,
        over_sound: None,
        score: Err(why),
        processor_s: None,
    };
    Tried { record, wrong: None }
}

fn of_trial(trial: Trial) -> Tried {
    let start = ThreadTime::now();
    let diagnosis = trial.diagnose().map_err(|error| error.to_string());
    let processor_s = start.elapsed().as_secs_f64();
    let diagnosis = diagnosis
        .and_then(|diagnosis| diagnosis.ok_or_else(|| "there is nothing to judge".to_owned()));
    let score = diagnosis.as_ref().map_err(Clone::clone).and_then(|diagnosis| {
        score::score(&trial.known, &[], diagnosis).map_err(|error| error.to_string())
    });
    let is_wrong = |outcome| matches!(outcome, Outcome::WrongCause | Outcome::FalseAlarm);
    let wrong = diagnosis.ok().filter(|_| score.as_ref().is_ok_and(|s| is_wrong(s.outcome)));
    let record = Record {
        file: trial.name,
        dataset: trial.group,
        label: trial.label,
        known: trial.known,
        is_visible: trial.is_visible,
        over_sound: trial.over_sound,
        score,
        processor_s: Some(processor_s),
    };
    let keep = |diagnosis| Box::new(Wrong { measured: trial.measured, diagnosis });
    Tried { record, wrong: wrong.map(keep) }
}
