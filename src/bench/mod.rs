//! What the program measures of itself: speed against error of the simulator and of the signal processing,
//! the simulator's hard cases against what is known of them, and the whole pipeline.
//!
//! `simulator`, `stability`, `signal` and `monitor` compute rows and hand each on as it is done; `table` and `crate::plot` word
//! them. `gaps` says how far results are apart, `records` compares motions, `scenes` has what they are compared on; tests use both. Reads the processor's
//! clock, writes no files. Must not know the command line.

pub mod computer;
pub mod table;
pub mod scenes;
pub mod gaps;
pub mod records;
pub mod simulator;
pub mod stability;
pub mod clock;
pub mod signal;
pub mod monitor;
pub mod thinning;

use crate::simulator::scene::SceneErrors;
use crate::simulator::simulation::AdvanceError;
use std::convert::Infallible;
use std::error::Error;

/// Why a bench has no result.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// A scene cannot be built.
    #[error(transparent)]
    Scene(#[from] SceneErrors),
    /// A motion diverged.
    #[error(transparent)]
    Advance(#[from] AdvanceError<Infallible>),
    /// A case cannot be computed.
    #[error("{case}: there is no {what}")]
    Absent {
        /// The case.
        case: &'static str,
        /// What it needs.
        what: &'static str,
    },
    /// A capture could not be written, or a row not be told.
    #[error("a result cannot be written")]
    Write(#[source] Box<dyn Error + Send + Sync>),
}

/// Takes a row as soon as it is there.
pub type Tell<'a> = dyn FnMut(&[table::Cell]) -> Result<(), BenchError> + 'a;
