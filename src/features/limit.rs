//! Numbers that only a stated limit asks for: RMS in a band, lines at any order; and whether it asks for the vector of 1×.
//!
//! Nothing is measured that no limit of the machine names. Must not know thresholds.

use super::Feature;
use super::overall;
use super::plans::Plans;
use super::shaft;
use crate::dsp::integrate;
use crate::dsp::line;
use crate::dsp::real::floor_index;
use crate::dsp::stats::Moments;
use crate::machine::Machine;
use crate::machine::ShaftIndex;
use crate::machine::alarm_limit::Quantity;
use crate::machine::alarm_limit::Reference;
use crate::units::Hz;
use crate::units::Unit;
use rustfft::num_complex::Complex;
use std::sync::Arc;

/// Name of the feature "displacement RMS in the band of ISO 20816, 10–1000 Hz".
pub const DISPLACEMENT_RMS: &str = "displacement_rms_10_1000_hz";

/// Name of the feature "largest minus smallest sample".
pub const PEAK_TO_PEAK: &str = "peak_to_peak";

/// Mean of the squared Hann window.
const HANN_POWER: f64 = 0.375;

/// Name of the feature "RMS between `low` and `high`".
#[must_use]
pub fn band_name(low: Hz, high: Hz) -> String {
    format!("rms_{}_{}_hz", low.0, high.0)
}

/// Name of the feature "amplitude at `order` times the speed of `shaft`"; of whole orders that of
/// [`shaft::line_name`].
#[must_use]
pub fn order_name(order: f64, shaft: &str) -> String {
    format!("line_{order}x_{shaft}")
}

/// What limits on a sensor ask for.
fn wanted(machine: &Machine, sensor: usize) -> impl Iterator<Item = &Quantity> {
    let limits = machine.alarm_limits.limits.iter();
    limits.filter(move |limit| limit.sensors.contains(&sensor)).map(|limit| &limit.quantity)
}

/// Displacement that limits on `sensor` ask for: RMS of a housing by integration (D48), peak to peak of a shaft.
/// `moments`: of all samples of the window.
#[must_use]
pub fn displacements(
    machine: &Machine,
    sensor: usize,
    (samples, rate): (&[f32], Hz),
    moments: &Moments,
    (unit, plans): (Unit, &mut Plans),
) -> Vec<Feature> {
    let asks = |quantity: &Quantity| wanted(machine, sensor).any(|asked| asked == quantity);
    let mut found = Vec::new();
    let integrated = match unit {
        Unit::MetrePerSecondSquared => Some(integrate::Quantity::Acceleration),
        Unit::MillimetrePerSecond => Some(integrate::Quantity::Velocity),
        Unit::Micrometre | Unit::Volt | Unit::Hertz | Unit::One | Unit::Unknown => None,
    };
    if let Some(quantity) = integrated.filter(|_| asks(&Quantity::DisplacementRms)) {
        let plan = plans.velocity(samples.len());
        let band_hz = overall::VELOCITY_BAND_HZ;
        if let Some(read) = plan.process_displacement(samples, rate.0, quantity, band_hz) {
            let name = Arc::from(DISPLACEMENT_RMS);
            found.push(Feature { name, value: read.um, unit: Unit::Micrometre });
        }
    }
    if moments.n > 0 && asks(&Quantity::PeakToPeak) {
        found.push(Feature {
            name: Arc::from(PEAK_TO_PEAK),
            value: moments.max - moments.min,
            unit,
        });
    }
    found
}

/// RMS in every band that a limit on `sensor` names; `x_hat`: unnormalised one-sided DFT of `n`
/// samples, mean removed. Bands that the spectrum does not hold are left out.
#[must_use]
pub fn bands(
    machine: &Machine,
    sensor: usize,
    (x_hat, n, rate): (&[Complex<f32>], usize, Hz),
    unit: Unit,
) -> Vec<Feature> {
    let mut found: Vec<Feature> = Vec::new();
    for quantity in wanted(machine, sensor) {
        let Quantity::Band { low, high } = quantity else { continue };
        let name = band_name(*low, *high);
        if found.iter().any(|feature| *feature.name == *name) {
            continue;
        }
        if let Some(value) = band_rms((x_hat, n, rate), (*low, *high)) {
            found.push(Feature { name: Arc::from(name), value, unit });
        }
    }
    found
}

