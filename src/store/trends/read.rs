//! The reading side: files are opened for each question, beside the daemon that writes them or without.
//!
//! What the coarser tier does not hold yet is made of the finer one while it is read, so that an answer
//! never depends on how far [`super::TrendStore::tidy`] has come.

use super::Minute;
use super::Subject;
use super::Table;
use super::Tier;
use super::TrendArchive;
use super::TrendQuery;
use super::block::Gathering;
use super::block::WIDTH;
use super::file::Row;
use super::file::TrendFile;
use super::file::gather;
use super::period::Period;
use super::retention;
use super::roll;
use super::settled;
use super::settled::Settled;
use super::sqlite::FOLDER;
use super::sqlite::read_minute;
use super::table::MAX_VALUES;
use super::table::Point;
use crate::alarms::past::PastStream;
use crate::alarms::past::PastWindow;
use crate::causes::with_causes;
use crate::signal::Timestamp;
use crate::store::StoreError;
use crate::store::names;
use crate::units::Unit;
use std::collections::BTreeMap;
use std::collections::BTreeSet;
use std::ops::ControlFlow;
use std::path::Path;
use std::path::PathBuf;
use std::sync::Arc;

/// The reading side.
#[derive(Debug, Clone)]
pub struct SqliteTrendArchive {
    folder: PathBuf,
    settled: Settled,
}

/// One question: the files it has opened.
struct Reading<'a> {
    folder: &'a Path,
    settled: &'a Settled,
    files: BTreeMap<Period, Option<TrendFile>>,
    unreadable: Vec<String>,
    /// Blocks of a tier that are made of the finer one, by stream.
    dirty: BTreeMap<(Tier, String), BTreeSet<i64>>,
}

/// Points of a block with their times, and the block.
type Points = (Vec<Point>, Row);

/// What is read of a stream.
struct Wanted<'a> {
    stream: &'a Arc<PastStream>,
    series: (&'a str, &'a str),
}

impl SqliteTrendArchive {
    /// Reads the trends in the store's `directory`.
    #[must_use]
    pub fn new(directory: &Path) -> Self {
        Self { folder: directory.join(FOLDER), settled: Settled::default() }
    }

    fn reading(&self) -> Reading<'_> {
        Reading {
            folder: &self.folder,
            settled: &self.settled,
            files: BTreeMap::new(),
            unreadable: Vec::new(),
            dirty: BTreeMap::new(),
        }
    }

    /// The periods of a tier that hold any of these blocks and have a file in it or in a finer tier.
    fn periods(&self, tier: Tier, blocks: (i64, i64)) -> BTreeSet<Period> {
        let overlaps = |period: &Period| {
            let held = period.blocks();
            held.start <= blocks.1 && blocks.0 < held.end
        };
        lifted(&self.folder, tier).into_iter().filter(overlaps).collect()
    }
}

/// The periods of a tier that have a file in it, or in a finer tier that may not be made coarser yet.
fn lifted(folder: &Path, tier: Tier) -> BTreeSet<Period> {
    let files = retention::files(folder).into_iter().map(|(period, _)| period);
    let lift = |period: Period| {
        let (mut block, mut at) = (period.blocks().start, period.tier);
        while at < tier {
            block = at.block_above(block);
            at = at.coarser().unwrap_or(tier);
        }
        Period::of(tier, block)
    };
    files.filter(|period| period.tier <= tier).map(lift).collect()
}

