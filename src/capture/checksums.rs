//! A capture's own checksums, `/checksums` and the root attribute `checksum`: verified on reading.
//!
//! What the file states about itself is compared when it is opened, samples as they stream by. A
//! file without either is read unverified. Must not know how sums are computed.

use super::checks::{Checks, Chunks};
use super::error::CaptureError;
use super::hdf5::{Dataset, Entry, File};
use super::info::{CaptureInfo, ChannelDescription};
use super::integrity::{ChannelFacts, Refusal, Statement, Verifier};
use super::layout::FORMAT;
use super::received::RawSamples;
use super::rows::{Rows, Source};
use super::segments::Segments;
use std::path::PathBuf;

/// The group of the sums.
pub(super) const GROUP: &str = "checksums";

/// Attribute of `/`: the sum of what the file states about itself.
pub(super) const STATEMENT: &str = "checksum";

/// Attribute of a table of sums: samples that share one.
pub(super) const BLOCK: &str = "block_samples";

/// Attribute of a table of sums: samples of the channel; absent while it is being recorded.
pub(super) const SAMPLES: &str = "samples";

/// Samples of a block at most: exact in a double, and no product with it overflows.
const BLOCK_SAMPLES_MAX: f64 = 4_294_967_296.0;

/// Sums fetched at once.
const PAGE_ROWS: u64 = 1024;

/// The table of one channel's sums.
struct Table {
    dataset: Dataset,
    /// Samples of a block.
    block: u64,
    /// Sums there are.
    rows: u64,
    /// Samples of the channel, if it is finished.
    samples: Option<u64>,
}

/// Checks what an opened capture states about itself and puts a check before its samples.
///
/// `stated`: the root attribute `checksum`; `sources`: one a channel, in the order of `info`.
pub(super) fn attach(
    checks: &Checks<'_>,
    file: &File,
    stated: Option<f64>,
    info: &mut CaptureInfo,
    segments: &Segments,
    sources: Vec<Source>,
) -> Result<Vec<Source>, CaptureError> {
    let library = |e| checks.library(GROUP, e);
    let Some(entries) = file.entries(GROUP).map_err(library)? else {
        return match stated {
            None => Ok(sources),
            Some(_) => Err(damaged(checks, "/checksums", "missing, though / has its checksum")),
        };
    };
    for (name, entry) in &entries {
        if *entry != Entry::Dataset {
            return Err(damaged(checks, &path_of(name), "no data set that can be read"));
        }
        if !info.channels.iter().any(|channel| channel.info.name == *name) {
            return Err(damaged(checks, &path_of(name), "checksums of a channel that is missing"));
        }
    }
    let mut tables = Vec::new();
    for channel in &info.channels {
        if !entries.iter().any(|(name, _)| *name == channel.info.name) {
            return Err(damaged(checks, &path_of(&channel.info.name), "the table is missing"));
        }
        tables.push(table(checks, file, channel)?);
    }
    let finished = tables.iter().filter(|table| table.samples.is_some()).count();
    if finished != 0 && finished != tables.len() {
        let problem = "some channels have the attribute samples here and some have not";
        return Err(damaged(checks, "/checksums", problem));
    }
    check_statement(checks, file, stated, info, (segments, finished != 0))?;
    for channel in &mut info.channels {
        channel.storage.push_str(", checksums");
    }
    Ok(sources.into_iter().zip(tables).map(|(source, table)| checked(source, table)).collect())
}

fn path_of(channel: &str) -> String {
    format!("{GROUP}/{channel}")
}

fn damaged(checks: &Checks<'_>, object: &str, problem: &str) -> CaptureError {
    CaptureError::Integrity {
        file: checks.path.into(),
        object: object.into(),
        problem: problem.into(),
    }
}

/// Opens a channel's table and checks that it fits the channel.
fn table(
    checks: &Checks<'_>,
    file: &File,
    channel: &ChannelDescription,
) -> Result<Table, CaptureError> {
    let path = path_of(&channel.info.name);
    let dataset = file.dataset(&path).map_err(|e| checks.library(&path, e))?;
    let rows = checks.length(&dataset, &path)?;
    checks.storage(&dataset, &path, rows, size_of::<u32>(), &mut Chunks::default())?;
    let block = whole(checks, &dataset, &path, BLOCK)?.filter(|&block| block > 0);
    let Some(block) = block else {
        return Err(damaged(checks, &path, "no attribute block_samples"));
    };
    let samples = whole(checks, &dataset, &path, SAMPLES)?;
    let length = channel.n_samples;
    let problem = match samples {
        Some(samples) if samples != length => {
            format!("for {samples} samples, and /channels/{} has {length}", channel.info.name)
        }
        Some(_) if rows != length.div_ceil(block) => {
            format!("{rows} sums, and {length} samples in blocks of {block} need another number")
        }
        None if rows.saturating_mul(block) > length => {
            format!("{rows} sums of {block} samples, and the channel has only {length}")
        }
        _ => return Ok(Table { dataset, block, rows, samples }),
    };
    Err(damaged(checks, &path, &problem))
}

