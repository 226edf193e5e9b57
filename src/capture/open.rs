//! Opening: the content of a file decides how it is read.

use super::content::{self, Content};
use super::csv;
use super::error::CaptureError;
use super::hints::Hints;
use super::info::CaptureInfo;
use super::layout;
use super::rows::Source;
use super::segments::Segments;
use super::wav;
use crate::machine::Machine;
use std::fs::File;
use std::path::Path;

/// An opened capture.
pub(super) struct Opened {
    pub(super) info: CaptureInfo,
    pub(super) sources: Vec<Source>,
    pub(super) segments: Segments,
}

/// Opens and checks everything but the samples.
pub(super) fn open(
    path: &Path,
    machine: Option<&Machine>,
    hints: &Hints,
) -> Result<Opened, CaptureError> {
    let io = |source| CaptureError::Io { file: path.into(), action: "open it", source };
    let content = File::open(path).and_then(|mut file| content::of(&mut file)).map_err(io)?;
    let unknown = |found: &str| CaptureError::NotHdf5 { file: path.into(), found: found.into() };
    match content {
        Content::Hdf5 => layout::open(path, machine),
        Content::Wav => wav::open(path, machine, hints),
        Content::Text => csv::open(path, machine, hints),
        Content::Foreign(kind) => {
            Err(CaptureError::Foreign { file: path.into(), found: kind.name, remedy: kind.remedy })
        }
        Content::Empty => Err(unknown("it is empty")),
        Content::Binary => Err(unknown("no HDF5 signature, no WAV header, no text")),
    }
}
