//! Diagnosis → operator: alarms and their lives in the words of ISA-18.2.
//!
//! [`AlarmEngine::observe`] takes verdicts, [`AlarmEngine::act`] what operators do,
//! [`AlarmEngine::tick`] that time has passed and what the shell alone can see; all with the time as
//! an argument. Everything that happens is an [`AlarmEvent`]. Must not know where verdicts come from,
//! how alarms are shown or stored, or what time it is.

pub mod state;
pub mod action;
pub mod alarm;
pub mod policy;
pub mod limit;
mod slot;
mod stated;
mod decisions;
mod advance;
mod renewal;
pub mod load;
pub mod past;

pub use action::Act;
pub use action::Action;
pub use action::ActionError;
pub use action::MAX_TEXT_CHARS;
pub use action::Moment;
pub use advance::Advance;
pub use advance::AdvanceError;
pub use advance::Announcement;
pub use advance::Ends;
pub use advance::Subject;
pub use alarm::Acknowledgement;
pub use alarm::Alarm;
pub use alarm::AlarmEvent;
pub use alarm::AlarmSource;
pub use alarm::Deadline;
pub use alarm::EventKind;
pub use alarm::Signature;
pub use alarm::Silencing;
pub use decisions::Decisions;
pub use policy::{Level, Settings};

use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::verdict::Diagnosis;
use crate::machine::Machine;
use crate::signal::ChannelIndex;
use crate::signal::ChannelInfo;
use limit::Measured;
use policy::Observation;
use slot::CauseDelay;
use slot::Finding;
use slot::Slot;
use state::AlarmInput;
use state::AlarmState;
use state::Refusal;
use state::Silence;
use stated::Stated;
use std::collections::BTreeMap;
use std::collections::VecDeque;

/// How the stream of a machine is doing, as the shell sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DataFlow<'a> {
    /// Data come, or it is no fault that they do not: a replay may wait for its next segment.
    Flowing,
    /// Nothing has come for so long, s of monotonic time.
    SilentFor(f64),
    /// Nobody can tell yet: an alarm of missing data stands as it stands.
    Unknown,
    /// The source gave up, with the reason.
    Failed(&'a str),
}

/// What an engine goes on with after a restart.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Kept {
    /// Alarms that are not over.
    pub alarms: Vec<Alarm>,
    /// The newest events, oldest first.
    pub history: Vec<AlarmEvent>,
    /// Highest id of an alarm so far.
    pub last_id: u64,
    /// Highest number of an event so far.
    pub last_sequence: u64,
    /// Stream time up to which the same stream was judged before, s: what it says again up to there
    /// is no news. `None`: it is another stream.
    pub judged_until_s: Option<f64>,
    /// Delays and hysteresis as they were then; `None`: they begin anew.
    pub decisions: Option<Decisions>,
    /// Silences in advance that hold.
    pub advance: Vec<Advance>,
    /// Highest number of one so far.
    pub last_advance: u64,
}

/// The alarms of one machine.
#[derive(Debug, Clone)]
pub struct AlarmEngine {
    settings: Settings,
    machine: String,
    components: BTreeMap<(ComponentKind, String), Slot>,
    /// What the machine file states.
    stated: Stated,
    /// The stream as a whole does not come.
    stream: Slot,
    /// The store does not take what it is given.
    store: Slot,
    /// Silences in advance, oldest first.
    advance: Vec<Advance>,
    last_advance: u64,
    /// Maintenances whose time is over, not yet told.
    over: Vec<Advance>,
    /// Stream time of the newest verdict.
    last_verdict_s: Option<f64>,
    judged_until_s: f64,
    next_id: u64,
    next_sequence: u64,
    history: VecDeque<AlarmEvent>,
}

impl AlarmEngine {
    /// An engine without alarms, of the machine with the id `machine`.
    #[must_use]
    pub fn new(machine: &str, settings: Settings) -> Self {
        Self {
            settings,
            machine: machine.to_owned(),
            components: BTreeMap::new(),
            stated: Stated::default(),
            stream: Slot::default(),
            store: Slot::default(),
            advance: Vec::new(),
            last_advance: 0,
            over: Vec::new(),
            last_verdict_s: None,
            judged_until_s: f64::NEG_INFINITY,
            next_id: 1,
            next_sequence: 1,
            history: VecDeque::new(),
        }
    }

    /// An engine that also judges the limits of `machine`, and sees when one of the `channels` of its
    /// stream does not come.
    #[must_use]
    pub fn of_machine(machine: &Machine, channels: &[ChannelInfo], settings: Settings) -> Self {
        let stated = Stated::new(machine, channels, &settings);
        Self { stated, ..Self::new(&machine.id, settings) }
    }

