//! Combs in the acceleration itself: whether something repeats at the rate of a race that turns (docs/theory.md, F23).
//!
//! Needs neither a resonance nor amplitudes that are right: it is read in channels that are cut, too. Must not know envelopes,
//! absolute vibration or verdicts.

use super::bands;
use super::bearing::DefectLine;
use super::reach;
use super::targets;
use super::targets::Target;
use super::trace::Trace;
use crate::dsp::real::floor_index;
use crate::machine::BearingIndex;
use crate::machine::Machine;
use crate::machine::ShaftIndex;
use crate::machine::sensor::SensorKind;
use crate::signal::ChannelIndex;
use crate::units::Hz;
use rustfft::num_complex::Complex;
use std::ops::RangeInclusive;

/// Harmonics of a comb.
pub const HARMONICS: RangeInclusive<usize> = 3..=10;

/// Harmonics of a comb: how many.
const N_HARMONICS: usize = 8;

/// A comb weighs what so many of them hold, the weakest: other lines may lie at the places of the rest.
const N_WEAKEST: usize = 5;

/// The harmonics that smooth motion hardly has.
pub const UPPER: RangeInclusive<usize> = 5..=10;

/// Rates next to those a line may have, to either side, relative: where nothing of the bearing repeats.
const ELSEWHERE: f64 = 0.12;

/// Rates tried, in steps of 1/T: the tenth harmonic then moves on by one bin.
const STEP: f64 = 0.1;

/// Half width of a Hann main lobe, bins, at the lowest harmonic.
const LOBE: f64 = 2.0 / 3.0;

/// Half width of what a known multiple occupies, bins: at the third harmonic it is 3, where the skirt of a Hann lobe is 41 dB down.
const SKIRT: f64 = 1.0;

/// Parts of a turn at which a comb's own side lines lie: what turns is struck less or more hard as the shaft moves, and a shaft that
/// touches or rattles moves in those. A comb beside, so far away, is made of them.
const SIDE_PARTS: [u32; 3] = [1, 2, 3];

/// Rates that shafts explain take up to this part of all.
const EXPLAINED_PART: f64 = 0.25;

/// Harmonics of half and of a third of a rate that are none of its own, and which part they are of it.
const SLOWER: [(f64, [usize; 4]); 2] = [(2.0, [3, 5, 7, 9]), (3.0, [4, 5, 7, 8])];

/// Something slower repeats if its own harmonics have a quarter of the power of those that both have, by the medians.
const SLOWER_PART: f32 = 0.25;

/// What repeats at the rate of a race that turns in the acceleration of a pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comb {
    /// Which bearing.
    pub bearing: BearingIndex,
    /// The pair: x and y.
    pub pair: (ChannelIndex, ChannelIndex),
    /// Which line: that of the race that turns.
    pub line: DefectLine,
    /// Kinematic rate.
    pub expected: Hz,
    /// Rate found.
    pub frequency: Hz,
    /// Weight of its comb over that of the weightiest comb at rates near by which the line cannot have.
    pub lead: f64,
    /// Part of the pair's vibration mean(x² + y²) that the upper harmonics of the rate hold.
    pub part: f64,
    /// Power of these over the most that a pair of accelerometers elsewhere has at this rate; infinite if there is none.
    pub loudness: f64,
    /// Whether something that repeats at half or a third of the rate explains it.
    pub is_slower: bool,
    /// First sample of x and one past the last.
    pub sample_range: (u64, u64),
}

/// Name of the feature "amplitude of the comb of `line` of `bearing`", in parts of the pair's √(mean(x² + y²)).
#[must_use]
pub fn feature_name(line: DefectLine, bearing: &str) -> String {
    format!("comb_{}_{bearing}", line.slug())
}

