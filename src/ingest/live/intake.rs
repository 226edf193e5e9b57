//! All senders of a machine: who has which channel, where their samples lie in the machine's stream.
//!
//! Stream time counts from a fixed moment before the daemon began, so that the samples of all senders are on one axis
//! and what they buffered has its place. An epoch is placed once, by the time of its first block; from there on its index
//! is the clock.

use super::Refusal;
use super::drift::Estimate;
use super::lane::Lane;
use super::lane::Placing;
pub use super::lane::Taken;
use super::ledger::Ledger;
use super::openings::Openings;
use super::rules;
use crate::ingest::replay::StreamInfo;
use crate::machine::Machine;
use crate::signal::ChannelIndex;
use crate::signal::Timestamp;
use crate::units::Hz;
use crate::wire;
use crate::wire::ErrorCode;
use crate::wire::Wanted;
use std::collections::BTreeMap;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Names of channels that a machine may have had since the start: each has its counters, in metrics too.
const MAX_NAMES: usize = 2 * wire::MAX_CHANNELS;

/// A moment, by the clock of the daemon.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arrived(pub Timestamp);

/// A sender that may send.
#[derive(Debug, Clone, PartialEq)]
pub struct Admitted {
    /// Where each of its channels goes on.
    pub wanted: Vec<Wanted>,
    /// The stream as it is from now on, if it is another one than before.
    pub opened: Option<StreamInfo>,
}

/// A sender that is connected.
#[derive(Debug)]
struct Sender {
    epoch: u64,
    peer: String,
    since: Timestamp,
    /// Its channels, by their place in its hello.
    lanes: Vec<u32>,
    /// What is added to its times so that stream time does not go back, s; `None`: nothing of it is placed yet.
    shift_s: Option<f64>,
}

/// The senders and channels of one machine.
#[derive(Debug)]
pub struct Intake {
    machine: Arc<Machine>,
    /// UTC of stream time 0.
    origin: Timestamp,
    keeps_received: bool,
    lanes: BTreeMap<u32, Lane>,
    next_lane: u32,
    segment: u32,
    /// Whether a stream is open; speed and load that it was opened with.
    open: Option<(Option<f64>, Option<f64>)>,
    senders: BTreeMap<u64, Sender>,
    /// Channels that are not in the stream any more, by name: who comes back goes on with counts and place.
    gone: BTreeMap<String, Lane>,
    /// Connections that lost their channels to a newer one of the same sender.
    superseded: BTreeSet<u64>,
    openings: Openings,
}

/// How a channel is doing.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelStatus {
    /// Its name.
    pub name: String,
    /// Its place among the channels of the stream.
    pub channel: ChannelIndex,
    /// What became of its samples.
    pub ledger: Ledger,
    /// Since when that is counted: its first hello since the start of the daemon.
    pub counted_since: Timestamp,
    /// How its clock runs, if that is known.
    pub clock: Option<Estimate>,
    /// How far its sender's clock is behind that of the daemon, s, below 0: ahead; if that is known.
    pub offset_s: Option<f64>,
    /// What is wrong with what comes, for people.
    pub doubt: Option<String>,
    /// Time that its sender stated of one past the newest sample, UTC; `None`: it stated none.
    pub stated_until: Option<Timestamp>,
    /// Samples a second, as stated.
    pub rate_hz: f64,
    /// Where it is sent from at the moment, and since when.
    pub sender: Option<(String, Timestamp)>,
}

impl Intake {
    /// A machine without senders, whose stream time 0 is at `origin`; `keeps_received`: samples are also kept as they come.
    #[must_use]
    pub fn new(machine: Arc<Machine>, origin: Timestamp, keeps_received: bool) -> Self {
        Self {
            machine,
            origin,
            keeps_received,
            lanes: BTreeMap::new(),
            next_lane: 0,
            segment: 0,
            open: None,
            senders: BTreeMap::new(),
            gone: BTreeMap::new(),
            superseded: BTreeSet::new(),
            openings: Openings::default(),
        }
    }