    /// Goes on with what was kept before a restart. Levels stand as they stood, delays go on as far as they were
    /// kept: the time without the program is one that nobody judged, which holds every clock. Gives the
    /// transitions that the restart itself causes: alarms of what is gone from the machine file are over.
    pub fn restore(&mut self, kept: Kept, now: Moment) -> Vec<AlarmEvent> {
        self.next_id = self.next_id.max(kept.last_id.saturating_add(1));
        self.next_sequence = self.next_sequence.max(kept.last_sequence.saturating_add(1));
        self.judged_until_s = kept.judged_until_s.unwrap_or(f64::NEG_INFINITY);
        self.history = kept.history.into();
        self.bound_history();
        self.take_over_advance(kept.advance, kept.last_advance);
        let ended = self.take_over(kept.alarms, now.stream_s);
        if let Some(decisions) = &kept.decisions {
            self.go_on(decisions, kept.judged_until_s.is_some());
        }
        ended
    }

    /// Gives each alarm its place. What is no longer in the machine file, a limit, a sensor or a component, is never
    /// judged again: its alarm is over, whatever its state.
    fn take_over(&mut self, alarms: Vec<Alarm>, time_s: f64) -> Vec<AlarmEvent> {
        let mut orphans = Vec::new();
        for alarm in alarms {
            let slot = Slot::restored(alarm);
            let Some(alarm) = &slot.alarm else { continue };
            match &alarm.source {
                AlarmSource::Diagnosis if !self.stated.has(alarm.kind, &alarm.component) => {
                    orphans.push(slot);
                }
                AlarmSource::Diagnosis => {
                    self.components.insert((alarm.kind, alarm.component.clone()), slot);
                }
                AlarmSource::Data if alarm.kind == ComponentKind::Machine => self.stream = slot,
                AlarmSource::Store => self.store = slot,
                AlarmSource::Data | AlarmSource::Limit(_) => {
                    orphans.extend(self.stated.restore(slot));
                }
            }
        }
        let ended = orphans.into_iter().filter_map(|slot| slot::remove(slot.alarm?, time_s));
        self.record_all(ended.collect(), time_s)
    }

    /// Takes a verdict at stream time `time_s` in and gives the transitions it causes.
    ///
    /// A component that is absent from the verdict was not judged and keeps its alarm. Stream time
    /// that goes back adds no evidence time.
    pub fn observe(&mut self, diagnosis: &Diagnosis, time_s: f64) -> Vec<AlarmEvent> {
        self.observe_window(diagnosis, time_s, None, &[])
    }

    /// Takes in a verdict and what was measured in its window, as [`Self::observe`] does; limits are judged
    /// too. `absent`: channels of which the window holds too little.
    pub fn observe_window(
        &mut self,
        diagnosis: &Diagnosis,
        time_s: f64,
        measured: Option<&Measured<'_>>,
        absent: &[ChannelIndex],
    ) -> Vec<AlarmEvent> {
        let evidence_s = self.evidence_since_last(diagnosis.duration_s, time_s);
        if time_s <= self.judged_until_s {
            return Vec::new();
        }
        let mut moved = Vec::new();
        for component in &diagnosis.components {
            let observation = Observation::of(component.state, diagnosis.operating_state);
            let slot = self.components.entry((component.kind, component.id.clone())).or_default();
            let level = slot.tracker.observe(observation, evidence_s, &self.settings);
            match &mut slot.alarm {
                Some(alarm) => {
                    if slot.cause.takes(alarm, component, evidence_s, &self.settings) {
                        alarm.take_over(component);
                    }
                }
                None => slot.cause = CauseDelay::default(),
            }
            let finding = || Finding::of(component);
            let next_id = &mut self.next_id;
            moved.extend(slot::transition(&mut slot.alarm, level, time_s, next_id, &finding));
        }
        if let Some(measured) = measured {
            let (stated, next_id) = (&mut self.stated, &mut self.next_id);
            stated.judge(measured, (time_s, evidence_s), next_id, &mut moved);
            stated.watch(absent, (time_s, evidence_s), next_id, &mut moved);
        }
        self.record_all(moved, time_s)
    }

    /// Stream time the newest window adds to what was already judged, s.
    fn evidence_since_last(&mut self, window_s: f64, time_s: f64) -> f64 {
        let elapsed_s = self.last_verdict_s.map_or(0.0, |last| time_s - last);
        self.last_verdict_s = Some(time_s);
        // `max` and `min` also drop NaN: what is no number proves nothing.
        elapsed_s.min(window_s).max(0.0)
    }