/// Reads the combs of all bearings that pairs of accelerometers listen to, at the speed `first` of the first shaft (F23).
pub(super) fn read(machine: &Machine, first: Hz, traces: &[&Trace<'_>]) -> Vec<Comb> {
    let of = |sensor: usize| traces.iter().copied().find(|t| t.sensor == sensor);
    let spectra = machine.sensor_pairs().into_iter().filter_map(|pair| {
        let (x, y) = (of(pair.x)?, of(pair.y)?);
        let is_asked =
            machine.sensors[pair.x].kind == SensorKind::Accelerometer && x.is_simultaneous(y);
        is_asked.then(|| (x, y, PowerSpectrum::of_traces([x, y])))
    });
    let spectra: Vec<_> = spectra.collect();
    let mut found = Vec::new();
    for (x, y, spectrum) in &spectra {
        let sensor = &machine.sensors[x.sensor];
        let usable = bands::usable_band(sensor, x.rate);
        let lattices = lattices(machine, first, spectrum.duration_s);
        let is_sought = |target: &Target| {
            let ring = machine.bearing(target.bearing).rotating_ring;
            target.line == DefectLine::of_turning_race(ring)
                && target.unreadable(usable, spectrum.duration_s).is_none()
        };
        for target in
            targets::of_sensor(machine, sensor, first, first).iter().filter(|t| is_sought(t))
        {
            let Some((frequency, lead)) = spectrum.find(target, &lattices) else { continue };
            let power = spectrum.upper_power(frequency);
            let others = spectra.iter().filter(|(o, ..)| machine.sensors[o.sensor].at != sensor.at);
            let loudest =
                others.map(|(.., other)| other.upper_power(frequency)).fold(0.0, f64::max);
            found.push(Comb {
                bearing: target.bearing,
                pair: (x.channel, y.channel),
                line: target.line,
                expected: target.expected,
                frequency,
                lead,
                part: power / spectrum.mean_square,
                loudness: power / loudest,
                is_slower: spectrum.is_slower(frequency),
                sample_range: x.range,
            });
        }
    }
    found
}

/// Rates whose multiples a comb may not have: of the mains, and of the shafts down to parts of a revolution (a shaft that touches
/// or rattles moves in those), as fine as leaves three quarters of all rates open (F23).
fn lattices(machine: &Machine, first: Hz, duration_s: f64) -> Vec<Hz> {
    let mut rates: Vec<Hz> =
        machine.motors.iter().filter_map(|motor| motor.line_frequency).collect();
    for shaft in (0..machine.shafts.len()).map(ShaftIndex) {
        let Some(speed) = machine.shaft_speed(shaft, first).filter(|speed| speed.0 > 0.0) else {
            continue;
        };
        let mut taken = 0.0;
        for n in 1_u32.. {
            // What no coarser part has explained: as many as there are numbers below n without a common divisor.
            let new = (1..=n).filter(|k| gcd(*k, n) == 1).count();
            taken += new as f64 * 2.0 * SKIRT / (duration_s * speed.0);
            if taken > EXPLAINED_PART {
                break;
            }
            rates.push(Hz(speed.0 / f64::from(n)));
        }
    }
    rates
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// Power of a pair, Hann window, both axes added: bin k at k/T.
struct PowerSpectrum {
    /// Power of a tone in that bin, u².
    power: Vec<f32>,
    duration_s: f64,
    mean_square: f64,
}

impl PowerSpectrum {
    fn of_traces(pair: [&Trace<'_>; 2]) -> Self {
        let variance = |trace: &Trace<'_>| trace.moments.variance().unwrap_or(0.0);
        let (n, rate) = (pair[0].samples.len(), pair[0].rate);
        Self::of(
            pair.map(|trace| &trace.x_hat[..]),
            (n, rate),
            pair.into_iter().map(variance).sum(),
        )
    }

    /// Of the unnormalised one-sided DFTs of `n` samples of both axes.
    fn of(pair: [&[Complex<f32>]; 2], (n, rate): (usize, Hz), mean_square: f64) -> Self {
        let mut power = vec![0.0_f32; pair[0].len()];
        // ½·A² of a tone whose windowed bin is A·n/4.
        #[expect(clippy::cast_possible_truncation, reason = "spectra are f32")]
        let scale = (8.0 / (n as f64).powi(2)) as f32;
        for x_hat in pair {
            for (x, power) in x_hat.windows(3).zip(power.iter_mut().skip(1)) {
                let windowed = x[1] * 0.5 - (x[0] + x[2]) * 0.25;
                *power += scale * windowed.norm_sqr();
            }
        }
        Self { power, duration_s: n as f64 / rate.0, mean_square }
    }

    fn at(&self, frequency: f64) -> f32 {
        self.power.get(floor_index(frequency * self.duration_s + 0.5)).copied().unwrap_or(0.0)
    }

    /// Weight of a comb: power of its weakest harmonics.
    fn weight(&self, rate: f64) -> f64 {
        let mut powers: [f32; N_HARMONICS] =
            std::array::from_fn(|i| self.at((HARMONICS.start() + i) as f64 * rate));
        powers.sort_by(f32::total_cmp);
        powers[..N_WEAKEST].iter().map(|p| f64::from(*p)).sum()
    }

    /// Power of the upper harmonics of a rate, u².
    fn upper_power(&self, rate: Hz) -> f64 {
        UPPER.map(|h| f64::from(self.at(h as f64 * rate.0))).sum()
    }

    /// The rate at which the comb of a target weighs most, and its lead over those near by; `None` where the spectrum ends or
    /// nothing is open (F23).
    fn find(&self, target: &Target, lattices: &[Hz]) -> Option<(Hz, f64)> {
        let (low, high) = reach::searched_range(target.line, target.expected, target.band);
        let reach = ELSEWHERE * target.expected.0;
        let top = (high.0 + reach) * *HARMONICS.end() as f64 * self.duration_s;
        if top >= self.power.len() as f64 || self.mean_square <= 0.0 {
            return None;
        }
        let lobe = LOBE / self.duration_s;
        let (rate, weight) =
            self.weightiest((low.0, high.0), |rate| self.is_open(rate, lattices))?;
        let is_side_line = |other: f64| {
            let spacings = SIDE_PARTS.map(|n| target.shaft_speed.0 / f64::from(n));
            spacings.iter().any(|spacing| self.is_multiple(other - rate, *spacing))
        };
        let opposes = |rate: f64| self.is_open(rate, lattices) && !is_side_line(rate);
        let below = self.weightiest((low.0 - reach, low.0 - lobe), opposes);
        let above = self.weightiest((high.0 + lobe, high.0 + reach), opposes);
        let elsewhere =
            below.into_iter().chain(above).map(|(_, weight)| weight).max_by(f64::total_cmp)?;
        (weight > 0.0).then(|| (Hz(rate), weight / elsewhere.max(f64::MIN_POSITIVE)))
    }

    /// Whether something slower repeats whose second or third multiple this rate is.
    fn is_slower(&self, rate: Hz) -> bool {
        let median = |mut powers: Vec<f32>| {
            powers.sort_by(f32::total_cmp);
            powers[(powers.len() - 1) / 2]
        };
        let own = median(HARMONICS.map(|h| self.at(h as f64 * rate.0)).collect());
        SLOWER.iter().any(|(m, harmonics)| {
            let others = harmonics.iter().map(|h| self.at(*h as f64 * rate.0 / m)).collect();
            median(others) > SLOWER_PART * own
        })
    }

    /// Whether a distance is a multiple of another, zero included, but for what a line's skirt occupies.
    fn is_multiple(&self, distance: f64, unit: f64) -> bool {
        (distance - unit * (distance / unit).round()).abs() < SKIRT / self.duration_s
    }

    /// Whether nothing known explains a comb at a rate.
    fn is_open(&self, rate: f64, lattices: &[Hz]) -> bool {
        !lattices.iter().any(|unit| self.is_multiple(rate, unit.0))
    }

    /// The rate of a range with the weightiest comb, of those that take part.
    fn weightiest(
        &self,
        (low, high): (f64, f64),
        takes_part: impl Fn(f64) -> bool,
    ) -> Option<(f64, f64)> {
        let step = STEP / self.duration_s;
        let n = floor_index(((high - low) / step).max(0.0));
        let rates = (0..=n).map(|i| low + i as f64 * step).filter(|rate| takes_part(*rate));
        rates.map(|rate| (rate, self.weight(rate))).max_by(|a, b| a.1.total_cmp(&b.1))
    }
}

#[cfg(test)]
#[path = "comb_tests.rs"]
mod tests;
