//! Every sample is accounted for and lies where it belongs, whatever a network does to blocks.

use super::Refusal;
use super::intake::Admitted;
use super::intake::Arrived;
use super::intake::Intake;
use super::intake::Taken;
use super::session::CREDIT_BYTES;
use super::session::FRAME_S;
use super::session::HELLO_S;
use super::session::IDLE_S;
use super::session::Session;
use crate::capture::received::RawSamples;
use crate::machine::Machine;
use crate::machine::file;
use crate::signal::Timestamp;
use crate::wire::Block;
use crate::wire::Bye;
use crate::wire::Channel;
use crate::wire::ErrorCode;
use crate::wire::Hello;
use crate::wire::Message;
use crate::wire::NO_TIME;
use crate::wire::SampleType;
use crate::wire::Samples;
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;

/// UTC of stream time 0, ns.
const ORIGIN_NS: i64 = 1_700_000_000_000_000_000;

const RATE_HZ: f64 = 1000.0;

fn machine() -> Arc<Machine> {
    let text = "[machine]\nid = \"rig-1\"\nname = \"Rig\"\n[[shaft]]\nid = \"main\"\nspeed_hz = 10.0\n\
         [[sensor]]\nchannel = \"x\"\nkind = \"accelerometer\"\nunit = \"m/s^2\"\nat = { shaft = \"main\" }\n\
         [[sensor]]\nchannel = \"y\"\nkind = \"accelerometer\"\nunit = \"m/s^2\"\nat = { shaft = \"main\" }\n";
    Arc::new(file::parse(text, "rig.toml").unwrap())
}

fn at(stream_s: f64) -> Timestamp {
    Timestamp(ORIGIN_NS).plus_seconds(stream_s)
}

fn channel(name: &str, sample_type: SampleType) -> Channel {
    Channel {
        name: name.to_owned(),
        rate_hz: RATE_HZ,
        sample_type,
        scale: 1.0,
        offset: 0.0,
        zero: 0.0,
        range: None,
        unit: "m/s^2".to_owned(),
    }
}

fn hello(epoch: u64, channels: Vec<Channel>) -> Hello {
    let machine = "rig-1".to_owned();
    Hello { machine, token: String::new(), epoch, shaft_speed_hz: None, load: None, channels }
}

fn intake() -> Intake {
    Intake::new(machine(), Timestamp(ORIGIN_NS), true)
}

fn admit(
    intake: &mut Intake,
    session: u64,
    now_s: f64,
    hello: &Hello,
) -> Result<Admitted, Refusal> {
    intake.hello(session, ("here", Arrived(at(now_s))), hello, &mut |_| Ok(()))
}

/// A block that owns its bytes.
#[derive(Debug, Clone)]
struct Owned {
    stream: u16,
    sequence: u64,
    first: u64,
    time_ns: i64,
    kind: SampleType,
    bytes: Vec<u8>,
}

impl Owned {
    /// Samples that say their own index, as 16 bits.
    fn ramp(sequence: u64, first: u64, n: u64, time_s: f64) -> Self {
        let value = |i: u64| i16::try_from(i % 30_000).unwrap();
        let bytes = (first..first + n).flat_map(|i| value(i).to_le_bytes()).collect();
        let (time_ns, kind) = (at(time_s).0, SampleType::I16);
        Self { stream: 0, sequence, first, time_ns, kind, bytes }
    }

    fn block(&self) -> Block<'_> {
        let samples = Samples::new(self.kind, &self.bytes).unwrap();
        let Self { stream, sequence, first, time_ns, .. } = *self;
        Block { stream, sequence, first, time_ns, samples }
    }
}

fn take(intake: &mut Intake, session: u64, owned: &Owned, now_s: f64) -> Result<Taken, Refusal> {
    intake.block(session, &owned.block(), Arrived(at(now_s)), true).map(|(_, taken)| taken)
}

fn code(result: Result<impl std::fmt::Debug, Refusal>) -> ErrorCode {
    result.unwrap_err().code
}

