//! An archive of files with their digests: a tar, compressed by gzip, whose last entry is the manifest.

use crate::api::wire::backup::ManifestFileWire;
use crate::api::wire::backup::ManifestWire;
use crate::api::wire::backup::SCHEMA;
use crate::cli::output::OutputError;
use crate::store::backup::BackupError;
use crate::store::backup::told;
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use sha2::Digest;
use sha2::Sha256;
use std::collections::BTreeSet;
use std::fs;
use std::fs::File;
use std::fs::OpenOptions;
use std::io;
use std::io::BufReader;
use std::io::BufWriter;
use std::io::Read;
use std::io::Write;
use std::path::Component;
use std::path::Path;
use std::path::PathBuf;

/// Name of the manifest in an archive.
const MANIFEST: &str = "manifest.json";

/// Longest manifest that is read: a hundred thousand files.
const MAX_MANIFEST_BYTES: u64 = 32 << 20;

/// Most files of an archive.
const MAX_FILES: usize = 100_000;

/// Why an archive was not made, or is not believed.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ArchiveError {
    /// The store or a file of it refused.
    #[error(transparent)]
    Backup(#[from] BackupError),
    /// Nothing is to be written there.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// There is something of this name already.
    #[error("{} is there already: choose another name, nothing is written over", file.display())]
    Exists {
        /// The name.
        file: PathBuf,
    },
    /// The archive is none, or was damaged.
    #[error("{} is no whole archive of rotorwatch: {problem}; nothing was changed", file.display())]
    Damaged {
        /// The archive.
        file: PathBuf,
        /// What was found.
        problem: String,
    },
}

/// An archive that is being written.
pub(super) struct Writer {
    out: tar::Builder<GzEncoder<BufWriter<File>>>,
    file: PathBuf,
    half: PathBuf,
    files: Vec<ManifestFileWire>,
}

/// A reader that digests what is read.
struct Digested<R> {
    inner: R,
    digest: Sha256,
    bytes: u64,
}

impl<R: Read> Read for Digested<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let n = self.inner.read(buffer)?;
        self.digest.update(buffer.get(..n).unwrap_or_default());
        self.bytes += n as u64;
        Ok(n)
    }
}

impl<R> Digested<R> {
    fn new(inner: R) -> Self {
        Self { inner, digest: Sha256::new(), bytes: 0 }
    }

    fn end(self, path: String) -> ManifestFileWire {
        let digest = self.digest.finalize();
        let sha256 = digest.iter().map(|byte| format!("{byte:02x}")).collect();
        ManifestFileWire { path, bytes: self.bytes, sha256 }
    }
}

/// A new file that only this user may read.
pub(crate) fn private(file: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options.open(file)
}

impl Writer {
    /// Begins the archive `file`; its name is given when it is whole.
    pub(super) fn create(file: &Path) -> Result<Self, ArchiveError> {
        if file.exists() {
            return Err(ArchiveError::Exists { file: file.to_owned() });
        }
        let mut half = file.as_os_str().to_owned();
        half.push(".part");
        let half = PathBuf::from(half);
        let _none_of_before = fs::remove_file(&half);
        let opened = private(&half).map_err(told("making", &half))?;
        let gzip = GzEncoder::new(BufWriter::new(opened), Compression::fast());
        let (out, file) = (tar::Builder::new(gzip), file.to_owned());
        Ok(Self { out, file, half, files: Vec::new() })
    }

    /// Adds the file `from` under the name `path`.
    pub(super) fn add(&mut self, from: &Path, path: &str) -> Result<(), ArchiveError> {
        let reading = told("archiving", from);
        let opened = File::open(from).map_err(&reading)?;
        let mut header = tar::Header::new_gnu();
        header.set_mode(0o600);
        header.set_size(opened.metadata().map_err(&reading)?.len());
        let mut digested = Digested::new(BufReader::new(opened));
        self.out.append_data(&mut header, path, &mut digested).map_err(&reading)?;
        self.files.push(digested.end(path.to_owned()));
        Ok(())
    }

