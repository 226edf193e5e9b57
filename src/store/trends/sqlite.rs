//! The writing side: minutes into the files of their days, coarser tiers when theirs is complete.
//!
//! A file that is damaged is put aside under another name and begun anew; a newer or foreign one is refused
//! and left alone. Neither stops anything but the trends of its own time.

use super::ChannelMinute;
use super::Kept;
use super::Minute;
use super::Tier;
use super::TrendStore;
use super::codec::Deflater;
use super::file::TrendFile;
use super::open::with_end;
use super::period::Period;
use super::retention;
use super::retention::Holdings;
use super::retention::Retention;
use super::roll;
use crate::alarms::past::PastStream;
use crate::alarms::past::PastWindow;
use crate::signal::Timestamp;
use crate::store::StoreError;
use std::collections::BTreeMap;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::path::PathBuf;
use std::sync::Arc;

/// Folder of trends in the store's directory.
pub const FOLDER: &str = "trends";

/// Files kept open: those of now, and of a replay beside them.
const MAX_OPEN: usize = 6;

/// Bytes of a log after which it is returned to its file.
const MAX_LOG_BYTES: u64 = 16 << 20;

/// A stream that has said nothing for so long is complete up to where it is, s.
const IDLE_S: i64 = 120;

/// How far a stream has come.
#[derive(Debug, Clone, Copy)]
struct Reached {
    minute: i64,
    at: Timestamp,
}

/// The writing side.
#[derive(Debug)]
pub struct SqliteTrends {
    directory: PathBuf,
    retention: Retention,
    deflater: Deflater,
    /// The newest used last.
    open: Vec<TrendFile>,
    /// Files in which the coarser tier may be behind.
    pending: BTreeSet<Period>,
    reached: BTreeMap<(String, String), Reached>,
    n_set_aside: u64,
    n_removed: u64,
}

/// Mean number of features of a channel in the newest file under the store's `directory`; `None`: nothing is held. Changes nothing.
#[must_use]
pub fn features_per_channel(directory: &Path) -> Option<f64> {
    let files = retention::files(&directory.join(FOLDER));
    let newest = files.iter().rfind(|(period, _)| period.tier == Tier::Windows)?;
    let file = TrendFile::reading(&newest.1, newest.0).ok()??;
    file.features_per_channel().ok()?
}

impl SqliteTrends {
    /// Opens the trends in the store's `directory`; makes their folder if it is missing. Nothing is read
    /// yet, so that the start does not wait for it.
    ///
    /// # Errors
    /// When the folder cannot be made.
    pub fn open(directory: &Path, retention: Retention) -> Result<Self, StoreError> {
        let directory = directory.join(FOLDER);
        fs::create_dir_all(&directory)
            .map_err(|source| StoreError::Folder { directory: directory.clone(), source })?;
        let is_finer = |found: &(Period, PathBuf)| found.0.tier.coarser().is_some();
        let files = retention::files(&directory).into_iter();
        Ok(Self {
            pending: files.filter(is_finer).map(|(period, _)| period).collect(),
            directory,
            retention,
            deflater: Deflater::new(),
            open: Vec::new(),
            reached: BTreeMap::new(),
            n_set_aside: 0,
            n_removed: 0,
        })
    }

    /// Files that were damaged and put aside since the start.
    #[must_use]
    pub fn n_set_aside(&self) -> u64 {
        self.n_set_aside
    }

    /// Opens a file, or finds it open, as the newest used.
    fn file(&mut self, period: Period) -> Result<usize, StoreError> {
        if let Some(at) = self.open.iter().position(|file| file.period == period) {
            let file = self.open.remove(at);
            self.open.push(file);
            return Ok(self.open.len() - 1);
        }
        let path = self.directory.join(period.name());
        let file = match TrendFile::writing(&path, period) {
            Err(error @ StoreError::DamagedTrends { .. }) => {
                self.put_aside(period, &error)?;
                TrendFile::writing(&path, period)?
            }
            opened => opened?,
        };
        if self.open.len() >= MAX_OPEN {
            self.open.remove(0);
        }
        self.open.push(file);
        Ok(self.open.len() - 1)
    }

    fn close(&mut self, period: Period) {
        self.open.retain(|file| file.period != period);
    }

    /// Gives a damaged file another name, so that its time goes on in a new one.
    fn put_aside(&mut self, period: Period, why: &StoreError) -> Result<(), StoreError> {
        self.close(period);
        let path = self.directory.join(period.name());
        let free = |n: &u32| !with_end(&path, &aside(*n)).exists();
        let n = (0..1000).find(free).unwrap_or(0);
        for end in ["", "-wal", "-shm"] {
            let (from, to) = (with_end(&path, end), with_end(&path, &format!("{}{end}", aside(n))));
            match fs::rename(&from, &to) {
                Err(source) if end.is_empty() => {
                    return Err(StoreError::Folder { directory: self.directory.clone(), source });
                }
                Ok(()) | Err(_) => {}
            }
        }
        self.n_set_aside += 1;
        tracing::error!(file = %path.display(), error = %why, "file of trends put aside, a new one begins");
        Ok(())
    }

