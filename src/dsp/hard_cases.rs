//! Every kernel on records that break kernels: finite in, finite out.
//!
//! What each makes of them is tested beside it; here only that none is left out. Must not be used
//! outside tests.

use rustfft::num_complex::Complex;
use rustfft::num_traits::Zero;

use crate::dsp::butterworth;
use crate::dsp::butterworth::Pass;
use crate::dsp::cepstrum;
use crate::dsp::cepstrum::CepstrumPlan;
use crate::dsp::cepstrum::Kind;
use crate::dsp::cepstrum::Lifter;
use crate::dsp::cepstrum::LifterPlan;
use crate::dsp::cross::CrossPlan;
use crate::dsp::drs::DrsPlan;
use crate::dsp::fft::FftCache;
use crate::dsp::fft::ForwardPlan;
use crate::dsp::fir;
use crate::dsp::fir::Decimator;
use crate::dsp::fir::FirFilter;
use crate::dsp::fir::FirSpec;
use crate::dsp::full_spectrum::FullSpectrumPlan;
use crate::dsp::integrate;
use crate::dsp::integrate::Quantity;
use crate::dsp::integrate::VelocityPlan;
use crate::dsp::kurtogram::InfogramPlan;
use crate::dsp::kurtogram::KurtogramPlan;
use crate::dsp::real::Real;
use crate::dsp::reference::gaussian_noise;
use crate::dsp::reference::narrow;
use crate::dsp::reference::sine;
use crate::dsp::sos::SosFilter;
use crate::dsp::sos::ZeroPhasePlan;
use crate::dsp::synthesis::SynthesisPlan;
use crate::dsp::welch::WelchPlan;
use crate::dsp::window::Shape;
use crate::dsp::zoom::ZoomGrid;
use crate::dsp::zoom::ZoomPlan;

const FS_HZ: f64 = 1000.0;

/// Records of n samples, by name.
fn records(n: usize) -> Vec<(&'static str, Vec<f64>)> {
    let mut impulse = vec![0.0; n];
    impulse[n / 3] = 1.0;
    let alternating = |i: usize| if i.is_multiple_of(2) { 1.0 } else { -1.0 };
    let noise = gaussian_noise(n, 1);
    vec![
        ("zeros", vec![0.0; n]),
        ("a constant", vec![-273.15; n]),
        ("one sample", impulse),
        ("Nyquist", (0..n).map(alternating).collect()),
        ("half a period", sine(n, n as f64, 0.5, 1.0, 0.3)),
        ("an offset of 1e6", noise.iter().map(|v| v + 1e6).collect()),
        ("counts", noise.iter().map(|v| (v * 2e6).round()).collect()),
        (
            "a clipped sine",
            sine(n, FS_HZ, 37.0, 1e3, 0.0).iter().map(|v| v.clamp(-1.0, 1.0)).collect(),
        ),
        // Denormal in f32, then so small that a square is nothing in f64, then so large as to be none.
        ("1e-42", noise.iter().map(|v| v * 1e-42).collect()),
        ("1e-30", noise.iter().map(|v| v * 1e-30).collect()),
        ("1e15", noise.iter().map(|v| v * 1e15).collect()),
    ]
}

fn all_finite<T: Real>(values: &[T]) -> bool {
    values.iter().all(|value| value.to_f64().is_finite())
}

fn all_finite_complex<T: Real>(values: &[Complex<T>]) -> bool {
    values.iter().all(|value| value.re.to_f64().is_finite() && value.im.to_f64().is_finite())
}

fn spectra<T: Real>(x: &[T]) -> [bool; 6] {
    let n = x.len();
    let mut cache = FftCache::<T>::new();
    let mut welch = WelchPlan::new(n / 3, &mut cache);
    let mut density = vec![T::zero(); welch.n_bins()];
    welch.process(x, FS_HZ, &mut density);
    let mut cross = CrossPlan::new(Shape::FlatTop, n / 4, 7, &mut cache);
    let (mut product, mut coherence) =
        (vec![Complex::zero(); cross.n_bins()], vec![None; cross.n_bins()]);
    cross.process(x, x, FS_HZ, &mut product, &mut coherence);
    let coherence: Vec<T> = coherence.into_iter().flatten().collect();
    let grid = ZoomGrid { low_hz: 0.0, step_hz: 0.5 * FS_HZ / 300.0, n_lines: 301 };
    let shape = Shape::Kaiser { beta: 12.0 };
    let mut zoom = ZoomPlan::new(n, shape, FS_HZ, grid, &mut FftCache::new()).unwrap();
    let mut lines = vec![Complex::<T>::zero(); grid.n_lines];
    zoom.process(x, &mut lines);
    let mut full = FullSpectrumPlan::new(n, Shape::BlackmanHarris, &mut cache);
    let (mut up, mut down) = (vec![T::zero(); full.n_bins()], vec![T::zero(); full.n_bins()]);
    full.process(x, x, &mut up, &mut down);
    let mut velocity = VelocityPlan::new(n, &mut cache);
    let band = integrate::GENERAL_BAND_HZ;
    let displacement = velocity.process_displacement(x, FS_HZ, Quantity::Acceleration, band);
    [
        all_finite(&density),
        all_finite_complex(&product) && all_finite(&coherence),
        all_finite_complex(&lines),
        all_finite(&up) && all_finite(&down),
        displacement.is_some_and(|rms| rms.um.is_finite()),
        velocity
            .process(x, FS_HZ, Quantity::Velocity, band)
            .is_some_and(|v| v.mm_per_s.is_finite()),
    ]
}

