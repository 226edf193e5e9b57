//! The transforms that are measured, each with its error against the slow reference.

use super::Effort;
use super::recording::{BAND_HZ, FS_HZ, IMPACTS_HZ, MESH_HZ, SHAFT_HZ};
use super::reference::{self, Morlet};
use crate::bench::clock::Work;
use crate::dsp::cwt::{DEFAULT_OMEGA0, MorletPlan, Part};
use crate::dsp::cwt_bank::{Accuracy, CwtPlan, Rate, Settings};
use crate::dsp::envelope::{self, EnvelopeSpectrumPlan, SquaredEnvelopePlan};
use crate::dsp::fft::{FftCache, ForwardPlan};
use crate::dsp::line::{self, Line, LinesPlan};
use crate::dsp::moments::{MomentHistory, Moments};
use crate::dsp::real::Real;
use crate::dsp::spectrum::AmplitudePlan;
use crate::dsp::welch::WelchPlan;
use rustfft::num_complex::Complex;
use rustfft::num_complex::Complex64;

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
const NAMES: [&str; 18] = [
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
    let (mut gap, mut largest) = (0.0_f64, 0.0_f64);
    for (found, exact) in pairs {
        gap = gap.max((found - exact).norm());
        largest = largest.max(exact.norm());
    }
    (largest > 0.0).then(|| gap / largest)
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
    forward: Forward<T>,
    plans: EnvelopePlans<T>,
}

impl<T: Real> Envelope<T> {
    fn new(x: &[f64]) -> Self {
        Self { forward: Forward::new(x), plans: EnvelopePlans::new(x.len(), &mut FftCache::new()) }
    }
}

impl<T: Real> Work for Envelope<T> {
    fn call(&mut self) {
        self.forward.call();
        self.plans.call(&self.forward.x_hat);
    }
}

impl<T: Real> Job for Envelope<T> {
    fn error(&mut self, x: &[f64]) -> Option<f64> {
        let n = self.forward.x.len();
        let bins = envelope::bins_of_band(n, FS_HZ, BAND_HZ.0, BAND_HZ.1)?;
        let e2 = reference::squared_envelope(&x[..n], bins, self.plans.e2.len());
        let bins: Vec<usize> = (0..self.plans.depth.len()).step_by(5).collect();
        let mean = reference::mean(&e2);
        let exact = reference::amplitudes(&e2, e2.len(), &bins);
        let exact: Vec<f64> = exact.iter().map(|value| value / mean).collect();
        relative_real(bins.iter().map(|k| self.plans.depth[*k]), &exact)
    }
}

