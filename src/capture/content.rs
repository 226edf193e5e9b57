//! What a file is, by its content: which reader takes it, or what to do with it otherwise.
//!
//! Looks at a few places of the file only. Must not know how any of the kinds is read, except that a
//! text may have to be told from a table.

use super::csv;
use std::fs::File;
use std::io;
use std::io::{Read, Seek, SeekFrom};

/// First bytes of an HDF5 superblock.
const HDF5_SIGNATURE: [u8; 8] = *b"\x89HDF\r\n\x1a\n";

/// Bytes at the beginning that tell binary from text.
const LOOK_BYTES: usize = 4096;

/// Kinds of files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Content {
    /// HDF5, at 0 or behind a user block; `MATLAB -v7.3` files are such.
    Hdf5,
    /// RIFF with samples.
    Wav,
    /// Text, perhaps with a table of numbers in it.
    Text,
    /// A known kind that is not read.
    Foreign(Foreign),
    /// No byte.
    Empty,
    /// Anything else.
    Binary,
}

/// A kind that is known, not read, and can be converted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Foreign {
    /// What it is.
    pub name: &'static str,
    /// What to do.
    pub remedy: &'static str,
}

const TO_WAV: &str = "convert it to WAV, e.g. sox in out.wav";
const TO_HDF5: &str = "write the channels to HDF5 (docs/hdf5.md)";
const UNPACK: &str = "unpack it first";

/// First bytes, name, remedy.
const FOREIGN: &[(&[u8], &str, &str)] = &[
    (b"RIFX", "a big-endian WAV file (RIFX)", TO_WAV),
    (b"RF64", "a WAV file of 64 bits (RF64)", "split it into files below 4 GB, e.g. with sox"),
    (b"BW64", "a WAV file of 64 bits (BW64)", "split it into files below 4 GB, e.g. with sox"),
    (b"riff\x2e\x91\xcf\x11", "a Wave64 file (W64)", TO_WAV),
    (b"RIFF", "a RIFF file without samples", "take the recording itself"),
    (b"FORM", "an AIFF file", TO_WAV),
    (b".snd", "an AU file", TO_WAV),
    (b"fLaC", "a FLAC file", "unpack it, e.g. flac -d in.flac"),
    (b"ID3", "an MP3 file", "take the original: MP3 drops what a diagnosis needs"),
    (b"\xff\xfb", "an MP3 file", "take the original: MP3 drops what a diagnosis needs"),
    (b"OggS", "an Ogg file", "take the original: lossy sound drops what a diagnosis needs"),
    (b"MATLAB 5.0 MAT-file", "a MATLAB file of version 5", "save it again with save -v7.3"),
    (b"TDSm", "a TDMS file", "export it as HDF5 or CSV"),
    (b"\x93NUMPY", "a NumPy array", TO_HDF5),
    (b"PAR1", "a Parquet file", TO_HDF5),
    (b"CDF\x01", "a netCDF file of version 3", "convert it, e.g. nccopy -k nc4 in.nc out.h5"),
    (b"CDF\x02", "a netCDF file of version 3", "convert it, e.g. nccopy -k nc4 in.nc out.h5"),
    (b"SQLite format 3", "an SQLite database", "export the table as CSV"),
    (b"PK\x03\x04", "a ZIP archive, or a spreadsheet", "unpack it, or save the sheet as CSV"),
    (b"\xd0\xcf\x11\xe0", "an Office file", "save the sheet as CSV"),
    (b"%PDF", "a PDF document", "take the recording itself"),
    (b"\x1f\x8b", "a gzip archive", UNPACK),
    (b"BZh", "a bzip2 archive", UNPACK),
    (b"\xfd7zXZ", "an xz archive", UNPACK),
    (b"\x28\xb5\x2f\xfd", "a zstd archive", UNPACK),
    (b"7z\xbc\xaf", "a 7z archive", UNPACK),
    (b"\xff\xfe", "text in UTF-16", "save it as UTF-8"),
    (b"\xfe\xff", "text in UTF-16", "save it as UTF-8"),
];

