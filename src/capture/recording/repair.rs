//! What becomes of a recording whose writer was killed.
//!
//! Such a file is whole up to the last flush; only its superblock still says that a writer is at
//! work, for which other programs refuse it. The repair rewrites those 48 bytes in place: one write
//! inside one sector, so it is there or not. A copy beside would need the room of the recording, on
//! a disk that may be full, to change as much. What then cannot be read to its last sample gets its
//! old superblock back.

use super::super::error::{CaptureError, LibraryError};
use super::super::hdf5;
use super::super::hdf5::format::superblock::{FLAG_SWMR_WRITE, FLAG_WRITE_ACCESS, SuperblockV2V3};
use super::super::hints::Hints;
use super::super::info::CaptureKind;
use super::super::reader::CaptureReader;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read};
use std::os::unix::fs::FileExt;
use std::path::Path;

/// What is said of a file that a recorder left open.
pub(in crate::capture) const LEFT_OPEN: &str = "left open by its recorder: it was ended at once or is still at \
     work; every sample it flushed is here, `rotorwatch check --repair` closes the file";

/// Bytes of the longest superblock with flags.
const SUPERBLOCK_BYTES: usize = 48;

/// What [`repair`] did.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Repair {
    /// The file was closed properly: it was not touched.
    NothingToDo,
    /// It was left open, and is closed and read to its last sample.
    Repaired {
        /// Samples of each channel, by name.
        samples: Vec<(String, u64)>,
    },
}

/// Whether the file says that a writer is at work; false if it cannot be told.
pub(in crate::capture) fn is_flagged(path: &Path) -> bool {
    let superblock = File::open(path).and_then(|file| superblock(&file));
    superblock.is_ok_and(|found| found.is_some_and(|(block, _)| flagged(&block)))
}

/// Closes a recording that was left open and reads it to its last sample.
///
/// # Errors
///
/// [`CaptureError::Content`] if a recorder is writing the file, else what keeps it from being
/// read; the file is then as it was.
pub fn repair(path: &Path) -> Result<Repair, CaptureError> {
    let io = |action| move |source| CaptureError::Io { file: path.into(), action, source };
    if !is_flagged(path) {
        let reader = CaptureReader::open(path, None, &Hints::default())?;
        return match reader.info().kind {
            CaptureKind::Hdf5 => Ok(Repair::NothingToDo),
            kind @ (CaptureKind::Csv | CaptureKind::Wav) => Err(CaptureError::Content {
                file: path.into(),
                object: "the file".into(),
                problem: format!(
                    "this is {}, no recording of the daemon; nothing can be repaired",
                    kind.name()
                ),
            }),
        };
    }
    let file = OpenOptions::new().read(true).write(true).open(path).map_err(io("open it"))?;
    if let Err(TryLockError::WouldBlock) = file.try_lock() {
        return Err(CaptureError::Content {
            file: path.into(),
            object: "the file".into(),
            problem: "a recorder is writing it or a program has it open; end that first".into(),
        });
    }
    let found = superblock(&file).map_err(io("read it"))?;
    let Some((block, old)) = found.filter(|(block, _)| flagged(block)) else {
        return Ok(Repair::NothingToDo); // its recorder closed it meanwhile
    };
    let metadata = file.metadata().map_err(io("look at it"))?;
    let length = metadata.len();
    if block.end_of_file_address > length {
        let declared = block.end_of_file_address;
        return Err(CaptureError::Truncated { file: path.into(), declared, found: length });
    }
    let closed = SuperblockV2V3 { file_consistency_flags: 0, end_of_file_address: length, ..block };
    let write = |bytes: &[u8]| {
        file.write_all_at(bytes, 0)?;
        // The time of its last sample tells how old a recording is, not that of its repair.
        metadata.modified().and_then(|at| file.set_modified(at))?;
        file.sync_all()
    };
    write(&closed.encode()).map_err(io("write its superblock"))?;
    // It says so itself from here on, and the reader wants a lock of its own.
    let _ = file.unlock();
    read_to_end(path).map(|samples| Repair::Repaired { samples }).inspect_err(|_| {
        // The error told is that of the samples; the flag is all that is lost otherwise.
        let _ = write(&old);
    })
}

/// Reads every sample; gives how many each channel has.
fn read_to_end(path: &Path) -> Result<Vec<(String, u64)>, CaptureError> {
    let mut reader = CaptureReader::open(path, None, &Hints::default())?;
    while reader.next_block()?.is_some() {}
    let channels = reader.info().channels.iter();
    Ok(channels.map(|channel| (channel.info.name.clone(), channel.n_samples)).collect())
}

fn flagged(block: &SuperblockV2V3) -> bool {
    block.file_consistency_flags & (FLAG_WRITE_ACCESS | FLAG_SWMR_WRITE) != 0
}

/// The superblock at the file's beginning and its bytes; `None` if there is none of that kind.
fn superblock(file: &File) -> io::Result<Option<(SuperblockV2V3, Vec<u8>)>> {
    let mut bytes = Vec::new();
    file.take(SUPERBLOCK_BYTES as u64).read_to_end(&mut bytes)?;
    let decoded: Result<_, LibraryError> = hdf5::guarded(|| SuperblockV2V3::decode(&bytes));
    Ok(decoded.ok().map(|block| {
        bytes.truncate(block.encoded_size());
        (block, bytes)
    }))
}
