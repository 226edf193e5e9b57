//! Plans allocate, processing does not: counted by an instrumented allocator.
//!
//! Without the test harness, so that no other thread allocates while it counts: `main` is the test.

#![expect(clippy::unwrap_used, reason = "a test may panic; clippy exempts only #[test] functions")]

use std::alloc::System;
use std::hint::black_box;

use rotorwatch::dsp::absolute;
use rotorwatch::dsp::absolute::OversampledAbsolutePlan;
use rotorwatch::dsp::cwt;
use rotorwatch::dsp::cwt::MorletPlan;
use rotorwatch::dsp::cwt::Part;
use rotorwatch::dsp::cwt::ScalogramPlan;
use rotorwatch::dsp::cwt_bank;
use rotorwatch::dsp::cwt_bank::Accuracy;
use rotorwatch::dsp::cwt_bank::CwtPlan;
use rotorwatch::dsp::cwt_bank::Rate;
use rotorwatch::dsp::envelope::EnvelopeSpectrumPlan;
use rotorwatch::dsp::envelope::SquaredEnvelopePlan;
use rotorwatch::dsp::fft::FftCache;
use rotorwatch::dsp::fft::ForwardPlan;
use rotorwatch::dsp::gear::GearPlan;
use rotorwatch::dsp::integrate;
use rotorwatch::dsp::integrate::Quantity;
use rotorwatch::dsp::integrate::VelocityPlan;
use rotorwatch::dsp::line;
use rotorwatch::dsp::line::LinesPlan;
use rotorwatch::dsp::moments::MomentHistory;
use rotorwatch::dsp::order::PhaseTrack;
use rotorwatch::dsp::real::Real;
use rotorwatch::dsp::spectrum::AmplitudePlan;
use rotorwatch::dsp::spectrum::WelchPlan;
use rotorwatch::dsp::stats;
use rotorwatch::dsp::stats::Moments;
use rotorwatch::dsp::tacho::Edge;
use rotorwatch::dsp::tacho::Threshold;
use rotorwatch::dsp::tsa::TsaPlan;
use rotorwatch::dsp::whiten::WhitenPlan;
use rustfft::num_complex::Complex;
use stats_alloc::INSTRUMENTED_SYSTEM;
use stats_alloc::Region;
use stats_alloc::StatsAlloc;

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

const FS_HZ: f64 = 10_000.0;

/// Runs `work` and fails if it allocated, grew or freed anything.
fn assert_no_allocation(what: &str, n: usize, work: impl FnOnce()) {
    let region = Region::new(ALLOCATOR);
    work();
    let change = region.change();
    let n_calls = change.allocations + change.reallocations + change.deallocations;
    assert_eq!(n_calls, 0, "{what}, n = {n}: {change:?}");
}

fn zeros<T: Real>(n: usize) -> Vec<T> {
    vec![T::default(); n]
}

/// Kernels that read samples.
fn time_domain<T: Real>(n: usize) {
    let x: Vec<T> = (0..n).map(|i| T::rounded((i as f64 * 0.37).sin() + 2.0)).collect();
    let mut cache = FftCache::<T>::new();

    assert_no_allocation("moments", n, || {
        black_box(Moments::of(&x).kurtosis());
    });
    let mut history = MomentHistory::new(3);
    assert_no_allocation("history of moments", n, || {
        for block in x.chunks(n / 8) {
            history.push(block);
            black_box(history.moments().m8());
        }
    });
    let mut values = x.clone();
    assert_no_allocation("median and mad", n, || {
        black_box(stats::mad(&mut values));
    });
    let mut lines = [None; 6];
    assert_no_allocation("lines", n, || {
        line::lines_at(&x, FS_HZ, &[50.0, 68.0, 99.0, 280.0, 300.0, 555.0], &mut lines);
    });
    let mut planned = LinesPlan::new(n, FS_HZ, &[50.0, 68.0, 99.0, 280.0, 300.0, 555.0]);
    assert_no_allocation("planned lines", n, || planned.process(&x, &mut lines));
    let mut out = zeros::<T>(n);
    assert_no_allocation("absolute vibration", n, || {
        absolute::absolute_vibration(&x, &x, &mut out);
    });
    let mut doubled = OversampledAbsolutePlan::new(n, &mut cache);
    let mut out = zeros::<T>(doubled.out_len());
    assert_no_allocation("oversampled", n, || doubled.process(&x, &x, &mut out));

    let mut amplitude = AmplitudePlan::new_padded(n, 2 * n, &mut cache);
    let mut out = zeros::<T>(amplitude.n_bins());
    assert_no_allocation("amplitude", n, || {
        amplitude.process(&x, &mut out);
    });
    let mut welch = WelchPlan::new(n / 4, &mut cache);
    let mut out = zeros::<T>(welch.n_bins());
    assert_no_allocation("welch", n, || {
        welch.process(&x, FS_HZ, &mut out);
    });
    let mut velocity = VelocityPlan::new(n, &mut cache);
    assert_no_allocation("velocity", n, || {
        let band = integrate::GENERAL_BAND_HZ;
        assert!(velocity.process(&x, FS_HZ, Quantity::Acceleration, band).is_some());
    });
    let mut scratch = Vec::with_capacity(n);
    let mut times_s = Vec::with_capacity(n);
    assert_no_allocation("tacho", n, || {
        let threshold = Threshold::of(&x, &mut scratch).unwrap();
        threshold.edges(&x, FS_HZ, Edge::Rising, &mut times_s);
    });
}

