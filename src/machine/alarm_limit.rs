//! Limits that raise alarms of their own: what is measured, against what, in which state of the machine.
//!
//! Written in `[[limits.alarm]]`, judged in `alarms::limit`. Thresholds are in canonical units. Must not
//! know how a value is measured or when it was exceeded.

use super::ShaftIndex;
use super::limits::DisplacementZones;
use super::limits::VelocityZones;
use crate::units::Hz;
use crate::units::Unit;

/// Part of the boundary B/C by which a level may change before it counts, up or down (Criterion II of
/// ISO 20816-1 and ISO 20816-3).
pub const CRITERION_II_PART: f64 = 0.25;

/// How far above a zone boundary a limit may lie at most (ISO 20816-3).
pub const MOST_ABOVE_BOUNDARY: f64 = 1.25;

/// What a limit watches.
#[derive(Debug, Clone, PartialEq)]
pub enum Quantity {
    /// Velocity RMS 10–1000 Hz, mm/s.
    VelocityRms,
    /// Displacement RMS 10–1000 Hz, µm.
    DisplacementRms,
    /// Largest minus smallest sample: the displacement of a shaft, of a probe.
    PeakToPeak,
    /// Mean of the signal with its constant: the gap of a probe.
    Gap,
    /// RMS in a band.
    Band {
        /// Lower edge.
        low: Hz,
        /// Upper edge.
        high: Hz,
    },
    /// Amplitude at a multiple of a shaft's speed, zero to peak.
    Order {
        /// Which shaft.
        shaft: ShaftIndex,
        /// Multiple, such as 0.5 or 2.
        order: f64,
    },
    /// RMS without the line at 1× of a shaft.
    NotOnce {
        /// Which shaft.
        shaft: ShaftIndex,
    },
    /// A feature, by its name in trends.
    Feature(String),
    /// Distance from a reference, up or down (Criterion II).
    Change(Reference),
    /// How many of other limits are exceeded, by their places.
    Vote(Vec<usize>),
}

/// What a change is counted from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reference {
    /// Velocity RMS 10–1000 Hz, mm/s.
    VelocityRms {
        /// The reference, mm/s.
        mm_per_s: f64,
    },
    /// The vector of 1× of the first shaft: amplitude zero to peak, and phase lag after its mark.
    Vector {
        /// Amplitude of the reference, the limit's unit.
        amplitude: f64,
        /// Phase lag of the reference, degrees.
        phase_deg: f64,
    },
}

/// Limits that apply together.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Thresholds {
    /// Above it a warning.
    pub warning_above: Option<f64>,
    /// Above it damaged.
    pub damaged_above: Option<f64>,
    /// Below it a warning.
    pub warning_below: Option<f64>,
    /// Below it damaged.
    pub damaged_below: Option<f64>,
}

/// Limits that apply in a range of speeds of the first shaft.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpeedRange {
    /// From this speed on.
    pub low: Hz,
    /// Below this speed.
    pub high: Hz,
    /// What applies then.
    pub thresholds: Thresholds,
}

/// In which operating states a limit is judged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct JudgedIn {
    /// At a steady speed.
    pub running: bool,
    /// While the speed changes.
    pub transient: bool,
    /// At standstill.
    pub stopped: bool,
    /// When no speed is known.
    pub unknown: bool,
}

impl JudgedIn {
    /// Where levels can be compared: at a steady or unknown speed.
    pub const STEADY: Self =
        Self { running: true, transient: false, stopped: false, unknown: true };

    /// Always.
    pub const ALWAYS: Self = Self { running: true, transient: true, stopped: true, unknown: true };
}

