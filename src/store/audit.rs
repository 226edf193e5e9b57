//! Who did what, and which configurations ran, page by page.

use super::ConfigurationEntry;
use super::StoreError;
use super::events::SqliteEvents;
use super::opening::failed;
use super::rows;
use super::rows::whole;
use crate::signal::Timestamp;
use rusqlite::Row;
use rusqlite::params;

/// One act, as it was audited.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AuditEntry {
    /// Its number; rises.
    pub number: u64,
    /// When, UTC.
    pub at: Timestamp,
    /// Who.
    pub author: String,
    /// What: a transition of an alarm, or what was done to a baseline.
    pub action: String,
    /// Of this machine.
    pub machine: Option<String>,
    /// To this alarm.
    pub alarm: Option<u64>,
    /// To this baseline.
    pub baseline: Option<String>,
    /// Why; may be empty.
    pub comment: String,
}

/// Which acts.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct AuditQuery {
    /// With a number below this one.
    pub before: u64,
    /// On these machines.
    pub machines: Option<Vec<String>>,
    /// By this author.
    pub author: Option<String>,
    /// At this time or later.
    pub since: Option<Timestamp>,
    /// At most so many.
    pub limit: usize,
}

/// The reading side of the audit.
pub trait AuditLog: Send + Sync {
    /// Acts, newest first.
    ///
    /// # Errors
    /// When they cannot be read.
    fn audit(&self, query: &AuditQuery) -> Result<Vec<AuditEntry>, StoreError>;

    /// Configurations with a number below `before`, newest first, with their numbers.
    ///
    /// # Errors
    /// When they cannot be read.
    fn configurations(
        &self,
        before: u64,
        limit: usize,
    ) -> Result<Vec<(u64, ConfigurationEntry)>, StoreError>;
}

fn limited(limit: usize) -> i64 {
    i64::try_from(limit).unwrap_or(i64::MAX)
}

impl AuditLog for SqliteEvents {
    fn audit(&self, query: &AuditQuery) -> Result<Vec<AuditEntry>, StoreError> {
        let reading = |source| failed("reading the audit", source);
        let connection = self.connection();
        let mut statement = connection
            .prepare_cached(
                "SELECT id, recorded_utc, author, action, machine, number, baseline, comment FROM audit
                 WHERE id < ?1 AND (?2 IS NULL OR instr(?2, char(10) || machine || char(10)) > 0)
                 AND (?3 IS NULL OR author = ?3)
                 AND (?4 IS NULL OR recorded_utc >= ?4) ORDER BY id DESC LIMIT ?5",
            )
            .map_err(reading)?;
        let entry = |row: &Row<'_>| {
            Ok(AuditEntry {
                number: rows::count(row.get(0)?),
                at: Timestamp(row.get(1)?),
                author: row.get(2)?,
                action: row.get(3)?,
                machine: row.get(4)?,
                alarm: row.get::<_, Option<i64>>(5)?.map(rows::count),
                baseline: row.get(6)?,
                comment: row.get(7)?,
            })
        };
        let found = statement.query_map(
            params![
                whole(query.before),
                rows::names(query.machines.as_deref()),
                query.author,
                query.since.map(|since| since.0),
                limited(query.limit)
            ],
            entry,
        );
        found.and_then(Iterator::collect).map_err(reading)
    }

    fn configurations(
        &self,
        before: u64,
        limit: usize,
    ) -> Result<Vec<(u64, ConfigurationEntry)>, StoreError> {
        let reading = |source| failed("reading the configurations", source);
        let connection = self.connection();
        let mut statement = connection
            .prepare_cached(
                "SELECT id, hash, version, since_utc FROM configuration WHERE id < ?1
                 ORDER BY id DESC LIMIT ?2",
            )
            .map_err(reading)?;
        let entry = |row: &Row<'_>| {
            let since = Timestamp(row.get(3)?);
            let entry = ConfigurationEntry { hash: row.get(1)?, version: row.get(2)?, since };
            Ok((rows::count(row.get(0)?), entry))
        };
        let found = statement.query_map(params![whole(before), limited(limit)], entry);
        found.and_then(Iterator::collect).map_err(reading)
    }
}

#[cfg(test)]
mod tests {
    use super::super::StateStore;
    use super::super::tests::batch;
    use super::super::tests::event;
    use super::super::tests::full;
    use super::super::tests::open;
    use super::*;
    use crate::alarms::EventKind;
    use tempfile::TempDir;

    #[test]
    fn acts_and_configurations_are_read_page_by_page() {
        let dir = TempDir::new().unwrap();
        let (mut store, _) = open(dir.path());
        let acts = (1..=5).map(|n| event(n, EventKind::Shelved, &full(n))).collect();
        store.keep(&[batch(acts)]).unwrap();
        for n in 0..3 {
            let (hash, version) = (format!("h{n}"), "0.1.0".to_owned());
            let entry = ConfigurationEntry { hash, version, since: Timestamp(n) };
            store.note_configuration(&entry).unwrap();
        }
        let log = SqliteEvents::join(dir.path()).unwrap();
        let query = AuditQuery { before: u64::MAX, limit: 3, ..AuditQuery::default() };
        let alarms = |query: &AuditQuery| -> Vec<u64> {
            log.audit(query).unwrap().iter().filter_map(|entry| entry.alarm).collect()
        };
        assert_eq!(alarms(&query), [5, 4, 3]);
        assert_eq!(alarms(&AuditQuery { before: 3, ..query.clone() }), [2, 1]);
        let found = log.audit(&query).unwrap().remove(0);
        assert_eq!((found.author.as_str(), found.action.as_str()), ("A. Berg", "shelved"));
        assert_eq!((found.machine.as_deref(), found.comment.as_str()), (Some("rig-1"), "new oil"));
        let two = Some(vec!["rig-2".to_owned(), "rig-1".to_owned()]);
        assert_eq!(alarms(&AuditQuery { machines: two, ..query.clone() }), [5, 4, 3]);
        let later = found.at.plus_seconds(1.0);
        for none in [
            AuditQuery { machines: Some(vec!["rig-2".to_owned()]), ..query.clone() },
            AuditQuery { machines: Some(vec!["ig-1".to_owned()]), ..query.clone() },
            AuditQuery { machines: Some(Vec::new()), ..query.clone() },
            AuditQuery { author: Some("M. Ito".to_owned()), ..query.clone() },
            AuditQuery { since: Some(later), ..query },
        ] {
            assert!(alarms(&none).is_empty(), "{none:?}");
        }
        let hashes = |before, limit| -> Vec<String> {
            let found = log.configurations(before, limit).unwrap();
            found.into_iter().map(|(_, entry)| entry.hash).collect()
        };
        assert_eq!(hashes(u64::MAX, 2), ["h2", "h1"]);
        assert_eq!(hashes(2, 2), ["h0"]);
    }
}
