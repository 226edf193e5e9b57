//! Trials made on the fly instead of captures: made, diagnosed and scored by all processors at once. What was judged wrongly is
//! kept. Whoever stops it early gets what was tried so far, of all parts alike.

use super::EvaluateError;
use super::stop::Stop;
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
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering;
use std::sync::mpsc;
use std::sync::mpsc::RecvTimeoutError;
use std::thread;
use std::time::Duration;

/// Parts that wait to be taken up at most.
const WAITING: usize = 16;

/// How often it is looked how far the trials are: parts of the rig take minutes each.
const LOOK: Duration = Duration::from_secs(1);

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

/// What came of a plan.
#[derive(Debug)]
pub(super) struct Scored {
    /// Name of the grid in tables; says so where it was stopped.
    pub(super) name: String,
    /// The trials, in the plan's order, with the names of their pages.
    pub(super) records: Vec<(Record, Option<String>)>,
}

/// Scores the trials of a plan until all are or `stop` is asked.
///
/// # Errors
/// When something cannot be kept.
pub(super) fn score(
    plan: &Plan,
    progress: Progress,
    stop: &Stop,
    keep: Keep<'_>,
) -> Result<Scored, EvaluateError> {
    let tasks = grid::tasks(plan);
    let next = AtomicUsize::new(0);
    let workers = thread::available_parallelism().map_or(1, NonZero::get);
    let mut scored = Vec::with_capacity(tasks.len());
    let (mut n_whole, n_tried) = (0, AtomicUsize::new(0));
    let n_trials: usize = tasks.iter().map(Task::n_trials).sum();
    progress.of(Path::new("grid"), |tell| {
        thread::scope(|scope| {
            let (done, finished) = mpsc::sync_channel(WAITING);
            for _ in 0..workers {
                let (done, next, tasks, n_tried) = (done.clone(), &next, &tasks, &n_tried);
                scope.spawn(move || {
                    while let Some((at, task)) = take(next, tasks).filter(|_| !stop.is_asked()) {
                        if done.send((at, of_task(task, stop, n_tried))).is_err() {
                            return;
                        }
                    }
                });
            }
            drop(done);
            loop {
                match finished.recv_timeout(LOOK) {
                    Ok((at, (tried, is_whole))) => {
                        let with_page = |tried| with_page(tried, &mut *keep);
                        let records: Result<Vec<_>, EvaluateError> =
                            tried.into_iter().map(with_page).collect();
                        scored.push((at, records?));
                        n_whole += usize::from(is_whole);
                    }
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => break,
                }
                tell(n_tried.load(Ordering::Relaxed) as f64 / n_trials.max(1) as f64);
            }
            Ok::<(), EvaluateError>(())
        })
    })?;
    scored.sort_by_key(|(at, _)| *at);
    let records = scored.into_iter().flat_map(|(_, records)| records).collect();
    Ok(Scored { name: name(plan, (n_whole, tasks.len())), records })
}

/// A record with the name of its page, if what was said of it is kept.
fn with_page(tried: Tried, keep: Keep<'_>) -> Result<(Record, Option<String>), EvaluateError> {
    let page = tried.wrong.map(|wrong| keep(&tried.record, &wrong)).transpose()?;
    Ok((tried.record, page.flatten()))
}

fn name(plan: &Plan, (n_whole, n_tasks): (usize, usize)) -> String {
    let last = plan.first_seed + plan.n_seeds.max(1) - 1;
    let seeds = format!("grid, seeds {} to {last}", plan.first_seed);
    if n_whole == n_tasks {
        seeds
    } else {
        format!("{seeds}, stopped after {n_whole} of {n_tasks} parts")
    }
}

/// The next part nobody has taken, of all parts of the grid in turn.
fn take<'t>(next: &AtomicUsize, tasks: &'t [Task]) -> Option<(usize, &'t Task)> {
    let at = place(next.fetch_add(1, Ordering::Relaxed), tasks.len())?;
    tasks.get(at).map(|task| (at, task))
}

/// Which of `n` places is taken as number `k`: each once, those of a few in a row far apart.
fn place(k: usize, n: usize) -> Option<usize> {
    // Multiples of the golden section lie evenly, however many there are.
    let golden = (n.saturating_mul(618) / 1000).max(1);
    let step = (golden..=n.max(1)).find(|step| gcd(*step, n) == 1)?;
    (k < n).then(|| k * step % n)
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// Tries a part, counting its trials as they are made; and whether nothing of it is left.
fn of_task(task: &Task, stop: &Stop, n_tried: &AtomicUsize) -> (Vec<Tried>, bool) {
    let mut tried = Vec::new();
    let ended = task.each(&mut |trial| {
        if stop.is_asked() {
            return ControlFlow::Break(());
        }
        tried.push(trial.map_or_else(failed, of_trial));
        n_tried.fetch_add(1, Ordering::Relaxed);
        ControlFlow::Continue(())
    });
    (tried, ended.is_continue())
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trials::grid::Part;
    use std::collections::BTreeSet;

    const PLAN: Plan = Plan {
        first_seed: 3,
        n_seeds: 2,
        is_thin: true,
        is_healthy: true,
        part: Some(Part::Stand),
    };

    #[test]
    fn every_place_is_taken_once_and_soon_one_of_each_part() {
        for n in 1..200 {
            let places: BTreeSet<_> = (0..n).filter_map(|k| place(k, n)).collect();
            assert_eq!(places.len(), n, "{n}");
        }
        assert_eq!((place(0, 0), place(7, 7)), (None, None));
        let fifths: BTreeSet<_> =
            (0..8).filter_map(|k| place(k, 1000)).map(|at| at / 200).collect();
        assert_eq!(fifths.len(), 5);
    }

    #[test]
    fn the_whole_grid_of_a_seed_has_the_trials_that_are_counted_for_its_progress() {
        let plan = Plan { n_seeds: 1, is_thin: false, is_healthy: false, part: None, ..PLAN };
        let tasks = grid::tasks(&plan);
        // docs/accuracy.md has a whole one of 6041 records, in 299 parts.
        assert_eq!(tasks.iter().map(Task::n_trials).sum::<usize>(), 6041);
        assert_eq!(tasks.len(), 299);
    }

    #[test]
    fn who_stops_it_gets_what_was_tried_and_how_much_that_is() {
        let stop = Stop::default();
        let mut n_kept = 0;
        let mut keep = |_: &Record, _: &Wrong| {
            n_kept += 1;
            Ok(None)
        };
        stop.ask();
        let scored = score(&PLAN, Progress::Hidden, &stop, &mut keep).unwrap();
        assert!(scored.records.is_empty());
        assert_eq!(scored.name, "grid, seeds 3 to 4, stopped after 0 of 80 parts");
        let task = &grid::tasks(&PLAN)[0];
        let n_tried = AtomicUsize::new(0);
        let (tried, is_whole) = of_task(task, &Stop::default(), &n_tried);
        assert_eq!((tried.len(), is_whole), (task.n_trials(), true));
        assert_eq!(n_tried.into_inner(), 1);
        assert_eq!(name(&PLAN, (80, 80)), "grid, seeds 3 to 4");
    }
}