/// One limit.
#[derive(Debug, Clone, PartialEq)]
pub struct AlarmLimit {
    /// Identifier within the machine.
    pub id: String,
    /// What is watched.
    pub quantity: Quantity,
    /// Unit of the thresholds; a value in another unit (an uncalibrated sensor) is not judged.
    pub unit: Unit,
    /// Whether values are divided by their baseline first.
    pub relative_to_baseline: bool,
    /// Places in [`super::Machine::sensors`]; none for a vote.
    pub sensors: Vec<usize>,
    /// What applies at any speed.
    pub thresholds: Thresholds,
    /// What applies by speed instead; outside of all ranges nothing is judged.
    pub by_speed: Vec<SpeedRange>,
    /// Part of a threshold by which a value must come back behind it to end what it began, 0…1.
    pub hysteresis: f64,
    /// How many channels, or limits of a vote, must exceed at once.
    pub votes: usize,
    /// For how long, s of judged stream time; `None`: as the configuration says.
    pub on_delay_s: Option<f64>,
    /// For how long not, s of judged stream time; `None`: as the configuration says.
    pub off_delay_s: Option<f64>,
    /// Whether the alarm waits for a reset.
    pub latching: bool,
    /// Whether it raises an alarm, or only takes part in votes.
    pub raises: bool,
    /// When it is judged.
    pub judged_in: JudgedIn,
    /// What upper thresholds are multiplied by in a declared transient, > 1.
    pub startup_multiply: Option<f64>,
}

/// A transient that the machine file declares.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Startup {
    /// Speeds of the first shaft it passes through.
    pub speed: (Hz, Hz),
    /// Longest time it takes, s.
    pub max_s: f64,
}

/// All limits of a machine that raise alarms.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct AlarmLimits {
    /// The limits; votes refer to places in it.
    pub limits: Vec<AlarmLimit>,
    /// The transient in which `startup_multiply` holds; `None`: there is none.
    pub startup: Option<Startup>,
}

impl Thresholds {
    /// Zone boundaries as limits: B/C and C/D.
    #[must_use]
    pub fn of_zones(zones: VelocityZones) -> Self {
        Self {
            warning_above: Some(zones.b_c_mm_per_s),
            damaged_above: Some(zones.c_d_mm_per_s),
            ..Self::default()
        }
    }

    /// Zone boundaries of a displacement as limits: B/C and C/D.
    #[must_use]
    pub fn of_displacement_zones(zones: DisplacementZones) -> Self {
        Self {
            warning_above: Some(zones.b_c_um),
            damaged_above: Some(zones.c_d_um),
            ..Self::default()
        }
    }

    /// Limits of a machine whose usual level is known: the warning a quarter of B/C above it and at most
    /// 1.25 B/C, damaged at C/D, which is tied to no baseline (ISO 20816-3).
    #[must_use]
    pub fn of_zones_and_baseline(zones: VelocityZones, baseline_mm_per_s: f64) -> Self {
        let boundary = zones.b_c_mm_per_s;
        let above = baseline_mm_per_s + CRITERION_II_PART * boundary;
        Self {
            warning_above: Some(above.min(MOST_ABOVE_BOUNDARY * boundary)),
            ..Self::of_zones(zones)
        }
    }

    /// Whether nothing is stated.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::limits::IsoGroup;

    #[test]
    fn limits_of_zones_follow_the_standards_arithmetic() {
        // Worked example of the standard's rule, group 2 rigid (B/C 2.8, C/D 4.5): 0.9 + 0.7 = 1.6.
        let zones = IsoGroup::Group2Rigid.velocity_zones().unwrap();
        let found = Thresholds::of_zones_and_baseline(zones, 0.9);
        assert!((found.warning_above.unwrap() - 1.6).abs() < 1e-12);
        assert_eq!(found.damaged_above, Some(4.5));
        // A high baseline is held at 1.25 · 2.8.
        let high = Thresholds::of_zones_and_baseline(zones, 3.4);
        assert!((high.warning_above.unwrap() - 3.5).abs() < 1e-12);
        assert!((MOST_ABOVE_BOUNDARY * zones.c_d_mm_per_s - 5.625).abs() < 1e-12);
        assert_eq!(Thresholds::of_zones(zones).warning_above, Some(2.8));
    }
}
