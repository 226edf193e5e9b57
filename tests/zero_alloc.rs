//! Plans allocate, processing does not: counted by an instrumented allocator.
//!
//! Without the test harness, so that no other thread allocates while it counts: `main` is the test.

#![expect(clippy::unwrap_used, reason = "a test may panic; clippy exempts only #[test] functions")]

use std::alloc::System;
use std::hint::black_box;

use rotorwatch::dsp::absolute;
use rotorwatch::dsp::absolute::OversampledAbsolutePlan;
use rotorwatch::dsp::band_envelope::BandEnvelopePlan;
use rotorwatch::dsp::bilinear::JointPlan;
use rotorwatch::dsp::bilinear::JointSpec;
use rotorwatch::dsp::bilinear::kernel::Kernel;
use rotorwatch::dsp::butterworth;
use rotorwatch::dsp::butterworth::Pass;
use rotorwatch::dsp::cepstrum;
use rotorwatch::dsp::cepstrum::CepstrumPlan;
use rotorwatch::dsp::cepstrum::Kind;
use rotorwatch::dsp::cepstrum::Lifter;
use rotorwatch::dsp::cepstrum::LifterPlan;
use rotorwatch::dsp::comb;
use rotorwatch::dsp::comb::CombSpeedPlan;
use rotorwatch::dsp::comb::SpeedSearch;
use rotorwatch::dsp::complex_cepstrum::ComplexCepstrumPlan;
use rotorwatch::dsp::cross::CrossPlan;
use rotorwatch::dsp::cwt;
use rotorwatch::dsp::cwt::MorletPlan;
use rotorwatch::dsp::cwt::Part;
use rotorwatch::dsp::cwt::ScalogramPlan;
use rotorwatch::dsp::cwt_bank;
use rotorwatch::dsp::cwt_bank::Accuracy;
use rotorwatch::dsp::cwt_bank::CwtPlan;
use rotorwatch::dsp::cwt_bank::Rate;
use rotorwatch::dsp::demodulate::MeshDemodPlan;
use rotorwatch::dsp::drs::DrsPlan;
use rotorwatch::dsp::envelope::EnvelopeSpectrumPlan;
use rotorwatch::dsp::envelope::SquaredEnvelopePlan;
use rotorwatch::dsp::fft::FftCache;
use rotorwatch::dsp::fft::ForwardPlan;
use rotorwatch::dsp::fir;
use rotorwatch::dsp::fir::Decimator;
use rotorwatch::dsp::fir::FirFilter;
use rotorwatch::dsp::fir::FirSpec;
use rotorwatch::dsp::full_spectrum::FullSpectrumPlan;
use rotorwatch::dsp::gear::GearPlan;
use rotorwatch::dsp::history::GearHistory;
use rotorwatch::dsp::history::HistoryPlan;
use rotorwatch::dsp::integrate;
use rotorwatch::dsp::integrate::Quantity;
use rotorwatch::dsp::integrate::VelocityPlan;
use rotorwatch::dsp::kurtogram::InfogramPlan;
use rotorwatch::dsp::kurtogram::KurtogramPlan;
use rotorwatch::dsp::line;
use rotorwatch::dsp::line::LinesPlan;
use rotorwatch::dsp::moments::MomentHistory;
use rotorwatch::dsp::order::PhaseTrack;
use rotorwatch::dsp::order_spectrum::OrderSpectrumPlan;
use rotorwatch::dsp::order_track::OrderTrackPlan;
use rotorwatch::dsp::pulses::PulseTrainPlan;
use rotorwatch::dsp::pulses::Wheel;
use rotorwatch::dsp::real::Real;
use rotorwatch::dsp::sample_check::SampleCheck;
use rotorwatch::dsp::sos::SosFilter;
use rotorwatch::dsp::sos::ZeroPhasePlan;
use rotorwatch::dsp::spectrum::AmplitudePlan;
use rotorwatch::dsp::speed_track::SpeedTrackPlan;
use rotorwatch::dsp::speed_track::SpeedTrackSpec;
use rotorwatch::dsp::stats;
use rotorwatch::dsp::stats::Moments;
use rotorwatch::dsp::stft::FrameSpec;
use rotorwatch::dsp::stft::Scale;
use rotorwatch::dsp::stft::StftPlan;
use rotorwatch::dsp::stft::StftStream;
use rotorwatch::dsp::synthesis::SynthesisPlan;
use rotorwatch::dsp::tacho::Edge;
use rotorwatch::dsp::tacho::Threshold;
use rotorwatch::dsp::tsa::TsaPlan;
use rotorwatch::dsp::wavelet::dwt::DwtPlan;
use rotorwatch::dsp::wavelet::picture::WaveletScalogramPlan;
use rotorwatch::dsp::wavelet::shape::Shape as WaveletShape;
use rotorwatch::dsp::wavelet::shape::Wavelet;
use rotorwatch::dsp::wavelet::taps::FilterBank;
use rotorwatch::dsp::welch::WelchPlan;
use rotorwatch::dsp::whiten::WhitenPlan;
use rotorwatch::dsp::window::Shape;
use rotorwatch::dsp::zoom::ZoomGrid;
use rotorwatch::dsp::zoom::ZoomPlan;
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
        let displacement = velocity.process_displacement(&x, FS_HZ, Quantity::Acceleration, band);
        assert!(displacement.is_some());
    });
    let mut scratch = Vec::with_capacity(n);
    let mut times_s = Vec::with_capacity(n);
    assert_no_allocation("tacho", n, || {
        let threshold = Threshold::of(&x, &mut scratch).unwrap();
        threshold.edges(&x, FS_HZ, Edge::Rising, &mut times_s);
    });
}