    /// Lets a sender in. `room` says whether the stream, as it would be, fits into memory.
    ///
    /// # Errors
    /// When it cannot be; nothing has changed then.
    pub fn hello(
        &mut self,
        session: u64,
        (peer, arrived): (&str, Arrived),
        hello: &wire::Hello,
        room: &mut dyn FnMut(&StreamInfo) -> Result<(), String>,
    ) -> Result<Admitted, Refusal> {
        let described = rules::check(hello, &self.machine)?;
        let old = self.superseded_by(hello)?;
        // By place in the hello: the lane there is, or a new one.
        let places = self.places();
        let same = |channel: &wire::Channel| {
            let id = places.get(channel.name.as_str())?;
            Some(*id).filter(|id| self.lanes.get(id).is_some_and(|l| l.described == *channel))
        };
        let found: Vec<Option<u32>> = hello.channels.iter().map(same).collect();
        let facts = (hello.shaft_speed_hz, hello.load);
        let has_other_facts = self.open.is_some_and(|(speed, load)| {
            facts.0.is_some_and(|_| facts.0 != speed) || facts.1.is_some_and(|_| facts.1 != load)
        });
        let is_same = self.open.is_some() && found.iter().all(Option::is_some) && !has_other_facts;
        let mut opened = None;
        let ids = if is_same {
            found.into_iter().flatten().collect()
        } else {
            self.openings.check(&self.machine.id, arrived.0)?;
            let (ids, info) = self.reopen((&found, &old), described, facts, room)?;
            self.openings.spend();
            opened = Some(info);
            ids
        };
        for id in old {
            self.forget(id);
            self.superseded.insert(id);
        }
        Ok(Admitted { wanted: self.admit(session, (peer, arrived), hello.epoch, ids), opened })
    }

    /// The channels of the stream by their names.
    fn places(&self) -> BTreeMap<&str, u32> {
        self.lanes.iter().map(|(id, lane)| (lane.described.name.as_str(), *id)).collect()
    }

    /// Connections of the same sender that have a channel of the hello; an error if another sender has one.
    fn superseded_by(&self, hello: &wire::Hello) -> Result<BTreeSet<u64>, Refusal> {
        let mut old = BTreeSet::new();
        let places = self.places();
        for channel in &hello.channels {
            let lane = places.get(channel.name.as_str()).and_then(|id| self.lanes.get(id));
            let Some(owner) = lane.and_then(|lane| lane.owner) else { continue };
            let Some(sender) = self.senders.get(&owner) else { continue };
            if sender.epoch != hello.epoch {
                let text = format!(
                    "channel {:?} of machine {:?} is sent by {} since {}; a channel has one sender",
                    channel.name,
                    self.machine.id,
                    sender.peer,
                    rfc3339(sender.since)
                );
                return Err(Refusal::new(ErrorCode::ChannelTaken, text));
            }
            old.insert(owner);
        }
        Ok(old)
    }

    /// Makes the stream anew: with the channels of the hello and those that other senders have.
    fn reopen(
        &mut self,
        (found, old): (&[Option<u32>], &BTreeSet<u64>),
        described: Vec<Lane>,
        (speed_hz, load): (Option<f64>, Option<f64>),
        room: &mut dyn FnMut(&StreamInfo) -> Result<(), String>,
    ) -> Result<(Vec<u32>, StreamInfo), Refusal> {
        let known: BTreeSet<u32> = found.iter().copied().flatten().collect();
        let is_kept = |id: u32, lane: &Lane| {
            known.contains(&id) || lane.owner.is_some_and(|owner| !old.contains(&owner))
        };
        let kept = self.lanes.iter().filter(|(id, lane)| is_kept(**id, lane)).map(|(id, _)| *id);
        let kept: BTreeSet<u32> = kept.collect();
        let new = found.iter().zip(&described).filter(|(found, _)| found.is_none());
        let lanes =
            kept.iter().filter_map(|id| self.lanes.get(id)).chain(new.map(|(_, lane)| lane));
        let lanes: Vec<&Lane> = lanes.collect();
        let (before_speed, before_load) = self.open.unwrap_or_default();
        let facts = (speed_hz.or(before_speed), load.or(before_load));
        let info = StreamInfo {
            channels: lanes.iter().map(|lane| lane.info.clone()).collect(),
            start_time: Some(self.origin),
            shaft_speed: facts.0.map(Hz),
            load: facts.1,
            received: lanes.iter().map(|lane| lane.received.clone()).collect(),
        };
        let is_known = |name: &str| info.channels.iter().any(|channel| channel.name == name);
        if !self.machine.sensors.iter().any(|sensor| is_known(&sensor.channel)) {
            let sensors: Vec<&str> =
                self.machine.sensors.iter().map(|s| s.channel.as_str()).collect();
            let text = format!(
                "no channel has the name of a sensor of machine {:?}: {}",
                self.machine.id,
                sensors.join(", ")
            );
            return Err(Refusal::new(ErrorCode::BadChannel, text));
        }
        self.check_names(&info)?;
        room(&info).map_err(|text| Refusal::new(ErrorCode::NoRoom, text))?;
        self.open = Some(facts);
        self.segment = self.segment.saturating_add(1);
        let others = self.lanes.extract_if(.., |id, _| !kept.contains(id));
        self.gone.extend(others.map(|(_, lane)| (lane.described.name.clone(), lane)));
        let joined = found.iter().zip(described);
        let ids = joined.map(|(id, lane)| id.unwrap_or_else(|| self.join(lane))).collect();
        // Lanes stand by rising number, and those that are new have the highest.
        for (place, lane) in self.lanes.values_mut().enumerate() {
            lane.channel = ChannelIndex(place);
        }
        Ok((ids, info))
    }

