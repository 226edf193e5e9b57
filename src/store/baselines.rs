//! Signed baselines in the state database, on a connection of their own.
//!
//! An act is one commit with its line in the audit: when it returns, it survives a kill; when it fails,
//! nothing has changed. Unlike alarms nothing waits in memory. The command line writes here too while a
//! daemon runs, which sees it by [`BaselineStore::version`].

use super::Act;
use super::BaselineStore;
use super::Held;
use super::StoreError;
use super::opening;
use super::opening::failed;
use super::rows::whole;
use super::sqlite;
use crate::diagnosis::baseline::OperatingPoint;
use crate::diagnosis::baseline::Record;
use crate::diagnosis::baseline::Usual;
use crate::diagnosis::baseline::signed::Signed;
use crate::signal::Timestamp;
use crate::units::Hz;
use rusqlite::Connection;
use rusqlite::OptionalExtension;
use rusqlite::Transaction;
use rusqlite::TransactionBehavior;
use rusqlite::params;
use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::MutexGuard;
use std::sync::PoisonError;

/// The connection for baselines.
#[derive(Debug)]
pub struct SqliteBaselines {
    connection: Mutex<Connection>,
    /// Held where no daemon runs.
    _lock: Option<File>,
}

impl SqliteBaselines {
    /// Joins the database in `directory`, which this process has open.
    ///
    /// # Errors
    /// When it cannot be opened.
    pub fn join(directory: &Path) -> Result<Self, StoreError> {
        let connection = opening::beside(&directory.join(sqlite::FILE))?;
        Ok(Self { connection: Mutex::new(connection), _lock: None })
    }

    /// Opens the database in `directory`: as its only user if no daemon has it, else beside the daemon.
    ///
    /// # Errors
    /// When it cannot be used, or a daemon with another schema has it.
    pub fn open(directory: &Path) -> Result<Self, StoreError> {
        match opening::alone(directory) {
            Ok((connection, lock)) => {
                Ok(Self { connection: Mutex::new(connection), _lock: Some(lock) })
            }
            Err(StoreError::InUse { .. }) => Self::join(directory),
            Err(error) => Err(error),
        }
    }

    /// The connection is consistent between any two statements, so a poisoned lock is as good.
    fn connection(&self) -> MutexGuard<'_, Connection> {
        self.connection.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Does `work` and writes its line in the audit, both or neither.
    fn commit(
        &self,
        (action, machine, id): (&str, &str, &str),
        act: &Act<'_>,
        work: impl FnOnce(&Transaction<'_>) -> rusqlite::Result<bool>,
    ) -> Result<bool, StoreError> {
        let mut connection = self.connection();
        let done = || -> rusqlite::Result<bool> {
            let transaction = connection.transaction()?;
            if !work(&transaction)? {
                return Ok(false);
            }
            audit(&transaction, (action, machine, id), act)?;
            transaction.commit()?;
            Ok(true)
        };
        done().map_err(|source| failed("storing a baseline", source))
    }
}

fn audit(
    transaction: &Transaction<'_>,
    (action, machine, id): (&str, &str, &str),
    act: &Act<'_>,
) -> rusqlite::Result<()> {
    let mut insert = transaction.prepare_cached(
        "INSERT INTO audit (recorded_utc, author, action, machine, comment, baseline)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
    )?;
    insert.execute(params![act.at.0, act.author, action, machine, act.comment, id]).map(drop)
}

/// Marks a baseline as used, and those it takes the place of as not.
fn use_instead(
    transaction: &Transaction<'_>,
    (machine, id): (&str, &str),
    replaced: &[Arc<str>],
) -> rusqlite::Result<bool> {
    let mut set = transaction
        .prepare_cached("UPDATE baseline SET active = 0 WHERE machine = ?1 AND id = ?2")?;
    for other in replaced.iter().filter(|other| ***other != *id) {
        set.execute(params![machine, &**other])?;
    }
    // Whoever activates it says that it holds for the machine as it is described now.
    let sql = "UPDATE baseline SET active = 1, described = NULL WHERE machine = ?1 AND id = ?2";
    Ok(transaction.execute(sql, [machine, id])? > 0)
}

fn write(transaction: &Transaction<'_>, signed: &Signed) -> rusqlite::Result<()> {
    let id = &*signed.id;
    transaction.execute(
        "INSERT INTO baseline (id, machine, author, comment, at_utc, active)
         VALUES (?1, ?2, ?3, ?4, ?5, 0)",
        params![id, signed.machine, signed.author, signed.comment, signed.at.0],
    )?;
    for (number, record) in (0_i64..).zip(&signed.records) {
        let speed = record.point.speed.map(|speed| speed.0);
        transaction.execute(
            "INSERT INTO baseline_record (baseline, number, name, speed_hz, load, n_windows)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
            params![id, number, record.name, speed, record.point.load, of(record.n_windows)],
        )?;
        let mut insert = transaction.prepare_cached(
            "INSERT INTO baseline_left_out (baseline, number, reason, n) VALUES (?1, ?2, ?3, ?4)",
        )?;
        for (reason, n) in &record.left_out {
            insert.execute(params![id, number, reason, of(*n)])?;
        }
        let mut insert = transaction.prepare_cached(
            "INSERT INTO baseline_feature
                (baseline, number, channel, feature, log_value, log_scatter, n_windows)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)",
        )?;
        for ((channel, feature), usual) in &record.usual {
            let Usual { log_value, log_scatter, n_windows } = *usual;
            let n_windows = of(n_windows);
            insert.execute(params![
                id,
                number,
                channel,
                feature,
                log_value,
                log_scatter,
                n_windows
            ])?;
        }
    }
    Ok(())
}

