//! Silence that is said in advance: of what a component, a limit or a channel may raise later.
//!
//! An alarm that is raised while it holds is silent from the first; it lives as any other behind it. Who ends it, or its
//! time, ends the silence of those alarms too. Must not know how it is kept.

use super::Alarm;
use super::AlarmEngine;
use super::AlarmEvent;
use super::AlarmSource;
use super::EventKind;
use super::Moment;
use super::Signature;
use super::action::MAX_TEXT_CHARS;
use super::alarm::Deadline;
use super::alarm::Silencing;
use super::state::AlarmInput;
use super::state::Silence;
use crate::diagnosis::fault::ComponentKind;
use crate::signal::Timestamp;

/// Silences of a machine in advance, at most.
const MAX_ADVANCE: usize = 1000;

/// Longest time of one that ends by itself, s: a year.
const MAX_ADVANCE_S: f64 = 31_536_000.0;

/// What raises the alarms that shall be silent.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum Subject {
    /// The verdicts on a component.
    Component(ComponentKind, String),
    /// A limit of the machine file, by its id.
    Limit(String),
    /// Data of a channel that do not come.
    Channel(String),
    /// Everything about the machine, which is maintained: all but that the daemon's store fails.
    Machine,
}

impl Subject {
    fn is_of(&self, alarm: &Alarm) -> bool {
        match (self, &alarm.source) {
            (Self::Component(kind, id), AlarmSource::Diagnosis) => {
                alarm.kind == *kind && alarm.component == *id
            }
            (Self::Limit(id), AlarmSource::Limit(of)) => id == of,
            (Self::Channel(name), AlarmSource::Data) => {
                alarm.kind == ComponentKind::Sensor && alarm.component == *name
            }
            (Self::Machine, source) => *source != AlarmSource::Store,
            (Self::Component(..) | Self::Limit(_) | Self::Channel(_), _) => false,
        }
    }

    /// In words, for people and the audit.
    #[must_use]
    pub fn words(&self) -> String {
        match self {
            Self::Component(kind, id) => format!("{} {id}", kind.name()),
            Self::Limit(id) => format!("limit {id}"),
            Self::Channel(name) => format!("channel {name}"),
            Self::Machine => "the machine".to_owned(),
        }
    }
}

/// A silence in advance.
#[derive(Debug, Clone, PartialEq)]
pub struct Advance {
    /// Its number within the machine, never used again.
    pub number: u64,
    /// Of what.
    pub subject: Subject,
    /// Suppressed by design, or out of service.
    pub silence: Silence,
    /// Who said it, and why.
    pub by: Signature,
    /// When, UTC.
    pub since: Timestamp,
    /// When it ends; `None`: not by itself.
    pub until: Option<Deadline>,
}

impl Advance {
    /// Whether the machine is maintained.
    #[must_use]
    pub fn is_maintenance(&self) -> bool {
        self.subject == Subject::Machine
    }

    /// Whether the silence of an alarm comes from this one.
    fn is_behind(&self, alarm: &Alarm) -> bool {
        alarm.silencing.as_ref().is_some_and(|held| {
            held.silence == self.silence
                && (&held.author, &held.comment) == (&self.by.author, &self.by.comment)
                && held.until.map(|until| until.utc) == self.until.map(|until| until.utc)
        })
    }

    fn silencing(&self, since_s: f64) -> Silencing {
        let Signature { author, comment } = self.by.clone();
        Silencing { silence: self.silence, author, comment, since_s, until: self.until }
    }
}

/// A silence in advance as it is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Announcement {
    /// Of what.
    pub subject: Subject,
    /// Suppressed by design, or out of service; to shelve is for what stands.
    pub silence: Silence,
    /// When it ends.
    pub ends: Ends,
    /// Who says it.
    pub author: String,
    /// Why; may be empty.
    pub comment: String,
}

/// When a silence in advance is to end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Ends {
    /// When somebody ends it.
    ByHand,
    /// After so long, s.
    After(f64),
    /// At this time, UTC.
    At(Timestamp),
}

impl Ends {
    /// For how long from `now` on, s; `None`: until somebody ends it.
    fn after_s(self, now: Moment) -> Option<f64> {
        match self {
            Self::ByHand => None,
            Self::After(for_s) => Some(for_s),
            Self::At(utc) => Some(utc.0.saturating_sub(now.utc.0) as f64 * 1e-9),
        }
    }
}

