//! A source's end of the way to its machine's shard.

use super::queue::Closed;
use super::queue::Queue;
use super::renewal::Renewed;
use crate::api::view::ShardBusy;
use crate::api::view::ShardRequest;
use crate::api::view::SourceState;
use crate::capture::received::Received;
use crate::ingest::replay::StreamInfo;
use crate::signal::Block;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::Ordering;
use std::time::Duration;
use std::time::Instant;

/// How long who was refused room is taken to want it still: a sender asks every few milliseconds.
const WANTS_ROOM: Duration = Duration::from_secs(1);

/// What a source tells its shard.
#[derive(Debug)]
pub enum Input {
    /// Samples, and when they arrived.
    Block(Block, Instant),
    /// Samples behind blocks to come, as they were received.
    Received(Arc<Received>),
    /// Samples that the source received but cannot hand on.
    Rejected {
        /// How many.
        n_samples: u64,
        /// Why.
        reason: String,
    },
    /// Why the rates of channels cannot be what is stated, for people; instead of what was said before.
    Doubts(Vec<String>),
    /// How the source is doing.
    Source(SourceState),
    /// The stream is another one from here on.
    Open(Box<StreamInfo>),
    /// The settings are others from here on.
    Renew(Box<Renewed>),
}

/// Input or request, with the place of the machine on its shard.
pub type ShardQueue = Queue<(usize, Input), (usize, ShardRequest)>;

/// The way to one machine; cheap to clone.
#[derive(Debug, Clone)]
pub struct Link {
    queue: Arc<ShardQueue>,
    /// Place of the machine on its shard.
    machine: usize,
    traffic: Arc<Traffic>,
}

/// What one machine has on the way to its shard, and what was lost because the queue was full.
#[derive(Debug, Default)]
pub struct Traffic {
    blocks_lost: AtomicU64,
    samples_lost: AtomicU64,
    /// Inputs of this machine that its shard has not taken.
    n_waiting: AtomicUsize,
    /// When there was no room for some of it last.
    refused_at: Mutex<Option<Instant>>,
}

impl Traffic {
    /// Blocks and samples lost so far.
    #[must_use]
    pub fn lost(&self) -> (u64, u64) {
        (self.blocks_lost.load(Ordering::Relaxed), self.samples_lost.load(Ordering::Relaxed))
    }

    /// Whether something of this machine waits for its shard, or for room in the queue before it.
    #[must_use]
    pub fn waits(&self) -> bool {
        let refused = *self.refused_at.lock().unwrap_or_else(PoisonError::into_inner);
        let wants_room = |at| super::now().saturating_duration_since(at) < WANTS_ROOM;
        self.n_waiting.load(Ordering::Relaxed) > 0 || refused.is_some_and(wants_room)
    }

    /// An input goes on its way. The queue's lock orders this before its being taken.
    fn note_sent(&self) {
        self.n_waiting.fetch_add(1, Ordering::Relaxed);
    }

    /// The shard has taken an input.
    pub fn note_taken(&self) {
        self.n_waiting.fetch_sub(1, Ordering::Relaxed);
    }

    fn note_refused(&self) {
        let now = Some(super::now());
        *self.refused_at.lock().unwrap_or_else(PoisonError::into_inner) = now;
    }
}

impl Link {
    /// Makes the way to the machine at place `machine` of the shard behind `queue`.
    #[must_use]
    pub fn new(queue: Arc<ShardQueue>, machine: usize) -> Self {
        Self { queue, machine, traffic: Arc::default() }
    }

    /// What is on this way, and what was lost.
    #[must_use]
    pub fn traffic(&self) -> &Arc<Traffic> {
        &self.traffic
    }

    /// Hands an input on, waiting for room: nothing is lost.
    ///
    /// # Errors
    /// When the daemon is stopping.
    pub fn send(&self, input: Input) -> Result<(), Closed> {
        let bytes = bytes_of(&input);
        self.traffic.note_sent();
        let sent = self.queue.push_wait((self.machine, input), bytes);
        sent.inspect_err(|_| self.traffic.note_taken())
    }

    /// Keeps room for what a live sender's block becomes; false: there is none.
    ///
    /// # Errors
    /// When the daemon is stopping.
    pub fn keep_room(&self, bytes: usize) -> Result<bool, Closed> {
        let has_room = self.queue.keep_room(bytes);
        if has_room == Ok(false) {
            self.traffic.note_refused();
        }
        has_room
    }

    /// Hands inputs on for which room was kept.
    ///
    /// # Errors
    /// When the daemon is stopping.
    pub fn send_kept(
        &self,
        inputs: impl IntoIterator<Item = Input>,
        kept: usize,
    ) -> Result<(), Closed> {
        let sized = inputs.into_iter().map(|input| {
            let bytes = bytes_of(&input);
            self.traffic.note_sent();
            ((self.machine, input), bytes)
        });
        self.queue.push_kept(sized, kept)
    }

    /// How full the queue is, 0 to 1 or more.
    #[must_use]
    pub fn fill(&self) -> f64 {
        self.queue.fill()
    }

    /// Counts a block that a live sender sent without credit, and for which there was no room.
    pub fn note_dropped(&self, n_samples: u64) {
        self.traffic.blocks_lost.fetch_add(1, Ordering::Relaxed);
        self.traffic.samples_lost.fetch_add(n_samples, Ordering::Relaxed);
    }

    /// Puts a question to the shard; it is answered between two blocks.
    ///
    /// # Errors
    /// When too many questions are waiting.
    pub fn ask(&self, request: ShardRequest) -> Result<(), ShardBusy> {
        self.queue.try_request((self.machine, request)).map_err(|_| ShardBusy)
    }
}

/// Memory an input takes while it waits.
fn bytes_of(input: &Input) -> usize {
    let heap = match input {
        Input::Block(block, _) => block.samples.capacity() * size_of::<f32>(),
        Input::Rejected { reason, .. } => reason.len(),
        Input::Received(run) => run.bytes(),
        Input::Source(_) | Input::Renew(_) => 0,
        Input::Doubts(doubts) => doubts.iter().map(String::capacity).sum(),
        Input::Open(info) => size_of::<StreamInfo>() + info.channels.len() * 512,
    };
    size_of::<(usize, Input)>() + heap
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::signal::ChannelIndex;
    use crate::signal::SampleIndex;

    #[test]
    fn a_live_source_loses_the_newest_block_and_counts_it() {
        let queue = Arc::new(ShardQueue::new(1000, 1));
        let link = Link::new(Arc::clone(&queue), 0);
        for start in [0, 200, 400] {
            let block = Block {
                channel: ChannelIndex(0),
                start: SampleIndex(start),
                segment: 0,
                time_s: 0.0,
                samples: vec![0.0; 200], // 800 bytes: the second does not fit
            };
            let input = Input::Block(block, super::super::now());
            let bytes = bytes_of(&input);
            match link.keep_room(bytes) {
                Ok(true) => link.send_kept([input], bytes).unwrap(),
                Ok(false) => link.note_dropped(200),
                Err(Closed) => panic!("it is open"),
            }
        }
        assert_eq!(link.traffic().lost(), (2, 400));
        queue.close();
        assert_eq!(link.send(Input::Source(SourceState::Finished)), Err(Closed));
    }
}
