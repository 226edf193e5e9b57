//! What a sender may say: the rules of a hello and of a block that need nothing but what is said. Must not know who else sends.

use super::Refusal;
use super::intake::Arrived;
use super::lane::Lane;
use crate::machine::Machine;
use crate::signal::Timestamp;
use crate::wire;
use crate::wire::ErrorCode;
use std::collections::BTreeSet;

/// What a time may be ahead of the daemon's clock, s.
pub(super) const AHEAD_S: f64 = 10.0;

/// Longest stretch of one block, s.
const BLOCK_S: f64 = 600.0;

/// What the time of an index may run ahead of the clock besides, as a part of the time since the epoch's begin: clocks
/// drift, and a rate may be stated a little wrong.
const AHEAD_PART: f64 = 0.05;

/// Bounds of a speed or load that is believed.
const PLAUSIBLE: f64 = 1e9;

/// What can be said of a hello by itself: its channels as lanes.
pub(super) fn check(hello: &wire::Hello, machine: &Machine) -> Result<Vec<Lane>, Refusal> {
    let bad = |text: String| Refusal::new(ErrorCode::BadChannel, text);
    if hello.channels.is_empty() {
        return Err(bad("the hello names no channel".to_owned()));
    }
    let mut names = BTreeSet::new();
    if let Some(twice) = hello.channels.iter().find(|channel| !names.insert(&channel.name)) {
        return Err(bad(format!("channel {:?} is named twice", twice.name)));
    }
    let is_wild = |number: Option<f64>| number.is_some_and(|x| x.is_nan() || x.abs() > PLAUSIBLE);
    let is_turning = hello.shaft_speed_hz.is_none_or(|speed| speed > 0.0);
    if is_wild(hello.shaft_speed_hz) || is_wild(hello.load) || !is_turning {
        return Err(bad(
            "the shaft's speed is not above 0, or speed or load is no usable number".to_owned()
        ));
    }
    hello.channels.iter().map(|channel| Lane::new(channel, machine)).collect()
}

/// Whether a block is short enough: all windows that it completes are judged at once.
pub(super) fn check_span(lane: &Lane, n_samples: usize) -> Result<(), Refusal> {
    let span_s = n_samples.saturating_sub(1) as f64 / lane.described.rate_hz;
    if span_s <= BLOCK_S {
        return Ok(());
    }
    let text = format!(
        "channel {:?}: a block spans {span_s:.0} s, at most {BLOCK_S} s are taken: send shorter ones",
        lane.described.name
    );
    Err(Refusal::new(ErrorCode::TooLarge, text))
}

/// Whether a time lies in the future.
///
/// # Errors
/// When it does.
pub fn check_ahead(at: Timestamp, now: Arrived) -> Result<(), Refusal> {
    // As f64: both are 64 bits wide, their difference is not.
    let by_s = (i128::from(at.0) - i128::from(now.0.0)) as f64 / 1e9;
    if by_s <= AHEAD_S {
        return Ok(());
    }
    let text = format!("a time lies {by_s:.1} s after the daemon's clock: set the sender's clock");
    Err(Refusal::new(ErrorCode::TimeAhead, text))
}

/// Whether a block lies in the future, by its time or by the place of its first sample.
pub(super) fn check_time(
    lane: &Lane,
    first: u64,
    (wall_s, now_s): (f64, f64),
) -> Result<(), Refusal> {
    let ahead = |what: String, by_s: f64| {
        let name = &lane.described.name;
        let text = format!("channel {name:?}: {what} lies {by_s:.1} s after the daemon's clock");
        Err(Refusal::new(ErrorCode::TimeAhead, text))
    };
    if wall_s > now_s + AHEAD_S {
        let what = "set the sender's clock: the time of a block".to_owned();
        return ahead(what, wall_s - now_s);
    }
    match lane.expected_s(first) {
        Some((index_s, first_s))
            if index_s > now_s + AHEAD_S + AHEAD_PART * (now_s - first_s).max(0.0) =>
        {
            let rate_hz = lane.described.rate_hz;
            let what = format!("is the rate of {rate_hz} Hz right? By it sample {first}");
            ahead(what, index_s - now_s)
        }
        Some(_) | None => Ok(()),
    }
}

pub(super) fn no_stream(block: &wire::Block<'_>) -> Refusal {
    let text = format!("a block of stream {}, which is not in the hello", block.stream);
    Refusal::new(ErrorCode::Unexpected, text)
}