fn moments_error(found: Moments, x: &[f64]) -> Option<f64> {
    let found = [found.rms()?, found.kurtosis()?, found.m6()?, found.m8()?];
    let exact = reference::moments(x);
    found.iter().zip(exact).map(|(found, exact)| (found / exact - 1.0).abs()).reduce(f64::max)
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

/// Frequencies of the scales, 5 Hz to 4 kHz by equal ratios.
pub(super) fn scales_hz(effort: &Effort) -> Vec<f64> {
    let last = (effort.n_scales - 1) as f64;
    let lowest = FS_HZ / effort.n_second as f64 * 5.0;
    (0..effort.n_scales).map(|i| lowest * (4000.0 / lowest).powf(i as f64 / last)).collect()
}

struct Cwt<T: Real> {
    x: Vec<T>,
    forward: ForwardPlan<T>,
    x_hat: Vec<Complex<T>>,
    /// Always there with a frequency below Nyquist, as all are.
    plan: Option<CwtPlan<T>>,
    f_hz: Vec<f64>,
    is_rms: bool,
    w: Vec<Complex<T>>,
    rms: Vec<f64>,
}

impl<T: Real> Cwt<T> {
    fn new(
        x: &[f64],
        effort: &Effort,
        n_padded: usize,
        (accuracy, rate, is_rms): (Accuracy, Rate, bool),
    ) -> Self {
        let mut cache = FftCache::new();
        let n = effort.n_second;
        let forward = ForwardPlan::new_padded(n, n_padded, &mut cache);
        let settings = Settings { fs_hz: FS_HZ, omega0: DEFAULT_OMEGA0, accuracy, rate };
        let f_hz = scales_hz(effort);
        let plan = if is_rms {
            CwtPlan::of_rms((n, n_padded), &f_hz, &settings)
        } else {
            CwtPlan::new((n, n_padded), &f_hz, &settings, &mut cache)
        };
        let w = complex_zeros(plan.as_ref().map_or(0, CwtPlan::out_len));
        let (x_hat, rms) = (complex_zeros(forward.n_bins()), vec![0.0; f_hz.len()]);
        Self { x: narrow(&x[..n]), forward, x_hat, plan, f_hz, is_rms, w, rms }
    }
}

impl<T: Real> Work for Cwt<T> {
    fn call(&mut self) {
        self.forward.process(&self.x, &mut self.x_hat);
        let Some(plan) = &mut self.plan else { return };
        if self.is_rms {
            plan.rms(&self.x_hat, &mut self.rms);
        } else {
            plan.process(&self.x_hat, &mut self.w);
        }
    }
}

impl<T: Real> Job for Cwt<T> {
    fn error(&mut self, x: &[f64]) -> Option<f64> {
        const TIMES: usize = 5;
        let plan = self.plan.as_ref()?;
        let (n, n_padded) = (self.x.len(), self.forward.n_samples());
        let spectrum = reference::spectrum(&x[..n], |_| 1.0, n_padded, 0..self.x_hat.len());
        let exact = Morlet { spectrum: &spectrum, n: n_padded, fs_hz: FS_HZ };
        if self.is_rms {
            let exact: Vec<f64> = self.f_hz.iter().map(|f_hz| exact.rms(*f_hz, n)).collect();
            return relative_real(self.rms.iter().copied(), &exact);
        }
        let pairs = self.f_hz.iter().enumerate().filter_map(|(scale, f_hz)| {
            let (places, step_s) = (plan.places(scale)?, plan.step_s(scale)?);
            let each = places.len().div_ceil(TIMES);
            Some((0..places.len()).step_by(each).map({
                let (w, exact) = (&self.w, &exact);
                move |i| (wide(&w[places.start + i]), exact.at(*f_hz, i as f64 * step_s * FS_HZ))
            }))
        });
        relative(pairs.flatten())
    }
}

/// Mean modulus at shaft and mesh, from a spectrum that is there.
struct Pair<T: Real> {
    x_hat: Vec<Complex<T>>,
    plans: Vec<MorletPlan<T>>,
    n: usize,
    found: [f64; 2],
}

impl<T: Real> Pair<T> {
    fn new(x: &[f64]) -> Self {
        let mut forward = Forward::<T>::new(x);
        forward.call();
        let plans = morlets(x.len(), &mut FftCache::new());
        Self { x_hat: forward.x_hat, plans, n: x.len(), found: [0.0; 2] }
    }
}

fn morlets<T: Real>(n: usize, cache: &mut FftCache<T>) -> Vec<MorletPlan<T>> {
    let shaft_hz = SHAFT_HZ.max(8.0 * FS_HZ / n as f64);
    let plan = |f_hz| MorletPlan::new(n, FS_HZ, f_hz, DEFAULT_OMEGA0, cache);
    [shaft_hz, MESH_HZ].into_iter().filter_map(plan).collect()
}

impl<T: Real> Work for Pair<T> {
    fn call(&mut self) {
        for (plan, found) in self.plans.iter_mut().zip(&mut self.found) {
            *found = plan.mean_magnitude(&self.x_hat).unwrap_or(f64::NAN);
        }
    }
}

impl<T: Real> Job for Pair<T> {
    fn error(&mut self, x: &[f64]) -> Option<f64> {
        let spectrum = reference::spectrum(&x[..self.n], |_| 1.0, self.n, 0..self.x_hat.len());
        let exact = Morlet { spectrum: &spectrum, n: self.n, fs_hz: FS_HZ };
        let shaft_hz = SHAFT_HZ.max(8.0 * FS_HZ / self.n as f64);
        let mean = |(plan, f_hz): (&MorletPlan<T>, f64)| {
            let (valid, step) = (plan.valid_range(), plan.step_s() * FS_HZ);
            let n = valid.len() as f64;
            valid.map(|i| exact.at(f_hz, i as f64 * step).norm()).sum::<f64>() / n
        };
        let exact: Vec<f64> = self.plans.iter().zip([shaft_hz, MESH_HZ]).map(mean).collect();
        relative_real(self.found.iter().copied(), &exact)
    }
}

/// What a second of a channel costs, many channels with their own histories in turn.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    /// 10 Hann spectra, an envelope spectrum, moments, |W| at all scales.
    Full(Accuracy),
    /// 10 lines in 10 windows, an envelope spectrum, moments, |W| at shaft and mesh.
    Diagnosis,
}

