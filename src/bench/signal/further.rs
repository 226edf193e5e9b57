//! The other transforms that are measured: how far f32 is from f64.
//!
//! Each kernel's own tests hold f64 against the slow definition.

use super::Effort;
use super::jobs::Job;
use super::recording::{FS_HZ, SHAFT_HZ};
use crate::bench::clock::Work;
use crate::bench::gaps::relative;
use crate::dsp::butterworth::{self, Pass};
use crate::dsp::cepstrum::{CepstrumPlan, Kind};
use crate::dsp::comb::{CombSpeedPlan, SpeedSearch, shaft_orders};
use crate::dsp::cross::CrossPlan;
use crate::dsp::drs::DrsPlan;
use crate::dsp::fft::{FftCache, ForwardPlan};
use crate::dsp::fir::Decimator;
use crate::dsp::full_spectrum::FullSpectrumPlan;
use crate::dsp::integrate::{GENERAL_BAND_HZ, Quantity, VelocityPlan};
use crate::dsp::kurtogram::{InfogramPlan, KurtogramPlan, Negentropy};
use crate::dsp::order::PhaseTrack;
use crate::dsp::order_track::OrderTrackPlan;
use crate::dsp::real::Real;
use crate::dsp::sos::{SosFilter, ZeroPhasePlan};
use crate::dsp::speed_track::{SpeedTrackPlan, SpeedTrackSpec};
use crate::dsp::stft::{FrameSpec, Scale, StftPlan};
use crate::dsp::window::Shape;
use crate::dsp::zoom::{ZoomGrid, ZoomPlan};
use rustfft::num_complex::Complex;

/// Names of these jobs.
pub(super) const NAMES: [&str; 15] = [
    "kurtogram",
    "infogram",
    "cepstrum",
    "coherence",
    "zoom",
    "full-spectrum",
    "drs",
    "velocity",
    "band-pass",
    "zero-phase",
    "decimate",
    "stft",
    "order-track",
    "speed",
    "speed-track",
];

/// Levels of the kurtogram and the infogram.
const DEPTH: u32 = 7;

/// Points a revolution of order tracking.
const POINTS: usize = 256;

/// A transform with its samples, and what it gave.
trait Shown: Work {
    /// The result of the last call, as numbers side by side.
    fn shown(&self) -> Vec<f64>;
}

/// Any state with what is done to it and what it shows.
struct Transform<S> {
    state: S,
    call: fn(&mut S),
    shown: fn(&S) -> Vec<f64>,
}

impl<S> Work for Transform<S> {
    fn call(&mut self) {
        (self.call)(&mut self.state);
    }
}

impl<S> Shown for Transform<S> {
    fn shown(&self) -> Vec<f64> {
        (self.shown)(&self.state)
    }
}

/// A transform beside the same in f64.
struct Beside {
    own: Box<dyn Shown>,
    double: Option<Box<dyn Shown>>,
}

impl Work for Beside {
    fn call(&mut self) {
        self.own.call();
    }
}

impl Job for Beside {
    fn error(&mut self, _: &[f64]) -> Option<f64> {
        let double = self.double.as_mut()?;
        double.call();
        let exact = double.shown();
        let found = self.own.shown();
        let is_there = found.len() == exact.len() && exact.iter().any(|x| *x != 0.0);
        is_there.then(|| relative(&found, &exact))
    }
}

/// What a job is, in which mode, and the job.
pub(super) type Prepared = (&'static str, &'static str, Box<dyn Job>);

/// Prepares a job; `None` if there is no such name.
pub(super) fn prepare<T: Real>(name: &str, x: &[f64], effort: &Effort) -> Option<Prepared> {
    let (what, mode, own) = transform::<T>(name, x, effort)?;
    let is_double = size_of::<T>() == size_of::<f64>();
    let double =
        if is_double { None } else { transform::<f64>(name, x, effort).map(|(_, _, job)| job) };
    Some((what, mode, Box::new(Beside { own, double })))
}

fn boxed<S: 'static>(
    state: S,
    call: fn(&mut S),
    shown: fn(&S) -> Vec<f64>,
) -> Option<Box<dyn Shown>> {
    Some(Box::new(Transform { state, call, shown }))
}

