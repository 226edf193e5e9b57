//! Signals at random through every transform: identities hold, and nothing that is no number comes out.

use super::Search;
use super::rows::Row;
use crate::bench::BenchError;
use crate::bench::gaps::{largest, relative};
use crate::dsp::bilinear::kernel::Kernel;
use crate::dsp::bilinear::{JointPlan, JointSpec};
use crate::dsp::complex_cepstrum::ComplexCepstrumPlan;
use crate::dsp::cwt::{DEFAULT_OMEGA0, Part, ScalogramPlan};
use crate::dsp::envelope::{EnvelopeSpectrumPlan, SquaredEnvelopePlan};
use crate::dsp::fft::{FftCache, ForwardPlan};
use crate::dsp::real::Real;
use crate::dsp::spectrum::AmplitudePlan;
use crate::dsp::stats;
use crate::dsp::stft::{FrameSpec, Scale, StftPlan};
use crate::dsp::synthesis::SynthesisPlan;
use crate::dsp::wavelet::dwt::DwtPlan;
use crate::dsp::wavelet::picture::WaveletScalogramPlan;
use crate::dsp::wavelet::shape::{Shape, Wavelet};
use crate::dsp::wavelet::taps::FilterBank;
use crate::dsp::welch::WelchPlan;
use crate::dsp::window;
use rand::RngExt;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use rustfft::num_complex::Complex;
use std::f64::consts::TAU;

const FS_HZ: f64 = 10_000.0;

/// Largest errors so far, by transform.
#[derive(Default)]
struct Errors {
    of: Vec<Error>,
}

/// Largest error of a transform.
struct Error {
    name: &'static str,
    largest: f64,
    tolerance: f64,
    reason: &'static str,
    n: usize,
}

impl Errors {
    /// Takes in an error with its tolerance and the tolerance's reason; what is no number is infinitely wrong.
    fn take(&mut self, name: &'static str, error: f64, tolerance: f64, reason: &'static str) {
        let error = if error.is_finite() { error } else { f64::INFINITY };
        match self.of.iter_mut().find(|known| known.name == name) {
            Some(known) => (known.largest, known.n) = (known.largest.max(error), known.n + 1),
            None => self.of.push(Error { name, largest: error, tolerance, reason, n: 1 }),
        }
    }
}

/// Runs the signals, one row a transform.
///
/// # Errors
///
/// [`BenchError`] when a transform cannot be planned.
pub fn signals(search: &Search) -> Result<Vec<Row>, BenchError> {
    let mut errors = Errors::default();
    for seed in search.first_seed..search.first_seed.saturating_add(search.n_signals) {
        let (kind, x) = signal(seed);
        one(&x, kind, &mut errors).ok_or(BenchError::Absent { case: "signals", what: "plan" })?;
    }
    let row = |error: &Error| {
        Row::below(
            error.name,
            format!("{} pictures or signals", error.n),
            error.largest,
            error.tolerance,
        )
        .in_terms_of("largest relative error")
        .because(error.reason)
    };
    Ok(errors.of.iter().map(row).collect())
}

/// A signal of 64 to 1500 samples: noise, tones, impulses, steps, a chirp, clipped, huge, tiny, with an offset.
fn signal(seed: u64) -> (Kind, Vec<f64>) {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let n = random.random_range(64..1500);
    let mut even = || random.random::<f64>();
    let noise_level = if even() < 0.3 { 0.0 } else { 10f64.powf(-6.0 * even()) };
    let (shape, frequency, phase) = (even(), 0.5 * even(), TAU * even());
    let place = 1.0 + (n - 2) as f64 * even();
    let value = |i: usize| {
        let t = i as f64;
        match shape {
            s if s < 0.2 => 0.0,
            s if s < 0.4 => (TAU * frequency * t + phase).cos(),
            s if s < 0.5 => f64::from(u8::from((t - place).abs() < 0.5)),
            s if s < 0.6 => {
                if t < place {
                    0.0
                } else {
                    1.0
                }
            }
            s if s < 0.8 => (TAU * frequency * t * t / (2.0 * n as f64) + phase).cos(),
            _ => (3.0 * (TAU * frequency * t + phase).cos()).clamp(-1.0, 1.0),
        }
    };
    let mut x: Vec<f64> = (0..n).map(value).collect();
    for x in &mut x {
        *x += noise_level * (even() + even() + even() - 1.5);
    }
    let exponent = if even() < 0.3 { 24.0 * even() - 12.0 } else { 0.0 };
    let offset = if even() < 0.2 { 100.0 * even() } else { 0.0 };
    for x in &mut x {
        *x = (*x + offset) * 10f64.powf(exponent);
    }
    (Kind { has_offset: offset != 0.0 }, x)
}

