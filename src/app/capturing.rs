//! Captures of a machine on its shard: holds what was received last, and with an alarm hands it to the thread that
//! writes, with the windows behind it. A shard never waits for the disk: what finds no room is told.

use super::captures::Capturer;
use super::captures::Order;
use crate::alarms::Alarm;
use crate::alarms::AlarmEvent;
use crate::alarms::AlarmSource;
use crate::alarms::EventKind;
use crate::capture::held::Held;
use crate::capture::received::Received;
use crate::capture::writer::CaptureHeader;
use crate::config;
use crate::diagnosis::verdict::Diagnosis;
use crate::evidence::kept::Judged;
use crate::pipeline::Monitor;
use crate::pipeline::Settings;
use crate::signal::Timestamp;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;
use std::time::Instant;
use tokio::sync::oneshot;
use toml::Table;
use toml::Value;

/// An hour.
const HOUR: Duration = Duration::from_secs(3600);

/// Windows kept with a capture at most.
const MAX_WINDOWS: f64 = 256.0;

/// How long after its end a capture waits for channels that are behind, s of stream time; one that is further behind
/// delivers no more.
const BEHIND_S: f64 = 30.0;

/// Why a capture ends early.
const NO_DATA: &str = "it ends early: no data come any more";

/// What a machine's captures need besides its monitor.
#[derive(Debug)]
pub struct Capturing {
    machine: String,
    settings: config::Captures,
    capturer: Capturer,
    header: CaptureHeader,
    judged: Arc<Judged>,
    /// Hash of the configuration.
    configuration: String,
    held: Held,
    /// Captures that take what comes.
    open: Vec<Open>,
    /// Ends of captures that found no room, with what is noted.
    unsaid: Vec<(u64, Option<String>)>,
    /// Stream time one past the newest sample of each channel, s.
    reached_s: Vec<f64>,
    /// When captures were begun within the last hour.
    begun: VecDeque<Instant>,
}

/// A capture that takes what comes; times in s of stream time.
#[derive(Debug, Clone, Copy)]
struct Open {
    key: u64,
    trigger_s: f64,
    ends_s: f64,
}

/// What an operator asks for.
#[derive(Debug)]
pub(super) struct Asked {
    pub(super) author: String,
    pub(super) comment: String,
    pub(super) before_s: Option<f64>,
    pub(super) after_s: Option<f64>,
    pub(super) reply: oneshot::Sender<Result<String, String>>,
}

impl Capturing {
    pub(super) fn new(
        machine: &str,
        settings: config::Captures,
        capturer: Capturer,
        header: CaptureHeader,
        (judged, configuration): (Judged, String),
    ) -> Self {
        let held = Held::new(&judged.received, settings.before_s);
        let (machine, judged) = (machine.to_owned(), Arc::new(judged));
        let reached_s = vec![f64::NEG_INFINITY; judged.received.len()];
        Self {
            machine,
            settings,
            capturer,
            header,
            judged,
            configuration,
            held,
            open: Vec::new(),
            unsaid: Vec::new(),
            reached_s,
            begun: VecDeque::new(),
        }
    }

    /// Windows are judged by other settings, or another description of the machine, from now on. Captures that are open
    /// have their windows already.
    pub(super) fn renew(&mut self, text: &str, settings: &Settings, configuration: &str) {
        self.header.machine = Some(text.to_owned());
        let settings = self.judged.settings.renewed(settings);
        self.judged = Arc::new(Judged { settings, ..Judged::clone(&self.judged) });
        configuration.clone_into(&mut self.configuration);
    }

