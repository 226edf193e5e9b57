//! Cuts a stream into stretches that every channel begins at the same time.
//!
//! Runs of different channels arrive one after another, so at a new segment, or where a file shall
//! end, some channels are further than others. Runs beyond such a boundary are held until every
//! channel has come to it. Pure bookkeeping: must not know files.

use super::super::received::{RawSamples, Received};
use crate::signal::SampleIndex;
use std::collections::VecDeque;

/// Longest wait for a channel at a boundary, s of stream time; then it begins without it.
const HOLD_S: f64 = 5.0;

/// Bytes held at a boundary at most.
const HOLD_BYTES: usize = 64 << 20;

/// How far a sample may lie from a whole second and still count as on it, samples.
const WHOLE_SAMPLE: f64 = 1e-6;

/// Seconds looked at for one at which every channel has a sample.
const CUT_SEARCH_S: u32 = 60;

/// What becomes of what was received.
#[derive(Debug, Clone, PartialEq)]
pub enum Act {
    /// A stretch begins: what follows belongs to it.
    Begin {
        /// Whether it may go on in the file of the stretch before: nothing was lost between.
        joins: bool,
        /// First sample of each channel; `None` for one that does not take part.
        starts: Vec<Option<u64>>,
        /// Stream time of those samples, s.
        time_s: f64,
    },
    /// The next samples of a channel in the stretch.
    Write(Received),
    /// Samples that have no place in any stretch.
    Skip {
        /// How many.
        n_samples: u64,
    },
}

/// Where the stretch ends.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Boundary {
    /// Where this segment of the source begins.
    Segment(u32),
    /// So many seconds after the origin.
    Cut(f64),
}

/// The bookkeeping of one stream.
#[derive(Debug)]
pub struct Aligner {
    rates_hz: Vec<f64>,
    /// Segment of the source; `None` before the first sample.
    segment: Option<u32>,
    /// Index of each channel's next sample.
    next: Vec<u64>,
    /// Whether each channel takes part in the stretch.
    taking: Vec<bool>,
    /// First sample of each channel in the stretch, all at `origin_s`.
    origin: Vec<u64>,
    origin_s: f64,
    boundary: Option<Boundary>,
    /// Whether the next stretch must not join.
    roll: bool,
    held: VecDeque<Received>,
    held_bytes: usize,
}

impl Aligner {
    /// Makes it for channels of these rates, Hz.
    #[must_use]
    pub fn new(rates_hz: Vec<f64>) -> Self {
        let n = rates_hz.len();
        Self {
            rates_hz,
            segment: None,
            next: vec![0; n],
            taking: vec![true; n],
            origin: vec![0; n],
            origin_s: 0.0,
            boundary: None,
            roll: false,
            held: VecDeque::new(),
            held_bytes: 0,
        }
    }

    /// Takes the next run, inside one segment of the source.
    pub fn take(&mut self, run: Received) -> Vec<Act> {
        let mut acts = Vec::new();
        if run.channel.0 < self.rates_hz.len() && !run.raw.is_empty() {
            self.settle(run, &mut acts);
            if self.is_complete() || self.waits_too_long() {
                self.begin(&mut acts);
            }
        }
        acts
    }

    /// Asks for a new stretch that does not join, as soon as all channels can begin one together.
    pub fn roll(&mut self) {
        if self.boundary.is_none() && self.segment.is_some() {
            self.boundary = Some(Boundary::Cut(self.common_second(0.0)));
        }
        self.roll = true;
    }

    /// Gives what is held; nothing more will come.
    pub fn finish(&mut self) -> Vec<Act> {
        let mut acts = Vec::new();
        while !self.held.is_empty() {
            self.begin(&mut acts);
        }
        acts
    }

    /// Places a run, beginning stretches as often as it needs.
    fn settle(&mut self, run: Received, acts: &mut Vec<Act>) {
        let mut left = Some(run);
        while let Some(run) = left {
            left = self.place(run, acts);
        }
    }

