//! Numbers → what is wrong, how badly, how sure, why. Pure: no labels, names of files or clocks.

pub mod fault;
pub mod verdict;