fn of(count: usize) -> i64 {
    whole(count as u64)
}

fn count(number: i64) -> usize {
    usize::try_from(number).unwrap_or(0)
}

fn read(connection: &Connection, machine: &str) -> rusqlite::Result<Vec<Held>> {
    let mut statement = connection.prepare_cached(
        "SELECT id, author, comment, at_utc, active FROM baseline WHERE machine = ?1
         ORDER BY at_utc DESC, id",
    )?;
    let heads = statement.query_map([machine], |row| {
        let signed = Signed {
            id: Arc::from(row.get::<_, String>(0)?),
            machine: machine.to_owned(),
            author: row.get(1)?,
            comment: row.get(2)?,
            at: Timestamp(row.get(3)?),
            records: Vec::new(),
        };
        Ok(Held { signed, is_active: row.get(4)?, is_intact: false })
    })?;
    let mut held = heads.collect::<rusqlite::Result<Vec<_>>>()?;
    for one in &mut held {
        one.signed.records = records(connection, &one.signed.id)?;
        one.is_intact = one.signed.is_intact();
    }
    Ok(held)
}

fn records(connection: &Connection, id: &Arc<str>) -> rusqlite::Result<Vec<Record>> {
    let mut statement = connection.prepare_cached(
        "SELECT number, name, speed_hz, load, n_windows FROM baseline_record WHERE baseline = ?1
         ORDER BY number",
    )?;
    let rows = statement.query_map([&**id], |row| {
        let speed: Option<f64> = row.get(2)?;
        let record = Record {
            name: row.get(1)?,
            baseline: Some(Arc::clone(id)),
            point: OperatingPoint { speed: speed.map(Hz), load: row.get(3)? },
            n_windows: count(row.get(4)?),
            ..Record::default()
        };
        Ok((row.get::<_, i64>(0)?, record))
    })?;
    let mut found = Vec::new();
    for row in rows {
        let (number, mut record) = row?;
        record.left_out = left_out(connection, id, number)?;
        record.usual = usual(connection, id, number)?;
        found.push(record);
    }
    Ok(found)
}

fn left_out(
    connection: &Connection,
    id: &str,
    number: i64,
) -> rusqlite::Result<BTreeMap<String, usize>> {
    let mut statement = connection.prepare_cached(
        "SELECT reason, n FROM baseline_left_out WHERE baseline = ?1 AND number = ?2",
    )?;
    let rows = statement
        .query_map(params![id, number], |row| Ok((row.get::<_, String>(0)?, count(row.get(1)?))))?;
    rows.collect()
}

fn usual(
    connection: &Connection,
    id: &str,
    number: i64,
) -> rusqlite::Result<BTreeMap<(String, String), Usual>> {
    let mut statement = connection.prepare_cached(
        "SELECT channel, feature, log_value, log_scatter, n_windows FROM baseline_feature
         WHERE baseline = ?1 AND number = ?2",
    )?;
    let rows = statement.query_map(params![id, number], |row| {
        let (log_value, log_scatter) = (row.get(2)?, row.get(3)?);
        let usual = Usual { log_value, log_scatter, n_windows: count(row.get(4)?) };
        Ok(((row.get::<_, String>(0)?, row.get::<_, String>(1)?), usual))
    })?;
    rows.collect()
}

