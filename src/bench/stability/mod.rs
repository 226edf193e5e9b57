//! Hard cases as rows: what was asked, what is right, what was found, how far they may be apart and why.
//!
//! One function a case; `tests/stability` asks each row to hold, `rotorwatch bench stability` prints them all. Behind
//! the cases comes the search for trouble: `random` runs scenes that `drawn` makes up, `transforms` signals, `extremes`
//! both ends of every number that a file may hold.

pub mod rows;
pub mod oscillators;
pub mod rotors;
pub mod bearings;
pub mod drawn;
pub mod random;
pub mod transforms;
pub mod extremes;

use super::{BenchError, Tell};
use rows::Row;
use serde_json::{Value, json};

/// The rows of a case.
pub type Rows = Result<Vec<Row>, BenchError>;

/// A case, and why its rows have their tolerances unless a row says so itself.
pub type Case = (fn() -> Rows, &'static str);

/// Every case, quick ones first.
pub const CASES: &[Case] = &[
    (oscillators::hertz_spring, "five decimals of the quadrature"),
    (oscillators::pumped_spring, "first order of the averaged equation"),
    (oscillators::without_damping, "rounding, one a step"),
    (oscillators::unbalance_and_bow, "rounding of a closed form"),
    (rotors::contact_approach, "five digits of the published tables"),
    (rotors::natural_frequencies, "elements converge with the square of their length"),
    (rotors::run_up_through_critical, "four digits of the quadrature"),
    (bearings::same_twice, "the same bits"),
    (bearings::mirror_image, "rounding in another order"),
    (bearings::reversing, "error of the steps"),
    (bearings::edge_on_a_sample, "error of the steps"),
    (bearings::two_edges_in_a_step, "error of the steps"),
    (bearings::rest, "of equilibrium, where it is sought by iteration"),
    (bearings::varying_compliance, "a line between two bins"),
    (bearings::truncated_basis, "digits of the independent reference"),
    (bearings::shapes_chosen, "ten times the accuracy asked for"),
    (bearings::order_of_steps, "measured orders scatter by some tenths"),
    (bearings::errors_of_steps, "twice what was measured"),
];

/// How far the search goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Search {
    /// Number of the first scene and of the first signal.
    pub first_seed: u64,
    /// Scenes.
    pub n_scenes: u64,
    /// Signals.
    pub n_signals: u64,
    /// What is done at the ends of the ranges of numbers.
    pub extremes: Extremes,
    /// Cases before it, the first of the list.
    pub n_cases: usize,
}

/// What is done at the ends of the ranges of numbers in files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extremes {
    /// Nothing.
    None,
    /// They are read.
    Read,
    /// They are read, and scenes run.
    Run,
}

impl Search {
    /// Scenes at random alone.
    #[must_use]
    pub fn of_scenes(first_seed: u64, n_scenes: u64) -> Self {
        Self { first_seed, n_scenes, n_signals: 0, extremes: Extremes::None, n_cases: 0 }
    }

    /// For the documents.
    #[must_use]
    pub fn json(&self) -> Value {
        json!({
            "first_seed": self.first_seed,
            "scenes": self.n_scenes,
            "signals": self.n_signals,
        })
    }

    /// What figures are published with.
    pub const WHOLE: Self = Self {
        first_seed: 0,
        n_scenes: 10_000,
        n_signals: 2000,
        extremes: Extremes::Run,
        n_cases: usize::MAX,
    };

    /// Minutes of work, for every change.
    pub const THINNED: Self =
        Self { n_scenes: 300, n_signals: 200, extremes: Extremes::Read, ..Self::WHOLE };

    /// Seconds of work: shows that it works.
    pub const QUICK: Self =
        Self { n_scenes: 1, n_signals: 2, extremes: Extremes::Read, n_cases: 2, ..Self::WHOLE };
}

/// Computes all and hands on each row.
///
/// # Errors
///
/// [`BenchError`] when a case cannot be computed.
pub fn run(search: &Search, tell: &mut Tell<'_>) -> Rows {
    let mut rows = Vec::new();
    let mut keep = |found: Vec<Row>, reason| {
        for row in found {
            let row = row.usually_because(reason);
            tell(&row.cells())?;
            rows.push(row);
        }
        Ok::<(), BenchError>(())
    };
    for (case, reason) in CASES.iter().take(search.n_cases) {
        keep(case()?, reason)?;
    }
    keep(transforms::signals(search)?, "")?;
    match search.extremes {
        Extremes::None => {}
        Extremes::Read => keep(extremes::values_read()?, "")?,
        Extremes::Run => keep(extremes::values()?, "")?,
    }
    keep(random::scenes(search)?, "")?;
    Ok(rows)
}
