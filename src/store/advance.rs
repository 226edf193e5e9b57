//! Silences in advance as rows, and back.

use super::Batch;
use super::StoreError;
use super::names;
use super::opening::failed;
use super::rows;
use super::rows::whole;
use crate::alarms::Advance;
use crate::alarms::Deadline;
use crate::alarms::Moment;
use crate::alarms::Signature;
use crate::alarms::Subject;
use crate::signal::Timestamp;
use rusqlite::Connection;
use rusqlite::OptionalExtension;
use rusqlite::Row;
use rusqlite::Transaction;
use rusqlite::params;

/// What is silent, as texts: of what sort it is, the kind of a component, and its name.
fn texts(subject: &Subject) -> (&'static str, Option<&'static str>, &str) {
    match subject {
        Subject::Component(kind, id) => ("component", Some(kind.name()), id),
        Subject::Limit(id) => ("limit", None, id),
        Subject::Channel(name) => ("channel", None, name),
        Subject::Machine => ("machine", None, ""),
    }
}

/// Stores all silences in advance of a machine, if the batch has them, and what was done to one.
pub(super) fn write(transaction: &Transaction<'_>, batch: &Batch) -> rusqlite::Result<()> {
    let machine = &batch.machine;
    if let Some((all, last)) = &batch.advance {
        transaction.execute("DELETE FROM advance WHERE machine = ?1", [machine])?;
        transaction.execute(
            "INSERT OR REPLACE INTO advance_last (machine, number) VALUES (?1, ?2)",
            params![machine, whole(*last)],
        )?;
        let mut insert = transaction.prepare_cached(
            "INSERT INTO advance (machine, number, sort, kind, name, silence, author, comment, since_utc,
                until_utc, remaining_s) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11)",
        )?;
        for one in all {
            let (sort, kind, name) = texts(&one.subject);
            let left_s = |until: Deadline| (until.monotonic_s - batch.now.monotonic_s).max(0.0);
            insert.execute(params![
                machine,
                whole(one.number),
                sort,
                kind,
                name,
                one.silence.name(),
                one.by.author,
                one.by.comment,
                one.since.0,
                one.until.map(|until| until.utc.0),
                one.until.map(left_s)
            ])?;
        }
    }
    for (action, by) in &batch.acts {
        transaction.execute(
            "INSERT INTO audit (recorded_utc, author, action, machine, comment) VALUES (?1, ?2, ?3, ?4, ?5)",
            params![batch.now.utc.0, by.author, action, machine, by.comment],
        )?;
    }
    Ok(())
}

/// The silences in advance of a machine at `now`, oldest first, and the highest number so far.
pub(super) fn read(
    connection: &Connection,
    machine: &str,
    now: Moment,
) -> Result<(Vec<Advance>, u64), StoreError> {
    let reading = |source| failed("reading silences in advance", source);
    let last: Option<i64> = connection
        .query_row("SELECT number FROM advance_last WHERE machine = ?1", [machine], |row| {
            row.get(0)
        })
        .optional()
        .map_err(reading)?;
    let mut statement = connection
        .prepare("SELECT * FROM advance WHERE machine = ?1 ORDER BY number")
        .map_err(reading)?;
    let mut found = statement.query([machine]).map_err(reading)?;
    let mut all = Vec::new();
    while let Some(row) = found.next().map_err(reading)? {
        all.push(one(row, now)?);
    }
    Ok((all, rows::count(last.unwrap_or(0))))
}

fn one(row: &Row<'_>, now: Moment) -> Result<Advance, StoreError> {
    let (sort, name): (String, String) = (rows::get(row, "sort")?, rows::get(row, "name")?);
    let kind: Option<String> = rows::get(row, "kind")?;
    let subject = match (sort.as_str(), kind) {
        ("component", Some(kind)) => {
            Subject::Component(rows::known("kind", kind, names::component_kind)?, name)
        }
        ("limit", None) => Subject::Limit(name),
        ("channel", None) => Subject::Channel(name),
        ("machine", None) => Subject::Machine,
        _ => return Err(StoreError::Unknown { what: "what is silent", found: sort }),
    };
    let until: Option<i64> = rows::get(row, "until_utc")?;
    let stored_s = rows::get::<Option<f64>>(row, "remaining_s")?.unwrap_or_default();
    Ok(Advance {
        number: rows::count(rows::get(row, "number")?),
        subject,
        silence: rows::known("silence", rows::get(row, "silence")?, names::silence)?,
        by: Signature { author: rows::get(row, "author")?, comment: rows::get(row, "comment")? },
        since: Timestamp(rows::get(row, "since_utc")?),
        until: until.map(|until| rows::deadline(until, stored_s, now)),
    })
}

#[cfg(test)]
mod tests {
    use super::super::tests::batch;
    use super::super::tests::open;
    use super::super::*;
    use crate::alarms::Deadline;
    use crate::alarms::Subject;
    use crate::alarms::state::Silence;
    use crate::diagnosis::fault::ComponentKind;
    use tempfile::TempDir;

    #[test]
    fn silences_in_advance_are_found_again_with_what_is_left_of_their_time() {
        let dir = TempDir::new().unwrap();
        let (mut store, archive) = open(dir.path());
        let plain = batch(Vec::new());
        let (since, by) =
            (plain.now.utc, Signature { author: "A".to_owned(), comment: "b".to_owned() });
        let until =
            Deadline { monotonic_s: plain.now.monotonic_s + 60.0, utc: since.plus_seconds(60.0) };
        let one = |number, subject, silence, until| Advance {
            number,
            subject,
            silence,
            by: by.clone(),
            since,
            until,
        };
        let bearing = Subject::Component(ComponentKind::Bearing, "right".to_owned());
        let all = vec![
            one(2, bearing, Silence::Suppressed, None),
            one(3, Subject::Limit("v".to_owned()), Silence::OutOfService, Some(until)),
            one(5, Subject::Channel("x".to_owned()), Silence::Suppressed, None),
        ];
        let acts = vec![("silence_announced", by.clone())];
        store.keep(&[Batch { advance: Some((all.clone(), 7)), acts, ..plain.clone() }]).unwrap();
        // A batch that says nothing of them changes nothing.
        store.keep(std::slice::from_ref(&plain)).unwrap();
        let load = |monotonic_s: f64, passed_s: f64| {
            let now = Moment { stream_s: 0.0, monotonic_s, utc: since.plus_seconds(passed_s) };
            archive.load("rig-1", &plain.stream, now, 10).unwrap()
        };
        let kept = load(plain.now.monotonic_s, 0.0);
        assert_eq!((kept.advance, kept.last_advance), (all.clone(), 7));
        // After a restart 20 s later, by another monotonic clock; a clock that was set back keeps none longer.
        let left_s = |kept: Kept| kept.advance[1].until.unwrap().monotonic_s - 5.0;
        assert!((left_s(load(5.0, 20.0)) - 40.0).abs() < 1e-6);
        assert!((left_s(load(5.0, -3600.0)) - 60.0).abs() < 1e-6);
        let audit: String = store
            .connection()
            .query_row("SELECT author || action || comment FROM audit", (), |row| row.get(0))
            .unwrap();
        assert_eq!(audit, "Asilence_announcedb");
        store.keep(&[Batch { advance: Some((Vec::new(), 7)), ..plain.clone() }]).unwrap();
        let kept = load(0.0, 0.0);
        assert_eq!((kept.advance.len(), kept.last_advance), (0, 7));
    }
}
