//! The stored history through the alarm engine, and what came of it beside what was raised.

use crate::alarms::Alarm;
use crate::alarms::AlarmEvent;
use crate::alarms::AlarmSource;
use crate::alarms::EventKind;
use crate::alarms::Level;
use crate::alarms::Settings;
use crate::alarms::limit::LimitJudge;
use crate::alarms::past;
use crate::alarms::past::PastAct;
use crate::alarms::past::PastEvent;
use crate::alarms::past::PastWindow;
use crate::alarms::past::Rerun;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::baseline::Record;
use crate::diagnosis::fault::ComponentKind;
use crate::machine::Machine;
use crate::signal::ChannelInfo;
use crate::signal::Timestamp;
use crate::store::Archive;
use crate::store::EventQuery;
use crate::store::StoreError;
use crate::store::trends::Minute;
use crate::store::trends::TrendArchive;
use crate::units::Hz;
use crate::units::Unit;
use std::collections::BTreeMap;
use std::collections::BTreeSet;
use std::collections::VecDeque;
use std::ops::ControlFlow;
use std::sync::Arc;

/// History before the span that sets the delays going, besides twice the longest delay, s.
const WARM_UP_S: f64 = 3600.0;

/// Two times are the same up to this, ns: UTC in seconds as a number is exact to a quarter of a microsecond.
const SAME_NS: i64 = 1_000_000;

/// Events read at a time.
const PAGE: usize = 1000;

/// What is asked.
#[derive(Debug)]
pub(super) struct Question {
    pub(super) machine: Arc<Machine>,
    pub(super) settings: Settings,
    pub(super) span: (Timestamp, Timestamp),
    /// Records of baselines by signed id and name.
    pub(super) records: BTreeMap<(Option<String>, String), Record>,
}

/// A change of an alarm's condition.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Change {
    pub(super) at: Timestamp,
    pub(super) what: What,
    pub(super) alarm: Alarm,
}

/// What happened to a condition, whatever operators did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum What {
    Came(Level),
    Rose,
    Fell,
    Went,
}

impl What {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Came(_) => "raised",
            Self::Rose => "escalated",
            Self::Fell => "de_escalated",
            Self::Went => "went",
        }
    }
}

/// What came of it.
#[derive(Debug, Default)]
pub(super) struct Answer {
    /// What would have been raised.
    pub(super) would: Vec<Change>,
    /// What was raised.
    pub(super) was: Vec<Change>,
    /// Of those above, what the other has not.
    pub(super) only_would: Vec<Change>,
    /// Of those above, what the other has not.
    pub(super) only_was: Vec<Change>,
    /// Alarms that would stand at the beginning of the span.
    pub(super) standing: Vec<Alarm>,
    pub(super) n_windows: usize,
    pub(super) gaps: Vec<(Timestamp, Timestamp)>,
    pub(super) notes: Vec<String>,
}

/// What raised an alarm, whichever number it has.
type Key = (AlarmSource, ComponentKind, String);

fn key(alarm: &Alarm) -> Key {
    (alarm.source.clone(), alarm.kind, alarm.component.clone())
}

/// Whether the history tells what raises it: not that a whole stream is silent or a store refuses.
fn is_told(alarm: &Alarm) -> bool {
    match alarm.source {
        AlarmSource::Diagnosis | AlarmSource::Limit(_) => true,
        AlarmSource::Data => alarm.kind == ComponentKind::Sensor,
        AlarmSource::Store => false,
    }
}

/// Puts the question to the history.
pub(super) fn ask(
    question: &Question,
    archive: &dyn Archive,
    trends: &dyn TrendArchive,
) -> Result<Answer, StoreError> {
    let (from, to) = question.span;
    let machine = &question.machine;
    let delays = machine.alarm_limits.limits.iter().map(|limit| {
        let (on, off) = (limit.on_delay_s, limit.off_delay_s);
        on.unwrap_or(question.settings.on_delay_s) + off.unwrap_or(question.settings.off_delay_s)
    });
    let longest_s =
        delays.fold(question.settings.on_delay_s + question.settings.off_delay_s, f64::max);
    let begin = from.plus_seconds(-WARM_UP_S - 2.0 * longest_s);
    let stored = events(archive, &machine.id, begin)?;
    let at = |event: &AlarmEvent| Timestamp(0).plus_seconds(event.time_s);
    let acts = stored.iter().filter(|event| event.by.is_some());
    let acts = acts.filter_map(|event| PastAct::of(event, at(event))).collect();
    let mut telling = Telling {
        question,
        rerun: Rerun::new(Arc::clone(machine), question.settings.clone()),
        acts,
        raised: Vec::new(),
        seen: Seen::default(),
        standing: None,
    };
    let unreadable = trends.minutes(&machine.id, (begin, to), &mut |minute| {
        telling.minute(minute);
        ControlFlow::Continue(())
    })?;
    let standing = telling.standing.take().unwrap_or_else(|| telling.rerun.standing());
    let inside = |change: &Change| change.at >= from && change.at < to;
    let would = changes(telling.raised.iter().map(|past| (past.at, &past.event)));
    let would: Vec<Change> = would.into_iter().filter(inside).collect();
    let was = changes(stored.iter().map(|event| (at(event), event)));
    let was: Vec<Change> = was.into_iter().filter(inside).collect();
    let mut answer = Answer {
        only_would: without(&would, &was),
        only_was: without(&was, &would),
        would,
        was,
        standing,
        n_windows: telling.seen.n_windows,
        gaps: telling.seen.gaps.clone(),
        notes: Vec::new(),
    };
    answer.notes = notes(&telling, &stored, unreadable);
    Ok(answer)
}