proptest! {
    #[test]
    fn every_sample_is_accounted_for_whatever_a_network_does(
        // Of each block: its length, samples that the sender did not measure before it, and how often and in which order it comes.
        blocks in prop::collection::vec((1..40_u64, prop_oneof![4 => Just(0), 1 => 1..50_u64], 0..3_usize, 0..1000_u32), 1..40),
        room in prop::collection::vec(prop::bool::weighted(0.9), 1..20),
    ) {
        let mut sent = Vec::new();
        let mut index = 0;
        for (sequence, (n, skipped, copies, order)) in (0..).zip(&blocks) {
            index += skipped;
            let block = Owned::ramp(sequence, index, *n, index as f64 / RATE_HZ);
            for copy in 0..*copies {
                // Mostly in order, some far off.
                let place = sequence * 100 + u64::from(*order) + copy as u64 * 37;
                sent.push((place, block.clone()));
            }
            index += n;
        }
        sent.sort_by_key(|(place, _)| *place);
        let mut intake = intake();
        admit(&mut intake, 1, 0.0, &hello(1, vec![channel("x", SampleType::I16)])).unwrap();
        let mut seen: BTreeMap<u64, f32> = BTreeMap::new();
        let (mut n_sent, mut begun) = (0, None);
        for (i, (_, owned)) in sent.iter().enumerate() {
            let has_room = room[i % room.len()];
            let block = owned.block();
            n_sent += block.samples.len() as u64;
            begun = begun.or(Some(block.first));
            let (_, taken) = intake.block(1, &block, Arrived(at(10.0)), has_room).unwrap();
            for piece in taken.blocks {
                // The first block that came gave the place, by its time: all others follow.
                prop_assert!((piece.time_s - piece.start.0 as f64 / RATE_HZ).abs() < 1e-9);
                for (k, x) in (piece.start.0..).zip(piece.samples) {
                    prop_assert!(seen.insert(k, x).is_none(), "sample {k} was used twice");
                }
            }
        }
        let ledger = intake.status()[0].ledger;
        prop_assert!(ledger.is_conserved(), "{ledger:?}");
        prop_assert_eq!(ledger.received, n_sent);
        prop_assert_eq!(ledger.used, seen.len() as u64);
        let next = admit(&mut intake, 1, 10.0, &hello(1, vec![channel("x", SampleType::I16)]));
        let next = next.unwrap().wanted[0];
        prop_assert_eq!(ledger.places(), next.index - begun.unwrap_or(0), "{:?}", ledger);
        prop_assert!(ledger.late <= ledger.lost);
        for (k, x) in seen {
            prop_assert!((f64::from(x) - (k % 30_000) as f64).abs() < 1e-9);
        }
    }
}

#[test]
fn what_comes_late_is_told_from_what_comes_twice() {
    let mut intake = intake();
    admit(&mut intake, 1, 0.0, &hello(1, vec![channel("x", SampleType::I16)])).unwrap();
    let block = |k: u64| Owned::ramp(k, 10 * k, 10, 0.01 * k as f64);
    for k in [0, 1, 4, 3, 3, 1] {
        take(&mut intake, 1, &block(k), 1.0).unwrap();
    }
    let ledger = intake.status()[0].ledger;
    // 2 and 3 were lost when 4 came; 3 came late, and once more; 1 came twice.
    assert_eq!((ledger.received, ledger.used), (60, 30));
    assert_eq!((ledger.lost, ledger.gaps, ledger.late, ledger.duplicate), (20, 1, 10, 20));
    assert_eq!((ledger.blocks, ledger.blocks_lost), (6, 2));
    assert!(ledger.is_conserved());
}