/// What decides tolerances.
#[derive(Clone, Copy)]
struct Kind {
    has_offset: bool,
}

/// Largest magnitude.
fn top(list: &[f64]) -> f64 {
    largest(list.iter().copied())
}

fn wide<T: Real>(list: &[T]) -> Vec<f64> {
    list.iter().map(|value| value.to_f64()).collect()
}

/// Results of the kernels that have no inverse, in one precision.
struct Pictures {
    spectra: Vec<List>,
    pictures: Vec<List>,
    joint: Vec<List>,
}

/// What a kernel gave, and below which largest value it is nothing but rounding of the samples: a thousandth of the
/// largest of them, of powers 1e-5 of its square.
struct List {
    values: Vec<f64>,
    floor: f64,
}

/// Amplitudes whose envelopes single precision holds: a spectrum's power is the fourth power of them, and 1e-10 of that where the band
/// has 1e-5 of the signal's.
const ENVELOPES_OF: std::ops::Range<f64> = 1e-6..1e9;

fn pictures<T: Real>(x: &[f64]) -> Option<Pictures> {
    let n = x.len();
    let top_of_signal = top(x);
    let (of_line, of_power) = (1e-3 * top_of_signal, 1e-5 * top_of_signal * top_of_signal);
    let list = |values: &[T], floor| List { values: wide(values), floor };
    let x: Vec<T> = x.iter().map(|x| T::rounded(*x)).collect();
    let mut cache = FftCache::<T>::new();
    let mut forward = ForwardPlan::new(n, &mut cache);
    let mut x_hat = vec![Complex::default(); forward.n_bins()];
    forward.process(&x, &mut x_hat);
    let mut spectra = Vec::new();
    let mut amplitude = AmplitudePlan::new(n, &mut cache);
    let mut out = vec![T::ZERO; amplitude.n_bins()];
    amplitude.process(&x, &mut out);
    spectra.push(list(&out, of_line));
    let mut welch = WelchPlan::new(n / 3, &mut cache);
    let mut out = vec![T::ZERO; welch.n_bins()];
    welch.process(&x, FS_HZ, &mut out);
    spectra.push(list(&out, of_power / FS_HZ));
    let spec = FrameSpec { shape: window::Shape::Hann, n_frame: n / 4, hop: n / 7 };
    let mut stft = StftPlan::new(spec, &mut cache);
    let mut out = vec![T::ZERO; stft.n_frames(n) * stft.n_bins()];
    stft.process(&x, FS_HZ, Scale::Amplitude, &mut out);
    spectra.push(list(&out, of_line));
    let band = n / 10..n / 4;
    let mut squared = SquaredEnvelopePlan::new(n, band.clone(), &mut cache);
    let mut e2 = vec![T::ZERO; squared.out_len()];
    squared.process(&x_hat, &mut e2);
    // The cheapest rate of e² is another in the other precision; its spectrum has the same bins at every rate.
    let mut envelope = EnvelopeSpectrumPlan::unpadded(e2.len(), &mut cache);
    let mut depth = vec![T::ZERO; envelope.n_bins()];
    let mean = envelope.process(&e2, &mut depth).unwrap_or(0.0);
    depth.truncate(band.len());
    if mean > of_power && ENVELOPES_OF.contains(&top_of_signal) {
        spectra.push(list(&depth, 0.0));
    }
    let f_hz = [150.0, 800.0, 3100.0];
    let mut pictures = Vec::new();
    let mut morlet = ScalogramPlan::new(n, FS_HZ, &f_hz, DEFAULT_OMEGA0, 40, &mut cache)?;
    let mut out = vec![T::ZERO; morlet.out_len()];
    morlet.process(&x_hat, Part::Modulus, &mut out);
    pictures.push(list(&out, of_line));
    for wavelet in [Wavelet::MexicanHat, Wavelet::Haar] {
        let shape = Shape::new(wavelet)?;
        let mut plan = WaveletScalogramPlan::new(shape, (n, FS_HZ), &f_hz, 40, &mut cache)?;
        let mut out = vec![T::ZERO; plan.out_len()];
        plan.process(&x_hat, Part::Modulus, &mut out);
        pictures.push(list(&out, of_line));
    }
    let mut joint = Vec::new();
    for kernel in [Kernel::Delta, Kernel::Hann(n / 20), Kernel::ChoiWilliams(1.0)] {
        let spec =
            JointSpec { kernel, n_lags: 16, is_lag_windowed: true, n_frequencies: 40, n_times: 9 };
        let mut plan = JointPlan::new(n, FS_HZ, spec, &mut cache)?;
        let mut out = vec![T::ZERO; plan.out_len()];
        plan.process(&x_hat, &mut out);
        joint.push(list(&out, 10.0 * of_power / FS_HZ));
    }
    Some(Pictures { spectra, pictures, joint })
}

