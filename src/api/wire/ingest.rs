//! What senders of samples say and are told in JSON or CBOR, and the frames it stands for (docs/wire.md).

use super::finite;
use crate::api::handles::NotUnderstood;
use crate::ingest::live::Refusal;
use crate::wire;
use crate::wire::{
    Block, Bye, Channel, ErrorCode, Frames, Hello, Message, NO_TIME, Problem, SampleType, Samples,
};
use serde::{Deserialize, Serialize};

/// Most channels of a sender that speaks no frames.
const MAX_CHANNELS: usize = 100;

/// Longest message in CBOR, bytes: the longest block fits, and what a short element becomes in memory is bounded.
const MAX_CBOR_BYTES: usize = 1 << 20;

/// What a sender speaks instead of frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Language {
    /// RFC 8259, in text messages.
    Json,
    /// RFC 8949, in binary messages.
    Cbor,
}

impl Language {
    /// Whether a binary message begins as a map in CBOR, which no frame does.
    #[must_use]
    pub fn is_cbor(message: &[u8]) -> bool {
        message.first().is_some_and(|first| (0xa0..=0xbf).contains(first))
    }

    fn read(self, message: &[u8]) -> Result<Said, Refusal> {
        let malformed = |error: String| Refusal::new(ErrorCode::Malformed, error);
        match self {
            Self::Json => {
                serde_json::from_slice(message).map_err(|error| malformed(error.to_string()))
            }
            Self::Cbor if message.len() > MAX_CBOR_BYTES => {
                let text = format!(
                    "a message of {} bytes; at most {MAX_CBOR_BYTES} are taken in CBOR",
                    message.len()
                );
                Err(Refusal::new(ErrorCode::TooLarge, text))
            }
            Self::Cbor => {
                let mut rest = message;
                let said = ciborium::from_reader(&mut rest)
                    .map_err(|error| malformed(error.to_string()))?;
                if !rest.is_empty() {
                    return Err(malformed(format!("{} bytes behind the message", rest.len())));
                }
                Ok(said)
            }
        }
    }

    fn write(self, told: &Told<'_>) -> Option<Vec<u8>> {
        match self {
            Self::Json => serde_json::to_vec(told).ok(),
            Self::Cbor => {
                let mut bytes = Vec::new();
                ciborium::into_writer(told, &mut bytes).ok()?;
                Some(bytes)
            }
        }
    }
}

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

/// Speaks JSON or CBOR with one sender and frames with the daemon.
#[derive(Debug)]
pub struct Translator {
    language: Language,
    /// Names of the channels, by stream.
    channels: Vec<String>,
}

impl Translator {
    /// For a sender that speaks so.
    #[must_use]
    pub fn new(language: Language) -> Self {
        Self { language, channels: Vec::new() }
    }

    /// What it speaks.
    #[must_use]
    pub fn language(&self) -> Language {
        self.language
    }

    /// The frame for what the sender says.
    ///
    /// # Errors
    /// Why there is none, and how many samples are lost with it.
    pub fn frame(&mut self, message: &[u8]) -> Result<Vec<u8>, NotUnderstood> {
        let lost = |n_samples| move |refusal| NotUnderstood { refusal, n_samples };
        let said = self.language.read(message).map_err(lost(0))?;
        let n_samples = match &said {
            Said::Block { samples, .. } => samples.len() as u64,
            Said::Hello { .. } | Said::Ping {} | Said::Bye { .. } => 0,
        };
        self.understand(said).map_err(lost(n_samples))
    }

