//! Where results go: stdout, or a file that is complete under its name or not there at all.

use crate::config::Config;
use std::fs;
use std::fs::File;
use std::fs::Permissions;
use std::io;
use std::io::Write;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::path::PathBuf;
use tempfile::NamedTempFile;

/// Why results could not be written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// The disk or device refuses.
    #[error("{target}: cannot be written")]
    Write {
        /// Where to.
        target: String,
        /// Why not.
        source: io::Error,
    },
    /// It is one of the command's own files.
    #[error("{}: --out would replace a file that is read; choose another name", file.display())]
    Overwrites {
        /// As given.
        file: PathBuf,
    },
    /// Only the daemon writes there.
    #[error("{}: --out is inside the store's folder {}; choose another place", file.display(), store.display())]
    InStore {
        /// As given.
        file: PathBuf,
        /// The folder.
        store: PathBuf,
    },
}

/// What results never replace: every file that is read, and whatever is in the store's folder.
#[derive(Debug, Clone, Default)]
pub struct Spared {
    files: Vec<PathBuf>,
    store: Option<PathBuf>,
}

impl Spared {
    /// For a command that reads no file.
    #[must_use]
    pub fn nothing() -> Self {
        Self::default()
    }

    /// Everything that a configuration names, and its store.
    #[must_use]
    pub fn of(config: &Config) -> Self {
        let store = Some(config.store.directory.clone());
        Self { files: config.inputs().map(Path::to_owned).collect(), store }
    }

    /// These files, too.
    #[must_use]
    pub fn and<P: AsRef<Path>>(mut self, files: impl IntoIterator<Item = P>) -> Self {
        self.files.extend(files.into_iter().map(|file| file.as_ref().to_owned()));
        self
    }

    /// Refuses a file that is one of these or in the store, by whatever name or link.
    ///
    /// # Errors
    /// With what it would harm.
    pub fn refuse(&self, out: &Path) -> Result<(), OutputError> {
        if fs::metadata(out).is_ok_and(|found| !found.is_file()) {
            return Ok(()); // A device holds nothing; a folder is refused by whoever opens it.
        }
        let (file, place) = (out.to_owned(), resolved(out));
        if self.files.iter().any(|spared| resolved(spared) == place) {
            return Err(OutputError::Overwrites { file });
        }
        match &self.store {
            Some(store) if place.starts_with(resolved(store)) => {
                Err(OutputError::InStore { file, store: store.clone() })
            }
            Some(_) | None => Ok(()),
        }
    }
}

/// A path without links, also of a file that is not there yet.
fn resolved(path: &Path) -> PathBuf {
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        Some(_) | None => Path::new("."),
    };
    let beside = || Some(fs::canonicalize(folder).ok()?.join(path.file_name()?));
    fs::canonicalize(path).ok().or_else(beside).unwrap_or_else(|| path.to_owned())
}

/// Takes texts and puts them where they belong.
#[derive(Debug)]
pub struct Output {
    target: Target,
    name: String,
}

#[derive(Debug)]
enum Target {
    Stdout,
    /// Nobody reads stdout any more.
    Closed,
    /// A terminal, pipe or device.
    Device(File),
    /// A file with a temporary name, and the name it will get.
    File(NamedTempFile, PathBuf),
}

impl Output {
    /// Stdout.
    #[must_use]
    pub fn stdout() -> Self {
        Self { target: Target::Stdout, name: "stdout".to_owned() }
    }

    /// Opens stdout, or what `out` names unless that is spared. An existing file is replaced only by
    /// [`Output::finish`].
    ///
    /// # Errors
    /// When a file is not to be written there, or cannot be created.
    pub fn open(out: Option<&Path>, spared: &Spared) -> Result<Self, OutputError> {
        let Some(out) = out else { return Ok(Self::stdout()) };
        spared.refuse(out)?;
        let name = out.display().to_string();
        match target(out) {
            Ok(target) => Ok(Self { target, name }),
            Err(source) => Err(OutputError::Write { target: name, source }),
        }
    }

    /// Writes a text and hands it on at once. A reader of stdout that is gone is no error.
    ///
    /// # Errors
    /// When the disk or device refuses it.
    pub fn write(&mut self, text: &str) -> Result<(), OutputError> {
        let bytes = text.as_bytes();
        let written = match &mut self.target {
            Target::Stdout => {
                let mut stdout = io::stdout().lock();
                stdout.write_all(bytes).and_then(|()| stdout.flush())
            }
            Target::Closed => Ok(()),
            Target::Device(file) => file.write_all(bytes),
            Target::File(file, _) => file.write_all(bytes),
        };
        match written {
            Err(error) if self.is_stdout() && error.kind() == io::ErrorKind::BrokenPipe => {
                self.target = Target::Closed;
                Ok(())
            }
            Err(source) => Err(OutputError::Write { target: self.name.clone(), source }),
            Ok(()) => Ok(()),
        }
    }

    /// Whether the reader of stdout is gone.
    #[must_use]
    pub fn is_closed(&self) -> bool {
        matches!(self.target, Target::Closed)
    }

    /// Whether texts go to stdout.
    #[must_use]
    pub fn is_stdout(&self) -> bool {
        matches!(self.target, Target::Stdout | Target::Closed)
    }

