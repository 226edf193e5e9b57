//! The rig, simulated: shaft, discs, ball bearings with defects, and what sensors make of it.
//!
//! ```text
//! text ─scene─▶ Scene ─build─▶ Model ─run (contacts, run-ups) or linear (exact)─▶ motion ─sensor─▶ samples
//! ```
//!
//! [`scene::Scene::parse`], then [`simulation::Simulation`]; [`explain`] says what was modelled.
//!
//! A leaf: a scene in, samples out. The monitor does not know it exists, and it does not know the
//! monitor. Pure and synchronous: time steps and the seed are arguments.

pub mod hertz;
pub mod beam;
pub mod rotor;
pub mod torsion;
pub mod modes;
pub mod reduction;
pub mod speed;
pub mod etd;
pub mod contact;
pub mod mesh;
pub mod model;
pub mod run;
pub mod reference;
pub mod sensor;
mod lanes;
mod spectrum;
pub mod linear;
pub mod ports;
pub mod scene;
pub mod build;
pub mod simulation;
pub mod scenario;
pub mod explain;
