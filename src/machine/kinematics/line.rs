//! One line of the frequency table: whose it is, what it is, where it stands.

use super::super::{BearingIndex, GearIndex, Machine, MotorIndex, ShaftIndex};
use crate::machine::uncertainty::RelativeBand;
use crate::units::{Hz, Order};

/// The part of the machine a line belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Owner {
    /// A shaft.
    Shaft(ShaftIndex),
    /// A bearing.
    Bearing(BearingIndex),
    /// A gear mesh.
    Gear(GearIndex),
    /// A motor.
    Motor(MotorIndex),
}

/// A wheel of a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Member {
    /// The driving gear.
    Driving,
    /// The driven gear.
    Driven,
}

/// What a line is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum LineKind {
    /// Harmonic of a shaft's speed.
    Shaft {
        /// 1 = once a revolution.
        harmonic: u8,
    },
    /// Cage rate (K2).
    Ftf {
        /// From 1.
        harmonic: u8,
    },
    /// Ball-pass rate of the outer race (K3).
    Bpfo {
        /// From 1.
        harmonic: u8,
    },
    /// Ball-pass rate of the inner race (K4).
    Bpfi {
        /// From 1.
        harmonic: u8,
    },
    /// Ball spin rate (K5); the defect line is [`LineKind::TwoBsf`].
    Bsf,
    /// Defect rate of a rolling element, 2·BSF (K6).
    TwoBsf {
        /// 1 = 2·BSF itself.
        harmonic: u8,
    },
    /// Gear-mesh frequency (K9).
    GearMesh {
        /// From 1.
        harmonic: u8,
    },
    /// GMF − 1× of a member's shaft (K10).
    LowerSideBand {
        /// Whose shaft.
        member: Member,
    },
    /// GMF + 1× of a member's shaft (K10).
    UpperSideBand {
        /// Whose shaft.
        member: Member,
    },
    /// Rate at which the same two teeth meet (K11).
    HuntingTooth,
    /// Line frequency of an induction motor and its double.
    Mains {
        /// 1 or 2.
        harmonic: u8,
    },
    /// Slip speed times poles (K12).
    PolePass,
    /// Supply frequency poles/2·f of a synchronous motor and its double (K13).
    SynchronousPole {
        /// 1 or 2.
        harmonic: u8,
    },
}

/// A labelled line.
#[derive(Debug, Clone, PartialEq)]
pub struct FrequencyLine {
    /// Whose it is.
    pub owner: Owner,
    /// The owner's identifier; of a motor, which has none in the file, `motor[i]`.
    pub owner_id: String,
    /// What it is.
    pub kind: LineKind,
    /// Where it stands, > 0 and finite.
    pub frequency: Hz,
    /// Frequency divided by the speed of `shaft`; `None` when that is unknown or zero.
    pub order: Option<Order>,
    /// Limits of the frequency that the bearing's geometry leaves; zero where it is exact.
    pub band: RelativeBand,
    /// The shaft the order refers to: of a side band, its member's; of a mesh, the driving one.
    pub shaft: ShaftIndex,
}

/// Why a part has no lines in the table (a motor: no lines that depend on speed).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unlisted {
    /// Nothing connects its shaft's speed to the first shaft's.
    SpeedNotConnected,
    /// The shaft stands still.
    Standstill,
    /// The bearing's geometry is unknown.
    NoGeometry,
    /// The motor's line frequency is not stated.
    NoLineFrequency,
}

impl Owner {
    /// Identifier in documents.
    ///
    /// # Panics
    ///
    /// If the owner comes from another machine.
    #[must_use]
    pub fn id(self, machine: &Machine) -> String {
        match self {
            Self::Shaft(index) => machine.shaft(index).id.clone(),
            Self::Bearing(index) => machine.bearing(index).id.clone(),
            Self::Gear(index) => machine.gear(index).id.clone(),
            Self::Motor(index) => format!("motor[{}]", index.0),
        }
    }

    /// Kind of part, as in documents.
    #[must_use]
    pub fn kind_name(self) -> &'static str {
        match self {
            Self::Shaft(_) => "shaft",
            Self::Bearing(_) => "bearing",
            Self::Gear(_) => "gear",
            Self::Motor(_) => "motor",
        }
    }
}

impl Member {
    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Driving => "driving",
            Self::Driven => "driven",
        }
    }
}

impl LineKind {
    /// Label for people: `BPFI`, `2x BPFI`, `GMF-1x driven`.
    #[must_use]
    pub fn label(self) -> String {
        let times = |harmonic: u8, name: &str| match harmonic {
            1 => name.to_owned(),
            _ => format!("{harmonic}x {name}"),
        };
        match self {
            Self::Shaft { harmonic } => format!("{harmonic}x"),
            Self::Ftf { harmonic } => times(harmonic, "FTF"),
            Self::Bpfo { harmonic } => times(harmonic, "BPFO"),
            Self::Bpfi { harmonic } => times(harmonic, "BPFI"),
            Self::Bsf => "BSF".to_owned(),
            Self::TwoBsf { harmonic } => times(harmonic, "2·BSF"),
            Self::GearMesh { harmonic } => times(harmonic, "GMF"),
            Self::LowerSideBand { member } => format!("GMF-1x {}", member.name()),
            Self::UpperSideBand { member } => format!("GMF+1x {}", member.name()),
            Self::HuntingTooth => "hunting tooth".to_owned(),
            Self::Mains { harmonic } => times(harmonic, "mains"),
            Self::PolePass => "pole pass".to_owned(),
            Self::SynchronousPole { harmonic } => times(harmonic, "synchronous supply"),
        }
    }
}

impl Unlisted {
    /// Reason for people.
    #[must_use]
    pub fn reason(self) -> &'static str {
        match self {
            Self::SpeedNotConnected => {
                "its speed is not connected to the first shaft by speed_hz, ratio_to or gears"
            }
            Self::Standstill => "its shaft stands still",
            Self::NoGeometry => "its geometry is unknown",
            Self::NoLineFrequency => "its line_frequency_hz is not stated",
        }
    }
}
