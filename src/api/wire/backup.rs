//! What an archive of a store holds, as JSON.

use serde::{Deserialize, Serialize};

/// Name and version of [`ManifestWire`].
pub const SCHEMA: &str = "rotorwatch.backup/1";

/// What an archive holds.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ManifestWire {
    /// `rotorwatch.backup/1`.
    pub schema: String,
    /// Version of the program that made it.
    pub version: String,
    /// When, wall clock.
    pub made_at: String,
    /// Schema of `state.db`.
    pub store_schema: u32,
    /// Whether captures are in it.
    pub with_captures: bool,
    /// The files, in their order.
    pub files: Vec<ManifestFileWire>,
    /// Files of the configuration that are not in it: they hold secrets, or data of the plant's own.
    pub left_out: Vec<String>,
}

/// A file of an archive.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ManifestFileWire {
    /// Its path in the archive.
    pub path: String,
    /// Its length.
    pub bytes: u64,
    /// Its digest, hexadecimal.
    pub sha256: String,
}