fn one(x: &[f64], kind: Kind, errors: &mut Errors) -> Option<()> {
    there_and_back(x, errors)?;
    marginal(x, errors)?;
    let (single, double) = (pictures::<f32>(x)?, pictures::<f64>(x)?);
    // An offset of 100 times the signal takes two digits of f32 away before anything is computed.
    let lists = [
        ("spectra, STFT, envelopes: f32 against f64", &single.spectra, &double.spectra, 1e-4),
        ("wavelet pictures: f32 against f64", &single.pictures, &double.pictures, 1e-4),
        ("bilinear distributions: f32 against f64", &single.joint, &double.joint, 1e-4),
    ];
    for (name, single, double, tolerance) in lists {
        for (single, double) in single.iter().zip(double) {
            let has_digits = top(&double.values) > double.floor;
            let (single, double) = (&single.values, &double.values);
            let is_finite = single.iter().chain(double).all(|v| v.is_finite());
            let error = if !is_finite {
                f64::INFINITY
            } else if kind.has_offset || !has_digits {
                0.0
            } else {
                relative(single, double)
            };
            errors.take(
                name,
                error,
                tolerance,
                "rounding of samples and sums in f32, 1e-7 each, of up to 1500 terms",
            );
        }
    }
    Some(())
}

/// Transforms with an inverse.
fn there_and_back(x: &[f64], errors: &mut Errors) -> Option<()> {
    let n = x.len();
    let rounding = "rounding of f64 in sums of up to 1500 terms";
    let mean = stats::mean(x).unwrap_or(0.0);
    let centred: Vec<f64> = x.iter().map(|x| x - mean).collect();
    let mut cache = FftCache::<f64>::new();
    let mut forward = ForwardPlan::new(n, &mut cache);
    let mut x_hat = vec![Complex::default(); forward.n_bins()];
    forward.process(x, &mut x_hat);
    let mut back = vec![0.0; n];
    SynthesisPlan::new(n).process(&x_hat, &mut back);
    // Of the samples with their mean: that is what was rounded.
    let of_samples = |found: &[f64], right: &[f64]| {
        let gap: Vec<f64> = found.iter().zip(right).map(|(a, b)| a - b).collect();
        if top(x) > 0.0 { top(&gap) / top(x) } else { top(&gap) }
    };
    errors.take("spectrum and back", of_samples(&back, &centred), 1e-12, rounding);
    let bins = x_hat.iter().enumerate();
    let both_sides = |(k, x): (usize, &Complex<f64>)| {
        x.norm_sqr() * if k == 0 || 2 * k == n { 1.0 } else { 2.0 }
    };
    let energy = bins.map(both_sides).sum::<f64>() / n as f64;
    let right: f64 = centred.iter().map(|x| x * x).sum();
    let scale = x.iter().map(|x| x * x).sum::<f64>();
    let error = if scale > 0.0 { (energy - right).abs() / scale } else { energy };
    errors.take("Parseval", error, 1e-12, rounding);
    let n_even = n - n % 8;
    for bank in [FilterBank::daubechies(1), FilterBank::daubechies(8), FilterBank::spline(2, 4)] {
        let mut plan = DwtPlan::new(&bank?, n_even, 3)?;
        let (mut c, mut back) = (vec![0.0; n_even], vec![0.0; n_even]);
        plan.analyse(&x[..n_even], &mut c);
        plan.synthesise(&c, &mut back);
        let error = of_samples(&back, &x[..n_even]);
        errors.take(
            "discrete wavelets and back",
            error,
            1e-10,
            "roots of the taps are known to 1e-12",
        );
    }
    let n_padded = 4 * n;
    let mut plan = ComplexCepstrumPlan::new(n, n_padded)?;
    let (mut c, mut back) = (vec![0.0; n_padded], vec![0.0; n_padded]);
    if let Some(removed) = plan.process(x, &mut c) {
        plan.invert(&c, &removed, &mut back);
        let error = of_samples(&back[..n], x);
        errors.take(
            "complex cepstrum and back",
            error,
            1e-8,
            "what lies below 1e-12 of the largest bin is raised to it, in up to 6000 bins",
        );
    }
    let mut spectrum = EnvelopeSpectrumPlan::new(64, &mut cache);
    let mut depth = vec![0.0; spectrum.n_bins()];
    let squares: Vec<f64> = x[..64].iter().map(|x| x * x).collect();
    spectrum.process(&squares, &mut depth);
    // Of values that are not negative no line exceeds twice the mean.
    errors.take(
        "modulation depth less 2",
        (top(&depth) - 2.0).max(0.0),
        1e-9,
        "|Σx·e^jφ| ≤ Σ|x|, rounding",
    );
    Some(())
}

