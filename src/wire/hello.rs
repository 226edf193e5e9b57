//! The first frame: who sends what.

use super::block::SampleType;
use super::cursor::{Cursor, at_most, put_count, put_text};
use super::{MAX_CHANNELS, MAX_NAME_BYTES, MAX_TOKEN_BYTES, MAX_UNIT_BYTES, WireError};
use std::fmt;

/// Who sends, and what.
#[derive(Clone, PartialEq)]
pub struct Hello {
    /// Id of the machine.
    pub machine: String,
    /// Access token; empty: none.
    pub token: String,
    /// Tells this stream from others of the sender: with the same one its sequences and indices go on, with another
    /// they begin anew.
    pub epoch: u64,
    /// Speed of the machine's first shaft, if the sender knows it, Hz.
    pub shaft_speed_hz: Option<f64>,
    /// Load, if the sender knows it, in the unit of the machine's load sensor.
    pub load: Option<f64>,
    /// The channels; blocks refer to the place in this list.
    pub channels: Vec<Channel>,
}

/// Without the token.
impl fmt::Debug for Hello {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Hello")
            .field("machine", &self.machine)
            .field("epoch", &self.epoch)
            .field("channels", &self.channels)
            .finish_non_exhaustive()
    }
}

/// A channel as its sender describes it.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Name, as in the machine file.
    pub name: String,
    /// Samples a second.
    pub rate_hz: f64,
    /// What each sample is.
    pub sample_type: SampleType,
    /// physical = raw·scale + offset, in `unit`.
    pub scale: f64,
    /// See `scale`.
    pub offset: f64,
    /// Raw value that is taken out before samples become single precision, near the mean of a signal on a large
    /// constant; 0 for all others.
    pub zero: f64,
    /// Lowest and highest raw value that the converter gives; `None`: those of the sample type, of floats none.
    pub range: Option<(f64, f64)>,
    /// Unit as machine files spell it; empty: unknown.
    pub unit: String,
}

impl Hello {
    /// Of a machine, without a token, speed and load.
    #[must_use]
    pub fn new(machine: &str, epoch: u64, channels: Vec<Channel>) -> Self {
        let (machine, token) = (machine.to_owned(), String::new());
        Self { machine, token, epoch, shaft_speed_hz: None, load: None, channels }
    }
}

impl Channel {
    /// Whose raw values are physical ones, over all that their type can hold.
    #[must_use]
    pub fn new(name: &str, rate_hz: f64, sample_type: SampleType, unit: &str) -> Self {
        let (name, unit) = (name.to_owned(), unit.to_owned());
        Self { name, rate_hz, sample_type, scale: 1.0, offset: 0.0, zero: 0.0, range: None, unit }
    }
}

/// A number that may be unknown travels as NaN.
fn put_known(out: &mut Vec<u8>, number: Option<f64>) {
    out.extend_from_slice(&number.unwrap_or(f64::NAN).to_le_bytes());
}

fn known(number: f64) -> Option<f64> {
    (!number.is_nan()).then_some(number)
}

impl Hello {
    pub(super) fn write(&self, out: &mut Vec<u8>) -> Result<(), WireError> {
        put_text(out, "the machine's id", &self.machine, MAX_NAME_BYTES)?;
        put_text(out, "the token", &self.token, MAX_TOKEN_BYTES)?;
        out.extend_from_slice(&self.epoch.to_le_bytes());
        put_known(out, self.shaft_speed_hz);
        put_known(out, self.load);
        put_count(out, "channels", self.channels.len(), MAX_CHANNELS)?;
        for channel in &self.channels {
            put_text(out, "a channel's name", &channel.name, MAX_NAME_BYTES)?;
            out.extend_from_slice(&channel.rate_hz.to_le_bytes());
            out.push(channel.sample_type.number());
            out.extend_from_slice(&channel.scale.to_le_bytes());
            out.extend_from_slice(&channel.offset.to_le_bytes());
            out.extend_from_slice(&channel.zero.to_le_bytes());
            put_known(out, channel.range.map(|(low, _)| low));
            put_known(out, channel.range.map(|(_, high)| high));
            put_text(out, "a channel's unit", &channel.unit, MAX_UNIT_BYTES)?;
        }
        Ok(())
    }

    pub(super) fn read(mut from: Cursor<'_>) -> Result<Self, WireError> {
        let machine = from.text("the machine's id", MAX_NAME_BYTES)?;
        let token = from.text("the token", MAX_TOKEN_BYTES)?;
        let epoch = from.u64("the epoch")?;
        let shaft_speed_hz = known(from.f64("the shaft's speed")?);
        let load = known(from.f64("the load")?);
        let n = usize::from(from.u16("the number of channels")?);
        at_most("channels", n as u64, MAX_CHANNELS as u64)?;
        // Grows with what is there, not with what is declared.
        let mut channels = Vec::new();
        for _ in 0..n {
            channels.push(Channel::read(&mut from)?);
        }
        from.end()?;
        Ok(Self { machine, token, epoch, shaft_speed_hz, load, channels })
    }
}

impl Channel {
    fn read(from: &mut Cursor<'_>) -> Result<Self, WireError> {
        let name = from.text("a channel's name", MAX_NAME_BYTES)?;
        let rate_hz = from.f64("a channel's rate")?;
        let sample_type = SampleType::read(from)?;
        let scale = from.f64("a channel's scale")?;
        let offset = from.f64("a channel's offset")?;
        let zero = from.f64("a channel's zero")?;
        let low = known(from.f64("a channel's range")?);
        let high = known(from.f64("a channel's range")?);
        let unit = from.text("a channel's unit", MAX_UNIT_BYTES)?;
        Ok(Self { name, rate_hz, sample_type, scale, offset, zero, range: low.zip(high), unit })
    }
}