/// RMS of a signal between two frequencies, both included (F16): Hann-weighted, so that a line is
/// counted whole if its lobe lies inside. `None` where the spectrum holds no bin of the band.
#[must_use]
pub fn band_rms(
    (x_hat, n, rate): (&[Complex<f32>], usize, Hz),
    (low, high): (Hz, Hz),
) -> Option<f64> {
    let bin_hz = rate.0 / n as f64;
    // Bin 0 holds the mean, and the last one has no neighbour.
    let first = floor_index((low.0 / bin_hz).ceil()).max(1);
    let last = floor_index(high.0 / bin_hz).min(x_hat.len().checked_sub(2)?);
    // Half the band, or more, above Nyquist is not the band asked for.
    if first > last || high.0 > rate.0 / 2.0 {
        return None;
    }
    let power: f64 = (first..=last).map(|k| shaft::hann_magnitude(x_hat, k).powi(2)).sum();
    Some(hann_rms(power, n))
}

/// RMS of what holds the sum `power` of |X_k|² over bins of the Hann-weighted one-sided spectrum of n samples (F16).
pub(super) fn hann_rms(power: f64, n: usize) -> f64 {
    let n = n as f64;
    (2.0 * power / (n * n * HANN_POWER)).sqrt()
}

/// Amplitudes at the orders that limits on `sensor` name and that are not read anyway.
#[must_use]
pub fn orders(
    machine: &Machine,
    sensor: usize,
    (samples, rate): (&[f32], Hz),
    first: Hz,
    unit: Unit,
) -> Vec<Feature> {
    let mut found: Vec<Feature> = Vec::new();
    for quantity in wanted(machine, sensor) {
        let Quantity::Order { shaft, order } = quantity else { continue };
        let name = order_name(*order, &machine.shaft(*shaft).id);
        let is_known = shaft::ORDERS.iter().any(|known| (f64::from(*known) - order).abs() < 1e-12);
        if is_known || found.iter().any(|feature| *feature.name == *name) {
            continue;
        }
        let speed = machine.shaft_speed(*shaft, first);
        let read = speed.and_then(|speed| line::line_at(samples, rate.0, speed.0 * order));
        if let Some(read) = read {
            found.push(Feature { name: Arc::from(name), value: read.amplitude, unit });
        }
    }
    found
}

/// Whether a limit on `sensor` asks for the vector of 1×.
#[must_use]
pub fn asks_for_vector(machine: &Machine, sensor: usize) -> bool {
    let is_vector =
        |quantity: &Quantity| matches!(quantity, Quantity::Change(Reference::Vector { .. }));
    wanted(machine, sensor).any(is_vector)
}