    /// Lets the monitor keep as many windows as a capture can hold.
    pub(super) fn prepare(&self, monitor: &mut Monitor) {
        let n = (self.settings.before_s / self.judged.settings.hop_s).ceil() + 1.0;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "at least 1, bounded"
        )]
        monitor.keep_trail(n.clamp(1.0, MAX_WINDOWS) as usize);
    }

    /// Holds a run, and hands it to the captures that go on.
    pub(super) fn receive(&mut self, run: &Arc<Received>) {
        self.held.push(Arc::clone(run));
        if let Some(reached_s) = self.reached_s.get_mut(run.channel.0) {
            *reached_s = reached_s.max(self.held.end_s(run));
        }
        for open in self.open.iter().filter(|open| run.time_s < open.ends_s) {
            self.capturer.go_on(open.key, Arc::clone(run));
        }
    }

    /// Ends the captures that have all that they should of every channel that still delivers, or have waited long enough
    /// for those that are behind.
    pub(super) fn end_those_complete(&mut self) {
        if self.open.is_empty() {
            return;
        }
        let newest_s = self.reached_s.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let open = std::mem::take(&mut self.open);
        for one in open {
            let short = self.short_channels(one);
            if newest_s < one.ends_s || !short.is_empty() && newest_s < one.ends_s + BEHIND_S {
                self.open.push(one);
                continue;
            }
            let names = short.join("`, `");
            let note = (!short.is_empty()).then(|| {
                format!("`{names}` ended early: behind the others by more than {BEHIND_S:.0} s")
            });
            self.end(one.key, note);
        }
    }

    /// Channels that delivered before a capture's trigger, and are not at its end yet.
    fn short_channels(&self, open: Open) -> Vec<&str> {
        let delivers_until = open.trigger_s - BEHIND_S;
        let channels = self.judged.received.iter().zip(&self.reached_s);
        let short = channels
            .filter(|(_, reached_s)| **reached_s >= delivers_until && **reached_s < open.ends_s);
        short.map(|(channel, _)| channel.name.as_str()).collect()
    }

    /// Ends all captures: the stream has ended.
    pub(super) fn end_all(&mut self) {
        for one in std::mem::take(&mut self.open) {
            self.end(one.key, None);
        }
    }

    /// Ends all captures: no data come, and nobody knows when they will.
    pub(super) fn end_for_silence(&mut self) {
        self.end_those_complete();
        for one in std::mem::take(&mut self.open) {
            self.end(one.key, Some(NO_DATA.to_owned()));
        }
    }

    /// Says again what ends, if there was no room for that.
    pub(super) fn tick(&mut self) {
        for (key, note) in std::mem::take(&mut self.unsaid) {
            self.end(key, note);
        }
    }

    fn end(&mut self, key: u64, note: Option<String>) {
        if !self.capturer.end(key, note.clone()) {
            self.unsaid.push((key, note));
        }
    }

    /// Begins a capture for the alarms that were raised, or rose, in a window that ended at `time_s`.
    pub(super) fn note(&mut self, events: &[AlarmEvent], time_s: f64, seen: Seen<'_>) {
        let is_news = |event: &&AlarmEvent| {
            matches!(event.kind, EventKind::Raised | EventKind::Escalated)
                && event.alarm.source != AlarmSource::Store
        };
        let alarms: Vec<&Alarm> = events.iter().filter(is_news).map(|event| &event.alarm).collect();
        let Some(first) = alarms.first() else { return };
        let numbers: Vec<u64> = alarms.iter().map(|alarm| alarm.id).collect();
        let now = super::now();
        while self.begun.front().is_some_and(|at| now.saturating_duration_since(*at) >= HOUR) {
            self.begun.pop_front();
        }
        let most = self.settings.most_per_hour;
        if self.begun.len() >= most {
            let why = format!(
                "{most} captures of this machine were begun within the hour (captures.most_per_hour)"
            );
            self.capturer.refuse(&self.machine, numbers, why);
            return;
        }
        let mut about = self.about("alarm", time_s);
        about.insert("alarm".to_owned(), Value::Table(alarm(first, seen.diagnosis)));
        let others = alarms.iter().skip(1).map(|alarm| whole(alarm.id)).collect();
        about.insert("further_alarms".to_owned(), Value::Array(others));
        about.insert("baselines".to_owned(), Value::Array(baselines(seen.diagnosis)));
        let after_s = self.settings.after_s;
        let order = self.order(about, time_s, (self.settings.before_s, after_s), seen);
        if self.send(Order { alarms: numbers, ..order }) {
            self.begun.push_back(now);
        }
    }

    /// Begins a capture that an operator asked for.
    pub(super) fn ask(&mut self, asked: Asked, time_s: f64, seen: Seen<'_>) {
        let Asked { author, comment, before_s, after_s, reply } = asked;
        let before_s = before_s.map_or(self.settings.before_s, |s| s.min(self.settings.before_s));
        let after_s = after_s.unwrap_or(self.settings.after_s);
        let mut about = self.about("operator", time_s);
        for (key, text) in [("author", &author), ("comment", &comment)] {
            about.insert(key.to_owned(), Value::String(text.clone()));
        }
        let order = self.order(about, time_s, (before_s, after_s), seen);
        let by = Some((author, comment));
        self.send(Order { by, reply: Some(reply), ..order });
    }

    fn order(
        &self,
        about: Table,
        trigger_s: f64,
        (before_s, after_s): (f64, f64),
        seen: Seen<'_>,
    ) -> Order {
        let trail = seen.monitor.map(Monitor::trail).unwrap_or_default();
        let is_past = |window: &Arc<crate::pipeline::Passed>| window.time_s.1 <= trigger_s + 1e-6;
        Order {
            machine: self.machine.clone(),
            header: self.header.clone(),
            judged: Arc::clone(&self.judged),
            configuration: self.configuration.clone(),
            about,
            runs: self.held.runs(),
            windows: trail.into_iter().filter(is_past).collect(),
            from_s: trigger_s - before_s,
            trigger_s,
            ends_s: trigger_s + after_s,
            requested: super::wall_clock(),
            alarms: Vec::new(),
            by: None,
            reply: None,
        }
    }

    fn send(&mut self, order: Order) -> bool {
        let (trigger_s, ends_s) = (order.trigger_s, order.ends_s);
        let Some(key) = self.capturer.begin(order) else { return false };
        self.open.push(Open { key, trigger_s, ends_s });
        true
    }

    fn about(&self, cause: &str, trigger_s: f64) -> Table {
        let utc = self.header.start_time.map(|start: Timestamp| start.plus_seconds(trigger_s).0);
        let mut about = Table::new();
        about.insert("cause".to_owned(), Value::String(cause.to_owned()));
        about.insert("machine".to_owned(), Value::String(self.machine.clone()));
        about.insert("trigger_s".to_owned(), Value::Float(trigger_s));
        if let Some(utc) = utc {
            about.insert("trigger_utc_ns".to_owned(), Value::Integer(utc));
        }
        about
    }
}

