//! The way of all senders of one machine into its shard's queue.

use super::Room;
use crate::api::handles::IngestView;
use crate::api::view::SourceState;
use crate::app::fitted::Fitted;
use crate::app::link::Input;
use crate::app::link::Link;
use crate::app::queue::Closed;
use crate::app::recording::Recording;
use crate::app::renewal::InForce;
use crate::app::trouble::Troubles;
use crate::capture::recording::store::Store as Recordings;
use crate::config::Live;
use crate::config::SourceConfig;
use crate::ingest::live::Refusal;
use crate::ingest::live::intake::Arrived;
use crate::ingest::live::intake::Intake;
use crate::ingest::live::ledger::Ledger;
use crate::ingest::replay::StreamInfo;
use crate::signal::Timestamp;
use crate::telemetry::Metrics;
use crate::telemetry::RecordingMetrics;
use crate::wire;
use crate::wire::ErrorCode;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::MutexGuard;
use std::sync::PoisonError;
use std::time::Duration;
use std::time::Instant;
use tokio::sync::watch;

/// Least time between two words to the shard on samples that were rejected.
const TELL_EVERY: Duration = Duration::from_secs(1);

/// Memory of a block besides its samples, bytes: more than it is.
const BLOCK_OVERHEAD: usize = 512;

/// What a port is made of.
pub(in crate::app) struct PortPlan {
    /// The settings that hold.
    pub(in crate::app) in_force: watch::Receiver<InForce>,
    pub(in crate::app) origin: Timestamp,
    pub(in crate::app) link: Link,
    pub(in crate::app) room: Arc<Room>,
    pub(in crate::app) recordings: Option<Arc<Mutex<Recordings>>>,
    pub(in crate::app) recorded: watch::Sender<crate::api::view::RecordingView>,
    pub(in crate::app) recording_metrics: RecordingMetrics,
    pub(in crate::app) troubles: Troubles,
}

/// One machine's way.
///
/// Who needs both locks takes that of the recorder first: a disk may keep it for long, and who only asks how the senders are
/// doing does not wait for it.
pub(in crate::app) struct Port {
    plan: PortPlan,
    machine: String,
    live: Live,
    /// Whether the shard holds what was received.
    is_captured: bool,
    recorder: Mutex<Recorder>,
    state: Mutex<State>,
}

/// What is recorded of the stream that is open.
#[derive(Default)]
pub(super) struct Recorder {
    info: Option<StreamInfo>,
    recording: Option<Recording>,
}

impl std::fmt::Debug for Port {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Port").field("machine", &self.machine()).finish_non_exhaustive()
    }
}

struct State {
    intake: Intake,
    /// What the shard and the metrics know of each channel.
    told: BTreeMap<String, (u64, u64)>,
    told_at: Instant,
    /// What the shard knows of clocks that run wrong.
    doubts: Vec<String>,
    counted: BTreeMap<String, Ledger>,
}

/// What became of a block.
#[derive(Debug)]
pub(super) enum Became {
    /// It is settled; the sequence wanted next.
    Settled(u64),
    /// There is no room yet; try again.
    Wait,
}

impl Port {
    /// Makes the way.
    #[must_use]
    pub(in crate::app) fn new(plan: PortPlan) -> Self {
        let InForce { config, entry, .. } = plan.in_force.borrow().clone();
        let is_captured = config.captures.is_some();
        let keeps_received = is_captured || plan.recordings.is_some();
        let machine = entry.machine.id.clone();
        let intake = Intake::new(entry.machine, plan.origin, keeps_received);
        let state = State {
            intake,
            told: BTreeMap::new(),
            told_at: crate::app::now(),
            doubts: Vec::new(),
            counted: BTreeMap::new(),
        };
        let live = match entry.source {
            SourceConfig::Live(live) => live,
            SourceConfig::Replay(_) | SourceConfig::Simulated(_) => Live::default(),
        };
        let (recorder, state) = (Mutex::default(), Mutex::new(state));
        Self { plan, machine, live, is_captured, recorder, state }
    }

    /// The machine's id.
    pub(super) fn machine(&self) -> &str {
        &self.machine
    }

