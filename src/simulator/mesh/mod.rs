//! A spur gear mesh: tooth compliance by the potential-energy method, pairs of teeth in contact,
//! faults of teeth, and the force between two gears (equations R18–R25).
//!
//! `gear` is the involute, `tooth` its compliance, `curve` a fast stand-in for it, `pair` two teeth
//! with their faults, `element` the force for gears in motion. Must not know shafts, time or scenes.

mod curve;
mod element;
mod gear;
mod pair;
mod quadrature;
mod tooth;

pub use element::{Crossing, Mesh, Moment};
pub use gear::{GearShape, Path};
pub use pair::{Fault, Flank, Member, MeshDesign, ToothFault, design_error};
pub use tooth::{Compliance, Crack, Root, Steel, ToothModel, ToothState};

#[cfg(test)]
mod tests;
