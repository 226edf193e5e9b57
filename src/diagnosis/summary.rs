//! From component verdicts to the document: the whole state, and several windows made one.
//!
//! A capture of several segments has the state of its last 5 % of segments (at least 3), one of a
//! single segment that of its last 5 % of windows (at least 3): a component is accused when more than half of them accuse it, or the newest three all do;
//! where half of them do it is left open.

use super::Context;
use super::baseline::OperatingPoint;
use super::baseline::Unfit;
use super::fault::ComponentKind;
use super::fault::FaultMode;
use super::fault::State;
use super::sensor;
use super::verdict::BaselineUse;
use super::verdict::ComponentDiagnosis;
use super::verdict::Coverage;
use super::verdict::DataQuality;
use super::verdict::Diagnosis;
use super::verdict::OperatingState;
use super::verdict::Timeline;
use crate::features::WindowFeatures;
use crate::features::sensor::SensorReading;
use crate::features::speed::SpeedSource;
use crate::units::Hz;
use std::collections::BTreeMap;

/// Part of a capture's windows that gives its state, and the fewest of them.
const LAST_PART: f64 = 0.05;
const FEWEST_WINDOWS: usize = 3;

/// An accusation must persist over this many windows to date the first warning, unless the whole is judged so for fewer.
const PERSISTENCE: usize = 3;

/// One window, judged.
#[derive(Debug, Clone)]
pub struct Judged {
    /// Start and end, s of stream time.
    pub time_s: (f64, f64),
    /// Segment of the stream it lies in.
    pub segment: u32,
    /// Verdicts.
    pub components: Vec<ComponentDiagnosis>,
    /// Speed of the first shaft.
    pub speed: Option<Hz>,
    /// Load, in the unit of the machine's load sensor.
    pub load: Option<f64>,
    /// Its source.
    pub speed_source: Option<SpeedSource>,
    /// 0…1.
    pub speed_confidence: f64,
    /// Speeds of all shafts.
    pub shaft_speeds: Vec<(String, Hz)>,
    /// Whether the machine ran.
    pub operating_state: OperatingState,
    /// Sensor health.
    pub data_quality: DataQuality,
    /// Ranges used by channel.
    pub sample_ranges: Vec<(String, u64, u64)>,
    /// Channel and index of samples among them that were set aside, because they are no motion: nothing rests on them.
    pub set_aside: Vec<(String, u64)>,
    /// Notes on the speed.
    pub notes: Vec<String>,
    /// Baselines offered at this window's speed.
    pub baselines: Vec<BaselineUse>,
}

impl Judged {
    /// Its operating state.
    #[must_use]
    pub fn point(&self) -> OperatingPoint {
        OperatingPoint { speed: self.speed, load: self.load }
    }

    /// Why no baseline is learned from this window; `None`: one can be.
    #[must_use]
    pub fn unfit_for_baseline(&self) -> Option<Unfit> {
        match (self.operating_state, self.data_quality) {
            (OperatingState::Stopped, _) => Some(Unfit::Stopped),
            (OperatingState::Transient, _) => Some(Unfit::Transient),
            (OperatingState::Running | OperatingState::Unknown, DataQuality::Bad) => {
                Some(Unfit::NoSensor)
            }
            (
                OperatingState::Running | OperatingState::Unknown,
                DataQuality::Ok | DataQuality::Degraded,
            ) => None,
        }
    }
}

/// Judges a window.
#[must_use]
pub fn judge_window(
    features: &WindowFeatures,
    segment: u32,
    context: &Context<'_>,
    baselines: Vec<BaselineUse>,
) -> Judged {
    let operating_state = operating_state(features, context);
    let mut components = super::assess(features, context);
    let blocked = match operating_state {
        OperatingState::Stopped => Some("not running".to_owned()),
        OperatingState::Transient => Some(features.speed.change()),
        OperatingState::Running | OperatingState::Unknown => None,
    };
    if let Some(why) = blocked {
        let is_blocked = |c: &&mut ComponentDiagnosis| match c.kind {
            ComponentKind::Sensor => false,
            // Their lines were read at equal angles, against the noise beside them.
            ComponentKind::Bearing => {
                operating_state == OperatingState::Stopped || !features.speed.is_evened
            }
            // By the vectors of the run, which want a changing speed.
            ComponentKind::Shaft => operating_state == OperatingState::Stopped,
            ComponentKind::Gear | ComponentKind::Machine => true,
        };
        for component in components.iter_mut().filter(is_blocked) {
            make_undetermined(component, &why);
        }
    }
    let shaft_speeds = context
        .machine
        .shafts
        .iter()
        .filter_map(|s| Some((s.id.clone(), Hz(features.speed.first?.0 * s.ratio_to_first?))))
        .collect();
    Judged {
        time_s: features.time_s,
        segment,
        components,
        speed: features.speed.first,
        load: features.load,
        speed_source: features.speed.source,
        speed_confidence: features.speed.confidence,
        shaft_speeds,
        operating_state,
        data_quality: sensor::data_quality(features),
        sample_ranges: features
            .sensors
            .iter()
            .filter(|s| s.absent.is_none())
            .map(|s| {
                (context.channel_name(s.channel).to_owned(), s.sample_range.0, s.sample_range.1)
            })
            .collect(),
        set_aside: set_aside(features, context),
        notes: notes(features, context),
        baselines,
    }
}

