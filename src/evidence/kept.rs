//! What a capture keeps of the windows an alarm rests on, and how it is read back.

use super::EvidenceError;
use super::list;
use super::list::Found;
use super::list::Lists;
use super::settings;
use crate::alarms::Level;
use crate::api::wire::diagnosis::DiagnosisDocument;
use crate::capture::attachment;
use crate::capture::attachment::Attachment;
use crate::capture::received::ReceivedChannel;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::verdict::Diagnosis;
use crate::features::ChannelFeatures;
use crate::pipeline::Carried;
use crate::pipeline::Passed;
use crate::pipeline::Run;
use crate::pipeline::Settings;
use crate::pipeline::SpeedHints;
use crate::signal::ChannelInfo;
use crate::tape::Reader;
use crate::tape::Tape;
use std::path::Path;
use std::sync::Arc;
use toml::Table;

/// Tape of the channels, of the state before the first window, of the baseline.
const CHANNELS: (&str, &str) = ("channel_numbers", "channel_words");
const STATE: (&str, &str) = ("state_numbers", "state_words");
const BASELINE: (&str, &str) = ("baseline_numbers", "baseline_words");

/// Where no samples stand.
const NOWHERE: i64 = -1;

/// A stream as it was judged.
#[derive(Debug, Clone)]
pub struct Judged {
    /// Its channels as they were received.
    pub received: Vec<ReceivedChannel>,
    /// What its blocks meant.
    pub channels: Vec<ChannelInfo>,
    /// What was known of the speed.
    pub hints: SpeedHints,
    /// How windows were laid and judged.
    pub settings: Settings,
}

/// How the samples of a channel were converted.
#[derive(Debug, Clone, PartialEq)]
pub struct Converted {
    /// Name of the channel.
    pub name: String,
    /// Raw value that became sample 0.
    pub raw_zero: f64,
    /// What was left out of the samples.
    pub offset: f64,
    /// Samples at the ends of the source's number range.
    pub full_scale: Option<(f32, f32)>,
}

/// A window as it was kept.
#[derive(Debug, Clone, PartialEq)]
pub struct Window {
    /// Start and end, s of stream time.
    pub time_s: (f64, f64),
    /// Segment of the stream.
    pub segment: u32,
    /// Number of its contiguous run.
    pub run: i64,
    /// By channel: first sample in the file, and what the window was made of.
    pub runs: Vec<Option<(u64, Run)>>,
    /// By channel and name, with their bits, in the order of measurement.
    pub features: Vec<(usize, String, u64)>,
    /// Its verdict as a document.
    pub verdict: String,
    /// What stood above its level after it.
    pub raised: String,
}

/// Everything that was kept.
#[derive(Debug, Clone)]
pub struct Kept {
    /// Who made it, why, and what the alarm says.
    pub about: Table,
    /// How windows were laid and judged; without the baseline.
    pub settings: Settings,
    /// What was known of the speed.
    pub hints: SpeedHints,
    /// In the order of the stream.
    pub channels: Vec<Converted>,
    /// The windows, oldest first.
    pub windows: Vec<Window>,
    /// What the first rests on besides.
    pub before: Carried,
}

/// The newest of the windows of which all samples have a place in the file, without a hole between them.
///
/// `place`: where so many samples of a channel from one on, in a segment, stand in the file.
#[must_use]
pub fn placed<'a>(
    windows: &'a [Arc<Passed>],
    place: &dyn Fn(usize, u32, &Run) -> Option<u64>,
) -> &'a [Arc<Passed>] {
    let is_placed = |window: &&Arc<Passed>| {
        let mut runs = window.runs.iter().enumerate();
        runs.all(|(c, run)| run.is_none_or(|run| place(c, window.segment, &run).is_some()))
    };
    let n = windows.iter().rev().take_while(is_placed).count();
    &windows[windows.len() - n..]
}

