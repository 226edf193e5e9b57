//! The closed vocabularies, read back from their names in documents.

use crate::alarms::EventKind;
use crate::alarms::Level;
use crate::alarms::state::AlarmState;
use crate::alarms::state::Silence;
use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::OperatingState;

macro_rules! names {
    ($($(#[doc = $doc:literal])+ $read:ident: $type:ty { $($variant:ident),+ $(,)? })+) => {
        $(
            $(#[doc = $doc])+
            pub(super) fn $read(text: &str) -> Option<$type> {
                // A variant that is not listed does not compile.
                let name = |value: $type| match value {
                    $(<$type>::$variant => value.name(),)+
                };
                [$(<$type>::$variant),+].into_iter().find(|value| name(*value) == text)
            }
        )+
    };
}

names! {
    /// Kind of a component.
    component_kind: ComponentKind { Bearing, Shaft, Gear, Sensor, Machine }
    /// A fault.
    fault: FaultMode {
        InnerRace, OuterRace, RollingElement, Cage, Bow, Unbalance, Misalignment, Looseness, ToothDamage,
        DistributedWear, Dead, Clipped, Stuck, Spiking, Loose, Noisy, WrongRange, AbnormalLevel,
    }
    /// State of a component or machine.
    health: State { Undetermined, Healthy, Warning, Damaged }
    /// Whether a machine runs.
    operating: OperatingState { Running, Stopped, Transient, Unknown }
    /// Level of an alarm.
    level: Level { Warning, Damaged }
    /// State of an alarm.
    state: AlarmState { Normal, Unacknowledged, Acknowledged, ReturnedUnacknowledged, Latched }
    /// Why an alarm is silent.
    silence: Silence { Shelved, Suppressed, OutOfService }
    /// What happened to an alarm.
    event: EventKind {
        Raised, Escalated, DeEscalated, Returned, Acknowledged, Latched, Reset, Cleared, Shelved, Unshelved,
        Suppressed, Unsuppressed, RemovedFromService, ReturnedToService,
        ConfigurationRemoved,
    }
}
