//! What is watched of a motion: rows over its coordinates, behind anti-alias filters or not
//! (equation R35).
//!
//! A filter is driven by the coordinates and by the forces. Less what the coordinates make of it, its
//! own motion ξ̃ = ξ − Σ ½(c·s/(λ − μ) + c̄·s̄/(λ̄ − μ)) is driven by the forces alone, like every
//! coordinate. What a force at a port makes of a pole μ is one number for all filters with this pole,
//! whatever they watch: those numbers are carried, and weighted where a sample is taken.

use super::Sensed;
use super::filter::LowPass;
use super::linearise::Ports;
use crate::simulator::lanes::{self, Rows, WIDTH};
use crate::simulator::linear::{LinearSystem, Seen, Steady, Still};
use crate::simulator::spectrum::Spectrum;
use nalgebra::Complex;

/// A filter's state below this is none: far from what anything shows, and from the least number
/// there is.
const DIED_OUT: f64 = 1e-150;

/// What is watched.
#[derive(Debug, Clone)]
pub(super) struct Watched {
    pub(super) rows: Rows,
    /// Effect at once of the force at each port, [watch·n_in + port].
    pub(super) direct: Vec<f64>,
    /// Steady part.
    pub(super) still: Vec<Still>,
    /// Poles of all filters, filters of one corner once.
    pub(super) poles: Vec<Complex<f64>>,
    places: Places,
    /// The filters' own motions.
    own: Vec<Own>,
}

/// Where the filters' coordinates stand behind those of the motion: for each pole first what a force
/// at each port makes of it, then what each watch began with.
#[derive(Debug, Clone, Copy)]
struct Places {
    /// Places of the motion, filled up, and blocks of ports and of watches.
    n_motion: usize,
    port_blocks: usize,
    watch_blocks: usize,
}

/// The own motion of one watch's filter at one of its poles.
#[derive(Debug, Clone)]
struct Own {
    watch: usize,
    pole: usize,
    /// What the coordinates s of the motion make of it: Σ of·s + of_conjugate·s̄.
    of: Vec<Complex<f64>>,
    of_conjugate: Vec<Complex<f64>>,
    /// What the steady motion makes of it.
    still: StillState,
    /// What a unit force at each port does.
    inputs: Vec<Complex<f64>>,
}

/// What a steady motion makes of a filter's state: constant, and what turns with and against each shaft.
type StillState = (Complex<f64>, Vec<[Complex<f64>; 2]>);

impl Places {
    /// Places of a pole.
    fn of_pole(self, pole: usize) -> usize {
        self.n_motion + pole * (self.port_blocks + self.watch_blocks) * WIDTH
    }

    fn of_port(self, pole: usize, port: usize) -> usize {
        self.of_pole(pole) + port
    }

    fn of_watch(self, pole: usize, watch: usize) -> usize {
        self.of_pole(pole) + self.port_blocks * WIDTH + watch
    }
}

impl Watched {
    pub(super) fn new(
        (system, steady, spectrum): (&LinearSystem, &Steady, &Spectrum),
        ports: &Ports,
        sensed: &[Sensed],
    ) -> Self {
        let inputs: Vec<_> = ports.inputs.iter().map(|input| spectrum.input(input)).collect();
        let places = Places {
            n_motion: spectrum.values.len().next_multiple_of(WIDTH),
            port_blocks: inputs.len().div_ceil(WIDTH),
            watch_blocks: sensed.len().div_ceil(WIDTH),
        };
        let mut corners_hz: Vec<f64> = Vec::new();
        let (mut all, mut poles, mut filters) = (Vec::new(), Vec::new(), Vec::new());
        let (mut direct, mut still) = (Vec::new(), Vec::new());
        for (watch, sensed) in sensed.iter().enumerate() {
            let Seen { row, still: seen } = Seen::by(system, steady, &sensed.watch);
            let weights = spectrum.output(&row);
            let at_once: Vec<f64> =
                ports.rows.iter().map(|row| system.direct(&sensed.watch, row)).collect();
            let Some(corner_hz) = sensed.corner_hz else {
                all.push(weights);
                direct.extend(at_once);
                still.push(seen);
                continue;
            };
            let filter = LowPass::butterworth(corner_hz);
            let known = corners_hz.iter().position(|known| known.to_bits() == corner_hz.to_bits());
            let number = known.unwrap_or(corners_hz.len());
            if known.is_none() {
                corners_hz.push(corner_hz);
                poles.extend(filter.halves().map(|(rate, _)| rate));
            }
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
            let n_halves = filter.halves().count();
            for (half, (rate, residue)) in filter.halves().enumerate() {
                let pole = number * n_halves + half;
                let own = Own::new(Followed {
                    place: (watch, pole),
                    rate,
                    still: (-seen[0] / rate, turned(&turning, rate)),
                    modes: (&weights, &spectrum.values),
                    inputs: (&at_once, &inputs),
                });
                let needed = places.of_pole(pole + 1);
                row.resize(needed.max(row.len()), Complex::new(0.0, 0.0));
                for (port, input) in own.inputs.iter().enumerate() {
                    row[places.of_port(pole, port)] = residue * 2.0 * input;
                }
                row[places.of_watch(pole, watch)] = residue * 2.0;
                filters.push(own);
            }
            all.push(row);
            direct.extend(ports.rows.iter().map(|_| 0.0));
            still.push(passed);
        }
        let mut rows = Rows::zero(sensed.len(), 2 * places.of_pole(poles.len()));
        for (i, weights) in all.iter().enumerate() {
            rows.set(i, weights);
        }
        Self { rows, direct, still, poles, places, own: filters }
    }

