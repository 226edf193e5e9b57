//! WAV: integers of 8 to 32 bits and floats, any number of channels, as fractions of full scale.
//!
//! The native integers are kept, so that clipping is seen and counts can be recorded. Must not know
//! segments' use or blocks.

mod header;
mod rows;

#[cfg(test)]
mod tests;

use super::error::CaptureError;
use super::hints::Hints;
use super::info::{CaptureInfo, CaptureKind};
use super::open::Opened;
use super::received::{NumberType, RawSamples};
use super::rows::{Rows, Source};
use super::segments::Segments;
use super::table::{self, Choice, Chosen, Facts, Offered, table_error};
use crate::machine::Machine;
use crate::signal::ChannelIndex;
use crate::units::Hz;
use header::{Encoding, Header, HeaderError};
use rows::WavRows;
use std::fs::File;
use std::io::{Seek, SeekFrom};
use std::path::Path;

/// Samples at the beginning that tell a constant to leave out.
const FIRST_SAMPLES: u64 = 16;

/// What the samples of an encoding are: type, value of a count in full scales, ends of the range.
fn numbers(encoding: Encoding) -> (NumberType, f64, Option<RawSamples>) {
    let counts = |bits: i32| 2_f64.powi(1 - bits);
    match encoding {
        Encoding::U8 => (NumberType::I16, counts(8), Some(RawSamples::I16(vec![-128, 127]))),
        Encoding::I16 => (NumberType::I16, counts(16), NumberType::I16.ends()),
        Encoding::I24 => {
            let ends = vec![-(1 << 23), (1 << 23) - 1];
            (NumberType::I32, counts(24), Some(RawSamples::I32(ends)))
        }
        Encoding::I32 => (NumberType::I32, counts(32), NumberType::I32.ends()),
        Encoding::F32 => (NumberType::F32, 1.0, None),
        Encoding::F64 => (NumberType::F64, 1.0, None),
    }
}

/// Opens a WAV file and checks all of it but the samples.
pub(super) fn open(
    path: &Path,
    machine: Option<&Machine>,
    hints: &Hints,
) -> Result<Opened, CaptureError> {
    let io = |source| CaptureError::Io { file: path.into(), action: "read it", source };
    let mut file = File::open(path).map_err(io)?;
    let file_bytes = file.metadata().map_err(io)?.len();
    let header = header::read(&mut file, file_bytes).map_err(|error| match error {
        HeaderError::Io(source) => io(source),
        HeaderError::Problem(problem) => table_error(path, format!("WAV: {problem}")),
    })?;
    let offered = offered(&header);
    let choice = match table::map_of(path, machine, hints)? {
        Some(map) => table::choose(path, &map, &offered)?,
        None => all(&offered),
    };
    let mut notes = header.notes.clone();
    let rate = rate(path, &header, &choice, hints, &mut notes)?;
    let (kind, scale, ends) = numbers(header.encoding);
    let (rows, first) = rows(path, file, &header, &choice)?;
    let facts = Facts {
        path,
        machine,
        hints,
        kind,
        scale,
        ends,
        rate,
        n_samples: header.n_frames,
        storage: header.encoding.name().to_owned(),
    };
    let (mut channels, mut columns) = (Vec::new(), Vec::new());
    for (at, (chosen, first)) in choice.channels.iter().zip(&first).enumerate() {
        let (described, column) = facts.describe(chosen, ChannelIndex(at), Some(first))?;
        channels.push(described);
        columns.push(column);
    }
    #[expect(clippy::float_cmp, reason = "the header's own rate is passed on as it is")]
    let overruled = rate.0 != f64::from(header.rate_hz);
    let info = CaptureInfo {
        file: path.into(),
        file_bytes,
        is_mapped: false,
        format_stated: false,
        start_time: None,
        machine: None,
        shaft_speed: None,
        load: None,
        segments: None,
        duration_s: header.n_frames as f64 / rate.0,
        absent_channels: table::absent(machine, &channels),
        channels,
        other_attributes: Vec::new(),
        ignored: Vec::new(),
        kind: CaptureKind::Wav,
        notes,
        options: Some(table::options(overruled.then_some(rate), &choice.channels, &offered)),
    };
    let source = Source {
        file: path.into(),
        object: "the samples".into(),
        rows: Box::new(rows),
        columns,
        length: header.n_frames,
        rate,
        chunk: 1,
        width: u64::from(header.n_channels),
    };
    Ok(Opened { info, sources: vec![source], segments: Segments::one(rate) })
}

/// The channels by number.
fn offered(header: &Header) -> Vec<Offered> {
    let offer = |column| Offered {
        column,
        name: format!("ch{}", column + 1),
        heading: String::new(),
        unit: None,
    };
    (0..usize::from(header.n_channels)).map(offer).collect()
}

/// The rows, at their beginning, and the first samples of each channel chosen.
fn rows(
    path: &Path,
    file: File,
    header: &Header,
    choice: &Choice,
) -> Result<(WavRows, Vec<RawSamples>), CaptureError> {
    let io = |source| CaptureError::Io { file: path.into(), action: "read it", source };
    let mut rows = WavRows {
        path: path.into(),
        file,
        encoding: header.encoding,
        n_channels: usize::from(header.n_channels),
        columns: choice.channels.iter().map(|channel| channel.column).collect(),
    };
    rows.file.seek(SeekFrom::Start(header.data_at)).map_err(io)?;
    let first = rows.read(0, FIRST_SAMPLES.min(header.n_frames))?;
    rows.file.seek(SeekFrom::Start(header.data_at)).map_err(io)?;
    Ok((rows, first))
}

/// Every channel, in the order of their names.
fn all(offered: &[Offered]) -> Choice {
    let chosen = |o: &Offered| Chosen {
        name: o.name.clone(),
        column: o.column,
        unit: None,
        scale: None,
        offset: None,
    };
    let mut channels: Vec<Chosen> = offered.iter().map(chosen).collect();
    channels.sort_by(|a, b| a.name.cmp(&b.name));
    Choice { channels, ..Choice::default() }
}

/// The header's rate, unless the map or an option says another.
fn rate(
    path: &Path,
    header: &Header,
    choice: &Choice,
    hints: &Hints,
    notes: &mut Vec<String>,
) -> Result<Hz, CaptureError> {
    let stated = Hz(f64::from(header.rate_hz));
    if choice.time.is_some() {
        let problem = "time= in --map: a WAV file has no times; give rate=, or leave it out";
        return Err(table_error(path, problem.to_owned()));
    }
    match table::told_rate(choice, hints) {
        Some((told, origin)) => {
            if !table::agree(stated, told) {
                notes.push(format!(
                    "the header says {} Hz, {origin} {} Hz: the latter is used",
                    stated.0, told.0
                ));
            }
            Ok(told)
        }
        None if (table::RATE_RANGE_HZ.0..=table::RATE_RANGE_HZ.1).contains(&stated.0) => Ok(stated),
        None => {
            let problem =
                format!("WAV: the header says {} samples a second; give --rate HZ", stated.0);
            Err(table_error(path, problem))
        }
    }
}
