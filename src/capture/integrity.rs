//! Checksums: of raw samples, block by block, and of what a capture states about itself.
//!
//! CRC-32 with the polynomial of zlib, so that `zlib.crc32` of Python verifies. Must not know
//! files: it is fed runs of samples and facts, and gives sums or the samples that differ.

use super::received::{NumberType, RawSamples};
use super::segments::Segments;
use crate::signal::Timestamp;
use crate::units::Hz;
use bytemuck::NoUninit;

/// Samples that share one sum in the captures this program writes.
pub(super) const BLOCK_SAMPLES: u64 = 65_536;

/// CRC-32 of consecutive blocks of a channel's raw samples, as little-endian bytes.
#[derive(Debug)]
pub(super) struct BlockSums {
    /// Samples of a block.
    block: u64,
    /// Samples added so far.
    at: u64,
    hasher: crc32fast::Hasher,
}

impl BlockSums {
    /// Starts at sample 0; `block` = samples of a block, at least 1.
    pub(super) fn new(block: u64) -> Self {
        Self { block: block.max(1), at: 0, hasher: crc32fast::Hasher::new() }
    }

    /// Adds the next samples; calls `complete` with (number, sum) of each block that ends in them.
    pub(super) fn add<T: NoUninit, E>(
        &mut self,
        mut run: &[T],
        mut complete: impl FnMut(u64, u32) -> Result<(), E>,
    ) -> Result<(), E> {
        while !run.is_empty() {
            let room = self.block - self.at % self.block;
            let count = usize::try_from(room).unwrap_or(usize::MAX).min(run.len());
            let (now, later) = run.split_at(count);
            update(&mut self.hasher, now);
            self.at += count as u64;
            run = later;
            if self.at.is_multiple_of(self.block) {
                let sum = std::mem::take(&mut self.hasher).finalize();
                complete(self.at / self.block - 1, sum)?;
            }
        }
        Ok(())
    }

    /// (number, sum) of the block begun and not complete; `None` if there is none.
    pub(super) fn rest(&self) -> Option<(u64, u32)> {
        let begun = !self.at.is_multiple_of(self.block);
        begun.then(|| (self.at / self.block, self.hasher.clone().finalize()))
    }
}

/// Adds the little-endian bytes of `run`.
fn update<T: NoUninit>(hasher: &mut crc32fast::Hasher, run: &[T]) {
    let bytes: &[u8] = bytemuck::cast_slice(run);
    if cfg!(target_endian = "little") {
        hasher.update(bytes);
        return;
    }
    for element in bytes.chunks_exact(size_of::<T>().max(1)) {
        let reversed: Vec<u8> = element.iter().rev().copied().collect();
        hasher.update(&reversed);
    }
}

/// The sums of all samples of a channel, the last block shorter if need be.
pub(super) fn sums<T: NoUninit>(samples: &[T], block: u64) -> Vec<u32> {
    let mut sums = Vec::new();
    let mut blocks = BlockSums::new(block);
    let Ok(()) = blocks.add(samples, |_, sum| {
        sums.push(sum);
        Ok::<(), std::convert::Infallible>(())
    });
    sums.extend(blocks.rest().map(|(_, sum)| sum));
    sums
}

/// Why a run of samples is not taken.
#[derive(Debug, PartialEq)]
pub(super) enum Refusal<E> {
    /// Samples `first..=last` of the channel are not those whose sum was stored.
    Differs {
        /// First sample of the block.
        first: u64,
        /// Last sample of the block.
        last: u64,
    },
    /// The stored sum could not be had.
    Unknown(E),
}

/// Compares a channel's samples with stored sums as they stream by.
#[derive(Debug)]
pub(super) struct Verifier {
    sums: BlockSums,
    /// Samples of the channel.
    length: u64,
    /// Sums stored; samples beyond their blocks are not compared.
    rows: u64,
}

impl Verifier {
    /// Starts at sample 0 of a channel of `length` samples with `rows` sums, one a `block`.
    pub(super) fn new(block: u64, length: u64, rows: u64) -> Self {
        Self { sums: BlockSums::new(block), length, rows }
    }

    /// Takes the next samples; `stored` gives the sum of the block of that number.
    pub(super) fn feed<E>(
        &mut self,
        raw: &RawSamples,
        stored: impl FnMut(u64) -> Result<u32, E>,
    ) -> Result<(), Refusal<E>> {
        match raw {
            RawSamples::F32(run) => self.compare(run, stored),
            RawSamples::F64(run) => self.compare(run, stored),
            RawSamples::I16(run) => self.compare(run, stored),
            RawSamples::I32(run) => self.compare(run, stored),
        }
    }