    /// Does `work` on a file; once more on a new one if it turns out to be damaged.
    fn on<T>(
        &mut self,
        period: Period,
        work: impl Fn(&TrendFile, &mut Deflater) -> Result<T, StoreError>,
    ) -> Result<T, StoreError> {
        let at = self.file(period)?;
        match work(&self.open[at], &mut self.deflater) {
            Err(error @ StoreError::DamagedTrends { .. }) => {
                self.put_aside(period, &error)?;
                let at = self.file(period)?;
                work(&self.open[at], &mut self.deflater)
            }
            done => done,
        }
    }

    /// Whether nothing more is expected of a stream in a block of `tier`.
    fn is_complete(&self, key: &(String, String), tier: Tier, block: i64, now: Timestamp) -> bool {
        self.reached.get(key).is_none_or(|reached| {
            let idle_s = now.0.saturating_sub(reached.at.0).div_euclid(1_000_000_000);
            let here = reached.minute * 60 / tier.block_s();
            here != block || !(0..IDLE_S).contains(&idle_s)
        })
    }

    /// Makes one block of the coarser tier of a file anew; gives whether there was one that is complete.
    fn roll_one(&mut self, period: Period, now: Timestamp) -> Result<bool, StoreError> {
        let Some(tier) = period.tier.coarser() else { return Ok(false) };
        let dirty = self.on(period, |file, _| file.dirty())?;
        if dirty.is_empty() {
            self.pending.remove(&period);
            return Ok(false);
        }
        for (block, id) in dirty {
            let stream = self.on(period, |file, _| file.stream_of(id))?;
            let Some(stream) = stream else {
                self.on(period, |file, _| file.mark(block, id, false))?;
                continue;
            };
            let key = (stream.machine.clone(), stream.name.clone());
            if !self.is_complete(&key, tier, block, now) {
                continue;
            }
            let gathered = self.on(period, |file, _| roll::of_stream(file, tier, block, id))?;
            let above = Period::of(tier, block);
            self.on(above, |file, deflater| {
                file.commit(|file| {
                    let id = file.stream(&stream)?;
                    for ((kind, name), gathering) in &gathered {
                        let (features, columns) = gathering.clone().finish();
                        file.put((block, id), (kind, name), (&features, &columns), deflater)?;
                    }
                    if tier.coarser().is_some() {
                        file.mark(tier.block_above(block), id, true)?;
                    }
                    Ok(())
                })
            })?;
            if tier.coarser().is_some() {
                self.pending.insert(above);
            }
            self.on(period, |file, _| file.mark(block, id, false))?;
            return Ok(true);
        }
        Ok(false)
    }
}

fn aside(n: u32) -> String {
    if n == 0 { ".damaged".to_owned() } else { format!(".damaged-{n}") }
}

/// Stores a minute in its file.
fn store(file: &TrendFile, minute: &Minute, deflater: &mut Deflater) -> Result<Kept, StoreError> {
    let id = file.stream(&minute.stream)?;
    let place = (minute.minute, id);
    let n_all = minute.n_points();
    replace_older(file, minute, deflater)?;
    let (merged, n_new) = match file.windows(minute.minute, id)? {
        None => (None, minute.windows.len()),
        Some(held) => {
            let known = |time_s: f64| held.iter().any(|w| w.time_s.to_bits() == time_s.to_bits());
            if minute.windows.iter().all(|window| known(window.time_s)) {
                return Ok(Kept { n_new: 0, n_again: n_all });
            }
            let mut whole = read_minute(file, (minute.minute, id), &minute.stream)?;
            let n_new = whole.merge(minute);
            (Some(whole), n_new)
        }
    };
    let minute = merged.as_ref().unwrap_or(minute);
    file.put_windows(place, &minute.windows, deflater)?;
    for channel in &minute.channels {
        let Some(name) = minute.stream.channels.get(channel.channel) else { continue };
        file.put(place, ("", name), (&channel.features, &channel.columns), deflater)?;
    }
    file.mark(Tier::Windows.block_above(minute.minute), id, true)?;
    let n_new = (n_new * minute.channels.len().max(1)) as u64;
    Ok(Kept { n_new, n_again: n_all.saturating_sub(n_new) })
}

/// A minute as it is stored.
pub(super) fn read_minute(
    file: &TrendFile,
    (block, id): (i64, i64),
    stream: &Arc<PastStream>,
) -> Result<Minute, StoreError> {
    let mut minute = Minute::new(Arc::clone(stream), block);
    minute.windows = file.windows(block, id)?.unwrap_or_default();
    for (channel, name) in stream.channels.iter().enumerate() {
        let Some(series) = file.find_series(id, ("", name))? else { continue };
        let Some(row) = file.row(block, series, 1)? else { continue };
        let features = row.layout.to_vec();
        let columns = row.columns;
        if columns.iter().all(|column| column.len() == minute.windows.len()) {
            minute.channels.push(ChannelMinute { channel, features, columns });
        }
    }
    Ok(minute)
}

