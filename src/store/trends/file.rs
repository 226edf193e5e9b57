//! One file of trends: rows by block and series, in every tier alike.
//!
//! A block of a series (a channel, or in coarser tiers also a component) is a shuffled, deflated blob of f32; the
//! times and verdicts of a minute are one more row a stream.

use super::super::StoreError;
use super::super::rows::whole;
use super::FeatureName;
use super::block::Gathering;
use super::codec;
use super::codec::Deflater;
use super::open;
use super::open::problem;
use super::open::with_end;
use super::period::Period;
use super::windows;
use crate::alarms::past::PastStream;
use crate::alarms::past::PastWindow;
use crate::signal::Timestamp;
use crate::units::Unit;
use rusqlite::Connection;
use rusqlite::OptionalExtension;
use rusqlite::params;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::Path;
use std::path::PathBuf;
use std::sync::Arc;

/// Bits of a key that number the series or the stream.
const SERIES_BITS: u32 = 24;

/// Names and units of the features of a row.
pub(super) type Layout = Arc<[FeatureName]>;

/// A stream with its number in this file.
pub(super) type Numbered = (i64, Arc<PastStream>);

/// A series: component kind (empty for a channel) and name.
pub(super) type SeriesName = (String, String);

/// The block of a series: its layout, number of values a column, columns.
pub(super) struct Row {
    pub(super) layout: Layout,
    pub(super) columns: Vec<Vec<f32>>,
}

/// A file.
#[derive(Debug)]
pub(super) struct TrendFile {
    pub(super) period: Period,
    path: PathBuf,
    connection: Connection,
    streams: RefCell<BTreeMap<String, Vec<Numbered>>>,
    series: RefCell<BTreeMap<(i64, String, String), i64>>,
    layouts: RefCell<BTreeMap<i64, Layout>>,
    layout_ids: RefCell<BTreeMap<String, i64>>,
}

impl TrendFile {
    /// Opens the file for writing; makes it where it is missing.
    pub(super) fn writing(path: &Path, period: Period) -> Result<Self, StoreError> {
        Ok(Self::of(open::writing(path)?, path, period))
    }

    /// Opens the file for reading; `None`: there is none yet.
    pub(super) fn reading(path: &Path, period: Period) -> Result<Option<Self>, StoreError> {
        Ok(open::reading(path)?.map(|connection| Self::of(connection, path, period)))
    }

    fn of(connection: Connection, path: &Path, period: Period) -> Self {
        connection.set_prepared_statement_cache_capacity(32);
        Self {
            period,
            path: path.to_owned(),
            connection,
            streams: RefCell::default(),
            series: RefCell::default(),
            layouts: RefCell::default(),
            layout_ids: RefCell::default(),
        }
    }

    fn failed(&self, doing: &'static str) -> impl Fn(rusqlite::Error) -> StoreError {
        move |source| problem(&self.path, doing, source)
    }

    /// What says that a row cannot be read.
    fn damaged(&self, found: &str) -> StoreError {
        StoreError::DamagedTrends { file: self.path.clone(), found: found.to_owned() }
    }

    /// Does `work` as a whole or not at all.
    pub(super) fn commit<T>(
        &self,
        work: impl FnOnce(&Self) -> Result<T, StoreError>,
    ) -> Result<T, StoreError> {
        let writing = self.failed("storing trends");
        self.connection.execute_batch("BEGIN IMMEDIATE").map_err(&writing)?;
        let done = work(self).and_then(|done| {
            self.connection.execute_batch("COMMIT").map_err(&writing).map(|()| done)
        });
        if done.is_err() {
            // What is rolled back already needs no second time; numbers given meanwhile hold no more.
            let _already_over = self.connection.execute_batch("ROLLBACK");
            self.streams.borrow_mut().clear();
            self.series.borrow_mut().clear();
            self.layout_ids.borrow_mut().clear();
            self.layouts.borrow_mut().clear();
        }
        done
    }