/// Channel and index of samples that are no motion.
fn set_aside(features: &WindowFeatures, context: &Context<'_>) -> Vec<(String, u64)> {
    let of = |reading: &SensorReading| {
        let channel = context.channel_name(reading.channel).to_owned();
        reading.lost.iter().map(move |at| (channel.clone(), *at)).collect::<Vec<_>>()
    };
    features.sensors.iter().flat_map(of).collect()
}

/// What the user should know of the window: of its speed, of what the sensors may receive besides the machine.
fn notes(features: &WindowFeatures, context: &Context<'_>) -> Vec<String> {
    let mut of_sensors: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for reading in &features.sensors {
        for doubt in &reading.doubts {
            of_sensors.entry(doubt).or_default().push(context.channel_name(reading.channel));
        }
    }
    let of_sensors =
        of_sensors.into_iter().map(|(doubt, of)| format!("{}: {doubt}", of.join(", ")));
    features.speed.notes.iter().cloned().chain(of_sensors).collect()
}

fn make_undetermined(component: &mut ComponentDiagnosis, why: &str) {
    component.state = State::Undetermined;
    component.fault = None;
    component.severity = None;
    component.confidence = None;
    component.other_faults.clear();
    component.gear = None;
    component.why = why.to_owned();
}

fn operating_state(features: &WindowFeatures, context: &Context<'_>) -> OperatingState {
    let Some(first) = features.speed.first else { return OperatingState::Unknown };
    let still = context.machine.shafts.iter().any(|s| {
        let speed = s.ratio_to_first.map(|r| r * first.0);
        matches!((speed, s.running_above), (Some(v), Some(limit)) if v <= limit.0)
    });
    if first.0 <= 0.0 || still {
        OperatingState::Stopped
    } else if features.speed.is_transient() {
        OperatingState::Transient
    } else {
        OperatingState::Running
    }
}

/// Makes the document of a stretch of windows, oldest first; `None` when there are none.
///
/// What only the stream knows (counts, unit conflicts, absent channels) is left empty.
#[must_use]
pub fn conclude(machine: &str, windows: &[Judged]) -> Option<Diagnosis> {
    let newest = windows.last()?;
    let last = match newest.operating_state {
        // What ran before says nothing of a machine that stands still.
        OperatingState::Stopped => std::slice::from_ref(newest),
        OperatingState::Running | OperatingState::Transient | OperatingState::Unknown => {
            last_part(windows)
        }
    };
    let mut diagnosis = of_window(machine, newest);
    diagnosis.components = merge_components(last);
    diagnosis.state = whole_state(&diagnosis.components);
    diagnosis.coverage = coverage(&diagnosis.components);
    diagnosis.warnings = windows.iter().flat_map(|w| w.notes.clone()).collect();
    diagnosis.warnings.sort();
    diagnosis.warnings.dedup();
    diagnosis.duration_s = covered_s(windows);
    diagnosis.samples_used = samples_used(windows);
    diagnosis.data_quality = last.iter().map(|w| w.data_quality).max().unwrap_or(DataQuality::Bad);
    diagnosis.timeline = (windows.len() > 1).then(|| timeline(windows));
    diagnosis.first_warning_s = first_since(windows, State::Warning, diagnosis.state);
    diagnosis.first_damaged_s = first_since(windows, State::Damaged, diagnosis.state);
    Some(diagnosis)
}