/// What a capture keeps of `windows`, which [`placed`] gave; `about`: who makes it and why.
#[must_use]
pub fn lists(
    about: &Table,
    judged: &Judged,
    windows: &[Arc<Passed>],
    place: &dyn Fn(usize, u32, &Run) -> Option<u64>,
) -> Vec<Attachment> {
    let mut lists = Lists::default();
    lists.text("about", about.to_string());
    lists.text("settings", settings::table(&judged.settings, &judged.hints).to_string());
    lists.tape(CHANNELS, channels(judged));
    let times_s = windows.iter().flat_map(|w| [w.time_s.0, w.time_s.1]);
    lists.numbers("window_time_s", times_s.collect());
    let places = windows.iter().flat_map(|w| [i64::from(w.segment), whole(w.run)]);
    lists.counts("window_place", places.collect());
    let origins_s = windows.iter().map(|w| w.origin_s.unwrap_or(f64::NAN));
    lists.numbers("window_origin_s", origins_s.collect());
    let (mut run_place, mut run_time_s) = (Vec::new(), Vec::new());
    for window in windows {
        for (c, run) in window.runs.iter().enumerate() {
            let first = run.and_then(|run| place(c, window.segment, &run));
            let (start, n) = run.map_or((0, 0), |run| (run.start, run.n_samples as u64));
            run_place.extend([first.map_or(NOWHERE, whole), whole(start), whole(n)]);
            run_time_s.push(run.map_or(f64::NAN, |run| run.time_s));
        }
    }
    lists.counts("run_place", run_place);
    lists.numbers("run_time_s", run_time_s);
    features(windows, &mut lists);
    let lines = |texts: Vec<String>| texts.into_iter().map(|text| text + "\n").collect::<String>();
    lists.text("verdicts", lines(windows.iter().map(|w| verdict(&w.diagnosis)).collect()));
    lists.text("raised", lines(windows.iter().map(|w| raised(&w.raised)).collect()));
    let (mut state, mut baseline) = (Tape::default(), Tape::default());
    if let Some(first) = windows.first() {
        first.before.write(&mut state);
        first.before.baseline.write(&mut baseline);
    }
    lists.tape(STATE, state);
    lists.tape(BASELINE, baseline);
    attachment::with_checksum(lists.into_attachments())
}

fn channels(judged: &Judged) -> Tape {
    let mut tape = Tape::default();
    tape.write_count(judged.channels.len());
    for (received, info) in judged.received.iter().zip(&judged.channels) {
        tape.write_word(&info.name);
        tape.write(&[received.raw_zero, info.offset]);
        tape.write_option(info.full_scale.map(|(low, _)| f64::from(low)));
        tape.write_option(info.full_scale.map(|(_, high)| f64::from(high)));
    }
    tape
}

fn features(windows: &[Arc<Passed>], lists: &mut Lists) {
    let mut names: Vec<&str> = Vec::new();
    let mut place_of = std::collections::BTreeMap::new();
    let (mut places, mut values) = (Vec::new(), Vec::new());
    for (w, window) in windows.iter().enumerate() {
        for channel in &window.features {
            for feature in &channel.values {
                let name = *place_of.entry(&*feature.name).or_insert_with(|| {
                    names.push(&feature.name);
                    names.len() - 1
                });
                places.extend([
                    whole(w as u64),
                    whole(channel.channel.0 as u64),
                    whole(name as u64),
                ]);
                values.push(feature.value);
            }
        }
    }
    lists.text("feature_words", list::joined(names.into_iter()));
    lists.counts("feature_place", places);
    lists.numbers("feature_value", values);
}

fn whole(count: u64) -> i64 {
    i64::try_from(count).unwrap_or(i64::MAX)
}

/// A window's verdict as a document on one line. What the stream had lost until then is no part of it.
#[must_use]
pub fn verdict(diagnosis: &Diagnosis) -> String {
    let of_window =
        Diagnosis { samples_rejected: 0, rejected_because: Vec::new(), ..diagnosis.clone() };
    serde_json::to_string(&DiagnosisDocument::new(&of_window, None)).unwrap_or_default()
}

/// What stands above its level, on one line.
#[must_use]
pub fn raised(raised: &[(String, Level)]) -> String {
    let parts = raised.iter().map(|(what, level)| format!("{what} {}", level.name()));
    parts.collect::<Vec<_>>().join("; ").replace(['\n', '\r'], " ")
}

/// By channel and name, with their bits.
#[must_use]
pub fn bits(features: &[ChannelFeatures]) -> Vec<(usize, String, u64)> {
    let of_channel = |channel: &ChannelFeatures| {
        let of_feature = |f: &crate::features::Feature| {
            (channel.channel.0, f.name.to_string(), f.value.to_bits())
        };
        channel.values.iter().map(of_feature).collect::<Vec<_>>()
    };
    features.iter().flat_map(of_channel).collect()
}