/// Says what an opened file is; leaves it rewound.
///
/// # Errors
/// When it is a folder or cannot be read.
pub fn of(file: &mut File) -> io::Result<Content> {
    if file.metadata()?.is_dir() {
        return Err(io::Error::new(io::ErrorKind::IsADirectory, "is a directory"));
    }
    let hdf5 = has_hdf5_signature(file)?;
    file.rewind()?;
    let mut head = Vec::new();
    file.take(LOOK_BYTES as u64).read_to_end(&mut head)?;
    file.rewind()?;
    Ok(if hdf5 { Content::Hdf5 } else { of_head(&head) })
}

/// Whether a text begins with, or is, a table of numbers; `whole`: there is no more of it.
#[must_use]
pub fn is_table(head: &[u8], whole: bool) -> bool {
    csv::is_table(head, whole)
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

fn of_head(head: &[u8]) -> Content {
    if head.is_empty() {
        return Content::Empty;
    }
    if head.starts_with(b"RIFF") && head.get(8..12) == Some(b"WAVE") {
        return Content::Wav;
    }
    let known = FOREIGN.iter().find(|(magic, _, _)| head.starts_with(magic));
    if let Some(&(_, name, remedy)) = known {
        // `RIFFraff;1` is a text.
        let is_text = magic_is_text(head) && is_text(head);
        if !is_text {
            return Content::Foreign(Foreign { name, remedy });
        }
    }
    if !is_text(head) {
        return Content::Binary;
    }
    if is_universal_file(head) {
        let name = "a universal file (UFF)";
        return Content::Foreign(Foreign { name, remedy: TO_HDF5 });
    }
    Content::Text
}

/// Whether the first bytes might as well begin a text.
fn magic_is_text(head: &[u8]) -> bool {
    !head.starts_with(b"MATLAB 5.0") && !head.starts_with(b"%PDF")
}

/// No control characters but those of texts.
fn is_text(head: &[u8]) -> bool {
    head.iter().all(|&byte| byte >= b' ' && byte != 0x7f || matches!(byte, b'\t' | b'\r' | b'\n'))
}

/// Whether it begins with the line `-1` and the number of a data set.
fn is_universal_file(head: &[u8]) -> bool {
    let mut lines = head.split(|&byte| byte == b'\n').map(<[u8]>::trim_ascii);
    lines.next() == Some(b"-1")
        && lines.next().is_some_and(|line| matches!(line, b"58" | b"58b" | b"151" | b"164" | b"15"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn content(bytes: &[u8]) -> Content {
        let mut file = tempfile::tempfile().unwrap();
        std::io::Write::write_all(&mut file, bytes).unwrap();
        of(&mut file).unwrap()
    }

    #[test]
    fn the_first_bytes_decide() {
        assert_eq!(content(&HDF5_SIGNATURE), Content::Hdf5);
        let mut matlab_73 = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".to_vec();
        matlab_73.resize(512, b' ');
        matlab_73.extend(HDF5_SIGNATURE);
        assert_eq!(content(&matlab_73), Content::Hdf5);
        assert_eq!(content(b"RIFF\x24\0\0\0WAVEfmt "), Content::Wav);
        assert_eq!(content(b""), Content::Empty);
        assert_eq!(content(b"t,x\n0,1\n"), Content::Text);
        assert_eq!(content("t;µ\n0;1\n".as_bytes()), Content::Text);
        assert_eq!(content(b"t;\xb5m\n"), Content::Text, "Latin-1");
        assert_eq!(content(b"FORMAT;1\n"), Content::Text);
        assert_eq!(content(b"\0\x01\x02"), Content::Binary);
    }

    #[test]
    fn known_kinds_are_named_with_a_remedy() {
        let mut matlab = b"MATLAB 5.0 MAT-file, Platform: GLNXA64".to_vec();
        matlab.resize(124, b' ');
        matlab.extend([0, 1, b'I', b'M']);
        for (bytes, name) in [
            (&matlab[..], "a MATLAB file of version 5"),
            (b"RIFX\0\0\0\x24WAVE", "a big-endian WAV file (RIFX)"),
            (b"RIFF\x24\0\0\0AVI LIST", "a RIFF file without samples"),
            (b"PK\x03\x04\x14\0", "a ZIP archive, or a spreadsheet"),
            (b"\xff\xfet\0,\0", "text in UTF-16"),
            (b"    -1\r\n    58\r\n", "a universal file (UFF)"),
        ] {
            let found = content(bytes);
            assert!(matches!(found, Content::Foreign(kind) if kind.name == name), "{found:?}");
        }
    }
}