impl Reading<'_> {
    /// A file; `None`: there is none, or it cannot be read, which is told.
    fn file(&mut self, period: Period) -> Option<&TrendFile> {
        let (folder, unreadable) = (self.folder, &mut self.unreadable);
        let opened = self.files.entry(period).or_insert_with(|| {
            TrendFile::reading(&folder.join(period.name()), period).unwrap_or_else(|error| {
                unreadable.push(with_causes(&error));
                None
            })
        });
        opened.as_ref()
    }

    /// Does `read` with a file; what is damaged is told and passed over.
    fn with<T>(
        &mut self,
        period: Period,
        read: impl FnOnce(&TrendFile) -> Result<Option<T>, StoreError>,
    ) -> Result<Option<T>, StoreError> {
        let Some(file) = self.file(period) else { return Ok(None) };
        match read(file) {
            Err(error @ StoreError::DamagedTrends { .. }) => {
                let told = with_causes(&error);
                if !self.unreadable.contains(&told) {
                    self.unreadable.push(told);
                }
                Ok(None)
            }
            done => done,
        }
    }

    /// The streams of a machine that these blocks of a tier may hold: of those without a start the newest.
    fn streams(
        &mut self,
        machine: &str,
        tier: Tier,
        periods: &BTreeSet<Period>,
    ) -> Result<Vec<Arc<PastStream>>, StoreError> {
        let mut found: BTreeMap<String, Arc<PastStream>> = BTreeMap::new();
        let mut level = Some((tier, periods.clone()));
        while let Some((held_tier, periods)) = level {
            for period in &periods {
                // Of a finer file that is made coarser as a whole, the coarser one has the streams.
                if held_tier != tier && self.settled.has(self.folder, *period) {
                    continue;
                }
                let held = self.with(*period, |file| Ok(Some(file.streams(machine)?)))?;
                for (_, stream) in held.unwrap_or_default() {
                    let newer = |old: &Arc<PastStream>| old.begun >= stream.begun;
                    if !found.get(&stream.name).is_some_and(newer) {
                        found.insert(stream.name.clone(), stream);
                    }
                }
            }
            level = held_tier.finer().map(|finer| (finer, self.periods_below(finer, &periods)));
        }
        let unstarted = found.values().filter(|stream| stream.start.is_none());
        let newest = unstarted.max_by_key(|stream| stream.begun).map(|stream| stream.name.clone());
        found.retain(|name, stream| stream.start.is_some() || Some(name) == newest.as_ref());
        let mut streams: Vec<_> = found.into_values().collect();
        streams.sort_by_key(|stream| stream.begun);
        Ok(streams)
    }

    /// The periods of the finer tier inside these.
    fn periods_below(&self, finer: Tier, periods: &BTreeSet<Period>) -> BTreeSet<Period> {
        let inside = |period: &Period| {
            let above = finer.block_above(period.blocks().start);
            periods.iter().any(|p| p.blocks().contains(&above))
        };
        lifted(self.folder, finer).into_iter().filter(inside).collect()
    }

    /// Notes which blocks of `tier` and the tiers below are older than what they are made of.
    fn note_dirty(&mut self, tier: Tier, periods: &BTreeSet<Period>) -> Result<(), StoreError> {
        let Some(finer) = tier.finer() else { return Ok(()) };
        let below = self.periods_below(finer, periods);
        self.note_dirty(finer, &below)?;
        for period in below {
            if self.settled.has(self.folder, period) {
                continue;
            }
            // Looked at before it is read: what changes meanwhile is seen the next time.
            let stamp = settled::stamp(self.folder, period);
            let marks = self.with(period, |file| {
                let mut named = Vec::new();
                for (block, id) in file.dirty()? {
                    named.extend(file.stream_of(id)?.map(|stream| (block, stream.name.clone())));
                }
                Ok(Some(named))
            })?;
            if marks.as_ref().is_some_and(Vec::is_empty) {
                self.settled.note(period, stamp);
            }
            for (block, name) in marks.unwrap_or_default() {
                self.dirty.entry((tier, name)).or_default().insert(block);
            }
        }
        // What is made of something that is behind is behind itself.
        let behind: Vec<(String, i64)> = self
            .dirty
            .iter()
            .filter(|((of, _), _)| *of == finer)
            .flat_map(|((_, name), blocks)| blocks.iter().map(|b| (name.clone(), *b)))
            .collect();
        for (name, block) in behind {
            self.dirty.entry((tier, name)).or_default().insert(finer.block_above(block));
        }
        Ok(())
    }

    /// The windows of a minute.
    fn windows(
        &mut self,
        block: i64,
        stream: &PastStream,
    ) -> Result<Option<Vec<PastWindow>>, StoreError> {
        self.with(Period::of(Tier::Windows, block), |file| match number(file, stream)? {
            Some(id) => file.windows(block, id),
            None => Ok(None),
        })
    }

    /// The row of a series as it is stored.
    fn stored(
        &mut self,
        tier: Tier,
        block: i64,
        wanted: &Wanted<'_>,
    ) -> Result<Option<Row>, StoreError> {
        let width = if tier == Tier::Windows { 1 } else { WIDTH };
        self.with(Period::of(tier, block), |file| {
            let Some(id) = number(file, wanted.stream)? else { return Ok(None) };
            match file.find_series(id, wanted.series)? {
                Some(series) => file.row(block, series, width),
                None => Ok(None),
            }
        })
    }

    /// The block of a coarser tier: stored, or made of the finer one.
    fn coarse(
        &mut self,
        tier: Tier,
        block: i64,
        wanted: &Wanted<'_>,
    ) -> Result<Option<Row>, StoreError> {
        let key = (tier, wanted.stream.name.clone());
        let Some(finer) = tier.finer() else { return Ok(None) };
        if !self.dirty.get(&key).is_some_and(|blocks| blocks.contains(&block)) {
            return self.stored(tier, block, wanted);
        }
        let n = tier.places();
        let mut gathering = Gathering::new(n);
        for (place, below) in tier.blocks_below(block).enumerate() {
            if finer != Tier::Windows {
                if let Some(row) = self.coarse(finer, below, wanted)? {
                    gather(&row, place, WIDTH, &mut gathering);
                }
            } else if wanted.series.0.is_empty() {
                if let Some(row) = self.stored(finer, below, wanted)? {
                    gather(&row, place, 1, &mut gathering);
                }
            } else if let Some(windows) = self.windows(below, wanted.stream)? {
                let mut gathered = roll::Gathered::new();
                let name = (wanted.series.0.to_owned(), wanted.series.1.to_owned());
                gathered.insert(name.clone(), gathering);
                roll::gather_verdicts(&windows, place, n, &mut gathered);
                gathering = gathered.remove(&name).unwrap_or_else(|| Gathering::new(n));
            }
        }
        let (features, columns) = gathering.finish();
        Ok((!features.is_empty()).then(|| Row { layout: features.into(), columns }))
    }

    /// The values of a minute's windows, with the windows.
    fn fine(
        &mut self,
        block: i64,
        wanted: &Wanted<'_>,
    ) -> Result<Option<(Vec<PastWindow>, Row)>, StoreError> {
        let Some(windows) = self.windows(block, wanted.stream)? else { return Ok(None) };
        let row = if wanted.series.0.is_empty() {
            self.stored(Tier::Windows, block, wanted)?
        } else {
            Some(verdicts(&windows, wanted.series))
        };
        let fits = |row: &Row| row.columns.iter().all(|column| column.len() == windows.len());
        Ok(row.filter(fits).map(|row| (windows, row)))
    }
}

