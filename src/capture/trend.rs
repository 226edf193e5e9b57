//! Writes trends as HDF5: a group a machine, in it one a channel or component, a data set a feature.
//!
//! Not a capture: nothing of ours reads it again. Complete under its name or not there at all.

use super::error::{CaptureError, LibraryError};
use super::hdf5::{NewFile, NewGroup, NewStorage};
use std::collections::BTreeMap;
use std::fs::{self, OpenOptions};
use std::path::{Path, PathBuf};

/// Values of a compressed chunk.
const CHUNK: usize = 16_384;

/// Level of gzip.
const LEVEL: u32 = 4;

/// One feature over time.
#[derive(Debug, Clone, Copy)]
pub struct TrendColumn<'a> {
    /// Name.
    pub name: &'a str,
    /// Unit.
    pub unit: &'a str,
    /// Values, NaN where there is none.
    pub value: &'a [f32],
    /// Smallest values of minutes or hours, or nothing.
    pub low: &'a [f32],
    /// Largest values of minutes or hours, or nothing.
    pub high: &'a [f32],
}

/// A file of trends being written.
pub struct TrendWriter {
    path: PathBuf,
    temporary: PathBuf,
    file: Option<NewFile>,
    machines: BTreeMap<String, NewGroup>,
}

impl std::fmt::Debug for TrendWriter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TrendWriter").field("path", &self.path).finish_non_exhaustive()
    }
}

impl TrendWriter {
    /// Starts a file that will replace `path`.
    ///
    /// # Errors
    /// [`CaptureError::Write`] if the folder cannot be written.
    pub fn create(path: &Path, tier: &str) -> Result<Self, CaptureError> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let temporary = path.with_file_name(format!(".{name}.{}.part", std::process::id()));
        let (path, machines) = (path.to_owned(), BTreeMap::new());
        let mut writer = Self { path, temporary, file: None, machines };
        let done = NewFile::create(&writer.temporary).and_then(|file| {
            file.text("format", "rotorwatch-trends")?;
            file.number("version", 1_i64)?;
            file.text("tier", tier)?;
            Ok(file)
        });
        writer.file = Some(done.map_err(|source| writer.failed("the file", source))?);
        Ok(writer)
    }

    /// Adds a channel or component of a machine: kind and name, times in seconds since 1970, columns as
    /// long as they.
    ///
    /// # Errors
    /// [`CaptureError::Write`] if the disk or the library refuses.
    pub fn subject(
        &mut self,
        machine: &str,
        (kind, name): (&str, &str),
        time_s: &[f64],
        columns: &[TrendColumn<'_>],
    ) -> Result<(), CaptureError> {
        let object = format!("{machine}/{kind} {name}");
        self.write(machine, (kind, name), time_s, columns)
            .map_err(|source| self.failed(&object, source))
    }

    fn write(
        &mut self,
        machine: &str,
        (kind, name): (&str, &str),
        time_s: &[f64],
        columns: &[TrendColumn<'_>],
    ) -> Result<(), LibraryError> {
        let Some(file) = &self.file else { return Ok(()) };
        if !self.machines.contains_key(machine) {
            let group = file.group(&plain(machine))?;
            group.text("machine", machine)?;
            self.machines.insert(machine.to_owned(), group);
        }
        let Some(group) = self.machines.get(machine) else { return Ok(()) };
        let group = group.group(&plain(&format!("{kind} {name}")))?;
        group.text("kind", kind)?;
        group.text("name", name)?;
        let storage = NewStorage { compressed: Some((CHUNK, LEVEL)), ..NewStorage::default() };
        let times = group.dataset("time_s", time_s, storage)?;
        times.text("unit", "s since 1970-01-01T00:00:00Z")?;
        for column in columns {
            let parts = [("", column.value), (".low", column.low), (".high", column.high)];
            for (end, values) in parts {
                if values.len() == time_s.len() {
                    let name = plain(&format!("{}{end}", column.name));
                    group.dataset(&name, values, storage)?.text("unit", column.unit)?;
                }
            }
        }
        Ok(())
    }

    /// Completes the file, waits until it is on the disk and gives it its name.
    ///
    /// # Errors
    /// [`CaptureError::Write`] or [`CaptureError::Io`]; an older file of that name is then untouched.
    pub fn finish(mut self) -> Result<(), CaptureError> {
        self.machines.clear();
        if let Some(file) = self.file.take() {
            file.close().map_err(|source| self.failed("the file", source))?;
        }
        let io = |action| {
            let file = self.path.clone();
            move |source| CaptureError::Io { file, action, source }
        };
        let sync = OpenOptions::new().read(true).open(&self.temporary).and_then(|f| f.sync_all());
        sync.map_err(io("flush it to the disk"))?;
        fs::rename(&self.temporary, &self.path).map_err(io("give it its name"))
    }

    fn failed(&self, object: &str, source: LibraryError) -> CaptureError {
        CaptureError::Write { file: self.path.clone(), object: object.into(), source }
    }
}

impl Drop for TrendWriter {
    /// Removes the temporary file; after [`TrendWriter::finish`] there is none.
    fn drop(&mut self) {
        self.machines.clear();
        drop(self.file.take());
        let _usually_gone = fs::remove_file(&self.temporary);
    }
}

/// A name that is no path.
fn plain(name: &str) -> String {
    name.replace('/', "_")
}
