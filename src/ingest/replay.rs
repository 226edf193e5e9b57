//! Plays a capture back as if it were measured now: at 1×, at N× or as fast as it is taken.

use super::interleave::Interleaver;
use super::shift::Reached;
use super::shift::Shift;
use crate::capture::error::CaptureError;
use crate::capture::hints::Hints;
use crate::capture::info::ChannelDescription;
use crate::capture::reader::CaptureReader;
use crate::capture::reader::Piece;
use crate::capture::reader::ReadReport;
use crate::capture::received::Received;
use crate::capture::received::ReceivedChannel;
use crate::machine::Machine;
use crate::signal::Block;
use crate::signal::ChannelInfo;
use crate::signal::Timestamp;
use crate::units::Hz;
use std::error::Error;
use std::fmt;
use std::ops::ControlFlow;
use std::path::Path;
use std::path::PathBuf;

/// Which capture, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The capture.
    pub file: PathBuf,
    /// What is known beside it.
    pub hints: Hints,
    /// How fast.
    pub speed: Speed,
    /// Whether to begin again at the end; indices, segments and times go on.
    pub repeat: bool,
}

/// How fast a capture is played back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Speed {
    /// As fast as the blocks are taken.
    Max,
    /// This many seconds of stream time a second, > 0.
    Times(f64),
}

/// What is known of a stream before its first sample.
#[derive(Debug, Clone, PartialEq)]
pub struct StreamInfo {
    /// Its channels; [`Block::channel`] is the place in this list.
    pub channels: Vec<ChannelInfo>,
    /// UTC of stream time 0, if known.
    pub start_time: Option<Timestamp>,
    /// The capture's `shaft_speed_hz`.
    pub shaft_speed: Option<Hz>,
    /// The capture's `load`.
    pub load: Option<f64>,
    /// The channels as they are received, in the same order.
    pub received: Vec<ReceivedChannel>,
}

/// One step of reading a capture.
#[derive(Debug, Clone, PartialEq)]
pub enum Step {
    /// The next samples; over the channels, in the order in which blocks begin.
    Block(Block),
    /// The samples behind blocks to come, as they were received; only if they were asked for.
    Received(Received),
    /// Samples of the capture that are of no use.
    Rejected {
        /// How many.
        n_samples: u64,
        /// Why.
        reason: String,
    },
    /// Nothing is left.
    End,
}

/// A capture opened for reading.
pub struct Stream {
    /// What is known of it.
    pub info: StreamInfo,
    /// Gives the next step; [`Step::End`] for ever after the first.
    pub next: Box<dyn FnMut() -> Result<Step, ReplayError>>,
}

impl fmt::Debug for Stream {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Stream").field("info", &self.info).finish_non_exhaustive()
    }
}

/// Why a replay cannot begin or go on.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The capture cannot be opened.
    #[error("opening {} failed", file.display())]
    Open {
        /// The capture.
        file: PathBuf,
        /// Why.
        source: Box<dyn Error + Send + Sync>,
    },
    /// The capture cannot be read further.
    #[error("reading {} failed", file.display())]
    Read {
        /// The capture.
        file: PathBuf,
        /// Why.
        source: Box<dyn Error + Send + Sync>,
    },
    /// There is nothing to play.
    #[error("{} holds no samples", file.display())]
    Empty {
        /// The capture.
        file: PathBuf,
    },
    /// The file became another one between two passes.
    #[error("{} changed its channels while it was replayed, restart to use it", file.display())]
    Changed {
        /// The capture.
        file: PathBuf,
    },
}

/// How a replay came to its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// Every sample was handed on.
    Finished,
    /// `wait` or `sink` asked to stop.
    Stopped,
}

/// Opens a capture for `machine`, whose sensors' units win over the capture's.
///
/// # Errors
/// When the file is no capture or cannot be read.
pub fn open(file: &Path, machine: &Machine, hints: &Hints) -> Result<Stream, ReplayError> {
    opened(file, machine, hints, false)
}