/// A stream's number in a file.
fn number(file: &TrendFile, stream: &PastStream) -> Result<Option<i64>, StoreError> {
    let held = file.streams(&stream.machine)?;
    Ok(held.into_iter().find(|(_, held)| held.name == stream.name).map(|(id, _)| id))
}

/// The verdicts on a component as columns.
fn verdicts(windows: &[PastWindow], (kind, id): (&str, &str)) -> Row {
    let mut columns = vec![Vec::new(); 3];
    for window in windows {
        let is_it = |v: &&crate::alarms::past::PastVerdict| v.kind.name() == kind && v.id == id;
        let found = window.verdicts.iter().find(is_it).map(roll::numbers);
        for (place, column) in columns.iter_mut().enumerate() {
            column.push(found.map_or(f32::NAN, |numbers| numbers[place].1));
        }
    }
    let names = [super::STATE, super::SEVERITY, super::CONFIDENCE];
    Row { layout: names.map(|name| (Arc::from(name), Unit::One)).into(), columns }
}

/// Seconds from an origin.
fn since(at: Timestamp, origin: Option<Timestamp>) -> f64 {
    at.0.saturating_sub(origin.unwrap_or_default().0) as f64 / 1e9
}

impl TrendArchive for SqliteTrendArchive {
    fn trend(&self, query: &TrendQuery) -> Result<Table, StoreError> {
        let (tier, mut table) = (query.tier, Table::default());
        if query.from >= query.to {
            return Ok(table);
        }
        let blocks = (tier.block_at(query.from), tier.block_at(Timestamp(query.to.0 - 1)));
        let periods = self.periods(tier, blocks);
        let mut reading = self.reading();
        reading.note_dirty(tier, &periods)?;
        let streams = reading.streams(&query.machine, tier, &periods)?;
        let (kind, name) = match &query.subject {
            Subject::Channel(name) => ("", name.as_str()),
            Subject::Component(kind, id) => (kind.name(), id.as_str()),
        };
        let features = query.features.as_deref();
        for stream in &streams {
            let wanted = Wanted { stream, series: (kind, name) };
            for period in &periods {
                let held = period.blocks();
                for block in held.start.max(blocks.0)..held.end.min(blocks.1 + 1) {
                    let found = points(&mut reading, query, block, &wanted)?;
                    let Some((points, row)) = found else { continue };
                    let width = if tier == Tier::Windows { 1 } else { WIDTH };
                    table.append(&points, (&row.layout, &row.columns), width, features);
                    let n_columns = table.columns.len().max(1);
                    if table.time_s.len().saturating_mul(n_columns) > MAX_VALUES {
                        return Err(StoreError::TooMuch { max: MAX_VALUES });
                    }
                }
            }
        }
        table.settle();
        table.unreadable = reading.unreadable;
        Ok(table)
    }

    fn minutes(
        &self,
        machine: &str,
        (from, to): (Timestamp, Timestamp),
        each: &mut dyn FnMut(&Minute) -> ControlFlow<()>,
    ) -> Result<Vec<String>, StoreError> {
        let tier = Tier::Windows;
        let blocks = (tier.block_at(from), tier.block_at(Timestamp(to.0.saturating_sub(1))));
        let periods = self.periods(tier, blocks);
        let mut reading = self.reading();
        let streams = reading.streams(machine, tier, &periods)?;
        for period in &periods {
            let held = period.blocks();
            for block in held.start.max(blocks.0)..held.end.min(blocks.1 + 1) {
                for stream in &streams {
                    let minute = reading.with(*period, |file| {
                        let Some(id) = number(file, stream)? else { return Ok(None) };
                        read_minute(file, (block, id), stream).map(Some)
                    })?;
                    let Some(minute) = minute.filter(|minute| !minute.windows.is_empty()) else {
                        continue;
                    };
                    if each(&minute).is_break() {
                        return Ok(reading.unreadable);
                    }
                }
            }
        }
        Ok(reading.unreadable)
    }

