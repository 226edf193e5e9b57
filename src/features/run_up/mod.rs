//! The vector of 1× at every speed that a run passes: what bow and unbalance are told apart by.
//!
//! A window is cut into pieces of a few revolutions; each gives the vector of 1× behind the tacho's mark at its own speed, or its
//! length where the speed is measured without a mark (teeth of a wheel, a speed channel, another shaft's tacho).
//! Pieces of the windows of one run are kept, few of each speed, so that at its working speed a machine still knows how it
//! ran up. From them the parts of bow and unbalance follow (D78). Must not know which part is too large.

use super::ChannelFeatures;
use super::Feature;
use super::WindowFeatures;
use super::speed::Speed;
use super::trace::Trace;
use super::vector;
use crate::dsp::order::PhaseTrack;
use crate::dsp::real::ceil_index;
use crate::dsp::real::floor_index;
use crate::dsp::speed_law;
pub use crate::dsp::speed_law::Fit;
pub use crate::dsp::speed_law::IMPLAUSIBLE;
pub use crate::dsp::speed_law::Known;
pub use crate::dsp::speed_law::Part;
pub use crate::dsp::speed_law::SpeedLaw;
pub use crate::dsp::speed_law::VectorAt;
pub use crate::dsp::speed_law::speed_law;
use crate::machine::Machine;
use crate::machine::ShaftIndex;
use crate::machine::sensor::SensorKind;
use crate::signal::ChannelIndex;
use crate::tape::Reader;
use crate::tape::Tape;
use crate::units::Hz;
use crate::units::Unit;
use rustfft::num_complex::Complex;
use std::sync::Arc;

/// Revolutions of a piece: what is not at 1× stands four cells of Hann away at twice, half or no speed.
const REVOLUTIONS: f64 = 8.0;

/// Pieces of a window at most; where the speed is steady, four, longer if the window allows.
const MOST_PIECES: f64 = 64.0;
const STEADY_PIECES: f64 = 4.0;
const LONGEST_REVOLUTIONS: f64 = 16.0;

/// A speed that changes by less within a window counts as steady.
const STEADY: f64 = 0.02;

/// Variance of the place of a sample in its piece under a Hann window, piece = 1: 1/12 − 1/(2π²).
const HANN_VARIANCE: f64 = 0.032_672_741_3;

/// Speeds nearer than this, relative, are one; of each so many pieces are kept, the newest.
const SPEED_STEP: f64 = 0.03;
const KEPT_OF_A_SPEED: usize = 4;

/// A vector that differs by more than this part of the largest of its run from the first at its speed has changed while the speed
/// did not: what was before is of another shaft.
const CHANGED: f64 = 0.3;

/// Pieces older than this say nothing of now, s.
const LONGEST_S: f64 = 3600.0;

/// Standard deviations that the amplitudes for the baseline are widened by.
const WIDENED: f64 = 2.0;

const BOW: &str = "slow_roll_1x_";
const UNBALANCE: &str = "unbalance_1x_";

/// Whether a feature is one of a run, which does not depend on the speed of a window.
#[must_use]
pub fn is_of_run(name: &str) -> bool {
    name.starts_with(BOW) || name.starts_with(UNBALANCE)
}

/// Leaves of the features of a window those of its run.
#[must_use]
pub fn of_run(mut channels: Vec<ChannelFeatures>) -> Vec<ChannelFeatures> {
    for channel in &mut channels {
        channel.values.retain(|feature| is_of_run(&feature.name));
    }
    channels
}

/// Name of the feature "1× vector of `shaft` at standstill, at most".
#[must_use]
pub fn bow_name(shaft: &str) -> String {
    format!("{BOW}{shaft}")
}

/// Name of the feature "part of the 1× vector of `shaft` that rises with the square of its speed, at 10 Hz, at most".
#[must_use]
pub fn unbalance_name(shaft: &str) -> String {
    format!("{UNBALANCE}{shaft}")
}

