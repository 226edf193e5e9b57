//! Minutes made of windows, and hours made of minutes.
//!
//! A coarser block is nothing but its finer ones gathered: made again it is the same, whatever happened
//! in between.

use super::CONFIDENCE;
use super::SEVERITY;
use super::STATE;
use super::block::Gathering;
use super::block::WIDTH;
use super::file::SeriesName;
use super::file::TrendFile;
use super::file::gather;
use super::period::Tier;
use crate::alarms::past::PastVerdict;
use crate::alarms::past::PastWindow;
use crate::diagnosis::fault::State;
use crate::store::StoreError;
use crate::units::Unit;
use std::collections::BTreeMap;
use std::sync::Arc;

/// What is gathered of each series.
pub(super) type Gathered = BTreeMap<SeriesName, Gathering>;

/// The numbers of a verdict, with their names.
pub(super) fn numbers(verdict: &PastVerdict) -> [(&'static str, f32); 3] {
    numbers_of(verdict.state, verdict.severity, verdict.confidence)
}

/// The numbers by which a verdict is kept, with their names.
#[must_use]
pub fn numbers_of(
    state: State,
    severity: Option<f64>,
    confidence: Option<f64>,
) -> [(&'static str, f32); 3] {
    let state = match state {
        State::Undetermined => f32::NAN,
        State::Healthy => 1.0,
        State::Warning => 2.0,
        State::Damaged => 3.0,
    };
    #[expect(clippy::cast_possible_truncation, reason = "what is stored is f32")]
    let number = |value: Option<f64>| value.map_or(f32::NAN, |value| value as f32);
    [(STATE, state), (SEVERITY, number(severity)), (CONFIDENCE, number(confidence))]
}

/// Gathers the verdicts of windows at a place.
pub(super) fn gather_verdicts(windows: &[PastWindow], place: usize, n: usize, into: &mut Gathered) {
    for verdict in windows.iter().flat_map(|window| &window.verdicts) {
        let name = (verdict.kind.name().to_owned(), verdict.id.clone());
        let gathering = into.entry(name).or_insert_with(|| Gathering::new(n));
        for (name, value) in numbers(verdict) {
            gathering.add_values(place, &(Arc::from(name), Unit::One), &[value]);
        }
    }
}

/// Gathers everything that `finer` holds of a stream in a block of the coarser tier.
pub(super) fn of_stream(
    finer: &TrendFile,
    tier: Tier,
    block: i64,
    stream: i64,
) -> Result<Gathered, StoreError> {
    let n = tier.places();
    let width = if finer.period.tier == Tier::Windows { 1 } else { WIDTH };
    let series = finer.series_of(stream)?;
    let mut gathered = Gathered::new();
    for (place, below) in tier.blocks_below(block).enumerate() {
        if width == 1
            && let Some(windows) = finer.windows(below, stream)?
        {
            gather_verdicts(&windows, place, n, &mut gathered);
        }
        for (id, name) in &series {
            if let Some(row) = finer.row(below, *id, width)? {
                let into = gathered.entry(name.clone()).or_insert_with(|| Gathering::new(n));
                gather(&row, place, width, into);
            }
        }
    }
    Ok(gathered)
}
