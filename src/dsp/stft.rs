//! Short-time Fourier transform: spectra of frames a hop apart.
//!
//! [`StftPlan`] transforms frames of a record, [`StftStream`] those of a signal that comes in blocks;
//! both give the same bits. Frames lie wholly inside the signal: nothing is padded, so the first frame
//! speaks for the time n/2 samples from the start, and up to hop − 1 samples at the end are in no
//! frame. No inverse. Must not know what the frames are for.

use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::fft;
use crate::dsp::fft::FftCache;
use crate::dsp::fft::ForwardPlan;
use crate::dsp::real::Real;
use crate::dsp::window::Shape;
use crate::dsp::window::Window;

/// What a bin of a frame stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Zero-to-peak amplitude, u: a sine on a bin reads its amplitude.
    Amplitude,
    /// One-sided power spectral density, u²/Hz: the sum times fs/n is the frame's weighted variance.
    Density,
}

/// Shape of the frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrameSpec {
    /// Window.
    pub shape: Shape,
    /// Samples n of a frame.
    pub n_frame: usize,
    /// Samples from one frame to the next; may exceed n.
    pub hop: usize,
}

/// Transforms frames of n samples (D68).
#[derive(Debug)]
pub struct StftPlan<T: Real> {
    hop: usize,
    window: Window<T>,
    forward: ForwardPlan<T>,
    x_hat: Vec<Complex<T>>,
}

impl<T: Real> StftPlan<T> {
    /// Plans for frames of one shape.
    ///
    /// # Panics
    ///
    /// If frame or hop is 0 samples.
    #[must_use]
    pub fn new(spec: FrameSpec, cache: &mut FftCache<T>) -> Self {
        assert!(spec.n_frame > 0 && spec.hop > 0, "frames of samples, some samples apart");
        Self {
            hop: spec.hop,
            window: Window::new(spec.shape, spec.n_frame),
            forward: ForwardPlan::new(spec.n_frame, cache),
            x_hat: vec![Complex::zero(); fft::n_bins(spec.n_frame)],
        }
    }

    /// Samples n of a frame.
    #[must_use]
    pub fn n_frame(&self) -> usize {
        self.window.weights.len()
    }

    /// Bins of a frame: ⌊n/2⌋ + 1, bin k at k·fs/n.
    #[must_use]
    pub fn n_bins(&self) -> usize {
        self.x_hat.len()
    }

    /// Complete frames in a record of `n_samples`.
    #[must_use]
    pub fn n_frames(&self, n_samples: usize) -> usize {
        n_samples.checked_sub(self.n_frame()).map_or(0, |rest| rest / self.hop + 1)
    }

    /// Time of the middle of frame `m`, s from the first sample: (m·hop + n/2)/fs.
    #[must_use]
    pub fn centre_s(&self, m: u64, fs_hz: f64) -> f64 {
        (m as f64 * self.hop as f64 + 0.5 * self.n_frame() as f64) / fs_hz
    }

    /// Transforms one frame: Σ w·(x − x̄)·e^(−j2πki/n), not normalised; the phase counts from the frame's
    /// first sample.
    ///
    /// # Panics
    ///
    /// If `frame` does not have the plan's length.
    pub fn transform(&mut self, frame: &[T]) -> &[Complex<T>] {
        self.forward.process_weighted(frame, &self.window.weights, &mut self.x_hat);
        &self.x_hat
    }

    /// Writes amplitude or density of one frame, its mean removed, into `out` (⌊n/2⌋ + 1 values).
    ///
    /// # Panics
    ///
    /// If a slice does not have the plan's length.
    pub fn frame(&mut self, frame: &[T], fs_hz: f64, scale: Scale, out: &mut [T]) {
        assert_eq!(out.len(), self.n_bins(), "bins of the plan");
        let n = self.n_frame();
        let amplitude = T::rounded(2.0 / self.window.sum);
        let density = 2.0 / (fs_hz * self.window.sum_of_squares);
        let half = T::rounded(0.5);
        let x_hat = self.transform(frame);
        for (k, (out, value)) in out.iter_mut().zip(x_hat).enumerate() {
            let whole = match scale {
                Scale::Amplitude => value.norm_sqr().square_root() * amplitude,
                Scale::Density => T::rounded(value.norm_sqr().to_f64() * density),
            };
            // A bin that is its own mirror is counted once.
            *out = if k == 0 || 2 * k == n { whole * half } else { whole };
        }
    }

