//! Files with one secret in them.

use std::fs;
use std::io;
use std::path::Path;

/// The first line of a file that is neither empty nor a comment.
///
/// # Errors
/// When it cannot be read, or has none.
pub(super) fn read(file: &Path) -> io::Result<String> {
    let text = fs::read_to_string(file)?;
    let is_secret = |line: &&str| !line.is_empty() && !line.starts_with('#');
    let found = text.lines().map(str::trim).find(is_secret);
    let none = || io::Error::new(io::ErrorKind::InvalidData, "no line of it is a token");
    found.map(str::to_owned).ok_or_else(none)
}
