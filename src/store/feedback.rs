//! What people found of verdicts, beside the verdict as it was then. Nothing is ever learned from it by itself.
//!
//! One commit each, with its line in the audit: when it returns, it survives a kill.

use super::StoreError;
use super::names;
use super::opening;
use super::opening::failed;
use super::rows;
use super::rows::whole;
use super::sqlite;
use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::fault::State;
use crate::signal::Timestamp;
use rusqlite::Connection;
use rusqlite::OpenFlags;
use rusqlite::Row;
use rusqlite::params;
use std::path::Path;
use std::sync::Mutex;
use std::sync::PoisonError;

/// Entries kept; the oldest give way. About 50 MB.
pub const MAX_FEEDBACK: u64 = 100_000;

/// What somebody found of a verdict.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Finding {
    /// It was right.
    Confirmed,
    /// It was wrong.
    Wrong,
    /// Something else was the cause.
    OtherCause,
}

impl Finding {
    /// Every one.
    pub const ALL: [Self; 3] = [Self::Confirmed, Self::Wrong, Self::OtherCause];

    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Confirmed => "confirmed",
            Self::Wrong => "wrong",
            Self::OtherCause => "other_cause",
        }
    }
}

/// A verdict on a component as it was when somebody said something of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Judgement {
    /// State.
    pub state: State,
    /// Strongest fault.
    pub fault: Option<FaultMode>,
    /// Effect size.
    pub severity: Option<f64>,
    /// Probability that state and fault are right.
    pub confidence: Option<f64>,
    /// One plain sentence.
    pub why: String,
    /// When the newest sample was taken that it rests on, UTC; `None`: unknown.
    pub at: Option<Timestamp>,
    /// Hash of the configuration by which it was judged.
    pub judged_by: String,
}

/// What somebody found of a verdict.
#[derive(Debug, Clone, PartialEq)]
pub struct Feedback {
    /// Machine id.
    pub machine: String,
    /// When it was said, UTC.
    pub at: Timestamp,
    /// Who.
    pub author: String,
    /// What.
    pub finding: Finding,
    /// Kind and id of the component.
    pub component: (ComponentKind, String),
    /// The cause that was found, where the program has a name for it.
    pub found: Option<FaultMode>,
    /// In words; may be empty.
    pub note: String,
    /// Of which verdict.
    pub judgement: Judgement,
}

/// Which entries.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct FeedbackQuery {
    /// Of this machine.
    pub machine: String,
    /// With a number below this one.
    pub before: u64,
    /// At most so many.
    pub limit: usize,
}

/// Where it is kept.
pub trait FeedbackStore: Send + Sync {
    /// Keeps an entry and gives its number, which rises.
    ///
    /// # Errors
    /// When it cannot be stored; nothing has changed then.
    fn add(&self, entry: &Feedback) -> Result<u64, StoreError>;

    /// Entries with their numbers, newest first.
    ///
    /// # Errors
    /// When they cannot be read.
    fn list(&self, query: &FeedbackQuery) -> Result<Vec<(u64, Feedback)>, StoreError>;
}

/// Feedback in the state database.
#[derive(Debug)]
pub struct SqliteFeedback {
    connection: Mutex<Connection>,
}

impl SqliteFeedback {
    /// Joins the database in `directory`, which this process has open.
    ///
    /// # Errors
    /// When it cannot be opened.
    pub fn join(directory: &Path) -> Result<Self, StoreError> {
        let connection = opening::beside(&directory.join(sqlite::FILE))?;
        Ok(Self { connection: Mutex::new(connection) })
    }

    /// Opens the database in `directory` for reading, beside a daemon or without; `None`: there is none.
    ///
    /// # Errors
    /// When it cannot be used, or a daemon with another schema has it.
    pub fn read_only(directory: &Path) -> Result<Option<Self>, StoreError> {
        // Checks it, and brings it up to date where no daemon runs.
        if sqlite::read_only(directory)?.is_none() {
            return Ok(None);
        }
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let opened = Connection::open_with_flags(directory.join(sqlite::FILE), flags);
        let connection = opened.map_err(|source| failed("opening the store", source))?;
        Ok(Some(Self { connection: Mutex::new(connection) }))
    }

    fn add_and_keep(&self, entry: &Feedback, max: u64) -> rusqlite::Result<u64> {
        let mut connection = self.connection.lock().unwrap_or_else(PoisonError::into_inner);
        let transaction = connection.transaction()?;
        let Feedback { machine, at, author, finding, component, found, note, judgement } = entry;
        let (kind, id) = (component.0.name(), &component.1);
        transaction.execute(
            "INSERT INTO feedback (machine, recorded_utc, author, outcome, kind, component, found, note, state,
                fault, severity, confidence, why, judged_utc, judged_by)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13, ?14, ?15)",
            params![
                machine,
                at.0,
                author,
                finding.name(),
                kind,
                id,
                found.map(FaultMode::name),
                note,
                judgement.state.name(),
                judgement.fault.map(FaultMode::name),
                judgement.severity,
                judgement.confidence,
                judgement.why,
                judgement.at.map(|at| at.0),
                judgement.judged_by
            ],
        )?;
        let number = rows::count(transaction.last_insert_rowid());
        transaction
            .execute("DELETE FROM feedback WHERE id <= ?1", [whole(number.saturating_sub(max))])?;
        let comment = format!("{kind} {id}, {}: {note}", finding.name());
        transaction.execute(
            "INSERT INTO audit (recorded_utc, author, action, machine, comment)
             VALUES (?1, ?2, 'feedback', ?3, ?4)",
            params![at.0, author, machine, comment],
        )?;
        transaction.commit()?;
        Ok(number)
    }
}

