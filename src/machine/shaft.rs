//! A shaft and what is known of its speed.

use crate::units::Hz;

/// Sense of rotation, seen from the driver end looking along the shaft.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rotation {
    /// Counter-clockwise: from +x (0°) towards +y (90°).
    Ccw,
    /// Clockwise.
    Cw,
}

/// One shaft.
#[derive(Debug, Clone, PartialEq)]
pub struct Shaft {
    /// Identifier.
    pub id: String,
    /// Speed of this shaft divided by the speed of the machine's first shaft; 1 for the first.
    /// `None` when neither `ratio_to`, nor gears, nor two nominal speeds connect them.
    pub ratio_to_first: Option<f64>,
    /// Nominal speed, Hz, from the file or through the train; `None` when not stated.
    pub nominal_speed: Option<Hz>,
    /// Sense of rotation; `None`: forward and backward are not named.
    pub rotation: Option<Rotation>,
    /// First lateral critical speed, Hz.
    pub first_critical: Option<Hz>,
    /// The machine counts as running above this speed, Hz.
    pub running_above: Option<Hz>,
}