/// As [`open`], with the samples as they were received as well, for a recorder.
///
/// # Errors
/// When the file is no capture or cannot be read.
pub fn open_with_received(
    file: &Path,
    machine: &Machine,
    hints: &Hints,
) -> Result<Stream, ReplayError> {
    opened(file, machine, hints, true)
}

fn opened(
    file: &Path,
    machine: &Machine,
    hints: &Hints,
    with_received: bool,
) -> Result<Stream, ReplayError> {
    let failed = |source: CaptureError| ReplayError::Open {
        file: file.to_owned(),
        source: Box::new(source),
    };
    let mut reader = CaptureReader::open(file, Some(machine), hints).map_err(failed)?;
    if with_received {
        reader.keep_received();
    }
    let described = reader.info();
    let info = StreamInfo {
        channels: described.channels.iter().map(|c| c.info.clone()).collect(),
        start_time: described.start_time,
        shaft_speed: described.shaft_speed,
        load: described.load,
        received: described.channels.iter().map(received_channel).collect(),
    };
    let file = file.to_owned();
    let mut told = 0;
    let next = move || {
        // Losses are told as soon as they are known, so that the next verdict can name them.
        if let Some(step) = newly_rejected(&reader.report(), &mut told) {
            return Ok(step);
        }
        match reader.next_piece() {
            Ok(Some(Piece::Block(block))) => Ok(Step::Block(block)),
            Ok(Some(Piece::Received(received))) => Ok(Step::Received(received)),
            // The last samples may have been among them.
            Ok(None) => Ok(newly_rejected(&reader.report(), &mut told).unwrap_or(Step::End)),
            Err(source) => Err(ReplayError::Read { file: file.clone(), source: Box::new(source) }),
        }
    };
    Ok(Stream { info, next: Box::new(next) })
}

fn received_channel(channel: &ChannelDescription) -> ReceivedChannel {
    ReceivedChannel {
        name: channel.info.name.clone(),
        sample_rate: channel.info.sample_rate,
        number_type: channel.number_type,
        scale: channel.scale,
        offset: channel.offset,
        raw_zero: channel.raw_zero,
        unit: channel.unit_text.clone(),
        sensor: channel.sensor.clone(),
    }
}

/// The step that tells of samples rejected beyond the `told` ones, if there are any.
fn newly_rejected(report: &ReadReport, told: &mut u64) -> Option<Step> {
    let n_samples = report.samples_rejected() - *told;
    *told += n_samples;
    let reason = || report.reasons().join("; ");
    (n_samples > 0).then(|| Step::Rejected { n_samples, reason: reason() })
}

/// Plays a capture until its end, an error or a stop.
///
/// `open` opens the capture (once a pass), `wait` returns when so many seconds have passed since
/// the replay began, and `sink` takes what was read; either may ask to stop. A block is handed on
/// when its *last* sample is due, as an acquisition would. Blocks given to `sink` are at most
/// [`super::interleave::MAX_BLOCK_S`] long and, over the channels, in the order of their ends.
///
/// # Errors
/// When the capture cannot be opened or read, is empty, or changed between two passes.
pub fn run(
    settings: &Settings,
    open: &mut dyn FnMut() -> Result<Stream, ReplayError>,
    wait: &mut dyn FnMut(f64) -> ControlFlow<()>,
    sink: &mut dyn FnMut(Step) -> ControlFlow<()>,
) -> Result<End, ReplayError> {
    let mut stream = open()?;
    let info = stream.info.clone();
    let mut shift = Shift::none(info.channels.len());
    loop {
        let pass = play(settings.speed, stream, &shift, wait, sink)?;
        let Played::All(reached) = pass else { return Ok(End::Stopped) };
        if reached.n_samples == 0 {
            return Err(ReplayError::Empty { file: settings.file.clone() });
        }
        if !settings.repeat {
            return Ok(End::Finished);
        }
        shift = reached.shift;
        stream = open()?;
        if stream.info.channels != info.channels {
            return Err(ReplayError::Changed { file: settings.file.clone() });
        }
    }
}