/// A whole number that is an attribute; `None` if there is none of that name.
fn whole(
    checks: &Checks<'_>,
    dataset: &Dataset,
    path: &str,
    name: &str,
) -> Result<Option<u64>, CaptureError> {
    let expected = "a whole number of samples";
    let limit = if name == BLOCK { BLOCK_SAMPLES_MAX } else { 2_f64.powi(53) };
    match checks.number(dataset, path, name, expected)? {
        None => Ok(None),
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "inside 0 to 2^53"
        )]
        Some(value) if (0.0..=limit).contains(&value) && value.fract() <= 0.0 => {
            Ok(Some(value as u64))
        }
        Some(value) => {
            Err(checks.attribute_error(path, name, value.to_string(), expected.to_owned()))
        }
    }
}

/// Compares what the file states about itself with the sum of what was written.
fn check_statement(
    checks: &Checks<'_>,
    file: &File,
    stated: Option<f64>,
    info: &CaptureInfo,
    (segments, finished): (&Segments, bool),
) -> Result<(), CaptureError> {
    let Some(stated) = stated else {
        // A recording need not have one: its writer may have been killed at any moment.
        let problem = "no attribute checksum, though /checksums is that of a finished capture";
        return if finished { Err(damaged(checks, "/", problem)) } else { Ok(()) };
    };
    let mut statement = Statement::new(
        info.format_stated.then_some(FORMAT),
        info.start_time,
        info.machine.as_deref(),
        info.shaft_speed,
    );
    for channel in &info.channels {
        // Not what an option gave in its stead.
        let path = format!("channels/{}", channel.info.name);
        let dataset = file.dataset(&path).map_err(|e| checks.library(&path, e))?;
        let unit = checks.text(&dataset, &path, "unit")?;
        statement.channel(&ChannelFacts {
            name: &channel.info.name,
            number_type: channel.number_type,
            sample_rate: channel.info.sample_rate,
            unit: unit.as_deref(),
            sensor: channel.sensor.as_deref(),
            scale: channel.scale,
            offset: channel.offset,
        });
    }
    if finished {
        statement.segments(info.segments.map(|_| segments));
    }
    #[expect(clippy::float_cmp, reason = "whole numbers of 32 bits are exact")]
    let agrees = stated == f64::from(statement.sum());
    if agrees {
        return Ok(());
    }
    let problem = "attributes or segments differ from the checksum of what was written";
    Err(damaged(checks, "/", problem))
}

fn checked(source: Source, table: Table) -> Source {
    let verifier = Verifier::new(table.block, source.length, table.rows);
    let (file, object) = (source.file.clone(), source.object.clone());
    let stored = Stored {
        file: file.clone(),
        object: object.replacen("channels", GROUP, 1),
        dataset: table.dataset,
        rows: table.rows,
        first: 0,
        page: Vec::new(),
    };
    let rows = CheckedRows { file, object, inner: source.rows, verifier, stored };
    Source { rows: Box::new(rows), ..source }
}

/// Rows of one channel that are compared with their sums as they are read.
struct CheckedRows {
    file: PathBuf,
    object: String,
    inner: Box<dyn Rows>,
    verifier: Verifier,
    stored: Stored,
}

impl Rows for CheckedRows {
    fn read(&mut self, start: u64, count: u64) -> Result<Vec<RawSamples>, CaptureError> {
        let raw = self.inner.read(start, count)?;
        for column in &raw {
            self.verifier.feed(column, |row| self.stored.get(row)).map_err(
                |refusal| match refusal {
                    Refusal::Unknown(error) => error,
                    Refusal::Differs { first, last } => {
                        let (file, dataset) = (self.file.clone(), self.object.clone());
                        CaptureError::Checksum { file, dataset, first, last }
                    }
                },
            )?;
        }
        Ok(raw)
    }
}

/// The stored sums of one channel, a page at a time.
struct Stored {
    file: PathBuf,
    object: String,
    dataset: Dataset,
    rows: u64,
    /// Number of the first sum of the page.
    first: u64,
    page: Vec<u32>,
}

impl Stored {
    fn get(&mut self, row: u64) -> Result<u32, CaptureError> {
        if row < self.first || row - self.first >= self.page.len() as u64 {
            let count = PAGE_ROWS.min(self.rows.saturating_sub(row));
            let (start, count) = (super::dataset::to_usize(row), super::dataset::to_usize(count));
            let page =
                self.dataset.slice(start, count).map_err(|source| CaptureError::Library {
                    file: self.file.clone(),
                    object: self.object.clone(),
                    source,
                })?;
            (self.first, self.page) = (row, page);
        }
        let at = super::dataset::to_usize(row - self.first);
        self.page.get(at).copied().ok_or_else(|| CaptureError::Integrity {
            file: self.file.clone(),
            object: self.object.clone(),
            problem: format!("sum {row} cannot be read"),
        })
    }
}
