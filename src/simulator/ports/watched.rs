//! What is watched of a motion: rows over its coordinates, behind anti-alias filters or not
//! (equation R35).
//!
//! A filter is driven by the coordinates and by the forces. Less what the coordinates make of it, its
//! own motion ξ̃ = ξ − Σ ½(c·s/(λ − μ) + c̄·s̄/(λ̄ − μ)) is driven by the forces alone, like every
//! coordinate.

use super::Sensed;
use super::filter::LowPass;
use super::lanes::Rows;
use super::linearise::Ports;
use super::spectrum::Spectrum;
use crate::simulator::linear::{LinearSystem, Seen, Steady, Still};
use nalgebra::Complex;

/// What is watched.
#[derive(Debug, Clone)]
pub(super) struct Watched {
    pub(super) rows: Rows,
    /// Effect at once of the force at each port, [watch·n_in + port].
    pub(super) direct: Vec<f64>,
    /// Steady part.
    pub(super) still: Vec<Still>,
    /// The filters' coordinates, which follow those of the motion.
    poles: Vec<Pole>,
}

/// A coordinate of a filter.
#[derive(Debug, Clone)]
struct Pole {
    rate: Complex<f64>,
    /// What the coordinates s of the motion make of it: Σ of·s + of_conjugate·s̄.
    of: Vec<Complex<f64>>,
    of_conjugate: Vec<Complex<f64>>,
    /// What the steady motion makes of it: constant, and what turns with and against each shaft.
    constant: Complex<f64>,
    turning: Vec<[Complex<f64>; 2]>,
    /// What a unit force at each port does.
    inputs: Vec<Complex<f64>>,
}

impl Watched {
    pub(super) fn new(
        (system, steady, spectrum): (&LinearSystem, &Steady, &Spectrum),
        ports: &Ports,
        sensed: &[Sensed],
    ) -> Self {
        let n_motion = spectrum.values.len();
        let inputs: Vec<_> = ports.inputs.iter().map(|input| spectrum.input(input)).collect();
        let (mut all, mut poles) = (Vec::new(), Vec::new());
        let (mut direct, mut still) = (Vec::new(), Vec::new());
        for Sensed { watch, corner_hz } in sensed {
            let Seen { row, still: seen } = Seen::by(system, steady, watch);
            let weights = spectrum.output(&row);
            let at_once: Vec<f64> =
                ports.rows.iter().map(|row| system.direct(watch, row)).collect();
            let Some(filter) = corner_hz.map(LowPass::butterworth) else {
                all.push(weights);
                direct.extend(at_once);
                still.push(seen);
                continue;
            };
            // Phasor and i·speed of every shaft.
            let turning = seen[1..].chunks_exact(2).zip(steady.speeds_rad_per_s(system));
            let turning: Vec<_> = turning
                .map(|(part, speed)| (Complex::new(part[0], -part[1]), Complex::new(0.0, speed)))
                .collect();
            let mut passed = seen;
            for (part, (phasor, speed)) in passed[1..].chunks_exact_mut(2).zip(&turning) {
                let passed = phasor * filter.response(*speed);
                part.copy_from_slice(&[passed.re, -passed.im]);
            }
            let through =
                weights.iter().zip(&spectrum.values).map(|(c, l)| c * filter.response(*l));
            let mut row: Vec<Complex<f64>> = through.collect();
            row.resize(n_motion + poles.len(), Complex::new(0.0, 0.0));
            for (rate, residue) in filter.halves() {
                row.push(residue * 2.0);
                let of_shaft = |(phasor, speed): &(Complex<f64>, Complex<f64>)| {
                    [(*phasor, *speed), (phasor.conj(), -*speed)]
                        .map(|(part, at)| part * (at - rate).inv() * 0.5)
                };
                let turning = turning.iter().map(of_shaft).collect();
                poles.push(Pole::new(
                    rate,
                    (-seen[0] / rate, turning),
                    (&weights, &spectrum.values),
                    (&at_once, &inputs),
                ));
            }
            all.push(row);
            direct.extend(ports.rows.iter().map(|_| 0.0));
            still.push(passed);
        }
        let len = super::lanes::list_len(n_motion + poles.len());
        let mut rows = Rows::zero(sensed.len(), len);
        for (i, weights) in all.iter().enumerate() {
            rows.set(i, weights);
        }
        Self { rows, direct, still, poles }
    }

    /// Rates of the filters' coordinates.
    pub(super) fn rates(&self) -> impl Iterator<Item = Complex<f64>> {
        self.poles.iter().map(|pole| pole.rate)
    }

    /// What a unit force at a port does to the filters' coordinates.
    pub(super) fn input(&self, port: usize) -> impl Iterator<Item = Complex<f64>> {
        self.poles.iter().map(move |pole| pole.inputs[port])
    }

    /// States of the filters by their coordinates, or back: `sign` 1 or −1. `turn` is e^{iφ} of every shaft.
    pub(super) fn states(
        &self,
        coordinates: &[Complex<f64>],
        motion: &[Complex<f64>],
        turn: &[Complex<f64>],
        sign: f64,
    ) -> Vec<Complex<f64>> {
        let state = |(pole, own): (&Pole, &Complex<f64>)| {
            let pairs = motion.iter().zip(pole.of.iter().zip(&pole.of_conjugate));
            let driven: Complex<f64> = pairs.map(|(s, (a, b))| a * s + b * s.conj()).sum();
            let turning: Complex<f64> = pole
                .turning
                .iter()
                .zip(turn)
                .map(|([with, against], turn)| with * turn + against * turn.conj())
                .sum();
            own + (driven + pole.constant + turning) * sign
        };
        self.poles.iter().zip(coordinates).map(state).collect()
    }

    /// Number of filter coordinates.
    pub(super) fn n_poles(&self) -> usize {
        self.poles.len()
    }
}

impl Pole {
    fn new(
        rate: Complex<f64>,
        (constant, turning): (Complex<f64>, Vec<[Complex<f64>; 2]>),
        (weights, values): (&[Complex<f64>], &[Complex<f64>]),
        (at_once, inputs): (&[f64], &[Vec<Complex<f64>>]),
    ) -> Self {
        let pairs = || weights.iter().zip(values);
        let of: Vec<_> = pairs().map(|(c, value)| c * 0.5 / (value - rate)).collect();
        let of_conjugate: Vec<_> =
            pairs().map(|(c, value)| c.conj() * 0.5 / (value.conj() - rate)).collect();
        let driven = |input: &Vec<Complex<f64>>| -> Complex<f64> {
            let pairs = input.iter().zip(of.iter().zip(&of_conjugate));
            pairs.map(|(b, (a, a_conjugate))| a * b + a_conjugate * b.conj()).sum()
        };
        let inputs =
            at_once.iter().zip(inputs).map(|(direct, input)| *direct - driven(input)).collect();
        Self { rate, of, of_conjugate, constant, turning, inputs }
    }
}
