//! Opening: the content of a file decides how it is read.

use super::checks::Checks;
use super::content::{self, Content};
use super::csv;
use super::error::CaptureError;
use super::foreign::mapped;
use super::hdf5::File;
use super::hints::Hints;
use super::info::CaptureInfo;
use super::layout;
use super::map::{ChannelMap, MapError};
use super::root;
use super::rows::Source;
use super::segments::Segments;
use super::wav;
use crate::machine::Machine;
use std::fs;
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
    let content = fs::File::open(path).and_then(|mut file| content::of(&mut file)).map_err(io)?;
    let unknown = |found: &str| CaptureError::NotHdf5 { file: path.into(), found: found.into() };
    match content {
        Content::Hdf5 => hdf5(path, machine, hints),
        Content::Wav => wav::open(path, machine, hints),
        Content::Text => csv::open(path, machine, hints),
        Content::Foreign(kind) => {
            Err(CaptureError::Foreign { file: path.into(), found: kind.name, remedy: kind.remedy })
        }
        Content::Empty => Err(unknown("it is empty")),
        Content::Binary => Err(unknown("no HDF5 signature, no WAV header, no text")),
    }
}

/// An HDF5 file: our layout, or any other by a map.
///
/// A map of the caller always holds; one of the machine file only for a file that is not of our
/// layout, since a machine's captures may come from several recorders.
fn hdf5(path: &Path, machine: Option<&Machine>, hints: &Hints) -> Result<Opened, CaptureError> {
    let file_bytes = std::fs::metadata(path)
        .map_err(|source| CaptureError::Io { file: path.into(), action: "open it", source })?
        .len();
    let checks = Checks { path, file_bytes };
    let attributes = root::attributes(path)?; // Tells a truncated file before the library does.
    let file = File::open(path).map_err(|source| match root::name_not_utf8(path) {
        Some(object) => CaptureError::Content {
            file: path.into(),
            object,
            problem: "this name is not UTF-8, and no object of such a file can be read; rename it (docs/hdf5.md)".into(),
        },
        None => checks.library("the file", source),
    })?;
    let of_machine = map_of(machine).map_err(|wrong| CaptureError::Mapped {
        file: path.into(),
        origin: wrong.origin,
        entry: wrong.entry,
        problem: wrong.problem,
    });
    if hints.map.is_empty() {
        let is_ours = layout::is_ours(&checks, &file, &attributes)?;
        let asked = machine.is_some_and(|machine| !machine.capture_map.is_empty());
        if is_ours || !asked {
            let note = "[capture.map] of the machine file is not used: this is a capture of rotorwatch's own layout";
            let notes = if asked { vec![note.to_owned()] } else { Vec::new() };
            return layout::open(&checks, &file, machine, hints, notes);
        }
    }
    let map = hints.map.over(&of_machine?);
    mapped::open(&checks, &file, machine, hints, &map)
}

/// The machine file's `[capture.map]`.
fn map_of(machine: Option<&Machine>) -> Result<ChannelMap, MapError> {
    match machine {
        Some(machine) => ChannelMap::of_table(&machine.capture_map, "the machine file"),
        None => Ok(ChannelMap::default()),
    }
}