/// Spectra of samples beyond the amplitude.
fn spectra<T: Real>(n: usize) {
    let x: Vec<T> = (0..n).map(|i| T::rounded((i as f64 * 0.37).sin() + 2.0)).collect();
    let zero = Complex::new(T::default(), T::default());
    let mut cache = FftCache::<T>::new();
    let mut cross = CrossPlan::new(Shape::FlatTop, n / 4, n / 16, &mut cache);
    let mut density = vec![zero; cross.n_bins()];
    let mut coherence = vec![None; cross.n_bins()];
    assert_no_allocation("cross", n, || {
        cross.process(&x, &x, FS_HZ, &mut density, &mut coherence);
    });
    let grid = ZoomGrid { low_hz: 270.0, step_hz: 0.1, n_lines: 200 };
    let mut zoom =
        ZoomPlan::new(n, Shape::BlackmanHarris, FS_HZ, grid, &mut FftCache::new()).unwrap();
    let mut lines = vec![zero; zoom.n_lines()];
    assert_no_allocation("zoom", n, || {
        zoom.process(&x, &mut lines);
    });
    let mut full = FullSpectrumPlan::new(n, Shape::Kaiser { beta: 9.0 }, &mut cache);
    let (mut up, mut down) = (zeros::<T>(full.n_bins()), zeros::<T>(full.n_bins()));
    assert_no_allocation("full spectrum", n, || full.process(&x, &x, &mut up, &mut down));
    let mut drs = DrsPlan::new(n, 256, 300, &mut cache).unwrap();
    let (mut discrete, mut random) = (zeros::<T>(n), zeros::<T>(n));
    assert_no_allocation("drs", n, || drs.process(&x, &mut discrete, &mut random));
}