    /// Whether there is room for the names of a stream beside those that channels have had.
    fn check_names(&self, info: &StreamInfo) -> Result<(), Refusal> {
        let now: BTreeSet<&String> = info.channels.iter().map(|channel| &channel.name).collect();
        let had = self.lanes.values().map(|lane| &lane.described.name).chain(self.gone.keys());
        let n_others = had.filter(|name| !now.contains(name)).count();
        if n_others + now.len() <= MAX_NAMES {
            return Ok(());
        }
        let text = format!(
            "machine {:?} has had {n_others} channels of other names since the start, and may have {MAX_NAMES} in all: name \
             them alike, or restart the daemon",
            self.machine.id
        );
        Err(Refusal::new(ErrorCode::NoRoom, text))
    }

    /// Puts a channel into the stream. One that was there before goes on as it was if it is described alike; else the new
    /// one has its counts, and lies behind it.
    fn join(&mut self, mut lane: Lane) -> u32 {
        match self.gone.remove(&lane.described.name) {
            Some(before) if before.described == lane.described => lane = before,
            Some(before) => lane.follow(&before),
            None => {}
        }
        let id = self.next_lane;
        self.next_lane = id.wrapping_add(1);
        self.lanes.insert(id, lane);
        id
    }

    /// Gives the channels to a sender.
    fn admit(
        &mut self,
        session: u64,
        (peer, arrived): (&str, Arrived),
        epoch: u64,
        ids: Vec<u32>,
    ) -> Vec<Wanted> {
        let is_new = |lane: &Lane| lane.epoch != Some(epoch);
        let of_it = ids.iter().filter_map(|id| self.lanes.get(id));
        if self.senders.is_empty() && of_it.clone().any(|lane| is_new(lane) && lane.end.is_some()) {
            // It begins anew and nobody else is there: no window shall lie over the time between.
            self.segment = self.segment.saturating_add(1);
        }
        let mut wanted = Vec::new();
        for id in &ids {
            let Some(lane) = self.lanes.get_mut(id) else { continue };
            lane.begin(epoch);
            lane.owner = Some(session);
            lane.counted_since.get_or_insert(arrived.0);
            wanted.push(lane.next);
        }
        let (peer, since) = (peer.to_owned(), arrived.0);
        self.senders.insert(session, Sender { epoch, peer, since, lanes: ids, shift_s: None });
        wanted
    }

    /// Takes a block in; `has_room`: there is room for what becomes of it, else it is counted as dropped. Gives the
    /// sequence wanted next, and what is to be handed on.
    ///
    /// # Errors
    /// When the sender must not go on; nothing has changed then.
    pub fn block(
        &mut self,
        session: u64,
        block: &wire::Block<'_>,
        arrived: Arrived,
        has_room: bool,
    ) -> Result<(u64, Taken), Refusal> {
        let id = self.lane_of(session, block)?;
        let Some(lane) = self.lanes.get(&id) else { return Err(rules::no_stream(block)) };
        rules::check_span(lane, block.samples.len())?;
        let now_s = seconds_since(self.origin, arrived.0);
        let wall_s = if block.time_ns == wire::NO_TIME {
            // The last sample has just been taken.
            now_s - block.samples.len() as f64 / lane.described.rate_hz
        } else {
            seconds_since(self.origin, Timestamp(block.time_ns))
        };
        rules::check_time(lane, block.first, (wall_s, now_s))?;
        let is_unplaced = lane.is_unplaced();
        let shift_s = if is_unplaced { self.sender_shift_s(session, wall_s) } else { 0.0 };
        let placing =
            Placing { segment: self.segment, keeps_received: self.keeps_received, has_room };
        let Some(lane) = self.lanes.get_mut(&id) else { return Err(rules::no_stream(block)) };
        if is_unplaced {
            lane.place(block.first, wall_s, shift_s);
            lane.next.sequence = block.sequence;
        }
        lane.observe(block.first, wall_s);
        let length_s = block.samples.len() as f64 / lane.described.rate_hz;
        let stated = Some(Timestamp(block.time_ns)).filter(|_| block.time_ns != wire::NO_TIME);
        lane.stated_until = stated.map(|first| first.plus_seconds(length_s));
        if stated.is_some() {
            lane.offset.observe(now_s, now_s - wall_s - length_s);
        }
        let taken = lane.take(block, placing);
        Ok((lane.next.sequence, taken))
    }

