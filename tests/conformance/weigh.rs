//! Reading a capture on a scale.
//!
//! What a call allocates in all, freed or not, is an upper bound of its largest allocation. An
//! endless loop shows as a test that does not end.

use rotorwatch::capture::error::CaptureError;
use rotorwatch::capture::hints::Hints;
use rotorwatch::capture::info::CaptureInfo;
use rotorwatch::capture::reader::CaptureReader;
use rotorwatch::capture::received::{RawSamples, Received};
use rotorwatch::signal::Block;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use std::alloc::System;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Bytes one call may allocate in all.
pub(crate) const ALLOCATION_MAX: usize = 256 << 20;

/// Samples kept of what is read.
const SAMPLES_KEPT: u64 = 1 << 20;

/// The allocator counts the whole process, so these tests run one at a time.
pub(crate) fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Does `work` and fails if it allocated too much, or asked for it in vain.
pub(crate) fn weighed<T>(what: &str, work: impl FnOnce() -> T) -> T {
    let region = Region::new(ALLOCATOR);
    let result = work();
    let bytes = region.change().bytes_allocated;
    assert!(bytes <= ALLOCATION_MAX, "{what}: {bytes} bytes allocated by one call");
    result
}

/// Everything a capture holds, to be compared.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Content {
    /// Start, machine, shaft speed and segments.
    pub(crate) header: String,
    /// By name.
    pub(crate) channels: BTreeMap<String, ChannelContent>,
}

/// Everything one channel holds.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct ChannelContent {
    /// Number type, rate, unit, sensor, scale, offset.
    pub(crate) facts: String,
    pub(crate) n_samples: u64,
    /// CRC-32 of the raw samples, little-endian.
    pub(crate) crc: u32,
    /// (number, first sample, bits of its time) of each segment.
    pub(crate) segments: Vec<(u32, u64, u64)>,
}

/// A capture read to its end.
pub(crate) struct Reading {
    pub(crate) info: CaptureInfo,
    /// Of the first [`SAMPLES_KEPT`] samples.
    pub(crate) blocks: Vec<Block>,
    pub(crate) rejected: u64,
    pub(crate) content: Content,
}

/// Reads everything; whatever is read without an error must agree with what was declared.
pub(crate) fn read(path: &Path, what: &str) -> Result<Reading, CaptureError> {
    let mut reader = weighed(what, || CaptureReader::open(path, None, &Hints::default()))?;
    reader.keep_received();
    let info = reader.info().clone();
    let declared: u64 = info.channels.iter().map(|channel| channel.n_samples).sum();
    let (mut blocks, mut seen) = (Vec::new(), 0);
    let mut sums = vec![(crc32fast::Hasher::new(), ChannelContent::default()); info.channels.len()];
    while let Some(block) = weighed(what, || reader.next_block())? {
        assert!(block.samples.iter().all(|sample| sample.is_finite()), "{what}");
        assert!(!block.samples.is_empty(), "{what}");
        while let Some(received) = reader.next_received() {
            add(&mut sums[received.channel.0], &received);
        }
        seen += block.samples.len() as u64;
        assert!(seen <= declared, "{what}: more samples than declared");
        // Huge but legal declarations are read through, not kept.
        if seen < SAMPLES_KEPT {
            blocks.push(block);
        }
    }
    while let Some(received) = reader.next_received() {
        add(&mut sums[received.channel.0], &received);
    }
    let report = reader.report();
    assert_eq!(report.samples_read, seen, "{what}");
    let rejected = report.samples_rejected();
    assert_eq!(seen + rejected, declared, "{what}: every sample is accounted for");
    let content = content(&info, sums);
    Ok(Reading { info, blocks, rejected, content })
}

fn content(info: &CaptureInfo, sums: Vec<(crc32fast::Hasher, ChannelContent)>) -> Content {
    let header = format!(
        "{:?} {:?} {:?} {:?}",
        info.start_time, info.machine, info.shaft_speed, info.segments
    );
    let channels = info.channels.iter().zip(sums).map(|(channel, (sum, content))| {
        let facts = format!(
            "{} {:?} {:?} {:?} {:?} {:?}",
            channel.number_type.name(),
            channel.info.sample_rate,
            channel.unit_text,
            channel.sensor,
            channel.scale,
            channel.offset
        );
        (channel.info.name.clone(), ChannelContent { facts, crc: sum.finalize(), ..content })
    });
    Content { header, channels: channels.collect() }
}

fn add((sum, content): &mut (crc32fast::Hasher, ChannelContent), received: &Received) {
    match &received.raw {
        RawSamples::F32(raw) => raw.iter().for_each(|x| sum.update(&x.to_le_bytes())),
        RawSamples::F64(raw) => raw.iter().for_each(|x| sum.update(&x.to_le_bytes())),
        RawSamples::I16(raw) => raw.iter().for_each(|x| sum.update(&x.to_le_bytes())),
        RawSamples::I32(raw) => raw.iter().for_each(|x| sum.update(&x.to_le_bytes())),
    }
    content.n_samples += received.raw.len() as u64;
    if content.segments.last().is_none_or(|last| last.0 != received.segment) {
        let start = (received.segment, received.start.0, received.time_s.to_bits());
        content.segments.push(start);
    }
}

#[test]
fn the_scale_sees_a_large_allocation() {
    let _alone = alone();
    let overweight = std::panic::catch_unwind(|| {
        weighed("a large vector", || Vec::<u8>::with_capacity(ALLOCATION_MAX + 1).capacity())
    });
    assert!(overweight.is_err());
}
