//! One channel of a machine: where each of its samples belongs, and what becomes of it.

use super::Refusal;
use super::drift::Drift;
use super::ledger::Ledger;
use super::offset::Offset;
use crate::capture::live::LiveChannel;
use crate::capture::received::NumberType;
use crate::capture::received::RawSamples;
use crate::capture::received::Received;
use crate::capture::received::ReceivedChannel;
use crate::machine::Machine;
use crate::signal::Block;
use crate::signal::ChannelIndex;
use crate::signal::ChannelInfo;
use crate::signal::SampleIndex;
use crate::signal::Timestamp;
use crate::units::Hz;
use crate::units::SourceUnit;
use crate::wire;
use crate::wire::ErrorCode;
use crate::wire::SampleType;
use crate::wire::Samples;
use std::collections::VecDeque;

/// Rates that are taken, samples a second.
const RATES_HZ: (f64, f64) = (1e-3, 1e7);

/// Samples beyond this magnitude no sensor measures, and spectra in single precision would overflow by them.
const LARGEST: f32 = 1e15;

/// Gaps of which it is remembered that they are ones, so that what comes late is told from what comes twice.
const MAX_GAPS: usize = 64;

/// Runs of good samples that a block is cut into; with more bad ones between them it is rejected as a whole.
const MAX_RUNS: usize = 64;

/// A channel.
#[derive(Debug)]
pub(super) struct Lane {
    pub(super) described: wire::Channel,
    pub(super) info: ChannelInfo,
    pub(super) received: ReceivedChannel,
    live: LiveChannel,
    /// Place among the channels of the stream that is open.
    pub(super) channel: ChannelIndex,
    /// Who sends it.
    pub(super) owner: Option<u64>,
    pub(super) epoch: Option<u64>,
    /// The next block and sample of the epoch.
    pub(super) next: wire::Wanted,
    /// Where the epoch lies in the machine's stream, once its first block has come.
    anchor: Option<Anchor>,
    /// One past the newest sample in the machine's stream: index and stream time, s.
    pub(super) end: Option<(u64, f64)>,
    /// Ranges of the epoch's indices that were lost, oldest first.
    gaps: VecDeque<(u64, u64)>,
    pub(super) ledger: Ledger,
    /// When it was first let in.
    pub(super) counted_since: Option<Timestamp>,
    /// Time that the sender states of one past its newest sample, UTC; `None`: it states none.
    pub(super) stated_until: Option<Timestamp>,
    pub(super) drift: Drift,
    pub(super) offset: Offset,
    /// Samples in a row that had come before.
    repeated: u64,
}

/// Time for which nothing but samples come that had come before until that is told, s: after a break a sender sends some again.
const REPEATED_S: f64 = 5.0;

/// Where an epoch lies.
#[derive(Debug, Clone, Copy)]
pub(super) struct Anchor {
    /// Index of the epoch's sample 0 in the machine's stream; below 0 where the epoch began before it.
    base: i64,
    /// Stream time of the epoch's sample 0, s.
    zero_s: f64,
    /// Wall clock at the epoch's sample 0, and at its first block, s of stream time: before any shift.
    wall_zero_s: f64,
    wall_first_s: f64,
}

/// What is made of a block.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Taken {
    /// Runs of good samples.
    pub blocks: Vec<Block>,
    /// The samples as they came, if they are kept.
    pub received: Option<Received>,
}

/// How a block is placed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placing {
    pub(super) segment: u32,
    /// Whether raw samples are kept.
    pub(super) keeps_received: bool,
    /// Whether there is room; else the samples are counted as dropped.
    pub(super) has_room: bool,
}