    /// Returns the log to the file if it is longer than `max_bytes`.
    pub(super) fn checkpoint(&self, max_bytes: u64) -> Result<(), StoreError> {
        let log = with_end(&self.path, "-wal");
        if std::fs::metadata(log).is_ok_and(|log| log.len() > max_bytes) {
            let done = self.connection.query_row("PRAGMA wal_checkpoint(TRUNCATE)", (), |_| Ok(()));
            done.map_err(self.failed("returning the log of trends"))?;
        }
        Ok(())
    }

    /// The streams of a machine, by number.
    pub(super) fn streams(&self, machine: &str) -> Result<Vec<Numbered>, StoreError> {
        if let Some(known) = self.streams.borrow().get(machine) {
            return Ok(known.clone());
        }
        let reading = self.failed("reading streams");
        let mut statement = self
            .connection
            .prepare_cached(
                "SELECT id, name, start_utc, begun_utc, channels FROM stream WHERE machine = ?1
                 ORDER BY id",
            )
            .map_err(&reading)?;
        let rows = statement.query_map([machine], |row| {
            let (start, channels): (Option<i64>, String) = (row.get(2)?, row.get(4)?);
            let stream = PastStream {
                machine: machine.to_owned(),
                name: row.get(1)?,
                start: start.map(Timestamp),
                begun: Timestamp(row.get(3)?),
                channels: channels.lines().map(str::to_owned).collect(),
            };
            Ok((row.get(0)?, Arc::new(stream)))
        });
        let streams: Vec<Numbered> =
            rows.and_then(|rows| rows.collect::<Result<_, _>>()).map_err(&reading)?;
        self.streams.borrow_mut().insert(machine.to_owned(), streams.clone());
        Ok(streams)
    }

    /// The number of a stream; notes it, and that it is the newest, if need be.
    pub(super) fn stream(&self, stream: &PastStream) -> Result<i64, StoreError> {
        let known = self.streams(&stream.machine)?;
        let known = known.iter().find(|(_, held)| held.name == stream.name);
        if let Some((id, held)) = known
            && held.begun >= stream.begun
        {
            return Ok(*id);
        }
        self.streams.borrow_mut().remove(&stream.machine);
        let writing = self.failed("storing a stream");
        let mut statement = self
            .connection
            .prepare_cached(
                "INSERT INTO stream (machine, name, start_utc, begun_utc, channels)
                 VALUES (?1, ?2, ?3, ?4, ?5)
                 ON CONFLICT (machine, name) DO UPDATE SET begun_utc = max(begun_utc, excluded.begun_utc)
                 RETURNING id",
            )
            .map_err(&writing)?;
        let start = stream.start.map(|start| start.0);
        let channels = stream.channels.join("\n");
        let values = params![stream.machine, stream.name, start, stream.begun.0, channels];
        self.numbered(statement.query_row(values, |row| row.get(0)).map_err(&writing)?)
    }

    /// A number of a key; more than fit there are never made.
    fn numbered(&self, id: i64) -> Result<i64, StoreError> {
        if (0..1 << SERIES_BITS).contains(&id) {
            Ok(id)
        } else {
            Err(self.damaged(&format!("a series has the number {id}")))
        }
    }

    /// The series of a stream, by name.
    pub(super) fn series_of(&self, stream: i64) -> Result<Vec<(i64, SeriesName)>, StoreError> {
        let reading = self.failed("reading series");
        let mut statement = self
            .connection
            .prepare_cached("SELECT id, kind, name FROM series WHERE stream = ?1 ORDER BY id")
            .map_err(&reading)?;
        let rows = statement
            .query_map([stream], |row| Ok((row.get(0)?, (row.get(1)?, row.get(2)?))))
            .map_err(&reading)?;
        rows.collect::<Result<_, _>>().map_err(&reading)
    }