    /// Gives the file its name, once it is on the disk. Without it nothing remains.
    ///
    /// # Errors
    /// When the disk refuses; an older file of that name is then untouched.
    pub fn finish(self) -> Result<(), OutputError> {
        let Target::File(file, name) = self.target else { return Ok(()) };
        let named = file
            .as_file()
            .sync_all()
            .and_then(|()| file.persist(name).map_err(|error| error.error));
        named.map(|_| ()).map_err(|source| OutputError::Write { target: self.name, source })
    }
}

fn target(out: &Path) -> io::Result<Target> {
    // Through a link its file is replaced, not the link.
    let name = fs::canonicalize(out).unwrap_or_else(|_| out.to_owned());
    match fs::metadata(&name) {
        Ok(found) if found.is_dir() => {
            return Err(io::Error::new(io::ErrorKind::IsADirectory, "is a directory"));
        }
        Ok(found) if !found.is_file() => {
            return File::options().write(true).open(&name).map(Target::Device);
        }
        Ok(_) | Err(_) => {}
    }
    let folder = match name.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        Some(_) | None => Path::new("."),
    };
    let hidden = format!(".{}.", name.file_name().unwrap_or_default().display());
    // As any new file: what the user's mask leaves.
    let permissions = Permissions::from_mode(0o666);
    let mut builder = tempfile::Builder::new();
    let builder = builder.prefix(&hidden).suffix(".part").permissions(permissions);
    builder.tempfile_in(folder).map(|file| Target::File(file, name))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(dir: &Path) -> Vec<String> {
        let entries = fs::read_dir(dir).unwrap();
        entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_file_appears_when_it_is_complete() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("out.json");
        fs::write(&path, "old").unwrap();
        let mut output = Output::open(Some(&path), &Spared::nothing()).unwrap();
        output.write("one\n").unwrap();
        output.write("two\n").unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "old");
        output.finish().unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "one\ntwo\n");
        assert_eq!(names(dir.path()), ["out.json"]);
    }

    #[test]
    fn nothing_remains_of_what_was_not_finished() {
        let dir = tempfile::tempdir().unwrap();
        let mut output =
            Output::open(Some(&dir.path().join("out.json")), &Spared::nothing()).unwrap();
        output.write("one\n").unwrap();
        drop(output);
        assert!(names(dir.path()).is_empty());
    }

    #[test]
    fn a_folder_that_is_missing_or_in_the_way_is_named() {
        let dir = tempfile::tempdir().unwrap();
        for path in [dir.path().join("no/out.json"), dir.path().to_owned()] {
            let text = Output::open(Some(&path), &Spared::nothing()).unwrap_err().to_string();
            assert_eq!(text, format!("{}: cannot be written", path.display()));
        }
    }

    #[test]
    fn a_device_is_written_as_it_is() {
        let mut output = Output::open(Some(Path::new("/dev/null")), &Spared::nothing()).unwrap();
        output.write("one\n").unwrap();
        output.finish().unwrap();
        assert!(!fs::metadata("/dev/null").unwrap().is_file());
    }

    #[test]
    fn a_link_stays_a_link() {
        let dir = tempfile::tempdir().unwrap();
        let (file, link) = (dir.path().join("file"), dir.path().join("link"));
        fs::write(&file, "old").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        let mut output = Output::open(Some(&link), &Spared::nothing()).unwrap();
        output.write("new").unwrap();
        output.finish().unwrap();
        assert_eq!(fs::read_to_string(&file).unwrap(), "new");
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    }

    #[test]
    fn what_is_read_is_spared_by_every_name_and_so_is_the_store() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        for folder in ["data", "elsewhere"] {
            fs::create_dir(at(folder)).unwrap();
        }
        fs::write(at("read.toml"), "read").unwrap();
        fs::write(at("data/state.db"), "database").unwrap();
        std::os::unix::fs::symlink(at("read.toml"), at("link.toml")).unwrap();
        std::os::unix::fs::symlink(at("data"), at("link")).unwrap();
        let config = Config {
            store: crate::config::Store { directory: at("link"), ..Default::default() },
            ..Config::default()
        };
        let spared = Spared::of(&config).and([&at("read.toml"), &at("not-yet.toml")]);
        for name in ["read.toml", "link.toml", "data/../read.toml", "elsewhere/../not-yet.toml"] {
            let error = Output::open(Some(&at(name)), &spared).unwrap_err();
            assert!(matches!(error, OutputError::Overwrites { .. }), "{name}: {error}");
        }
        for name in ["data/state.db", "link/state.db", "data/new.csv", "elsewhere/../link/new"] {
            let error = Output::open(Some(&at(name)), &spared).unwrap_err();
            assert!(matches!(error, OutputError::InStore { .. }), "{name}: {error}");
        }
        for name in ["new.csv", "elsewhere/state.db", "data.csv"] {
            spared.refuse(&at(name)).unwrap();
        }
        spared.refuse(Path::new("/dev/null")).unwrap();
        assert_eq!(fs::read_to_string(at("read.toml")).unwrap(), "read");
        assert_eq!(names(&at("data")), ["state.db"]);
    }
}