impl Lane {
    /// Makes a channel as it is described.
    pub(super) fn new(described: &wire::Channel, machine: &Machine) -> Result<Self, Refusal> {
        let name = &described.name;
        let bad =
            |why: String| Refusal::new(ErrorCode::BadChannel, format!("channel {name:?}: {why}"));
        if name.is_empty() || name.contains('/') || name.chars().any(char::is_control) {
            return Err(bad(
                "a name is not empty and has no / and no control characters".to_owned()
            ));
        }
        let (low, high) = RATES_HZ;
        if !(low..=high).contains(&described.rate_hz) {
            return Err(bad(format!(
                "{} samples a second; allowed: {low} to {high}",
                described.rate_hz
            )));
        }
        if !described.unit.is_empty() && SourceUnit::parse(&described.unit).is_none() {
            let accepted = SourceUnit::ACCEPTED.join(", ");
            return Err(bad(format!("unit {:?} is none of {accepted}", described.unit)));
        }
        let range = described.range.or(described.sample_type.ends());
        if range.is_some_and(|(low, high)| !(low < high && low.is_finite() && high.is_finite())) {
            return Err(bad("the lowest raw value is not below the highest".to_owned()));
        }
        let received = ReceivedChannel {
            name: name.clone(),
            sample_rate: Hz(described.rate_hz),
            number_type: number_type(described.sample_type),
            scale: described.scale,
            offset: described.offset,
            raw_zero: described.zero,
            unit: (!described.unit.is_empty()).then(|| described.unit.clone()),
            sensor: None,
        };
        let (live, mut info) = LiveChannel::new(&received, machine).ok_or_else(|| {
            bad(format!(
                "scale {} and offset {} are not finite, the scale is 0, or the result leaves single precision",
                described.scale, described.offset
            ))
        })?;
        info.full_scale = range.and_then(|(low, high)| {
            let ends = live.samples(ends(received.number_type, low, high));
            let (low, high) = (*ends.first()?, *ends.last()?);
            Some(if low <= high { (low, high) } else { (high, low) })
        });
        Ok(Self {
            described: described.clone(),
            info,
            received,
            live,
            channel: ChannelIndex(0),
            owner: None,
            epoch: None,
            next: wire::Wanted { sequence: 0, index: 0 },
            anchor: None,
            end: None,
            gaps: VecDeque::new(),
            ledger: Ledger::default(),
            counted_since: None,
            stated_until: None,
            drift: Drift::default(),
            offset: Offset::default(),
            repeated: 0,
        })
    }

    /// Whether the epoch's first block is still to come.
    pub(super) fn is_unplaced(&self) -> bool {
        self.anchor.is_none()
    }

    /// Goes on with an epoch, or begins another.
    pub(super) fn begin(&mut self, epoch: u64) {
        if self.epoch == Some(epoch) {
            return;
        }
        self.epoch = Some(epoch);
        self.next = wire::Wanted { sequence: 0, index: 0 };
        self.anchor = None;
        self.gaps.clear();
        self.drift = Drift::default();
        self.offset = Offset::default();
        self.repeated = 0;
    }

    /// What is wrong with what comes, for people; `None`: nothing is known to be.
    pub(super) fn doubt(&mut self) -> Option<String> {
        let rate_hz = self.described.rate_hz;
        if self.repeated as f64 >= REPEATED_S * rate_hz {
            let (n, epoch) = (self.repeated, self.epoch.unwrap_or_default());
            return Some(format!(
                "the newest {n} samples had come before, and none of them is used: a sender that begins anew must state another \
                 epoch than {epoch}"
            ));
        }
        let drift = self.drift.estimate().and_then(|estimate| estimate.doubt(rate_hz));
        drift.or_else(|| self.offset.doubt())
    }

    /// Takes over what another description of the channel has counted and where it has come to.
    pub(super) fn follow(&mut self, before: &Self) {
        self.ledger = before.ledger;
        self.counted_since = before.counted_since;
        // Another rate counts other samples: the index goes on, so that it never goes back.
        self.end = before.end;
    }