    fn compare<T: NoUninit, E>(
        &mut self,
        run: &[T],
        mut stored: impl FnMut(u64) -> Result<u32, E>,
    ) -> Result<(), Refusal<E>> {
        let (block, length, rows) = (self.sums.block, self.length, self.rows);
        let mut check = |number: u64, sum: u32| {
            if number >= rows || stored(number).map_err(Refusal::Unknown)? == sum {
                return Ok(());
            }
            let first = number * block;
            Err(Refusal::Differs { first, last: (first + block).min(length).saturating_sub(1) })
        };
        self.sums.add(run, &mut check)?;
        match self.sums.rest().filter(|_| self.sums.at == length) {
            Some((number, sum)) => check(number, sum),
            None => Ok(()),
        }
    }
}

/// What a capture states about itself, in a form that has one sum for one content.
///
/// A chain of texts, each as `<bytes>:<text>,`: place, name and value of every fact that is
/// stated, in a fixed order. A number is the 16 hexadecimal digits of its IEEE double.
#[derive(Debug, Clone, Default)]
pub(super) struct Statement {
    hasher: crc32fast::Hasher,
}

/// One channel's facts.
#[derive(Debug, Clone, Copy)]
pub(super) struct ChannelFacts<'a> {
    pub(super) name: &'a str,
    pub(super) number_type: NumberType,
    pub(super) sample_rate: Hz,
    pub(super) unit: Option<&'a str>,
    pub(super) sensor: Option<&'a str>,
    /// physical = raw·scale + offset; 1 where the file has no such attribute.
    pub(super) scale: f64,
    /// See `scale`; 0 where the file has no such attribute.
    pub(super) offset: f64,
}

impl Statement {
    /// Begins with the attributes of the root.
    pub(super) fn new(
        format: Option<&str>,
        start_time: Option<Timestamp>,
        machine: Option<&str>,
        shaft_speed: Option<Hz>,
    ) -> Self {
        let mut statement = Self::default();
        statement.text("/", "format", format);
        statement.text("/", "start_time", start_time.map(|t| t.0.to_string()).as_deref());
        statement.text("/", "machine", machine);
        statement.number("/", "shaft_speed_hz", shaft_speed.map(|speed| speed.0));
        statement
    }

    /// Adds a channel; the channels come in the order of their names' bytes.
    pub(super) fn channel(&mut self, facts: &ChannelFacts<'_>) {
        let place = format!("/channels/{}", facts.name);
        self.text(&place, "type", Some(facts.number_type.name()));
        self.number(&place, "sample_rate_hz", Some(facts.sample_rate.0));
        self.text(&place, "unit", facts.unit);
        self.text(&place, "sensor", facts.sensor);
        self.number(&place, "scale", Some(facts.scale));
        self.number(&place, "offset", Some(facts.offset));
    }

    /// Adds the segments of a finished capture; `None`: it lists none.
    pub(super) fn segments(&mut self, segments: Option<&Segments>) {
        let count = segments.map_or(0, Segments::len);
        self.text("/segments", "count", Some(&count.to_string()));
        for (start, time_s) in segments.into_iter().flat_map(Segments::listed) {
            self.text("/segments", "start_sample", Some(&start.to_string()));
            self.number("/segments", "time_s", Some(time_s));
        }
    }

    /// The sum of everything stated so far.
    pub(super) fn sum(&self) -> u32 {
        self.hasher.clone().finalize()
    }

    fn number(&mut self, place: &str, name: &str, value: Option<f64>) {
        let digits = value.map(|value| format!("{:016x}", value.to_bits()));
        self.text(place, name, digits.as_deref());
    }