/// Filters in the time domain.
fn filters<T: Real>(n: usize) {
    let x: Vec<T> = (0..n).map(|i| T::rounded((i as f64 * 0.37).sin() + 2.0)).collect();
    let mut out = zeros::<T>(n);
    let pass = Pass::Band { low_hz: 100.0, high_hz: 1000.0 };
    let sections = butterworth::design(pass, 4, FS_HZ).unwrap();
    let mut filter = SosFilter::new(sections.clone());
    assert_no_allocation("sections", n, || {
        filter.settle(2.0);
        filter.process(&x, &mut out);
    });
    let mut both_ways = ZeroPhasePlan::new(n, sections);
    assert_no_allocation("zero phase", n, || both_ways.process(&x, &mut out));
    let spec = FirSpec { low_hz: 100.0, high_hz: 1000.0, transition_hz: 50.0, stop_db: 80.0 };
    let mut filter = FirFilter::new(&fir::design(&spec, FS_HZ).unwrap());
    assert_no_allocation("fir", n, || filter.process(&x, &mut out));
    let mut decimator = Decimator::new(5);
    assert_no_allocation("decimator", n, || {
        let n_out = decimator.out_len(n);
        decimator.process(&x, &mut out[..n_out]);
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
    let mut back = SynthesisPlan::new(n);
    let mut samples = zeros::<T>(n);
    assert_no_allocation("synthesis", n, || back.process(&x_hat, &mut samples));
    let mut power = CepstrumPlan::new(n, &mut cache);
    let mut values = zeros::<T>(power.n_values());
    assert_no_allocation("cepstrum", n, || {
        assert!(power.process(&x_hat, Kind::Power, &mut values).is_some());
    });
    let comb = Lifter::WithoutComb { period_s: 0.01, half_width_s: 0.0005 };
    let mut lifter = LifterPlan::new(n, FS_HZ, comb, &mut cache).unwrap();
    let mut edited = x_hat.clone();
    assert_no_allocation("lifter", n, || {
        lifter.process(&x_hat, &mut edited);
        cepstrum::prewhiten(&x_hat, &mut edited);
    });
    let mut kurtogram = KurtogramPlan::new(n, 5, 0..x_hat.len(), &mut cache);
    let mut kurtosis = vec![None; kurtogram.bands().len()];
    assert_no_allocation("kurtogram", n, || kurtogram.process(&x_hat, &mut kurtosis));
    let mut infogram = InfogramPlan::new(n, 5, 0..x_hat.len(), &mut cache);
    let mut information = vec![None; infogram.bands().len()];
    assert_no_allocation("infogram", n, || infogram.process(&x_hat, &mut information));
    envelopes(&x, &x_hat, &mut cache);
    wavelets(n, &x_hat, &mut cache);
}

/// Kernels of the envelope, from a signal's spectrum.
fn envelopes<T: Real>(x: &[T], x_hat: &[Complex<T>], cache: &mut FftCache<T>) {
    let n = x.len();
    let mut whiten = WhitenPlan::new(n, 32, 3.0);
    let mut white = x_hat.to_vec();
    assert_no_allocation("whiten", n, || {
        whiten.process(x_hat, &mut white);
    });
    let mut envelope = SquaredEnvelopePlan::new(n, n / 8..n / 4, cache);
    let mut e2 = zeros::<T>(envelope.out_len());
    assert_no_allocation("squared envelope", n, || envelope.process(&white, &mut e2));
    let mut spectrum = EnvelopeSpectrumPlan::new(e2.len(), cache);
    let mut depth = zeros::<T>(spectrum.n_bins());
    assert_no_allocation("envelope spectrum", n, || {
        spectrum.process(&e2, &mut depth);
    });
    let mut band = BandEnvelopePlan::new(n, n / 8..n / 4, cache);
    let mut depth = zeros::<T>(band.n_bins());
    assert_no_allocation("envelope spectrum of a band", n, || {
        band.process(x, &mut depth);
    });
}

/// Kernels of scale, from the spectrum of `n` samples.
fn wavelets<T: Real>(n: usize, x_hat: &[Complex<T>], cache: &mut FftCache<T>) {
    let mut morlet = MorletPlan::new(n, FS_HZ, 280.0, cwt::DEFAULT_OMEGA0, cache).unwrap();
    assert_no_allocation("morlet", n, || {
        assert!(morlet.mean_magnitude(x_hat).is_some());
    });
    let f_hz = [280.0, 560.0];
    let mut picture = ScalogramPlan::new(n, FS_HZ, &f_hz, cwt::DEFAULT_OMEGA0, 100, cache).unwrap();
    let mut out = zeros::<T>(picture.out_len());
    assert_no_allocation("scalogram", n, || picture.process(x_hat, Part::Modulus, &mut out));
    for rate in [Rate::Decimated, Rate::Full] {
        let settings = cwt_bank::Settings {
            fs_hz: FS_HZ,
            omega0: cwt::DEFAULT_OMEGA0,
            accuracy: Accuracy::Fine,
            rate,
        };
        let mut bank = CwtPlan::new((n, n), &f_hz, &settings, cache).unwrap();
        let mut w = vec![Complex::new(T::default(), T::default()); bank.out_len()];
        let mut parts = zeros::<T>(bank.out_len());
        let mut rms = [0.0; 2];
        assert_no_allocation("bank of scales", n, || {
            bank.process(x_hat, &mut w);
            bank.process_part(x_hat, Part::Real, &mut parts);
            bank.rms(x_hat, &mut rms);
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

/// Kernels that follow the shaft.
fn synchronous<T: Real>(n: usize) {
    let x: Vec<T> = (0..n).map(|i| T::rounded((i as f64 * 0.37).sin() + 2.0)).collect();
    let mut cache = FftCache::<T>::new();
    assert_no_allocation("sample check", n, || {
        black_box(SampleCheck::of(&x, None));
    });
    let spec = FrameSpec { shape: Shape::Hann, n_frame: n / 8, hop: n / 16 };
    let mut stft = StftPlan::new(spec, &mut cache);
    let mut out = zeros::<T>(stft.n_frames(n) * stft.n_bins());
    assert_no_allocation("stft", n, || {
        assert!(stft.process(&x, FS_HZ, Scale::Density, &mut out) > 0);
    });
    let mut stream = StftStream::new(stft, FS_HZ, Scale::Amplitude);
    assert_no_allocation("stft stream", n, || {
        for block in x.chunks(100) {
            stream.push(block, |m, row| {
                black_box((m, row[0]));
            });
        }
    });
    let track = PhaseTrack::from_knots(&[0.0, 0.3, 1.0], &[0.0, 7.0, 25.0]).unwrap();
    let mut tracked = OrderTrackPlan::new(64, FS_HZ, 20.0).unwrap();
    let mut y = zeros::<T>(64 * 8);
    assert_no_allocation("order track", n, || {
        assert!(tracked.process(&x, FS_HZ, &track, &mut y).is_some());
    });
    let mut spectrum = OrderSpectrumPlan::new(64, 8, Shape::FlatTop, &mut cache);
    let mut out = zeros::<T>(spectrum.n_bins());
    assert_no_allocation("order spectrum", n, || spectrum.process(&y, &mut out));
    let search = SpeedSearch { low_hz: 300.0, high_hz: 700.0, orders: comb::shaft_orders(4) };
    let mut speed = CombSpeedPlan::new(search.clone(), n, FS_HZ, &mut cache).unwrap();
    assert_no_allocation("comb speed", n, || {
        assert!(speed.process(&x).is_some());
    });
    let spec = SpeedTrackSpec { search, fs_hz: FS_HZ, n_frame: 400, max_rate_hz_s: 100.0 };
    let mut speed = SpeedTrackPlan::new(spec, n, &mut cache).unwrap();
    assert_no_allocation("speed track", n, || {
        assert!(speed.process(&x).is_some());
    });
}

/// Pictures over time and frequency, and what goes with them.
fn joint<T: Real>(n: usize) {
    let x: Vec<T> = (0..n).map(|i| T::rounded((i as f64 * 0.37).sin() + 2.0)).collect();
    let mut cache = FftCache::<T>::new();
    let mut forward = ForwardPlan::new(n, &mut cache);
    let mut x_hat = vec![Complex::default(); forward.n_bins()];
    forward.process(&x, &mut x_hat);
    let shape = WaveletShape::new(Wavelet::Haar).unwrap();
    let mut picture =
        WaveletScalogramPlan::new(shape, (n, FS_HZ), &[50.0, 90.0], 100, &mut cache).unwrap();
    let mut out = zeros::<T>(picture.out_len());
    assert_no_allocation("wavelet picture", n, || {
        picture.process(&x_hat, Part::Modulus, &mut out);
    });
    for kernel in [Kernel::Delta, Kernel::Hann(9), Kernel::ChoiWilliams(1.0)] {
        let spec =
            JointSpec { kernel, n_lags: 6, is_lag_windowed: true, n_frequencies: 16, n_times: 5 };
        let mut plan = JointPlan::new(n, FS_HZ, spec, &mut cache).unwrap();
        let mut out = zeros::<T>(plan.out_len());
        assert_no_allocation("bilinear", n, || plan.process(&x_hat, &mut out));
    }
    let bank = FilterBank::daubechies(4).unwrap();
    let mut dwt = DwtPlan::new(&bank, 4096, 5).unwrap();
    let (mut c, mut back) = (zeros::<T>(4096), zeros::<T>(4096));
    assert_no_allocation("dwt", n, || {
        dwt.analyse(&x[..4096.min(n)], &mut c);
        dwt.synthesise(&c, &mut back);
    });
    let mut plan = ComplexCepstrumPlan::new(n, 2 * n).unwrap();
    let (mut c, mut back) = (zeros::<T>(2 * n), zeros::<T>(2 * n));
    assert_no_allocation("complex cepstrum", n, || {
        let removed = plan.process(&x, &mut c).unwrap();
        plan.invert(&c, &removed, &mut back);
        plan.minimum_phase(&x, &mut back).unwrap();
    });
}

/// Kernels of pulses and of averages against their history.
fn pulses_and_histories(n: usize) {
    let mut pulses_s: Vec<f64> = (0..n).map(|i| i as f64 * 0.01).collect();
    pulses_s.remove(77);
    pulses_s.insert(40, 0.4 + 1e-4);
    let wheel = Wheel { smoothing_pulses: 3, ..Wheel::even(4, 1.0) };
    let mut train = PulseTrainPlan::new(wheel, n).unwrap();
    assert_no_allocation("pulse train", n, || {
        assert_eq!(train.process(&pulses_s).len(), 1);
    });
    let mut cache = FftCache::new();
    let y: Vec<f64> = (0..n).map(|i| (i as f64 * 0.37).sin() + (i as f64 * 1.1).cos()).collect();
    let mut demodulation = MeshDemodPlan::new(n, 28, 1, &mut cache).unwrap();
    assert_no_allocation("mesh demodulation", n, || {
        assert!(demodulation.process(&y));
    });
    let mut history = GearHistory::new(n, 28, 1);
    let mut plan = HistoryPlan::new(&history, 400, &mut cache).unwrap();
    assert_no_allocation("history", n, || {
        assert!(plan.process(&y, &mut history).is_some());
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
        spectra::<f32>(n);
        spectra::<f64>(n);
        filters::<f32>(n);
        filters::<f64>(n);
        frequency_domain::<f32>(n);
        frequency_domain::<f64>(n);
        angle_domain(n);
        synchronous::<f32>(n);
        synchronous::<f64>(n);
        joint::<f32>(n);
        joint::<f64>(n);
        pulses_and_histories(n);
    }
}