fn narrow<T: Real>(x: &[f64]) -> Vec<T> {
    x.iter().map(|x| T::rounded(*x)).collect()
}

fn wide<T: Real>(x: &[T]) -> Vec<f64> {
    x.iter().map(|x| x.to_f64()).collect()
}

fn zeros<T: Real>(n: usize) -> Vec<T> {
    vec![T::zero(); n]
}

fn complex_zeros<T: Real>(n: usize) -> Vec<Complex<T>> {
    vec![Complex::new(T::zero(), T::zero()); n]
}

fn transform<T: Real>(
    name: &str,
    x: &[f64],
    effort: &Effort,
) -> Option<(&'static str, &'static str, Box<dyn Shown>)> {
    let second = &x[..effort.n_second];
    let segment = &x[..effort.n_spectrum];
    let (what, mode, job) = match name {
        "kurtogram" => ("kurtogram, 10 s", "with transform", kurtogram::<T>(x)),
        "infogram" => ("infogram, 10 s", "with transform", infogram::<T>(x)),
        "cepstrum" => ("power cepstrum, 1 s", "with transform", cepstrum::<T>(second)),
        "coherence" => ("coherence, 10 s", "Hann, half", coherence::<T>(x, effort.n_spectrum)),
        "zoom" => ("zoom spectrum", "64 lines", zoom::<T>(segment)),
        "full-spectrum" => ("full spectrum", "Hann", full_spectrum::<T>(segment)),
        "drs" => ("discrete and random, 10 s", "", drs::<T>(x, effort.n_spectrum / 2)),
        "velocity" => ("velocity RMS, 10 s", "10-1000 Hz", velocity::<T>(x)),
        "band-pass" => ("Butterworth band, 10 s", "streaming", band_pass::<T>(x)),
        "zero-phase" => ("Butterworth band, 10 s", "zero phase", zero_phase::<T>(x)),
        "decimate" => ("decimation by 10, 10 s", "streaming", decimate::<T>(x)),
        "stft" => ("STFT, 10 s", "half overlap", stft::<T>(x, effort.n_spectrum / 8)),
        "order-track" => ("order tracking, 10 s", "256 a turn", order_track::<T>(x)),
        "speed" => ("speed, 10 s", "comb", speed::<T>(x)),
        "speed-track" => ("speed over time, 10 s", "", speed_track::<T>(x, effort.n_second)),
        _ => return None,
    };
    Some((what, mode, job?))
}

/// A record with the transform that several jobs begin with.
struct Spectral<T: Real> {
    x: Vec<T>,
    forward: ForwardPlan<T>,
    x_hat: Vec<Complex<T>>,
    cache: FftCache<T>,
}

impl<T: Real> Spectral<T> {
    fn new(x: &[f64]) -> Self {
        let mut cache = FftCache::new();
        let forward = ForwardPlan::new(x.len(), &mut cache);
        let x_hat = complex_zeros(forward.n_bins());
        Self { x: narrow(x), forward, x_hat, cache }
    }
}

fn kurtogram<T: Real>(x: &[f64]) -> Option<Box<dyn Shown>> {
    let Spectral { x, forward, x_hat, mut cache } = Spectral::<T>::new(x);
    let plan = KurtogramPlan::new(x.len(), DEPTH, 1..x_hat.len(), &mut cache);
    let out = vec![None; plan.bands().len()];
    boxed(
        (x, forward, x_hat, plan, out),
        |(x, forward, x_hat, plan, out)| {
            forward.process(x, x_hat);
            plan.process(x_hat, out);
        },
        |(.., out)| out.iter().map(|value| value.unwrap_or(0.0)).collect(),
    )
}

fn infogram<T: Real>(x: &[f64]) -> Option<Box<dyn Shown>> {
    let Spectral { x, forward, x_hat, mut cache } = Spectral::<T>::new(x);
    let plan = InfogramPlan::new(x.len(), DEPTH, 1..x_hat.len(), &mut cache);
    let out = vec![None; plan.bands().len()];
    boxed(
        (x, forward, x_hat, plan, out),
        |(x, forward, x_hat, plan, out)| {
            forward.process(x, x_hat);
            plan.process(x_hat, out);
        },
        |(.., out)| out.iter().map(|value| value.map_or(0.0, |n: Negentropy| n.mean())).collect(),
    )
}