/// Reads what a capture keeps; `None`: nothing.
///
/// # Errors
/// When it cannot be read, or contradicts itself.
pub fn read(file: &Path) -> Result<Option<Kept>, EvidenceError> {
    let Some(found) = attachment::read(file, &list::NAMES)? else { return Ok(None) };
    let damaged = |problem: &str| EvidenceError::Damaged {
        file: file.to_owned(),
        problem: problem.to_owned(),
    };
    let found = Found(found);
    let table = |name: &str| found.text(name)?.parse::<Table>().ok();
    let about = table("about").ok_or_else(|| damaged("`about` is no TOML"))?;
    let settings = table("settings").and_then(|table| settings::read(&table));
    let (settings, hints) = settings.ok_or_else(|| damaged("`settings` are incomplete"))?;
    let channels = read_channels(&found).ok_or_else(|| damaged("`channel_*` are incomplete"))?;
    let windows = read_windows(&found, channels.len());
    let windows = windows.ok_or_else(|| damaged("the lists of windows do not fit together"))?;
    let before = if windows.is_empty() { Some(Carried::default()) } else { read_before(&found) };
    let before =
        before.ok_or_else(|| damaged("the state before the first window is incomplete"))?;
    Ok(Some(Kept { about, settings, hints, channels, windows, before }))
}

fn read_before(found: &Found) -> Option<Carried> {
    let (state, baseline) = (found.tape(STATE)?, found.tape(BASELINE)?);
    let (mut state, mut baseline) = (state.reader(), baseline.reader());
    let normal = Baseline::read(&mut baseline).filter(|_| baseline.is_at_end())?;
    Carried::read(&mut state, Arc::new(normal)).filter(|_| state.is_at_end())
}

fn read_channels(found: &Found) -> Option<Vec<Converted>> {
    let tape = found.tape(CHANNELS)?;
    let mut reader = tape.reader();
    let read = |tape: &mut Reader<'_>| {
        let name = tape.word()?.to_owned();
        let [raw_zero, offset] = tape.array()?;
        #[expect(clippy::cast_possible_truncation, reason = "it was a f32")]
        let ends = (tape.option()?.map(|x| x as f32), tape.option()?.map(|x| x as f32));
        Some(Converted { name, raw_zero, offset, full_scale: ends.0.zip(ends.1) })
    };
    reader.list(read).filter(|_| reader.is_at_end())
}

fn read_windows(found: &Found, n_channels: usize) -> Option<Vec<Window>> {
    let times_s = found.numbers("window_time_s")?;
    let places = found.counts("window_place")?;
    let (run_place, run_time_s) = (found.counts("run_place")?, found.numbers("run_time_s")?);
    let n = times_s.len() / 2;
    let fits = times_s.len() == 2 * n
        && places.len() == 2 * n
        && run_time_s.len() == n * n_channels
        && run_place.len() == 3 * n * n_channels;
    let (verdicts, raised) = (found.text("verdicts")?, found.text("raised")?);
    let (mut verdicts, mut raised) =
        (verdicts.split_terminator('\n'), raised.split_terminator('\n'));
    if !fits {
        return None;
    }
    let mut windows = Vec::new();
    for w in 0..n {
        let mut runs = Vec::new();
        for c in w * n_channels..(w + 1) * n_channels {
            let [first, start, n_samples] =
                [run_place[3 * c], run_place[3 * c + 1], run_place[3 * c + 2]];
            let run = Run {
                start: u64::try_from(start).ok()?,
                time_s: run_time_s[c],
                n_samples: usize::try_from(n_samples).ok()?,
            };
            runs.push(if first == NOWHERE {
                None
            } else {
                Some((u64::try_from(first).ok()?, run))
            });
        }
        windows.push(Window {
            time_s: (times_s[2 * w], times_s[2 * w + 1]),
            segment: u32::try_from(places[2 * w]).ok()?,
            run: places[2 * w + 1],
            runs,
            features: Vec::new(),
            verdict: verdicts.next()?.to_owned(),
            raised: raised.next()?.to_owned(),
        });
    }
    read_features(found, &mut windows)?;
    Some(windows)
}

fn read_features(found: &Found, windows: &mut [Window]) -> Option<()> {
    let names = list::split(found.text("feature_words")?);
    let (places, values) = (found.counts("feature_place")?, found.numbers("feature_value")?);
    if places.len() != 3 * values.len() {
        return None;
    }
    for (place, value) in places.chunks_exact(3).zip(values) {
        let at = |i: usize| usize::try_from(place[i]).ok();
        let (window, name) = (windows.get_mut(at(0)?)?, names.get(at(2)?)?);
        window.features.push((at(1)?, name.clone(), value.to_bits()));
    }
    Some(())
}
