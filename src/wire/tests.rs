//! What is written is read again; what was damaged is an error or nothing, never another frame.

use super::*;
use proptest::prelude::*;
use rand::RngExt;
use rand::SeedableRng;
use rand_pcg::Pcg64;

fn text(max: usize) -> impl Strategy<Value = String> {
    "[a-zA-Z0-9 µ°/^_-]{0,32}".prop_map(move |text| {
        let end = (0..=max.min(text.len())).rev().find(|at| text.is_char_boundary(*at));
        text[..end.unwrap_or(0)].to_owned()
    })
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![any::<f64>().prop_filter("NaN is unknown", |x| !x.is_nan()), -1e3..1e3_f64]
}

fn sample_type() -> impl Strategy<Value = SampleType> {
    prop::sample::select(SampleType::ALL.to_vec())
}

prop_compose! {
    fn channel()(
        name in text(MAX_NAME_BYTES),
        numbers in [number(), number(), number(), number()],
        sample_type in sample_type(),
        range in prop::option::of((number(), number())),
        unit in text(MAX_UNIT_BYTES),
    ) -> Channel {
        let [rate_hz, scale, offset, zero] = numbers;
        Channel { name, rate_hz, sample_type, scale, offset, zero, range, unit }
    }
}

prop_compose! {
    fn hello()(
        machine in text(MAX_NAME_BYTES),
        token in text(MAX_TOKEN_BYTES),
        epoch in any::<u64>(),
        shaft_speed_hz in prop::option::of(number()),
        load in prop::option::of(number()),
        channels in prop::collection::vec(channel(), 0..6),
    ) -> Hello {
        Hello { machine, token, epoch, shaft_speed_hz, load, channels }
    }
}

/// A message that owns what a block borrows.
#[derive(Debug, Clone)]
enum Owned {
    Whole(Message<'static>),
    Block { stream: u16, numbers: [u64; 2], time_ns: i64, kind: SampleType, bytes: Vec<u8> },
}

impl Owned {
    fn message(&self) -> Message<'_> {
        match self {
            Self::Whole(message) => message.clone(),
            Self::Block { stream, numbers: [sequence, first], time_ns, kind, bytes } => {
                let whole = bytes.len() / kind.bytes() * kind.bytes();
                let samples = Samples::new(*kind, &bytes[..whole]).unwrap();
                let (stream, sequence, first, time_ns) = (*stream, *sequence, *first, *time_ns);
                Message::Block(Block { stream, sequence, first, time_ns, samples })
            }
        }
    }

    fn frame(&self) -> Vec<u8> {
        let mut frame = Vec::new();
        encode(&self.message(), &mut frame).unwrap();
        frame
    }
}

fn message() -> impl Strategy<Value = Owned> {
    let index = 0..=MAX_INDEX;
    let wanted =
        (index.clone(), index.clone()).prop_map(|(sequence, index)| Wanted { sequence, index });
    let progress =
        (any::<u16>(), index.clone()).prop_map(|(stream, sequence)| Progress { stream, sequence });
    let whole = prop_oneof![
        hello().prop_map(Message::Hello),
        (any::<u32>(), prop::collection::vec(wanted, 0..9))
            .prop_map(|(credit_bytes, wanted)| Message::Welcome(Welcome { credit_bytes, wanted })),
        (any::<u32>(), prop::collection::vec(progress, 0..9))
            .prop_map(|(credit_bytes, progress)| Message::Ack(Ack { credit_bytes, progress })),
        (prop::sample::select(ErrorCode::ALL.to_vec()), text(MAX_TEXT_BYTES))
            .prop_map(|(code, text)| Message::Problem(Problem { code, text })),
        Just(Message::Bye(Bye::Pause)),
        Just(Message::Bye(Bye::End)),
        Just(Message::Ping),
    ];
    let block = (
        any::<u16>(),
        [index.clone(), index],
        any::<i64>(),
        sample_type(),
        prop::collection::vec(any::<u8>(), 0..400),
    );
    prop_oneof![
        whole.prop_map(Owned::Whole),
        block.prop_map(|(stream, numbers, time_ns, kind, bytes)| {
            Owned::Block { stream, numbers, time_ns, kind, bytes }
        }),
    ]
}