fn cepstrum<T: Real>(x: &[f64]) -> Option<Box<dyn Shown>> {
    let Spectral { x, forward, x_hat, mut cache } = Spectral::<T>::new(x);
    let plan = CepstrumPlan::new(x.len(), &mut cache);
    let out = zeros(plan.n_values());
    boxed(
        (x, forward, x_hat, plan, out),
        |(x, forward, x_hat, plan, out)| {
            forward.process(x, x_hat);
            let _rms = plan.process(x_hat, Kind::Power, out);
        },
        |(.., out)| wide(out),
    )
}

fn coherence<T: Real>(x: &[f64], n_segment: usize) -> Option<Box<dyn Shown>> {
    let plan =
        CrossPlan::<T>::new(Shape::Hann, n_segment, (n_segment / 2).max(1), &mut FftCache::new());
    let (cross, values) = (complex_zeros(plan.n_bins()), vec![None; plan.n_bins()]);
    // The same a millisecond later at half size: coherent but for what segments do not share.
    let later: Vec<f64> = x.iter().skip(10).chain(&x[..10]).map(|x| 0.5 * x).collect();
    boxed(
        (narrow::<T>(x), narrow::<T>(&later), plan, cross, values),
        |(x, y, plan, cross, values)| {
            plan.process(x, y, FS_HZ, cross, values);
        },
        |(.., values)| values.iter().map(|v: &Option<T>| v.map_or(0.0, |v| v.to_f64())).collect(),
    )
}

fn zoom<T: Real>(x: &[f64]) -> Option<Box<dyn Shown>> {
    let grid = ZoomGrid { low_hz: 640.0, step_hz: 1.25, n_lines: 64 };
    let plan = ZoomPlan::new(x.len(), Shape::Hann, FS_HZ, grid, &mut FftCache::new())?;
    let out = complex_zeros::<T>(plan.n_lines());
    boxed(
        (narrow::<T>(x), plan, out),
        |(x, plan, out)| {
            plan.process(x, out);
        },
        |(.., out)| out.iter().flat_map(|z| [z.re.to_f64(), z.im.to_f64()]).collect(),
    )
}

fn full_spectrum<T: Real>(x: &[f64]) -> Option<Box<dyn Shown>> {
    let plan = FullSpectrumPlan::<T>::new(x.len(), Shape::Hann, &mut FftCache::new());
    let (forward, backward) = (zeros(plan.n_bins()), zeros(plan.n_bins()));
    let y: Vec<f64> = x.iter().rev().copied().collect();
    boxed(
        (narrow::<T>(x), narrow::<T>(&y), plan, forward, backward),
        |(x, y, plan, forward, backward)| plan.process(x, y, forward, backward),
        |(.., forward, backward)| wide(&[&forward[..], backward].concat()),
    )
}

fn drs<T: Real>(x: &[f64], n_segment: usize) -> Option<Box<dyn Shown>> {
    let plan = DrsPlan::<T>::new(x.len(), n_segment, n_segment, &mut FftCache::new())?;
    boxed(
        (narrow::<T>(x), plan, zeros(x.len()), zeros(x.len())),
        |(x, plan, discrete, random)| plan.process(x, discrete, random),
        |(.., discrete, _)| wide(discrete),
    )
}

fn velocity<T: Real>(x: &[f64]) -> Option<Box<dyn Shown>> {
    let plan = VelocityPlan::<T>::new(x.len(), &mut FftCache::new());
    boxed(
        (narrow::<T>(x), plan, 0.0),
        |(x, plan, rms)| {
            let found = plan.process(x, FS_HZ, Quantity::Acceleration, GENERAL_BAND_HZ);
            *rms = found.map_or(f64::NAN, |found| found.mm_per_s);
        },
        |(.., rms)| vec![*rms],
    )
}

fn band() -> Option<Vec<crate::dsp::sos::Section>> {
    butterworth::design(Pass::Band { low_hz: 2000.0, high_hz: 4000.0 }, 4, FS_HZ)
}

