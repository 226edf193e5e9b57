//! Files named on the command line: what kind each is, by its content, and machine files read.

use crate::machine::Machine;
use crate::machine::file;
use crate::machine::file::MachineFileErrors;
use std::fs::File;
use std::io;
use std::io::Read;
use std::io::Seek;
use std::io::SeekFrom;
use std::path::Path;
use std::path::PathBuf;

/// First bytes of an HDF5 superblock.
const HDF5_SIGNATURE: [u8; 8] = *b"\x89HDF\r\n\x1a\n";

/// Tables that only a configuration of the daemon has.
const CONFIGURATION_TABLES: [&str; 5] = ["server", "store", "pipeline", "alarms", "source"];

/// What a file is.
#[derive(Debug, Clone, PartialEq)]
pub enum FileKind {
    /// HDF5.
    Capture,
    /// TOML with a table `[machine]`, and its text.
    Machine(String),
    /// TOML with a table `[scene]`, and its text.
    Scene(String),
    /// TOML with a table of the daemon or a list `[[machine]]`.
    Configuration,
    /// None of these, and what stands there.
    Unknown(&'static str),
}

impl FileKind {
    /// Name for people.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Capture => "a capture (HDF5)",
            Self::Machine(_) => "a machine file",
            Self::Scene(_) => "a scene",
            Self::Configuration => "a configuration of the daemon",
            Self::Unknown(what) => what,
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
    /// The machine file has mistakes: one line each, with the file's name.
    #[error(transparent)]
    Mistakes(#[from] MachineFileErrors),
}

/// Finds out by its content what a file is. Reads [`file::MAX_TEXT_BYTES`] of it at most.
///
/// # Errors
/// When the file cannot be read.
pub fn kind(path: &Path) -> Result<FileKind, InputError> {
    let look = || {
        let mut file = File::open(path)?;
        if file.metadata()?.is_dir() {
            return Err(io::Error::new(io::ErrorKind::IsADirectory, "is a directory"));
        }
        if has_hdf5_signature(&mut file)? {
            return Ok(FileKind::Capture);
        }
        file.rewind()?;
        let mut bytes = Vec::new();
        // One more than is read of a machine file, so that a longer one is told so.
        file.take(file::MAX_TEXT_BYTES as u64 + 1).read_to_end(&mut bytes)?;
        Ok(kind_of_text(bytes))
    };
    look().map_err(|source| InputError::Read { file: path.to_owned(), source })
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
        FileKind::Unknown(found) => {
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
        FileKind::Capture | FileKind::Unknown(_) => return None,
    };
    let (file, found) = (path.to_owned(), found.name());
    Some(InputError::Kind { file, found, wanted: "a capture", hint })
}

/// Whether an HDF5 superblock stands at 0, or at 512 doubled repeatedly behind a user block.
fn has_hdf5_signature(file: &mut File) -> io::Result<bool> {
    let length = file.metadata()?.len();
    let mut at = 0_u64;
    while at.saturating_add(8) <= length {
        let mut found = [0; 8];
        file.seek(SeekFrom::Start(at))?;
        file.read_exact(&mut found)?;
        if found == HDF5_SIGNATURE {
            return Ok(true);
        }
        at = if at == 0 { 512 } else { at.saturating_mul(2) };
    }
    Ok(false)
}

fn kind_of_text(bytes: Vec<u8>) -> FileKind {
    if bytes.is_empty() {
        return FileKind::Unknown("an empty file");
    }
    let text = match String::from_utf8(bytes) {
        Ok(text) if !text.contains('\0') => text,
        Ok(_) | Err(_) => return FileKind::Unknown("a file that is neither HDF5 nor text"),
    };
    let (is_machine, is_configuration) = match text.parse::<toml::Table>() {
        Ok(table) => (
            table.get("machine").is_some_and(toml::Value::is_table),
            table.get("machine").is_some_and(toml::Value::is_array)
                || CONFIGURATION_TABLES.iter().any(|name| table.contains_key(*name)),
        ),
        Err(_) => by_headings(&text),
    };
    // A scene may hold a table [machine], so it is asked for first.
    if is_scene(&text) {
        FileKind::Scene(text)
    } else if is_configuration {
        FileKind::Configuration
    } else if is_machine {
        FileKind::Machine(text)
    } else {
        FileKind::Unknown(
            "a text file without a table [machine], [scene], [server], [pipeline] or [[source]]",
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
        let mut behind = vec![0; 1024];
        behind.extend(HDF5_SIGNATURE);
        assert_eq!(kind_of(&behind), FileKind::Capture);
        assert!(matches!(kind_of(b"[machine]\nid = 'm'\n"), FileKind::Machine(_)));
        assert!(matches!(kind_of(b"machine.id = 'm'\n"), FileKind::Machine(_)));
        assert_eq!(kind_of(b"[[machine]]\nfile = 'm.toml'\n"), FileKind::Configuration);
        assert_eq!(kind_of(b"[alarms]\n"), FileKind::Configuration);
        assert!(matches!(kind_of(b"[scene]\n[machine]\nfile = 'm'\n"), FileKind::Scene(_)));
        for unknown in [&b""[..], b"\0\0", b"\xff\xfe", b"a,b\n1,2\n", b"[tool]\n"] {
            assert!(matches!(kind_of(unknown), FileKind::Unknown(_)), "{unknown:?}");
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
        std::fs::write(&capture, HDF5_SIGNATURE).unwrap();
        let text = machine(&capture).unwrap_err().to_string();
        assert!(text.ends_with("x.h5: this is a capture (HDF5), not a machine file: captures are named without an option"), "{text}");
        let rig = dir.path().join("rig.toml");
        std::fs::write(&rig, "[machine]\nid = 'm'\n").unwrap();
        let text = not_a_capture(&rig).unwrap().to_string();
        assert!(text.ends_with("not a capture: name it with --machine"), "{text}");
        assert!(not_a_capture(&capture).is_none());
        assert!(matches!(kind(dir.path()), Err(InputError::Read { .. })));
    }
}
