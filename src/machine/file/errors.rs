//! The mistakes of a machine file and the log that gathers them.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fmt;
use std::ops::Range;

/// Most mistakes kept; further ones are counted.
const MAX_MISTAKES: usize = 200;

/// Longest excerpt of the file in a message, characters.
const MAX_EXCERPT_CHARS: usize = 60;

/// One mistake.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Mistake {
    /// Line, from 1.
    pub line: usize,
    /// Column, from 1, in characters.
    pub column: usize,
    /// Where in the document, e.g. `bearing[0].elements`; empty for the file as a whole.
    pub path: String,
    /// What stands there.
    pub found: String,
    /// What may stand there.
    pub allowed: String,
}

/// Every mistake of a machine file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MachineFileErrors {
    /// Name of the file as given to the reader.
    pub file_name: String,
    /// The mistakes, by place; never empty.
    pub mistakes: Vec<Mistake>,
    /// Mistakes beyond those kept.
    pub n_omitted: usize,
}

impl fmt::Display for Mistake {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{}:{}: ", self.line, self.column)?;
        if !self.path.is_empty() {
            write!(out, "{}: ", self.path)?;
        }
        write!(out, "found {}, allowed: {}", self.found, self.allowed)
    }
}

/// One line per mistake, `file:line:column: path: found …, allowed: …`; no line break at the end.
impl fmt::Display for MachineFileErrors {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, mistake) in self.mistakes.iter().enumerate() {
            let separator = if index == 0 { "" } else { "\n" };
            write!(out, "{separator}{}:{mistake}", self.file_name)?;
        }
        if self.n_omitted > 0 {
            write!(out, "\n{}: and {} more mistakes", self.file_name, self.n_omitted)?;
        }
        Ok(())
    }
}

impl std::error::Error for MachineFileErrors {}

/// Gathers mistakes and notes while the document is walked.
///
/// Shared by all sections, hence the inner mutability; never borrowed across a call.
pub(crate) struct Log<'t> {
    text: &'t str,
    file_name: &'t str,
    /// What the document is: `a machine file`.
    kind: &'static str,
    /// Byte offset at which each line begins.
    line_starts: Vec<usize>,
    /// Lines with a syntax error; what else they seem to say is not to be trusted.
    broken_lines: BTreeSet<usize>,
    gathered: RefCell<Gathered>,
}

#[derive(Default)]
struct Gathered {
    mistakes: Vec<Mistake>,
    n_omitted: usize,
    notes: Vec<String>,
}

impl<'t> Log<'t> {
    pub(crate) fn new(text: &'t str, file_name: &'t str, kind: &'static str) -> Self {
        let line_starts =
            std::iter::once(0).chain(text.match_indices('\n').map(|(at, _)| at + 1)).collect();
        let (broken_lines, gathered) = Default::default();
        Self { text, file_name, kind, line_starts, broken_lines, gathered }
    }

    /// Notes a mistake at a byte offset.
    pub(crate) fn report(
        &self,
        at: usize,
        path: String,
        found: impl Into<String>,
        allowed: impl Into<String>,
    ) {
        let (line, column) = self.place(at);
        if self.broken_lines.contains(&line) {
            return;
        }
        self.keep(Mistake { line, column, path, found: found.into(), allowed: allowed.into() });
    }

    /// Notes a mistake that a syntax error elsewhere may have caused: a missing key, an unknown
    /// reference, a contradiction. Silent when there is any.
    pub(crate) fn report_derived(
        &self,
        at: usize,
        path: String,
        found: impl Into<String>,
        allowed: impl Into<String>,
    ) {
        if self.broken_lines.is_empty() {
            self.report(at, path, found, allowed);
        }
    }

    /// Notes a syntax error.
    pub(crate) fn syntax(&mut self, at: usize, message: &str) {
        let (line, column) = self.place(at);
        let found = format!("broken TOML ({})", one_line(message));
        let allowed = "a TOML document".to_owned();
        self.keep(Mistake { line, column, path: String::new(), found, allowed });
        self.broken_lines.insert(line);
    }

    /// Notes a remark that is no mistake.
    pub(crate) fn note(&self, at: usize, path: &str, remark: &str) {
        let (line, _) = self.place(at);
        self.gathered.borrow_mut().notes.push(format!("line {line}: {path}: {remark}"));
    }

    /// The text of a value as written, shortened.
    pub(crate) fn excerpt(&self, span: Range<usize>) -> String {
        one_line(self.text.get(span).unwrap_or_default())
    }

    /// Line of a byte offset, from 1.
    pub(crate) fn line(&self, at: usize) -> usize {
        self.place(at).0
    }

    /// What the document is.
    pub(crate) fn kind(&self) -> &'static str {
        self.kind
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.gathered.borrow().mistakes.is_empty()
    }

    pub(crate) fn into_notes(self) -> Vec<String> {
        self.gathered.into_inner().notes
    }

    pub(crate) fn into_errors(self) -> MachineFileErrors {
        let Gathered { mut mistakes, n_omitted, .. } = self.gathered.into_inner();
        mistakes.sort();
        mistakes.dedup();
        MachineFileErrors { file_name: self.file_name.to_owned(), mistakes, n_omitted }
    }

    fn keep(&self, mistake: Mistake) {
        let mut gathered = self.gathered.borrow_mut();
        if gathered.mistakes.len() < MAX_MISTAKES {
            gathered.mistakes.push(mistake);
        } else {
            gathered.n_omitted += 1;
        }
    }

    /// Line and column of a byte offset, both from 1.
    pub(crate) fn place(&self, at: usize) -> (usize, usize) {
        let line = self.line_starts.partition_point(|&start| start <= at).max(1);
        let before = self.text.get(self.line_starts[line - 1]..at).unwrap_or_default();
        (line, before.chars().count() + 1)
    }
}

/// Puts text of the file on one short line: control characters escaped, the rest cut.
pub(crate) fn one_line(text: &str) -> String {
    let mut line = String::new();
    for (n, char) in text.chars().enumerate() {
        if n == MAX_EXCERPT_CHARS {
            line.push('…');
            break;
        }
        if char.is_control() { line.extend(char.escape_default()) } else { line.push(char) }
    }
    line
}
