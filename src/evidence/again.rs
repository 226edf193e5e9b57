//! Judges the windows that a capture keeps again: from its samples, its machine text and its settings alone. Only the
//! outcome is held against what was kept.

use super::EvidenceError;
use super::kept;
use super::kept::Kept;
use crate::capture::hints::Hints;
use crate::capture::live::LiveChannel;
use crate::capture::reader::CaptureReader;
use crate::capture::received::ReceivedChannel;
use crate::diagnosis::verdict::Diagnosis;
use crate::features;
use crate::features::ChannelWindow;
use crate::machine::Machine;
use crate::machine::file as machine_file;
use crate::pipeline::Monitor;
use crate::pipeline::Outcome;
use crate::pipeline::Settings;
use crate::signal::ChannelInfo;
use std::path::Path;
use std::sync::Arc;
use toml::Table;

/// Differences named of a window, at most.
const MAX_NAMED: usize = 5;

/// A window judged again.
#[derive(Debug, Clone, PartialEq)]
pub struct Compared {
    /// Start and end, s of stream time.
    pub time_s: (f64, f64),
    /// Features held against each other.
    pub n_features: usize,
    /// Features whose bits differ, or that one side lacks.
    pub n_different: usize,
    /// In what the window differs, for people; empty: in nothing.
    pub differences: Vec<String>,
}

impl Compared {
    /// Whether features, verdict and levels are the same bit by bit.
    #[must_use]
    pub fn is_equal(&self) -> bool {
        self.differences.is_empty()
    }
}

/// All windows judged again.
#[derive(Debug, Clone)]
pub struct Again {
    /// Who made the capture and why.
    pub about: Table,
    /// The windows, oldest first.
    pub windows: Vec<Compared>,
    /// The verdict on the newest; `None`: none is kept.
    pub diagnosis: Option<Diagnosis>,
    /// What stands above its level after it.
    pub raised: String,
    /// The verdict of then on the newest, as a document; `None`: none is kept.
    pub then: Option<String>,
}

impl Again {
    /// Whether all windows are the same.
    #[must_use]
    pub fn is_equal(&self) -> bool {
        self.windows.iter().all(Compared::is_equal)
    }

    /// Why bits may differ: another program or processor made it; `None`: neither.
    #[must_use]
    pub fn made_elsewhere(&self) -> Option<String> {
        let text =
            |key: &str| self.about.get(key).and_then(toml::Value::as_str).unwrap_or("unknown");
        let (version, processor) = (text("version"), text("processor"));
        let (here, this) = (env!("CARGO_PKG_VERSION"), super::processor());
        (version != here || processor != this).then(|| {
            format!(
                "it was made by version {version} on {processor}, this is version {here} on {this}: bits may differ"
            )
        })
    }
}

/// The baseline that a capture keeps, to judge the whole capture against; `None`: it keeps none.
///
/// # Errors
/// As [`judge`].
pub fn baseline(
    file: &Path,
) -> Result<Option<crate::diagnosis::baseline::Baseline>, EvidenceError> {
    let kept = kept::read(file)?;
    let baseline = kept.map(|kept| kept.before.baseline.as_ref().clone());
    Ok(baseline.filter(|baseline| !baseline.records.is_empty()))
}

/// Judges the windows again that a capture keeps; `None`: it keeps none.
///
/// # Errors
/// When the capture cannot be read, or what it keeps contradicts itself.
pub fn judge(file: &Path) -> Result<Option<Again>, EvidenceError> {
    let Some(kept) = kept::read(file)? else { return Ok(None) };
    let damaged = |problem: String| EvidenceError::Damaged { file: file.to_owned(), problem };
    let plain = CaptureReader::open(file, None, &Hints::default())?;
    let text = plain.info().machine.clone();
    let text = text.ok_or_else(|| damaged("the machine's description is not there".to_owned()))?;
    let name = format!("{} (attribute `machine`)", file.display());
    let machine = machine_file::parse(&text, &name)
        .map_err(|source| EvidenceError::Machine { file: file.to_owned(), source })?;
    let machine = Arc::new(machine);
    let stream = Stream::read(file, &machine, &kept)?;
    // No ring is filled: windows are made of what is in the file.
    let settings = Settings { window_s: 0.0, hop_s: 0.0, ring_s: 0.0, ..kept.settings.clone() };
    let mut monitor =
        Monitor::new(Arc::clone(&machine), stream.channels.clone(), kept.hints, &settings)
            .map_err(|source| EvidenceError::Monitor { file: file.to_owned(), source })?;
    if !monitor.resume(&kept.before) && !kept.windows.is_empty() {
        return Err(damaged("the state before the first window is of another machine".to_owned()));
    }
    let mut windows: Vec<Compared> = Vec::new();
    let mut newest = None;
    for (i, window) in kept.windows.iter().enumerate() {
        let samples = stream.window(window).ok_or_else(|| {
            damaged(format!("the samples of the window at {:.3} s are not there", window.time_s.0))
        })?;
        let is_same_run = i == 0 || kept.windows[i - 1].run == window.run;
        let outcome = monitor.judge_again(&samples, window.segment, is_same_run);
        let raised = kept::raised(&monitor.alarms().raised());
        windows.push(compared(window, &outcome, &raised));
        newest = Some((Diagnosis::clone(&outcome.diagnosis), raised));
    }
    let (diagnosis, raised) = newest.unzip();
    let raised = raised.unwrap_or_default();
    let then = kept.windows.last().map(|window| window.verdict.clone());
    Ok(Some(Again { about: kept.about, windows, diagnosis, raised, then }))
}

