//! The mistakes of a scene.

use crate::machine::file::{MachineFileErrors, Mistake};
use std::fmt;

/// Every mistake of a scene, those of its text or those found when it was built.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SceneErrors(MachineFileErrors);

impl SceneErrors {
    /// A single mistake.
    pub(super) fn one(
        file_name: &str,
        (line, column): (usize, usize),
        path: &str,
        found: String,
        allowed: String,
    ) -> Self {
        let mistake = Mistake { line, column, path: path.to_owned(), found, allowed };
        Self(MachineFileErrors {
            file_name: file_name.to_owned(),
            mistakes: vec![mistake],
            n_omitted: 0,
        })
    }

    /// The mistakes, by place; never empty.
    #[must_use]
    pub fn mistakes(&self) -> &[Mistake] {
        &self.0.mistakes
    }
}

impl From<MachineFileErrors> for SceneErrors {
    fn from(errors: MachineFileErrors) -> Self {
        Self(errors)
    }
}

/// One line per mistake, `file:line:column: path: found …, allowed: …`.
impl fmt::Display for SceneErrors {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(out)
    }
}

impl std::error::Error for SceneErrors {}
