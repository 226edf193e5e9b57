//! What senders of samples say and are told in JSON, and the frames it stands for (docs/wire.md).

use super::finite;
use crate::wire;
use crate::wire::{
    Block, Bye, Channel, ErrorCode, Frames, Hello, Message, NO_TIME, Problem, SampleType, Samples,
};
use serde::{Deserialize, Serialize};

/// Most channels of a sender that speaks JSON.
const MAX_CHANNELS: usize = 100;

/// What a sender says.
#[derive(Debug, Deserialize)]
#[serde(tag = "type", rename_all = "lowercase", deny_unknown_fields)]
enum Said {
    Hello {
        machine: String,
        #[serde(default)]
        token: String,
        #[serde(default)]
        epoch: u64,
        shaft_speed_hz: Option<f64>,
        load: Option<f64>,
        channels: Vec<SaidChannel>,
    },
    Block {
        channel: String,
        sequence: u64,
        first: u64,
        /// RFC 3339.
        time: Option<jiff::Timestamp>,
        /// Null: no number.
        samples: Vec<Option<f64>>,
    },
    Ping {},
    Bye {
        #[serde(default)]
        end: bool,
    },
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SaidChannel {
    name: String,
    rate_hz: f64,
    #[serde(default)]
    unit: String,
    range: Option<[f64; 2]>,
}

/// What a sender is told.
#[derive(Debug, Serialize)]
#[serde(tag = "type", rename_all = "lowercase")]
enum Told<'a> {
    Welcome { credit_bytes: u32, wanted: Vec<ToldPlace<'a>> },
    Ack { credit_bytes: u32, wanted: Vec<ToldPlace<'a>> },
    Error { code: &'a str, text: &'a str },
}

#[derive(Debug, Serialize)]
struct ToldPlace<'a> {
    channel: &'a str,
    sequence: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    first: Option<u64>,
}

/// Speaks JSON with one sender and frames with the daemon.
#[derive(Debug, Default)]
pub struct Translator {
    /// Names of the channels, by stream.
    channels: Vec<String>,
}

impl Translator {
    /// The frame for what the sender says.
    ///
    /// # Errors
    /// What the sender is told if it is none, as JSON.
    pub fn frame(&mut self, text: &str) -> Result<Vec<u8>, String> {
        let wrong = |code: ErrorCode, text: &str| {
            let told = Told::Error { code: code.name(), text };
            serde_json::to_string(&told).unwrap_or_default()
        };
        let said: Said = serde_json::from_str(text)
            .map_err(|error| wrong(ErrorCode::Malformed, &error.to_string()))?;
        let mut frame = Vec::new();
        let encoded = match said {
            Said::Hello { machine, token, epoch, shaft_speed_hz, load, channels } => {
                if channels.len() > MAX_CHANNELS {
                    let text =
                        format!("{} channels; JSON is for {MAX_CHANNELS} at most", channels.len());
                    return Err(wrong(ErrorCode::TooLarge, &text));
                }
                self.channels = channels.iter().map(|channel| channel.name.clone()).collect();
                let channels = channels.into_iter().map(SaidChannel::described).collect();
                let hello = Hello { machine, token, epoch, shaft_speed_hz, load, channels };
                wire::encode(&Message::Hello(hello), &mut frame)
            }
            Said::Block { channel, sequence, first, time, samples } => {
                let stream = self.channels.iter().position(|name| *name == channel);
                let Some(stream) = stream.and_then(|stream| u16::try_from(stream).ok()) else {
                    let text = format!("channel {channel:?} is not in the hello");
                    return Err(wrong(ErrorCode::Unexpected, &text));
                };
                let bytes: Vec<u8> =
                    samples.iter().flat_map(|x| x.unwrap_or(f64::NAN).to_le_bytes()).collect();
                let time = time.and_then(|time| i64::try_from(time.as_nanosecond()).ok());
                let time_ns = time.unwrap_or(NO_TIME);
                let Some(samples) = Samples::new(SampleType::F64, &bytes) else {
                    return Err(wrong(ErrorCode::Malformed, "samples"));
                };
                let block = Block { stream, sequence, first, time_ns, samples };
                wire::encode(&Message::Block(block), &mut frame)
            }
            Said::Ping {} => wire::encode(&Message::Ping, &mut frame),
            Said::Bye { end } => {
                let bye = if end { Bye::End } else { Bye::Pause };
                wire::encode(&Message::Bye(bye), &mut frame)
            }
        };
        encoded.map_err(|error| wrong(error.code(), &error.to_string()))?;
        Ok(frame)
    }