/// Why a silence in advance was refused; nothing has changed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AdvanceError {
    /// It must be signed.
    #[error("the author of an action must not be empty")]
    NoAuthor,
    /// Author or comment is too long.
    #[error("{field} has {found} characters, at most {MAX_TEXT_CHARS} are allowed")]
    TextTooLong {
        /// Which text.
        field: &'static str,
        /// Its length.
        found: usize,
    },
    /// It cannot be silent so, or for such a time.
    #[error("{0}")]
    NotAllowed(String),
    /// The machine has no such thing.
    #[error("the machine has no {0} that could raise an alarm")]
    UnknownSubject(String),
    /// It is silent in advance already.
    #[error("{subject} is silent in advance already, by {author}: end silence {number} first")]
    Already {
        /// What.
        subject: String,
        /// By whom.
        author: String,
        /// Its number.
        number: u64,
    },
    /// As many as may be.
    #[error("there are {MAX_ADVANCE} silences in advance, as many as may be: end one first")]
    TooMany,
    /// There is none of this number.
    #[error("no silence {number} is said in advance: it is unknown or over")]
    Unknown {
        /// The number asked for.
        number: u64,
    },
}

fn signed(author: &str, comment: &str) -> Result<Signature, AdvanceError> {
    let (author, comment) = (author.trim(), comment.trim());
    if author.is_empty() {
        return Err(AdvanceError::NoAuthor);
    }
    for (field, text) in [("author", author), ("comment", comment)] {
        let found = text.chars().count();
        if found > MAX_TEXT_CHARS {
            return Err(AdvanceError::TextTooLong { field, found });
        }
    }
    Ok(Signature { author: author.to_owned(), comment: comment.to_owned() })
}

impl AlarmEngine {
    /// Silences in advance that hold, oldest first.
    #[must_use]
    pub fn advance(&self) -> &[Advance] {
        &self.advance
    }

    /// Says a silence in advance; gives it, and what that does to an alarm of it that stands.
    ///
    /// # Errors
    /// See [`AdvanceError`].
    pub fn announce(
        &mut self,
        wanted: &Announcement,
        now: Moment,
    ) -> Result<(Advance, Vec<AlarmEvent>), AdvanceError> {
        let by = signed(&wanted.author, &wanted.comment)?;
        let for_s = wanted.ends.after_s(now);
        check(wanted, for_s, &by)?;
        if !self.knows(&wanted.subject) {
            return Err(AdvanceError::UnknownSubject(wanted.subject.words()));
        }
        let replaced = self.take_replaced(&wanted.subject)?;
        if self.advance.len() >= MAX_ADVANCE {
            return Err(AdvanceError::TooMany);
        }
        let until = for_s.map(|for_s| Deadline {
            monotonic_s: now.monotonic_s + for_s,
            utc: now.utc.plus_seconds(for_s),
        });
        self.last_advance += 1;
        let said = Advance {
            number: self.last_advance,
            subject: wanted.subject.clone(),
            silence: wanted.silence,
            by: by.clone(),
            since: now.utc,
            until,
        };
        self.advance.push(said.clone());
        let mut moved = Vec::new();
        for alarm in self.alarms_mut().filter_map(Option::as_mut) {
            let input = AlarmInput::Silence(said.silence);
            let is_free = alarm.position().after(input, alarm.latching).is_ok()
                || replaced.as_ref().is_some_and(|before| before.is_behind(alarm));
            if said.subject.is_of(alarm) && is_free {
                alarm.silencing = Some(said.silencing(now.stream_s));
                alarm.changed_at_s = now.stream_s;
                moved.push(alarm.clone());
            }
        }
        let kind = EventKind::begin_of(said.silence);
        let record = |alarm| self.record(kind, now.stream_s, Some(by.clone()), alarm);
        let events = moved.into_iter().map(record).collect();
        Ok((said, events))
    }

    /// Takes away what the next one takes the place of: another time or reason of a maintenance.
    fn take_replaced(&mut self, subject: &Subject) -> Result<Option<Advance>, AdvanceError> {
        let found = self.advance.iter().enumerate().find(|(_, held)| held.subject == *subject);
        let Some((at, held)) = found else { return Ok(None) };
        if held.is_maintenance() {
            return Ok(Some(self.advance.remove(at)));
        }
        let (subject, author) = (subject.words(), held.by.author.clone());
        Err(AdvanceError::Already { subject, author, number: held.number })
    }

    /// The maintenance of the machine; `None`: there is none.
    #[must_use]
    pub fn maintenance(&self) -> Option<&Advance> {
        self.advance.iter().find(|held| held.is_maintenance())
    }

    /// Ends a silence in advance before its time, and that of the alarms behind it.
    ///
    /// # Errors
    /// See [`AdvanceError`].
    pub fn revoke(
        &mut self,
        number: u64,
        (author, comment): (&str, &str),
        now: Moment,
    ) -> Result<(Advance, Vec<AlarmEvent>), AdvanceError> {
        let by = signed(author, comment)?;
        let at = self.advance.iter().position(|held| held.number == number);
        let ended = self.advance.remove(at.ok_or(AdvanceError::Unknown { number })?);
        let mut moved = Vec::new();
        for slot in self.alarms_mut() {
            let is_behind =
                |alarm: &&mut Alarm| ended.subject.is_of(alarm) && ended.is_behind(alarm);
            let Some(alarm) = slot.as_mut().filter(is_behind) else { continue };
            let input = AlarmInput::EndOf(ended.silence);
            let Ok(after) = alarm.position().after(input, alarm.latching) else { continue };
            (alarm.state, alarm.silencing) = (after.life, None);
            alarm.changed_at_s = now.stream_s;
            moved.push(alarm.clone());
            if after.is_over() {
                *slot = None;
            }
        }
        let kind = EventKind::end_of(ended.silence);
        let mut events = Vec::new();
        for alarm in moved {
            let id = alarm.id;
            events.push(self.record(kind, now.stream_s, Some(by.clone()), alarm));
            events.extend(self.silence_again(id, now));
        }
        Ok((ended, events))
    }

