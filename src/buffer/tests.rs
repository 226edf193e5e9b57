//! Properties of the ring against a naive list of samples, and its corner cases.

use super::*;
use crate::signal::ChannelIndex;
use proptest::prelude::*;

const RATE: Hz = Hz(100.0);

fn block(start: u64, segment: u32, time_s: f64, samples: Vec<f32>) -> Block {
    Block { channel: ChannelIndex(0), start: SampleIndex(start), segment, time_s, samples }
}

/// A block whose samples say their own index and whose time is index / rate.
fn indexed(start: u64, len: u64, segment: u32) -> Block {
    let samples = (start..start + len).map(|i| i as f32).collect();
    block(start, segment, start as f64 / RATE.0, samples)
}

/// One sample of the naive model.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Held {
    index: u64,
    segment: u32,
    /// Number of boundaries before the sample.
    run: u64,
    value: f32,
}

/// The ring as a plain list: every sample decided one by one.
#[derive(Debug, Default)]
struct Model {
    held: VecDeque<Held>,
    newest: Option<Held>,
    received: u64,
    missing: u64,
    gaps: u64,
    duplicated: u64,
}

impl Model {
    fn push(&mut self, block: &Block, capacity: usize) {
        if block.samples.is_empty() {
            return;
        }
        let restart =
            self.newest.is_some_and(|n| block.start.0 <= n.index && block.segment > n.segment);
        if restart {
            self.held.clear();
        }
        let mut previous = self.newest.filter(|_| !restart);
        let run_before = self.newest.map_or(0, |n| n.run);
        for (i, &value) in block.samples.iter().enumerate() {
            let index = block.start.0 + i as u64;
            let mut run = run_before + u64::from(restart);
            if let Some(p) = previous {
                if index <= p.index {
                    self.duplicated += 1;
                    continue;
                }
                let is_gap = index > p.index + 1;
                if is_gap {
                    self.gaps += 1;
                    self.missing += index - p.index - 1;
                }
                run = p.run + u64::from(is_gap || p.segment != block.segment);
            }
            let held = Held { index, segment: block.segment, run, value };
            self.received += 1;
            self.held.push_back(held);
            previous = Some(held);
            self.newest = previous;
        }
        while self.held.len() > capacity {
            self.held.pop_front();
        }
    }

    fn contiguous_before(&self, end: u64, max_len: usize) -> Vec<Held> {
        let Some(last) = self.held.iter().rposition(|h| h.index + 1 == end) else {
            return Vec::new();
        };
        let run = self.held[last].run;
        let mut out: Vec<Held> =
            self.held.iter().take(last + 1).filter(|h| h.run == run).copied().collect();
        out.drain(..out.len().saturating_sub(max_len));
        out
    }
}

/// Steps relative to the newest index, so that overlaps, gaps and restarts are all frequent.
fn stream() -> impl Strategy<Value = Vec<(i64, u64, u32)>> {
    let shift = prop_oneof![4 => Just(0_i64), 2 => -30_i64..0, 2 => 1_i64..30];
    let segment_step = prop_oneof![6 => Just(0_u32), 1 => Just(1_u32)];
    prop::collection::vec((shift, 0_u64..40, segment_step), 1..60)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn ring_agrees_with_a_plain_list(steps in stream(), capacity in 1_u32..50, max_len in 0_usize..60) {
        let mut ring = Ring::new(RATE, f64::from(capacity) / RATE.0);
        let capacity = ring.capacity();
        let mut model = Model::default();
        let (mut segment, mut serial) = (0_u32, 0.0_f32);
        for (shift, len, segment_step) in steps {
            segment += segment_step;
            let next = model.newest.map_or(50, |n| n.index + 1);
            let start = next.saturating_add_signed(shift);
            // values are distinct by arrival, so that a stale copy cannot pass as the right one
            let samples: Vec<f32> = (0..len).map(|i| serial + i as f32).collect();
            serial += len as f32;
            let block = block(start, segment, start as f64 / RATE.0, samples);
            ring.push(&block);
            model.push(&block, capacity);

            let status = ring.status();
            prop_assert_eq!(status.received, model.received);
            prop_assert_eq!(status.missing, model.missing);
            prop_assert_eq!(status.gaps, model.gaps);
            prop_assert_eq!(status.duplicated, model.duplicated);
            prop_assert_eq!(status.oldest.0, model.held.front().map_or(0, |h| h.index));
            prop_assert_eq!(status.newest.0, model.newest.map_or(0, |h| h.index + 1));

            for end in start.saturating_sub(60)..start + 60 {
                let wanted = model.contiguous_before(end, max_len);
                let (first, n) = ring.contiguous_before(SampleIndex(end), max_len);
                prop_assert_eq!(n, wanted.len(), "run before {}", end);
                let mut got = vec![f32::NAN; n];
                prop_assert!(ring.copy(first, &mut got));
                prop_assert_eq!(&got, &wanted.iter().map(|h| h.value).collect::<Vec<_>>());

                let held = model.held.iter().find(|h| h.index == end);
                prop_assert_eq!(ring.segment_of(SampleIndex(end)), held.map(|h| h.segment));
                // index / rate by two routes: the error is that of adding two times near 1 s
                let time_error = ring.time_of(SampleIndex(end)).map(|t| (t - end as f64 / RATE.0).abs());
                prop_assert_eq!(time_error.map(|e| e < 1e-9), held.map(|_| true));

                let before = model.held.iter().filter(|h| h.index < end).map(|h| h.index + 1).max();
                prop_assert_eq!(ring.newest_before(SampleIndex(end)).map(|i| i.0), before);
                // sample times are index / rate here, so a time of `end` / rate means index `end`
                prop_assert_eq!(ring.end_at(end as f64 / RATE.0).map(|i| i.0), before);
            }
        }
    }
}