fn compared(window: &kept::Window, outcome: &Outcome, raised: &str) -> Compared {
    let found = kept::bits(&outcome.features);
    let mut differences: Vec<String> = Vec::new();
    let mut n_different = window.features.len().abs_diff(found.len());
    for (then, now) in window.features.iter().zip(&found) {
        if then == now {
            continue;
        }
        n_different += 1;
        if differences.len() < MAX_NAMED {
            let of = |(_, name, bits): &(usize, String, u64)| {
                format!("{name} = {:?}", f64::from_bits(*bits))
            };
            differences.push(format!("feature {} then, {} now", of(then), of(now)));
        }
    }
    if window.features.len() != found.len() {
        let (then, now) = (window.features.len(), found.len());
        differences.push(format!("{then} features then, {now} now"));
    }
    if window.verdict != kept::verdict(&outcome.diagnosis) {
        differences.push("the verdict".to_owned());
    }
    if window.raised != raised {
        differences.push(format!("above their level then: {:?}, now: {raised:?}", window.raised));
    }
    let n_features = window.features.len().max(found.len());
    Compared { time_s: window.time_s, n_features, n_different, differences }
}

/// The channels of the stream as they were judged, with their samples in the file.
struct Stream {
    channels: Vec<ChannelInfo>,
    samples: Vec<Vec<f32>>,
}

impl Stream {
    /// Reads every sample that a window needs and converts it as it was converted then.
    fn read(file: &Path, machine: &Machine, kept: &Kept) -> Result<Self, EvidenceError> {
        let damaged = |problem: String| EvidenceError::Damaged { file: file.to_owned(), problem };
        let mut reader = CaptureReader::open(file, Some(machine), &Hints::default())?;
        reader.keep_received();
        let described = reader.info().channels.clone();
        let (mut live, mut channels, mut place) =
            (Vec::new(), Vec::new(), vec![None; described.len()]);
        for (c, converted) in kept.channels.iter().enumerate() {
            let at = described.iter().position(|found| found.info.name == converted.name);
            let at =
                at.ok_or_else(|| damaged(format!("channel {} is not there", converted.name)))?;
            let found = &described[at];
            let received = ReceivedChannel {
                name: converted.name.clone(),
                sample_rate: found.info.sample_rate,
                number_type: found.number_type,
                scale: found.scale,
                offset: found.offset,
                raw_zero: converted.raw_zero,
                unit: found.unit_text.clone(),
                sensor: None,
            };
            let made = LiveChannel::new(&received, machine);
            let (channel, info) =
                made.ok_or_else(|| damaged(format!("channel {} has no scale", converted.name)))?;
            channels.push(ChannelInfo {
                offset: converted.offset,
                full_scale: converted.full_scale,
                ..info
            });
            live.push(channel);
            place[at] = Some(c);
        }
        let needed = |c: usize| {
            let ends = kept.windows.iter().filter_map(|w| {
                let (first, run) = w.runs.get(c).copied().flatten()?;
                Some(first.saturating_add(run.n_samples as u64))
            });
            ends.max().unwrap_or(0)
        };
        let needed: Vec<u64> = (0..channels.len()).map(needed).collect();
        let mut samples: Vec<Vec<f32>> = vec![Vec::new(); channels.len()];
        while reader.next_block()?.is_some() {
            while let Some(run) = reader.next_received() {
                let Some(c) = place[run.channel.0] else { continue };
                if (samples[c].len() as u64) < needed[c] {
                    samples[c].extend(live[c].samples(run.raw));
                }
            }
            if (0..channels.len()).all(|c| samples[c].len() as u64 >= needed[c]) {
                break;
            }
        }
        Ok(Self { channels, samples })
    }

    /// The samples of a window; `None`: they are not there.
    fn window(&self, window: &kept::Window) -> Option<features::Window<'_>> {
        let mut channels = Vec::new();
        for (run, samples) in window.runs.iter().zip(&self.samples) {
            channels.push(match run {
                None => None,
                Some((first, run)) => {
                    let first = usize::try_from(*first).ok()?;
                    let samples = samples.get(first..first.checked_add(run.n_samples)?)?;
                    let is_finite = samples.iter().all(|x| x.is_finite());
                    is_finite.then_some(())?;
                    Some(ChannelWindow { start: run.start, time_s: run.time_s, samples })
                }
            });
        }
        let length_s = window.time_s.1 - window.time_s.0;
        let is_span = length_s > 0.0 && length_s.is_finite();
        is_span.then_some(features::Window { time_s: window.time_s, channels })
    }
}
