//! Electric motors: the source of lines that are no faults.

use super::ShaftIndex;
use crate::units::Hz;

/// An electric motor on a shaft.
#[derive(Debug, Clone, PartialEq)]
pub struct Motor {
    /// Shaft it drives.
    pub shaft: ShaftIndex,
    /// Number of poles, even, ≥ 2.
    pub poles: u32,
    /// Mains or nominal inverter output frequency; `None`: no mains lines are excluded, unless
    /// the motor is synchronous.
    pub line_frequency: Option<Hz>,
    /// A synchronous motor: line frequency = poles/2 · shaft speed.
    pub synchronous: bool,
}