fn band_pass<T: Real>(x: &[f64]) -> Option<Box<dyn Shown>> {
    boxed(
        (narrow::<T>(x), SosFilter::new(band()?), zeros::<T>(x.len())),
        |(x, filter, out)| {
            filter.reset();
            filter.process(x, out);
        },
        |(.., out)| wide(out),
    )
}

fn zero_phase<T: Real>(x: &[f64]) -> Option<Box<dyn Shown>> {
    boxed(
        (narrow::<T>(x), ZeroPhasePlan::new(x.len(), band()?), zeros::<T>(x.len())),
        |(x, plan, out)| plan.process(x, out),
        |(.., out)| wide(out),
    )
}

fn decimate<T: Real>(x: &[f64]) -> Option<Box<dyn Shown>> {
    let decimator = Decimator::new(10);
    let out = zeros::<T>(decimator.out_len(x.len()));
    boxed(
        (narrow::<T>(x), decimator, out),
        |(x, decimator, out)| {
            decimator.reset();
            decimator.process(x, out);
        },
        |(.., out)| wide(out),
    )
}

fn stft<T: Real>(x: &[f64], n_frame: usize) -> Option<Box<dyn Shown>> {
    let spec = FrameSpec { shape: Shape::Hann, n_frame, hop: (n_frame / 2).max(1) };
    let plan = StftPlan::<T>::new(spec, &mut FftCache::new());
    let out = zeros(plan.n_frames(x.len()) * plan.n_bins());
    boxed(
        (narrow::<T>(x), plan, out),
        |(x, plan, out)| {
            plan.process(x, FS_HZ, Scale::Amplitude, out);
        },
        |(.., out)| wide(out),
    )
}

fn order_track<T: Real>(x: &[f64]) -> Option<Box<dyn Shown>> {
    let plan = OrderTrackPlan::new(POINTS, FS_HZ, 0.5 * SHAFT_HZ)?;
    let track = PhaseTrack::constant(SHAFT_HZ)?;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "thousands")]
    let n_points = (x.len() as f64 / FS_HZ * SHAFT_HZ) as usize * POINTS;
    boxed(
        (narrow::<T>(x), plan, track, zeros::<T>(n_points)),
        |(x, plan, track, out)| {
            let _tracked = plan.process(x, FS_HZ, track, out);
        },
        |(.., out)| wide(out),
    )
}

fn search() -> SpeedSearch {
    SpeedSearch { low_hz: 20.0, high_hz: 40.0, orders: shaft_orders(5) }
}

fn speed<T: Real>(x: &[f64]) -> Option<Box<dyn Shown>> {
    let plan = CombSpeedPlan::<T>::new(search(), x.len(), FS_HZ, &mut FftCache::new())?;
    boxed(
        (narrow::<T>(x), plan, 0.0),
        |(x, plan, hz)| *hz = plan.process(x).map_or(f64::NAN, |found| found.speed_hz),
        |(.., hz)| vec![*hz],
    )
}

fn speed_track<T: Real>(x: &[f64], n_frame: usize) -> Option<Box<dyn Shown>> {
    let spec = SpeedTrackSpec { search: search(), fs_hz: FS_HZ, n_frame, max_rate_hz_s: 5.0 };
    let plan = SpeedTrackPlan::<T>::new(spec, x.len(), &mut FftCache::new())?;
    boxed(
        (narrow::<T>(x), plan),
        |(x, plan)| {
            let _tracked = plan.process(x);
        },
        |(_, plan)| plan.points().iter().map(|point| point.speed_hz).collect(),
    )
}

#[cfg(test)]
mod tests {
    use super::super::{jobs, recording};
    use super::*;

    #[test]
    fn every_job_is_there_and_right() {
        let effort = Effort::WHOLE;
        let x = recording::gearbox(10 * effort.n_second, 1);
        let known: Vec<&str> = jobs::names().collect();
        for name in NAMES {
            assert!(known.contains(&name));
            let Some((_, _, mut job)) = prepare::<f32>(name, &x, &effort) else {
                panic!("no job {name}");
            };
            job.call();
            let error = job.error(&x).unwrap();
            // Negentropies are differences of logarithms near 0; the others keep what f32 has.
            let most = if name == "infogram" { 1e-5 } else { 2e-6 };
            assert!(error < most, "{name}: {error}");
        }
    }
}
