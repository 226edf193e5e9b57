//! How far a long command is, on stderr: a bar for people at a terminal, lines of the log for the longest elsewhere.

use super::terminal::clean;
use indicatif::ProgressBar;
use indicatif::ProgressDrawTarget;
use indicatif::ProgressStyle;
use std::io;
use std::io::IsTerminal;
use std::path::Path;
use std::time::Duration;
use std::time::Instant;

/// Steps of a bar.
const STEPS: f64 = 1000.0;

/// How often the log says how far a work is.
const EVERY: Duration = Duration::from_secs(60);

/// How a command shows how far it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Progress {
    /// Not at all.
    Hidden,
    /// A bar, which leaves nothing behind.
    Bar,
    /// A line of the log a minute.
    Log,
}

impl Progress {
    /// A bar if `wanted` and stderr is a terminal, else nothing.
    #[must_use]
    pub fn new(wanted: bool) -> Self {
        if wanted && io::stderr().is_terminal() { Self::Bar } else { Self::Hidden }
    }

    /// The same of a work that may last hours: where stderr is no terminal the log tells how far it is.
    #[must_use]
    pub fn of_hours(wanted: bool) -> Self {
        if io::stderr().is_terminal() { Self::new(wanted) } else { Self::Log }
    }

    /// Runs a work on a file and shows the part done that it tells, 0…1.
    pub fn of<T>(self, file: &Path, work: impl FnOnce(&mut dyn FnMut(f64)) -> T) -> T {
        match self {
            Self::Hidden => work(&mut |_| ()),
            Self::Bar => Self::with_bar(file, work),
            Self::Log => {
                #[expect(clippy::disallowed_methods, reason = "lines of the log come by the clock")]
                let begin = Instant::now();
                let mut lines = Lines::default();
                work(&mut |part| {
                    if lines.is_due(begin.elapsed()) {
                        tracing::info!(work = %file.display(), percent = (100.0 * part).floor(), "under way");
                    }
                })
            }
        }
    }

    fn with_bar<T>(file: &Path, work: impl FnOnce(&mut dyn FnMut(f64)) -> T) -> T {
        let style = ProgressStyle::with_template("{wide_msg} [{bar:30}] {percent:>3} %");
        let style = style.unwrap_or_else(|_| ProgressStyle::default_bar()).progress_chars("=> ");
        let target = ProgressDrawTarget::stderr();
        let bar = ProgressBar::with_draw_target(Some(1000), target).with_style(style);
        bar.set_message(clean(&file.display().to_string()));
        let done = work(&mut |part| bar.set_position(step(part)));
        bar.finish_and_clear();
        done
    }
}

/// When the log is told.
#[derive(Default)]
struct Lines {
    /// Time of the last line since the work began.
    last: Duration,
}

impl Lines {
    fn is_due(&mut self, elapsed: Duration) -> bool {
        let is_due = elapsed.saturating_sub(self.last) >= EVERY;
        if is_due {
            self.last = elapsed;
        }
        is_due
    }
}

fn step(part: f64) -> u64 {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "clamped to 0…1000; NaN gives 0"
    )]
    let step = (part * STEPS).clamp(0.0, STEPS) as u64;
    step
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_stay_on_the_bar() {
        assert_eq!([step(-1.0), step(0.5), step(7.0), step(f64::NAN)], [0, 500, 1000, 0]);
    }

    #[test]
    fn the_work_is_done_without_a_terminal_too() {
        for progress in [Progress::Hidden, Progress::Log] {
            let told = progress.of(Path::new("x.h5"), |tell| {
                tell(0.5);
                7
            });
            assert_eq!(told, 7);
        }
    }

    #[test]
    fn the_log_is_told_once_a_minute() {
        let mut lines = Lines::default();
        let is_due = [59, 60, 61, 119, 121, 180, 181].map(|s| lines.is_due(Duration::from_secs(s)));
        assert_eq!(is_due, [false, true, false, false, true, false, true]);
    }
}