#[test]
fn a_sender_that_comes_back_goes_on_and_one_that_begins_anew_is_placed_by_its_time() {
    let mut intake = intake();
    let greeting = hello(7, vec![channel("x", SampleType::I16)]);
    let admitted = admit(&mut intake, 1, 0.0, &greeting).unwrap();
    assert!(admitted.opened.is_some());
    let first = take(&mut intake, 1, &Owned::ramp(0, 0, 100, 100.0), 200.0).unwrap();
    assert!((first.blocks[0].time_s - 100.0).abs() < 1e-9);
    assert!(intake.leave(1));
    let admitted = admit(&mut intake, 2, 200.0, &greeting).unwrap();
    assert_eq!((admitted.wanted[0].sequence, admitted.wanted[0].index), (1, 100));
    assert_eq!(admitted.opened, None);
    // Its stamp says another time now: inside an epoch the index is the clock.
    let second = take(&mut intake, 2, &Owned::ramp(1, 100, 100, 103.0), 200.0).unwrap();
    let (start, time_s) = (second.blocks[0].start.0, second.blocks[0].time_s);
    assert_eq!((start, second.blocks[0].segment), (100, first.blocks[0].segment));
    assert!((time_s - 100.1).abs() < 1e-9, "{time_s}");
    assert_eq!(intake.status()[0].ledger.lost, 0);

    // Another epoch, ten seconds later: its own counts, its own place, a new segment, no sample lost.
    assert!(intake.leave(2));
    let greeting = hello(8, vec![channel("x", SampleType::I16)]);
    let admitted = admit(&mut intake, 3, 200.0, &greeting).unwrap();
    assert_eq!((admitted.wanted[0].sequence, admitted.wanted[0].index), (0, 0));
    let third = take(&mut intake, 3, &Owned::ramp(0, 0, 100, 110.2), 200.0).unwrap();
    // The last sample ended at 100.2 s: 10 s are 10 000 samples.
    assert_eq!(third.blocks[0].start.0, 200 + 10_000);
    assert!((third.blocks[0].time_s - 110.2).abs() < 1e-9);
    assert!(third.blocks[0].segment > second.blocks[0].segment);
    // One whose clock was set back goes on where stream time is.
    assert!(intake.leave(3));
    let greeting = hello(9, vec![channel("x", SampleType::I16)]);
    admit(&mut intake, 4, 200.0, &greeting).unwrap();
    let fourth = take(&mut intake, 4, &Owned::ramp(0, 0, 100, 50.0), 200.0).unwrap();
    assert!((fourth.blocks[0].time_s - 110.3).abs() < 1e-9, "{}", fourth.blocks[0].time_s);
    let ledger = intake.status()[0].ledger;
    assert_eq!((ledger.used, ledger.lost), (400, 0));
}

#[test]
fn a_channel_has_one_sender_but_the_same_sender_may_come_again() {
    let mut intake = intake();
    admit(&mut intake, 1, 0.0, &hello(1, vec![channel("x", SampleType::I16)])).unwrap();
    take(&mut intake, 1, &Owned::ramp(0, 0, 10, 0.0), 1.0).unwrap();
    let refused = admit(&mut intake, 2, 0.0, &hello(2, vec![channel("x", SampleType::I16)]));
    let refused = refused.unwrap_err();
    assert_eq!(refused.code, ErrorCode::ChannelTaken);
    assert!(refused.text.contains("here") && refused.text.contains("\"x\""), "{}", refused.text);
    // The first is not disturbed.
    take(&mut intake, 1, &Owned::ramp(1, 10, 10, 0.01), 1.0).unwrap();
    // Its connection broke without a word: the new one goes on, the old one is told.
    let again = admit(&mut intake, 3, 1.0, &hello(1, vec![channel("x", SampleType::I16)])).unwrap();
    assert_eq!(again.wanted[0].sequence, 2);
    assert_eq!(
        code(take(&mut intake, 1, &Owned::ramp(2, 20, 10, 0.02), 1.0)),
        ErrorCode::ChannelTaken
    );
    take(&mut intake, 3, &Owned::ramp(2, 20, 10, 0.02), 1.0).unwrap();
    assert!(!intake.leave(1), "the other is still there");
    assert!(intake.leave(3));
    assert_eq!(intake.status()[0].ledger.used, 30);
}

