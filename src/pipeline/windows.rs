//! Where windows lie: a grid of hops from the start of each contiguous run of stream time.

/// Length of the fewest equal windows that lie end to end in a record and are no longer than `longest_s`, s.
#[must_use]
pub fn equal_s(duration_s: f64, longest_s: f64) -> f64 {
    duration_s / (duration_s / longest_s).ceil().max(1.0)
}

/// Lays the windows of one stream.
#[derive(Debug, Clone)]
pub(super) struct WindowGrid {
    window_s: f64,
    hop_s: f64,
    run: Option<Run>,
}

#[derive(Debug, Clone, Copy)]
struct Run {
    start_s: f64,
    n_windows: u32,
    judged_to_s: f64,
}

impl WindowGrid {
    /// Windows of at most `window_s` that end every `hop_s`.
    #[must_use]
    pub(super) fn new(window_s: f64, hop_s: f64) -> Self {
        Self { window_s, hop_s, run: None }
    }

    /// Where the run under way began, s: windows end a whole number of hops after it.
    #[must_use]
    pub(super) fn origin_s(&self) -> Option<f64> {
        self.run.map(|run| run.start_s)
    }

    /// Begins a run at `start_s`, unless one is under way.
    pub(super) fn begin(&mut self, start_s: f64) {
        self.run.get_or_insert(Run { start_s, n_windows: 0, judged_to_s: start_s });
    }

    /// The next window whose end lies at or before `reached_s`: start and end, s.
    pub(super) fn next_due(&mut self, reached_s: f64) -> Option<(f64, f64)> {
        let (window_s, hop_s) = (self.window_s, self.hop_s);
        let run = self.run.as_mut()?;
        let end = run.start_s + f64::from(run.n_windows + 1) * hop_s;
        // A millionth of a hop against the rounding of index/rate.
        if end > reached_s + 1e-6 * hop_s {
            return None;
        }
        run.n_windows += 1;
        run.judged_to_s = end;
        Some(((end - window_s).max(run.start_s), end))
    }

    /// Ends the run at `end_s`: the last window, if at least half a hop has not been judged yet, or
    /// nothing of the run has.
    pub(super) fn finish(&mut self, end_s: f64) -> Option<(f64, f64)> {
        let run = self.run.take()?;
        let left = end_s - run.judged_to_s;
        let untouched = run.n_windows == 0 && left > 0.0;
        (untouched || left >= 0.5 * self.hop_s)
            .then(|| ((end_s - self.window_s).max(run.start_s), end_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_grow_to_their_length_and_then_slide() {
        let mut grid = WindowGrid::new(10.0, 5.0);
        grid.begin(2.0);
        assert_eq!(grid.next_due(6.9), None);
        assert_eq!(grid.next_due(30.0), Some((2.0, 7.0)));
        assert_eq!(grid.next_due(30.0), Some((2.0, 12.0)));
        assert_eq!(grid.next_due(30.0), Some((7.0, 17.0)));
    }

    #[test]
    fn what_is_left_is_judged_once() {
        let mut grid = WindowGrid::new(10.0, 5.0);
        grid.begin(0.0);
        assert_eq!(grid.finish(0.1), Some((0.0, 0.1)), "a snapshot is a window");
        assert_eq!(grid.finish(0.1), None);
        grid.begin(0.0);
        assert!(grid.next_due(5.0).is_some());
        assert_eq!(grid.finish(7.4), None, "less than half a hop");
        grid.begin(0.0);
        assert!(grid.next_due(5.0).is_some());
        assert_eq!(grid.finish(7.6), Some((0.0, 7.6)));
    }
}