/// One of each kind, as a corpus for damage.
fn corpus() -> Vec<Owned> {
    let channel = |i: u8| Channel {
        name: format!("bearing_{i}_x"),
        rate_hz: 25_600.0,
        sample_type: SampleType::ALL[usize::from(i) % 5],
        scale: 0.001,
        offset: 0.0,
        zero: 0.0,
        range: (i == 2).then_some((-5.0, 5.0)),
        unit: "m/s^2".to_owned(),
    };
    let hello = Hello {
        machine: "rig-1".to_owned(),
        token: "a token of some length".to_owned(),
        epoch: 7,
        shaft_speed_hz: Some(29.5),
        load: None,
        channels: (0..5).map(channel).collect(),
    };
    let wanted = vec![Wanted { sequence: 3, index: 3000 }; 5];
    let progress = vec![Progress { stream: 1, sequence: 4 }; 3];
    let mut messages: Vec<Owned> = [
        Message::Hello(hello),
        Message::Welcome(Welcome { credit_bytes: 1 << 22, wanted }),
        Message::Ack(Ack { credit_bytes: 1 << 20, progress }),
        Message::Problem(Problem::new(ErrorCode::ChannelTaken, "another sender has x")),
        Message::Bye(Bye::End),
        Message::Ping,
    ]
    .map(Owned::Whole)
    .into();
    messages.push(Owned::Block {
        stream: 4,
        numbers: [17, 1_000_000],
        time_ns: 1_700_000_000_000_000_000,
        kind: SampleType::F32,
        bytes: (0..=255).collect(),
    });
    messages
}

