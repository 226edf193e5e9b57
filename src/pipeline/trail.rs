//! The windows judged last with all that their verdicts rest on, so that they can be judged again: what an alarm's
//! evidence is made of. Must not know where it is kept.

use super::Monitor;
use super::Outcome;
use crate::alarms::Decisions;
use crate::alarms::Level;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::drift;
use crate::diagnosis::verdict::Diagnosis;
use crate::features::ChannelFeatures;
use crate::features::Window;
use crate::features::run_up::RunUp;
use crate::tape::Reader;
use crate::tape::Tape;
use std::collections::VecDeque;
use std::sync::Arc;

/// What a verdict rests on beside its window, the machine and the settings.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Carried {
    /// The 1× vectors of the run.
    pub run_up: RunUp,
    /// The sums of the watch for slow change.
    pub drift: drift::Watch,
    /// Delays and hysteresis of the alarms.
    pub decisions: Decisions,
    /// What is normal.
    pub baseline: Arc<Baseline>,
}

impl Carried {
    /// Writes all but the baseline.
    pub fn write(&self, tape: &mut Tape) {
        self.run_up.write(tape);
        self.drift.write(tape);
        self.decisions.write(tape);
    }

    /// Reads what [`Self::write`] wrote; `None`: it is something else.
    #[must_use]
    pub fn read(tape: &mut Reader<'_>, baseline: Arc<Baseline>) -> Option<Self> {
        let (run_up, drift) = (RunUp::read(tape)?, drift::Watch::read(tape)?);
        Some(Self { run_up, drift, decisions: Decisions::read(tape)?, baseline })
    }
}

/// The samples of a channel that a window was made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Run {
    /// First sample.
    pub start: u64,
    /// Stream time of the first sample, s.
    pub time_s: f64,
    /// Number of samples.
    pub n_samples: usize,
}

/// A window that was judged.
#[derive(Debug, Clone)]
pub struct Passed {
    /// Start and end, s of stream time.
    pub time_s: (f64, f64),
    /// Segment of the stream.
    pub segment: u32,
    /// Number of the contiguous run it lies in.
    pub run: u64,
    /// Begin of that run, a whole number of hops before the window's end, s; `None`: the run ended with it, where it
    /// ended.
    pub origin_s: Option<f64>,
    /// Its samples by channel.
    pub runs: Vec<Option<Run>>,
    /// What its verdict rests on besides.
    pub before: Carried,
    /// Its features, ratios to the baseline included.
    pub features: Vec<ChannelFeatures>,
    /// Its verdict.
    pub diagnosis: Arc<Diagnosis>,
    /// What stood above its level after it ([`crate::alarms::AlarmEngine::raised`]).
    pub raised: Vec<(String, Level)>,
}

impl Passed {
    pub(super) fn new(
        window: &Window<'_>,
        (segment, run, origin_s): (u32, u64, Option<f64>),
        before: Carried,
        outcome: &Outcome,
        raised: Vec<(String, Level)>,
    ) -> Self {
        let runs = window.channels.iter().map(|channel| {
            channel.map(|run| Run {
                start: run.start,
                time_s: run.time_s,
                n_samples: run.samples.len(),
            })
        });
        Self {
            time_s: window.time_s,
            segment,
            run,
            origin_s,
            runs: runs.collect(),
            before,
            features: outcome.features.clone(),
            diagnosis: Arc::clone(&outcome.diagnosis),
            raised,
        }
    }
}

/// The windows passed last, oldest first; none are kept unless asked for.
#[derive(Debug, Clone, Default)]
pub(super) struct Trail {
    windows: VecDeque<Arc<Passed>>,
    most: usize,
}

impl Trail {
    pub(super) fn is_kept(&self) -> bool {
        self.most > 0
    }

    pub(super) fn clear(&mut self) {
        self.windows.clear();
    }

    pub(super) fn push(&mut self, passed: Passed) {
        while self.windows.len() >= self.most.max(1) {
            self.windows.pop_front();
        }
        self.windows.push_back(Arc::new(passed));
    }
}

impl Monitor {
    /// Keeps the last `most` windows for [`Self::trail`] from now on.
    pub fn keep_trail(&mut self, most: usize) {
        self.trail.most = most;
    }

    /// The windows judged last, oldest first, all of them against the baseline of now.
    #[must_use]
    pub fn trail(&self) -> Vec<Arc<Passed>> {
        self.trail.windows.iter().cloned().collect()
    }

    /// What the next window's verdict will rest on beside it.
    #[must_use]
    pub fn carried(&self) -> Carried {
        Carried {
            run_up: self.run_up.clone(),
            drift: self.drift.clone(),
            decisions: self.alarms.decisions(),
            baseline: Arc::clone(&self.baseline),
        }
    }

    /// Goes on from what another monitor of this machine and stream carried; false: it was none of those.
    pub fn resume(&mut self, carried: &Carried) -> bool {
        self.run_up = carried.run_up.clone();
        self.drift = carried.drift.clone();
        self.baseline = Arc::clone(&carried.baseline);
        self.alarms.resume(&carried.decisions)
    }

    /// Judges a window of `segment` whose samples somebody kept, as if it had just come; `is_same_run`: no
    /// contiguous run ended since the window before.
    pub fn judge_again(&mut self, window: &Window<'_>, segment: u32, is_same_run: bool) -> Outcome {
        if !is_same_run {
            self.run_up.clear();
        }
        self.segment = Some(segment);
        self.judge_window(window)
    }
}