/// The events of a machine from a time on, oldest first, their times counted from 1970-01-01.
fn events(
    archive: &dyn Archive,
    machine: &str,
    since: Timestamp,
) -> Result<Vec<AlarmEvent>, StoreError> {
    let mut all = Vec::new();
    let mut before = u64::MAX;
    loop {
        let query = EventQuery {
            machine: machine.to_owned(),
            before,
            since: Some(since),
            limit: PAGE,
            start: Some(Timestamp(0)),
            ..EventQuery::default()
        };
        let page = archive.events(&query)?;
        let Some(last) = page.last() else { break };
        before = last.sequence;
        all.extend(page);
    }
    all.reverse();
    Ok(all)
}

/// What is seen of the history on the way.
#[derive(Default)]
struct Seen {
    n_windows: usize,
    newest: Option<(Timestamp, f64)>,
    gaps: Vec<(Timestamp, Timestamp)>,
    /// Features that were measured, by channel.
    measured: BTreeSet<(String, String)>,
    missing_records: BTreeSet<String>,
    /// Channels of the streams.
    channels: BTreeSet<String>,
}

/// The history on its way through the engine.
struct Telling<'a> {
    question: &'a Question,
    rerun: Rerun,
    /// What operators did, oldest first.
    acts: VecDeque<PastAct>,
    raised: Vec<PastEvent>,
    seen: Seen,
    /// What stood at the beginning of the span.
    standing: Option<Vec<Alarm>>,
}

impl Telling<'_> {
    fn minute(&mut self, minute: &Minute) {
        for channel in &minute.channels {
            let Some(name) = minute.stream.channels.get(channel.channel) else { continue };
            for (feature, _) in &channel.features {
                let known = (name.clone(), feature.to_string());
                if !self.seen.measured.contains(&known) {
                    self.seen.measured.insert(known);
                }
            }
        }
        if !minute.stream.channels.iter().all(|name| self.seen.channels.contains(name)) {
            self.seen.channels.extend(minute.stream.channels.iter().cloned());
        }
        for place in 0..minute.windows.len() {
            self.window(minute, place);
        }
    }

    fn window(&mut self, minute: &Minute, place: usize) {
        let window = &minute.windows[place];
        let at = minute.stream.utc(window.time_s);
        let (from, to) = self.question.span;
        if at >= to {
            return;
        }
        if at >= from {
            if self.standing.is_none() {
                self.standing = Some(self.rerun.standing());
            }
            self.seen.n_windows += 1;
            self.seen.window(at, window);
        }
        while self.acts.front().is_some_and(|act| act.at < at) {
            let Some(act) = self.acts.pop_front() else { break };
            self.raised.extend(self.rerun.act(&act));
        }
        let columns: Vec<past::PastFeatures<'_>> = minute
            .channels
            .iter()
            .map(|channel| {
                let values = channel.features.iter().zip(&channel.columns);
                (channel.channel, values.map(|((n, u), c)| (n, *u, c[place])).collect())
            })
            .collect();
        let measured = past::features(&columns);
        let baseline = self.baseline(window);
        self.raised.extend(self.rerun.observe(&minute.stream, window, &measured, &baseline));
    }

    /// The records that the window was held against, where they still are.
    fn baseline(&mut self, window: &PastWindow) -> Baseline {
        let mut records = Vec::new();
        for used in &window.baselines {
            match self.question.records.get(used) {
                Some(record) => records.push(record.clone()),
                None => {
                    self.seen.missing_records.insert(used.1.clone());
                }
            }
        }
        Baseline { records, provisional: false }
    }
}

impl Seen {
    /// Notes a window inside the span, and the gap before it.
    fn window(&mut self, at: Timestamp, window: &PastWindow) {
        if let Some((newest, length_s)) = self.newest {
            let longest = newest.plus_seconds(length_s.max(window.duration_s));
            if at > longest {
                self.gaps.push((newest, at));
            }
        }
        self.newest = Some((at, window.duration_s));
    }
}

