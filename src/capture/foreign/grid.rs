//! Channels of a one- or two-dimensional data set of any layout, as one table.
//!
//! Time runs along one axis; a channel is one coordinate on the other. All channels asked for are
//! read at once, so that a chunk is decompressed once. Must not know maps or units.

use super::objects::Number;
use crate::capture::error::{CaptureError, LibraryError};
use crate::capture::hdf5::Dataset;
use crate::capture::received::RawSamples;
use crate::capture::rows::Rows;
use std::path::PathBuf;

/// Which samples of a data set are one channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Strip {
    /// Number of dimensions, 1 or 2.
    pub(super) rank: usize,
    /// The dimension along which time runs.
    pub(super) axis: usize,
    /// Place on the other one.
    pub(super) at: usize,
    /// Samples.
    pub(super) length: u64,
}

impl Strip {
    /// Finds the channel of a data set; the error says what to add to the entry.
    ///
    /// `column`: across the shorter dimension, time along the longer, whichever way round; in a
    /// square the column as HDF5 shows it. `row`: the row as HDF5 shows it.
    pub(super) fn find(
        shape: &[usize],
        column: Option<usize>,
        row: Option<usize>,
    ) -> Result<Self, String> {
        let strip = |axis: usize, at: usize| {
            let length = shape[axis] as u64;
            Self { rank: shape.len(), axis, at, length }
        };
        let outside = |what: &str, at: usize, n: usize| {
            let last = n.saturating_sub(1);
            format!("{what}={at}, but the shape is {}: {what} is 0 to {last}", times(shape))
        };
        match (shape, column, row) {
            ([_], None | Some(0), None | Some(0)) => Ok(strip(0, 0)),
            ([n], ..) => {
                Err(format!("a column or row of {n} numbers in one dimension; leave it out"))
            }
            ([rows, _], _, Some(at)) if at < *rows => Ok(strip(1, at)),
            ([rows, _], _, Some(at)) => Err(outside("row", at, *rows)),
            ([rows, columns], Some(at), None) => {
                let (axis, n) = if rows >= columns { (0, *columns) } else { (1, *rows) };
                if at < n { Ok(strip(axis, at)) } else { Err(outside("column", at, n)) }
            }
            ([1, _], None, None) => Ok(strip(1, 0)),
            ([_, 1], None, None) => Ok(strip(0, 0)),
            ([rows, columns], None, None) => Err(format!(
                "the shape is {}, {} channels; add column=K, K from 0 to {}",
                times(shape),
                rows.min(columns),
                rows.min(columns).saturating_sub(1)
            )),
            _ => Err(format!(
                "the shape is {}; expected one or two dimensions: store each channel as a data set of its own",
                times(shape)
            )),
        }
    }

    /// Start of a box that begins with element `start` of this strip and place `at`.
    pub(super) fn corner(&self, start: usize, at: usize) -> Vec<usize> {
        self.pair(start, at)
    }

    fn pair(&self, along: usize, across: usize) -> Vec<usize> {
        match (self.rank, self.axis) {
            (1, _) => vec![along],
            (_, 0) => vec![along, across],
            _ => vec![across, along],
        }
    }

    /// Extents of a box of `count` elements along and `width` places across.
    pub(super) fn extents(&self, count: usize, width: usize) -> Vec<usize> {
        self.pair(count, width)
    }
}

/// A shape as people write it.
pub(super) fn times(shape: &[usize]) -> String {
    if shape.is_empty() {
        return "one element".into();
    }
    let extents: Vec<String> = shape.iter().map(ToString::to_string).collect();
    extents.join(" × ")
}

/// Reads all channels of a table.
pub(super) struct TableRows {
    pub(super) file: PathBuf,
    /// Path inside the file.
    pub(super) object: String,
    pub(super) dataset: Dataset,
    pub(super) number: Number,
    /// Any of the strips: they differ in their place only.
    pub(super) strip: Strip,
    /// Places of the channels.
    pub(super) places: Vec<usize>,
    /// Whether each place is read alone: time runs along the last dimension, no chunk holds two.
    pub(super) alone: bool,
}

impl Rows for TableRows {
    fn read(&mut self, start: u64, count: u64) -> Result<Vec<RawSamples>, CaptureError> {
        // Counts come from shapes, which are `usize`.
        let clamp = |count: u64| usize::try_from(count).unwrap_or(usize::MAX);
        self.columns(clamp(start), clamp(count)).map_err(|source| CaptureError::Library {
            file: self.file.clone(),
            object: self.object.clone(),
            source,
        })
    }
}

