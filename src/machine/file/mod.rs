//! The machine file: TOML text in, validated [`Machine`] or every mistake out.
//!
//! The document is walked by hand, with the place of every value, so that all mistakes are
//! reported at once, each with line, key, what was found and what is allowed. Reads text, never
//! a file. Keys and their ranges: `docs/machines.md`.
//!
//! `errors` holds the mistakes, `range` words what is allowed, `reader` takes values
//! out of tables, `general`, `train` and `sensors` know the keys. The simulator's scene files are
//! read with the same `errors`, `range` and `reader`.

pub(crate) mod errors;
pub(crate) mod range;
pub(crate) mod reader;
pub(crate) mod general;
mod limits;
mod parts;
mod sensors;

pub use errors::{MachineFileErrors, Mistake};

use errors::Log;
use reader::Section;
use toml::de::DeTable;

use super::Machine;

/// Longest machine file that is read, bytes.
pub const MAX_TEXT_BYTES: usize = 1_000_000;

/// Most tables of one kind (`[[shaft]]`, `[[bearing]]`, …).
pub const MAX_TABLES: usize = 1000;

/// Longest text in which the parser looks for more than the first syntax error, bytes: every error
/// it keeps takes some hundred bytes.
const MAX_RECOVERY_BYTES: usize = 100_000;

/// Reads the text of a machine file; `file_name` only labels the mistakes.
///
/// # Errors
///
/// Every mistake of the file, in the order of their places. After a syntax error the rest of the
/// file is still judged, except for what the broken line may have taken away: missing keys,
/// references and ratios.
///
/// # Examples
///
/// ```
/// use rotorwatch::machine::file;
///
/// let text = "[machine]\nid = 'rig'\n[[shaft]]\nid = 'main'\nspeed_hz = -3\n";
/// let errors = file::parse(text, "rig.toml").unwrap_err();
/// assert_eq!(
///     errors.to_string(),
///     "rig.toml:5:12: shaft[0].speed_hz: found -3, allowed: a number above 0 and up to 10000"
/// );
/// ```
pub fn parse(text: &str, file_name: &str) -> Result<Machine, MachineFileErrors> {
    let mut log = Log::new(text, file_name, "a machine file");
    if text.len() > MAX_TEXT_BYTES {
        log.report(
            0,
            String::new(),
            format!("{} bytes", text.len()),
            format!("up to {MAX_TEXT_BYTES} bytes"),
        );
        return Err(log.into_errors());
    }
    let document = match parse_document(text, &mut log) {
        Some(document) => document,
        None => return Err(log.into_errors()),
    };
    let machine = general::read(Section::root(&document, &log));
    match machine {
        Some(machine) if log.is_empty() => {
            let notes = log.into_notes();
            Ok(Machine { notes, ..machine })
        }
        _ => Err(log.into_errors()),
    }
}

/// Parses the TOML and notes its syntax errors; `None` when nothing is left to judge.
pub(crate) fn parse_document<'t>(text: &'t str, log: &mut Log<'t>) -> Option<DeTable<'t>> {
    let (document, errors) = if text.len() > MAX_RECOVERY_BYTES {
        match DeTable::parse(text) {
            Ok(document) => (Some(document.into_inner()), Vec::new()),
            Err(error) => (None, vec![error]),
        }
    } else {
        let (document, errors) = DeTable::parse_recoverable(text);
        (Some(document.into_inner()), errors)
    };
    for error in errors {
        let at = error.span().map_or(text.len(), |span| span.start);
        log.syntax(at, error.message());
    }
    document
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod limits_tests;
