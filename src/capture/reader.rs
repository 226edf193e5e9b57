//! Streams a capture as blocks, its channels interleaved in time.

use super::error::CaptureError;
use super::hints::Hints;
use super::info::CaptureInfo;
use super::open::{self, Opened};
use super::received::Received;
use super::segments::Segments;
use super::stream::TableStream;
use crate::machine::Machine;
use crate::signal::Block;
use std::collections::VecDeque;
use std::fmt;
use std::path::Path;

/// Samples of a block at most.
const BLOCK_SAMPLES_MAX: u64 = 65_536;

/// Elements of all channels' blocks together at most.
const ELEMENTS_MAX: u64 = 8 << 20;

/// What has been read so far, over all channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ReadReport {
    /// Samples handed out in blocks.
    pub samples_read: u64,
    /// Samples left out because they, or their conversion, are not finite; a gap stands for each.
    pub samples_not_finite: u64,
}

impl ReadReport {
    /// Samples left out, for whatever reason.
    #[must_use]
    pub fn samples_rejected(&self) -> u64 {
        self.samples_not_finite
    }

    /// Why samples were left out, one text per reason that occurred, without a count: the same
    /// reason has the same text whenever it is asked for.
    #[must_use]
    pub fn reasons(&self) -> Vec<String> {
        match self.samples_not_finite {
            0 => Vec::new(),
            _ => vec!["not finite numbers".to_owned()],
        }
    }
}

/// A piece of a capture, as [`CaptureReader::next_piece`] gives it.
#[derive(Debug, Clone, PartialEq)]
pub enum Piece {
    /// Samples as they are stored.
    Received(Received),
    /// Samples as they are analysed.
    Block(Block),
}

/// A capture being read.
///
/// Memory is bounded whatever the file declares: one block or chunk of each channel is held.
pub struct CaptureReader {
    info: CaptureInfo,
    streams: Vec<TableStream>,
    segments: Segments,
    ready: VecDeque<Block>,
    /// Raw samples not yet taken, if they are kept at all.
    received: VecDeque<Received>,
    keep_received: bool,
    report: ReadReport,
    ended: bool,
}

impl fmt::Debug for CaptureReader {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("CaptureReader")
            .field("info", &self.info)
            .field("report", &self.report)
            .finish_non_exhaustive()
    }
}

impl CaptureReader {
    /// Opens a capture and checks all of it but the samples.
    ///
    /// The content decides the format: HDF5, WAV or text (CSV). `machine`: whose sensors' units and
    /// sensitivities win over those of the capture, and whose `[capture.map]` says where channels
    /// stand in a foreign layout; `hints`: what the caller knows beside that.
    ///
    /// # Errors
    ///
    /// See [`CaptureError`]; every variant names the place and the remedy.
    pub fn open(
        path: &Path,
        machine: Option<&Machine>,
        hints: &Hints,
    ) -> Result<Self, CaptureError> {
        let Opened { info, sources, segments } = open::open(path, machine, hints)?;
        let width: u64 = sources.iter().map(|source| source.width).sum();
        let block_max = (ELEMENTS_MAX / width.max(1)).clamp(1, BLOCK_SAMPLES_MAX);
        let streams = sources
            .into_iter()
            .filter_map(|source| TableStream::new(source, &segments, block_max))
            .collect();
        Ok(Self {
            info,
            streams,
            segments,
            ready: VecDeque::new(),
            received: VecDeque::new(),
            keep_received: false,
            report: ReadReport::default(),
            ended: false,
        })
    }

    /// Also keeps the raw samples behind every block, for [`CaptureReader::next_received`].
    pub fn keep_received(&mut self) {
        self.keep_received = true;
    }

    /// Takes the next run of raw samples behind the blocks handed out so far.
    ///
    /// Runs come in the order of [`CaptureReader::next_block`]; whoever keeps them takes them all
    /// before asking for another block, else they pile up.
    pub fn next_received(&mut self) -> Option<Received> {
        self.received.pop_front()
    }

    /// What the capture states about itself.
    #[must_use]
    pub fn info(&self) -> &CaptureInfo {
        &self.info
    }

    /// What has been read so far.
    #[must_use]
    pub fn report(&self) -> ReadReport {
        self.report
    }

    /// Gives the next block, at most about one second long; `None` at the end.
    ///
    /// Blocks of one channel come in the order of their samples and never span a segment; over
    /// the channels, the block that begins first in stream time comes first. `block.channel` is
    /// the place in [`CaptureInfo::channels`].
    ///
    /// # Errors
    ///
    /// If the samples cannot be read or decompressed; the reader is at its end from then on.
    pub fn next_block(&mut self) -> Result<Option<Block>, CaptureError> {
        loop {
            if let Some(block) = self.ready.pop_front() {
                self.report.samples_read += block.samples.len() as u64;
                return Ok(Some(block));
            }
            if !self.step()? {
                return Ok(None);
            }
        }
    }

    /// Gives the next piece, raw samples before the blocks made of them; `None` at the end.
    ///
    /// For whoever keeps what was received: nothing piles up, not even where no sample is finite.
    ///
    /// # Errors
    ///
    /// As [`CaptureReader::next_block`].
    pub fn next_piece(&mut self) -> Result<Option<Piece>, CaptureError> {
        loop {
            if let Some(received) = self.received.pop_front() {
                return Ok(Some(Piece::Received(received)));
            }
            if let Some(block) = self.ready.pop_front() {
                self.report.samples_read += block.samples.len() as u64;
                return Ok(Some(Piece::Block(block)));
            }
            if !self.step()? {
                return Ok(None);
            }
        }
    }

    /// Reads the next run of the earliest table; false at the end.
    fn step(&mut self) -> Result<bool, CaptureError> {
        let Some(at) = self.earliest() else { return Ok(false) };
        match self.streams[at].step(&self.segments, self.keep_received) {
            Ok(step) => {
                self.report.samples_not_finite += step.n_rejected;
                self.ready.extend(step.blocks);
                self.received.extend(step.received);
                Ok(true)
            }
            Err(error) => {
                self.ended = true;
                Err(error)
            }
        }
    }

    /// The table whose next row is the earliest; the first of equals.
    fn earliest(&self) -> Option<usize> {
        if self.ended {
            return None;
        }
        let mut best: Option<(usize, f64)> = None;
        for (at, stream) in self.streams.iter().enumerate() {
            if let Some(time_s) = stream.next_time_s()
                && best.is_none_or(|(_, earliest_s)| time_s < earliest_s)
            {
                best = Some((at, time_s));
            }
        }
        best.map(|(at, _)| at)
    }
}