    /// Writes all complete frames of `x` one behind another into `out` and returns how many.
    ///
    /// `x`: any length, unit u. `out`: at least n_frames·n_bins values; row m is frame m.
    ///
    /// # Panics
    ///
    /// If `out` is too short.
    pub fn process(&mut self, x: &[T], fs_hz: f64, scale: Scale, out: &mut [T]) -> usize {
        let n_frames = self.n_frames(x.len());
        let n_bins = self.n_bins();
        assert!(out.len() >= n_frames * n_bins, "room for all frames");
        for (m, row) in out.chunks_exact_mut(n_bins).take(n_frames).enumerate() {
            let start = m * self.hop;
            self.frame(&x[start..start + self.n_frame()], fs_hz, scale, row);
        }
        n_frames
    }
}

/// Frames of a signal that comes in blocks of any length (D68).
#[derive(Debug)]
pub struct StftStream<T: Real> {
    plan: StftPlan<T>,
    fs_hz: f64,
    scale: Scale,
    /// The samples of the frame under way.
    held: Vec<T>,
    /// Samples to pass over before the next frame, where the hop exceeds the frame.
    skip: usize,
    row: Vec<T>,
    n_frames: u64,
    n_rejected_frames: u64,
    n_not_finite: u64,
}

impl<T: Real> StftStream<T> {
    /// Begins a stream at `fs_hz`.
    #[must_use]
    pub fn new(plan: StftPlan<T>, fs_hz: f64, scale: Scale) -> Self {
        let (held, row) = (Vec::with_capacity(plan.n_frame()), vec![T::zero(); plan.n_bins()]);
        Self {
            plan,
            fs_hz,
            scale,
            held,
            skip: 0,
            row,
            n_frames: 0,
            n_rejected_frames: 0,
            n_not_finite: 0,
        }
    }

    /// Takes in a block and hands each frame completed to `sink`: its number m from the start of the
    /// stream, and its bins.
    ///
    /// A frame with a sample that is no number is not handed on; frame and samples are counted.
    pub fn push(&mut self, mut x: &[T], mut sink: impl FnMut(u64, &[T])) {
        let n = self.plan.n_frame();
        while !x.is_empty() {
            let skipped = self.skip.min(x.len());
            self.skip -= skipped;
            let (passed, rest) = x.split_at(skipped);
            self.count_not_finite(passed);
            let (taken, rest) = rest.split_at((n - self.held.len()).min(rest.len()));
            self.count_not_finite(taken);
            self.held.extend_from_slice(taken);
            x = rest;
            if self.held.len() == n {
                self.emit(&mut sink);
                let hop = self.plan.hop;
                self.held.drain(..hop.min(n));
                self.skip = hop.saturating_sub(n);
            }
        }
    }

    fn emit(&mut self, sink: &mut impl FnMut(u64, &[T])) {
        let m = self.n_frames;
        self.n_frames += 1;
        if self.held.iter().all(|value| value.to_f64().is_finite()) {
            self.plan.frame(&self.held, self.fs_hz, self.scale, &mut self.row);
            sink(m, &self.row);
        } else {
            self.n_rejected_frames += 1;
        }
    }

    fn count_not_finite(&mut self, x: &[T]) {
        let bad = x.iter().filter(|value| !value.to_f64().is_finite()).count();
        self.n_not_finite += bad as u64;
    }

    /// Forgets the frame under way: after a gap no frame may span it. Frames are numbered on.
    pub fn break_off(&mut self) {
        self.held.clear();
        self.skip = 0;
    }

    /// Frames completed, rejected ones among them.
    #[must_use]
    pub fn n_frames(&self) -> u64 {
        self.n_frames
    }

