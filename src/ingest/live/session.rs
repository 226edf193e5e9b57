//! One connection: whose turn it is, how long it may take, how much may be under way.

use super::Refusal;
use crate::wire;
use crate::wire::ErrorCode;
use crate::wire::Message;
use crate::wire::Progress;
use std::collections::BTreeMap;

/// Longest time until the hello, s.
pub const HELLO_S: f64 = 5.0;

/// Longest time from the first byte of a frame to its last, s.
pub const FRAME_S: f64 = 10.0;

/// Longest silence, s.
pub const IDLE_S: f64 = 60.0;

/// Credit while the analysis keeps up, bytes.
pub const CREDIT_BYTES: u32 = 2 << 20;

/// Longest time from a block to its ack, s.
const ACK_S: f64 = 0.05;

/// Bytes of blocks after which an ack is due at once.
const ACK_BYTES: u64 = 256 << 10;

/// The turns of one connection.
#[derive(Debug)]
pub struct Session {
    is_greeted: bool,
    is_over: bool,
    begun_s: f64,
    last_frame_s: f64,
    /// When the frame began that has not come as a whole.
    part_since_s: Option<f64>,
    /// Bytes of frames that came, and up to which the sender may send.
    came: u64,
    may_come: u64,
    /// Bytes that had come at the last ack, and the credit it gave.
    acked: u64,
    credit_bytes: u32,
    /// Channels of which there is more than the last ack said.
    progress: BTreeMap<u16, u64>,
    /// When the oldest of it came.
    due_since_s: Option<f64>,
    /// The sender waits for an ack.
    is_asked: bool,
}

impl Session {
    /// A connection that begins now, s of any clock that only goes forward.
    #[must_use]
    pub fn new(now_s: f64) -> Self {
        Self {
            is_greeted: false,
            is_over: false,
            begun_s: now_s,
            last_frame_s: now_s,
            part_since_s: None,
            came: 0,
            may_come: 0,
            acked: 0,
            credit_bytes: 0,
            progress: BTreeMap::new(),
            due_since_s: None,
            is_asked: false,
        }
    }

    /// Takes in that the sender is alive, as far as it was listened to.
    pub fn heard(&mut self, now_s: f64) {
        self.last_frame_s = now_s;
    }

    /// Takes in that a frame of so many bytes has come; says whether a block is within its credit.
    ///
    /// # Errors
    /// When it is out of its turn.
    pub fn frame(
        &mut self,
        message: &Message<'_>,
        n_bytes: usize,
        now_s: f64,
    ) -> Result<bool, Refusal> {
        self.last_frame_s = now_s;
        self.part_since_s = None;
        let unexpected = |text: &str| Err(Refusal::new(ErrorCode::Unexpected, text));
        if self.is_over {
            return unexpected("a frame after the bye");
        }
        match message {
            Message::Hello(_) if self.is_greeted => unexpected("a second hello"),
            Message::Hello(_) => {
                self.is_greeted = true;
                Ok(true)
            }
            Message::Welcome(_) | Message::Ack(_) | Message::Problem(_) => {
                unexpected("a frame that only the daemon sends")
            }
            Message::Block(_) | Message::Bye(_) | Message::Ping if !self.is_greeted => {
                unexpected("the first frame of a connection is a hello")
            }
            Message::Block(_) => {
                // With nothing under way one block may be larger than the credit.
                let is_alone = self.came == self.acked && self.credit_bytes > 0;
                self.came += n_bytes as u64;
                Ok(self.came <= self.may_come || is_alone)
            }
            Message::Bye(_) => {
                self.is_over = true;
                self.is_asked = true;
                Ok(true)
            }
            Message::Ping => {
                self.is_asked = true;
                Ok(true)
            }
        }
    }

    /// The answer to the hello; `fill`: how full the queue of the analysis is, 0 to 1.
    pub fn welcome(&mut self, wanted: Vec<wire::Wanted>, fill: f64) -> wire::Welcome {
        let credit_bytes = self.grant(fill);
        wire::Welcome { credit_bytes, wanted }
    }

    /// Takes in that a block is settled.
    pub fn settle(&mut self, stream: u16, sequence: u64, now_s: f64) {
        self.progress.insert(stream, sequence);
        self.due_since_s.get_or_insert(now_s);
    }

    /// The ack that is due, if one is.
    pub fn ack(&mut self, fill: f64, now_s: f64) -> Option<wire::Ack> {
        if !self.is_greeted {
            return None;
        }
        let is_late = self.due_since_s.is_some_and(|since_s| now_s - since_s >= ACK_S);
        let is_much = self.came - self.acked >= ACK_BYTES;
        // A sender without credit is told when there is some again.
        let is_freed = self.credit_bytes == 0 && credit_bytes(fill) > 0;
        if !(is_late || is_much && self.due_since_s.is_some() || is_freed || self.is_asked) {
            return None;
        }
        let progress = std::mem::take(&mut self.progress).into_iter();
        let progress = progress.map(|(stream, sequence)| Progress { stream, sequence }).collect();
        (self.due_since_s, self.is_asked) = (None, false);
        Some(wire::Ack { credit_bytes: self.grant(fill), progress })
    }

    /// Gives credit. What was given is never taken back.
    fn grant(&mut self, fill: f64) -> u32 {
        self.acked = self.came;
        self.credit_bytes = credit_bytes(fill);
        self.may_come = self.may_come.max(self.came + u64::from(self.credit_bytes));
        self.credit_bytes
    }

    /// Whether the sender has said its bye.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.is_over
    }

    /// Takes in that time has passed; `is_within`: a part of a frame has come.
    ///
    /// # Errors
    /// When the sender takes too long.
    pub fn tick(&mut self, is_within: bool, now_s: f64) -> Result<(), Refusal> {
        let late = |text: String| Err(Refusal::new(ErrorCode::Timeout, text));
        if !self.is_greeted && now_s - self.begun_s > HELLO_S {
            return late(format!("no hello has come within {HELLO_S} s"));
        }
        if is_within {
            let since_s = *self.part_since_s.get_or_insert(now_s);
            if now_s - since_s > FRAME_S {
                return late(format!("a frame is not complete after {FRAME_S} s"));
            }
        } else {
            self.part_since_s = None;
        }
        if now_s - self.last_frame_s > IDLE_S {
            return late(format!(
                "nothing has come for {IDLE_S} s; a ping says that you are alive"
            ));
        }
        Ok(())
    }
}

/// What may be under way: less as the queue of the analysis fills.
fn credit_bytes(fill: f64) -> u32 {
    match fill {
        fill if fill < 0.5 => CREDIT_BYTES,
        fill if fill < 0.75 => CREDIT_BYTES / 4,
        fill if fill < 0.9 => CREDIT_BYTES / 16,
        _ => 0,
    }
}