/// By how much an unbalance's part has risen at a speed over that of [`unbalance_name`], without resonance.
#[must_use]
pub fn rise(speed: Hz) -> f64 {
    (speed.0 / speed_law::REFERENCE_HZ).powi(2)
}

/// The vector of 1× of the first shaft over a few revolutions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// Channel of the probe.
    pub channel: ChannelIndex,
    /// Begin and end, s of stream time.
    pub time_s: (f64, f64),
    /// The vector; its length along the real axis where that is all that is known.
    pub at: VectorAt,
    /// What is known of it.
    pub known: Known,
}

/// The parts of bow and unbalance in what a probe saw of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct ShaftLaw {
    /// The shaft it looks at.
    pub shaft: ShaftIndex,
    /// Channel of the probe.
    pub channel: ChannelIndex,
    /// The parts.
    pub law: SpeedLaw,
}

/// How the first shaft turned in a window, from which time on, and what of a vector that tells.
fn turned(speed: &Speed) -> Option<(PhaseTrack, f64, Known)> {
    match (&speed.phase, &speed.turning) {
        (Some(phase), _) if phase.is_marked => {
            Some((smooth(&phase.track)?, phase.start_s, Known::Vectors))
        }
        (_, Some(turning)) => Some((turning.track.clone(), turning.start_s, Known::Lengths)),
        (_, None) => None,
    }
}

/// Reads the pieces of a probe's window (F18); none of other sensors, nor where nothing measured how the first shaft turned.
pub(super) fn pieces(
    machine: &Machine,
    trace: &Trace<'_>,
    (rate, unit): (Hz, Unit),
    speed: &Speed,
) -> Vec<Piece> {
    let sensor = &machine.sensors[trace.sensor];
    let is_probe = sensor.kind == SensorKind::Proximitor && unit == Unit::Micrometre;
    let Some((track, track_s, known)) = turned(speed).filter(|_| is_probe) else {
        return Vec::new();
    };
    let start_s = trace.start_s() - track_s;
    let samples = trace.all.samples;
    let duration_s = samples.len() as f64 / rate.0;
    let Some((from, to)) = track.covered_revolutions(start_s, start_s + duration_s) else {
        return Vec::new();
    };
    let turned = to - from;
    let (most, longest) = if speed.excursion < STEADY {
        (STEADY_PIECES, LONGEST_REVOLUTIONS)
    } else {
        (MOST_PIECES, turned)
    };
    let revolutions = (turned / most).clamp(REVOLUTIONS, longest.max(REVOLUTIONS));
    let n = floor_index((turned / revolutions).min(most));
    let piece = |i: usize| {
        let begin = from + i as f64 * revolutions;
        let (a, b) = (track.time_at(begin)?, track.time_at(begin + revolutions)?);
        let first = ceil_index(((a - start_s) * rate.0).max(0.0));
        let end = floor_index(((b - start_s) * rate.0).max(0.0)).min(samples.len());
        let inside = samples.get(first..end)?;
        let turns = |k: usize| track.revolutions_at(start_s + (first + k) as f64 / rate.0);
        let (cos, sin) = vector::once_a_revolution(inside, turns)?;
        let half = 0.5 * (b - a) / revolutions;
        let ends = (track.speed_at(a + half)?, track.speed_at(b - half)?);
        let mean_hz = revolutions / (b - a);
        let square = mean_hz * mean_hz + HANN_VARIANCE * (ends.1 - ends.0).powi(2);
        let vector = Complex::new(cos, sin);
        let vector = match known {
            Known::Vectors => vector,
            Known::Lengths => Complex::new(vector.norm(), 0.0),
        };
        let at = VectorAt { speed_hz: square.sqrt(), vector, weight: inside.len() as f64 };
        Some(Piece { channel: trace.channel, time_s: (track_s + a, track_s + b), at, known })
    };
    (0..n).filter_map(piece).collect()
}