    /// Silences an alarm whose silence has just ended, if another one said in advance holds.
    pub(super) fn silence_again(&mut self, id: u64, now: Moment) -> Option<AlarmEvent> {
        let all = self.advance.clone();
        let is_it = |alarm: &&mut Alarm| alarm.id == id && alarm.silencing.is_none();
        let alarm = self.alarms_mut().filter_map(Option::as_mut).find(is_it)?;
        let said = strongest(&all, alarm)?;
        alarm.silencing = Some(said.silencing(now.stream_s));
        let (kind, alarm) = (EventKind::begin_of(said.silence), alarm.clone());
        Some(self.record(kind, now.stream_s, Some(said.by.clone()), alarm))
    }

    /// Takes over what was said before a restart, or under other settings; what the machine does not have any more is
    /// forgotten with it.
    pub(super) fn take_over_advance(&mut self, advance: Vec<Advance>, last: u64) {
        self.last_advance = advance.iter().map(|one| one.number).fold(last, u64::max);
        self.advance = advance.into_iter().filter(|one| self.knows(&one.subject)).collect();
    }

    /// Forgets those whose time is over; their alarms have the same deadline.
    pub(super) fn end_advance(&mut self, now: Moment) {
        let is_over = |until: Deadline| now.monotonic_s >= until.monotonic_s;
        let over = self.advance.extract_if(.., |one| one.until.is_some_and(is_over));
        self.over.extend(over.filter(Advance::is_maintenance));
    }

    /// Maintenances that have ended by their time since this was last asked.
    pub fn take_ended_maintenances(&mut self) -> Vec<Advance> {
        std::mem::take(&mut self.over)
    }

    /// Silences alarms that have just been raised, if that was said.
    pub(super) fn silence_raised(&mut self, moved: &mut [(EventKind, Alarm)]) {
        if self.advance.is_empty() {
            return;
        }
        let raised = moved.iter_mut().filter(|(kind, _)| *kind == EventKind::Raised);
        for (_, alarm) in raised.filter(|(_, alarm)| alarm.silencing.is_none()) {
            let said = strongest(&self.advance, alarm);
            let Some(silencing) = said.map(|one| one.silencing(alarm.changed_at_s)) else {
                continue;
            };
            alarm.silencing = Some(silencing.clone());
            let is_it = |slot: &&mut Option<Alarm>| slot.as_ref().is_some_and(|a| a.id == alarm.id);
            if let Some(Some(standing)) = self.alarms_mut().find(is_it) {
                standing.silencing = Some(silencing);
            }
        }
    }

    fn knows(&self, subject: &Subject) -> bool {
        match subject {
            Subject::Component(kind, id) => self.stated.has(*kind, id),
            Subject::Limit(id) => self.stated.has_limit(id),
            Subject::Channel(name) => self.stated.has_channel(name),
            Subject::Machine => true,
        }
    }
}

/// The strongest of those that silence an alarm.
fn strongest<'a>(all: &'a [Advance], alarm: &Alarm) -> Option<&'a Advance> {
    all.iter().filter(|one| one.subject.is_of(alarm)).max_by_key(|one| one.silence)
}

/// Whether it can be silent so, for such a time.
fn check(wanted: &Announcement, for_s: Option<f64>, by: &Signature) -> Result<(), AdvanceError> {
    let not_allowed = |why: &str| Err(AdvanceError::NotAllowed(why.to_owned()));
    if wanted.silence == Silence::Shelved {
        return not_allowed("only suppressed and out_of_service can be said in advance");
    }
    // Written so that NaN is refused.
    if for_s.is_some_and(|for_s| !(for_s > 0.0 && for_s <= MAX_ADVANCE_S)) {
        return not_allowed("it must end later than now and within 31536000 s (a year)");
    }
    if wanted.subject != Subject::Machine {
        return Ok(());
    }
    if wanted.silence != Silence::OutOfService || for_s.is_none() {
        return not_allowed(
            "a machine is out of service as a whole, and for a time, while it is maintained",
        );
    }
    if by.comment.is_empty() {
        return not_allowed("say why the machine is maintained: the reason must not be empty");
    }
    Ok(())
}

#[cfg(test)]
#[path = "advance_tests.rs"]
mod tests;