/// ∫W df = |z|² for every kernel.
fn marginal(x: &[f64], errors: &mut Errors) -> Option<()> {
    let n = x.len();
    let mut cache = FftCache::<f64>::new();
    let mut forward = ForwardPlan::new(n, &mut cache);
    let mut x_hat = vec![Complex::default(); forward.n_bins()];
    forward.process(x, &mut x_hat);
    let base = JointSpec {
        kernel: Kernel::Delta,
        n_lags: 16,
        is_lag_windowed: true,
        n_frequencies: 40,
        n_times: 9,
    };
    let power = |kernel| {
        let mut plan =
            JointPlan::new(n, FS_HZ, JointSpec { kernel, ..base }, &mut FftCache::new())?;
        let mut out = vec![0.0; plan.out_len()];
        plan.process(&x_hat, &mut out);
        let width_hz = plan.bin_width_hz();
        Some(out.chunks(40).map(|row| row.iter().sum::<f64>() * width_hz).collect::<Vec<f64>>())
    };
    let (ville, choi) = (power(Kernel::Delta)?, power(Kernel::ChoiWilliams(1.0))?);
    let scale = top(x) * top(x);
    let gap: Vec<f64> = ville.iter().zip(&choi).map(|(a, b)| a - b).collect();
    let error = if scale > 0.0 { top(&gap) / scale } else { top(&gap) };
    errors.take("power at an instant, two kernels", error, 1e-11, "at lag 0 no kernel smooths");
    let negative = ville.iter().fold(0.0_f64, |a, b| a.max(-b));
    let error = if scale > 0.0 { negative / scale } else { negative };
    errors.take("power at an instant below 0", error, 1e-11, "it is |z|², rounding of sums of 40");
    Some(())
}