/// The shaft whose line a limit takes out, for its name.
#[must_use]
pub fn once_name(machine: &Machine, shaft: ShaftIndex) -> String {
    shaft::line_name(1, &machine.shaft(shaft).id)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::fft::FftCache;
    use crate::dsp::fft::ForwardPlan;
    use crate::dsp::real::Real;
    use crate::features::ChannelWindow;
    use crate::features::Extractor;
    use crate::features::Window;
    use crate::features::speed::SpeedHints;
    use crate::features::vector;
    use crate::machine::file;
    use crate::signal::ChannelIndex;
    use crate::signal::ChannelInfo;
    use std::f64::consts::TAU;

    const RATE: Hz = Hz(2000.0);

    fn spectrum(x: &[f32]) -> Vec<Complex<f32>> {
        let mut plan = ForwardPlan::new(x.len(), &mut FftCache::new());
        let mut x_hat = vec![Complex::default(); plan.n_bins()];
        plan.process(x, &mut x_hat);
        x_hat
    }

    #[test]
    fn a_line_inside_counts_whole_and_one_outside_not_at_all() {
        // Amplitude 2 at 100.05 Hz (between two bins), amplitude 3 at 400 Hz, a constant of 5.
        let x: Vec<f32> = (0..20_000)
            .map(|i| {
                let t = f64::from(i) / RATE.0;
                let line = |f: f64| (TAU * f * t).cos();
                f32::rounded(5.0 + 2.0 * line(100.05) + 3.0 * line(400.0))
            })
            .collect();
        let x_hat = spectrum(&x);
        let rms = |low, high| band_rms((&x_hat, x.len(), RATE), (Hz(low), Hz(high)));
        // A Hann lobe falls as 1/d³: 50 Hz are 500 bins.
        assert!((rms(50.0, 200.0).unwrap() - 2.0_f64.sqrt()).abs() < 1e-5);
        assert!((rms(300.0, 500.0).unwrap() - 3.0 / 2.0_f64.sqrt()).abs() < 1e-5);
        assert!(rms(200.0, 300.0).unwrap() < 1e-4);
        let both = (2.0_f64 + 4.5).sqrt();
        assert!((rms(0.0, 1000.0).unwrap() - both).abs() < 1e-5);
        assert_eq!(rms(500.0, 1000.1), None, "beyond Nyquist");
        assert_eq!(rms(100.06, 100.09), None, "between two bins");
    }

    #[test]
    fn bands_of_noise_add_up_to_its_variance() {
        let mut state = 7_u64;
        let x: Vec<f32> = (0..20_000)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                f32::rounded((state >> 33) as f64 / (1_u64 << 31) as f64 - 0.5)
            })
            .collect();
        let x_hat = spectrum(&x);
        let power =
            |low, high| band_rms((&x_hat, x.len(), RATE), (Hz(low), Hz(high))).unwrap().powi(2);
        // Variance 1/12; the Hann-weighted estimate of 2500 and 10,000 cells scatters by 2 and 1 %.
        assert!((power(0.0, 1000.0) * 12.0 - 1.0).abs() < 0.05);
        assert!((power(250.0, 500.0) * 48.0 - 1.0).abs() < 0.1);
    }

    #[test]
    fn whole_orders_have_the_name_they_have_anyway() {
        assert_eq!(order_name(2.0, "main"), shaft::line_name(2, "main"));
        assert_eq!(order_name(0.5, "main"), "line_0.5x_main");
        assert_eq!(band_name(Hz(10.0), Hz(62.5)), "rms_10_62.5_hz");
    }

    #[test]
    fn a_window_yields_what_limits_ask_for_and_nothing_else() {
        let limit =
            |rest: &str| format!("[[limits.alarm]]\nunit = 'm/s^2'\nwarning_above = 1\n{rest}\n");
        let stated = [
            "id = 'a'\nkind = 'band'\nband_hz = [150, 250]",
            "id = 'b'\nkind = 'order'\norder = 0.5",
            "id = 'c'\nkind = 'vector_change'\nreference = 1\nreference_phase_deg = 0",
        ];
        let head = "[machine]\nid = 'm'\n[[shaft]]\nid = 'main'\nspeed_hz = 10\n\
                    [[sensor]]\nchannel = 'x'\nkind = 'accelerometer'\nunit = 'm/s^2'\n\
                    at = { shaft = 'main' }\n\
                    [[sensor]]\nchannel = 'mark'\nkind = 'tacho'\npulses_per_rev = 1\n\
                    at = { shaft = 'main' }\n";
        let features = |limits: String| -> Vec<(String, f64)> {
            let machine = file::parse(&format!("{head}{limits}"), "m.toml").unwrap();
            let channel = |name: &str, unit| ChannelInfo {
                name: name.to_owned(),
                sample_rate: RATE,
                unit,
                offset: 0.0,
                unit_conflict: None,
                full_scale: None,
            };
            let channels =
                vec![channel("x", Unit::MetrePerSecondSquared), channel("mark", Unit::Volt)];
            // 10 Hz, the mark at whole turns: 1× of 3 at 40°, ½× of 0.7, 2 at 200 Hz.
            let n = 20_000_u32;
            let line = |i: u32, f: f64, lag: f64| {
                (TAU * f * f64::from(i) / RATE.0 - lag.to_radians()).cos()
            };
            let x = |i| {
                3.0 * line(i, 10.0, 40.0) + 0.7 * line(i, 5.0, 10.0) + 2.0 * line(i, 200.0, 0.0)
            };
            let x: Vec<f32> = (0..n).map(|i| f32::rounded(x(i))).collect();
            let mark: Vec<f32> = (0..n).map(|i| if i % 200 < 20 { 5.0 } else { 0.0 }).collect();
            let run = |samples| Some(ChannelWindow { start: 0, time_s: 0.0, samples });
            let window =
                Window { time_s: (0.0, 10.0), channels: vec![run(&x[..]), run(&mark[..])] };
            let mut extractor = Extractor::new(Arc::new(machine), channels, SpeedHints::default());
            let found = extractor.extract(&window);
            let of_x = found.channel(ChannelIndex(0)).unwrap();
            of_x.values.iter().map(|f| (f.name.to_string(), f.value)).collect()
        };
        let without = features(String::new());
        let found = features(stated.iter().map(|rest| limit(rest)).collect());
        let new: Vec<_> = found.iter().filter(|f| !without.iter().any(|w| w.0 == f.0)).collect();
        assert_eq!(new.len(), 4, "{new:?}");
        let value = |name: &str| found.iter().find(|f| f.0 == name).unwrap().1;
        assert!((value("rms_150_250_hz") - 2.0_f64.sqrt()).abs() < 1e-4);
        assert!((value("line_0.5x_main") - 0.7).abs() < 1e-3);
        // The edge of a pulse is known to a sample: 1/200 of a turn, 1.8°.
        let (cos, sin) = (value(vector::COS), value(vector::SIN));
        assert!((cos.hypot(sin) - 3.0).abs() < 0.01, "{cos} {sin}");
        assert!((sin.atan2(cos).to_degrees() - 40.0).abs() < 2.0, "{cos} {sin}");
    }
}