/// How one pass ended.
enum Played {
    /// With every sample handed on.
    All(Reached),
    /// By a stop.
    Stopped,
}

/// Plays one pass.
fn play(
    speed: Speed,
    mut stream: Stream,
    shift: &Shift,
    wait: &mut dyn FnMut(f64) -> ControlFlow<()>,
    sink: &mut dyn FnMut(Step) -> ControlFlow<()>,
) -> Result<Played, ReplayError> {
    let rates_hz: Vec<f64> = stream.info.channels.iter().map(|c| c.sample_rate.0).collect();
    let mut reached = Reached { n_samples: 0, shift: shift.clone() };
    let mut interleaver = Interleaver::new(rates_hz.clone());
    loop {
        let mut block = match interleaver.next(&mut stream.next)? {
            Step::Block(block) => block,
            Step::End => return Ok(Played::All(reached)),
            Step::Received(mut run) => {
                shift.apply_to_received(&mut run);
                let n_samples = run.raw.len() as u64;
                let end_s = run.time_s + n_samples as f64 / rates_hz[run.channel.0];
                reached.note(run.channel.0, run.start.0 + n_samples, run.segment, end_s);
                if sink(Step::Received(run)).is_break() {
                    return Ok(Played::Stopped);
                }
                continue;
            }
            rejected @ Step::Rejected { .. } => {
                if sink(rejected).is_break() {
                    return Ok(Played::Stopped);
                }
                continue;
            }
        };
        shift.apply(&mut block);
        let end_s = block.time_s + block.samples.len() as f64 / rates_hz[block.channel.0];
        reached.n_samples += block.samples.len() as u64;
        reached.note(block.channel.0, block.end().0, block.segment, end_s);
        let due = match speed {
            Speed::Max => ControlFlow::Continue(()),
            Speed::Times(factor) => wait(end_s / factor),
        };
        if due.is_break() || sink(Step::Block(block)).is_break() {
            return Ok(Played::Stopped);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::ChannelIndex;
    use crate::signal::SampleIndex;
    use crate::units::Unit;
    use std::collections::VecDeque;

    const SLOW_HZ: f64 = 100.0;
    const FAST_HZ: f64 = 400.0;

    fn channel(name: &str, rate_hz: f64) -> ChannelInfo {
        ChannelInfo {
            name: name.to_owned(),
            sample_rate: Hz(rate_hz),
            unit: Unit::Unknown,
            offset: 0.0,
            unit_conflict: None,
            full_scale: None,
        }
    }

    /// Two channels, two seconds, handed out a second at a time as a capture does.
    fn two_channels() -> Stream {
        let mut blocks = VecDeque::new();
        for second in 0..2_u64 {
            for (channel, rate) in [(0, 100_u64), (1, 400)] {
                blocks.push_back(Step::Block(Block {
                    channel: ChannelIndex(channel),
                    start: SampleIndex(second * rate),
                    segment: 0,
                    time_s: second as f64,
                    samples: (second * rate..(second + 1) * rate).map(|i| i as f32).collect(),
                }));
            }
        }
        blocks.insert(2, Step::Rejected { n_samples: 3, reason: "not finite".to_owned() });
        let info = StreamInfo {
            channels: vec![channel("slow", SLOW_HZ), channel("fast", FAST_HZ)],
            start_time: None,
            shaft_speed: None,
            load: None,
            received: Vec::new(),
        };
        Stream { info, next: Box::new(move || Ok(blocks.pop_front().unwrap_or(Step::End))) }
    }

    fn settings(speed: Speed, repeat: bool) -> Settings {
        Settings { file: PathBuf::from("x.h5"), hints: Hints::default(), speed, repeat }
    }

    #[test]
    fn everything_arrives_in_order_and_in_small_blocks() {
        let (mut waits, mut next, mut rejected) = (Vec::new(), [0_u64; 2], 0);
        let end = run(
            &settings(Speed::Times(2.0), false),
            &mut || Ok(two_channels()),
            &mut |due_s| {
                waits.push(due_s);
                ControlFlow::Continue(())
            },
            &mut |step| {
                match step {
                    Step::Block(block) => {
                        assert_eq!(block.start.0, next[block.channel.0]);
                        assert!(block.samples.len() as f64 <= 0.25 * FAST_HZ);
                        next[block.channel.0] = block.end().0;
                    }
                    Step::Rejected { n_samples, .. } => rejected += n_samples,
                    Step::Received(_) => panic!("nothing was asked for"),
                    Step::End => panic!("the end is the return value"),
                }
                ControlFlow::Continue(())
            },
        );
        assert_eq!((end.unwrap(), next, rejected), (End::Finished, [200, 800], 3));
        assert!(waits.is_sorted(), "{waits:?}");
        // two seconds at 2x: the last sample is due after one
        assert_eq!(waits.last(), Some(&1.0));
        // two channels in quarter seconds
        assert_eq!(waits.len(), 16);
    }

    #[test]
    fn passes_continue_indices_segments_and_time() {
        let mut blocks: Vec<Block> = Vec::new();
        let end = run(
            &settings(Speed::Max, true),
            &mut || Ok(two_channels()),
            &mut |_| panic!("full speed does not wait"),
            &mut |step| {
                if let Step::Block(block) = step {
                    blocks.push(block);
                }
                if blocks.len() == 48 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            },
        );
        assert_eq!(end.unwrap(), End::Stopped);
        for (channel, rate) in [(0, SLOW_HZ), (1, FAST_HZ)] {
            let mut end = 0;
            for block in blocks.iter().filter(|b| b.channel.0 == channel) {
                assert_eq!(block.start.0, end);
                end = block.end().0;
                // passes of 2 s in quarters: binary fractions, so nothing is rounded
                assert!((block.time_s - block.start.0 as f64 / rate).abs() < 1e-12);
                assert!((f64::from(block.segment) - (block.time_s / 2.0).floor()).abs() < 1e-12);
            }
            assert!((end as f64 - 6.0 * rate).abs() < 1e-12);
        }
    }

    #[test]
    fn an_empty_capture_is_an_error_even_when_repeated() {
        let empty = || {
            let mut stream = two_channels();
            stream.next = Box::new(|| Ok(Step::End));
            Ok(stream)
        };
        let end = run(
            &settings(Speed::Max, true),
            &mut { empty },
            &mut |_| ControlFlow::Continue(()),
            &mut |_| ControlFlow::Continue(()),
        );
        assert!(matches!(end, Err(ReplayError::Empty { .. })));
    }

    #[test]
    fn a_file_that_changed_between_passes_ends_the_replay() {
        let mut pass = 0;
        let end = run(
            &settings(Speed::Max, true),
            &mut || {
                let mut stream = two_channels();
                stream.info.channels[0].sample_rate = Hz(SLOW_HZ + f64::from(pass));
                pass += 1;
                Ok(stream)
            },
            &mut |_| ControlFlow::Continue(()),
            &mut |_| ControlFlow::Continue(()),
        );
        assert!(matches!(end, Err(ReplayError::Changed { .. })));
    }

    #[test]
    fn a_stop_while_waiting_ends_the_replay() {
        let mut n_blocks = 0;
        let end = run(
            &settings(Speed::Times(1.0), false),
            &mut || Ok(two_channels()),
            &mut |due_s| {
                if due_s > 1.0 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            },
            &mut |step| {
                n_blocks += usize::from(matches!(step, Step::Block(_)));
                ControlFlow::Continue(())
            },
        );
        assert_eq!((end.unwrap(), n_blocks), (End::Stopped, 8));
    }
}