#[test]
fn channels_of_several_senders_rates_and_starts_are_on_one_axis() {
    let mut intake = intake();
    admit(&mut intake, 1, 0.0, &hello(1, vec![channel("x", SampleType::I16)])).unwrap();
    let x = take(&mut intake, 1, &Owned::ramp(0, 5000, 100, 20.0), 30.0).unwrap();
    // A slower one of another sender, which began 2.5 s later, makes it another stream; both go on.
    let slow = Channel { rate_hz: 100.0, ..channel("y", SampleType::I16) };
    let admitted = admit(&mut intake, 2, 30.0, &hello(2, vec![slow])).unwrap();
    let info = admitted.opened.unwrap();
    let names: Vec<&str> = info.channels.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["x", "y"]);
    let y = take(&mut intake, 2, &Owned::ramp(0, 0, 100, 22.5), 30.0).unwrap();
    let x_on = take(&mut intake, 1, &Owned::ramp(1, 5100, 100, 20.1), 30.0).unwrap();
    assert!((x.blocks[0].time_s - 20.0).abs() < 1e-9);
    assert!((y.blocks[0].time_s - 22.5).abs() < 1e-9 && y.blocks[0].channel.0 == 1);
    assert!((x_on.blocks[0].time_s - 20.1).abs() < 1e-9 && x_on.blocks[0].channel.0 == 0);
    assert_eq!(x_on.blocks[0].segment, y.blocks[0].segment);
    assert_eq!(intake.status().iter().map(|c| c.ledger.used).sum::<u64>(), 300);
    // The first one goes and comes with another rate: the other is not disturbed.
    intake.leave(1);
    let fast = Channel { rate_hz: 2000.0, ..channel("x", SampleType::I16) };
    let admitted = admit(&mut intake, 3, 30.0, &hello(3, vec![fast])).unwrap();
    assert_eq!(admitted.opened.unwrap().channels.len(), 2);
    assert_eq!(intake.status().iter().map(|c| c.ledger.used).sum::<u64>(), 300, "counts go on");
    let y = take(&mut intake, 2, &Owned::ramp(1, 100, 100, 23.5), 30.0).unwrap();
    assert_eq!((y.blocks[0].channel.0, y.blocks[0].start.0), (0, 100));
}

#[test]
fn times_and_indices_of_the_future_are_refused() {
    let mut intake = intake();
    admit(&mut intake, 1, 0.0, &hello(1, vec![channel("x", SampleType::I16)])).unwrap();
    let refused = take(&mut intake, 1, &Owned::ramp(0, 0, 10, 11.0), 0.0);
    assert_eq!(code(refused), ErrorCode::TimeAhead);
    take(&mut intake, 1, &Owned::ramp(0, 0, 10, 0.0), 0.0).unwrap();
    // 20 s of samples within a second of the clock.
    let refused = take(&mut intake, 1, &Owned::ramp(1, 20_000, 10, 0.01), 1.0);
    assert_eq!(code(refused), ErrorCode::TimeAhead);
    let ledger = intake.status()[0].ledger;
    assert_eq!((ledger.used, ledger.lost), (10, 0), "nothing has changed");
    // A clock that runs 1 % fast is no hostile one, however long it runs.
    take(&mut intake, 1, &Owned::ramp(1, 10_100_000, 10, 10_000.0), 10_000.0).unwrap();
}

#[test]
fn a_block_is_no_longer_than_what_may_be_judged_at_once() {
    let mut intake = intake();
    let slow = Channel { rate_hz: 0.01, ..channel("x", SampleType::I16) };
    admit(&mut intake, 1, 0.0, &hello(1, vec![slow])).unwrap();
    let refused = take(&mut intake, 1, &Owned::ramp(0, 0, 8, 0.0), 7000.0);
    assert_eq!(code(refused), ErrorCode::TooLarge);
    take(&mut intake, 1, &Owned::ramp(0, 0, 7, 0.0), 7000.0).unwrap();
}

