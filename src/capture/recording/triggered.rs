//! A capture of the past and what follows: planned from runs held in memory, then written on as more come.
//!
//! Its channels begin at one sample instant. A stretch of the stream that the layout cannot hold beside the one
//! before, such as one of channels that lost samples, ends it; before the trigger, what came before gives way. Must
//! not know why it is made.

use super::super::error::CaptureError;
use super::super::received::{RawSamples, Received, ReceivedChannel};
use super::super::segments::Segments;
use super::align::{Act, Aligner};
use super::file::{Finished, Recorder, RecordingHeader};
use crate::signal::SampleIndex;
use crate::units::Hz;
use std::path::Path;
use std::sync::Arc;

/// How far a sample may lie from an instant and still count as on it, samples.
const ON_SAMPLE: f64 = 1e-3;

/// Samples of the slowest channel looked at for one at which every channel has a sample.
const INSTANT_SEARCH: u32 = 4096;

/// Channels whose oldest sample is later than the oldest of all by this were not there, s.
const APART_S: f64 = 5.0;

/// Part of a stream whose channels begin together.
#[derive(Debug, Clone, PartialEq)]
struct Stretch {
    segment: u32,
    starts: Vec<Option<u64>>,
    time_s: f64,
    runs: Vec<Received>,
}

impl Stretch {
    fn lengths(&self, n_channels: usize) -> Vec<u64> {
        let mut lengths = vec![0; n_channels];
        for run in &self.runs {
            lengths[run.channel.0] += run.raw.len() as u64;
        }
        lengths
    }
}

/// What the capture will hold of the past.
#[derive(Debug)]
pub struct Plan {
    rates: Vec<Hz>,
    stretches: Vec<Stretch>,
    aligner: Aligner,
}

/// A capture being written.
#[derive(Debug)]
pub struct Triggered {
    recorder: Recorder,
    aligner: Aligner,
    /// Samples of each channel in the file.
    lengths: Vec<u64>,
}

/// Whether a capture goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Next {
    /// It does.
    GoesOn,
    /// The layout cannot hold what follows.
    Ends,
}

impl Plan {
    /// Plans a capture of the runs held of a stream, from stream time `from_s` on; `None`: they hold nothing of it.
    #[must_use]
    pub fn new(runs: &[Arc<Received>], channels: &[ReceivedChannel], from_s: f64) -> Option<Self> {
        let rates: Vec<Hz> = channels.iter().map(|channel| channel.sample_rate).collect();
        let at_s = instant(runs, &rates, from_s)?;
        let mut aligner = Aligner::new(rates.iter().map(|rate| rate.0).collect());
        let mut acts = Vec::new();
        for run in runs {
            if let Some(rest) = rest_of(run, rates.get(run.channel.0)?.0, at_s) {
                acts.extend(aligner.take(rest));
            }
        }
        if acts.is_empty() {
            acts = aligner.finish();
        }
        let mut stretches: Vec<Stretch> = Vec::new();
        for act in acts {
            match act {
                Act::Begin { starts, time_s, .. } => {
                    stretches.push(Stretch { segment: 0, starts, time_s, runs: Vec::new() });
                }
                Act::Write(run) => {
                    if let Some(last) = stretches.last_mut() {
                        last.segment = run.segment;
                        last.runs.push(run);
                    }
                }
                Act::Skip { .. } => {}
            }
        }
        let first =
            (0..stretches.len()).find(|first| fit_in_a_file(&stretches[*first..], &rates))?;
        stretches.drain(..first);
        Some(Self { rates, stretches, aligner })
    }

    /// Where in the file a run of samples of the stream will stand; `None`: not all of it will.
    #[must_use]
    pub fn place(&self, channel: usize, segment: u32, start: u64, n_samples: u64) -> Option<u64> {
        let mut before = 0;
        for stretch in &self.stretches {
            let length = stretch.lengths(self.rates.len()).get(channel).copied()?;
            let begins = stretch.starts.get(channel).copied().flatten();
            if let Some(begin) = begins.filter(|_| stretch.segment == segment)
                && start >= begin
                && start + n_samples <= begin + length
            {
                return Some(before + (start - begin));
            }
            before += length;
        }
        None
    }

    /// Stream time of its first sample, s.
    #[must_use]
    pub fn begins_s(&self) -> f64 {
        self.stretches.first().map_or(f64::NAN, |stretch| stretch.time_s)
    }

    /// Writes it and begins to take what follows. The file has its name when this returns.
    ///
    /// # Errors
    ///
    /// When the disk or the library refuses.
    pub fn create(
        self,
        path: &Path,
        header: &RecordingHeader,
        channels: &[ReceivedChannel],
    ) -> Result<Triggered, CaptureError> {
        let recorder = Recorder::create(path, header, channels, None)?;
        let lengths = vec![0; self.rates.len()];
        let mut made = Triggered { recorder, aligner: self.aligner, lengths };
        for stretch in self.stretches {
            if made.begin(&stretch.starts, stretch.time_s)? == Next::Ends {
                return Err(CaptureError::Content {
                    file: path.into(),
                    object: "segments".to_owned(),
                    problem: "what was planned does not fit into one file".to_owned(),
                });
            }
            for run in stretch.runs {
                made.write(run)?;
            }
        }
        made.recorder.flush()?;
        Ok(made)
    }
}

impl Triggered {
    /// Takes the next run of the stream.
    ///
    /// # Errors
    ///
    /// When the disk or the library refuses.
    pub fn take(&mut self, run: Received) -> Result<Next, CaptureError> {
        for act in self.aligner.take(run) {
            match act {
                Act::Begin { starts, time_s, .. } => {
                    if self.begin(&starts, time_s)? == Next::Ends {
                        return Ok(Next::Ends);
                    }
                }
                Act::Write(run) => self.write(run)?,
                Act::Skip { .. } => {}
            }
        }
        Ok(Next::GoesOn)
    }