    fn understand(&mut self, said: Said) -> Result<Vec<u8>, Refusal> {
        let wrong = |code: ErrorCode, text: &str| Refusal::new(code, text);
        let mut frame = Vec::new();
        let encoded = match said {
            Said::Hello { machine, token, epoch, shaft_speed_hz, load, channels } => {
                if channels.len() > MAX_CHANNELS {
                    let text = format!(
                        "{} channels; JSON and CBOR are for {MAX_CHANNELS} at most",
                        channels.len()
                    );
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
        encoded?;
        Ok(frame)
    }

    /// What the sender is told by a frame of the daemon; `None`: it is none.
    #[must_use]
    pub fn told(&self, frame: &[u8]) -> Option<Vec<u8>> {
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
        self.language.write(&told)
    }
}

impl SaidChannel {
    fn described(self) -> Channel {
        let range = self.range.and_then(|[low, high]| finite(low).zip(finite(high)));
        let described = Channel::new(&self.name, self.rate_hz, SampleType::F64, &self.unit);
        Channel { range, ..described }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HELLO: &str =
        r#"{"type":"hello","machine":"m","channels":[{"name":"x","rate_hz":10.0,"unit":"g"}]}"#;

    /// A message in a language, as JSON says it.
    fn said(language: Language, text: &str) -> Vec<u8> {
        if language == Language::Json {
            return text.as_bytes().to_vec();
        }
        let value: serde_json::Value = serde_json::from_str(text).unwrap();
        let mut bytes = Vec::new();
        ciborium::into_writer(&value, &mut bytes).unwrap();
        bytes
    }

    #[test]
    fn what_is_said_in_json_or_cbor_is_what_frames_say() {
        says_what_frames_say(Language::Json);
        says_what_frames_say(Language::Cbor);
    }

    fn says_what_frames_say(language: Language) {
        let mut translator = Translator::new(language);
        let mut frames = Frames::default();
        assert_eq!(Language::is_cbor(&said(language, HELLO)), language == Language::Cbor);
        frames.push(&translator.frame(&said(language, HELLO)).unwrap());
        let block = r#"{"type":"block","channel":"x","sequence":3,"first":30,"time":"2023-11-14T22:13:20Z","samples":[1.5,null]}"#;
        frames.push(&translator.frame(&said(language, block)).unwrap());
        frames.push(&translator.frame(&said(language, r#"{"type":"bye","end":true}"#)).unwrap());
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
        let told = translator.told(&welcome).unwrap();
        let expected = r#"{"type":"welcome","credit_bytes":9,"wanted":[{"channel":"x","sequence":3,"first":30}]}"#;
        let told: serde_json::Value = match language {
            Language::Json => serde_json::from_slice(&told).unwrap(),
            Language::Cbor => ciborium::from_reader(&told[..]).unwrap(),
        };
        assert_eq!(told, serde_json::from_str::<serde_json::Value>(expected).unwrap());
    }

    #[test]
    fn what_cannot_be_understood_is_told_with_its_code() {
        let mut translator = Translator::new(Language::Json);
        let told = |translator: &mut Translator, said: &[u8]| {
            translator.frame(said).unwrap_err().refusal.code.name()
        };
        let block = r#"{"type":"block","channel":"x","sequence":0,"first":0,"samples":[1,2,3]}"#;
        for (said, code, n_samples) in [
            ("{", "malformed", 0),
            (r#"{"type":"hello"}"#, "malformed", 0),
            (block, "unexpected", 3),
        ] {
            let why = translator.frame(said.as_bytes()).unwrap_err();
            assert_eq!((why.refusal.code.name(), why.n_samples), (code, n_samples), "{said}");
        }
        let channel = r#"{"name":"x","rate_hz":1.0},"#.repeat(101);
        let many = format!(
            r#"{{"type":"hello","machine":"m","channels":[{}]}}"#,
            channel.trim_end_matches(',')
        );
        assert!(told(&mut translator, many.as_bytes()).contains("too-large"));
        // In CBOR: cut off, with something behind it, nested deep, longer than any block, of a length that it has not.
        let mut translator = Translator::new(Language::Cbor);
        let hello = super::tests::said(Language::Cbor, HELLO);
        let behind = [&hello[..], &[0]].concat();
        let deep = [&[0xa1, 0x61, b'x'][..], &[0x81; 100_000]].concat();
        let long = vec![0xbf; MAX_CBOR_BYTES + 1];
        let lying = [0xbb, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff];
        let malformed: [&[u8]; 4] = [&hello[..hello.len() - 1], &behind, &deep, &lying];
        for said in malformed {
            assert!(told(&mut translator, said).contains("malformed"));
        }
        assert!(told(&mut translator, &long).contains("too-large"));
    }
}