#[test]
fn samples_that_are_no_numbers_or_beyond_the_range_leave_counted_holes() {
    let mut intake = intake();
    let ranged = Channel { range: Some((-5.0, 5.0)), ..channel("x", SampleType::F32) };
    let free = channel("y", SampleType::F64);
    admit(&mut intake, 1, 0.0, &hello(1, vec![ranged, free])).unwrap();
    let x = [1.0_f32, f32::NAN, 2.0, 5.0, 5.5, f32::INFINITY, -5.0, 3.0];
    let bytes = x.iter().flat_map(|x| x.to_le_bytes()).collect();
    let owned = Owned { kind: SampleType::F32, bytes, ..Owned::ramp(0, 0, 0, 0.0) };
    let taken = take(&mut intake, 1, &owned, 0.0).unwrap();
    let runs: Vec<(u64, Vec<f32>)> =
        taken.blocks.iter().map(|b| (b.start.0, b.samples.clone())).collect();
    assert_eq!(runs, [(0, vec![1.0]), (2, vec![2.0, 5.0]), (6, vec![-5.0, 3.0])]);
    assert!((taken.blocks[2].time_s - 0.006).abs() < 1e-12);
    let raw = taken.received.unwrap().raw;
    assert!(matches!(raw, RawSamples::F32(raw) if raw.len() == 8), "all are kept as they came");
    let ledger = intake.status()[0].ledger;
    assert_eq!((ledger.used, ledger.not_finite, ledger.out_of_range), (5, 2, 1));
    assert_eq!(ledger.clipped, 2);
    assert!(ledger.is_conserved() && ledger.places() == 8);
    // Without a range only what no sensor gives is beyond it.
    let y = [1e14_f64, 1e16, f64::MAX, -1e16];
    let bytes = y.iter().flat_map(|y| y.to_le_bytes()).collect();
    let owned = Owned { stream: 1, kind: SampleType::F64, bytes, ..Owned::ramp(0, 0, 0, 0.0) };
    take(&mut intake, 1, &owned, 0.0).unwrap();
    let ledger = intake.status()[1].ledger;
    assert_eq!((ledger.used, ledger.not_finite + ledger.out_of_range), (1, 3));
    // A block that is mostly holes is refused as a whole, and counted.
    let bytes = (0..1000).flat_map(|i| if i % 2 == 0 { f64::NAN } else { 1.0 }.to_le_bytes());
    let bytes = bytes.collect();
    let owned = Owned { stream: 1, kind: SampleType::F64, bytes, ..Owned::ramp(1, 4, 0, 0.0) };
    assert!(take(&mut intake, 1, &owned, 1.0).unwrap().blocks.is_empty());
    let ledger = intake.status()[1].ledger;
    assert_eq!((ledger.used, ledger.places()), (1, 1004));
    assert!(ledger.is_conserved());
}

#[test]
fn numbers_of_every_type_are_read_with_their_sign() {
    let expected = [-8_388_608.0, -1.0, 0.0, 1.0, 8_388_607.0];
    let bytes = |kind: SampleType| -> Vec<u8> {
        let one = |x: f64| -> Vec<u8> {
            #[expect(clippy::cast_possible_truncation, reason = "whole numbers of 24 bits")]
            match kind {
                SampleType::I16 => (x.clamp(-32_768.0, 32_767.0) as i16).to_le_bytes().to_vec(),
                SampleType::I24 => (x as i32).to_le_bytes()[..3].to_vec(),
                SampleType::I32 => (x as i32).to_le_bytes().to_vec(),
                SampleType::F32 => (x as f32).to_le_bytes().to_vec(),
                SampleType::F64 => x.to_le_bytes().to_vec(),
            }
        };
        expected.into_iter().flat_map(one).collect()
    };
    for kind in SampleType::ALL {
        let mut intake = intake();
        let described = Channel { scale: 2.0, ..channel("x", kind) };
        let admitted = admit(&mut intake, 1, 0.0, &hello(1, vec![described])).unwrap();
        let bytes = bytes(kind);
        let owned = Owned { kind, bytes, ..Owned::ramp(0, 0, 0, 0.0) };
        let taken = take(&mut intake, 1, &owned, 0.0).unwrap();
        let low = if kind == SampleType::I16 { -32_768.0 } else { expected[0] };
        let high = if kind == SampleType::I16 { 32_767.0 } else { expected[4] };
        let samples: Vec<f64> = taken.blocks[0].samples.iter().map(|x| f64::from(*x)).collect();
        assert_eq!(samples, [2.0 * low, -2.0, 0.0, 2.0, 2.0 * high], "{kind:?}");
        let full_scale = admitted.opened.unwrap().channels[0].full_scale;
        let n_clipped = match kind {
            SampleType::I16 | SampleType::I24 => 2,
            SampleType::I32 | SampleType::F32 | SampleType::F64 => 0,
        };
        assert_eq!(intake.status()[0].ledger.clipped, n_clipped, "{kind:?} {full_scale:?}");
    }
}

