//! HDF5 files of another layout: read by a map, or listed with the map that would read them.
//!
//! `mapped` turns the entries of a map into tables of samples; [`inventory`] tells what a file
//! holds and suggests the map. Must not know our own layout.

pub mod inventory;

pub(super) mod mapped;

mod objects; // links and element types
mod grid; // which strip of a data set is a channel
mod places; // numbers and texts elsewhere in the file
mod facts; // what holds for the whole recording
mod times; // vectors of times
mod spelling; // units as others write them
mod suggest;

#[cfg(test)]
mod tests;