/// Removes what older streams of the machine left at the times of a minute: a capture played again with
/// other settings, or the next stream without a start.
fn replace_older(
    file: &TrendFile,
    minute: &Minute,
    deflater: &mut Deflater,
) -> Result<(), StoreError> {
    let new = &minute.stream;
    let Some(span) = utc_span(new, &minute.windows) else { return Ok(()) };
    for (id, old) in file.streams(&new.machine)? {
        if old.name == new.name || old.begun >= new.begun {
            continue;
        }
        let Some(held) = file.windows(minute.minute, id)? else { continue };
        let is_kept = |window: &PastWindow| {
            let at = old.utc(window.time_s);
            at < span.0 || at > span.1
        };
        if held.iter().all(is_kept) {
            continue;
        }
        let mut rest = read_minute(file, (minute.minute, id), &old)?;
        rest.retain(is_kept);
        file.put_windows((minute.minute, id), &rest.windows, deflater)?;
        for (channel, name) in old.channels.iter().enumerate() {
            let left = rest.channels.iter().find(|left| left.channel == channel);
            let left = left.filter(|_| !rest.windows.is_empty());
            let (features, columns) =
                left.map_or((&[][..], &[][..]), |l| (&l.features[..], &l.columns[..]));
            if left.is_some() || file.find_series(id, ("", name))?.is_some() {
                file.put((minute.minute, id), ("", name), (features, columns), deflater)?;
            }
        }
        file.mark(Tier::Windows.block_above(minute.minute), id, true)?;
    }
    Ok(())
}

/// First and last end of windows, UTC.
fn utc_span(stream: &PastStream, windows: &[PastWindow]) -> Option<(Timestamp, Timestamp)> {
    let (first, last) = (windows.first()?, windows.last()?);
    Some((stream.utc(first.time_s), stream.utc(last.time_s)))
}

impl TrendStore for SqliteTrends {
    fn keep(&mut self, minutes: &[Minute], now: Timestamp) -> Result<Kept, StoreError> {
        let mut kept = Kept::default();
        for day in minutes.chunk_by(|a, b| {
            Period::of(Tier::Windows, a.minute) == Period::of(Tier::Windows, b.minute)
        }) {
            let Some(first) = day.first() else { continue };
            let period = Period::of(Tier::Windows, first.minute);
            let done = self.on(period, |file, deflater| {
                file.commit(|file| {
                    let mut kept = Kept::default();
                    for minute in day {
                        let one = store(file, minute, deflater)?;
                        kept.n_new += one.n_new;
                        kept.n_again += one.n_again;
                    }
                    Ok(kept)
                })
            })?;
            kept.n_new += done.n_new;
            kept.n_again += done.n_again;
            self.pending.insert(period);
            for minute in day {
                let key = (minute.stream.machine.clone(), minute.stream.name.clone());
                self.reached.insert(key, Reached { minute: minute.minute, at: now });
            }
        }
        Ok(kept)
    }

    fn tidy(&mut self, now: Timestamp) -> Result<bool, StoreError> {
        for period in self.pending.clone() {
            match self.roll_one(period, now) {
                Ok(false) => {}
                // Told where it is written; there is nothing to make of it.
                Err(StoreError::NewerTrends { .. } | StoreError::Foreign { .. }) => {
                    self.pending.remove(&period);
                }
                done => return done,
            }
        }
        self.reached
            .retain(|_, reached| now.0.saturating_sub(reached.at.0) < 2 * IDLE_S * 1_000_000_000);
        for file in &self.open {
            file.checkpoint(MAX_LOG_BYTES)?;
        }
        Ok(false)
    }

    fn retain(&mut self, retention: Retention) {
        self.retention = retention;
    }

    fn prune(&mut self, now: Timestamp, max_bytes: u64) -> Holdings {
        let gone = retention::too_many(&self.directory, &self.retention, now, max_bytes);
        for (period, path, bytes) in gone {
            // What the coarser tier lacks is made of it first; if that cannot be, it is lost with the file.
            while period.tier.coarser().is_some() {
                match self.roll_one(period, Timestamp(i64::MAX)) {
                    Ok(true) => {}
                    Ok(false) => break,
                    Err(error) => {
                        tracing::error!(%error, "trends are removed before they were made coarser");
                        break;
                    }
                }
            }
            self.close(period);
            self.pending.remove(&period);
            match retention::remove(&path) {
                Ok(()) => {
                    self.n_removed += 1;
                    tracing::info!(file = %path.display(), bytes, "oldest trends removed");
                }
                Err(error) => {
                    tracing::error!(file = %path.display(), %error, "trends cannot be removed");
                }
            }
        }
        let (n_files, bytes, log_bytes) = retention::held(&self.directory);
        let (n_removed, n_set_aside) = (self.n_removed, self.n_set_aside);
        Holdings { n_files, bytes, log_bytes, n_removed, n_set_aside }
    }
}