#[test]
fn a_hello_that_cannot_be_used_is_refused_with_the_reason() {
    let bad = |channels: Vec<Channel>| {
        let refused = admit(&mut intake(), 1, 0.0, &hello(1, channels)).unwrap_err();
        assert_eq!(refused.code, ErrorCode::BadChannel, "{}", refused.text);
        refused.text
    };
    let x = || channel("x", SampleType::I16);
    assert!(bad(vec![]).contains("no channel"));
    assert!(bad(vec![x(), x()]).contains("twice"));
    assert!(bad(vec![channel("z", SampleType::I16)]).contains("x, y"));
    assert!(bad(vec![channel("x/y", SampleType::I16)]).contains('/'));
    for rate_hz in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e12] {
        assert!(bad(vec![Channel { rate_hz, ..x() }]).contains("samples a second"));
    }
    for scale in [0.0, f64::NAN, 1e300] {
        assert!(bad(vec![Channel { scale, ..x() }]).contains("scale"));
    }
    assert!(bad(vec![Channel { unit: "furlong".to_owned(), ..x() }]).contains("m/s^2"));
    assert!(bad(vec![Channel { range: Some((1.0, 1.0)), ..x() }]).contains("lowest"));
    // What does not fit is refused, and nothing of it stays.
    let mut intake = intake();
    let hello = hello(1, vec![x()]);
    let full = &mut |_: &_| Err("no room".to_owned());
    let refused = intake.hello(1, ("here", Arrived(at(0.0))), &hello, full);
    assert_eq!(code(refused), ErrorCode::NoRoom);
    assert_eq!((intake.n_senders(), intake.status().len()), (0, 0));
    // Nor may names be exchanged for ever: each leaves its counters behind.
    let many = |round: usize| {
        let named = |i: usize| channel(&format!("{round}-{i}"), SampleType::I16);
        let more = (0..4000).map(named).chain([x()]).collect();
        super::tests::hello(round as u64, more)
    };
    let mut rotating = super::tests::intake();
    for (round, expected) in [(1, true), (2, true), (3, false), (2, true)] {
        let admitted = admit(&mut rotating, 1, 0.0, &many(round));
        assert_eq!(admitted.is_ok(), expected, "{round}");
        assert!(admitted.err().is_none_or(|refusal| refusal.code == ErrorCode::NoRoom));
        rotating.leave(1);
    }
    // A block of a stream that is none, of another type, without samples, without a hello.
    admit(&mut intake, 1, 0.0, &hello).unwrap();
    let block = || Owned::ramp(0, 0, 10, 0.0);
    let beyond = Owned { stream: 1, ..block() };
    assert_eq!(code(take(&mut intake, 1, &beyond, 0.0)), ErrorCode::Unexpected);
    let other = Owned { kind: SampleType::F32, bytes: vec![0; 8], ..block() };
    assert_eq!(code(take(&mut intake, 1, &other, 0.0)), ErrorCode::Malformed);
    let empty = Owned { bytes: Vec::new(), ..block() };
    assert_eq!(code(take(&mut intake, 1, &empty, 0.0)), ErrorCode::Malformed);
    assert_eq!(code(take(&mut intake, 9, &block(), 0.0)), ErrorCode::Unexpected);
}

#[test]
fn a_block_without_a_time_is_placed_by_its_arrival() {
    let mut intake = intake();
    admit(&mut intake, 1, 0.0, &hello(1, vec![channel("x", SampleType::I16)])).unwrap();
    let owned = Owned { time_ns: NO_TIME, ..Owned::ramp(0, 0, 500, 0.0) };
    let taken = take(&mut intake, 1, &owned, 60.0).unwrap();
    // Half a second of samples, the last of which has just been taken.
    assert!((taken.blocks[0].time_s - 59.5).abs() < 1e-9);
}