/// The changes of conditions in a list of events, what operators did left out.
fn changes<'e>(events: impl Iterator<Item = (Timestamp, &'e AlarmEvent)>) -> Vec<Change> {
    let mut is_active: BTreeMap<Key, bool> = BTreeMap::new();
    let mut found = Vec::new();
    for (at, event) in events.filter(|(_, event)| is_told(&event.alarm)) {
        let active = is_active.entry(key(&event.alarm)).or_insert(true);
        let what = match event.kind {
            EventKind::Raised => What::Came(event.alarm.level),
            EventKind::Escalated => What::Rose,
            EventKind::DeEscalated => What::Fell,
            // What an act ends was gone before.
            EventKind::Returned
            | EventKind::Cleared
            | EventKind::Latched
            | EventKind::ConfigurationRemoved
                if *active =>
            {
                What::Went
            }
            EventKind::Returned
            | EventKind::Cleared
            | EventKind::Latched
            | EventKind::Acknowledged
            | EventKind::Reset
            | EventKind::Shelved
            | EventKind::Unshelved
            | EventKind::Suppressed
            | EventKind::Unsuppressed
            | EventKind::RemovedFromService
            | EventKind::ReturnedToService
            | EventKind::ConfigurationRemoved => continue,
        };
        *active = what != What::Went;
        found.push(Change { at, what, alarm: event.alarm.clone() });
    }
    found
}

/// The changes that others have not: the same thing happened to the same condition at the same time.
fn without(changes: &[Change], others: &[Change]) -> Vec<Change> {
    let mut by_key: BTreeMap<Key, Vec<&Change>> = BTreeMap::new();
    for other in others {
        by_key.entry(key(&other.alarm)).or_default().push(other);
    }
    let is_there = |change: &&Change| {
        let same = |other: &&Change| {
            other.what == change.what
                && other.at.0.saturating_sub(change.at.0).saturating_abs() <= SAME_NS
        };
        by_key.get(&key(&change.alarm)).is_some_and(|others| others.iter().any(same))
    };
    changes.iter().filter(|change| !is_there(change)).cloned().collect()
}

/// What the history cannot tell.
fn notes(telling: &Telling<'_>, stored: &[AlarmEvent], unreadable: Vec<String>) -> Vec<String> {
    let Telling { question, rerun, seen, .. } = telling;
    let mut notes = Vec::new();
    let (n, seconds) = seen.gaps.iter().fold((0, 0.0), |(n, sum), (from, to)| {
        (n + 1, sum + to.0.saturating_sub(from.0) as f64 * 1e-9)
    });
    if n > 0 {
        notes.push(format!("{n} gaps, {seconds:.0} s together: what was in them is not known"));
    }
    notes.extend(missing_features(question, seen));
    if !seen.missing_records.is_empty() {
        let names = seen.missing_records.iter().map(String::as_str).collect::<Vec<_>>().join(", ");
        notes.push(format!(
            "records of baselines that were in use are gone ({names}): limits relative to a baseline were not \
             judged against them"
        ));
    }
    if rerun.n_restarts() > 0 {
        notes.push(format!(
            "the daemon was restarted {} times in the history: delays under way then may have begun anew at \
             another time",
            rerun.n_restarts()
        ));
    }
    let untold = stored.iter().filter(|event| !is_told(&event.alarm)).count();
    if untold > 0 {
        notes.push(format!(
            "{untold} stored events are of a source that was silent or a store that refused: the history does \
             not tell them again"
        ));
    }
    notes.extend(unreadable);
    notes.push(
        "verdicts are as they were: levels, zones and baselines that the diagnosis judges are not judged anew; \
         measured values are stored to 7 digits, so one within that of a limit may fall on its other side"
            .to_owned(),
    );
    notes
}

/// Limits whose features no window of the history has.
fn missing_features(question: &Question, seen: &Seen) -> Vec<String> {
    let info = |name: &String| ChannelInfo {
        name: name.clone(),
        sample_rate: Hz(1.0),
        unit: Unit::Unknown,
        offset: 0.0,
        unit_conflict: None,
        full_scale: None,
    };
    let channels: Vec<ChannelInfo> = seen.channels.iter().map(info).collect();
    let limits = question.machine.alarm_limits.limits.iter();
    limits
        .filter_map(|limit| {
            let judge = LimitJudge::new(&question.machine, limit, &channels);
            let needs = judge.needs();
            let is_missing = |(channel, feature): &&(&str, &str)| {
                !seen.measured.contains(&((*channel).to_owned(), (*feature).to_owned()))
            };
            let missing: Vec<_> = needs.iter().filter(is_missing).collect();
            let (channel, feature) = missing.first()?;
            Some(format!(
                "limit {:?} needs {feature:?} of {channel:?}{}, which was not measured then: it was not judged \
                 there",
                limit.id,
                match missing.len() {
                    1 => String::new(),
                    n => format!(" and {} more", n - 1),
                }
            ))
        })
        .collect()
}
