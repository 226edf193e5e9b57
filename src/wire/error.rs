//! What can be wrong with a frame, and the names by which either side tells the other.

/// Why a connection ends, as a number in frames and a name in JSON, logs and metrics.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum ErrorCode {
    /// The protocol's version is another one.
    Version,
    /// A frame is no frame, or its content breaks a rule.
    Malformed,
    /// A frame was damaged on its way.
    Checksum,
    /// Something is larger than is taken.
    TooLarge,
    /// A frame that does not belong there, such as a block before the hello.
    Unexpected,
    /// Nothing, or only a part of a frame, came for too long.
    Timeout,
    /// The token is missing or wrong.
    Unauthorised,
    /// No machine of this id takes samples.
    UnknownMachine,
    /// A channel cannot be taken as it was described.
    BadChannel,
    /// Another sender has the channel.
    ChannelTaken,
    /// As many senders as are allowed are connected.
    TooManyConnections,
    /// The samples to be held do not fit into memory.
    NoRoom,
    /// A time or an index lies in the future.
    TimeAhead,
    /// The daemon ends, or the machine cannot go on.
    Stopping,
    /// The machine's stream was begun anew too often.
    ReopenedTooOften,
}

impl ErrorCode {
    /// Every code.
    pub const ALL: [Self; 15] = [
        Self::Version,
        Self::Malformed,
        Self::Checksum,
        Self::TooLarge,
        Self::Unexpected,
        Self::Timeout,
        Self::Unauthorised,
        Self::UnknownMachine,
        Self::BadChannel,
        Self::ChannelTaken,
        Self::TooManyConnections,
        Self::NoRoom,
        Self::TimeAhead,
        Self::Stopping,
        Self::ReopenedTooOften,
    ];

    /// Its number in frames.
    #[must_use]
    pub fn number(self) -> u16 {
        match self {
            Self::Version => 1,
            Self::Malformed => 2,
            Self::Checksum => 3,
            Self::TooLarge => 4,
            Self::Unexpected => 5,
            Self::Timeout => 6,
            Self::Unauthorised => 7,
            Self::UnknownMachine => 8,
            Self::BadChannel => 9,
            Self::ChannelTaken => 10,
            Self::TooManyConnections => 11,
            Self::NoRoom => 12,
            Self::TimeAhead => 13,
            Self::Stopping => 14,
            Self::ReopenedTooOften => 15,
        }
    }

    /// The code of a number.
    #[must_use]
    pub fn of(number: u16) -> Option<Self> {
        Self::ALL.into_iter().find(|code| code.number() == number)
    }

    /// Its name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Version => "version",
            Self::Malformed => "malformed",
            Self::Checksum => "checksum",
            Self::TooLarge => "too-large",
            Self::Unexpected => "unexpected",
            Self::Timeout => "timeout",
            Self::Unauthorised => "unauthorised",
            Self::UnknownMachine => "unknown-machine",
            Self::BadChannel => "bad-channel",
            Self::ChannelTaken => "channel-taken",
            Self::TooManyConnections => "too-many-connections",
            Self::NoRoom => "no-room",
            Self::TimeAhead => "time-ahead",
            Self::Stopping => "stopping",
            Self::ReopenedTooOften => "reopened-too-often",
        }
    }
}

/// What is wrong with a frame.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum WireError {
    /// It does not begin as a frame does.
    #[error("a frame begins with \"RW\", not with the bytes {found:02x?}: is it another protocol?")]
    Magic {
        /// What was found.
        found: [u8; 2],
    },
    /// It is of another version.
    #[error("version {found} of the protocol; this program speaks version {}", super::VERSION)]
    Version {
        /// What was found.
        found: u8,
    },
    /// There is no such kind.
    #[error("a frame of the unknown kind {found}")]
    Kind {
        /// What was found.
        found: u8,
    },
    /// It was damaged on its way.
    #[error(
        "the checksum is {stated:08x} and the bytes give {computed:08x} (CRC-32C of all others)"
    )]
    Checksum {
        /// What the frame says.
        stated: u32,
        /// What its bytes give.
        computed: u32,
    },
    /// A length or number is beyond its limit.
    #[error("{what}: {found}, at most {limit} are taken")]
    TooLarge {
        /// Of what.
        what: &'static str,
        /// What was found.
        found: u64,
        /// The limit.
        limit: u64,
    },
    /// The payload ends too early.
    #[error("the payload ends before {what}")]
    Cut {
        /// What is missing.
        what: &'static str,
    },
    /// The payload does not end where it should.
    #[error("{found} bytes are left over in the payload")]
    Rest {
        /// How many.
        found: usize,
    },
    /// A text is not UTF-8.
    #[error("{what} is not UTF-8")]
    Text {
        /// Which.
        what: &'static str,
    },
    /// A value that is not allowed.
    #[error("{what} cannot be {found}")]
    Value {
        /// Of what.
        what: &'static str,
        /// What was found.
        found: u64,
    },
}

impl WireError {
    /// What the sender is told.
    #[must_use]
    pub fn code(&self) -> ErrorCode {
        match self {
            Self::Version { .. } => ErrorCode::Version,
            Self::Checksum { .. } => ErrorCode::Checksum,
            Self::TooLarge { .. } => ErrorCode::TooLarge,
            Self::Magic { .. }
            | Self::Kind { .. }
            | Self::Cut { .. }
            | Self::Rest { .. }
            | Self::Text { .. }
            | Self::Value { .. } => ErrorCode::Malformed,
        }
    }
}
