//! What becomes of samples.

use super::*;

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
fn a_block_without_a_time_is_placed_by_its_arrival() {
    let mut intake = intake();
    admit(&mut intake, 1, 0.0, &hello(1, vec![channel("x", SampleType::I16)])).unwrap();
    let owned = Owned { time_ns: NO_TIME, ..Owned::ramp(0, 0, 500, 0.0) };
    let taken = take(&mut intake, 1, &owned, 60.0).unwrap();
    // Half a second of samples, the last of which has just been taken.
    assert!((taken.blocks[0].time_s - 59.5).abs() < 1e-9);
    assert_eq!(intake.status()[0].stated_until, None);
    take(&mut intake, 1, &Owned::ramp(1, 500, 500, 60.0), 60.6).unwrap();
    assert_eq!(intake.status()[0].stated_until, Some(at(60.5)));
}

#[test]
fn a_sender_that_begins_anew_with_its_old_epoch_is_told() {
    let mut intake = intake();
    admit(&mut intake, 1, 0.0, &hello(1, vec![channel("x", SampleType::I16)])).unwrap();
    let second = |k: u64| Owned::ramp(k, 1000 * k, 1000, k as f64);
    for k in 0..20 {
        take(&mut intake, 1, &second(k), (k + 1) as f64).unwrap();
    }
    // The first seconds again, as of a program that counts from 0 and keeps its epoch.
    for k in 0..4 {
        take(&mut intake, 1, &second(k), (21 + k) as f64).unwrap();
    }
    assert_eq!(intake.status()[0].doubt, None, "a sender repeats some after a break");
    take(&mut intake, 1, &second(4), 25.0).unwrap();
    let told = intake.status()[0].doubt.clone().unwrap();
    assert!(
        told.contains("5000 samples had come before") && told.contains("epoch than 1"),
        "{told}"
    );
    assert_eq!(intake.doubts(), [format!("channel `x`: {told}")]);
    take(&mut intake, 1, &second(20), 26.0).unwrap();
    assert_eq!(intake.status()[0].doubt, None, "new ones come");
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

#[test]
fn a_senders_clock_that_is_behind_or_ahead_is_told_until_it_is_set() {
    for (behind_s, what) in [(300.0, "300 s after"), (-5.0, "5.0 s before")] {
        let mut intake = intake();
        admit(&mut intake, 1, 0.0, &hello(1, vec![channel("x", SampleType::I16)])).unwrap();
        let mut send = |k: u64, behind_s: f64| {
            let owned = Owned::ramp(k, 1000 * k, 1000, 1000.0 + k as f64 - behind_s);
            take(&mut intake, 1, &owned, 1001.0 + k as f64).unwrap();
            let status = intake.status().remove(0);
            (status.offset_s, status.doubt)
        };
        let first = (0..60).map(|k| send(k, behind_s)).last().unwrap();
        assert_eq!(first, (None, None), "nothing is said before a minute is over");
        let (offset_s, doubt) = (60..70).map(|k| send(k, behind_s)).last().unwrap();
        assert!((offset_s.unwrap() - behind_s).abs() < 1e-6, "{offset_s:?}");
        let doubt = doubt.unwrap();
        assert!(doubt.contains(what), "{doubt}");
        // It is set.
        let (_, doubt) = (70..400).map(|k| send(k, 0.0)).last().unwrap();
        assert_eq!(doubt, None);
    }
}

/// What happens to the sender of a channel.
#[derive(Debug, Clone)]
enum Happens {
    /// A block comes: how far from the one that is next, which samples are none, whether there is room.
    Block { place: i64, n: u64, bad: Option<u64>, has_room: bool },
    /// The line breaks, and the sender goes on; another one may have come in between.
    Break { other_came: bool },
    /// The sender begins anew, with another rate or not.
    Anew { faster: bool },
}

fn happens() -> impl Strategy<Value = Happens> {
    let place = prop_oneof![6 => Just(0), 2 => -6..0_i64, 2 => 1..6_i64];
    let bad = prop_oneof![4 => Just(None), 1 => (0..40_u64).prop_map(Some)];
    let block = (place, 1..40_u64, bad, prop::bool::weighted(0.9));
    prop_oneof![
        12 => block.prop_map(|(place, n, bad, has_room)| Happens::Block { place, n, bad, has_room }),
        1 => any::<bool>().prop_map(|other_came| Happens::Break { other_came }),
        1 => any::<bool>().prop_map(|faster| Happens::Anew { faster }),
    ]
}

proptest! {
    #[test]
    fn every_sample_is_accounted_for_over_breaks_epochs_and_other_senders(
        story in prop::collection::vec(happens(), 1..80),
    ) {
        let mut intake = intake();
        let described = |faster: bool| {
            let rate_hz = if faster { 2.0 * RATE_HZ } else { RATE_HZ };
            Channel { rate_hz, range: Some((-1e4, 1e4)), ..channel("x", SampleType::F32) }
        };
        let (mut epoch, mut session, mut faster) = (1, 1, false);
        // Sent so far of the epoch: sequence and index wanted next.
        let mut next = admit(&mut intake, session, 0.0, &hello(epoch, vec![described(faster)])).unwrap().wanted[0];
        let (mut n_sent, mut n_used, mut end, mut before) = (0, 0, 0, 0);
        for (step, happens) in story.iter().enumerate() {
            match *happens {
                Happens::Block { place, n, bad, has_room } => {
                    let sequence = next.sequence.saturating_add_signed(place);
                    let first = next.index.saturating_add_signed(40 * place);
                    let value = |i: u64| if bad == Some(i) { f32::NAN } else { i as f32 };
                    let bytes = (0..n).flat_map(|i| value(i).to_le_bytes()).collect();
                    let owned = Owned { kind: SampleType::F32, bytes, ..Owned::ramp(sequence, first, 0, step as f64) };
                    let arrived = Arrived(at(100.0 + step as f64));
                    let (wanted, taken) = intake.block(session, &owned.block(), arrived, has_room).unwrap();
                    prop_assert!(wanted >= next.sequence, "what is settled stays so");
                    n_sent += n;
                    for block in taken.blocks {
                        prop_assert!(block.start.0 >= end, "sample {} after {end}", block.start.0);
                        end = block.start.0 + block.samples.len() as u64;
                        n_used += block.samples.len() as u64;
                    }
                    next.sequence = wanted;
                    next.index = next.index.max(first + n);
                }
                Happens::Break { other_came } => {
                    intake.leave(session);
                    if other_came {
                        admit(&mut intake, 1000 + step as u64, 100.0, &hello(9, vec![channel("y", SampleType::I16)])).unwrap();
                    }
                    session += 1;
                    let wanted = admit(&mut intake, session, 100.0, &hello(epoch, vec![described(faster)])).unwrap().wanted[0];
                    prop_assert_eq!(wanted.sequence, next.sequence);
                    next = wanted;
                }
                Happens::Anew { faster: now } => {
                    intake.leave(session);
                    (epoch, session, faster) = (epoch + 1, session + 1, now);
                    next = admit(&mut intake, session, 100.0, &hello(epoch, vec![described(faster)])).unwrap().wanted[0];
                    prop_assert_eq!((next.sequence, next.index), (0, 0));
                }
            }
            let ledger = intake.ledgers().find(|(name, _)| *name == "x").map(|(_, ledger)| *ledger).unwrap();
            prop_assert!(ledger.is_conserved(), "{:?}", ledger);
            prop_assert_eq!((ledger.received, ledger.used), (n_sent, n_used));
            prop_assert!(ledger.places() >= before, "places are counted up only");
            prop_assert!(ledger.late <= ledger.lost);
            before = ledger.places();
        }
    }
}
