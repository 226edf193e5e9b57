//! What metrics are told apart by.

use prometheus_client::encoding::EncodeLabelSet;

/// Labels of what is counted for a channel.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
pub(super) struct ChannelLabels {
    pub(super) machine: String,
    pub(super) channel: String,
}

/// Labels of what is counted for a machine.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
pub(super) struct MachineLabels {
    pub(super) machine: String,
}

/// Labels of what is counted of a machine's alarms.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
pub(super) struct AlarmLabels {
    pub(super) machine: String,
    pub(super) what: String,
}

/// Labels of what became of a channel's samples.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
pub(super) struct FateLabels {
    pub(super) machine: String,
    pub(super) channel: String,
    pub(super) fate: String,
}

/// Labels of what became of notifications.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
pub(super) struct NotificationLabels {
    pub(super) receiver: String,
    pub(super) outcome: String,
}

/// Labels of a receiver of notifications.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
pub(super) struct ReceiverLabels {
    pub(super) receiver: String,
}

/// Labels of what is measured on a shard.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
pub(super) struct ShardLabels {
    pub(super) shard: u64,
}