impl FeedbackStore for SqliteFeedback {
    fn add(&self, entry: &Feedback) -> Result<u64, StoreError> {
        let done = self.add_and_keep(entry, MAX_FEEDBACK);
        done.map_err(|source| failed("storing feedback", source))
    }

    fn list(&self, query: &FeedbackQuery) -> Result<Vec<(u64, Feedback)>, StoreError> {
        let reading = |source| failed("reading feedback", source);
        let connection = self.connection.lock().unwrap_or_else(PoisonError::into_inner);
        let mut statement = connection
            .prepare_cached(
                "SELECT * FROM feedback WHERE machine = ?1 AND id < ?2 ORDER BY id DESC LIMIT ?3",
            )
            .map_err(reading)?;
        let limit = i64::try_from(query.limit).unwrap_or(i64::MAX);
        let found = statement.query(params![query.machine, whole(query.before), limit]);
        let mut found = found.map_err(reading)?;
        let mut entries = Vec::new();
        while let Some(row) = found.next().map_err(reading)? {
            entries.push((rows::count(rows::get(row, "id")?), entry(row)?));
        }
        Ok(entries)
    }
}

fn entry(row: &Row<'_>) -> Result<Feedback, StoreError> {
    let fault = |name: &'static str| -> Result<Option<FaultMode>, StoreError> {
        let text: Option<String> = rows::get(row, name)?;
        text.map(|text| rows::known("fault", text, names::fault)).transpose()
    };
    let finding = |text: &str| Finding::ALL.into_iter().find(|one| one.name() == text);
    let kind = rows::known("kind", rows::get(row, "kind")?, names::component_kind)?;
    Ok(Feedback {
        machine: rows::get(row, "machine")?,
        at: Timestamp(rows::get(row, "recorded_utc")?),
        author: rows::get(row, "author")?,
        finding: rows::known("outcome", rows::get(row, "outcome")?, finding)?,
        component: (kind, rows::get(row, "component")?),
        found: fault("found")?,
        note: rows::get(row, "note")?,
        judgement: Judgement {
            state: rows::known("state", rows::get(row, "state")?, names::health)?,
            fault: fault("fault")?,
            severity: rows::get(row, "severity")?,
            confidence: rows::get(row, "confidence")?,
            why: rows::get(row, "why")?,
            at: rows::get::<Option<i64>>(row, "judged_utc")?.map(Timestamp),
            judged_by: rows::get(row, "judged_by")?,
        },
    })
}

#[cfg(test)]
mod tests {
    use super::super::tests::open;
    use super::*;
    use tempfile::TempDir;

    fn said(machine: &str, finding: Finding, found: Option<FaultMode>) -> Feedback {
        Feedback {
            machine: machine.to_owned(),
            at: Timestamp(1_700_000_000_000_000_000),
            author: "M. Ito".to_owned(),
            finding,
            component: (ComponentKind::Bearing, "right".to_owned()),
            found,
            note: "spalled, 3 mm".to_owned(),
            judgement: Judgement {
                state: State::Damaged,
                fault: Some(FaultMode::InnerRace),
                severity: Some(0.62),
                confidence: Some(0.97),
                why: "BPFI stands out".to_owned(),
                at: Some(Timestamp(1_699_999_999_000_000_000)),
                judged_by: "h".to_owned(),
            },
        }
    }

    #[test]
    fn what_was_said_is_found_again_newest_first_and_page_by_page() {
        let dir = TempDir::new().unwrap();
        let (store, _) = open(dir.path());
        let feedback = SqliteFeedback::join(dir.path()).unwrap();
        let all = [
            said("rig-1", Finding::Confirmed, None),
            said("rig-2", Finding::Wrong, None),
            said("rig-1", Finding::OtherCause, Some(FaultMode::Misalignment)),
        ];
        let numbers: Vec<u64> = all.iter().map(|one| feedback.add(one).unwrap()).collect();
        assert_eq!(numbers, [1, 2, 3]);
        let query = |before, limit| FeedbackQuery { machine: "rig-1".to_owned(), before, limit };
        let found = feedback.list(&query(u64::MAX, 9)).unwrap();
        assert_eq!(found, [(3, all[2].clone()), (1, all[0].clone())]);
        assert_eq!(feedback.list(&query(u64::MAX, 1)).unwrap()[0].0, 3);
        assert_eq!(feedback.list(&query(3, 9)).unwrap()[0].0, 1);
        let audit: String = store
            .connection()
            .query_row("SELECT action || ' ' || comment FROM audit WHERE id = 3", (), |row| {
                row.get(0)
            })
            .unwrap();
        assert_eq!(audit, "feedback bearing right, other_cause: spalled, 3 mm");
        drop(store);
        // Without a daemon it can be read, too.
        let alone = SqliteFeedback::read_only(dir.path()).unwrap().unwrap();
        assert_eq!(alone.list(&query(u64::MAX, 9)).unwrap(), found);
        assert!(alone.add(&all[0]).is_err(), "but not written");
        assert!(SqliteFeedback::read_only(&dir.path().join("no")).unwrap().is_none());
    }

    #[test]
    fn the_oldest_give_way() {
        let dir = TempDir::new().unwrap();
        let (_store, _) = open(dir.path());
        let feedback = SqliteFeedback::join(dir.path()).unwrap();
        for _ in 0..5 {
            feedback.add_and_keep(&said("rig-1", Finding::Wrong, None), 3).unwrap();
        }
        let query = FeedbackQuery { machine: "rig-1".to_owned(), before: u64::MAX, limit: 9 };
        let numbers: Vec<u64> =
            feedback.list(&query).unwrap().into_iter().map(|(number, _)| number).collect();
        assert_eq!(numbers, [5, 4, 3]);
    }
}
