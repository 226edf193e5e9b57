//! Whatever bytes come: an error, or messages that can be written and read again. Checksums are made right at times, so
//! that payloads are reached.

#![no_main]
#![allow(dead_code, unreachable_pub, unused_imports)]

#[path = "../../src/wire/mod.rs"]
mod wire;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    read(bytes);
    if let [kind, payload @ ..] = bytes {
        let mut frame = vec![b'R', b'W', wire::VERSION, kind % 8];
        frame.extend_from_slice(&u32::try_from(payload.len()).unwrap_or(0).to_le_bytes());
        let sum = crc32c::crc32c_append(crc32c::crc32c(&frame), payload);
        frame.extend_from_slice(&sum.to_le_bytes());
        frame.extend_from_slice(payload);
        read(&frame);
    }
});

fn read(bytes: &[u8]) {
    let mut frames = wire::Frames::default();
    frames.push(bytes);
    while let Ok(Some((message, _))) = frames.take() {
        let mut again = Vec::new();
        wire::encode(&message, &mut again).expect("what was read can be written");
        let mut frames = wire::Frames::default();
        frames.push(&again);
        let (read, _) = frames.take().expect("a frame").expect("as a whole");
        // NaN is not equal to itself, so bytes are compared.
        let mut once_more = Vec::new();
        wire::encode(&read, &mut once_more).expect("what was read can be written");
        assert_eq!(again, once_more);
    }
}
