//! What a second of a channel costs: everything that is done to it.

use super::wavelets::{morlets, scales_hz};
use super::{EnvelopePlans, Job, LINES_HZ, complex_zeros, narrow, zeros};
use crate::bench::clock::Work;
use crate::bench::signal::Effort;
use crate::bench::signal::recording::FS_HZ;
use crate::dsp::cwt::{DEFAULT_OMEGA0, MorletPlan, Part};
use crate::dsp::cwt_bank::{Accuracy, CwtPlan, Rate, Settings};
use crate::dsp::fft::{FftCache, ForwardPlan};
use crate::dsp::line::{Line, LinesPlan};
use crate::dsp::moments::MomentHistory;
use crate::dsp::real::Real;
use crate::dsp::spectrum::AmplitudePlan;
use rustfft::num_complex::Complex;

/// What a second of a channel costs, many channels with their own histories in turn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Kind {
    /// 10 Hann spectra, an envelope spectrum, moments, |W| at all scales.
    Full(Accuracy),
    /// 10 lines in 10 windows, an envelope spectrum, moments, |W| at shaft and mesh.
    Diagnosis,
}

pub(super) struct Channels<T: Real> {
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
    pub(super) fn new(x: &[f64], effort: &Effort, kind: Kind) -> Self {
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