    /// The channel that a block is of.
    fn lane_of(&self, session: u64, block: &wire::Block<'_>) -> Result<u32, Refusal> {
        if self.superseded.contains(&session) {
            let text = "a newer connection of this sender has its channels";
            return Err(Refusal::new(ErrorCode::ChannelTaken, text));
        }
        let sender = self.senders.get(&session);
        let id = sender.and_then(|sender| sender.lanes.get(usize::from(block.stream)));
        let found = id.and_then(|id| Some((*id, self.lanes.get(id)?)));
        let (id, lane) = found.ok_or_else(|| rules::no_stream(block))?;
        if block.samples.kind() == lane.described.sample_type && !block.samples.is_empty() {
            return Ok(id);
        }
        let text = format!(
            "a block of channel {:?} with {} samples of type {}; at least one of type {} is taken",
            lane.described.name,
            block.samples.len(),
            block.samples.kind().name(),
            lane.described.sample_type.name()
        );
        Err(Refusal::new(ErrorCode::Malformed, text))
    }

    /// What is added to a sender's times, decided by the first of its channels that is placed.
    fn sender_shift_s(&mut self, session: u64, wall_s: f64) -> f64 {
        let Some(sender) = self.senders.get(&session) else { return 0.0 };
        let shift_s = sender.shift_s.unwrap_or_else(|| self.shift_s(&sender.lanes, wall_s));
        if let Some(sender) = self.senders.get_mut(&session) {
            sender.shift_s = Some(shift_s);
        }
        shift_s
    }

    /// What must be added to a sender's times: stream time does not go back in any of its channels, nor before 0.
    fn shift_s(&self, ids: &[u32], wall_s: f64) -> f64 {
        let ends = ids.iter().filter_map(|id| self.lanes.get(id)?.end);
        let reached_s = ends.map(|(_, end_s)| end_s).fold(0.0, f64::max);
        (reached_s - wall_s).max(0.0)
    }

    /// A sender has gone. Gives whether it was the last.
    pub fn leave(&mut self, session: u64) -> bool {
        self.superseded.remove(&session);
        self.forget(session) && self.senders.is_empty()
    }

    fn forget(&mut self, session: u64) -> bool {
        let Some(sender) = self.senders.remove(&session) else { return false };
        for id in sender.lanes {
            let lane = self.lanes.get_mut(&id).filter(|lane| lane.owner == Some(session));
            if let Some(lane) = lane {
                lane.owner = None;
            }
        }
        true
    }

    /// Senders that are connected.
    #[must_use]
    pub fn n_senders(&self) -> usize {
        self.senders.len()
    }

    /// What became of the samples of each channel there was since the start, by its name: first those of the stream, in
    /// their order.
    pub fn ledgers(&self) -> impl Iterator<Item = (&str, &Ledger)> {
        let lanes = self.lanes.values().chain(self.gone.values());
        lanes.map(|lane| (lane.described.name.as_str(), &lane.ledger))
    }

    /// What is wrong with what comes: a clock that runs so wrong that its rate cannot be what is stated, one that is far off, samples that had all come before.
    pub fn doubts(&mut self) -> Vec<String> {
        let doubt = |lane: &mut Lane| {
            let doubt = lane.doubt()?;
            Some(format!("channel `{}`: {doubt}", lane.described.name))
        };
        self.lanes.values_mut().filter_map(doubt).collect()
    }

    /// How each channel is doing, in the order of the stream.
    pub fn status(&mut self) -> Vec<ChannelStatus> {
        let (senders, origin) = (&self.senders, self.origin);
        let status = |lane: &mut Lane| {
            let sender = lane.owner.and_then(|owner| senders.get(&owner));
            ChannelStatus {
                name: lane.described.name.clone(),
                channel: lane.channel,
                ledger: lane.ledger,
                counted_since: lane.counted_since.unwrap_or(origin),
                clock: lane.drift.estimate(),
                offset_s: lane.offset.estimate_s(),
                doubt: lane.doubt(),
                stated_until: lane.stated_until,
                rate_hz: lane.described.rate_hz,
                sender: sender.map(|sender| (sender.peer.clone(), sender.since)),
            }
        };
        self.lanes.values_mut().map(status).collect()
    }
}

/// Time from one moment to another, s; exact to a microsecond over centuries.
fn seconds_since(origin: Timestamp, at: Timestamp) -> f64 {
    // Both are 64 bits wide: their difference is not, and fits into 128.
    (i128::from(at.0) - i128::from(origin.0)) as f64 / 1e9
}

fn rfc3339(at: Timestamp) -> String {
    jiff::Timestamp::from_nanosecond(i128::from(at.0)).unwrap_or_default().to_string()
}
