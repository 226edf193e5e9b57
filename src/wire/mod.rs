//! The protocol by which acquisition hardware sends samples: frames as bytes, and back.
//!
//! `docs/wire.md` describes each byte. Every length is checked against what there is and against a limit before
//! anything is allocated; a frame that was damaged on its way is an error, never another frame. Pure. Must not know
//! sockets, machines, or what samples become.

mod cursor;
mod error;
mod frame;
mod hello;
mod block;
mod control;

pub use block::{Block, NO_TIME, SampleType, Samples};
pub use control::{Ack, Bye, Problem, Progress, Wanted, Welcome};
pub use error::{ErrorCode, WireError};
pub use frame::{Frames, encode};
pub use hello::{Channel, Hello};

/// Version of the protocol.
pub const VERSION: u8 = 1;

/// First two bytes of every frame.
pub const MAGIC: [u8; 2] = *b"RW";

/// Bytes before the payload of a frame.
pub const HEADER_BYTES: usize = 12;

/// Most bytes of a payload.
pub const MAX_PAYLOAD_BYTES: usize = 1 << 20;

/// Most samples of a block.
pub const MAX_BLOCK_SAMPLES: usize = 1 << 16;

/// Most channels of a sender.
pub const MAX_CHANNELS: usize = 4096;

/// Most bytes of a machine's id or a channel's name.
pub const MAX_NAME_BYTES: usize = 128;

/// Most bytes of a token.
pub const MAX_TOKEN_BYTES: usize = 512;

/// Most bytes of a unit.
pub const MAX_UNIT_BYTES: usize = 16;

/// Most bytes of the text of an error.
pub const MAX_TEXT_BYTES: usize = 1024;

/// Highest sequence or sample index: beyond it a number is not exact in every language.
pub const MAX_INDEX: u64 = 1 << 53;

/// What a frame says.
#[derive(Debug, Clone, PartialEq)]
pub enum Message<'a> {
    /// A sender says who it is; the first frame of a connection.
    Hello(Hello),
    /// The daemon takes it and says where to go on.
    Welcome(Welcome),
    /// Samples of one channel.
    Block(Block<'a>),
    /// What the daemon has, and what it takes next.
    Ack(Ack),
    /// Why the connection ends.
    Problem(Problem),
    /// The sender ends.
    Bye(Bye),
    /// The sender is alive; the daemon answers with an [`Ack`].
    Ping,
}

#[cfg(test)]
mod tests;
