//! Measures nothing and sends it: a sine of 50 Hz with a little noise, to a running daemon, for ten seconds.
//!
//! ```sh
//! cargo run --example stream -- 127.0.0.1:8081 rig-1 right_x
//! ```
//!
//! The whole of a sender by the protocol of `docs/wire.md`, without coming back after a break; `app::live::client` does that.

use rotorwatch::wire;
use rotorwatch::wire::{Block, Bye, Channel, Frames, Hello, Message, SampleType, Samples};
use std::error::Error;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::thread;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

const RATE_HZ: u32 = 10_000;

/// Samples of a block: a tenth of a second.
const BLOCK: u32 = 1000;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [address, machine, channel] = &arguments[..] else {
        return Err("give HOST:PORT, the machine's id and the channel's name".into());
    };
    #[expect(clippy::disallowed_methods, reason = "the clock of a sender")]
    let start_ns = i64::try_from(SystemTime::now().duration_since(UNIX_EPOCH)?.as_nanos())?;
    let channel = Channel::new(channel, f64::from(RATE_HZ), SampleType::F32, "m/s^2");
    let hello = Hello::new(machine, start_ns.cast_unsigned(), vec![channel]);
    let mut stream = TcpStream::connect(address)?;
    let mut frames = Frames::default();
    say(&mut stream, &Message::Hello(hello))?;
    let (mut credit, mut wanted) = (0, 0);
    let mut under_way: Vec<(u64, usize)> = Vec::new();
    for k in 0..100_u32 {
        thread::sleep(Duration::from_millis(100));
        let value = |i: u32| {
            let phase = f64::from(i % RATE_HZ) / f64::from(RATE_HZ) * 50.0 * std::f64::consts::TAU;
            phase.sin() + 1e-3 * f64::from(i.wrapping_mul(2_654_435_761) >> 22)
        };
        #[expect(clippy::cast_possible_truncation, reason = "rounding to single precision")]
        let bytes: Vec<u8> =
            (k * BLOCK..(k + 1) * BLOCK).flat_map(|i| (value(i) as f32).to_le_bytes()).collect();
        let samples = Samples::new(SampleType::F32, &bytes).ok_or("the last sample is cut")?;
        let (sequence, first) = (u64::from(k), u64::from(k * BLOCK));
        let time_ns = start_ns + i64::from(k) * 100_000_000;
        let block = Block { stream: 0, sequence, first, time_ns, samples };
        // Until there is credit, listen. One block may always be under way.
        while credit == 0
            || !under_way.is_empty()
                && under_way.iter().map(|(_, n)| n).sum::<usize>() + bytes.len() + 64 > credit
        {
            listen(&mut stream, &mut frames, &mut credit, &mut wanted)?;
            under_way.retain(|(sequence, _)| *sequence >= wanted);
        }
        under_way.push((sequence, say(&mut stream, &Message::Block(block))?));
    }
    while wanted < 100 {
        listen(&mut stream, &mut frames, &mut credit, &mut wanted)?;
    }
    say(&mut stream, &Message::Bye(Bye::End))?;
    // The daemon closes when it has taken that in.
    while stream.read(frames.space())? > 0 {}
    Ok(())
}

/// Sends a frame and gives its length.
fn say(stream: &mut TcpStream, message: &Message<'_>) -> Result<usize, Box<dyn Error>> {
    let mut frame = Vec::new();
    wire::encode(message, &mut frame)?;
    stream.write_all(&frame)?;
    Ok(frame.len())
}

/// Waits for what the daemon says: its credit, and the block that it wants next.
fn listen(
    stream: &mut TcpStream,
    frames: &mut Frames,
    credit: &mut usize,
    wanted: &mut u64,
) -> Result<(), Box<dyn Error>> {
    let n = stream.read(frames.space())?;
    if n == 0 {
        return Err("the daemon has closed the connection".into());
    }
    frames.filled(n);
    while let Some((message, _)) = frames.take()? {
        match message {
            Message::Welcome(welcome) => *credit = usize::try_from(welcome.credit_bytes)?,
            Message::Ack(ack) => {
                *credit = usize::try_from(ack.credit_bytes)?;
                *wanted = ack.progress.first().map_or(*wanted, |progress| progress.sequence);
            }
            Message::Problem(problem) => return Err(problem.text.into()),
            Message::Hello(_) | Message::Block(_) | Message::Bye(_) | Message::Ping => {}
        }
    }
    Ok(())
}
