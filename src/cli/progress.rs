//! How far a long command is, on stderr, for people at a terminal.

use super::terminal::clean;
use indicatif::ProgressBar;
use indicatif::ProgressDrawTarget;
use indicatif::ProgressStyle;
use std::io;
use std::io::IsTerminal;
use std::path::Path;

/// Steps of a bar.
const STEPS: f64 = 1000.0;

/// Shows bars, or nothing.
#[derive(Debug, Clone, Copy)]
pub struct Progress {
    shown: bool,
}

impl Progress {
    /// Shows bars if `wanted` and stderr is a terminal.
    #[must_use]
    pub fn new(wanted: bool) -> Self {
        Self { shown: wanted && io::stderr().is_terminal() }
    }

    /// Runs a work on a file and shows the part done that it tells, 0…1; leaves nothing behind.
    pub fn of<T>(&self, file: &Path, work: impl FnOnce(&mut dyn FnMut(f64)) -> T) -> T {
        if !self.shown {
            return work(&mut |_| ());
        }
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
        let told = Progress { shown: false }.of(Path::new("x.h5"), |tell| {
            tell(0.5);
            7
        });
        assert_eq!(told, 7);
    }
}
