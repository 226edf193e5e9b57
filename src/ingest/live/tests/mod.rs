//! Every sample is accounted for and lies where it belongs, whatever a network does to blocks.

mod samples;
mod senders;
mod sessions;

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
    Channel::new(name, RATE_HZ, sample_type, "m/s^2")
}

fn hello(epoch: u64, channels: Vec<Channel>) -> Hello {
    Hello::new("rig-1", epoch, channels)
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
