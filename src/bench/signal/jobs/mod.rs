//! The transforms that are measured, each with its error against the slow reference.

mod channels;
mod pictures;
mod wavelets;

use super::Effort;
use super::recording::{BAND_HZ, FS_HZ, IMPACTS_HZ, MESH_HZ, SHAFT_HZ};
use super::reference;
use crate::bench::clock::Work;
use crate::bench::gaps::largest;
use crate::dsp::band_envelope::BandEnvelopePlan;
use crate::dsp::cwt_bank::{Accuracy, Rate};
use crate::dsp::envelope::{self, EnvelopeSpectrumPlan, SquaredEnvelopePlan};
use crate::dsp::fft::{FftCache, ForwardPlan};
use crate::dsp::line::{self, Line, LinesPlan};
use crate::dsp::moments::{MomentHistory, Moments};
use crate::dsp::real::Real;
use crate::dsp::spectrum::AmplitudePlan;
use crate::dsp::welch::WelchPlan;
use channels::{Channels, Kind};
use pictures::{Picture, Tree};
use rustfft::num_complex::Complex;
use rustfft::num_complex::Complex64;
use wavelets::{Cwt, Pair};

/// Frequencies of the lines that are read exactly.
pub(super) const LINES_HZ: [f64; 10] = [
    2.0 * SHAFT_HZ,
    3.0 * SHAFT_HZ,
    IMPACTS_HZ,
    2.0 * IMPACTS_HZ,
    3.0 * IMPACTS_HZ,
    MESH_HZ - SHAFT_HZ,
    MESH_HZ,
    MESH_HZ + SHAFT_HZ,
    2.0 * MESH_HZ,
    3.0 * MESH_HZ,
];

/// Something measured.
pub(super) trait Job: Work {
    /// Largest error of what the last call gave, relative to the largest value; `None`: nothing of its
    /// own to be wrong. `x` is the recording of which the job has its samples.
    fn error(&mut self, x: &[f64]) -> Option<f64>;
}

/// What is known of a job.
pub(super) struct Named {
    /// Name on the command line.
    pub(super) name: &'static str,
    /// What it is, for the table.
    pub(super) what: &'static str,
    /// What is different in this one.
    pub(super) mode: &'static str,
    /// A second of one channel a call.
    pub(super) is_channel: bool,
    pub(super) job: Box<dyn Job>,
}

/// Names of these jobs.
const NAMES: [&str; 23] = [
    "forward",
    "hann",
    "welch",
    "lines",
    "lines-new",
    "envelope",
    "moments",
    "history",
    "cwt",
    "cwt-coarse",
    "cwt-full",
    "cwt-rms",
    "cwt-padded",
    "cwt-padded-full",
    "morlet",
    "cwt-hat",
    "dwt",
    "ville",
    "smoothed-ville",
    "choi-williams",
    "full-job",
    "full-job-coarse",
    "diagnosis-job",
];

/// Names of all jobs, those of [`super::further`] included.
pub(super) fn names() -> impl Iterator<Item = &'static str> {
    NAMES.iter().chain(&super::further::NAMES).copied()
}

