//! Recording what a source delivers, as it was received, so that a kill loses nothing flushed.
//!
//! [`align`] cuts the stream into stretches that all channels begin together, [`mod@file`] is one
//! file and `declare` what it states before its first sample, [`machine`] the files of one machine, [`store`] the folder with its limit, [`repair`]
//! what happens to a file that a recorder left open. `docs/hdf5.md` is the layout. Time comes in as
//! an argument. Must not know what the samples mean or who asks for the files.

pub mod align;
mod column;
mod declare;
pub mod file;
pub mod repair;
pub mod store;
pub mod machine;
pub mod triggered;

#[cfg(test)]
mod tests;
