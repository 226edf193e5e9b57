//! Wavelets beside Morlet's: pictures by the continuous transform, decompositions by the discrete one.
//!
//! `taps` makes filter banks from their definition, `shape` the transform ψ̂ of each wavelet, `picture`
//! multiplies spectra by it, `dwt` goes to octaves and back. Must not know shafts or meshes.

pub mod taps;
pub mod shape;
pub mod picture;
pub mod dwt;