    /// Places the epoch by the stream time at which a sample of it was taken; `shift_s` is added to that.
    pub(super) fn place(&mut self, index: u64, wall_s: f64, shift_s: f64) {
        let rate_hz = self.described.rate_hz;
        let at_s = wall_s + shift_s;
        let place = match self.end {
            None => index,
            Some((end, end_s)) => {
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "float to int casts saturate; a sample between them, so that no run spans two epochs"
                )]
                let between = ((at_s - end_s) * rate_hz).round().max(1.0) as u64;
                end.saturating_add(between)
            }
        };
        let since_zero_s = index as f64 / rate_hz;
        self.anchor = Some(Anchor {
            base: place.cast_signed().saturating_sub(index.cast_signed()),
            zero_s: at_s - since_zero_s,
            wall_zero_s: wall_s - since_zero_s,
            wall_first_s: wall_s,
        });
        self.next.index = index;
    }

    /// Wall clock at which a sample should be taken, and at the epoch's first block, s of stream time; `None`: it is
    /// not placed yet.
    pub(super) fn expected_s(&self, index: u64) -> Option<(f64, f64)> {
        let anchor = self.anchor?;
        let index_s = anchor.wall_zero_s + index as f64 / self.described.rate_hz;
        Some((index_s, anchor.wall_first_s))
    }

    /// Notes when a sample was taken by the wall clock, s of stream time.
    pub(super) fn observe(&mut self, index: u64, wall_s: f64) {
        if let Some(anchor) = self.anchor {
            self.drift.observe(index as f64 / self.described.rate_hz, wall_s - anchor.wall_zero_s);
        }
    }

    /// Takes a block in, whose epoch is placed.
    pub(super) fn take(&mut self, block: &wire::Block<'_>, placing: Placing) -> Taken {
        let n = block.samples.len() as u64;
        self.ledger.received += n;
        self.ledger.blocks += 1;
        let end = block.first + n;
        if block.sequence < self.next.sequence {
            let n_late = self.take_from_gaps(block.first, end);
            self.ledger.late += n_late;
            self.ledger.duplicate += n - n_late;
            self.repeated += n - n_late;
            return Taken::default();
        }
        self.ledger.blocks_lost += block.sequence - self.next.sequence;
        self.next.sequence = block.sequence + 1;
        let n_known = self.next.index.saturating_sub(block.first).min(n);
        if n_known > 0 {
            let n_late = self.take_from_gaps(block.first, block.first + n_known);
            self.ledger.late += n_late;
            self.ledger.duplicate += n_known - n_late;
        }
        if n_known == n {
            self.repeated += n;
            return Taken::default();
        }
        self.repeated = 0;
        let first = block.first + n_known;
        if first > self.next.index {
            self.note_gap(self.next.index, first);
        }
        self.next.index = end;
        let Some(anchor) = self.anchor else { return Taken::default() };
        let end_s = anchor.zero_s + end as f64 / self.described.rate_hz;
        self.end = Some((anchor.base.saturating_add_unsigned(end).cast_unsigned(), end_s));
        if !placing.has_room {
            self.ledger.dropped += n - n_known;
            return Taken::default();
        }
        let samples = block.samples.skip(usize::try_from(n_known).unwrap_or(usize::MAX));
        self.convert(first, samples, anchor, placing)
    }

    /// Takes a range of indices out of the gaps, and gives how many of it lay in them.
    fn take_from_gaps(&mut self, start: u64, end: u64) -> u64 {
        let common = |(from, to): &(u64, u64)| end.min(*to).saturating_sub(start.max(*from));
        let n = self.gaps.iter().map(common).sum();
        if n > 0 {
            let left = self.gaps.iter().flat_map(|&(from, to)| {
                // The part before the range and the part behind it; what is empty falls away.
                [(from, to.min(start)), (from.max(end), to)].into_iter().filter(|(a, b)| a < b)
            });
            self.gaps = left.collect();
            while self.gaps.len() > MAX_GAPS {
                self.gaps.pop_front();
            }
        }
        n
    }

    fn note_gap(&mut self, start: u64, end: u64) {
        self.ledger.lost += end - start;
        self.ledger.gaps += 1;
        if self.gaps.len() == MAX_GAPS {
            self.gaps.pop_front();
        }
        self.gaps.push_back((start, end));
    }

    /// Makes blocks of the good ones among samples.
    fn convert(
        &mut self,
        first: u64,
        samples: Samples<'_>,
        anchor: Anchor,
        placing: Placing,
    ) -> Taken {
        let (channel, segment) = (self.channel, placing.segment);
        let rate_hz = self.described.rate_hz;
        let start_of =
            |index: u64| SampleIndex(anchor.base.saturating_add_unsigned(index).cast_unsigned());
        let time_of = |index: u64| anchor.zero_s + index as f64 / rate_hz;
        let raw = raw(samples);
        let received = placing.keeps_received.then(|| Received {
            channel,
            start: start_of(first),
            segment,
            time_s: time_of(first),
            raw: raw.clone(),
        });
        let samples = self.live.samples(raw);
        let (low, high) = self.limits();
        let is_bad = |x: f32| !(x >= low && x <= high);
        // Counted without a branch, so that it vectorises.
        let n_bad: u32 = samples.iter().map(|x| u32::from(is_bad(*x))).sum();
        if n_bad == 0 {
            self.ledger.used += samples.len() as u64;
            self.ledger.clipped += self.n_clipped(&samples);
            let (start, time_s) = (start_of(first), time_of(first));
            let block = Block { channel, start, segment, time_s, samples };
            return Taken { blocks: vec![block], received };
        }
        let n_not_finite = samples.iter().filter(|x| !x.is_finite()).count() as u64;
        let runs = || samples.split(|x| is_bad(*x)).filter(|run| !run.is_empty());
        if runs().count() > MAX_RUNS {
            let of_block = samples.len() as u64;
            let fate = if n_not_finite > 0 {
                &mut self.ledger.not_finite
            } else {
                &mut self.ledger.out_of_range
            };
            *fate += of_block;
            return Taken { blocks: Vec::new(), received };
        }
        self.ledger.not_finite += n_not_finite;
        self.ledger.out_of_range += u64::from(n_bad) - n_not_finite;
        let mut blocks = Vec::new();
        let mut index = first;
        for run in samples.split(|x| is_bad(*x)) {
            if !run.is_empty() {
                self.ledger.used += run.len() as u64;
                self.ledger.clipped += self.n_clipped(run);
                let (start, time_s) = (start_of(index), time_of(index));
                blocks.push(Block { channel, start, segment, time_s, samples: run.to_vec() });
            }
            index += run.len() as u64 + 1;
        }
        Taken { blocks, received }
    }

    /// Lowest and highest sample that is taken.
    fn limits(&self) -> (f32, f32) {
        self.info.full_scale.unwrap_or((-LARGEST, LARGEST))
    }

    fn n_clipped(&self, samples: &[f32]) -> u64 {
        let Some((low, high)) = self.info.full_scale else { return 0 };
        let clipped = samples.iter().map(|x| u32::from(*x <= low || *x >= high));
        u64::from(clipped.sum::<u32>())
    }
}