    /// From where its samples come.
    pub(in crate::app) fn live(&self) -> &Live {
        &self.live
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn recorder(&self) -> MutexGuard<'_, Recorder> {
        self.recorder.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// How full the queue before the analysis is.
    pub(super) fn fill(&self) -> f64 {
        self.plan.link.fill()
    }

    /// Lets a sender in, and opens the stream if it is another one; gives where its channels go on. `None`: there is no
    /// room for that yet, try again.
    pub(super) fn hello(
        &self,
        session: u64,
        (peer, arrived): (&str, Arrived),
        hello: &wire::Hello,
    ) -> Result<Option<Vec<wire::Wanted>>, Refusal> {
        let mut recorder = self.recorder();
        let mut state = self.lock();
        if !self.plan.link.keep_room(BLOCK_OVERHEAD).map_err(|Closed| stopping())? {
            return Ok(None);
        }
        let mut room = |info: &StreamInfo| {
            let InForce { config, entry, .. } = &*self.plan.in_force.borrow();
            let bytes = Fitted::of(config, &entry.machine, info).memory_bytes(info);
            self.plan.room.take(self.machine(), bytes)
        };
        let admitted = state.intake.hello(session, (peer, arrived), hello, &mut room);
        let opened = admitted.as_ref().ok().and_then(|admitted| admitted.opened.clone());
        let inputs = opened.clone().map(|info| Input::Open(Box::new(info)));
        self.plan.link.send_kept(inputs, BLOCK_OVERHEAD).map_err(|Closed| stopping())?;
        let admitted = admitted?;
        drop(state);
        if let Some(info) = opened {
            recorder.finish();
            tracing::info!(
                machine = self.machine(),
                peer,
                n_channels = info.channels.len(),
                "a stream was opened"
            );
            recorder.info = Some(info);
        } else {
            tracing::info!(machine = self.machine(), peer, "a sender goes on");
        }
        self.record(&mut recorder);
        Ok(Some(admitted.wanted))
    }

    /// Begins to record, if that is wanted and not done.
    fn record(&self, recorder: &mut Recorder) {
        let Recorder { recording, info: Some(info) } = recorder else { return };
        let Some(store) = self.plan.recordings.as_ref().filter(|_| recording.is_none()) else {
            return;
        };
        let PortPlan { in_force, recorded, recording_metrics, troubles, .. } = &self.plan;
        let told = (recording_metrics.clone(), recorded.clone(), troubles.clone());
        *recording = Recording::with_view(in_force, info, store, told);
    }

    /// Takes a block in. `within_credit`: the sender may wait for room; else, without room, its samples are dropped.
    pub(super) fn block(
        &self,
        session: u64,
        (block, n_bytes): (&wire::Block<'_>, usize),
        arrived: Arrived,
        within_credit: bool,
    ) -> Result<Became, Refusal> {
        // As samples in single precision, as they came, and what stands around both.
        let kept = block.samples.len() * size_of::<f32>() + 2 * n_bytes + BLOCK_OVERHEAD;
        let mut recorder = self.recorder();
        let mut state = self.lock();
        let has_room = self.plan.link.keep_room(kept).map_err(|Closed| stopping())?;
        if !has_room && within_credit {
            return Ok(Became::Wait);
        }
        let taken = state.intake.block(session, block, arrived, has_room);
        let kept = if has_room { kept } else { 0 };
        let (sequence, taken) = match taken {
            Ok(taken) => taken,
            Err(refusal) => {
                let _closed = self.plan.link.send_kept(None, kept);
                return Err(refusal);
            }
        };
        if !has_room {
            self.plan.link.note_dropped(block.samples.len() as u64);
        }
        let received = taken.received.map(Arc::new);
        let now = crate::app::now();
        let inputs = received.clone().filter(|_| self.is_captured).map(Input::Received);
        let blocks = taken.blocks.into_iter().map(|block| Input::Block(block, now));
        let inputs = inputs.into_iter().chain(blocks);
        self.plan.link.send_kept(inputs, kept).map_err(|Closed| stopping())?;
        self.tell(&mut state, false);
        drop(state);
        if let (Some(run), Some(recording)) = (received, &mut recorder.recording) {
            recording.take(Arc::unwrap_or_clone(run));
        }
        Ok(Became::Settled(sequence))
    }

    /// Lets the shard know what was rejected and whose clock runs wrong, at times.
    fn tell(&self, state: &mut State, now: bool) {
        if !now && crate::app::now().saturating_duration_since(state.told_at) < TELL_EVERY {
            return;
        }
        state.told_at = crate::app::now();
        let doubts = state.intake.doubts();
        if doubts != state.doubts {
            state.doubts.clone_from(&doubts);
            let _closed = self.plan.link.send_kept([Input::Doubts(doubts)], 0);
        }
        let State { intake, told, .. } = state;
        let (mut not_finite, mut out_of_range) = (0, 0);
        let bad = |(_, ledger): &(&str, &Ledger)| ledger.not_finite + ledger.out_of_range > 0;
        for (name, ledger) in intake.ledgers().filter(bad) {
            let told = told.entry(name.to_owned()).or_default();
            not_finite += ledger.not_finite.saturating_sub(told.0);
            out_of_range += ledger.out_of_range.saturating_sub(told.1);
            *told = (ledger.not_finite, ledger.out_of_range);
        }
        for (n_samples, reason) in [
            (not_finite, "not finite numbers"),
            (out_of_range, "beyond the range of the converter"),
        ] {
            if n_samples > 0 {
                let input = Input::Rejected { n_samples, reason: reason.to_owned() };
                // Closed: nobody is left to tell.
                let _closed = self.plan.link.send_kept([input], 0);
            }
        }
    }

    /// Lets time pass.
    pub(super) fn tick(&self) {
        self.tell(&mut self.lock(), false);
        if let Some(recording) = &mut self.recorder().recording
            && recording.flush_due().is_some_and(|due| due <= crate::app::now())
        {
            recording.tick();
        }
    }

    /// A sender has gone; `has_ended`: its stream is complete.
    pub(super) fn leave(&self, session: u64, has_ended: bool) {
        let mut recorder = self.recorder();
        let mut state = self.lock();
        self.tell(&mut state, true);
        if !state.intake.leave(session) {
            return;
        }
        if has_ended {
            let _closed = self.plan.link.send_kept([Input::Source(SourceState::Finished)], 0);
        }
        drop(state);
        recorder.finish();
    }

    /// Completes what is recorded.
    pub(super) fn finish_recording(&self) {
        self.recorder().finish();
    }

    /// How the senders are doing.
    pub(in crate::app) fn view(&self) -> IngestView {
        let mut state = self.lock();
        let (n_senders, channels) = (state.intake.n_senders(), state.intake.status());
        IngestView { n_senders, channels, at: crate::app::wall_clock() }
    }

    /// Brings the counters up to date.
    pub(super) fn count(&self, metrics: &Metrics) {
        let mut state = self.lock();
        let State { intake, counted, .. } = &mut *state;
        for (name, ledger) in intake.ledgers() {
            // Counts of a name only rise, whatever becomes of its stream.
            let before = counted.entry(name.to_owned()).or_default();
            let fates = ledger.fates().into_iter().zip(before.fates());
            for ((fate, n), (_, told)) in fates.filter(|((_, n), (_, told))| n > told) {
                metrics.ingested(self.machine(), name, fate).inc_by(n.saturating_sub(told));
            }
            *before = *ledger;
        }
        for channel in intake.status() {
            if let Some(clock) = channel.clock {
                metrics.clock_drift(self.machine(), &channel.name).set(clock.ppm);
            }
            if let Some(offset_s) = channel.offset_s {
                metrics.clock_offset(self.machine(), &channel.name).set(offset_s);
            }
        }
    }
}

impl Recorder {
    /// Completes the file.
    fn finish(&mut self) {
        if let Some(recording) = self.recording.take() {
            recording.finish();
        }
    }
}

pub(super) fn stopping() -> Refusal {
    Refusal::new(ErrorCode::Stopping, "the daemon is stopping; try again later")
}