    fn subjects(&self, machine: &str) -> Result<Vec<Subject>, StoreError> {
        let mut found = BTreeSet::new();
        let mut reading = self.reading();
        for (period, _) in retention::files(&self.folder) {
            let here = reading.with(period, |file| {
                let mut subjects = Vec::new();
                for (id, _) in file.streams(machine)? {
                    // Of components windows have no series, only verdicts.
                    let newest = file.newest_windows(id)?.unwrap_or_default();
                    let verdicts = newest.iter().flat_map(|window| &window.verdicts);
                    subjects.extend(verdicts.map(|v| Subject::Component(v.kind, v.id.clone())));
                    for (_, (kind, name)) in file.series_of(id)? {
                        let kind = names::component_kind(&kind);
                        subjects.push(match kind {
                            Some(kind) => Subject::Component(kind, name),
                            None => Subject::Channel(name),
                        });
                    }
                }
                Ok(Some(subjects))
            })?;
            found.extend(here.unwrap_or_default());
        }
        Ok(found.into_iter().collect())
    }

    fn span(
        &self,
        machine: &str,
        tier: Tier,
    ) -> Result<Option<(Timestamp, Timestamp)>, StoreError> {
        let mut reading = self.reading();
        let files = retention::files(&self.folder).into_iter();
        let mine: Vec<Period> =
            files.map(|(period, _)| period).filter(|period| period.tier == tier).collect();
        let mut reach = |periods: &mut dyn Iterator<Item = &Period>| {
            for period in periods {
                let found = reading.with(*period, |file| file.reach(&file.streams(machine)?))?;
                if found.is_some() {
                    return Ok(found);
                }
            }
            Ok::<_, StoreError>(None)
        };
        let (first, last) = (reach(&mut mine.iter())?, reach(&mut mine.iter().rev())?);
        let at = |block: i64| {
            Timestamp(block.saturating_mul(tier.block_s()).saturating_mul(1_000_000_000))
        };
        Ok(first.zip(last).map(|((low, _), (_, high))| (at(low), at(high + 1))))
    }
}

/// The points of a block, those inside the span alone, with their times.
fn points(
    reading: &mut Reading<'_>,
    query: &TrendQuery,
    block: i64,
    wanted: &Wanted<'_>,
) -> Result<Option<Points>, StoreError> {
    let tier = query.tier;
    let (row, all): (Row, Vec<(Timestamp, Point)>) = if let Some(step_s) = tier.step_s() {
        let Some(row) = reading.coarse(tier, block, wanted)? else { return Ok(None) };
        let first_s = block.saturating_mul(tier.block_s());
        let places = (0_i64..).take(tier.places());
        let at = |place: i64| {
            let at = Timestamp((first_s + place * step_s).saturating_mul(1_000_000_000));
            (at, since(at, query.origin))
        };
        let point = |(place, (at, time_s))| (at, Point { place, time_s, duration_s: None });
        (row, places.map(at).enumerate().map(point).collect())
    } else {
        let Some((windows, row)) = reading.fine(block, wanted)? else { return Ok(None) };
        // Of the same stream the time is that of the stream, to the last digit.
        let start = wanted.stream.start.unwrap_or_default();
        let shift_s = since(start, query.origin);
        let is_asked = wanted.stream.start == query.origin;
        let at = |(place, window): (usize, &PastWindow)| {
            let (time_s, length_s) = (window.time_s + shift_s, window.duration_s);
            let duration_s = Some(if is_asked { length_s } else { f64::NAN });
            (wanted.stream.utc(window.time_s), Point { place, time_s, duration_s })
        };
        (row, windows.iter().enumerate().map(at).collect())
    };
    // A minute or hour belongs to the span that it reaches into.
    let length = tier.step_s().map_or(1, |step_s| step_s * 1_000_000_000);
    let is_inside = |at: Timestamp| at < query.to && at.0.saturating_add(length) > query.from.0;
    let is_known = |place: usize| {
        tier == Tier::Windows || row.columns.iter().step_by(WIDTH).any(|n| n[place] > 0.0)
    };
    let taken = all.into_iter().filter(|(at, point)| is_inside(*at) && is_known(point.place));
    let taken: Vec<Point> = taken.map(|(_, point)| point).collect();
    Ok((!taken.is_empty()).then_some((taken, row)))
}
