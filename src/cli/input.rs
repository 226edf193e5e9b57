//! Files named on the command line: what kind each is, by its content, and machine files read.

use crate::capture::content;
use crate::capture::content::Content;
use crate::machine::Machine;
use crate::machine::file;
use crate::machine::file::MachineFileErrors;
use std::fs::File;
use std::io;
use std::io::Read;
use std::path::Path;
use std::path::PathBuf;

/// Tables that only a configuration of the daemon has.
const CONFIGURATION_TABLES: [&str; 6] =
    ["server", "store", "pipeline", "diagnosis", "alarms", "source"];

/// What a file is.
#[derive(Debug, Clone, PartialEq)]
pub enum FileKind {
    /// HDF5, WAV, or text with a table of numbers (CSV).
    Capture,
    /// TOML with a table `[machine]`, and its text.
    Machine(String),
    /// TOML with a table `[scene]`, and its text.
    Scene(String),
    /// TOML with a table of the daemon or a list `[[machine]]`.
    Configuration,
    /// None of these: what stands there, and what to do, empty if nothing helps.
    Unknown(&'static str, &'static str),
}

impl FileKind {
    /// Name for people.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Capture => "a capture",
            Self::Machine(_) => "a machine file",
            Self::Scene(_) => "a scene",
            Self::Configuration => "a configuration of the daemon",
            Self::Unknown(what, _) => what,
        }
    }
}

/// Why a file named on the command line is of no use.
#[derive(Debug, thiserror::Error)]
pub enum InputError {
    /// The operating system refused it.
    #[error("{}: cannot be read", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// It is something else.
    #[error("{}: this is {found}, not {wanted}{hint}", file.display())]
    Kind {
        /// The file.
        file: PathBuf,
        /// What it is.
        found: &'static str,
        /// What was expected.
        wanted: &'static str,
        /// What to do; empty or beginning with `: `.
        hint: &'static str,
    },
    /// A file of this program that is not UTF-8.
    #[error("{}:{line}: not UTF-8: byte {byte:#04x}, as in Latin-1; save the file as UTF-8", file.display())]
    NotUtf8 {
        /// The file.
        file: PathBuf,
        /// Number of the line, from 1.
        line: usize,
        /// What stands there.
        byte: u8,
    },
    /// The machine file has mistakes: one line each, with the file's name.
    #[error(transparent)]
    Mistakes(#[from] MachineFileErrors),
}

/// Finds out by its content what a file is. Reads [`file::MAX_TEXT_BYTES`] of it at most.
///
/// # Errors
/// When the file cannot be read.
pub fn kind(path: &Path) -> Result<FileKind, InputError> {
    let mut foreign = None;
    let mut look = || {
        let mut file = File::open(path)?;
        match content::of(&mut file)? {
            Content::Hdf5 | Content::Wav => return Ok(FileKind::Capture),
            Content::Foreign(kind) => return Ok(FileKind::Unknown(kind.name, kind.remedy)),
            Content::Empty => return Ok(FileKind::Unknown("an empty file", "")),
            Content::Binary => return Ok(FileKind::Unknown("a file of an unknown kind", "")),
            Content::Text => {}
        }
        let mut bytes = Vec::new();
        // One more than is read of a machine file, so that a longer one is told so.
        let limit = file::MAX_TEXT_BYTES + 1;
        file.take(limit as u64).read_to_end(&mut bytes)?;
        let kind = kind_of_text(&bytes, bytes.len() < limit);
        foreign = foreign_byte(&bytes, &kind);
        Ok(kind)
    };
    let found = look().map_err(|source| InputError::Read { file: path.to_owned(), source })?;
    match foreign {
        Some((line, byte)) => Err(InputError::NotUtf8 { file: path.to_owned(), line, byte }),
        None => Ok(found),
    }
}

/// Line and value of the first byte that is not UTF-8 in a file that is one of this program by its headings.
fn foreign_byte(bytes: &[u8], kind: &FileKind) -> Option<(usize, u8)> {
    let error = std::str::from_utf8(bytes).err()?;
    let (before, rest) = bytes.split_at(error.valid_up_to());
    let text = String::from_utf8_lossy(bytes);
    let (is_machine, is_configuration) = by_headings(&text);
    let is_ours = is_machine || is_configuration || is_scene(&text);
    let is_told = is_ours && *kind != FileKind::Capture;
    // The end of what is read may cut a character.
    error.error_len().filter(|_| is_told)?;
    Some((before.iter().filter(|byte| **byte == b'\n').count() + 1, *rest.first()?))
}

/// Reads a machine file.
///
/// # Errors
/// When it cannot be read, is something else, or has mistakes (all of them).
pub fn machine(path: &Path) -> Result<Machine, InputError> {
    let wrong = |found: &'static str, hint| InputError::Kind {
        file: path.to_owned(),
        found,
        wanted: "a machine file",
        hint,
    };
    match kind(path)? {
        FileKind::Machine(text) => Ok(file::parse(&text, &path.display().to_string())?),
        FileKind::Capture => {
            Err(wrong(FileKind::Capture.name(), ": captures are named without an option"))
        }
        FileKind::Scene(_) => {
            Err(wrong("a scene", ": `rotorwatch simulate` takes it and writes a capture"))
        }
        FileKind::Configuration => Err(wrong(
            FileKind::Configuration.name(),
            ": name the file that its [[machine]] names, or use `rotorwatch serve`",
        )),
        FileKind::Unknown(found, _) => {
            Err(wrong(found, ": a machine file is TOML with a table [machine] (docs/machines.md)"))
        }
    }
}

