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

/// A silence in advance as it is asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Announcement {
    /// Of what.
    pub subject: Subject,
    /// Suppressed by design, or out of service; to shelve is for what stands.
    pub silence: Silence,
    /// For how long, s; `None`: until somebody ends it.
    pub for_s: Option<f64>,
    /// Who says it.
    pub author: String,
    /// Why; may be empty.
    pub comment: String,
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
        let not_allowed = |why: &str| Err(AdvanceError::NotAllowed(why.to_owned()));
        if wanted.silence == Silence::Shelved {
            return not_allowed("only suppressed and out_of_service can be said in advance");
        }
        // Written so that NaN is refused.
        if wanted.for_s.is_some_and(|for_s| !(for_s > 0.0 && for_s <= MAX_ADVANCE_S)) {
            return not_allowed("for_s must be above 0 and at most 31536000 s (a year)");
        }
        if !self.knows(&wanted.subject) {
            return Err(AdvanceError::UnknownSubject(wanted.subject.words()));
        }
        if let Some(held) = self.advance.iter().find(|held| held.subject == wanted.subject) {
            let (subject, author) = (wanted.subject.words(), held.by.author.clone());
            return Err(AdvanceError::Already { subject, author, number: held.number });
        }
        if self.advance.len() >= MAX_ADVANCE {
            return Err(AdvanceError::TooMany);
        }
        let until = wanted.for_s.map(|for_s| Deadline {
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
            let silenced = alarm.position().after(input, alarm.latching);
            if let (true, Ok(_)) = (said.subject.is_of(alarm), silenced) {
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
            let Some(alarm) = slot.as_mut().filter(|alarm| ended.subject.is_of(alarm)) else {
                continue;
            };
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
        let record = |alarm| self.record(kind, now.stream_s, Some(by.clone()), alarm);
        let events = moved.into_iter().map(record).collect();
        Ok((ended, events))
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
        self.advance.retain(|one| !one.until.is_some_and(is_over));
    }

    /// Silences alarms that have just been raised, if that was said.
    pub(super) fn silence_raised(&mut self, moved: &mut [(EventKind, Alarm)]) {
        if self.advance.is_empty() {
            return;
        }
        let raised = moved.iter_mut().filter(|(kind, _)| *kind == EventKind::Raised);
        for (_, alarm) in raised.filter(|(_, alarm)| alarm.silencing.is_none()) {
            let said = self.advance.iter().find(|one| one.subject.is_of(alarm));
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
        }
    }
}

impl Advance {
    fn silencing(&self, since_s: f64) -> Silencing {
        let Signature { author, comment } = self.by.clone();
        Silencing { silence: self.silence, author, comment, since_s, until: self.until }
    }
}

#[cfg(test)]
#[path = "advance_tests.rs"]
mod tests;