    /// The number of a series, if there is one.
    pub(super) fn find_series(
        &self,
        stream: i64,
        (kind, name): (&str, &str),
    ) -> Result<Option<i64>, StoreError> {
        let key = (stream, kind.to_owned(), name.to_owned());
        if let Some(id) = self.series.borrow().get(&key) {
            return Ok(Some(*id));
        }
        let reading = self.failed("reading series");
        let mut statement = self
            .connection
            .prepare_cached("SELECT id FROM series WHERE stream = ?1 AND kind = ?2 AND name = ?3")
            .map_err(&reading)?;
        let found: Option<i64> = statement
            .query_row(params![stream, kind, name], |row| row.get(0))
            .optional()
            .map_err(&reading)?;
        if let Some(id) = found {
            self.series.borrow_mut().insert(key, id);
        }
        Ok(found)
    }

    fn series(&self, stream: i64, name: (&str, &str)) -> Result<i64, StoreError> {
        if let Some(id) = self.find_series(stream, name)? {
            return Ok(id);
        }
        let writing = self.failed("storing a series");
        let insert = "INSERT INTO series (stream, kind, name) VALUES (?1, ?2, ?3)";
        let mut statement = self.connection.prepare_cached(insert).map_err(&writing)?;
        let id = statement.insert(params![stream, name.0, name.1]).map_err(&writing)?;
        let id = self.numbered(id)?;
        self.series.borrow_mut().insert((stream, name.0.to_owned(), name.1.to_owned()), id);
        Ok(id)
    }

    fn layout_id(&self, features: &[FeatureName]) -> Result<i64, StoreError> {
        let text: String =
            features.iter().map(|(name, unit)| format!("{name}\t{}\n", unit.symbol())).collect();
        if let Some(id) = self.layout_ids.borrow().get(&text) {
            return Ok(*id);
        }
        let writing = self.failed("storing the names of features");
        let found: Option<i64> = self
            .connection
            .query_row("SELECT id FROM layout WHERE features = ?1", [&text], |row| row.get(0))
            .optional()
            .map_err(&writing)?;
        let id = match found {
            Some(id) => id,
            None => {
                let insert = "INSERT INTO layout (features) VALUES (?1)";
                self.connection.execute(insert, [&text]).map_err(&writing)?;
                self.connection.last_insert_rowid()
            }
        };
        self.layout_ids.borrow_mut().insert(text, id);
        Ok(id)
    }

    fn layout(&self, id: i64) -> Result<Layout, StoreError> {
        if let Some(layout) = self.layouts.borrow().get(&id) {
            return Ok(Arc::clone(layout));
        }
        let text: String = self
            .connection
            .query_row("SELECT features FROM layout WHERE id = ?1", [id], |row| row.get(0))
            .map_err(self.failed("reading the names of features"))?;
        let feature = |line: &str| {
            let (name, unit) = line.split_once('\t')?;
            Some((Arc::from(name), unit_of(unit)?))
        };
        let layout: Option<Layout> = text.lines().map(feature).collect();
        let layout = layout.ok_or_else(|| self.damaged("the names of features"))?;
        self.layouts.borrow_mut().insert(id, Arc::clone(&layout));
        Ok(layout)
    }

    /// Stores the block of a series; without features there is none.
    pub(super) fn put(
        &self,
        (block, stream): (i64, i64),
        name: (&str, &str),
        (features, columns): (&[FeatureName], &[Vec<f32>]),
        deflater: &mut Deflater,
    ) -> Result<(), StoreError> {
        let key = key(block, self.series(stream, name)?);
        let writing = self.failed("storing trends");
        if features.is_empty() {
            let mut statement = self
                .connection
                .prepare_cached("DELETE FROM row WHERE key = ?1")
                .map_err(&writing)?;
            return statement.execute([key]).map(drop).map_err(&writing);
        }
        let layout = self.layout_id(features)?;
        let n = whole(columns.first().map_or(0, Vec::len) as u64);
        let data = codec::write_f32(deflater, columns).ok_or_else(|| self.damaged("no memory"))?;
        let insert = "INSERT OR REPLACE INTO row (key, layout, n, data) VALUES (?1, ?2, ?3, ?4)";
        let mut statement = self.connection.prepare_cached(insert).map_err(&writing)?;
        statement.execute(params![key, layout, n, data]).map(drop).map_err(&writing)
    }