    /// Shows readers what was taken; it survives a kill.
    ///
    /// # Errors
    ///
    /// When the disk or the library refuses.
    pub fn flush(&mut self) -> Result<(), CaptureError> {
        self.recorder.flush()
    }

    /// Bytes of the file now.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.recorder.bytes()
    }

    /// Completes the file.
    ///
    /// # Errors
    ///
    /// When the disk or the library refuses; what was flushed is in the file.
    pub fn close(self) -> Result<Finished, CaptureError> {
        self.recorder.close()
    }

    fn begin(&mut self, starts: &[Option<u64>], time_s: f64) -> Result<Next, CaptureError> {
        let starts: Vec<Option<u64>> = starts
            .iter()
            .zip(&self.lengths)
            .map(|(start, length)| start.map(|_| *length))
            .collect();
        Ok(if self.recorder.begin(&starts, time_s)? { Next::GoesOn } else { Next::Ends })
    }

    /// Writes a run behind what its channel has: indices of the file have no gaps.
    fn write(&mut self, run: Received) -> Result<(), CaptureError> {
        let length = &mut self.lengths[run.channel.0];
        let run = Received { start: SampleIndex(*length), ..run };
        *length += run.raw.len() as u64;
        self.recorder.write(&run)
    }
}

/// Whether one file can hold stretches one behind the other, as [`Recorder::begin`] will find it.
fn fit_in_a_file(stretches: &[Stretch], rates: &[Hz]) -> bool {
    let fastest = rates.iter().fold(0.0_f64, |fastest, rate| fastest.max(rate.0));
    let takes_part = |stretch: &Stretch, c: usize| stretch.starts[c].is_some();
    let Some(first) = stretches.first() else { return false };
    let mut lengths = first.lengths(rates.len());
    let (mut newest, mut newest_s) = (0, first.time_s);
    stretches[1..].iter().all(|stretch| {
        let reference = (0..rates.len()).find(|&c| takes_part(stretch, c) && rates[c].0 >= fastest);
        let Some(start) = reference.map(|c| lengths[c]) else { return false };
        let fits = start > newest
            && stretch.time_s >= newest_s
            && (0..rates.len()).all(|c| {
                let scaled = Segments::scaled(start, rates[c], Hz(fastest));
                let is_new = takes_part(stretch, c) && !takes_part(first, c);
                !is_new
                    && if takes_part(stretch, c) {
                        lengths[c] == scaled
                    } else {
                        lengths[c] <= scaled
                    }
            });
        for (length, more) in lengths.iter_mut().zip(stretch.lengths(rates.len())) {
            *length += more;
        }
        (newest, newest_s) = (start, stretch.time_s);
        fits
    })
}

/// The first instant from `from_s` on at which every channel has a sample, or simply the first.
fn instant(runs: &[Arc<Received>], rates: &[Hz], from_s: f64) -> Option<f64> {
    let oldest_of = |c: usize| runs.iter().find(|run| run.channel.0 == c).map(|run| run.time_s);
    let oldest: Vec<f64> = (0..rates.len()).filter_map(oldest_of).collect();
    let oldest_s = oldest.iter().copied().reduce(f64::min)?;
    let together = oldest.iter().copied().filter(|s| *s <= oldest_s + APART_S);
    let from_s = together.fold(from_s, f64::max);
    let at = |c: usize| {
        runs.iter().find(|run| {
            let end_s = run.time_s + run.raw.len() as f64 / rates[c].0;
            run.channel.0 == c && end_s > from_s
        })
    };
    let first: Vec<(usize, &Arc<Received>)> =
        (0..rates.len()).filter_map(|c| Some((c, at(c)?))).collect();
    let (slowest, run) = first.iter().min_by(|a, b| rates[a.0].0.total_cmp(&rates[b.0].0))?;
    let rate_hz = rates[*slowest].0;
    let skipped = ((from_s - run.time_s) * rate_hz - ON_SAMPLE).ceil().max(0.0);
    let begin_s = run.time_s + skipped / rate_hz;
    let is_common = |at_s: &f64| {
        first.iter().all(|(c, run)| {
            let samples = (at_s - run.time_s) * rates[*c].0;
            (samples - samples.round()).abs() <= ON_SAMPLE
        })
    };
    let mut candidates = (0..INSTANT_SEARCH).map(|k| begin_s + f64::from(k) / rate_hz);
    Some(candidates.find(is_common).unwrap_or(from_s))
}

/// What of a run is not before an instant.
fn rest_of(run: &Received, rate_hz: f64, at_s: f64) -> Option<Received> {
    let skip = ((at_s - run.time_s) * rate_hz - ON_SAMPLE).ceil().max(0.0);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "float to int casts saturate"
    )]
    let skip = skip as usize;
    if skip >= run.raw.len() {
        return None;
    }
    let raw = match &run.raw {
        RawSamples::F32(raw) => RawSamples::F32(raw[skip..].to_vec()),
        RawSamples::F64(raw) => RawSamples::F64(raw[skip..].to_vec()),
        RawSamples::I16(raw) => RawSamples::I16(raw[skip..].to_vec()),
        RawSamples::I32(raw) => RawSamples::I32(raw[skip..].to_vec()),
    };
    Some(Received {
        channel: run.channel,
        start: SampleIndex(run.start.0 + skip as u64),
        segment: run.segment,
        time_s: run.time_s + skip as f64 / rate_hz,
        raw,
    })
}
