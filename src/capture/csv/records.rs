//! Lines of a text as cells: bounded whatever the text says.

use csv_core::{ReadRecordResult, Reader, ReaderBuilder};
use std::io::{self, BufRead};

/// Bytes of a line's cells at most.
pub(super) const LINE_BYTES_MAX: usize = 1 << 20;

/// Cells of a line at most.
pub(super) const COLUMNS_MAX: usize = 1024;

/// Blanks that may separate the cells of a line, if blanks do.
const BLANKS_MAX: usize = 32 * COLUMNS_MAX;

/// Why a line could not be read.
#[derive(Debug)]
pub(super) enum RecordError {
    Io(io::Error),
    /// The line of this number has too many bytes.
    TooLong(u64),
    /// The line of this number has too many cells.
    TooWide(u64),
}

/// The cells of one line after another; blank lines are passed over.
pub(super) struct Records<R> {
    input: R,
    core: Reader,
    /// Whether runs of blanks separate, so that there are no empty cells.
    by_blanks: bool,
    text: Vec<u8>,
    ends: Vec<usize>,
    /// Of the line at hand, begin and end of each cell.
    cells: Vec<(usize, usize)>,
    line: u64,
}

impl<R: BufRead> Records<R> {
    /// Reads cells separated by `separator`; `first_line` is the number of the input's first line.
    pub(super) fn new(input: R, separator: u8, first_line: u64) -> Self {
        let mut core = ReaderBuilder::new().delimiter(separator).build();
        core.set_line(first_line);
        let by_blanks = separator == b' ';
        let n_ends = if by_blanks { BLANKS_MAX } else { COLUMNS_MAX + 1 };
        let (text, ends, cells) = (vec![0; 64 << 10], vec![0; n_ends], Vec::new());
        Self { input, core, by_blanks, text, ends, cells, line: first_line }
    }

    /// Reads the next line that is not blank; `false` at the end.
    pub(super) fn advance(&mut self) -> Result<bool, RecordError> {
        while self.read()? {
            let is_blank =
                self.cells.is_empty() || self.cells.len() == 1 && self.cell(0).is_empty();
            if !is_blank {
                return Ok(true);
            }
        }
        Ok(false)
    }

    fn read(&mut self) -> Result<bool, RecordError> {
        let (mut n_text, mut n_ends) = (0, 0);
        let mut last_byte = 0;
        loop {
            let input = self.input.fill_buf().map_err(RecordError::Io)?;
            let (text, ends) = (&mut self.text[n_text..], &mut self.ends[n_ends..]);
            let (result, n_in, more_text, more_ends) = self.core.read_record(input, text, ends);
            if n_in > 0 {
                last_byte = input[n_in - 1];
            }
            self.input.consume(n_in);
            n_text += more_text;
            n_ends += more_ends;
            match result {
                ReadRecordResult::InputEmpty => {}
                ReadRecordResult::OutputFull if self.text.len() >= LINE_BYTES_MAX => {
                    return Err(RecordError::TooLong(self.core.line()));
                }
                ReadRecordResult::OutputFull => self.text.resize(2 * self.text.len(), 0),
                ReadRecordResult::OutputEndsFull => {
                    return Err(RecordError::TooWide(self.core.line()));
                }
                ReadRecordResult::Record => {
                    // The line feed that ends a line is counted already.
                    self.line = self.core.line() - u64::from(last_byte == b'\n');
                    self.set_cells(n_ends);
                    return if self.by_blanks && self.cells.len() > COLUMNS_MAX {
                        Err(RecordError::TooWide(self.line))
                    } else {
                        Ok(true)
                    };
                }
                ReadRecordResult::End => return Ok(false),
            }
        }
    }

    fn set_cells(&mut self, n_ends: usize) {
        self.cells.clear();
        let mut begin = 0;
        for &end in &self.ends[..n_ends] {
            if !self.by_blanks || end > begin {
                self.cells.push((begin, end));
            }
            begin = end;
        }
    }

    /// Number of the line at hand.
    pub(super) fn line(&self) -> u64 {
        self.line
    }

    /// Number of its cells.
    pub(super) fn len(&self) -> usize {
        self.cells.len()
    }

    /// A cell without outer blanks; empty past the last.
    pub(super) fn cell(&self, at: usize) -> &[u8] {
        match self.cells.get(at) {
            Some(&(begin, end)) => self.text[begin..end].trim_ascii(),
            None => &[],
        }
    }
}

/// The cells of one line alone.
pub(super) fn cells_of(line: &[u8], separator: u8) -> Option<Vec<Vec<u8>>> {
    if line.contains(&b'"') {
        let mut records = Records::new(line, separator, 1);
        let found = records.advance().ok()?;
        let cells = || (0..records.len()).map(|at| records.cell(at).to_vec()).collect();
        return found.then(cells);
    }
    let by_blanks = separator == b' ';
    let cells = line.split(|&byte| byte == separator);
    let cells = cells.map(<[u8]>::trim_ascii).filter(|cell| !by_blanks || !cell.is_empty());
    let cells: Vec<Vec<u8>> = cells.take(COLUMNS_MAX + 1).map(<[u8]>::to_vec).collect();
    (cells.len() <= COLUMNS_MAX).then_some(cells)
}
