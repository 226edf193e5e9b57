//! What the caller knows of a file that does not say it itself.

use super::map::ChannelMap;
use crate::units::Hz;

/// Facts beside the file; all optional.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Hints {
    /// Where the channels stand, over the machine file's `[capture.map]`.
    pub map: ChannelMap,
    /// Samples a second of every channel whose rate nothing else states.
    pub rate: Option<Hz>,
    /// Unit of every channel whose unit nothing else states, one of
    /// [`crate::units::SourceUnit::ACCEPTED`].
    pub unit: Option<String>,
}
