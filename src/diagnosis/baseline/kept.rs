//! A baseline on a tape, bit by bit: kept with the evidence of what was judged against it.

use super::Baseline;
use super::OperatingPoint;
use super::Record;
use super::Usual;
use crate::tape::Reader;
use crate::tape::Tape;
use crate::units::Hz;
use std::sync::Arc;

impl Baseline {
    /// Writes all of it.
    pub fn write(&self, tape: &mut Tape) {
        tape.write_flag(self.provisional);
        tape.write_count(self.records.len());
        self.records.iter().for_each(|record| write_record(record, tape));
    }

    /// Reads what [`Self::write`] wrote; `None`: it is something else.
    #[must_use]
    pub fn read(tape: &mut Reader<'_>) -> Option<Self> {
        Some(Self { provisional: tape.flag()?, records: tape.list(read_record)? })
    }
}

fn write_record(record: &Record, tape: &mut Tape) {
    tape.write_word(&record.name);
    tape.write_flag(record.baseline.is_some());
    if let Some(id) = &record.baseline {
        tape.write_word(id);
    }
    tape.write_option(record.point.speed.map(|speed| speed.0));
    tape.write_option(record.point.load);
    tape.write_count(record.n_windows);
    tape.write_count(record.left_out.len());
    for (why, n) in &record.left_out {
        tape.write_word(why);
        tape.write_count(*n);
    }
    tape.write_count(record.usual.len());
    for ((channel, feature), usual) in &record.usual {
        tape.write_word(channel);
        tape.write_word(feature);
        tape.write(&[usual.log_value]);
        tape.write_option(usual.log_scatter);
        tape.write_count(usual.n_windows);
    }
}

fn read_record(tape: &mut Reader<'_>) -> Option<Record> {
    let name = tape.word()?.to_owned();
    let baseline = if tape.flag()? { Some(Arc::from(tape.word()?)) } else { None };
    let point = OperatingPoint { speed: tape.option()?.map(Hz), load: tape.option()? };
    let n_windows = tape.count()?;
    let left_out = tape.list(|tape| Some((tape.word()?.to_owned(), tape.count()?)))?;
    let usual = tape.list(|tape| {
        let key = (tape.word()?.to_owned(), tape.word()?.to_owned());
        let (log_value, log_scatter) = (tape.number()?, tape.option()?);
        Some((key, Usual { log_value, log_scatter, n_windows: tape.count()? }))
    })?;
    let (left_out, usual) = (left_out.into_iter().collect(), usual.into_iter().collect());
    Some(Record { name, baseline, point, usual, n_windows, left_out, channels: Vec::new() })
}