/// The angle between the marks as smooth as a run-up turns, whole revolutions at the marks.
fn smooth(track: &PhaseTrack) -> Option<PhaseTrack> {
    let mut marks = (Vec::new(), Vec::new());
    let mut revolution = 0.0;
    while let Some(time_s) = track.time_at(revolution) {
        marks.0.push(time_s);
        marks.1.push(revolution);
        revolution += 1.0;
    }
    PhaseTrack::from_knots(&marks.0, &marks.1)
}

/// The pieces of one run, from its begin to now.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RunUp {
    pieces: Vec<Piece>,
    /// The first piece of each speed since the last change.
    first: Vec<Piece>,
    /// End of the newest piece of each channel, s.
    reached_s: Vec<(ChannelIndex, f64)>,
}

impl RunUp {
    /// Writes all of it.
    pub fn write(&self, tape: &mut Tape) {
        for pieces in [&self.pieces, &self.first] {
            tape.write_count(pieces.len());
            for piece in pieces {
                tape.write_count(piece.channel.0);
                let VectorAt { speed_hz, vector, weight } = piece.at;
                let (from_s, to_s) = piece.time_s;
                tape.write(&[from_s, to_s, speed_hz, vector.re, vector.im, weight]);
                tape.write_count(usize::from(piece.known == Known::Lengths));
            }
        }
        tape.write_count(self.reached_s.len());
        for (channel, reached_s) in &self.reached_s {
            tape.write_count(channel.0);
            tape.write(&[*reached_s]);
        }
    }

    /// Reads what [`Self::write`] wrote; `None`: it is something else.
    #[must_use]
    pub fn read(tape: &mut Reader<'_>) -> Option<Self> {
        let read = |tape: &mut Reader<'_>| {
            let channel = ChannelIndex(tape.count()?);
            let [from_s, to_s, speed_hz, re, im, weight] = tape.array()?;
            let at = VectorAt { speed_hz, vector: Complex::new(re, im), weight };
            let known = if tape.count()? == 0 { Known::Vectors } else { Known::Lengths };
            Some(Piece { channel, time_s: (from_s, to_s), at, known })
        };
        let (pieces, first) = (tape.list(read)?, tape.list(read)?);
        let reached_s = tape.list(|tape| Some((ChannelIndex(tape.count()?), tape.number()?)))?;
        Some(Self { pieces, first, reached_s })
    }

    /// Begins anew.
    pub fn clear(&mut self) {
        self.pieces.clear();
        self.first.clear();
        self.reached_s.clear();
    }

    /// Takes the pieces of a window in (a machine at rest begins anew), tells the window what all of them say, and adds that to its features.
    pub fn follow(&mut self, machine: &Machine, features: &mut WindowFeatures) {
        if features.speed.first.is_none_or(|first| first.0 <= 0.0) {
            self.clear();
        }
        for piece in std::mem::take(&mut features.pieces) {
            let shaft = shaft_of(machine, features, piece.channel);
            let critical = machine.shaft(shaft).first_critical.map_or(f64::INFINITY, |hz| hz.0);
            self.take(piece, speed_law::HIGHEST_RATIO * critical);
        }
        let is_recent = |p: &Piece| p.time_s.1 >= features.time_s.1 - LONGEST_S;
        self.pieces.retain(is_recent);
        self.first.retain(is_recent);
        for (channel, _) in &self.reached_s {
            let shaft = shaft_of(machine, features, *channel);
            let Some(values) = features.channels.iter_mut().find(|c| c.channel == *channel) else {
                continue;
            };
            let of_channel = self.pieces.iter().filter(|p| p.channel == *channel);
            let known = common(of_channel.clone());
            let vectors: Vec<VectorAt> = of_channel.map(|p| p.at).collect();
            // What a probe without a place sees is the first shaft's.
            let described = machine.shaft(shaft);
            if described.ratio_to_first.is_none_or(|ratio| (ratio - 1.0).abs() > 1e-9) {
                continue;
            }
            let critical = described.first_critical.map(|hz| hz.0);
            if let Some(law) = speed_law(&vectors, known, critical) {
                values.values.extend(for_baseline(&law, &described.id));
                features.laws.push(ShaftLaw { shaft, channel: *channel, law });
            }
        }
    }

    /// Keeps a piece if it begins where nothing was read yet and the law holds at its speed; the oldest of too many of one speed
    /// gives way, and all of them if the vector has changed at one speed.
    fn take(&mut self, piece: Piece, highest_hz: f64) {
        let known = self.reached_s.iter_mut().find(|(channel, _)| *channel == piece.channel);
        match known {
            // Pieces of two windows share no sample: they are independent.
            Some((_, reached_s)) if piece.time_s.0 < *reached_s => return,
            Some((_, reached_s)) => *reached_s = piece.time_s.1,
            None => self.reached_s.push((piece.channel, piece.time_s.1)),
        }
        if piece.at.speed_hz > highest_hz {
            return;
        }
        match self.first.iter().find(|first| is_alike(first, &piece)) {
            Some(first) if self.has_changed(first, &piece) => {
                self.pieces.retain(|p| p.channel != piece.channel);
                self.first.retain(|p| p.channel != piece.channel);
                self.first.push(piece);
            }
            Some(_) => {}
            None => self.first.push(piece),
        }
        if self.pieces.iter().filter(|p| is_alike(p, &piece)).count() >= KEPT_OF_A_SPEED
            && let Some(oldest) = self.pieces.iter().position(|p| is_alike(p, &piece))
        {
            self.pieces.remove(oldest);
        }
        self.pieces.push(piece);
    }

    /// Whether a piece is another vector than the first at its speed.
    fn has_changed(&self, first: &Piece, now: &Piece) -> bool {
        let of_channel = self.pieces.iter().filter(|p| p.channel == now.channel);
        let largest = of_channel.map(|p| p.at.vector.norm()).fold(now.at.vector.norm(), f64::max);
        let change = match common([first, now].into_iter()) {
            Known::Vectors => (now.at.vector - first.at.vector).norm(),
            Known::Lengths => (now.at.vector.norm() - first.at.vector.norm()).abs(),
        };
        change > CHANGED * largest
    }
}