/// What a reader makes of bytes: frames until there are no more, and how it ended.
fn read(bytes: &[u8], mut see: impl FnMut(Message<'_>)) -> Result<(), WireError> {
    let mut frames = Frames::default();
    frames.push(bytes);
    while let Some((message, _)) = frames.take()? {
        see(message);
    }
    Ok(())
}

proptest! {
    #[test]
    fn what_is_written_is_read_again_however_it_is_cut(
        messages in prop::collection::vec(message(), 1..6),
        pieces in prop::collection::vec(1..90_usize, 1..9),
    ) {
        let bytes: Vec<u8> = messages.iter().flat_map(Owned::frame).collect();
        let (mut frames, mut n_read, mut at) = (Frames::default(), 0, 0);
        for i in 0.. {
            while let Some((message, _)) = frames.take().unwrap() {
                prop_assert_eq!(message, messages[n_read].message());
                n_read += 1;
            }
            if at == bytes.len() {
                break;
            }
            let n = pieces[i % pieces.len()].min(bytes.len() - at);
            frames.push(&bytes[at..at + n]);
            at += n;
        }
        prop_assert_eq!(n_read, messages.len());
        prop_assert!(!frames.is_within());
    }

    #[test]
    fn any_bytes_are_an_error_or_wait_for_more(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        // Without the right checksum nothing is ever read.
        let mut seen = 0;
        let _named = read(&bytes, |_| seen += 1);
        prop_assert_eq!(seen, 0);
    }
}

#[test]
fn flipped_and_cut_bytes_are_an_error_or_the_same_frame() {
    let mut random = Pcg64::seed_from_u64(8);
    for owned in corpus() {
        let frame = owned.frame();
        let is_same = |bytes: &[u8]| {
            let mut seen = Vec::new();
            let ended = read(bytes, |message| seen.push(message == owned.message()));
            assert!(!seen.contains(&false), "another frame came out of a damaged one");
            (seen.len(), ended)
        };
        assert_eq!(is_same(&frame), (1, Ok(())));
        for at in 0..frame.len() {
            assert_eq!(is_same(&frame[..at]), (0, Ok(())), "cut at {at}");
            for bit in 0..8 {
                let mut damaged = frame.clone();
                damaged[at] ^= 1 << bit;
                // A longer length waits for what never comes; everything else is told.
                assert_eq!(is_same(&damaged).0, 0, "bit {bit} of byte {at}");
            }
        }
        for _ in 0..5_000 {
            let mut damaged = frame.clone();
            for _ in 0..random.random_range(1..6) {
                let at = random.random_range(0..damaged.len());
                match random.random_range(0..4) {
                    0 => damaged[at] = random.random(),
                    1 => drop(damaged.drain(at..)),
                    2 => damaged.insert(at, random.random()),
                    _ => damaged.extend_from_within(at..),
                }
                if damaged.is_empty() {
                    break;
                }
            }
            let _named = is_same(&damaged);
        }
    }
}

/// Damage behind the checksum: a sender that errs, or means harm.
#[test]
fn a_wrong_payload_with_a_right_checksum_is_an_error_or_a_frame() {
    let mut random = Pcg64::seed_from_u64(9);
    let (mut n_taken, mut n_refused) = (0, 0);
    for owned in corpus() {
        let frame = owned.frame();
        for _ in 0..5_000 {
            let mut damaged = frame.clone();
            for _ in 0..random.random_range(1..4) {
                let at = random.random_range(HEADER_BYTES..=damaged.len());
                match random.random_range(0..3) {
                    0 if at < damaged.len() => damaged[at] = random.random(),
                    1 => damaged.insert(at, random.random()),
                    _ => damaged.truncate(at),
                }
            }
            let n = u32::try_from(damaged.len() - HEADER_BYTES).unwrap();
            damaged[4..8].copy_from_slice(&n.to_le_bytes());
            let sum = crc32c::crc32c(&[&damaged[..8], &damaged[HEADER_BYTES..]].concat());
            damaged[8..12].copy_from_slice(&sum.to_le_bytes());
            // Whatever is read can be written again, so it is within every limit.
            let mut again = Vec::new();
            match read(&damaged, |message| encode(&message, &mut again).unwrap()) {
                Ok(()) => n_taken += 1,
                Err(error) => {
                    n_refused += 1;
                    assert!(!matches!(error, WireError::Checksum { .. }), "{error}");
                }
            }
        }
    }
    assert!(n_taken > 1000 && n_refused > 1000, "{n_taken} taken, {n_refused} refused");
}

#[test]
fn nothing_is_allocated_from_a_declared_length() {
    let mut frames = Frames::default();
    let mut header = [b'R', b'W', VERSION, 3, 0, 0, 0, 0, 0, 0, 0, 0];
    header[4..8].copy_from_slice(&u32::try_from(MAX_PAYLOAD_BYTES).unwrap().to_le_bytes());
    frames.push(&header);
    assert_eq!(frames.take(), Ok(None));
    assert!(frames.capacity() <= 1 << 17, "{}", frames.capacity());
    header[4..8].copy_from_slice(&u32::MAX.to_le_bytes());
    let mut frames = Frames::default();
    frames.push(&header);
    assert!(matches!(frames.take(), Err(WireError::TooLarge { .. })));
    // As much as a frame may have, and no more memory than twice that and a read.
    let mut frames = Frames::default();
    header[4..8].copy_from_slice(&u32::try_from(MAX_PAYLOAD_BYTES).unwrap().to_le_bytes());
    frames.push(&header);
    for _ in 0..MAX_PAYLOAD_BYTES / 1024 - 1 {
        frames.push(&[0; 1024]);
        assert_eq!(frames.take(), Ok(None));
    }
    assert!(frames.capacity() <= 2 * MAX_PAYLOAD_BYTES + (1 << 17), "{}", frames.capacity());
}

#[test]
fn what_is_too_long_is_not_written() {
    let mut out = b"before".to_vec();
    let long = Hello {
        machine: "m".repeat(MAX_NAME_BYTES + 1),
        token: String::new(),
        epoch: 0,
        shaft_speed_hz: None,
        load: None,
        channels: Vec::new(),
    };
    let error = encode(&Message::Hello(long), &mut out).unwrap_err();
    assert_eq!(error.code(), ErrorCode::TooLarge);
    assert_eq!(out, b"before");
    let bytes = vec![0; 2 * (MAX_BLOCK_SAMPLES + 1)];
    let samples = Samples::new(SampleType::I16, &bytes).unwrap();
    let block = Block { stream: 0, sequence: 0, first: 0, time_ns: NO_TIME, samples };
    assert!(encode(&Message::Block(block), &mut out).is_err());
    assert_eq!(Problem::new(ErrorCode::Malformed, &"µ".repeat(600)).text.len(), MAX_TEXT_BYTES);
}

/// The example of docs/wire.md, byte by byte.
#[test]
fn the_example_of_the_document_is_what_is_written() {
    let document = include_str!("../../docs/wire.md");
    let bytes: Vec<i16> = vec![1, -1, 256];
    let bytes: Vec<u8> = bytes.iter().flat_map(|x| x.to_le_bytes()).collect();
    let samples = Samples::new(SampleType::I16, &bytes).unwrap();
    let block = Block { stream: 2, sequence: 5, first: 15, time_ns: NO_TIME, samples };
    let mut frame = Vec::new();
    encode(&Message::Block(block), &mut frame).unwrap();
    let hex: Vec<String> = frame.iter().map(|byte| format!("{byte:02x}")).collect();
    let shown = document.split("```hex\n").nth(1).unwrap().split("```").next().unwrap();
    let shown: Vec<&str> =
        shown.lines().flat_map(|l| l.split("  #").next().unwrap().split(' ')).collect();
    assert_eq!(hex, shown.into_iter().filter(|word| !word.is_empty()).collect::<Vec<_>>());
    for code in ErrorCode::ALL {
        assert!(
            document.contains(&format!("| {} | `{}` |", code.number(), code.name())),
            "{code:?}"
        );
        assert_eq!(ErrorCode::of(code.number()), Some(code));
    }
}