    /// Frames not handed on.
    #[must_use]
    pub fn n_rejected_frames(&self) -> u64 {
        self.n_rejected_frames
    }

    /// Samples that were no numbers.
    #[must_use]
    pub fn n_not_finite(&self) -> u64 {
        self.n_not_finite
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::reference::dft;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::largest_difference;
    use crate::dsp::reference::narrow;
    use crate::dsp::reference::sine;

    const FS_HZ: f64 = 1000.0;

    fn plan<T: Real>(n_frame: usize, hop: usize) -> StftPlan<T> {
        let spec = FrameSpec { shape: Shape::Hann, n_frame, hop };
        StftPlan::new(spec, &mut FftCache::new())
    }

    fn frames<T: Real>(x: &[f64], n_frame: usize, hop: usize, scale: Scale) -> Vec<T> {
        let mut plan = plan::<T>(n_frame, hop);
        let mut out = vec![T::zero(); plan.n_frames(x.len()) * plan.n_bins()];
        plan.process(&narrow::<T>(x), FS_HZ, scale, &mut out);
        out
    }

    /// One frame as its definition says.
    fn slow_frame(x: &[f64], scale: Scale) -> Vec<f64> {
        let n = x.len();
        let mean = x.iter().sum::<f64>() / n as f64;
        let w = |i: usize| 0.5 - 0.5 * (std::f64::consts::TAU * i as f64 / n as f64).cos();
        let weighted = |(i, v): (usize, &f64)| Complex::new((v - mean) * w(i), 0.0);
        let x_hat = dft(&x.iter().enumerate().map(weighted).collect::<Vec<_>>());
        let sides = |k: usize| if k == 0 || 2 * k == n { 1.0 } else { 2.0 };
        let bin = |k: usize| match scale {
            Scale::Amplitude => sides(k) * x_hat[k].norm() / (0..n).map(w).sum::<f64>(),
            Scale::Density => {
                let power = (0..n).map(|i| w(i) * w(i)).sum::<f64>();
                sides(k) * x_hat[k].norm_sqr() / (FS_HZ * power)
            }
        };
        (0..=n / 2).map(bin).collect()
    }

    #[test]
    fn every_frame_matches_the_definition() {
        let x = gaussian_noise(500, 1);
        for (n, hop) in [(64, 16), (97, 50), (30, 40)] {
            for scale in [Scale::Amplitude, Scale::Density] {
                let exact: Vec<f64> = (0..(500 - n) / hop + 1)
                    .flat_map(|m| slow_frame(&x[m * hop..m * hop + n], scale))
                    .collect();
                // Rounding of an FFT in either precision; the f32 window and input add theirs.
                assert!(largest_difference(&frames::<f64>(&x, n, hop, scale), &exact) < 1e-13);
                assert!(largest_difference(&frames::<f32>(&x, n, hop, scale), &exact) < 1e-6);
            }
        }
    }

    #[test]
    fn a_sine_reads_its_amplitude_and_a_chirp_its_frequency_at_the_frame_middle() {
        let tone: Vec<f64> = sine(2000, FS_HZ, 125.0, 3.0, 0.2).iter().map(|v| v + 1e6).collect();
        for row in frames::<f64>(&tone, 200, 50, Scale::Amplitude).chunks(101) {
            // An offset of 1e6 times the signal rounds it by 1e-10 and is taken out first.
            assert!((row[25] - 3.0).abs() < 1e-8);
        }
        // 100 Hz + 40 Hz/s: in frame m the ridge is at 100 + 40·t_m.
        let chirp: Vec<f64> = (0..5000)
            .map(|i| i as f64 / FS_HZ)
            .map(|t| (std::f64::consts::TAU * (100.0 * t + 20.0 * t * t)).cos())
            .collect();
        let (mut plan, n_bins) = (plan::<f64>(256, 128), 129);
        let mut out = vec![0.0; plan.n_frames(5000) * n_bins];
        let n_frames = plan.process(&chirp, FS_HZ, Scale::Amplitude, &mut out);
        for m in 0..n_frames {
            let row = &out[m * n_bins..(m + 1) * n_bins];
            let at = (0..n_bins).max_by(|a, b| row[*a].total_cmp(&row[*b])).unwrap();
            let expected = 100.0 + 40.0 * plan.centre_s(m as u64, FS_HZ);
            // Half a bin of 3.9 Hz.
            assert!((at as f64 * FS_HZ / 256.0 - expected).abs() <= 2.0, "frame {m}");
        }
    }

    #[test]
    fn density_integrates_to_the_variance_for_every_window() {
        let x = gaussian_noise(60_000, 9);
        for shape in [Shape::Hann, Shape::FlatTop] {
            let spec = FrameSpec { shape, n_frame: 256, hop: 128 };
            let mut plan = StftPlan::new(spec, &mut FftCache::new());
            let mut out = vec![0.0; plan.n_frames(x.len()) * plan.n_bins()];
            let n_frames = plan.process(&x, FS_HZ, Scale::Density, &mut out);
            let variance = out.iter().sum::<f64>() * FS_HZ / 256.0 / n_frames as f64;
            // 60 000 samples scatter by 0.6 %; removing a frame's mean takes up to 3.8/256.
            assert!((variance - 1.0).abs() < 0.03, "{shape:?} {variance}");
        }
    }

    #[test]
    fn blocks_of_any_length_give_the_same_bits() {
        let x = narrow::<f32>(&gaussian_noise(3001, 5));
        for (n, hop) in [(64, 16), (100, 100), (30, 47), (97, 1)] {
            let mut plan = plan::<f32>(n, hop);
            let n_bins = plan.n_bins();
            let mut whole = vec![0.0; plan.n_frames(x.len()) * n_bins];
            let n_frames = plan.process(&x, FS_HZ, Scale::Amplitude, &mut whole);
            for block in [1, 7, 64, 1000, 5000] {
                let mut stream = StftStream::new(self::plan(n, hop), FS_HZ, Scale::Amplitude);
                let (mut streamed, mut next) = (Vec::new(), 0);
                for block in x.chunks(block) {
                    stream.push(block, |m, row| {
                        assert_eq!(m, next);
                        next += 1;
                        streamed.extend_from_slice(row);
                    });
                }
                assert_eq!((stream.n_frames(), streamed.len()), (n_frames as u64, whole.len()));
                assert!(streamed.iter().zip(&whole).all(|(a, b)| a.to_bits() == b.to_bits()));
            }
        }
    }

    #[test]
    fn samples_that_are_no_numbers_cost_the_frames_that_hold_them() {
        let mut x = gaussian_noise(1000, 6);
        (x[300], x[301]) = (f64::NAN, f64::INFINITY);
        let mut stream = StftStream::new(plan(100, 50), FS_HZ, Scale::Density);
        let mut seen = Vec::new();
        stream.push(&x, |m, row| {
            assert!(row.iter().all(|value| value.is_finite()));
            seen.push(m);
        });
        // Frames 5 (250…349) and 6 (300…399).
        assert_eq!(seen, (0..19).filter(|m| *m != 5 && *m != 6).collect::<Vec<_>>());
        assert_eq!((stream.n_rejected_frames(), stream.n_not_finite()), (2, 2));
        // After a gap a frame begins anew.
        stream.break_off();
        let mut first = Vec::new();
        stream.push(&x[..100], |m, row| first = [&[m as f64], row].concat());
        assert_eq!(first.len(), 52, "numbered on from 19");
        assert!((first[0] - 19.0).abs() < 1e-9);
    }

    #[test]
    fn short_constant_and_zero_records() {
        let mut plan = plan::<f32>(64, 32);
        assert_eq!((plan.n_frames(0), plan.n_frames(63), plan.n_frames(64)), (0, 0, 1));
        assert_eq!(plan.process(&[1.0; 63], FS_HZ, Scale::Density, &mut []), 0);
        for level in [0.0, 5.5, 1e30] {
            let mut row = vec![1.0; plan.n_bins()];
            plan.frame(&[level; 64], FS_HZ, Scale::Amplitude, &mut row);
            assert!(row.iter().all(|a| a.abs() <= 0.0), "a constant is exactly nothing");
        }
    }
}
