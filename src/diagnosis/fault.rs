//! The closed vocabulary of verdicts: states, faults, component kinds, with their document names.

/// State of a component or machine, ordered from best to worst; `Undetermined` stands apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum State {
    /// Could not look: a right answer where the data cannot tell.
    Undetermined,
    /// Looked for every fault the component and its sensors allow, found nothing.
    Healthy,
    /// Proven at the declared false-alarm rate, severity below 0.5.
    Warning,
    /// Proven, severity from 0.5.
    Damaged,
}

impl State {
    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Undetermined => "undetermined",
            Self::Healthy => "healthy",
            Self::Warning => "warning",
            Self::Damaged => "damaged",
        }
    }

    /// Whether the component is accused (warning or damaged).
    #[must_use]
    pub fn is_accusation(self) -> bool {
        matches!(self, Self::Warning | Self::Damaged)
    }
}

/// Kind of a judged component.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum ComponentKind {
    /// Rolling bearing.
    Bearing,
    /// Shaft.
    Shaft,
    /// Gear mesh.
    Gear,
    /// Sensor (does not change the whole).
    Sensor,
    /// The machine as a whole: abnormal, cause not proven.
    Machine,
}

impl ComponentKind {
    /// All kinds.
    pub const ALL: [Self; 5] =
        [Self::Bearing, Self::Shaft, Self::Gear, Self::Sensor, Self::Machine];

    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Bearing => "bearing",
            Self::Shaft => "shaft",
            Self::Gear => "gear",
            Self::Sensor => "sensor",
            Self::Machine => "machine",
        }
    }
}

/// Every fault the monitor can name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum FaultMode {
    /// Bearing inner race: BPFI.
    InnerRace,
    /// Bearing outer race: BPFO.
    OuterRace,
    /// Bearing rolling element: 2·BSF.
    RollingElement,
    /// Bearing cage: FTF.
    Cage,
    /// Residual bow of a shaft.
    Bow,
    /// Unbalance.
    Unbalance,
    /// Misalignment.
    Misalignment,
    /// Looseness.
    Looseness,
    /// Damage localised at one or a few teeth.
    ToothDamage,
    /// Wear of all teeth.
    DistributedWear,
    /// Sensor without signal.
    Dead,
    /// Signal cut at the ends of its range.
    Clipped,
    /// Signal frozen at a value.
    Stuck,
    /// Isolated spikes.
    Spiking,
    /// Loose sensor.
    Loose,
    /// Excess noise.
    Noisy,
    /// Wrong range.
    WrongRange,
    /// Abnormal level, cause not proven.
    AbnormalLevel,
}

impl FaultMode {
    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::InnerRace => "inner_race",
            Self::OuterRace => "outer_race",
            Self::RollingElement => "rolling_element",
            Self::Cage => "cage",
            Self::Bow => "bow",
            Self::Unbalance => "unbalance",
            Self::Misalignment => "misalignment",
            Self::Looseness => "looseness",
            Self::ToothDamage => "tooth_damage",
            Self::DistributedWear => "distributed_wear",
            Self::Dead => "dead",
            Self::Clipped => "clipped",
            Self::Stuck => "stuck",
            Self::Spiking => "spiking",
            Self::Loose => "loose",
            Self::Noisy => "noisy",
            Self::WrongRange => "wrong_range",
            Self::AbnormalLevel => "abnormal_level",
        }
    }

    /// What people read: the name in words, and what is abnormal, of which the name tells one kind, by what is not known of it.
    #[must_use]
    pub fn words(self) -> String {
        if self == Self::AbnormalLevel {
            "abnormal, cause not proven".to_owned()
        } else {
            self.name().replace('_', " ")
        }
    }
}

/// Which member of a gear pair a fault belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum GearSide {
    /// The driving gear.
    Driving,
    /// The driven gear.
    Driven,
}

/// How a value was detected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Detector {
    /// Root mean square.
    Rms,
    /// Zero to peak.
    ZeroToPeak,
    /// Peak to peak.
    PeakToPeak,
}

impl Detector {
    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Rms => "rms",
            Self::ZeroToPeak => "0-p",
            Self::PeakToPeak => "p-p",
        }
    }
}