    /// The block of a series: features and columns, `width` each.
    pub(super) fn row(
        &self,
        block: i64,
        series: i64,
        width: usize,
    ) -> Result<Option<Row>, StoreError> {
        let reading = self.failed("reading trends");
        let select = "SELECT layout, n, data FROM row WHERE key = ?1";
        let mut statement = self.connection.prepare_cached(select).map_err(&reading)?;
        let mut rows = statement.query([key(block, series)]).map_err(&reading)?;
        let Some(row) = rows.next().map_err(&reading)? else { return Ok(None) };
        let layout = self.layout(row.get(0).map_err(&reading)?)?;
        let n: i64 = row.get(1).map_err(&reading)?;
        let data = row.get_ref(2).map_err(&reading)?;
        let data = data.as_blob().map_err(|_| self.damaged("a row without its data"))?;
        let n_columns = layout.len().saturating_mul(width);
        let columns = usize::try_from(n).ok().and_then(|n| codec::read_f32(data, n_columns, n));
        let columns = columns.ok_or_else(|| self.damaged("a row that cannot be read"))?;
        Ok(Some(Row { layout, columns }))
    }

    /// Stores the windows of a minute; none removes them.
    pub(super) fn put_windows(
        &self,
        (block, stream): (i64, i64),
        past: &[PastWindow],
        deflater: &mut Deflater,
    ) -> Result<(), StoreError> {
        let writing = self.failed("storing verdicts");
        if past.is_empty() {
            let delete = "DELETE FROM windows WHERE key = ?1";
            let done = self.connection.execute(delete, [key(block, stream)]);
            return done.map(drop).map_err(&writing);
        }
        let data = windows::write(past, deflater).ok_or_else(|| self.damaged("no memory"))?;
        let insert = "INSERT OR REPLACE INTO windows (key, data) VALUES (?1, ?2)";
        let mut statement = self.connection.prepare_cached(insert).map_err(&writing)?;
        statement.execute(params![key(block, stream), data]).map(drop).map_err(&writing)
    }

    /// The windows of a minute.
    pub(super) fn windows(
        &self,
        block: i64,
        stream: i64,
    ) -> Result<Option<Vec<PastWindow>>, StoreError> {
        let reading = self.failed("reading verdicts");
        let select = "SELECT data FROM windows WHERE key = ?1";
        let mut statement = self.connection.prepare_cached(select).map_err(&reading)?;
        let data: Option<Vec<u8>> = statement
            .query_row([key(block, stream)], |row| row.get(0))
            .optional()
            .map_err(&reading)?;
        let read = |data: Vec<u8>| {
            windows::read(&data).ok_or_else(|| self.damaged("verdicts that cannot be read"))
        };
        data.map(read).transpose()
    }

    /// The newest windows of a stream.
    pub(super) fn newest_windows(
        &self,
        stream: i64,
    ) -> Result<Option<Vec<PastWindow>>, StoreError> {
        let select = "SELECT key FROM windows WHERE key & ?1 = ?2 ORDER BY key DESC LIMIT 1";
        let newest: Option<i64> = self
            .connection
            .query_row(select, params![(1_i64 << SERIES_BITS) - 1, stream], |row| row.get(0))
            .optional()
            .map_err(self.failed("reading verdicts"))?;
        newest.map_or(Ok(None), |key| self.windows(key >> SERIES_BITS, stream))
    }

