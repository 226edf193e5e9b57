//! The simulator's hard cases as rows: what was asked, what is right, what was found, how far they may be
//! apart.
//!
//! One function a case; `tests/stability` asks each row to hold, `rotorwatch bench stability` prints
//! them all.

pub mod rows;
pub mod oscillators;
pub mod rotors;
pub mod bearings;

use super::{BenchError, Tell};
use rows::Row;

/// The rows of a case.
pub type Rows = Result<Vec<Row>, BenchError>;

/// Every case, quick ones first.
pub const CASES: &[fn() -> Rows] = &[
    oscillators::hertz_spring,
    oscillators::pumped_spring,
    oscillators::without_damping,
    oscillators::unbalance_and_bow,
    rotors::contact_approach,
    rotors::natural_frequencies,
    rotors::run_up_through_critical,
    bearings::same_twice,
    bearings::mirror_image,
    bearings::reversing,
    bearings::edge_on_a_sample,
    bearings::two_edges_in_a_step,
    bearings::rest,
    bearings::varying_compliance,
    bearings::truncated_basis,
    bearings::shapes_chosen,
    bearings::order_of_steps,
    bearings::errors_of_steps,
];

/// Computes the first `n_cases` and hands on each row.
///
/// # Errors
///
/// [`BenchError`] when a case cannot be computed.
pub fn run(n_cases: usize, tell: &mut Tell<'_>) -> Rows {
    let mut rows = Vec::new();
    for case in CASES.iter().take(n_cases) {
        for row in case()? {
            tell(&row.cells())?;
            rows.push(row);
        }
    }
    Ok(rows)
}