fn of_the_spectrum<T: Real>(x: &[T]) -> [bool; 5] {
    let n = x.len();
    let mut cache = FftCache::<T>::new();
    let mut forward = ForwardPlan::new(n, &mut cache);
    let mut x_hat = vec![Complex::zero(); forward.n_bins()];
    forward.process(x, &mut x_hat);
    let mut power = CepstrumPlan::new(n, &mut cache);
    let mut values = vec![T::zero(); power.n_values()];
    power.process(&x_hat, Kind::Squared, &mut values);
    let comb = Lifter::WithoutComb { period_s: 0.02, half_width_s: 0.001 };
    let mut lifter = LifterPlan::new(n, FS_HZ, comb, &mut cache).unwrap();
    let mut edited = x_hat.clone();
    lifter.process(&x_hat, &mut edited);
    let mut white = x_hat.clone();
    cepstrum::prewhiten(&x_hat, &mut white);
    let mut samples = vec![T::zero(); n];
    SynthesisPlan::new(n).process(&white, &mut samples);
    let mut kurtogram = KurtogramPlan::new(n, 4, 0..x_hat.len(), &mut cache);
    let mut kurtosis = vec![None; kurtogram.bands().len()];
    kurtogram.process(&x_hat, &mut kurtosis);
    let mut infogram = InfogramPlan::new(n, 4, 0..x_hat.len(), &mut cache);
    let mut information = vec![None; infogram.bands().len()];
    infogram.process(&x_hat, &mut information);
    [
        all_finite(&values),
        all_finite_complex(&edited),
        all_finite(&samples),
        kurtosis.iter().flatten().all(|k| k.is_finite()),
        information.iter().flatten().all(|v| v.time.is_finite() && v.cyclic.is_finite()),
    ]
}

fn filters<T: Real>(x: &[T]) -> [bool; 5] {
    let n = x.len();
    let mut out = vec![T::zero(); n];
    let pass = Pass::Band { low_hz: 1.0, high_hz: 200.0 };
    let sections = butterworth::design(pass, 4, FS_HZ).unwrap();
    SosFilter::new(sections.clone()).process(x, &mut out);
    let recursive = all_finite(&out);
    ZeroPhasePlan::new(n, sections).process(x, &mut out);
    let both_ways = all_finite(&out);
    let spec = FirSpec { low_hz: 20.0, high_hz: 200.0, transition_hz: 10.0, stop_db: 60.0 };
    FirFilter::new(&fir::design(&spec, FS_HZ).unwrap()).process(x, &mut out);
    let finite = all_finite(&out);
    let mut decimator = Decimator::new(3);
    let n_out = decimator.out_len(n);
    decimator.process(x, &mut out[..n_out]);
    let decimated = all_finite(&out);
    let mut drs = DrsPlan::new(n, 64, 40, &mut FftCache::new()).unwrap();
    let mut random = vec![T::zero(); n];
    drs.process(x, &mut out, &mut random);
    [recursive, both_ways, finite, decimated, all_finite(&out) && all_finite(&random)]
}

#[test]
fn finite_in_finite_out() {
    // A prime, a power of two, and 2·prime.
    for n in [1009, 1024, 1018] {
        for (name, x) in records(n) {
            let (wide, single) = (narrow::<f64>(&x), narrow::<f32>(&x));
            assert!(spectra(&wide).iter().all(|ok| *ok), "{name}, {n}: {:?}", spectra(&wide));
            assert!(spectra(&single).iter().all(|ok| *ok), "{name}, {n}: {:?}", spectra(&single));
            let (a, b) = (of_the_spectrum(&wide), of_the_spectrum(&single));
            assert!(a.iter().chain(&b).all(|ok| *ok), "{name}, {n}: {a:?} {b:?}");
            let (a, b) = (filters(&wide), filters(&single));
            assert!(a.iter().chain(&b).all(|ok| *ok), "{name}, {n}: {a:?} {b:?}");
        }
    }
}