#[test]
fn the_same_block_twice_changes_nothing_but_the_count() {
    let mut ring = Ring::new(RATE, 1.0);
    ring.push(&indexed(0, 10, 0));
    ring.push(&indexed(0, 10, 0));
    let status = ring.status();
    assert_eq!((status.received, status.duplicated, status.gaps), (10, 10, 0));
}

#[test]
fn a_partial_overlap_adds_its_new_part() {
    let mut ring = Ring::new(RATE, 1.0);
    ring.push(&indexed(0, 10, 0));
    ring.push(&indexed(6, 10, 0));
    let mut out = [0.0; 16];
    assert!(ring.copy(SampleIndex(0), &mut out));
    assert_eq!(out.to_vec(), (0_u8..16).map(f32::from).collect::<Vec<_>>());
    assert_eq!(ring.status().duplicated, 4);
}

#[test]
fn a_segment_change_is_a_boundary_without_a_missing_sample() {
    let mut ring = Ring::new(RATE, 1.0);
    ring.push(&indexed(0, 10, 0));
    ring.push(&block(10, 1, 600.0, vec![1.0; 5])); // a snapshot ten minutes later
    assert_eq!(ring.status().missing, 0);
    assert_eq!(ring.contiguous_before(SampleIndex(15), 100), (SampleIndex(10), 5));
    assert_eq!(ring.contiguous_before(SampleIndex(10), 100), (SampleIndex(0), 10));
    assert!(!ring.copy(SampleIndex(8), &mut [0.0; 4]));
    assert_eq!(ring.time_of(SampleIndex(10)), Some(600.0));
    assert_eq!(ring.end_at(300.0), Some(SampleIndex(10)));
    // five samples at 100 a second; binary rounding near 600 is 1e-13
    assert!((ring.status().newest_time_s - 600.05).abs() < 1e-9);
}

#[test]
fn a_newer_segment_may_start_again_at_zero() {
    let mut ring = Ring::new(RATE, 1.0);
    ring.push(&indexed(1000, 50, 3));
    ring.push(&indexed(0, 20, 4));
    let status = ring.status();
    assert_eq!((status.oldest.0, status.newest.0, status.received), (0, 20, 70));
    assert!(ring.time_of(SampleIndex(1000)).is_none());
    ring.push(&indexed(0, 20, 3)); // a late block of the old pass
    assert_eq!(ring.status().duplicated, 20);
}

#[test]
fn a_declared_rate_does_not_decide_the_allocation() {
    let bytes = Ring::bytes(Hz(f64::INFINITY), 30.0);
    assert_eq!(bytes, MAX_SAMPLES * 4 + MAX_RUNS * size_of::<Run>());
    assert_eq!(Ring::new(Hz(f64::NAN), 30.0).capacity(), 1);
    assert_eq!(Ring::new(Hz(12_000.0), 30.0).capacity(), 360_000);
}

#[test]
fn boundaries_stay_bounded() {
    let mut ring = Ring::new(RATE, 100.0); // holds 10,000
    for i in 0..5_000_u64 {
        ring.push(&indexed(2 * i, 1, 0)); // every other sample is missing
    }
    assert_eq!(ring.runs.len(), MAX_RUNS);
    let status = ring.status();
    assert_eq!((status.gaps, status.missing, status.received), (4_999, 4_999, 5_000));
    assert_eq!(ring.contiguous_before(SampleIndex(9_999), 10), (SampleIndex(9_998), 1));
    assert_eq!(status.oldest.0, 2 * (5_000 - MAX_RUNS as u64));
}

#[test]
fn samples_at_full_scale_count_as_clipped() {
    let mut ring = Ring::new(RATE, 1.0).with_full_scale(Some((-10.0, 9.5)));
    ring.push(&block(0, 0, 0.0, vec![-10.0, 0.0, 9.4, 9.5, 12.0]));
    assert_eq!(ring.status().clipped, 3);
}

#[test]
fn an_index_beyond_the_last_is_refused_and_counted() {
    let mut ring = Ring::new(RATE, 1.0);
    ring.push(&block(u64::MAX - 1, 0, 0.0, vec![0.0; 4]));
    assert_eq!((ring.status().received, ring.status().duplicated), (0, 4));
}