impl BaselineStore for SqliteBaselines {
    fn baselines(&self, machine: &str) -> Result<Vec<Held>, StoreError> {
        let mut connection = self.connection();
        // One snapshot, whatever another process commits meanwhile.
        let begun = connection.transaction_with_behavior(TransactionBehavior::Deferred);
        let snapshot = begun.and_then(|transaction| read(&transaction, machine));
        snapshot.map_err(|source| failed("reading the baselines", source))
    }

    fn learn(&self, signed: &Signed, replaced: &[Arc<str>]) -> Result<(), StoreError> {
        let (machine, id) = (&*signed.machine, &*signed.id);
        let act = Act { author: &signed.author, comment: &signed.comment, at: signed.at };
        let work = |transaction: &Transaction<'_>| {
            write(transaction, signed)?;
            use_instead(transaction, (machine, id), replaced)
        };
        self.commit(("baseline_learned", machine, id), &act, work).map(drop)
    }

    fn activate(
        &self,
        (machine, id): (&str, &str),
        replaced: &[Arc<str>],
        act: &Act<'_>,
    ) -> Result<bool, StoreError> {
        let work =
            |transaction: &Transaction<'_>| use_instead(transaction, (machine, id), replaced);
        self.commit(("baseline_activated", machine, id), act, work)
    }

    fn retire(&self, machine: &str, ids: &[String], act: &Act<'_>) -> Result<(), StoreError> {
        let mut connection = self.connection();
        let mut done = || -> rusqlite::Result<()> {
            let transaction = connection.transaction()?;
            for id in ids {
                let n = transaction.execute(
                    "UPDATE baseline SET active = 0 WHERE machine = ?1 AND id = ?2 AND active = 1",
                    [machine, id],
                )?;
                if n > 0 {
                    audit(&transaction, ("baseline_stale", machine, id), act)?;
                }
            }
            transaction.commit()
        };
        done().map_err(|source| failed("marking baselines as stale", source))
    }

    fn described(&self, machine: &str) -> Result<Vec<(String, Option<String>)>, StoreError> {
        let connection = self.connection();
        let found = || -> rusqlite::Result<Vec<(String, Option<String>)>> {
            connection
                .prepare(
                    "SELECT id, described FROM baseline WHERE machine = ?1 AND active = 1 ORDER BY id",
                )?
                .query_map([machine], |row| Ok((row.get(0)?, row.get(1)?)))?
                .collect()
        };
        found().map_err(|source| failed("reading what baselines were used with", source))
    }

    fn describe(&self, machine: &str, text: &str) -> Result<(), StoreError> {
        let sql = "UPDATE baseline SET described = ?2
                   WHERE machine = ?1 AND active = 1 AND described IS NULL";
        let done = self.connection().execute(sql, [machine, text]);
        done.map(drop).map_err(|source| failed("noting what baselines are used with", source))
    }

    fn remove(&self, (machine, id): (&str, &str), act: &Act<'_>) -> Result<bool, StoreError> {
        let work = |transaction: &Transaction<'_>| {
            let n = transaction
                .execute("DELETE FROM baseline WHERE machine = ?1 AND id = ?2", [machine, id])?;
            if n > 0 {
                for table in ["baseline_record", "baseline_left_out", "baseline_feature"] {
                    transaction
                        .execute(&format!("DELETE FROM {table} WHERE baseline = ?1"), [id])?;
                }
            }
            Ok(n > 0)
        };
        self.commit(("baseline_removed", machine, id), act, work)
    }

    fn version(&self) -> Result<i64, StoreError> {
        self.connection()
            .query_row("PRAGMA data_version", (), |row| row.get(0))
            .map_err(|source| failed("asking for the store's version", source))
    }

    fn newest_act(&self) -> Result<i64, StoreError> {
        let newest = "SELECT id FROM audit WHERE baseline IS NOT NULL ORDER BY id DESC LIMIT 1";
        let found = self.connection().query_row(newest, (), |row| row.get(0)).optional();
        found.map(Option::unwrap_or_default).map_err(|source| failed("asking for acts", source))
    }
}
