//! Delays and hysteresis of alarms in the state database: stored with what they led to, in the same commit.

use super::Batch;
use super::StoreError;
use super::StreamKey;
use super::opening::failed;
use crate::alarms::Decisions;
use crate::tape::Tape;
use rusqlite::Connection;
use rusqlite::OptionalExtension;
use rusqlite::Transaction;
use rusqlite::params;

/// Ends each word.
const END: char = '\0';

/// Stores what the batch says of them.
pub(super) fn write(transaction: &Transaction<'_>, batch: &Batch) -> rusqlite::Result<()> {
    let (Some(decisions), Some(judged_by)) = (&batch.decisions, &batch.stream.judged_by) else {
        return Ok(());
    };
    let mut tape = Tape::default();
    decisions.write(&mut tape);
    let numbers: Vec<u8> = tape.numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
    let words = tape.words.iter().fold(String::new(), |all, word| all + word + "\0");
    transaction
        .prepare_cached(
            "INSERT OR REPLACE INTO decision (machine, judged_by, numbers, words) VALUES (?1, ?2, ?3, ?4)",
        )?
        .execute(params![batch.machine, judged_by, numbers, words])?;
    Ok(())
}

/// Those of a machine, if they are of the configuration that judges now.
pub(super) fn read(
    connection: &Connection,
    machine: &str,
    stream: &StreamKey,
) -> Result<Option<Decisions>, StoreError> {
    let found: Option<(Vec<u8>, String)> = connection
        .query_row(
            "SELECT numbers, words FROM decision WHERE machine = ?1 AND judged_by = ?2",
            params![machine, stream.judged_by],
            |row| Ok((row.get(0)?, row.get(1)?)),
        )
        .optional()
        .map_err(|source| failed("reading the delays of alarms", source))?;
    let Some((numbers, words)) = found else { return Ok(None) };
    let (numbers, rest) = numbers.as_chunks::<8>();
    let words = words.strip_suffix(END).map(|words| words.split(END).map(str::to_owned).collect());
    let tape = Tape {
        numbers: numbers.iter().map(|bytes| f64::from_le_bytes(*bytes)).collect(),
        words: words.unwrap_or_default(),
    };
    Ok(Decisions::read(&mut tape.reader()).filter(|_| rest.is_empty()))
}