    /// Lowest and highest block that is held of any of these streams.
    pub(super) fn reach(&self, streams: &[Numbered]) -> Result<Option<(i64, i64)>, StoreError> {
        let mut ids: Vec<i64> = Vec::new();
        for (stream, _) in streams {
            ids.extend(self.series_of(*stream)?.into_iter().map(|(series, _)| series));
        }
        let reading = self.failed("reading trends");
        let exists = "SELECT 1 FROM row WHERE key = ?1";
        let mut statement = self.connection.prepare_cached(exists).map_err(&reading)?;
        let mut first = |blocks: &mut dyn Iterator<Item = i64>| {
            for block in blocks {
                for id in &ids {
                    if statement.exists([key(block, *id)]).map_err(&reading)? {
                        return Ok(Some(block));
                    }
                }
            }
            Ok(None)
        };
        let blocks = self.period.blocks();
        let Some(low) = first(&mut blocks.clone())? else { return Ok(None) };
        Ok(first(&mut blocks.rev())?.map(|high| (low, high)))
    }

    /// Notes that a block of the coarser tier is older than what it is made of, or no longer.
    pub(super) fn mark(&self, block: i64, stream: i64, is_dirty: bool) -> Result<(), StoreError> {
        let writing = self.failed("storing trends");
        let text = if is_dirty {
            "INSERT OR IGNORE INTO dirty (block, stream) VALUES (?1, ?2)"
        } else {
            "DELETE FROM dirty WHERE block = ?1 AND stream = ?2"
        };
        let mut statement = self.connection.prepare_cached(text).map_err(&writing)?;
        statement.execute(params![block, stream]).map(drop).map_err(&writing)
    }

    /// The blocks of the coarser tier that are older than what they are made of, with the stream.
    pub(super) fn dirty(&self) -> Result<Vec<(i64, i64)>, StoreError> {
        let reading = self.failed("reading trends");
        let mut statement = self
            .connection
            .prepare_cached("SELECT block, stream FROM dirty ORDER BY block, stream")
            .map_err(&reading)?;
        let rows =
            statement.query_map((), |row| Ok((row.get(0)?, row.get(1)?))).map_err(&reading)?;
        rows.collect::<Result<_, _>>().map_err(&reading)
    }

    /// A stream by its number.
    pub(super) fn stream_of(&self, id: i64) -> Result<Option<Arc<PastStream>>, StoreError> {
        let machine: Option<String> = self
            .connection
            .query_row("SELECT machine FROM stream WHERE id = ?1", [id], |row| row.get(0))
            .optional()
            .map_err(self.failed("reading streams"))?;
        let Some(machine) = machine else { return Ok(None) };
        let streams = self.streams(&machine)?;
        Ok(streams.into_iter().find(|(number, _)| *number == id).map(|(_, stream)| stream))
    }

    /// Mean number of features of a channel; `None`: nothing is held.
    pub(super) fn features_per_channel(&self) -> Result<Option<f64>, StoreError> {
        let reading = self.failed("reading the names of features");
        // Line breaks of the layouts of the newest rows.
        let text = "SELECT avg(length(features) - length(replace(features, char(10), '')))
                    FROM (SELECT layout FROM row ORDER BY key DESC LIMIT 1000) JOIN layout ON id = layout";
        self.connection.query_row(text, (), |row| row.get(0)).map_err(&reading)
    }
}

/// Adds a block to a gathering at a place.
pub(super) fn gather(row: &Row, place: usize, width: usize, into: &mut Gathering) {
    if width == 1 {
        for (feature, column) in row.layout.iter().zip(&row.columns) {
            into.add_values(place, feature, column);
        }
    } else {
        into.add_block(place, &row.layout, &row.columns);
    }
}

fn key(block: i64, series: i64) -> i64 {
    (block << SERIES_BITS) | series
}

/// Reads a unit's symbol.
fn unit_of(symbol: &str) -> Option<Unit> {
    const ALL: [Unit; 7] = [
        Unit::MetrePerSecondSquared,
        Unit::MillimetrePerSecond,
        Unit::Micrometre,
        Unit::Volt,
        Unit::Hertz,
        Unit::One,
        Unit::Unknown,
    ];
    ALL.into_iter().find(|unit| unit.symbol() == symbol)
}
