//! A capture as a live sender would send it: what was received, cut into short blocks, over the channels in the order of
//! time, with indices that count what was not measured.

use super::replay::ReplayError;
use super::replay::Step;
use super::replay::Stream;
use crate::capture::received::NumberType;
use crate::capture::received::RawSamples;
use crate::capture::received::Received;
use crate::capture::received::ReceivedChannel;
use crate::signal::ChannelInfo;
use crate::wire;
use crate::wire::SampleType;
use std::collections::VecDeque;

/// Longest block, s of stream time.
const BLOCK_S: f64 = 0.1;

/// Fewest samples of a block, so that slow channels are not sent sample by sample; at most a second of them.
const FEWEST: f64 = 100.0;

/// A block to be sent.
#[derive(Debug, Clone, PartialEq)]
pub struct Outgoing {
    /// Place of the channel.
    pub stream: u16,
    /// Number of the block in its channel.
    pub sequence: u64,
    /// Index of its first sample.
    pub first: u64,
    /// Stream time of its first sample and one past its last, s.
    pub time_s: (f64, f64),
    /// The samples.
    pub raw: RawSamples,
}

/// What is sent of a capture.
#[derive(Debug)]
pub struct Outlet {
    stream: Stream,
    lanes: Vec<Lane>,
    /// Where the newest run read begins, s; infinite after the last.
    read_to_s: f64,
}

#[derive(Debug)]
struct Lane {
    rate_hz: f64,
    sequence: u64,
    pending: VecDeque<(Received, usize)>,
}

impl Outlet {
    /// Sends an open capture that gives what was received.
    #[must_use]
    pub fn new(stream: Stream) -> Self {
        let lane = |c: &ReceivedChannel| Lane {
            rate_hz: c.sample_rate.0,
            sequence: 0,
            pending: VecDeque::new(),
        };
        let lanes = stream.info.received.iter().map(lane).collect();
        Self { stream, lanes, read_to_s: f64::NEG_INFINITY }
    }

    /// The channels as they are said in a hello.
    #[must_use]
    pub fn channels(&self) -> Vec<wire::Channel> {
        let (received, infos) = (&self.stream.info.received, &self.stream.info.channels);
        received.iter().zip(infos).map(|(channel, info)| described(channel, info)).collect()
    }

    /// The next block; `None` after the last.
    ///
    /// # Errors
    /// When the capture cannot be read further.
    pub fn take(&mut self) -> Result<Option<Outgoing>, ReplayError> {
        loop {
            let earliest = self.earliest();
            if let Some((stream, end_s)) = earliest
                && end_s <= self.read_to_s
            {
                return Ok(self.cut(stream));
            }
            if self.read_to_s == f64::INFINITY {
                return Ok(None);
            }
            match (self.stream.next)()? {
                Step::Received(run) => {
                    // Runs come in the order in which they begin: nothing unread ends before this one begins.
                    self.read_to_s = run.time_s;
                    if let Some(lane) = self.lanes.get_mut(run.channel.0) {
                        lane.pending.push_back((run, 0));
                    }
                }
                Step::End => self.read_to_s = f64::INFINITY,
                // The daemon counts for itself what is of no use.
                Step::Block(_) | Step::Rejected { .. } => {}
            }
        }
    }

    /// The channel whose next block ends first, and when, s.
    fn earliest(&self) -> Option<(usize, f64)> {
        let ends = self.lanes.iter().enumerate().filter_map(|(stream, lane)| {
            let (run, at) = lane.pending.front()?;
            let end = (at + lane.block_len()).min(run.raw.len());
            Some((stream, run.time_s + end as f64 / lane.rate_hz))
        });
        ends.min_by(|a, b| a.1.total_cmp(&b.1))
    }

    fn cut(&mut self, stream: usize) -> Option<Outgoing> {
        let lane = self.lanes.get_mut(stream)?;
        let n = lane.block_len();
        let (run, at) = lane.pending.front_mut()?;
        let (from, to) = (*at, (*at + n).min(run.raw.len()));
        let raw = part(&run.raw, from, to);
        let time = |sample: usize| run.time_s + sample as f64 / lane.rate_hz;
        let time_s = (time(from), time(to));
        let sequence = lane.sequence;
        lane.sequence += 1;
        *at = to;
        if to == run.raw.len() {
            lane.pending.pop_front();
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "float to int casts saturate"
        )]
        let first = (time_s.0 * lane.rate_hz).round().max(0.0) as u64;
        Some(Outgoing { stream: u16::try_from(stream).ok()?, sequence, first, time_s, raw })
    }
}

impl Lane {
    /// Samples of a block.
    fn block_len(&self) -> usize {
        let second = self.rate_hz.max(1.0);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "float to int casts saturate"
        )]
        let n = (self.rate_hz * BLOCK_S).max(FEWEST).min(second) as usize;
        n.clamp(1, wire::MAX_BLOCK_SAMPLES)
    }
}