/// The windows of the last 5 % of segments, at least 3; of the last 5 % of windows where there is one
/// segment only.
fn last_part(windows: &[Judged]) -> &[Judged] {
    let mut segments: Vec<u32> = windows.iter().map(|w| w.segment).collect();
    segments.dedup();
    let several = segments.len() > 1;
    let n = if several { segments.len() } else { windows.len() };
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a small part of a length"
    )]
    let n_last = ((n as f64 * LAST_PART).ceil() as usize).max(FEWEST_WINDOWS).min(n);
    let n_windows = if several {
        let first = segments[n - n_last];
        windows.iter().rev().take_while(|w| w.segment >= first).count()
    } else {
        n_last
    };
    &windows[windows.len() - n_windows..]
}

/// Stream time covered, each second once though windows may overlap.
fn covered_s(windows: &[Judged]) -> f64 {
    let mut reached = f64::NEG_INFINITY;
    let mut total = 0.0;
    for (start, end) in windows.iter().map(|w| w.time_s) {
        total += (end - start.max(reached)).max(0.0);
        reached = reached.max(end);
    }
    total
}

/// Makes the document of one window.
#[must_use]
pub fn of_window(machine: &str, window: &Judged) -> Diagnosis {
    let since =
        |level: State| (whole_state(&window.components) >= level).then_some(window.time_s.0);
    Diagnosis {
        machine: machine.to_owned(),
        duration_s: window.time_s.1 - window.time_s.0,
        samples_used: samples_used([window]),
        samples_rejected: 0,
        rejected_because: Vec::new(),
        shaft_speed: window.speed,
        shaft_speeds: window.shaft_speeds.clone(),
        speed_source: window.speed_source,
        speed_confidence: window.speed_confidence,
        operating_state: window.operating_state,
        state: whole_state(&window.components),
        coverage: coverage(&window.components),
        data_quality: window.data_quality,
        components: window.components.clone(),
        warnings: window.notes.clone(),
        notes: Vec::new(),
        baselines: window.baselines.clone(),
        provisional_baseline: None,
        timeline: None,
        first_warning_s: since(State::Warning),
        first_damaged_s: since(State::Damaged),
        sample_ranges: window.sample_ranges.clone(),
    }
}

/// Samples used by windows in their order, each counted once though windows may overlap, without those set aside.
pub fn samples_used<'a>(windows: impl IntoIterator<Item = &'a Judged>) -> u64 {
    let (total, set_aside) = samples_in(windows);
    total.saturating_sub(set_aside)
}

/// Counts samples that windows set aside, each once though windows may overlap.
#[derive(Debug, Default)]
pub struct SetAsideCount {
    /// Of each channel one past the last that was counted.
    until: BTreeMap<String, u64>,
}

impl SetAsideCount {
    /// How many samples a window sets aside that none before it has; windows come in their order.
    pub fn count_new(&mut self, window: &Judged) -> u64 {
        let mut n = 0;
        for (channel, at) in &window.set_aside {
            let until = self.until.entry(channel.clone()).or_insert(0);
            n += u64::from(*at >= *until);
            *until = (*until).max(at + 1);
        }
        n
    }
}

/// Samples in windows in their order, and those of them that were set aside, each counted once though windows may overlap.
pub fn samples_in<'a>(windows: impl IntoIterator<Item = &'a Judged>) -> (u64, u64) {
    let mut reached: BTreeMap<&str, u64> = BTreeMap::new();
    let mut counted = SetAsideCount::default();
    let (mut total, mut set_aside) = (0, 0);
    for window in windows {
        set_aside += counted.count_new(window);
        for (channel, start, end) in &window.sample_ranges {
            let from = reached.entry(channel.as_str()).or_insert(0);
            total += end.saturating_sub((*start).max(*from));
            *from = (*from).max(*end);
        }
    }
    (total, set_aside)
}

/// One verdict a component from the verdicts of several windows.
fn merge_components(windows: &[Judged]) -> Vec<ComponentDiagnosis> {
    let Some(newest) = windows.last() else { return Vec::new() };
    let mut keys: Vec<(ComponentKind, &str)> =
        newest.components.iter().map(|c| (c.kind, c.id.as_str())).collect();
    for component in windows.iter().flat_map(|w| &w.components) {
        if !keys.contains(&(component.kind, component.id.as_str())) {
            keys.push((component.kind, component.id.as_str()));
        }
    }
    keys.into_iter().filter_map(|key| merge_component(key, windows)).collect()
}

