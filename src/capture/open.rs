//! Opening: the content of a file decides how it is read.

use super::error::CaptureError;
use super::hints::Hints;
use super::info::CaptureInfo;
use super::layout;
use super::rows::Source;
use super::segments::Segments;
use crate::machine::Machine;
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
    _hints: &Hints,
) -> Result<Opened, CaptureError> {
    layout::open(path, machine)
}