    /// The filters' part of a list: what they begin with, from one state for each of [`Watched::states`].
    pub(super) fn begun(
        &self,
        states: &[Complex<f64>],
        motion: &[Complex<f64>],
        turn: &[Complex<f64>],
    ) -> Vec<f64> {
        let places = self.places;
        let n = places.of_pole(self.poles.len()) - places.n_motion;
        let mut numbers = vec![Complex::new(0.0, 0.0); n];
        for (own, state) in self.own.iter().zip(states) {
            let at = places.of_watch(own.pole, own.watch) - places.n_motion;
            numbers[at] = state - own.driven(motion, turn);
        }
        lanes::list(&numbers)
    }

    /// States of the filters, by watch and pole, of a list of which this is the motion.
    pub(super) fn states(
        &self,
        list: &[f64],
        motion: &[Complex<f64>],
        turn: &[Complex<f64>],
    ) -> Vec<Complex<f64>> {
        let at = |place: usize| {
            let (re, im) = lanes::places(place);
            Complex::new(list[re], list[im])
        };
        let state = |own: &Own| {
            let begun = at(self.places.of_watch(own.pole, own.watch));
            let pushed = own.inputs.iter().enumerate();
            let pushed =
                pushed.map(|(port, input)| input * at(self.places.of_port(own.pole, port)));
            begun + pushed.sum::<Complex<f64>>() + own.driven(motion, turn)
        };
        self.own.iter().map(state).collect()
    }

    /// Sets to 0 what the filters began with, once it has died out: numbers that go on to shrink become
    /// too small for the processor to be fast.
    pub(super) fn forget_what_died(&self, list: &mut [f64]) {
        for pole in 0..self.poles.len() {
            let places = self.places.of_watch(pole, 0)..self.places.of_pole(pole + 1);
            let begun = &mut list[2 * places.start..2 * places.end];
            if begun.iter().all(|x| x.abs() < DIED_OUT) {
                begun.fill(0.0);
            }
        }
    }

    /// Number of states of the filters.
    pub(super) fn n_states(&self) -> usize {
        self.own.len()
    }
}

/// What a filter's state follows.
struct Followed<'a> {
    /// The watch, and the pole.
    place: (usize, usize),
    /// Of the filter.
    rate: Complex<f64>,
    still: StillState,
    /// How the watch sees each mode of the motion, and the modes' eigenvalues.
    modes: (&'a [Complex<f64>], &'a [Complex<f64>]),
    /// What the watch sees of each input without any mode, and how each drives the modes.
    inputs: (&'a [f64], &'a [Vec<Complex<f64>>]),
}

/// What turning with and against each shaft, a phasor and i·speed each, makes of the state of a filter of this rate.
fn turned(turning: &[(Complex<f64>, Complex<f64>)], rate: Complex<f64>) -> Vec<[Complex<f64>; 2]> {
    let of_shaft = |(phasor, speed): &(Complex<f64>, Complex<f64>)| {
        [(*phasor, *speed), (phasor.conj(), -*speed)]
            .map(|(part, at)| part * (at - rate).inv() * 0.5)
    };
    turning.iter().map(of_shaft).collect()
}

impl Own {
    fn new(followed: Followed<'_>) -> Self {
        let Followed { place: (watch, pole), rate, still, modes, inputs } = followed;
        let ((weights, values), (at_once, inputs)) = (modes, inputs);
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
        Self { watch, pole, of, of_conjugate, still, inputs }
    }

    /// What free and steady motion make of the filter's state; `turn` is e^{iφ} of every shaft.
    fn driven(&self, motion: &[Complex<f64>], turn: &[Complex<f64>]) -> Complex<f64> {
        let pairs = motion.iter().zip(self.of.iter().zip(&self.of_conjugate));
        let driven: Complex<f64> = pairs.map(|(s, (a, b))| a * s + b * s.conj()).sum();
        let (constant, turning) = &self.still;
        let turning = turning.iter().zip(turn);
        let turning = turning.map(|([with, against], turn)| with * turn + against * turn.conj());
        driven + constant + turning.sum::<Complex<f64>>()
    }
}