    /// Takes in that time has passed: shelvings end, data that do not come and a store that fails raise
    /// their alarms. `store_failure`: why what happens cannot be stored, `None` if it can or another
    /// machine tells it.
    pub fn tick(
        &mut self,
        now: Moment,
        flow: DataFlow<'_>,
        store_failure: Option<&str>,
    ) -> Vec<AlarmEvent> {
        self.end_advance(now);
        let mut events = self.end_silences(now);
        let silent = match flow {
            DataFlow::Flowing | DataFlow::Unknown => None,
            DataFlow::SilentFor(for_s) if for_s < self.settings.missing_after_s => None,
            DataFlow::SilentFor(for_s) => Some(format!("no data have come for {for_s:.0} s")),
            DataFlow::Failed(why) => Some(format!("no data come, the source failed: {why}")),
        };
        let (machine, next_id) = (&self.machine, &mut self.next_id);
        let of_machine = |source: AlarmSource, why: &str| Finding {
            component: machine.clone(),
            kind: ComponentKind::Machine,
            source,
            latching: false,
            fault: None,
            why: why.to_owned(),
            severity: None,
            confidence: None,
        };
        let stated = [
            (&mut self.stream, AlarmSource::Data, silent.as_deref()),
            (&mut self.store, AlarmSource::Store, store_failure),
        ];
        let mut moved = Vec::new();
        let is_told =
            |source: &AlarmSource| *source != AlarmSource::Data || flow != DataFlow::Unknown;
        for (slot, source, why) in stated.into_iter().filter(|(_, source, _)| is_told(source)) {
            let level = why.map(|_| Level::Warning);
            let finding = || of_machine(source.clone(), why.unwrap_or_default());
            let time_s = now.stream_s;
            moved.extend(slot::transition(&mut slot.alarm, level, time_s, next_id, &finding));
        }
        // What goes wrong may change while the alarm stands; that is shown, and is no transition.
        if let (Some(alarm), Some(why)) = (&mut self.store.alarm, store_failure)
            && alarm.why != why
        {
            why.clone_into(&mut alarm.why);
        }
        events.extend(self.record_all(moved, now.stream_s));
        events
    }

    fn end_silences(&mut self, now: Moment) -> Vec<AlarmEvent> {
        let mut ended = Vec::new();
        for slot in self.alarms_mut() {
            let Some(alarm) = slot else { continue };
            let Some(silencing) = &alarm.silencing else { continue };
            let (silence, until) = (silencing.silence, silencing.until);
            if until.is_none_or(|until| now.monotonic_s < until.monotonic_s) {
                continue;
            }
            let input = AlarmInput::EndOf(silence);
            let Ok(after) = alarm.position().after(input, alarm.latching) else { continue };
            alarm.state = after.life;
            alarm.silencing = None;
            alarm.changed_at_s = now.stream_s;
            ended.push((EventKind::end_of(silence), alarm.clone()));
            if after.is_over() {
                *slot = None;
            }
        }
        let ids: Vec<u64> = ended.iter().map(|(_, alarm)| alarm.id).collect();
        let mut events = self.record_all(ended, now.stream_s);
        events.extend(ids.into_iter().filter_map(|id| self.silence_again(id, now)));
        events
    }

    /// Takes an operator's act in; gives the alarm after it and the transitions: the act, and `Cleared`
    /// when it ends the alarm's life.
    ///
    /// # Errors
    /// When no such alarm is standing, the act does not fit its state, or a text or time is not
    /// allowed. Nothing has changed then.
    pub fn act(&mut self, act: &Act, now: Moment) -> Result<(Alarm, Vec<AlarmEvent>), ActionError> {
        act.check(self.settings.max_shelving_s)?;
        let id = act.alarm;
        let by = Signature {
            author: act.author.trim().to_owned(),
            comment: act.comment.trim().to_owned(),
        };
        let is_it = |slot: &&mut Option<Alarm>| slot.as_ref().is_some_and(|alarm| alarm.id == id);
        let slot = self.alarms_mut().find(is_it).ok_or(ActionError::UnknownAlarm { id })?;
        let alarm = slot.as_mut().ok_or(ActionError::UnknownAlarm { id })?;
        let after = alarm
            .position()
            .after(act.action.input(), alarm.latching)
            .map_err(|why| refused(alarm, why))?;
        let was = alarm.state;
        alarm.state = after.life;
        alarm.changed_at_s = now.stream_s;
        alarm.silencing = after.silence.and_then(|silence| {
            let kept = alarm.silencing.take();
            match act.action.input() {
                AlarmInput::Life(_) | AlarmInput::Removed => kept,
                AlarmInput::Silence(_) | AlarmInput::EndOf(_) => {
                    Some(silencing(silence, act.action, &by, now))
                }
            }
        });
        if act.action == Action::Acknowledge {
            let Signature { author, comment } = by.clone();
            alarm.acknowledgement = Some(Acknowledgement { author, comment, time_s: now.stream_s });
        }
        let alarm = alarm.clone();
        if after.is_over() {
            *slot = None;
        }
        let kind = EventKind::of(act.action);
        let mut events = vec![self.record(kind, now.stream_s, Some(by), alarm.clone())];
        if after.life == AlarmState::Normal && was != AlarmState::Normal {
            events.push(self.record(EventKind::Cleared, now.stream_s, None, alarm.clone()));
        }
        Ok((alarm, events))
    }