/// Prepares a job; `None` if there is no such name.
pub(super) fn prepare<T: Real>(name: &str, x: &[f64], effort: &Effort) -> Option<Named> {
    let second = effort.n_second;
    // f64 is measured with all of the wavelet that it can see.
    let is_double = size_of::<T>() == size_of::<f64>();
    let fine = if is_double { Accuracy::Reference } else { Accuracy::Fine };
    let cwt = |n_padded, accuracy, rate, is_rms| -> Box<dyn Job> {
        Box::new(Cwt::<T>::new(x, effort, n_padded, (accuracy, rate, is_rms)))
    };
    let padded = effort.n_padded;
    let (what, mode, job): (_, _, Box<dyn Job>) = match name {
        "forward" => ("real transform, 1 s", "", Box::new(Forward::<T>::new(&x[..second]))),
        "hann" => ("Hann spectrum", "", Box::new(Hann::<T>::new(&x[..effort.n_spectrum]))),
        "welch" => ("Welch density, 10 s", "", Box::new(Welch::<T>::new(x, effort.n_spectrum))),
        "lines" => {
            let job = Lines::<T>::new(&x[..effort.n_spectrum], true);
            ("10 exact lines", "planned", Box::new(job))
        }
        "lines-new" => {
            let job = Lines::<T>::new(&x[..effort.n_spectrum], false);
            ("10 exact lines", "new frequencies", Box::new(job))
        }
        "envelope" => (
            "envelope spectrum, 1 s",
            "band only, 1 Hz",
            Box::new(Envelope::<T>::new(&x[..second])),
        ),
        "moments" => {
            ("moments, 10 s", "at once", Box::new(AtOnce { x: narrow::<T>(x), found: None }))
        }
        "history" => ("moments, 10 s", "1 s is new", Box::new(History::<T>::new(x, second))),
        "cwt" => ("CWT, 1 s", "decimated", cwt(second, fine, Rate::Decimated, false)),
        "cwt-coarse" => {
            ("CWT, 1 s", "decimated 1e-3", cwt(second, Accuracy::Coarse, Rate::Decimated, false))
        }
        "cwt-full" => ("CWT, 1 s", "full rate", cwt(second, fine, Rate::Full, false)),
        "cwt-rms" => ("CWT, 1 s", "RMS only", cwt(second, fine, Rate::Decimated, true)),
        "cwt-padded" => {
            ("CWT, 1 s and zeros", "decimated", cwt(padded, fine, Rate::Decimated, false))
        }
        "cwt-padded-full" => {
            ("CWT, 1 s and zeros", "full rate", cwt(padded, fine, Rate::Full, false))
        }
        "morlet" => {
            ("Morlet at 2 frequencies", "from spectrum", Box::new(Pair::<T>::new(&x[..second])))
        }
        "cwt-hat" => {
            let job = Picture::<T>::hat(&x[..second], effort)?;
            ("Mexican hat, 1 s", "200 columns", Box::new(job))
        }
        "dwt" => ("discrete wavelets, 10 s", "db8, 8 levels", Box::new(Tree::<T>::new(x)?)),
        "ville" => {
            let job = Picture::<T>::ville(&x[..second], effort)?;
            ("Wigner-Ville, 1 s", "pseudo", Box::new(job))
        }
        "smoothed-ville" => {
            let job = Picture::<T>::smoothed(&x[..second], effort)?;
            ("Wigner-Ville, 1 s", "smoothed", Box::new(job))
        }
        "choi-williams" => {
            let job = Picture::<T>::choi(&x[..second], effort)?;
            ("Choi-Williams, 1 s", "", Box::new(job))
        }
        "full-job" => {
            ("channel-second, full", "", Box::new(Channels::<T>::new(x, effort, Kind::Full(fine))))
        }
        "full-job-coarse" => {
            let kind = Kind::Full(Accuracy::Coarse);
            ("channel-second, full", "CWT 1e-3", Box::new(Channels::<T>::new(x, effort, kind)))
        }
        "diagnosis-job" => {
            let job = Channels::<T>::new(x, effort, Kind::Diagnosis);
            ("channel-second, diagnosis", "", Box::new(job))
        }
        _ => super::further::prepare::<T>(name, x, effort)?,
    };
    let name = names().find(|known| *known == name)?;
    let is_channel = what.starts_with("channel-second");
    Some(Named { name, what, mode, is_channel, job })
}

fn narrow<T: Real>(x: &[f64]) -> Vec<T> {
    x.iter().map(|x| T::rounded(*x)).collect()
}

fn zeros<T: Real>(n: usize) -> Vec<T> {
    vec![T::zero(); n]
}

fn complex_zeros<T: Real>(n: usize) -> Vec<Complex<T>> {
    vec![Complex::new(T::zero(), T::zero()); n]
}

fn wide<T: Real>(x: &Complex<T>) -> Complex64 {
    Complex64::new(x.re.to_f64(), x.im.to_f64())
}

/// Largest difference over largest reference.
fn relative(pairs: impl Iterator<Item = (Complex64, Complex64)>) -> Option<f64> {
    let (gaps, sizes): (Vec<f64>, Vec<f64>) =
        pairs.map(|(found, exact)| ((found - exact).norm(), exact.norm())).unzip();
    let size = largest(sizes);
    (size > 0.0).then(|| largest(gaps) / size)
}

fn relative_real<T: Real>(found: impl Iterator<Item = T>, exact: &[f64]) -> Option<f64> {
    let real = |x: f64| Complex64::new(x, 0.0);
    relative(found.zip(exact).map(|(found, exact)| (real(found.to_f64()), real(*exact))))
}