fn merge_component(key: (ComponentKind, &str), windows: &[Judged]) -> Option<ComponentDiagnosis> {
    let of_key: Vec<&ComponentDiagnosis> = windows
        .iter()
        .flat_map(|w| &w.components)
        .filter(|c| (c.kind, c.id.as_str()) == key)
        .collect();
    let accusing: Vec<&ComponentDiagnosis> =
        of_key.iter().copied().filter(|c| c.state.is_accusation()).collect();
    let newest_all = of_key.len() >= PERSISTENCE
        && of_key.iter().rev().take(PERSISTENCE).all(|c| c.state.is_accusation());
    if newest_all || 2 * accusing.len() > windows.len() {
        let fault = most_frequent(&accusing);
        let mut with_fault: Vec<&ComponentDiagnosis> =
            accusing.into_iter().filter(|c| c.fault == fault).collect();
        with_fault.sort_by(|a, b| a.severity.unwrap_or(0.0).total_cmp(&b.severity.unwrap_or(0.0)));
        let mut median = (*with_fault.get(with_fault.len() / 2)?).clone();
        note_windows(&mut median, with_fault.len(), windows.len());
        return Some(median);
    }
    let is_tied = 2 * accusing.len() == windows.len() && key.0 != ComponentKind::Sensor;
    if let Some(accused) = accusing.last().filter(|_| is_tied) {
        let mut open = (*accused).clone();
        let why = format!("{} (in half of {} windows, not in most)", open.why, windows.len());
        make_undetermined(&mut open, &why);
        return Some(open);
    }
    let calm: Vec<&ComponentDiagnosis> =
        of_key.iter().copied().filter(|c| !c.state.is_accusation()).collect();
    let healthy = calm.iter().filter(|c| c.state == State::Healthy).count();
    let wanted = if 2 * healthy > calm.len() { State::Healthy } else { State::Undetermined };
    let newest = calm.iter().rev().find(|c| c.state == wanted).or(calm.last())?;
    let mut verdict = (*newest).clone();
    if !accusing.is_empty() {
        verdict.why = format!(
            "{} (accused in {} of {} windows, not in most)",
            verdict.why,
            accusing.len(),
            windows.len()
        );
    }
    Some(verdict)
}

fn note_windows(verdict: &mut ComponentDiagnosis, n: usize, of: usize) {
    if of > 1 {
        verdict.why = format!("{}; in {n} of the last {of} windows", verdict.why);
    }
}

fn most_frequent(verdicts: &[&ComponentDiagnosis]) -> Option<FaultMode> {
    let count = |fault: Option<FaultMode>| verdicts.iter().filter(|c| c.fault == fault).count();
    verdicts.iter().map(|c| c.fault).max_by_key(|f| count(*f)).flatten()
}

/// Worst of bearing, shaft, gear, machine; undetermined only if all of them are.
#[must_use]
pub fn whole_state(components: &[ComponentDiagnosis]) -> State {
    let parts = components.iter().filter(|c| c.kind != ComponentKind::Sensor);
    parts.map(|c| c.state).max().unwrap_or(State::Undetermined)
}

fn coverage(components: &[ComponentDiagnosis]) -> Coverage {
    let parts: Vec<_> = components.iter().filter(|c| c.kind != ComponentKind::Sensor).collect();
    let undetermined: Vec<String> =
        parts.iter().filter(|c| c.state == State::Undetermined).map(|c| c.id.clone()).collect();
    Coverage { judged: parts.len() - undetermined.len(), undetermined }
}

fn timeline(windows: &[Judged]) -> Timeline {
    let mut columns = Timeline::default();
    for window in windows {
        let worst = window
            .components
            .iter()
            .filter(|c| c.kind != ComponentKind::Sensor && c.state.is_accusation())
            .max_by(|a, b| a.severity.unwrap_or(0.0).total_cmp(&b.severity.unwrap_or(0.0)));
        columns.time_s.push(window.time_s.0);
        columns.state.push(whole_state(&window.components));
        columns.component.push(worst.map(|c| c.id.clone()));
        columns.severity.push(worst.and_then(|c| c.severity));
    }
    columns
}

/// Start of the first window from which `level` or worse persists; of the first at all where none does and the whole is judged so.
fn first_since(windows: &[Judged], level: State, whole: State) -> Option<f64> {
    let is_so = |w: &Judged| whole_state(&w.components) >= level;
    let lasting = windows.windows(PERSISTENCE).find(|run| run.iter().all(is_so)).map(|run| &run[0]);
    let first = || windows.iter().find(|w| is_so(w)).filter(|_| whole >= level);
    // What begins in the last windows has had no time to last.
    let at_end = || {
        let calm = windows.iter().rposition(|w| !is_so(w)).map_or(0, |i| i + 1);
        windows.get(calm).filter(|_| whole >= level)
    };
    lasting.or_else(at_end).or_else(first).map(|w| w.time_s.0)
}

#[cfg(test)]
#[path = "summary_tests.rs"]
mod tests;