    /// What the sender is told by a frame of the daemon; `None`: it is none.
    #[must_use]
    pub fn text(&self, frame: &[u8]) -> Option<String> {
        let mut frames = Frames::default();
        frames.push(frame);
        let (message, _) = frames.take().ok()??;
        let name = |stream: usize| self.channels.get(stream).map_or("", String::as_str);
        let told = match &message {
            Message::Welcome(welcome) => Told::Welcome {
                credit_bytes: welcome.credit_bytes,
                wanted: (0..)
                    .zip(&welcome.wanted)
                    .map(|(stream, wanted)| ToldPlace {
                        channel: name(stream),
                        sequence: wanted.sequence,
                        first: Some(wanted.index),
                    })
                    .collect(),
            },
            Message::Ack(ack) => Told::Ack {
                credit_bytes: ack.credit_bytes,
                wanted: ack
                    .progress
                    .iter()
                    .map(|progress| ToldPlace {
                        channel: name(usize::from(progress.stream)),
                        sequence: progress.sequence,
                        first: None,
                    })
                    .collect(),
            },
            Message::Problem(Problem { code, text }) => Told::Error { code: code.name(), text },
            Message::Hello(_) | Message::Block(_) | Message::Bye(_) | Message::Ping => return None,
        };
        serde_json::to_string(&told).ok()
    }
}

impl SaidChannel {
    fn described(self) -> Channel {
        let range = self.range.and_then(|[low, high]| finite(low).zip(finite(high)));
        Channel {
            name: self.name,
            rate_hz: self.rate_hz,
            sample_type: SampleType::F64,
            scale: 1.0,
            offset: 0.0,
            zero: 0.0,
            range,
            unit: self.unit,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HELLO: &str =
        r#"{"type":"hello","machine":"m","channels":[{"name":"x","rate_hz":10.0,"unit":"g"}]}"#;

    #[test]
    fn what_is_said_in_json_is_what_frames_say() {
        let mut translator = Translator::default();
        let mut frames = Frames::default();
        frames.push(&translator.frame(HELLO).unwrap());
        let block = r#"{"type":"block","channel":"x","sequence":3,"first":30,"time":"2023-11-14T22:13:20Z","samples":[1.5,null]}"#;
        frames.push(&translator.frame(block).unwrap());
        frames.push(&translator.frame(r#"{"type":"bye","end":true}"#).unwrap());
        let (Message::Hello(hello), _) = frames.take().unwrap().unwrap() else { panic!("hello") };
        assert_eq!((hello.machine.as_str(), hello.channels[0].unit.as_str()), ("m", "g"));
        let (Message::Block(block), _) = frames.take().unwrap().unwrap() else { panic!("block") };
        assert_eq!((block.stream, block.sequence, block.first), (0, 3, 30));
        assert_eq!(block.time_ns, 1_700_000_000_000_000_000);
        let samples: Vec<f64> = block.samples.each().map(|b| f64::from_le_bytes(*b)).collect();
        assert!((samples[0] - 1.5).abs() < 1e-15 && samples[1].is_nan());
        assert_eq!(frames.take().unwrap().unwrap().0, Message::Bye(Bye::End));

        let mut welcome = Vec::new();
        let wanted = vec![wire::Wanted { sequence: 3, index: 30 }];
        let message = Message::Welcome(wire::Welcome { credit_bytes: 9, wanted });
        wire::encode(&message, &mut welcome).unwrap();
        let text = translator.text(&welcome).unwrap();
        let expected = r#"{"type":"welcome","credit_bytes":9,"wanted":[{"channel":"x","sequence":3,"first":30}]}"#;
        assert_eq!(text, expected);
    }

    #[test]
    fn what_cannot_be_understood_is_told_with_its_code() {
        let mut translator = Translator::default();
        for (said, code) in [
            ("{", "malformed"),
            (r#"{"type":"hello"}"#, "malformed"),
            (r#"{"type":"block","channel":"x","sequence":0,"first":0,"samples":[]}"#, "unexpected"),
        ] {
            let told = translator.frame(said).unwrap_err();
            assert!(told.contains(&format!(r#""code":"{code}""#)), "{said}: {told}");
        }
        let channel = r#"{"name":"x","rate_hz":1.0},"#.repeat(101);
        let many = format!(
            r#"{{"type":"hello","machine":"m","channels":[{}]}}"#,
            channel.trim_end_matches(',')
        );
        assert!(translator.frame(&many).unwrap_err().contains("too-large"));
    }
}