    /// Adds the manifest, and gives it and the archive's name.
    pub(super) fn finish(
        mut self,
        about: impl FnOnce(Vec<ManifestFileWire>) -> ManifestWire,
    ) -> Result<ManifestWire, ArchiveError> {
        let manifest = about(std::mem::take(&mut self.files));
        // A document of texts, numbers and lists always has a JSON form.
        let text = serde_json::to_vec_pretty(&manifest).unwrap_or_default();
        let writing = told("writing", &self.half);
        let mut header = tar::Header::new_gnu();
        header.set_mode(0o600);
        header.set_size(text.len() as u64);
        self.out.append_data(&mut header, MANIFEST, &text[..]).map_err(&writing)?;
        let gzip = self.out.into_inner().map_err(&writing)?;
        let mut buffer = gzip.finish().map_err(&writing)?;
        buffer.flush().and_then(|()| buffer.get_ref().sync_all()).map_err(&writing)?;
        fs::rename(&self.half, &self.file).map_err(told("naming", &self.file))?;
        Ok(manifest)
    }
}

/// Unpacks the archive `file` into `to` and holds each file against the manifest.
///
/// # Errors
/// When it is damaged, has more or less than it says, or a file that would lie elsewhere.
pub(super) fn unpack(file: &Path, to: &Path) -> Result<ManifestWire, ArchiveError> {
    let damaged = |problem: String| ArchiveError::Damaged { file: file.to_owned(), problem };
    let unreadable = |error: io::Error| damaged(error.to_string());
    let opened = File::open(file).map_err(told("opening", file))?;
    let mut archive = tar::Archive::new(GzDecoder::new(BufReader::new(opened)));
    let (mut found, mut manifest): (Vec<ManifestFileWire>, Option<ManifestWire>) =
        (Vec::new(), None);
    for entry in archive.entries().map_err(unreadable)? {
        let mut entry = entry.map_err(unreadable)?;
        let path = entry.path().map_err(unreadable)?.into_owned();
        let name = path.to_string_lossy().into_owned();
        let is_inside = path.components().all(|part| matches!(part, Component::Normal(_)));
        if !is_inside || !entry.header().entry_type().is_file() || found.len() >= MAX_FILES {
            return Err(damaged(format!("{name:?} is nothing that it may hold")));
        }
        if name == MANIFEST {
            let mut text = Vec::new();
            entry.by_ref().take(MAX_MANIFEST_BYTES).read_to_end(&mut text).map_err(unreadable)?;
            let read = serde_json::from_slice(&text);
            manifest = Some(read.map_err(|error| damaged(format!("its manifest: {error}")))?);
            continue;
        }
        let into = to.join(&path);
        let folder = into.parent().unwrap_or(to);
        fs::create_dir_all(folder).map_err(told("making", folder))?;
        let mut out = private(&into).map_err(told("unpacking", &into))?;
        let mut digested = Digested::new(&mut entry);
        io::copy(&mut digested, &mut out).map_err(unreadable)?;
        out.sync_all().map_err(told("unpacking", &into))?;
        found.push(digested.end(name));
    }
    let manifest =
        manifest.ok_or_else(|| damaged("it has no manifest, its end is missing".to_owned()))?;
    if manifest.schema != SCHEMA {
        return Err(damaged(format!("it is {:?}, this program knows {SCHEMA}", manifest.schema)));
    }
    let [stated, held] = [&manifest.files, &found].map(|files| {
        files.iter().map(|one| (&one.path, one.bytes, &one.sha256)).collect::<BTreeSet<_>>()
    });
    if let Some((path, ..)) = stated.symmetric_difference(&held).next() {
        return Err(damaged(format!("{path} is not what the manifest says")));
    }
    Ok(manifest)
}
