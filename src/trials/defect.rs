//! Defects of a bearing: where they strike.

use crate::diagnosis::fault::FaultMode;
use crate::machine::bearing::FaultOrders;

/// Which element of a bearing is damaged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Defect {
    /// Struck at BPFI, through the load zone.
    InnerRace,
    /// Struck at BPFO.
    OuterRace,
    /// Struck at 2·BSF, through the load zone with the cage.
    RollingElement,
}

impl Defect {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::InnerRace, Self::OuterRace, Self::RollingElement];

    /// What the diagnosis should call it.
    #[must_use]
    pub fn fault(self) -> FaultMode {
        match self {
            Self::InnerRace => FaultMode::InnerRace,
            Self::OuterRace => FaultMode::OuterRace,
            Self::RollingElement => FaultMode::RollingElement,
        }
    }

    /// Strikes a revolution of the shaft, without slip.
    #[must_use]
    pub fn order(self, orders: &FaultOrders) -> f64 {
        match self {
            Self::InnerRace => orders.bpfi,
            Self::OuterRace => orders.bpfo,
            Self::RollingElement => orders.two_bsf(),
        }
    }

    /// Turns through the load zone a revolution of the shaft.
    #[must_use]
    pub fn load_order(self, orders: &FaultOrders) -> f64 {
        match self {
            Self::InnerRace | Self::OuterRace => 1.0,
            Self::RollingElement => orders.ftf,
        }
    }
}