struct Channels<T: Real> {
    kind: Kind,
    n_second: usize,
    rings: Vec<(Vec<T>, MomentHistory)>,
    next: usize,
    forward: ForwardPlan<T>,
    x_hat: Vec<Complex<T>>,
    hann: AmplitudePlan<T>,
    amplitudes: Vec<T>,
    lines: LinesPlan<T>,
    found: [Option<Line>; LINES_HZ.len()],
    envelope: EnvelopePlans<T>,
    cwt: Option<CwtPlan<T>>,
    moduli: Vec<T>,
    morlets: Vec<MorletPlan<T>>,
}

impl<T: Real> Channels<T> {
    fn new(x: &[f64], effort: &Effort, kind: Kind) -> Self {
        let mut cache = FftCache::new();
        let n = effort.n_second;
        let forward = ForwardPlan::new(n, &mut cache);
        let hann = AmplitudePlan::new(effort.n_spectrum, &mut cache);
        let envelope = EnvelopePlans::new(n, &mut cache);
        let cwt = match kind {
            Kind::Full(accuracy) => {
                let rate = Rate::Decimated;
                let settings = Settings { fs_hz: FS_HZ, omega0: DEFAULT_OMEGA0, accuracy, rate };
                CwtPlan::new((n, n), &scales_hz(effort), &settings, &mut cache)
            }
            Kind::Diagnosis => None,
        };
        let mut history = MomentHistory::new(x.len() / n);
        for block in x.chunks(n) {
            history.push(block);
        }
        let ring = narrow::<T>(x);
        Self {
            kind,
            n_second: n,
            rings: vec![(ring, history); effort.n_channels],
            next: 0,
            x_hat: complex_zeros(forward.n_bins()),
            forward,
            amplitudes: zeros(hann.n_bins()),
            hann,
            lines: LinesPlan::new(effort.n_spectrum, FS_HZ, &LINES_HZ),
            found: [None; LINES_HZ.len()],
            envelope,
            moduli: zeros(cwt.as_ref().map_or(0, CwtPlan::out_len)),
            cwt,
            morlets: morlets(n, &mut cache),
        }
    }
}

impl<T: Real> Work for Channels<T> {
    fn call(&mut self) {
        const WINDOWS: usize = 10;
        self.next = (self.next + 1) % self.rings.len();
        let (ring, history) = &mut self.rings[self.next];
        let n_window = self.hann.n_samples();
        for i in 0..WINDOWS {
            let end = ring.len() - i * self.n_second / WINDOWS;
            let window = &ring[end - n_window..end];
            if self.kind == Kind::Diagnosis {
                self.lines.process(window, &mut self.found);
                std::hint::black_box(&mut self.found);
            } else {
                self.hann.process(window, &mut self.amplitudes);
                std::hint::black_box(&mut self.amplitudes);
            }
        }
        let newest = &ring[ring.len() - self.n_second..];
        history.push(newest);
        std::hint::black_box(history.moments());
        self.forward.process(newest, &mut self.x_hat);
        self.envelope.call(&self.x_hat);
        match &mut self.cwt {
            Some(cwt) => cwt.process_part(&self.x_hat, Part::Modulus, &mut self.moduli),
            None => {
                for morlet in &mut self.morlets {
                    std::hint::black_box(morlet.mean_magnitude(&self.x_hat));
                }
            }
        }
    }
}

impl<T: Real> Job for Channels<T> {
    fn error(&mut self, _: &[f64]) -> Option<f64> {
        None
    }
}
