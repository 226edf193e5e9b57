//! What a capture's samples are read from: rows of one number a channel.
//!
//! A data set of one channel is a table of one column; a two-dimensional data set, a CSV or a WAV
//! file has a column a channel. Must not know segments, units or blocks.

use super::convert::Conversion;
use super::error::CaptureError;
use super::received::RawSamples;
use crate::signal::ChannelIndex;
use crate::units::Hz;
use std::path::PathBuf;

/// Reads rows, in rising order.
pub(super) trait Rows {
    /// Reads rows `start..start + count`, which lie inside the table: for each column of the
    /// source, in their order, `count` elements.
    ///
    /// Calls come with rising `start`, each where the last one ended.
    fn read(&mut self, start: u64, count: u64) -> Result<Vec<RawSamples>, CaptureError>;
}

/// A table of samples: all its channels have one rate and one length.
pub(super) struct Source {
    /// The file, for errors.
    pub(super) file: PathBuf,
    /// The place in the file, for errors.
    pub(super) object: String,
    /// Where the samples come from.
    pub(super) rows: Box<dyn Rows>,
    /// The channels, one a column.
    pub(super) columns: Vec<Column>,
    /// Rows there are.
    pub(super) length: u64,
    /// Rows a second.
    pub(super) rate: Hz,
    /// Rows that are decoded together; 1 if any run may be read alone.
    pub(super) chunk: u64,
    /// Elements read for one row, unused ones included.
    pub(super) width: u64,
}

/// A channel of a table.
pub(super) struct Column {
    pub(super) channel: ChannelIndex,
    pub(super) conversion: Conversion,
}
