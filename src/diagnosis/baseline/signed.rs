//! A baseline that a person has learned and signed: frozen, and known by what it holds.
//!
//! The id is a digest of everything in it, who learned it and when included. It finds what was changed or
//! damaged; it is no protection against somebody who may write where baselines are kept.

use super::Record;
use super::robust;
use super::state::OperatingPoint;
use crate::signal::Timestamp;
use crate::units::Hz;
use sha2::Digest as _;
use sha2::Sha256;
use std::sync::Arc;

/// Longest author or comment, in characters.
pub const MAX_TEXT_CHARS: usize = 2000;

/// Baselines a machine may have: more are refused, so that a store does not fill up unseen.
pub const MAX_BASELINES: usize = 200;

/// A signed baseline.
#[derive(Debug, Clone, PartialEq)]
pub struct Signed {
    /// 64 hexadecimal digits: SHA-256 of the content.
    pub id: Arc<str>,
    /// Machine id.
    pub machine: String,
    /// Who called the records healthy.
    pub author: String,
    /// Why, or of what.
    pub comment: String,
    /// When, UTC.
    pub at: Timestamp,
    /// The records, of one operating state; each names the id.
    pub records: Vec<Record>,
}

/// Why records make no baseline.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SignError {
    /// Nothing was measured.
    #[error(
        "{record}: no window can be used ({windows}): choose a record or a time at which the machine ran steadily"
    )]
    Empty {
        /// The record.
        record: String,
        /// What became of its windows.
        windows: String,
    },
    /// No record was given.
    #[error("no record was given")]
    None,
    /// Who is not said.
    #[error("the author must not be empty")]
    NoAuthor,
    /// Author or comment is too long.
    #[error("{field} has {found} characters, at most {MAX_TEXT_CHARS} are allowed")]
    TextTooLong {
        /// Which text.
        field: &'static str,
        /// Its length.
        found: usize,
    },
    /// Records of different operating states.
    #[error("{record}: {why}: learn a baseline for each operating state")]
    States {
        /// The record.
        record: String,
        /// What differs.
        why: String,
    },
}

/// Checks who does something to a baseline, and why.
///
/// # Errors
/// When the author is empty or a text too long.
pub fn check_by(author: &str, comment: &str) -> Result<(), SignError> {
    if author.trim().is_empty() {
        return Err(SignError::NoAuthor);
    }
    for (field, text) in [("author", author), ("comment", comment)] {
        let found = text.chars().count();
        if found > MAX_TEXT_CHARS {
            return Err(SignError::TextTooLong { field, found });
        }
    }
    Ok(())
}

impl Signed {
    /// Signs records of one operating state.
    ///
    /// # Errors
    /// When there is none, one of them is empty, they are of different states, or a text is not allowed.
    pub fn new(
        machine: &str,
        (author, comment): (&str, &str),
        at: Timestamp,
        records: Vec<Record>,
        load_bins: &[f64],
    ) -> Result<Self, SignError> {
        check_by(author, comment)?;
        let first = records.first().ok_or(SignError::None)?.point;
        for record in &records {
            let name = || record.name.clone();
            if record.usual.is_empty() {
                return Err(SignError::Empty { record: name(), windows: record.windows_text() });
            }
            if let Some(why) = record.point.unfit(&first, load_bins) {
                return Err(SignError::States { record: name(), why });
            }
        }
        let mut signed = Self {
            id: Arc::from(""),
            machine: machine.to_owned(),
            author: author.to_owned(),
            comment: comment.to_owned(),
            at,
            records,
        };
        signed.id = Arc::from(signed.digest());
        for record in &mut signed.records {
            record.baseline = Some(Arc::clone(&signed.id));
        }
        Ok(signed)
    }

    /// Whether it is as it was signed.
    #[must_use]
    pub fn is_intact(&self) -> bool {
        *self.id == *self.digest()
            && self.records.iter().all(|record| record.baseline.as_ref() == Some(&self.id))
    }

    /// Its operating state: the medians over the records.
    #[must_use]
    pub fn point(&self) -> OperatingPoint {
        let points = self.records.iter().map(|record| record.point);
        let speeds: Vec<f64> = points.clone().filter_map(|point| Some(point.speed?.0)).collect();
        let loads: Vec<f64> = points.filter_map(|point| point.load).collect();
        OperatingPoint { speed: robust::median(&speeds).map(Hz), load: robust::median(&loads) }
    }

    /// Ids of those of `others`, of one machine, whose place it takes: they are of its operating state.
    #[must_use]
    pub fn replaces<'o>(
        &self,
        others: impl Iterator<Item = &'o Self>,
        load_bins: &[f64],
    ) -> Vec<Arc<str>> {
        let is_replaced =
            |other: &&Self| other.id != self.id && other.point().is_same(&self.point(), load_bins);
        others.filter(is_replaced).map(|other| Arc::clone(&other.id)).collect()
    }

    /// Digest of everything but the id.
    fn digest(&self) -> String {
        let mut digest = Content::default();
        digest.text("rotorwatch-baseline-1");
        for text in [&self.machine, &self.author, &self.comment] {
            digest.text(text);
        }
        digest.bytes(&self.at.0.to_le_bytes());
        digest.count(self.records.len());
        for record in &self.records {
            digest.record(record);
        }
        digest.hexadecimal()
    }
}

