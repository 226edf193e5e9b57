//! The verdicts over time, as runs of equal state.

use super::super::terminal::Page;
use super::super::terminal::clean;
use super::INDENT;
use super::state_word;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::Diagnosis;
use crate::diagnosis::verdict::Timeline;
use crate::html::numbers;

/// Most runs written out; of more, the last ones.
const MAX_RUNS: usize = 20;

/// Windows in a row with one state and one worst component.
#[derive(Debug, Clone, PartialEq)]
struct Run<'a> {
    start_s: f64,
    n_windows: usize,
    state: State,
    component: Option<&'a str>,
}

/// Appends when the state changed, for captures of several windows.
pub(super) fn append(out: &mut String, diagnosis: &Diagnosis, page: &Page) {
    let Some(timeline) = &diagnosis.timeline else { return };
    let since = |name: &str, first: Option<f64>| match first {
        Some(time_s) => format!("{name} that lasts from {} s", numbers::seconds(time_s)),
        None => format!("no {name} that lasts"),
    };
    let head = format!(
        "timeline of {} windows: {}, {}",
        timeline.time_s.len(),
        since("warning", diagnosis.first_warning_s),
        since("damage", diagnosis.first_damaged_s)
    );
    out.push('\n');
    page.hanging(out, 0, INDENT, &head);
    let runs = runs(timeline);
    let omitted = runs.len().saturating_sub(MAX_RUNS);
    if omitted > 0 {
        out.push_str(&format!("  … {omitted} earlier changes\n"));
    }
    for run in &runs[omitted..] {
        out.push_str(&line(run, page));
    }
}

fn line(run: &Run<'_>, page: &Page) -> String {
    let windows = if run.n_windows == 1 { "window" } else { "windows" };
    let component = run.component.map_or(String::new(), |id| format!(", {}", clean(id)));
    format!(
        "  from {:>8} s: {} in {} {windows}{component}\n",
        numbers::seconds(run.start_s),
        page.paint(run.state, &state_word(run.state)),
        run.n_windows
    )
}

fn runs(timeline: &Timeline) -> Vec<Run<'_>> {
    let mut runs: Vec<Run<'_>> = Vec::new();
    let columns = timeline.time_s.iter().zip(&timeline.state).zip(&timeline.component);
    for ((start_s, state), component) in columns {
        let (state, component) = (*state, component.as_deref());
        match runs.last_mut() {
            Some(run) if run.state == state && run.component == component => run.n_windows += 1,
            Some(_) | None => {
                runs.push(Run { start_s: *start_s, n_windows: 1, state, component });
            }
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    fn timeline(states: &[State]) -> Timeline {
        Timeline {
            time_s: (0..states.len()).map(|i| 10.0 * i as f64).collect(),
            state: states.to_vec(),
            component: states.iter().map(|s| s.is_accusation().then(|| "b".to_owned())).collect(),
            severity: vec![None; states.len()],
        }
    }

    #[test]
    fn equal_windows_are_one_run() {
        use State::{Damaged, Healthy, Warning};
        let columns = timeline(&[Healthy, Healthy, Warning, Damaged, Damaged, Damaged]);
        let found: Vec<(f64, usize, State, Option<&str>)> =
            runs(&columns).iter().map(|r| (r.start_s, r.n_windows, r.state, r.component)).collect();
        assert_eq!(
            found,
            [(0.0, 2, Healthy, None), (20.0, 1, Warning, Some("b")), (30.0, 3, Damaged, Some("b"))]
        );
    }

    #[test]
    fn long_histories_are_cut_and_counted() {
        let states: Vec<State> =
            (0..50).map(|i| if i % 2 == 0 { State::Healthy } else { State::Warning }).collect();
        let mut diagnosis = super::super::tests::diagnosis();
        diagnosis.timeline = Some(timeline(&states));
        (diagnosis.first_warning_s, diagnosis.first_damaged_s) = (Some(10.0), None);
        let mut out = String::new();
        append(&mut out, &diagnosis, &Page::PLAIN);
        assert!(
            out.contains(
                "timeline of 50 windows: warning that lasts from 10 s, no damage that lasts"
            ),
            "{out}"
        );
        assert!(out.contains("… 30 earlier changes"), "{out}");
        assert_eq!(out.lines().filter(|line| line.contains("1 window")).count(), 20);
    }
}