struct Forward<T: Real> {
    x: Vec<T>,
    plan: ForwardPlan<T>,
    x_hat: Vec<Complex<T>>,
}

impl<T: Real> Forward<T> {
    fn new(x: &[f64]) -> Self {
        let plan = ForwardPlan::new(x.len(), &mut FftCache::new());
        let x_hat = complex_zeros(plan.n_bins());
        Self { x: narrow(x), plan, x_hat }
    }
}

impl<T: Real> Work for Forward<T> {
    fn call(&mut self) {
        self.plan.process(&self.x, &mut self.x_hat);
    }
}

impl<T: Real> Job for Forward<T> {
    fn error(&mut self, x: &[f64]) -> Option<f64> {
        let x = &x[..self.x.len()];
        let exact = reference::spectrum(x, |_| 1.0, x.len(), 0..self.x_hat.len());
        relative(self.x_hat.iter().map(wide).zip(exact))
    }
}

struct Hann<T: Real> {
    x: Vec<T>,
    plan: AmplitudePlan<T>,
    out: Vec<T>,
}

impl<T: Real> Hann<T> {
    fn new(x: &[f64]) -> Self {
        let plan = AmplitudePlan::new(x.len(), &mut FftCache::new());
        let out = zeros(plan.n_bins());
        Self { x: narrow(x), plan, out }
    }
}

impl<T: Real> Work for Hann<T> {
    fn call(&mut self) {
        self.plan.process(&self.x, &mut self.out);
    }
}

impl<T: Real> Job for Hann<T> {
    fn error(&mut self, x: &[f64]) -> Option<f64> {
        let n = self.x.len();
        let bins: Vec<usize> = (0..self.out.len()).collect();
        relative_real(self.out.iter().copied(), &reference::amplitudes(&x[..n], n, &bins))
    }
}

struct Welch<T: Real> {
    x: Vec<T>,
    plan: WelchPlan<T>,
    out: Vec<T>,
}

impl<T: Real> Welch<T> {
    fn new(x: &[f64], n_segment: usize) -> Self {
        let plan = WelchPlan::new(n_segment, &mut FftCache::new());
        let out = zeros(plan.n_bins());
        Self { x: narrow(x), plan, out }
    }
}

impl<T: Real> Work for Welch<T> {
    fn call(&mut self) {
        self.plan.process(&self.x, FS_HZ, &mut self.out);
    }
}

impl<T: Real> Job for Welch<T> {
    fn error(&mut self, x: &[f64]) -> Option<f64> {
        // Some bins, the mesh line's among them: all of them would take a minute.
        let n = 2 * (self.out.len() - 1);
        let mesh =
            (1..n / 2).max_by(|a, b| self.out[*a].to_f64().total_cmp(&self.out[*b].to_f64()))?;
        let bins: Vec<usize> = (0..=n / 2).step_by(67).chain([mesh]).collect();
        let exact = reference::densities(x, n, FS_HZ, &bins);
        relative_real(bins.iter().map(|k| self.out[*k]), &exact)
    }
}

struct Lines<T: Real> {
    x: Vec<T>,
    /// `None`: frequencies that are new with every record.
    plan: Option<LinesPlan<T>>,
    lines: [Option<Line>; LINES_HZ.len()],
}

impl<T: Real> Lines<T> {
    fn new(x: &[f64], is_planned: bool) -> Self {
        let plan = is_planned.then(|| LinesPlan::new(x.len(), FS_HZ, &LINES_HZ));
        Self { x: narrow(x), plan, lines: [None; LINES_HZ.len()] }
    }
}

impl<T: Real> Work for Lines<T> {
    fn call(&mut self) {
        match &mut self.plan {
            Some(plan) => plan.process(&self.x, &mut self.lines),
            None => line::lines_at(&self.x, FS_HZ, &LINES_HZ, &mut self.lines),
        }
    }
}

impl<T: Real> Job for Lines<T> {
    fn error(&mut self, x: &[f64]) -> Option<f64> {
        let x = &x[..self.x.len()];
        let exact: Vec<f64> =
            LINES_HZ.iter().map(|f_hz| reference::line(x, f_hz / FS_HZ)).collect();
        let found = self.lines.iter().map(|line| line.map_or(f64::NAN, |line| line.amplitude));
        relative_real(found, &exact)
    }
}

