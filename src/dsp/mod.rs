//! The numeric core: slices in, slices or values out.
//!
//! Everything is generic over [`real::Real`] (`f32` for the running monitor, `f64` as reference).
//! What a kernel needs between calls is a named plan: *plans allocate, processing does not*. The
//! plans that start from one spectrum share one forward transform ([`fft::ForwardPlan`]); the plans
//! of one length share their twiddles through one [`fft::FftCache`].
//!
//! Conventions of every kernel: samples are finite (a NaN in gives a NaN out; keeping it out is the
//! caller's duty), frequencies are in Hz, amplitudes zero-to-peak, moments population moments
//! (1/N) with the mean removed, phase is lag (A·cos(θ − φ)). A zero denominator gives `None`, never
//! 0 or ∞. A slice whose length does not fit its plan is a fault of the caller and panics. Equation
//! numbers D1… refer to `docs/theory.md`.
//!
//! Must not know machines, sensors, baselines or thresholds: only rates, frequencies and lengths.

pub mod real;
mod lanes;
pub mod moments;
pub mod stats;
pub mod window;
mod butterfly;
mod grid;
mod split;
mod power_sums;
mod inverse;
mod forward;
pub mod fft;
mod length;
pub mod spectrum;
pub mod welch;
pub mod cross;
pub mod zoom;
pub mod synthesis;
pub mod cepstrum;
pub mod complex_cepstrum;
pub mod line;
pub mod full_spectrum;
pub mod absolute;
pub mod sos;
pub mod butterworth;
pub mod fir;
pub mod filter_bank;
pub mod kurtogram;
pub mod envelope;
pub mod turn_gate;
pub mod band_envelope;
pub mod impulsive;
pub mod low_band;
pub mod whiten;
pub mod drs;
pub mod integrate;
pub mod cwt;
pub mod sample_check;
pub mod cwt_bank;
pub mod wavelet;
pub mod bilinear;
pub mod tacho;
mod hermite;
pub mod order;
pub mod pulses;
pub mod interpolate;
pub mod tsa;
pub mod gear;
pub mod demodulate;
pub mod mesh_angle;
pub mod history;
pub mod stft;
pub mod order_track;
pub mod order_spectrum;
pub mod comb;
pub mod speed_track;
pub mod speed_law;

#[cfg(test)]
mod drift;
#[cfg(test)]
mod hard_cases;
#[cfg(test)]
pub(crate) mod reference;