    /// All alarms that are not over, newest first.
    #[must_use]
    pub fn standing(&self) -> Vec<Alarm> {
        let slots = self.components.values().chain(self.stated.slots());
        let slots = slots.chain([&self.stream, &self.store]);
        let mut alarms: Vec<Alarm> = slots.filter_map(|slot| slot.alarm.clone()).collect();
        alarms.sort_by_key(|alarm| std::cmp::Reverse(alarm.id));
        alarms
    }

    /// The alarm that stands while no data of the machine come.
    #[must_use]
    pub fn no_data(&self) -> Option<&Alarm> {
        self.stream.alarm.as_ref().filter(|alarm| alarm.state.is_active())
    }

    fn alarms_mut(&mut self) -> impl Iterator<Item = &mut Option<Alarm>> {
        let slots = self.components.values_mut().chain(self.stated.slots_mut());
        let slots = slots.chain([&mut self.stream, &mut self.store]);
        slots.map(|slot| &mut slot.alarm)
    }

    /// Stream time up to which this stream is judged, s; `None`: it is not yet.
    #[must_use]
    pub fn judged_until_s(&self) -> Option<f64> {
        let before = Some(self.judged_until_s).filter(|time_s| time_s.is_finite());
        let newest = self.last_verdict_s.filter(|time_s| time_s.is_finite());
        [before, newest].into_iter().flatten().reduce(f64::max)
    }

    /// Highest id of an alarm so far; 0: none was raised.
    #[must_use]
    pub fn last_id(&self) -> u64 {
        self.next_id - 1
    }

    /// Highest number of an event so far; 0: none.
    #[must_use]
    pub fn last_sequence(&self) -> u64 {
        self.next_sequence - 1
    }

    /// Highest number of a silence in advance so far; 0: none was said.
    #[must_use]
    pub fn last_advance(&self) -> u64 {
        self.last_advance
    }

    /// Policy.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The events held, oldest first; at most [`Settings::history_len`].
    #[must_use]
    pub fn history(&self) -> &VecDeque<AlarmEvent> {
        &self.history
    }

    /// Number of events that fell out of the history.
    #[must_use]
    pub fn history_dropped(&self) -> u64 {
        self.next_sequence - 1 - self.history.len() as u64
    }

    fn record_all(&mut self, mut moved: Vec<(EventKind, Alarm)>, time_s: f64) -> Vec<AlarmEvent> {
        self.silence_raised(&mut moved);
        moved.into_iter().map(|(kind, alarm)| self.record(kind, time_s, None, alarm)).collect()
    }

    fn record(
        &mut self,
        kind: EventKind,
        time_s: f64,
        by: Option<Signature>,
        alarm: Alarm,
    ) -> AlarmEvent {
        let event = AlarmEvent { sequence: self.next_sequence, kind, time_s, by, alarm };
        self.next_sequence += 1;
        self.history.push_back(event.clone());
        self.bound_history();
        event
    }

    fn bound_history(&mut self) {
        while self.history.len() > self.settings.history_len {
            self.history.pop_front();
        }
    }
}

fn silencing(silence: Silence, action: Action, by: &Signature, now: Moment) -> Silencing {
    let until = match action {
        Action::Shelve { for_s } => Some(Deadline {
            monotonic_s: now.monotonic_s + for_s,
            utc: now.utc.plus_seconds(for_s),
        }),
        Action::Acknowledge
        | Action::Unshelve
        | Action::Suppress
        | Action::Unsuppress
        | Action::TakeOutOfService
        | Action::ReturnToService
        | Action::Reset => None,
    };
    let Signature { author, comment } = by.clone();
    Silencing { silence, author, comment, since_s: now.stream_s, until }
}

fn refused(alarm: &Alarm, why: Refusal) -> ActionError {
    let id = alarm.id;
    match (&alarm.acknowledgement, why) {
        (Some(by), Refusal::NothingToAcknowledge) => {
            ActionError::AlreadyAcknowledged { id, author: by.author.clone() }
        }
        _ => ActionError::NotInState { id, why },
    }
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod life_tests;
#[cfg(test)]
mod limit_tests;