/// Says so if `path`, named as a capture, is a file of another kind that is known.
#[must_use]
pub fn not_a_capture(path: &Path) -> Option<InputError> {
    let found = kind(path).ok()?;
    let hint = match found {
        FileKind::Machine(_) => ": name it with --machine",
        FileKind::Configuration => ": `rotorwatch serve --config` takes it",
        FileKind::Scene(_) => ": `rotorwatch simulate` makes a capture of it",
        FileKind::Capture | FileKind::Unknown(..) => return None,
    };
    let (file, found) = (path.to_owned(), found.name());
    Some(InputError::Kind { file, found, wanted: "a capture", hint })
}

/// Tells texts apart: `whole` if the bytes are all of it.
fn kind_of_text(bytes: &[u8], whole: bool) -> FileKind {
    let text = std::str::from_utf8(bytes).unwrap_or_default();
    let (is_machine, is_configuration) = match text.parse::<toml::Table>() {
        Ok(table) => (
            table.get("machine").is_some_and(toml::Value::is_table),
            table.get("machine").is_some_and(toml::Value::is_array)
                || CONFIGURATION_TABLES.iter().any(|name| table.contains_key(*name)),
        ),
        Err(_) => by_headings(text),
    };
    // A scene may hold a table [machine], so it is asked for first.
    if is_scene(text) {
        FileKind::Scene(text.to_owned())
    } else if is_configuration {
        FileKind::Configuration
    } else if is_machine {
        FileKind::Machine(text.to_owned())
    } else if content::is_table(bytes, whole) {
        FileKind::Capture
    } else {
        FileKind::Unknown(
            "a text file without a table [machine], [scene], [server], [pipeline] or [[source]], and without a table of numbers",
            "",
        )
    }
}

/// Whether a text has the table `[scene]`, right TOML or not.
fn is_scene(text: &str) -> bool {
    text.lines().any(|line| line.trim_start().starts_with("[scene]"))
}

/// What the headings of broken TOML say: whether it is a machine file, whether a configuration.
fn by_headings(text: &str) -> (bool, bool) {
    let headings = || text.lines().map(str::trim_start).filter(|line| line.starts_with('['));
    let begins = |heading: &str| headings().any(|line| line.starts_with(heading));
    let configuration = begins("[[machine]]")
        || CONFIGURATION_TABLES
            .iter()
            .any(|name| begins(&format!("[{name}]")) || begins(&format!("[[{name}]]")));
    (begins("[machine]"), configuration)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kind_of(content: &[u8]) -> FileKind {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("file");
        std::fs::write(&path, content).unwrap();
        kind(&path).unwrap()
    }

    #[test]
    fn content_decides() {
        assert_eq!(kind_of(b"\x89HDF\r\n\x1a\n...."), FileKind::Capture);
        assert_eq!(kind_of(b"RIFF\x24\0\0\0WAVEfmt "), FileKind::Capture);
        assert_eq!(kind_of(b"a,b\n1,2\n3,4\n"), FileKind::Capture);
        assert_eq!(kind_of(b"n;\xb5m\n1,5;2\n2,5;4\n"), FileKind::Capture);
        assert!(matches!(kind_of(b"[machine]\nid = 'm'\n"), FileKind::Machine(_)));
        assert!(matches!(kind_of(b"machine.id = 'm'\n"), FileKind::Machine(_)));
        assert_eq!(kind_of(b"[[machine]]\nfile = 'm.toml'\n"), FileKind::Configuration);
        assert_eq!(kind_of(b"[alarms]\n"), FileKind::Configuration);
        assert!(matches!(kind_of(b"[scene]\n[machine]\nfile = 'm'\n"), FileKind::Scene(_)));
        for unknown in [&b""[..], b"\0\0", b"\xff\xfe", b"a,b\nc,d\n", b"[tool]\n"] {
            assert!(matches!(kind_of(unknown), FileKind::Unknown(..)), "{unknown:?}");
        }
    }

    #[test]
    fn a_file_of_this_program_that_is_not_utf_8_is_told_with_its_line() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("rig.toml");
        let text = b"[machine]\nid = 'm'\nname = 'Pr\xfcfstand'\n";
        for begin in [&b""[..], b"[scene]\n", b"[[source]]\n"] {
            std::fs::write(&path, [begin, text].concat()).unwrap();
            let line = if begin.is_empty() { 3 } else { 4 };
            let told = format!("rig.toml:{line}: not UTF-8: byte 0xfc");
            for error in [kind(&path).unwrap_err(), machine(&path).unwrap_err()] {
                assert!(error.to_string().contains(&told), "{error}");
            }
        }
    }

    #[test]
    fn broken_toml_is_known_by_its_headings() {
        assert!(matches!(kind_of(b"[machine]\nid = = 1\n"), FileKind::Machine(_)));
        assert_eq!(kind_of(b"x = = 1\n[[source]] # where\n"), FileKind::Configuration);
    }

    #[test]
    fn a_file_given_for_another_is_told_what_to_do() {
        let dir = tempfile::tempdir().unwrap();
        let capture = dir.path().join("x.h5");
        std::fs::write(&capture, b"\x89HDF\r\n\x1a\n").unwrap();
        let text = machine(&capture).unwrap_err().to_string();
        assert!(
            text.ends_with(
                "x.h5: this is a capture, not a machine file: captures are named without an option"
            ),
            "{text}"
        );
        let rig = dir.path().join("rig.toml");
        std::fs::write(&rig, "[machine]\nid = 'm'\n").unwrap();
        let text = not_a_capture(&rig).unwrap().to_string();
        assert!(text.ends_with("not a capture: name it with --machine"), "{text}");
        assert!(not_a_capture(&capture).is_none());
        assert!(matches!(kind(dir.path()), Err(InputError::Read { .. })));
    }
}