/// Digests parts that each say where they end.
#[derive(Default)]
struct Content(Sha256);

impl Content {
    fn hexadecimal(self) -> String {
        self.0.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }

    fn bytes(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    fn count(&mut self, count: usize) {
        self.bytes(&(count as u64).to_le_bytes());
    }

    fn text(&mut self, text: &str) {
        self.count(text.len());
        self.bytes(text.as_bytes());
    }

    /// Either zero counts as 0: databases hold one only.
    fn number(&mut self, number: Option<f64>) {
        self.bytes(&[u8::from(number.is_some())]);
        self.bytes(&number.map_or(0, |number| (number + 0.0).to_bits()).to_le_bytes());
    }

    fn record(&mut self, record: &Record) {
        self.text(&record.name);
        self.number(record.point.speed.map(|speed| speed.0));
        self.number(record.point.load);
        self.count(record.n_windows);
        self.count(record.left_out.len());
        for (why, n) in &record.left_out {
            self.text(why);
            self.count(*n);
        }
        self.count(record.usual.len());
        for ((channel, feature), usual) in &record.usual {
            self.text(channel);
            self.text(feature);
            self.number(Some(usual.log_value));
            self.number(usual.log_scatter);
            self.count(usual.n_windows);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnosis::baseline::Usual;
    use std::collections::BTreeMap;

    fn record(name: &str, speed: f64) -> Record {
        let usual = Usual { log_value: 0.25, log_scatter: Some(0.125), n_windows: 12 };
        Record {
            name: name.to_owned(),
            point: OperatingPoint { speed: Some(Hz(speed)), load: Some(3.0) },
            usual: BTreeMap::from([(("x".to_owned(), "rms".to_owned()), usual)]),
            n_windows: 12,
            left_out: BTreeMap::from([("not running".to_owned(), 2)]),
            ..Record::default()
        }
    }

    fn sign(records: Vec<Record>) -> Result<Signed, SignError> {
        Signed::new("rig-1", ("A. Berg", "new bearing"), Timestamp(5), records, &[])
    }

    /// The example of FIPS 180-4.
    #[test]
    fn the_digest_is_sha_256() {
        let mut digest = Content::default();
        digest.bytes(b"abc");
        let published = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(digest.hexadecimal(), published);
    }

    #[test]
    fn the_id_is_that_of_the_content_and_of_nothing_else() {
        let signed = sign(vec![record("a", 10.0), record("b", 10.1)]).unwrap();
        assert!(signed.is_intact() && signed.id.len() == 64);
        assert_eq!(signed.id, sign(vec![record("a", 10.0), record("b", 10.1)]).unwrap().id);
        let changes: [fn(&mut Signed); 10] = [
            |s| s.machine.push('x'),
            |s| s.author.push('x'),
            |s| s.comment.clear(),
            |s| s.at.0 += 1,
            |s| s.records.truncate(1),
            |s| s.records[1].name.push('x'),
            |s| s.records[1].point.load = None,
            |s| s.records[1].left_out.clear(),
            |s| s.records[1].usual.values_mut().for_each(|u| u.log_value += 1e-16),
            |s| s.records[1].usual.values_mut().for_each(|u| u.log_scatter = None),
        ];
        for (n, change) in changes.into_iter().enumerate() {
            let mut changed = signed.clone();
            change(&mut changed);
            assert!(!changed.is_intact(), "change {n}");
        }
    }

    #[test]
    fn records_that_make_no_baseline_are_refused_with_the_remedy() {
        assert_eq!(sign(Vec::new()), Err(SignError::None));
        assert_eq!(check_by(" \t", ""), Err(SignError::NoAuthor));
        assert_eq!(check_by("ä", &"ä".repeat(MAX_TEXT_CHARS)), Ok(()));
        assert!(check_by("a", &"a".repeat(MAX_TEXT_CHARS + 1)).is_err());
        let states = sign(vec![record("a", 10.0), record("b", 12.0)]).unwrap_err().to_string();
        assert!(states.starts_with("b: its speed of 12.00 Hz"), "{states}");
        let empty = Record { usual: BTreeMap::new(), n_windows: 0, ..record("c", 10.0) };
        let empty = sign(vec![empty]).unwrap_err().to_string();
        assert!(
            empty.contains("c: no window can be used (0 of 2 windows (2: not running))"),
            "{empty}"
        );
    }

    #[test]
    fn the_state_is_the_median_of_the_records() {
        let signed = sign(vec![record("a", 10.0), record("b", 10.4), record("c", 10.1)]).unwrap();
        assert_eq!(signed.point().speed, Some(Hz(10.1)));
    }

    #[test]
    fn a_baseline_takes_the_place_of_those_of_its_operating_state() {
        let [a, b, c] = [10.0, 10.3, 20.0].map(|hz| sign(vec![record("r", hz)]).unwrap());
        let others = [a.clone(), b.clone(), c];
        assert_eq!(a.replaces(others.iter(), &[]), [b.id]);
    }
}