fn part(raw: &RawSamples, from: usize, to: usize) -> RawSamples {
    match raw {
        RawSamples::I16(raw) => RawSamples::I16(raw[from..to].to_vec()),
        RawSamples::I32(raw) => RawSamples::I32(raw[from..to].to_vec()),
        RawSamples::F32(raw) => RawSamples::F32(raw[from..to].to_vec()),
        RawSamples::F64(raw) => RawSamples::F64(raw[from..to].to_vec()),
    }
}

/// What each sample is on the wire.
#[must_use]
pub fn sample_type(kind: NumberType) -> SampleType {
    match kind {
        NumberType::I16 => SampleType::I16,
        NumberType::I32 => SampleType::I32,
        NumberType::F32 => SampleType::F32,
        NumberType::F64 => SampleType::F64,
    }
}

/// Samples as they travel.
#[must_use]
pub fn bytes_of(raw: &RawSamples) -> Vec<u8> {
    match raw {
        RawSamples::I16(raw) => raw.iter().flat_map(|x| x.to_le_bytes()).collect(),
        RawSamples::I32(raw) => raw.iter().flat_map(|x| x.to_le_bytes()).collect(),
        RawSamples::F32(raw) => raw.iter().flat_map(|x| x.to_le_bytes()).collect(),
        RawSamples::F64(raw) => raw.iter().flat_map(|x| x.to_le_bytes()).collect(),
    }
}

fn described(channel: &ReceivedChannel, info: &ChannelInfo) -> wire::Channel {
    let is_known = |unit: &&String| crate::units::SourceUnit::parse(unit).is_some();
    wire::Channel {
        name: channel.name.clone(),
        rate_hz: info.sample_rate.0,
        sample_type: sample_type(channel.number_type),
        scale: channel.scale,
        offset: channel.offset,
        zero: channel.raw_zero,
        range: None,
        unit: channel.unit.as_ref().filter(is_known).cloned().unwrap_or_default(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ingest::replay::StreamInfo;
    use crate::signal::ChannelIndex;
    use crate::signal::SampleIndex;
    use crate::units::Hz;
    use crate::units::Unit;

    /// Two channels of 1000 and 50 samples a second, with a hole of a second after the first.
    fn stream() -> Stream {
        let rates = [1000.0, 50.0];
        let mut steps = VecDeque::new();
        for (time_s, start_part) in [(0.0, 0.0), (2.0, 1.0)] {
            for (channel, rate_hz) in rates.into_iter().enumerate() {
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "small"
                )]
                let (start, n) = ((start_part * rate_hz) as u64, rate_hz as i16);
                let raw = RawSamples::I16((0..n).collect());
                let (channel, start) = (ChannelIndex(channel), SampleIndex(start));
                steps.push_back(Step::Received(Received {
                    channel,
                    start,
                    segment: 0,
                    time_s,
                    raw,
                }));
            }
        }
        let channel = |name: &str, rate_hz| ChannelInfo {
            name: name.to_owned(),
            sample_rate: Hz(rate_hz),
            unit: Unit::Unknown,
            offset: 0.0,
            unit_conflict: None,
            full_scale: None,
        };
        let received = |name: &str, rate_hz| ReceivedChannel {
            name: name.to_owned(),
            sample_rate: Hz(rate_hz),
            number_type: NumberType::I16,
            scale: 2.0,
            offset: 0.0,
            raw_zero: 0.0,
            unit: Some("furlong".to_owned()),
            sensor: None,
        };
        let info = StreamInfo {
            channels: vec![channel("fast", rates[0]), channel("slow", rates[1])],
            start_time: None,
            shaft_speed: None,
            load: None,
            received: vec![received("fast", rates[0]), received("slow", rates[1])],
        };
        Stream { info, next: Box::new(move || Ok(steps.pop_front().unwrap_or(Step::End))) }
    }

    #[test]
    fn blocks_come_in_the_order_of_time_and_count_what_was_not_measured() {
        let mut outlet = Outlet::new(stream());
        assert_eq!(outlet.channels()[1].unit, "", "a unit that is none is not said");
        let (mut ends, mut next, mut sequences) = (Vec::new(), [Vec::new(), Vec::new()], [0, 0]);
        while let Some(block) = outlet.take().unwrap() {
            let stream = usize::from(block.stream);
            assert_eq!(block.sequence, sequences[stream]);
            sequences[stream] += 1;
            ends.push(block.time_s.1);
            next[stream].push((block.first, block.raw.len()));
        }
        assert!(ends.is_sorted(), "{ends:?}");
        assert_eq!(next[1], [(0, 50), (100, 50)]);
        assert_eq!(next[0].len(), 20);
        assert_eq!((next[0][9], next[0][10]), ((900, 100), (2000, 100)));
    }
}
