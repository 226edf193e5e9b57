//! Where results go: stdout, or a file that is complete under its name or not there at all.

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
#[error("{target}: cannot be written")]
pub struct OutputError {
    target: String,
    source: io::Error,
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
    /// Opens stdout, or what `out` names. An existing file is replaced only by [`Output::finish`].
    ///
    /// # Errors
    /// When a file cannot be created there.
    pub fn open(out: Option<&Path>) -> Result<Self, OutputError> {
        let Some(out) = out else {
            return Ok(Self { target: Target::Stdout, name: "stdout".to_owned() });
        };
        let name = out.display().to_string();
        match target(out) {
            Ok(target) => Ok(Self { target, name }),
            Err(source) => Err(OutputError { target: name, source }),
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
            Err(source) => Err(OutputError { target: self.name.clone(), source }),
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
        named.map(|_| ()).map_err(|source| OutputError { target: self.name, source })
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
        let mut output = Output::open(Some(&path)).unwrap();
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
        let mut output = Output::open(Some(&dir.path().join("out.json"))).unwrap();
        output.write("one\n").unwrap();
        drop(output);
        assert!(names(dir.path()).is_empty());
    }

    #[test]
    fn a_folder_that_is_missing_or_in_the_way_is_named() {
        let dir = tempfile::tempdir().unwrap();
        for path in [dir.path().join("no/out.json"), dir.path().to_owned()] {
            let text = Output::open(Some(&path)).unwrap_err().to_string();
            assert_eq!(text, format!("{}: cannot be written", path.display()));
        }
    }

    #[test]
    fn a_device_is_written_as_it_is() {
        let mut output = Output::open(Some(Path::new("/dev/null"))).unwrap();
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
        let mut output = Output::open(Some(&link)).unwrap();
        output.write("new").unwrap();
        output.finish().unwrap();
        assert_eq!(fs::read_to_string(&file).unwrap(), "new");
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    }
}