/// Squared envelope and its spectrum, from a spectrum.
struct EnvelopePlans<T: Real> {
    squared: SquaredEnvelopePlan<T>,
    e2: Vec<T>,
    spectrum: EnvelopeSpectrumPlan<T>,
    depth: Vec<T>,
}

impl<T: Real> EnvelopePlans<T> {
    fn new(n: usize, cache: &mut FftCache<T>) -> Self {
        let bins = envelope::bins_of_band(n, FS_HZ, BAND_HZ.0, BAND_HZ.1).unwrap_or(1..2);
        let squared = SquaredEnvelopePlan::new(n, bins, cache);
        let e2 = zeros(squared.out_len());
        let spectrum = EnvelopeSpectrumPlan::unpadded(e2.len(), cache);
        let depth = zeros(spectrum.n_bins());
        Self { squared, e2, spectrum, depth }
    }

    fn call(&mut self, x_hat: &[Complex<T>]) {
        self.squared.process(x_hat, &mut self.e2);
        self.spectrum.process(&self.e2, &mut self.depth);
    }
}

struct Envelope<T: Real> {
    x: Vec<T>,
    plan: BandEnvelopePlan<T>,
    depth: Vec<T>,
}

impl<T: Real> Envelope<T> {
    fn new(x: &[f64]) -> Self {
        let bins = envelope::bins_of_band(x.len(), FS_HZ, BAND_HZ.0, BAND_HZ.1).unwrap_or(1..2);
        let plan = BandEnvelopePlan::new(x.len(), bins, &mut FftCache::new());
        let depth = zeros(plan.n_bins());
        Self { x: narrow(x), plan, depth }
    }
}

impl<T: Real> Work for Envelope<T> {
    fn call(&mut self) {
        self.plan.process(&self.x, &mut self.depth);
    }
}

impl<T: Real> Job for Envelope<T> {
    fn error(&mut self, x: &[f64]) -> Option<f64> {
        let n = self.x.len();
        let bins = envelope::bins_of_band(n, FS_HZ, BAND_HZ.0, BAND_HZ.1)?;
        let e2 = reference::squared_envelope(&x[..n], bins, 2 * (self.depth.len() - 1));
        let bins: Vec<usize> = (0..self.depth.len()).step_by(5).collect();
        let mean = reference::mean(&e2);
        let exact = reference::amplitudes(&e2, e2.len(), &bins);
        let exact: Vec<f64> = exact.iter().map(|value| value / mean).collect();
        relative_real(bins.iter().map(|k| self.depth[*k]), &exact)
    }
}

fn moments_error(found: Moments, x: &[f64]) -> Option<f64> {
    let found = [found.rms()?, found.kurtosis()?, found.m6()?, found.m8()?];
    let exact = reference::moments(x);
    Some(largest(found.iter().zip(exact).map(|(found, exact)| found / exact - 1.0)))
}

struct AtOnce<T> {
    x: Vec<T>,
    found: Option<Moments>,
}

impl<T: Real> Work for AtOnce<T> {
    fn call(&mut self) {
        self.found = Some(Moments::of(&self.x));
    }
}

impl<T: Real> Job for AtOnce<T> {
    fn error(&mut self, x: &[f64]) -> Option<f64> {
        moments_error(self.found?, x)
    }
}

struct History<T> {
    x: Vec<T>,
    n_second: usize,
    next: usize,
    history: MomentHistory,
    found: Moments,
}

impl<T: Real> History<T> {
    fn new(x: &[f64], n_second: usize) -> Self {
        let history = MomentHistory::new(x.len() / n_second);
        Self { x: narrow(x), n_second, next: 0, history, found: Moments::EMPTY }
    }
}

impl<T: Real> Work for History<T> {
    fn call(&mut self) {
        self.history.push(&self.x[self.next..self.next + self.n_second]);
        self.next = (self.next + self.n_second) % self.x.len();
        self.found = self.history.moments();
    }
}

impl<T: Real> Job for History<T> {
    fn error(&mut self, x: &[f64]) -> Option<f64> {
        for _ in 0..x.len() / self.n_second {
            self.call();
        }
        moments_error(self.found, x)
    }
}