    /// Places a run or a part of it; gives back what has to be looked at again.
    fn place(&mut self, run: Received, acts: &mut Vec<Act>) -> Option<Received> {
        let channel = run.channel.0;
        let follows = Some(run.segment) == self.segment
            && self.taking[channel]
            && run.start.0 == self.next[channel];
        match self.boundary {
            None if follows => {
                self.write(run, acts);
                None
            }
            None if Some(run.segment) != self.segment => {
                self.boundary = Some(Boundary::Segment(run.segment));
                Some(run)
            }
            None => {
                // Samples were lost, or the channel was not there when the stretch began.
                self.boundary = Some(Boundary::Cut(self.common_second(self.end_s(&run))));
                self.roll = true;
                Some(run)
            }
            Some(Boundary::Segment(segment)) if run.segment == segment && self.continues(&run) => {
                self.hold(run);
                None
            }
            Some(Boundary::Segment(segment)) if run.segment != segment && follows => {
                self.write(run, acts);
                None
            }
            Some(Boundary::Cut(_)) if Some(run.segment) != self.segment && self.held.is_empty() => {
                self.boundary = Some(Boundary::Segment(run.segment));
                Some(run)
            }
            Some(Boundary::Cut(cut_s)) if Some(run.segment) == self.segment => {
                self.place_at_cut(run, cut_s, follows, acts)
            }
            Some(_) => {
                self.begin(acts);
                Some(run)
            }
        }
    }

    /// Writes what lies before the cut and holds what lies behind it.
    fn place_at_cut(
        &mut self,
        run: Received,
        cut_s: f64,
        follows: bool,
        acts: &mut Vec<Act>,
    ) -> Option<Received> {
        let rate_hz = self.rates_hz[run.channel.0];
        let (before, after) = split(run, |run| self.cut_index(run, cut_s), rate_hz);
        if let Some(before) = before {
            if follows {
                self.write(before, acts);
            } else {
                acts.push(Act::Skip { n_samples: before.raw.len() as u64 });
            }
        }
        let after = after?;
        if self.continues(&after) {
            self.hold(after);
            return None;
        }
        self.begin(acts);
        Some(after)
    }

    /// Begins the next stretch with what is held.
    fn begin(&mut self, acts: &mut Vec<Act>) {
        let boundary = self.boundary.take();
        let held = std::mem::take(&mut self.held);
        self.held_bytes = 0;
        let n = self.rates_hz.len();
        let mut first: Vec<Option<(u64, f64)>> = vec![None; n];
        for run in &held {
            first[run.channel.0].get_or_insert((run.start.0, run.time_s));
        }
        let fastest = (0..n)
            .filter(|&c| first[c].is_some())
            .max_by(|&a, &b| self.rates_hz[a].total_cmp(&self.rates_hz[b]).then(b.cmp(&a)));
        let (Some(time_s), Some(segment)) = (
            fastest.and_then(|c| first[c]).map(|(_, time_s)| time_s),
            held.front().map(|r| r.segment),
        ) else {
            return;
        };
        let aligned = |c: usize, at_s: f64| (at_s - time_s).abs() * self.rates_hz[c] <= 1.0;
        let starts: Vec<Option<u64>> = (0..n)
            .map(|c| first[c].filter(|&(_, at_s)| aligned(c, at_s)).map(|(start, _)| start))
            .collect();
        let is_segment = matches!(boundary, Some(Boundary::Segment(_)));
        let joins = is_segment
            && !self.roll
            && self.segment.is_some()
            && (0..n)
                .all(|c| starts[c].is_none_or(|start| start == self.next[c] && self.taking[c]));
        (self.segment, self.origin_s, self.roll) = (Some(segment), time_s, false);
        for (c, start) in starts.iter().enumerate() {
            self.taking[c] = start.is_some();
            self.next[c] = start.unwrap_or(self.next[c]);
            self.origin[c] = self.next[c];
        }
        acts.push(Act::Begin { joins, starts, time_s });
        for run in held {
            self.settle(run, acts);
        }
    }

    fn write(&mut self, run: Received, acts: &mut Vec<Act>) {
        self.next[run.channel.0] += run.raw.len() as u64;
        acts.push(Act::Write(run));
    }

    fn hold(&mut self, run: Received) {
        self.held_bytes += run.raw.len() * run.raw.number_type().bytes();
        self.held.push_back(run);
    }

