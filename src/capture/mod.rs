//! Capture files: recordings in and out.
//!
//! [`reader`] streams a file as blocks of physical samples, converted once: HDF5 of our layout or,
//! with a [`map`], of any other; CSV; WAV. [`writer`] makes finished files, [`streaming`] those of any
//! length; `docs/hdf5.md` is the layout. A file is never believed: every declared size is checked
//! against the file and a limit before anything is allocated from it. Must not know what the samples
//! mean, and never reads ground truth (`/truth`, `label`-like attributes).

pub mod error;
pub mod content;
pub mod hints;
pub mod map;
pub mod foreign;
pub mod info;
pub mod received;
pub mod attachment;
pub mod held;
pub mod live;
pub mod reader;
pub mod writer;
pub mod recording;
pub mod streaming;

mod open;
mod hdf5; // the only folder that names the crate
mod filters;
mod root;
mod links;
mod checks;
mod layout;
mod dataset;
mod integrity;
mod checksums;
mod rows;
mod channel_unit;
mod segments;
mod since_1970;
mod convert;
mod stream;
mod table;
pub mod trend;
mod csv;
mod wav;

#[cfg(test)]
mod tests;
