//! The closed vocabularies as JSON strings.
//!
//! A test holds each name against the domain's own `name()`.

use crate::alarms;
use crate::diagnosis::fault;
use crate::diagnosis::verdict;
use crate::evaluation::score;
use crate::features::speed;
use crate::store::feedback;
use crate::store::trends;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

macro_rules! names {
    ($(#[doc = $doc:literal])* $wire:ident of $domain:ty { $($variant:ident = $name:tt,)+ }) => {
        $(#[doc = $doc])*
        #[derive(
            Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, ToSchema,
        )]
        #[expect(missing_docs, reason = "the domain type of the same name documents each variant")]
        pub enum $wire {
            $(#[serde(rename = $name)] $variant,)+
        }

        impl From<$domain> for $wire {
            fn from(value: $domain) -> Self {
                match value {
                    $(<$domain>::$variant => Self::$variant,)+
                }
            }
        }

        impl From<$wire> for $domain {
            fn from(value: $wire) -> Self {
                match value {
                    $($wire::$variant => Self::$variant,)+
                }
            }
        }

        #[cfg(test)]
        impl Vocabulary for $domain {
            fn all_with_json() -> Vec<(Self, String)> {
                vec![$((
                    <$domain>::$variant,
                    serde_json::to_string(&$wire::from(<$domain>::$variant)).unwrap(),
                ),)+]
            }
        }
    };
}

#[cfg(test)]
trait Vocabulary: Sized {
    fn all_with_json() -> Vec<(Self, String)>;
}

names! {
    /// How finely a trend is held.
    TierName of trends::Tier {
        Windows = "raw",
        Minutes = "1min",
        Hours = "1h",
    }
}

names! {
    /// State of a component or machine.
    StateName of fault::State {
        Undetermined = "undetermined",
        Healthy = "healthy",
        Warning = "warning",
        Damaged = "damaged",
    }
}

names! {
    /// Kind of a judged component.
    KindName of fault::ComponentKind {
        Bearing = "bearing",
        Shaft = "shaft",
        Gear = "gear",
        Sensor = "sensor",
        Machine = "machine",
    }
}

names! {
    /// A fault.
    FaultName of fault::FaultMode {
        InnerRace = "inner_race",
        OuterRace = "outer_race",
        RollingElement = "rolling_element",
        Cage = "cage",
        Bow = "bow",
        Unbalance = "unbalance",
        Misalignment = "misalignment",
        Looseness = "looseness",
        ToothDamage = "tooth_damage",
        DistributedWear = "distributed_wear",
        Dead = "dead",
        Clipped = "clipped",
        Stuck = "stuck",
        Spiking = "spiking",
        Loose = "loose",
        Noisy = "noisy",
        WrongRange = "wrong_range",
        AbnormalLevel = "abnormal_level",
    }
}

names! {
    /// Member of a gear pair.
    MemberName of fault::GearSide {
        Driving = "driving",
        Driven = "driven",
    }
}

names! {
    /// How a value was detected.
    DetectorName of fault::Detector {
        Rms = "rms",
        ZeroToPeak = "0-p",
        PeakToPeak = "p-p",
    }
}

names! {
    /// Where the speed came from.
    SpeedSourceName of speed::SpeedSource {
        Tacho = "tacho",
        SpeedChannel = "speed_channel",
        Capture = "capture",
        Machine = "machine",
        Option = "option",
        Estimated = "estimated",
    }
}

names! {
    /// Whether the machine runs.
    OperatingStateName of verdict::OperatingState {
        Running = "running",
        Stopped = "stopped",
        Transient = "transient",
        Unknown = "unknown",
    }
}

names! {
    /// Worst data quality among the sensors.
    DataQualityName of verdict::DataQuality {
        Ok = "ok",
        Degraded = "degraded",
        Bad = "bad",
    }
}

names! {
    /// How a verdict compares with the truth.
    OutcomeName of score::Outcome {
        Right = "right",
        Detected = "detected",
        Undetermined = "undetermined",
        Missed = "missed",
        WrongCause = "wrong_cause",
        FalseAlarm = "false_alarm",
    }
}

names! {
    /// Level of an alarm.
    LevelName of alarms::Level {
        Warning = "warning",
        Damaged = "damaged",
    }
}

names! {
    /// State of an alarm (ISA-18.2).
    AlarmStateName of alarms::state::ShownState {
        Normal = "normal",
        Unacknowledged = "unacknowledged",
        Acknowledged = "acknowledged",
        ReturnedUnacknowledged = "returned_unacknowledged",
        Latched = "latched",
        Shelved = "shelved",
        Suppressed = "suppressed",
        OutOfService = "out_of_service",
    }
}

names! {
    /// What happened to an alarm.
    EventName of alarms::EventKind {
        Raised = "raised",
        Escalated = "escalated",
        DeEscalated = "de_escalated",
        Returned = "returned",
        Acknowledged = "acknowledged",
        Latched = "latched",
        Reset = "reset",
        Cleared = "cleared",
        Shelved = "shelved",
        Unshelved = "unshelved",
        Suppressed = "suppressed",
        Unsuppressed = "unsuppressed",
        RemovedFromService = "removed_from_service",
        ReturnedToService = "returned_to_service",
        ConfigurationRemoved = "configuration_removed",
    }
}

names! {
    /// What somebody found of a verdict.
    FindingName of feedback::Finding {
        Confirmed = "confirmed",
        Wrong = "wrong",
        OtherCause = "other_cause",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check<T: Vocabulary + Copy>(name: fn(T) -> &'static str) {
        for (value, json) in T::all_with_json() {
            assert_eq!(json, format!("{:?}", name(value)));
        }
    }

    #[test]
    fn json_names_are_those_of_the_domain() {
        check(fault::State::name);
        check(fault::ComponentKind::name);
        check(fault::FaultMode::name);
        check(fault::Detector::name);
        check(speed::SpeedSource::name);
        check(verdict::OperatingState::name);
        check(verdict::DataQuality::name);
        check(score::Outcome::name);
        check(alarms::Level::name);
        check(alarms::state::ShownState::name);
        check(alarms::EventKind::name);
        check(feedback::Finding::name);
    }
}