    /// Whether a run goes on where the held ones of its channel end.
    fn continues(&self, run: &Received) -> bool {
        let last = self.held.iter().rev().find(|held| held.channel == run.channel);
        last.is_none_or(|last| {
            last.segment == run.segment && last.start.0 + last.raw.len() as u64 == run.start.0
        })
    }

    /// Whether every channel of the last stretch has come to the boundary.
    fn is_complete(&self) -> bool {
        self.boundary.is_some()
            && !self.held.is_empty()
            && (0..self.rates_hz.len())
                .all(|c| !self.taking[c] || self.held.iter().any(|run| run.channel.0 == c))
    }

    fn waits_too_long(&self) -> bool {
        let first = self.held.front().map_or(f64::INFINITY, |run| run.time_s);
        let last = self.held.back().map_or(f64::NEG_INFINITY, |run| run.time_s);
        last - first > HOLD_S || self.held_bytes > HOLD_BYTES
    }

    /// End of a run, s after the origin.
    fn end_s(&self, run: &Received) -> f64 {
        run.time_s + run.raw.len() as f64 / self.rates_hz[run.channel.0] - self.origin_s
    }

    /// The first whole second after the origin that no channel has passed, nor `at_least_s`, and at
    /// which every channel has a sample; simply the first if there is none such.
    fn common_second(&self, at_least_s: f64) -> f64 {
        let reached = (0..self.rates_hz.len())
            .filter(|&c| self.taking[c])
            .map(|c| (self.next[c] - self.origin[c]) as f64 / self.rates_hz[c])
            .fold(at_least_s, f64::max);
        let first = (reached - WHOLE_SAMPLE).ceil().max(0.0);
        let whole = |second: f64| {
            self.rates_hz.iter().all(|rate_hz| {
                let samples = rate_hz * second;
                (samples - samples.round()).abs() <= WHOLE_SAMPLE
            })
        };
        let seconds = (0..CUT_SEARCH_S).map(|more| first + f64::from(more));
        seconds.into_iter().find(|&second| whole(second)).unwrap_or(first)
    }

    /// First sample of the run's channel that is not before the cut.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "non-negative; float to int casts saturate"
    )]
    fn cut_index(&self, run: &Received, cut_s: f64) -> u64 {
        let channel = run.channel.0;
        let after =
            |seconds: f64| (seconds * self.rates_hz[channel] - WHOLE_SAMPLE).ceil().max(0.0) as u64;
        if self.taking[channel] {
            self.origin[channel].saturating_add(after(cut_s))
        } else {
            run.start.0.saturating_add(after(cut_s - (run.time_s - self.origin_s)))
        }
    }
}

/// Splits a run before the sample whose index `at` gives.
fn split(
    run: Received,
    at: impl FnOnce(&Received) -> u64,
    rate_hz: f64,
) -> (Option<Received>, Option<Received>) {
    let n_before = at(&run).saturating_sub(run.start.0);
    let n_before = usize::try_from(n_before).unwrap_or(usize::MAX).min(run.raw.len());
    if n_before == 0 {
        return (None, Some(run));
    }
    if n_before == run.raw.len() {
        return (Some(run), None);
    }
    let (head, tail) = split_raw(run.raw, n_before);
    let after = Received {
        channel: run.channel,
        start: SampleIndex(run.start.0 + n_before as u64),
        segment: run.segment,
        time_s: run.time_s + n_before as f64 / rate_hz,
        raw: tail,
    };
    (Some(Received { raw: head, ..run }), Some(after))
}

fn split_raw(raw: RawSamples, at: usize) -> (RawSamples, RawSamples) {
    match raw {
        RawSamples::F32(mut head) => {
            let tail = head.split_off(at);
            (RawSamples::F32(head), RawSamples::F32(tail))
        }
        RawSamples::F64(mut head) => {
            let tail = head.split_off(at);
            (RawSamples::F64(head), RawSamples::F64(tail))
        }
        RawSamples::I16(mut head) => {
            let tail = head.split_off(at);
            (RawSamples::I16(head), RawSamples::I16(tail))
        }
        RawSamples::I32(mut head) => {
            let tail = head.split_off(at);
            (RawSamples::I32(head), RawSamples::I32(tail))
        }
    }
}
