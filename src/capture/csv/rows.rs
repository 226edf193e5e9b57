//! The second pass: numbers of the wanted columns, row by row. A cell that holds none is NaN, and
//! so is counted as rejected by whoever takes the samples.

use super::super::error::CaptureError;
use super::super::received::RawSamples;
use super::super::rows::Rows;
use super::cell;
use super::dialect::Dialect;
use super::records::Records;
use super::survey::{record_error, records};
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// Rows of a text.
pub(super) struct CsvRows {
    path: PathBuf,
    dialect: Dialect,
    /// Column of each channel.
    columns: Vec<usize>,
    /// Opened by the first reading.
    records: Option<Records<BufReader<File>>>,
}

impl CsvRows {
    pub(super) fn new(path: &Path, dialect: Dialect, columns: Vec<usize>) -> Self {
        let dialect = Dialect { first_rows: Vec::new(), ..dialect };
        Self { path: path.into(), dialect, columns, records: None }
    }
}

impl Rows for CsvRows {
    fn read(&mut self, _start: u64, count: u64) -> Result<Vec<RawSamples>, CaptureError> {
        let records = match &mut self.records {
            Some(records) => records,
            None => self.records.insert(records(&self.path, &self.dialect)?),
        };
        let count = usize::try_from(count).unwrap_or(usize::MAX);
        let mut read = vec![Vec::new(); self.columns.len()];
        for _ in 0..count {
            let is_row = records.advance().map_err(|error| record_error(&self.path, error))?;
            if !is_row || records.len() != self.dialect.n_columns {
                break; // The file has changed: too few rows, which the caller tells.
            }
            for (numbers, &column) in read.iter_mut().zip(&self.columns) {
                let number = cell::number(records.cell(column), self.dialect.decimal_comma);
                numbers.push(number.unwrap_or(f64::NAN));
            }
        }
        Ok(read.into_iter().map(RawSamples::F64).collect())
    }
}