/// Kernels that read the shared spectrum.
fn frequency_domain<T: Real>(n: usize) {
    let x: Vec<T> = (0..n).map(|i| T::rounded((i as f64 * 0.37).sin() + 2.0)).collect();
    let mut cache = FftCache::<T>::new();
    let mut forward = ForwardPlan::new(n, &mut cache);
    let mut x_hat = vec![Complex::new(T::default(), T::default()); forward.n_bins()];
    assert_no_allocation("forward", n, || {
        forward.process(&x, &mut x_hat);
    });
    let mut whiten = WhitenPlan::new(n, 32, 3.0);
    let mut white = x_hat.clone();
    assert_no_allocation("whiten", n, || {
        whiten.process(&x_hat, &mut white);
    });
    let mut envelope = SquaredEnvelopePlan::new(n, n / 8..n / 4, &mut cache);
    let mut e2 = zeros::<T>(envelope.out_len());
    assert_no_allocation("squared envelope", n, || envelope.process(&white, &mut e2));
    let mut spectrum = EnvelopeSpectrumPlan::new(e2.len(), &mut cache);
    let mut depth = zeros::<T>(spectrum.n_bins());
    assert_no_allocation("envelope spectrum", n, || {
        spectrum.process(&e2, &mut depth);
    });
    let mut morlet = MorletPlan::new(n, FS_HZ, 280.0, cwt::DEFAULT_OMEGA0, &mut cache).unwrap();
    assert_no_allocation("morlet", n, || {
        assert!(morlet.mean_magnitude(&x_hat).is_some());
    });
    let f_hz = [280.0, 560.0];
    let mut picture =
        ScalogramPlan::new(n, FS_HZ, &f_hz, cwt::DEFAULT_OMEGA0, 100, &mut cache).unwrap();
    let mut out = zeros::<T>(picture.out_len());
    assert_no_allocation("scalogram", n, || picture.process(&x_hat, Part::Modulus, &mut out));
    for rate in [Rate::Decimated, Rate::Full] {
        let settings = cwt_bank::Settings {
            fs_hz: FS_HZ,
            omega0: cwt::DEFAULT_OMEGA0,
            accuracy: Accuracy::Fine,
            rate,
        };
        let mut bank = CwtPlan::new((n, n), &f_hz, &settings, &mut cache).unwrap();
        let mut w = vec![Complex::new(T::default(), T::default()); bank.out_len()];
        let mut parts = zeros::<T>(bank.out_len());
        let mut rms = [0.0; 2];
        assert_no_allocation("bank of scales", n, || {
            bank.process(&x_hat, &mut w);
            bank.process_part(&x_hat, Part::Real, &mut parts);
            bank.rms(&x_hat, &mut rms);
        });
    }
}

/// Kernels of the revolution.
fn angle_domain(n: usize) {
    let x: Vec<f32> = (0..n).map(|i| f32::rounded((i as f64 * 0.37).sin())).collect();
    let track = PhaseTrack::constant(25.0).unwrap();
    let plan = TsaPlan::new(512, FS_HZ / 25.0);
    let mut y = vec![0.0; 512];
    assert_no_allocation("tsa", n, || {
        assert!(plan.process(&x, FS_HZ, &track, &mut y) > 0);
    });
    let mut gear = GearPlan::new(512, 28, 200, &mut FftCache::new()).unwrap();
    assert_no_allocation("gear", n, || {
        black_box(gear.process(&y));
        black_box(gear.localise());
    });
}

fn main() {
    let region = Region::new(ALLOCATOR);
    black_box(vec![0_u8; 16]);
    assert_eq!(region.change().allocations, 1, "the counter counts");
    // A power of two, a composite and a prime: the three kinds of FFT.
    for n in [4096, 6000, 6007] {
        time_domain::<f32>(n);
        time_domain::<f64>(n);
        frequency_domain::<f32>(n);
        frequency_domain::<f64>(n);
        angle_domain(n);
    }
}
