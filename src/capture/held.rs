//! What was received last, held in memory as it was received: what a capture of the past is made of.
//!
//! Bounded by age and by bytes. Must not know what the samples mean or who asks for them.

use super::received::{Received, ReceivedChannel};
use std::collections::VecDeque;
use std::sync::Arc;

/// What a source may be ahead of the window that is judged: it reads a second of each channel at once.
const AHEAD_S: f64 = 5.0;

/// The runs received last.
#[derive(Debug, Clone)]
pub struct Held {
    rates_hz: Vec<f64>,
    runs: VecDeque<Arc<Received>>,
    bytes: usize,
    keep_s: f64,
    max_bytes: usize,
}

impl Held {
    /// Holds so many seconds of a stream, and what a source may be ahead.
    #[must_use]
    pub fn new(channels: &[ReceivedChannel], keep_s: f64) -> Self {
        Self {
            rates_hz: channels.iter().map(|channel| channel.sample_rate.0).collect(),
            runs: VecDeque::new(),
            bytes: 0,
            keep_s: keep_s + AHEAD_S,
            max_bytes: Self::bytes(channels, keep_s),
        }
    }

    /// Bytes that so many seconds of a stream need at most.
    #[must_use]
    pub fn bytes(channels: &[ReceivedChannel], keep_s: f64) -> usize {
        let bytes = |channel: &ReceivedChannel| {
            channel.sample_rate.0 * channel.number_type.bytes() as f64 * (keep_s + 2.0 * AHEAD_S)
        };
        let sum: f64 = channels.iter().map(bytes).sum();
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "float to int casts saturate"
        )]
        let bytes = sum.ceil() as usize;
        bytes.saturating_add(channels.len() * size_of::<Received>() * 64)
    }

    /// Takes a run in; the oldest give way.
    pub fn push(&mut self, run: Arc<Received>) {
        let newest_s = run.time_s;
        self.bytes += run.bytes();
        self.runs.push_back(run);
        while let Some(oldest) = self.runs.front() {
            let is_old = self.end_s(oldest) < newest_s - self.keep_s;
            if !is_old && (self.bytes <= self.max_bytes || self.runs.len() == 1) {
                break;
            }
            self.bytes -= oldest.bytes();
            self.runs.pop_front();
        }
    }

    /// The runs held, in the order in which they came.
    #[must_use]
    pub fn runs(&self) -> Vec<Arc<Received>> {
        self.runs.iter().cloned().collect()
    }

    /// Samples a second of each channel.
    #[must_use]
    pub fn rates_hz(&self) -> &[f64] {
        &self.rates_hz
    }

    /// Stream time one past a run of the stream, s.
    #[must_use]
    pub fn end_s(&self, run: &Received) -> f64 {
        let rate_hz = self.rates_hz.get(run.channel.0).copied().unwrap_or(f64::INFINITY);
        run.time_s + run.raw.len() as f64 / rate_hz
    }
}

impl Received {
    /// Bytes it takes in memory.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of::<Self>() + self.raw.len() * self.raw.number_type().bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::super::received::{NumberType, RawSamples};
    use super::*;
    use crate::signal::{ChannelIndex, SampleIndex};
    use crate::units::Hz;

    #[test]
    fn the_oldest_give_way_by_age_and_by_bytes() {
        let channel = ReceivedChannel {
            name: "x".to_owned(),
            sample_rate: Hz(100.0),
            number_type: NumberType::I16,
            scale: 1.0,
            offset: 0.0,
            raw_zero: 0.0,
            unit: None,
            sensor: None,
        };
        let run = |second: u64, n: usize| Received {
            channel: ChannelIndex(0),
            start: SampleIndex(second * 100),
            segment: 0,
            time_s: second as f64,
            raw: RawSamples::I16(vec![0; n]),
        };
        let mut held = Held::new(std::slice::from_ref(&channel), 10.0);
        for second in 0..60 {
            held.push(Arc::new(run(second, 100)));
        }
        let runs = held.runs();
        // 10 s and 5 s ahead of the newest run's begin at 59 s.
        assert!((runs[0].time_s - 43.0).abs() < 1e-9, "{}", runs[0].time_s);
        assert!(held.bytes <= Held::bytes(&[channel], 10.0));
        held.push(Arc::new(run(59, 100_000)));
        assert_eq!(held.runs().len(), 1, "one that is larger than all is held alone");
    }
}
