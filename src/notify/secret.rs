//! A text that no log, error, metric or answer may show.

use std::fmt;

/// A secret; its `Debug` says nothing about it, so that whatever holds it can be printed and hashed.
#[derive(Clone, PartialEq, Eq)]
pub struct Secret(Vec<u8>);

impl Secret {
    /// Hides `bytes`.
    #[must_use]
    pub fn new(bytes: impl Into<Vec<u8>>) -> Self {
        Self(bytes.into())
    }

    /// What is hidden: for the one who sends or signs.
    #[must_use]
    pub fn reveal(&self) -> &[u8] {
        &self.0
    }

    /// What is hidden, if it is text.
    #[must_use]
    pub fn text(&self) -> Option<&str> {
        std::str::from_utf8(&self.0).ok()
    }
}

impl fmt::Debug for Secret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Secret(…)")
    }
}