impl TableRows {
    /// First place, and places from there to the last.
    pub(super) fn range(places: &[usize]) -> (usize, usize) {
        let first = places.iter().copied().min().unwrap_or(0);
        let last = places.iter().copied().max().unwrap_or(0);
        (first, last - first + 1)
    }

    fn columns(&self, start: usize, count: usize) -> Result<Vec<RawSamples>, LibraryError> {
        let read = |at: usize, width: usize| {
            let (corner, extents) =
                (self.strip.corner(start, at), self.strip.extents(count, width));
            self.dataset.box_of(self.number, &corner, &extents)
        };
        if self.alone {
            return self.places.iter().map(|&at| read(at, 1)).collect();
        }
        let (first, width) = Self::range(&self.places);
        let raw = read(first, width)?;
        if width == 1 && self.places.len() == 1 {
            return Ok(vec![raw]);
        }
        let interleaved = self.strip.axis == 0;
        let of = |at: &usize| part(&raw, at - first, width, interleaved);
        Ok(self.places.iter().map(of).collect())
    }
}

/// Channel `at` of `width` in a box, its samples side by side or interleaved with the others'.
fn part(raw: &RawSamples, at: usize, width: usize, interleaved: bool) -> RawSamples {
    match raw {
        RawSamples::F32(raw) => RawSamples::F32(pick(raw, at, width, interleaved)),
        RawSamples::F64(raw) => RawSamples::F64(pick(raw, at, width, interleaved)),
        RawSamples::I16(raw) => RawSamples::I16(pick(raw, at, width, interleaved)),
        RawSamples::I32(raw) => RawSamples::I32(pick(raw, at, width, interleaved)),
    }
}

fn pick<T: Copy>(raw: &[T], at: usize, width: usize, interleaved: bool) -> Vec<T> {
    if interleaved {
        return raw.chunks_exact(width).map(|row| row[at]).collect();
    }
    let count = raw.len() / width;
    raw[at * count..(at + 1) * count].to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(shape: &[usize], column: Option<usize>, row: Option<usize>) -> (usize, usize, u64) {
        let strip = Strip::find(shape, column, row).unwrap();
        (strip.axis, strip.at, strip.length)
    }

    #[test]
    fn time_runs_along_the_longer_dimension() {
        assert_eq!(found(&[9], None, None), (0, 0, 9));
        assert_eq!(found(&[9, 3], Some(2), None), (0, 2, 9));
        assert_eq!(found(&[3, 9], Some(2), None), (1, 2, 9));
        assert_eq!(found(&[1, 9], None, None), (1, 0, 9));
        assert_eq!(found(&[9, 1], None, None), (0, 0, 9));
        // A square has no longer one: the column is the one HDF5 shows.
        assert_eq!(found(&[4, 4], Some(1), None), (0, 1, 4));
        assert_eq!(found(&[4, 4], None, Some(1)), (1, 1, 4));
        assert_eq!(found(&[9, 3], None, Some(8)), (1, 8, 3));
    }

    #[test]
    fn what_is_ambiguous_or_absent_is_told_with_the_remedy() {
        let wrong = |shape: &[usize], column, row| Strip::find(shape, column, row).unwrap_err();
        assert_eq!(
            wrong(&[3, 9], None, None),
            "the shape is 3 × 9, 3 channels; add column=K, K from 0 to 2"
        );
        assert_eq!(
            wrong(&[9, 3], Some(3), None),
            "column=3, but the shape is 9 × 3: column is 0 to 2"
        );
        assert_eq!(wrong(&[3, 9], None, Some(5)), "row=5, but the shape is 3 × 9: row is 0 to 2");
        assert!(wrong(&[9], Some(1), None).contains("leave it out"));
        assert!(wrong(&[2, 2, 2], Some(1), None).contains("one or two dimensions"));
        assert!(wrong(&[], None, None).contains("one element"));
    }

    #[test]
    fn a_box_is_taken_apart() {
        let raw = RawSamples::I16(vec![0, 1, 2, 10, 11, 12]);
        assert_eq!(part(&raw, 1, 3, true), RawSamples::I16(vec![1, 11]));
        assert_eq!(part(&raw, 1, 2, false), RawSamples::I16(vec![10, 11, 12]));
    }
}