/// What was seen when a capture is begun.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen<'a> {
    pub(super) monitor: Option<&'a Monitor>,
    pub(super) diagnosis: Option<&'a Diagnosis>,
}

/// What an alarm says, and the numbers behind it.
fn alarm(alarm: &Alarm, diagnosis: Option<&Diagnosis>) -> Table {
    let text = |text: &str| Value::String(text.to_owned());
    let mut table = Table::new();
    table.insert("number".to_owned(), whole(alarm.id));
    table.insert("component".to_owned(), text(&alarm.component));
    table.insert("kind".to_owned(), text(alarm.kind.name()));
    table.insert("source".to_owned(), text(alarm.source.name()));
    table.insert("level".to_owned(), text(alarm.level.name()));
    table.insert("why".to_owned(), text(&alarm.why));
    if let Some(fault) = alarm.fault {
        table.insert("fault".to_owned(), text(fault.name()));
    }
    let origin = match &alarm.source {
        AlarmSource::Limit(id) => format!("[[limits.alarm]] {id} of the machine file"),
        AlarmSource::Diagnosis => {
            "the false-alarm probability of `settings`, and the baseline where the line says so"
                .to_owned()
        }
        AlarmSource::Data | AlarmSource::Store => "alarms.missing_after_s".to_owned(),
    };
    table.insert("thresholds_from".to_owned(), Value::String(origin));
    let of_it = diagnosis.and_then(|diagnosis| {
        let is_it = |c: &&crate::diagnosis::verdict::ComponentDiagnosis| {
            c.kind == alarm.kind && c.id == alarm.component
        };
        diagnosis.components.iter().find(is_it)
    });
    let lines = of_it.map_or(&[][..], |component| &component.evidence).iter().map(|line| {
        let numbers = [
            ("frequency_hz", line.frequency.map(|hz| hz.0)),
            ("expected_hz", line.expected.map(|hz| hz.0)),
            ("value", Some(line.value)),
            ("threshold", line.threshold),
            ("false_alarm_probability", line.false_alarm_probability),
        ];
        let mut entry: Table = numbers
            .into_iter()
            .filter_map(|(key, number)| Some((key.to_owned(), Value::Float(number?))))
            .collect();
        entry.insert("indicator".to_owned(), text(&line.indicator));
        entry.insert("channel".to_owned(), text(&line.channel));
        entry.insert("unit".to_owned(), text(line.unit.symbol()));
        Value::Table(entry)
    });
    table.insert("lines".to_owned(), Value::Array(lines.collect()));
    table
}

/// Ids of the signed baselines that were used, or the names of the others.
fn baselines(diagnosis: Option<&Diagnosis>) -> Vec<Value> {
    let used = diagnosis.map_or(&[][..], |diagnosis| &diagnosis.baselines).iter();
    let used = used.filter(|baseline| baseline.used);
    used.map(|b| Value::String(b.id.as_deref().unwrap_or(&b.name).to_owned())).collect()
}

fn whole(number: u64) -> Value {
    Value::Integer(i64::try_from(number).unwrap_or(i64::MAX))
}