/// What is known of all of them.
fn common<'p>(mut pieces: impl Iterator<Item = &'p Piece>) -> Known {
    if pieces.any(|p| p.known == Known::Lengths) { Known::Lengths } else { Known::Vectors }
}

/// Whether two pieces are of one channel and one speed.
fn is_alike(a: &Piece, b: &Piece) -> bool {
    let step = |p: &Piece| (p.at.speed_hz.ln() / SPEED_STEP).round();
    a.channel == b.channel && (step(a) - step(b)).abs() < 0.5
}

/// The shaft that a channel's sensor looks at; one without a place sees the first.
fn shaft_of(machine: &Machine, features: &WindowFeatures, channel: ChannelIndex) -> ShaftIndex {
    let sensor = features.sensors.iter().find(|reading| reading.channel == channel);
    let place = sensor.and_then(|reading| machine.shaft_at(&machine.sensors[reading.sensor]));
    place.unwrap_or(ShaftIndex(0))
}

/// The largest that every plausible fit allows, two standard deviations on top: a baseline must not be smaller than it is.
fn for_baseline(law: &SpeedLaw, shaft: &str) -> [Feature; 2] {
    let most = |of: fn(&Fit) -> Part| {
        let amplitudes = law.fits.iter().map(of).map(|p| p.vector.norm() + WIDENED * p.sigma);
        amplitudes.fold(0.0, f64::max)
    };
    let feature =
        |name: String, value| Feature { name: Arc::from(name), value, unit: Unit::Micrometre };
    [
        feature(bow_name(shaft), most(|fit| fit.bow)),
        feature(unbalance_name(shaft), most(|fit| fit.unbalance)),
    ]
}

#[cfg(test)]
mod tests;
