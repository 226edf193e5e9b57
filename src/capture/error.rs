//! What can be wrong with a capture file, each naming file, place, finding and remedy.

use std::path::PathBuf;

/// A failure inside the HDF5 library, panics included.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub struct LibraryError {
    pub(super) message: String,
}

/// Why a capture could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum CaptureError {
    /// The operating system refused the file.
    #[error("{}: cannot {action}", file.display())]
    Io {
        /// The capture.
        file: PathBuf,
        /// What was attempted.
        action: &'static str,
        /// The cause.
        source: std::io::Error,
    },
    /// No HDF5 signature, nor anything else that is known.
    #[error(
        "{}: not a capture: {found}; captures are HDF5 (docs/hdf5.md), CSV and WAV (docs/captures.md)",
        file.display()
    )]
    NotHdf5 {
        /// The file.
        file: PathBuf,
        /// What stands there instead.
        found: String,
    },
    /// A known kind that is not read.
    #[error("{}: this is {found}, which is not read: {remedy}", file.display())]
    Foreign {
        /// The file.
        file: PathBuf,
        /// What it is.
        found: &'static str,
        /// What to do.
        remedy: &'static str,
    },
    /// A line of a text file.
    #[error("{}:{line}: {problem}", file.display())]
    Line {
        /// The file.
        file: PathBuf,
        /// Number of the line, from 1.
        line: u64,
        /// What is wrong with it, and the remedy.
        problem: String,
    },
    /// A CSV or WAV file as a whole.
    #[error("{}: {problem}", file.display())]
    Table {
        /// The file.
        file: PathBuf,
        /// What is wrong with it, and the remedy.
        problem: String,
    },
    /// Shorter than its own superblock says.
    #[error(
        "{}: truncated: the superblock declares {declared} bytes, the file has {found}; copy it again or take the \
         original", file.display()
    )]
    Truncated {
        /// The capture.
        file: PathBuf,
        /// Length by the superblock, bytes.
        declared: u64,
        /// Length on disk, bytes.
        found: u64,
    },
    /// An HDF5 file of another layout.
    #[error(
        "{}: no group /channels in this HDF5 file (it holds {found}); one data set per channel under /channels with \
         the attribute sample_rate_hz makes it a capture (docs/hdf5.md); `rotorwatch check {}` prints the --map options \
         that read it as it is", file.display(), file.display()
    )]
    ForeignLayout {
        /// The file.
        file: PathBuf,
        /// Names in the root group.
        found: String,
    },
    /// A `--map` or `[capture.map]` that does not fit the file.
    #[error("{}: {origin}: {entry}: {problem}", file.display())]
    Mapped {
        /// The file.
        file: PathBuf,
        /// Who says so: `--map` or `[capture.map]`.
        origin: String,
        /// The channel, or `@…`.
        entry: String,
        /// What is wrong, and what to do.
        problem: String,
    },
    /// A capture without a single sample.
    #[error("{}: empty: {found}; record at least one channel under /channels", file.display())]
    Empty {
        /// The capture.
        file: PathBuf,
        /// What there is.
        found: &'static str,
    },
    /// A required attribute is missing or an attribute cannot mean what it must.
    #[error("{}: {object}: attribute {attribute}: found {found}, expected {expected}", file.display())]
    Attribute {
        /// The capture.
        file: PathBuf,
        /// Group or data set that carries it.
        object: String,
        /// Attribute name.
        attribute: String,
        /// What stands there.
        found: String,
        /// What is allowed.
        expected: String,
    },
    /// A data set of a kind that cannot be read as a channel or segment list.
    #[error("{}: {dataset}: found {found}, expected {expected}", file.display())]
    Dataset {
        /// The capture.
        file: PathBuf,
        /// Path inside the file.
        dataset: String,
        /// What stands there.
        found: String,
        /// What is allowed.
        expected: String,
    },
    /// More than this program is willing to hold.
    #[error("{}: {what}: {found} is over the limit of {limit}; {remedy}", file.display())]
    Limit {
        /// The capture.
        file: PathBuf,
        /// What is too large.
        what: String,
        /// How large it is.
        found: u64,
        /// How large it may be.
        limit: u64,
        /// What to do.
        remedy: &'static str,
    },
    /// The HDF5 library failed on an object of the file.
    #[error("{}: {object} cannot be read (damaged, or a feature of HDF5 not supported)", file.display())]
    Library {
        /// The capture.
        file: PathBuf,
        /// Path inside the file.
        object: String,
        /// The cause.
        source: LibraryError,
    },
    /// A table without times whose rate nobody states.
    #[error(
        "{}: no time column, and no rate is given; give --rate HZ, or rate= or time= in --map",
        file.display()
    )]
    NoRate {
        /// The file.
        file: PathBuf,
        /// What was guessed of its form.
        guessed: String,
        /// What is in it.
        channels: String,
        /// Options that name the channels as they are.
        options: String,
    },
    /// Fewer samples than were declared.
    #[error(
        "{}: {object}: {found} of {expected} samples can be read from sample {at} on; take the original again",
        file.display()
    )]
    Short {
        /// The capture.
        file: PathBuf,
        /// Place inside the file.
        object: String,
        /// First sample asked for.
        at: u64,
        /// Samples asked for.
        expected: u64,
        /// Samples there.
        found: u64,
    },
    /// Samples are not those that were written.
    #[error(
        "{}: {dataset}: samples {first} to {last} differ from their checksum: damaged; copy the file again or take \
         the original", file.display()
    )]
    Checksum {
        /// The capture.
        file: PathBuf,
        /// Path inside the file.
        dataset: String,
        /// First sample of the block that differs.
        first: u64,
        /// Its last sample.
        last: u64,
    },
    /// What the file states about itself is not what was written.
    #[error(
        "{}: {object}: {problem}: damaged, or changed later; copy the file again or take the original (or remove \
         /checksums and the attribute checksum of / to have it read unchecked)", file.display()
    )]
    Integrity {
        /// The capture.
        file: PathBuf,
        /// Group, table or attribute.
        object: String,
        /// What does not fit.
        problem: String,
    },
    /// The HDF5 library failed while writing.
    #[error("{}: cannot write {object}", file.display())]
    Write {
        /// The capture.
        file: PathBuf,
        /// Path inside the file.
        object: String,
        /// The cause.
        source: LibraryError,
    },
    /// The caller's content is no valid capture.
    #[error("{}: {object}: {problem}", file.display())]
    Content {
        /// The capture to be written.
        file: PathBuf,
        /// Path inside the file.
        object: String,
        /// What is wrong with it.
        problem: String,
    },
}

impl CaptureError {
    /// Whether the file may be of another layout, which a map could read.
    #[must_use]
    pub fn is_of_layout(&self) -> bool {
        match self {
            Self::ForeignLayout { .. } | Self::Dataset { .. } | Self::Empty { .. } => true,
            Self::Attribute { attribute, .. } => {
                attribute == "format" || attribute == "sample_rate_hz"
            }
            Self::Io { .. }
            | Self::NotHdf5 { .. }
            | Self::Truncated { .. }
            | Self::Foreign { .. }
            | Self::Line { .. }
            | Self::Table { .. }
            | Self::NoRate { .. }
            | Self::Checksum { .. }
            | Self::Integrity { .. }
            | Self::Mapped { .. }
            | Self::Limit { .. }
            | Self::Library { .. }
            | Self::Short { .. }
            | Self::Write { .. }
            | Self::Content { .. } => false,
        }
    }
}
