//! Streams a capture as blocks, its channels interleaved in time.

use super::error::{CaptureError, LibraryError};
use super::info::CaptureInfo;
use super::layout::{self, Opened};
use super::segments::Segments;
use super::stream::ChannelStream;
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

/// A capture being read.
///
/// Memory is bounded whatever the file declares: one block or chunk of each channel is held.
pub struct CaptureReader {
    info: CaptureInfo,
    streams: Vec<ChannelStream>,
    segments: Segments,
    ready: VecDeque<Block>,
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
    /// `machine`: whose sensors' units and sensitivities win over the capture's `unit` attributes.
    ///
    /// # Errors
    ///
    /// See [`CaptureError`]; every variant names the place and the remedy.
    pub fn open(path: &Path, machine: Option<&Machine>) -> Result<Self, CaptureError> {
        let Opened { info, sources, segments } = layout::open(path, machine)?;
        let share = ELEMENTS_MAX / sources.len().max(1) as u64;
        let block_max = share.clamp(1, BLOCK_SAMPLES_MAX);
        let streams = sources
            .into_iter()
            .filter_map(|source| ChannelStream::new(source, &segments, block_max))
            .collect();
        let (ready, report) = (VecDeque::new(), ReadReport::default());
        Ok(Self { info, streams, segments, ready, report, ended: false })
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
    /// [`CaptureError::Library`] if the samples cannot be read or decompressed; the reader is at
    /// its end from then on.
    pub fn next_block(&mut self) -> Result<Option<Block>, CaptureError> {
        loop {
            if let Some(block) = self.ready.pop_front() {
                self.report.samples_read += block.samples.len() as u64;
                return Ok(Some(block));
            }
            let Some(at) = self.earliest() else { return Ok(None) };
            match self.streams[at].step(&self.segments) {
                Ok(step) => {
                    self.report.samples_not_finite += step.n_rejected;
                    self.ready.extend(step.blocks);
                }
                Err(source) => return Err(self.failed(at, source)),
            }
        }
    }

    /// The channel whose next sample is the earliest; the first of equals.
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

    fn failed(&mut self, at: usize, source: LibraryError) -> CaptureError {
        self.ended = true;
        let object = self.streams[at].path.clone();
        CaptureError::Library { file: self.info.file.clone(), object, source }
    }
}