fn number_type(kind: SampleType) -> NumberType {
    match kind {
        SampleType::I16 => NumberType::I16,
        SampleType::I24 | SampleType::I32 => NumberType::I32,
        SampleType::F32 => NumberType::F32,
        SampleType::F64 => NumberType::F64,
    }
}

/// Raw elements of the two values.
#[expect(clippy::cast_possible_truncation, reason = "float to int casts saturate")]
fn ends(kind: NumberType, low: f64, high: f64) -> RawSamples {
    match kind {
        NumberType::I16 => RawSamples::I16(vec![low as i16, high as i16]),
        NumberType::I32 => RawSamples::I32(vec![low as i32, high as i32]),
        NumberType::F32 => RawSamples::F32(vec![low as f32, high as f32]),
        NumberType::F64 => RawSamples::F64(vec![low, high]),
    }
}

/// Samples of a frame as numbers; an allocation a block, in loops the compiler can vectorise.
fn raw(samples: Samples<'_>) -> RawSamples {
    match samples.kind() {
        SampleType::I16 => {
            RawSamples::I16(samples.each().map(|b| i16::from_le_bytes(*b)).collect())
        }
        SampleType::I24 => {
            // The three bytes are the upper ones, so that the shift down brings the sign.
            let wide = |b: &[u8; 3]| i32::from_le_bytes([0, b[0], b[1], b[2]]) >> 8;
            RawSamples::I32(samples.each().map(wide).collect())
        }
        SampleType::I32 => {
            RawSamples::I32(samples.each().map(|b| i32::from_le_bytes(*b)).collect())
        }
        SampleType::F32 => {
            RawSamples::F32(samples.each().map(|b| f32::from_le_bytes(*b)).collect())
        }
        SampleType::F64 => {
            RawSamples::F64(samples.each().map(|b| f64::from_le_bytes(*b)).collect())
        }
    }
}