    fn text(&mut self, place: &str, name: &str, value: Option<&str>) {
        let Some(value) = value else { return };
        for part in [place, name, value] {
            self.hasher.update(format!("{}:", part.len()).as_bytes());
            self.hasher.update(part.as_bytes());
            self.hasher.update(b",");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::convert::Infallible;

    #[test]
    fn sums_are_those_of_zlib() {
        // The check value of CRC-32/ISO-HDLC, which is zlib's: crc32("123456789") = 0xcbf43926.
        assert_eq!(sums(b"123456789", 9), [0xcbf4_3926]);
        // Little-endian bytes whatever the element: 0x3231 is "12".
        assert_eq!(sums(&[0x3231_i16, 0x3433, 0x3635, 0x3837], 4), sums(b"12345678", 8));
        assert!(sums::<f32>(&[], 4).is_empty());
    }

    #[test]
    fn a_damaged_block_is_named_by_its_samples() {
        let samples: Vec<i16> = (0..2500).collect();
        let stored = sums(&samples, 1000);
        assert_eq!(stored.len(), 3);
        for damaged in [0, 999, 1000, 2499] {
            let mut read = samples.clone();
            read[damaged] ^= 0x40;
            let first = damaged as u64 / 1000 * 1000;
            let expected = Refusal::Differs { first, last: (first + 999).min(2499) };
            assert_eq!(verify(&read, &stored, 700), Err(expected), "sample {damaged}");
        }
        assert_eq!(verify(&samples, &stored, 700), Ok(()));
        // Without a sum for it, the last block is not compared.
        let mut read = samples;
        read[2100] = 0;
        assert_eq!(verify(&read, &stored[..2], 700), Ok(()));
    }

    fn verify(samples: &[i16], stored: &[u32], run: usize) -> Result<(), Refusal<Infallible>> {
        let mut verifier = Verifier::new(1000, samples.len() as u64, stored.len() as u64);
        samples.chunks(run).try_for_each(|run| {
            let number = |k: u64| Ok(stored[usize::try_from(k).unwrap()]);
            verifier.feed(&RawSamples::I16(run.to_vec()), number)
        })
    }

    /// One change of one fact.
    type Change = fn(&mut ChannelFacts<'static>);

    #[test]
    fn every_fact_changes_the_statement() {
        let facts = ChannelFacts {
            name: "x",
            number_type: NumberType::F32,
            sample_rate: Hz(1000.0),
            unit: Some("g"),
            sensor: None,
            scale: 1.0,
            offset: 0.0,
        };
        let sum = |facts: &ChannelFacts<'_>| {
            let mut statement = Statement::new(None, None, None, None);
            statement.channel(facts);
            statement.sum()
        };
        let changes: [Change; 8] = [
            |f| f.name = "y",
            |f| f.number_type = NumberType::I32,
            |f| f.sample_rate = Hz(1000.5),
            |f| f.unit = None,
            |f| f.unit = Some("mm/s"),
            |f| (f.unit, f.sensor) = (None, Some("g")),
            |f| f.scale = 2.0,
            |f| f.offset = -0.5,
        ];
        for (at, change) in changes.iter().enumerate() {
            let mut changed = facts;
            change(&mut changed);
            assert_ne!(sum(&changed), sum(&facts), "change {at}");
        }
        let root = |a, b, c, d| Statement::new(a, b, c, d).sum();
        let none = root(None, None, None, None);
        assert_ne!(root(Some("f"), None, None, None), none);
        assert_ne!(root(None, Some(Timestamp(0)), None, None), none);
        assert_ne!(root(None, None, Some(""), None), none);
        assert_ne!(root(None, None, None, Some(Hz(0.0))), none);
        let mut finished = Statement::default();
        finished.segments(None);
        assert_ne!(finished.sum(), none, "a finished capture is not one being written");
        let mut listed = Statement::default();
        listed.segments(Some(&Segments::one(Hz(1.0))));
        assert_ne!(listed.sum(), finished.sum());
    }

    proptest! {
        #[test]
        fn how_samples_are_cut_into_runs_does_not_matter(
            samples in prop::collection::vec(any::<i32>(), 0..400),
            block in 1..100_u64,
            run in 1..100_usize,
        ) {
            let mut found = Vec::new();
            let mut blocks = BlockSums::new(block);
            for run in samples.chunks(run) {
                let Ok(()) = blocks.add(run, |number, sum| {
                    found.push((number, sum));
                    Ok::<(), Infallible>(())
                });
            }
            found.extend(blocks.rest());
            let bytes: Vec<u8> = samples.iter().flat_map(|x| x.to_le_bytes()).collect();
            let block_bytes = usize::try_from(block * 4).unwrap();
            let slow = bytes.chunks(block_bytes).map(crc32fast::hash);
            prop_assert_eq!(found, (0..).zip(slow).collect::<Vec<_>>());
        }
    }
}