#[test]
fn a_clock_that_drifts_is_seen_by_arrivals() {
    let mut intake = intake();
    admit(&mut intake, 1, 0.0, &hello(1, vec![channel("x", SampleType::I16)])).unwrap();
    for k in 0..600_u64 {
        // 100 samples come every 0.1 s / (1 + 2e-3): a rate stated 0.2 % too low.
        let now_s = 0.1 * (k + 1) as f64 / 1.002;
        let owned = Owned { time_ns: NO_TIME, ..Owned::ramp(k, 100 * k, 100, 0.0) };
        take(&mut intake, 1, &owned, 1.0 + now_s).unwrap();
    }
    let clock = intake.status()[0].clock.unwrap();
    assert!((clock.ppm - 2000.0).abs() < 10.0 && clock.is_wrong_rate(), "{clock:?}");
}

fn block_message(owned: &Owned) -> Message<'_> {
    Message::Block(owned.block())
}

#[test]
fn credit_shrinks_as_the_queue_fills_and_is_never_taken_back() {
    let mut session = Session::new(0.0);
    let greeting = Message::Hello(hello(1, vec![channel("x", SampleType::I16)]));
    session.frame(&greeting, 100, 0.1).unwrap();
    let welcome = session.welcome(Vec::new(), 0.0);
    assert_eq!(welcome.credit_bytes, CREDIT_BYTES);
    let owned = Owned::ramp(0, 0, 100, 0.0);
    let half = usize::try_from(CREDIT_BYTES / 2).unwrap();
    let frame = |session: &mut Session, n| session.frame(&block_message(&owned), n, 0.2).unwrap();
    assert!(frame(&mut session, half));
    session.settle(0, 1, 0.2);
    // Much has come: an ack at once; the queue is full: no more from here on. What was given stays.
    let ack = session.ack(0.95, 0.2).unwrap();
    assert_eq!((ack.credit_bytes, ack.progress.len()), (0, 1));
    assert!(frame(&mut session, half), "it was under way already");
    assert!(!frame(&mut session, 100), "this was not");
    assert_eq!(session.ack(0.95, 0.21), None, "nothing is settled");
    // There is room again: it is told without being asked.
    let ack = session.ack(0.1, 0.22).unwrap();
    assert_eq!(ack.credit_bytes, CREDIT_BYTES);
    assert!(frame(&mut session, 100));
    session.settle(0, 2, 0.3);
    assert_eq!(session.ack(0.6, 0.31), None, "a little waits for more");
    assert_eq!(session.ack(0.6, 0.36).unwrap().credit_bytes, CREDIT_BYTES / 4);
    assert_eq!(session.ack(0.0, 9.0), None);
    session.frame(&Message::Ping, 12, 9.0).unwrap();
    assert!(session.ack(0.0, 9.0).is_some(), "a ping is answered");
}

#[test]
fn frames_out_of_turn_and_senders_that_take_too_long_are_named() {
    let greeting = || Message::Hello(hello(1, vec![channel("x", SampleType::I16)]));
    let owned = Owned::ramp(0, 0, 100, 0.0);
    let mut session = Session::new(0.0);
    assert_eq!(code(session.frame(&block_message(&owned), 100, 0.0)), ErrorCode::Unexpected);
    assert_eq!(code(Session::new(0.0).frame(&Message::Ping, 12, 0.0)), ErrorCode::Unexpected);
    session.tick(false, HELLO_S).unwrap();
    assert_eq!(code(session.tick(true, HELLO_S + 0.1)), ErrorCode::Timeout);
    session.frame(&greeting(), 100, 1.0).unwrap();
    assert_eq!(code(session.frame(&greeting(), 100, 1.0)), ErrorCode::Unexpected);
    // A frame that comes byte by byte.
    session.tick(true, 2.0).unwrap();
    session.tick(true, 2.0 + FRAME_S).unwrap();
    assert_eq!(code(session.tick(true, 2.1 + FRAME_S)), ErrorCode::Timeout);
    // One that comes in time, then silence.
    session.frame(&Message::Ping, 12, 20.0).unwrap();
    session.tick(false, 20.0 + IDLE_S).unwrap();
    assert_eq!(code(session.tick(false, 20.1 + IDLE_S)), ErrorCode::Timeout);
    session.frame(&Message::Bye(Bye::End), 13, 30.0).unwrap();
    assert!(session.is_over() && session.ack(0.0, 30.0).is_some());
    assert_eq!(code(session.frame(&Message::Ping, 12, 30.0)), ErrorCode::Unexpected);
}
