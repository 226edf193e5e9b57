//! What a sensor may receive besides its machine: mains hum in the cable, frequencies folded for want of a filter, drift
//! of its own. It may be no fault of the sensor, and nothing is left out for it; but who reads its spectrum should know.

use super::sensor::SensorReading;
use super::shaft;
use super::trace::Trace;
use crate::dsp::real::floor_index;
use crate::machine::Machine;
use crate::machine::motor::MAINS_HZ;
use crate::machine::sensor::SensorKind;
use crate::units::Hz;
use rustfft::num_complex::Complex;

/// Odd harmonics that all must stand out: hum is rich in them, and three by chance are rare.
const HUM: [f64; 3] = [1.0, 3.0, 5.0];

/// Power over the surroundings from which a harmonic of hum stands out, 20 dB.
const HUM_POWER: f64 = 100.0;

/// Half width of a hum line's surroundings.
const SURROUNDINGS: Hz = Hz(5.0);

/// A shaft harmonic this near to a mains harmonic, relative, may be the line.
const NEAR: f64 = 5e-3;

/// Highest shaft harmonic that is looked at beside hum.
const SHAFT_HARMONICS: f64 = 60.0;

/// An anti-alias filter lowers the last hundredth of the band by at least this power ratio (3 dB) below what stands
/// a little lower: at half the sampling rate even half-band filters have 6 dB.
const FALL: f64 = 0.5;

/// Nothing of a machine moves slower than this part of its slowest shaft but what is hunting or loose: cages, belts and
/// whirls in oil stand at a third to a half.
const BELOW_ALL: f64 = 0.25;

/// Octaves below that in which a drift must rise, and lines of the spectrum in the lowest at least: a mean over four is
/// known to a factor of 2 at 95 %.
const DRIFT_OCTAVES: i32 = 3;
const DRIFT_BINS: usize = 4;

/// Factor by which the density of a drift rises an octave: half of what a wandering zero has (1/f²).
const DRIFT_RISE: f64 = 2.0;

/// Part of the whole power that a drift must have to be told.
const DRIFT_PART: f64 = 0.5;

/// Adds sentences to the readings of the sensors that `traces` are of. `first`: speed of the first shaft, if known.
pub(super) fn doubt(
    machine: &Machine,
    first: Option<Hz>,
    traces: &[Trace<'_>],
    sensors: &mut [SensorReading],
) {
    for trace in traces {
        let Some(reading) = sensors.iter_mut().find(|r| r.sensor == trace.sensor) else { continue };
        let n = trace.samples.len();
        reading.doubts.extend(hum(machine, first, &trace.x_hat, n, trace.rate));
        if machine.sensors[trace.sensor].usable.is_none() {
            reading.doubts.extend(folding(&trace.x_hat, trace.rate));
        }
        if machine.sensors[trace.sensor].kind == SensorKind::Accelerometer {
            reading.doubts.extend(drift(machine, first, &trace.x_hat, n, trace.rate));
        }
    }
}

/// Mains hum: first, third and fifth harmonic of a supply that no motor of the machine has and no shaft explains.
fn hum(
    machine: &Machine,
    first: Option<Hz>,
    x_hat: &[Complex<f32>],
    n: usize,
    rate: Hz,
) -> Option<String> {
    let has_supply = |mains_hz: f64| {
        let mut supplies = machine.motors.iter().filter_map(|m| m.line_frequency);
        supplies.any(|supply| (supply.0 - mains_hz).abs() <= NEAR * mains_hz)
    };
    let turns_so = |line_hz: f64| {
        let Some(first) = first else { return false };
        let mut ratios = machine.shafts.iter().filter_map(|s| s.ratio_to_first);
        ratios.any(|ratio| {
            let order = line_hz / (first.0 * ratio);
            let multiple = order.round();
            (1.0..=SHAFT_HARMONICS).contains(&multiple) && (order - multiple).abs() <= NEAR * order
        })
    };
    let stands = |line_hz: f64| {
        let found = shaft::over_floor(x_hat, n, rate, Hz(line_hz), SURROUNDINGS);
        found.is_some_and(|(power, _)| power >= HUM_POWER)
    };
    let is_hum = |mains_hz: &&f64| {
        let mut lines = HUM.iter().map(|order| order * **mains_hz);
        !has_supply(**mains_hz) && lines.all(|line_hz| stands(line_hz) && !turns_so(line_hz))
    };
    let mains_hz = MAINS_HZ.iter().find(is_hum)?;
    Some(format!(
        "mains pick-up: {mains_hz:.0} Hz and its third and fifth harmonic stand out; look at cable and earth, or state \
         the motor's line_frequency_hz"
    ))
}

/// No filter before the sampling: the noise does not fall towards half the rate.
fn folding(x_hat: &[Complex<f32>], rate: Hz) -> Option<String> {
    let mean = |from: f64, to: f64| {
        let at = |part: f64| floor_index(part * (x_hat.len() - 1) as f64);
        let bins = x_hat.get(at(from)..at(to)).filter(|bins| !bins.is_empty())?;
        Some(bins.iter().map(|b| f64::from(b.norm_sqr())).sum::<f64>() / bins.len() as f64)
    };
    let (below, top) = (mean(0.8, 0.9)?, mean(0.99, 1.0)?);
    (below > 0.0 && top > FALL * below).then(|| {
        format!(
            "aliasing risk: the spectrum does not fall towards {:.0} Hz, so what lies above may be folded into it; state \
             usable_hz if a filter is known",
            0.5 * rate.0
        )
    })
}

/// A zero that wanders more than the machine shakes: far below its slowest shaft the spectrum rises towards 0 Hz and
/// holds most of the power.
fn drift(
    machine: &Machine,
    first: Option<Hz>,
    x_hat: &[Complex<f32>],
    n: usize,
    rate: Hz,
) -> Option<String> {
    let ratios = machine.shafts.iter().filter_map(|s| s.ratio_to_first);
    let slowest_hz = first?.0 * ratios.reduce(f64::min)?;
    let top_hz = BELOW_ALL * slowest_hz;
    let bins = |low_hz: f64, high_hz: f64| {
        let at = |hz: f64| floor_index(hz * n as f64 / rate.0) + 1;
        x_hat.get(at(low_hz)..at(high_hz)).unwrap_or_default()
    };
    let power = |bins: &[Complex<f32>]| bins.iter().map(|b| f64::from(b.norm_sqr())).sum::<f64>();
    let octaves = (0..DRIFT_OCTAVES).map(|octave| {
        let high_hz = top_hz / 2.0_f64.powi(octave);
        let bins = bins(0.5 * high_hz, high_hz);
        (bins.len() >= DRIFT_BINS).then(|| power(bins) / bins.len() as f64)
    });
    let densities: Vec<f64> = octaves.collect::<Option<_>>()?;
    let rises = densities.windows(2).all(|pair| pair[1] >= DRIFT_RISE * pair[0]);
    let part = power(bins(0.0, top_hz)) / power(bins(0.0, 0.5 * rate.0));
    (rises && part >= DRIFT_PART).then(|| {
        format!(
            "drift: {:.0} % of the power lies below {top_hz:.1} Hz and rises towards 0 Hz; look for a loose mounting or plug, \
             a blow beyond the range, or heat",
            100.0 * part
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::fft::FftCache;
    use crate::dsp::fft::ForwardPlan;
    use crate::dsp::real::Real;
    use crate::dsp::reference::gaussian_noise;
    use crate::machine::file;
    use std::f64::consts::TAU;

    const RATE: Hz = Hz(5000.0);

    fn spectrum(x: &[f64]) -> Vec<Complex<f32>> {
        let x: Vec<f32> = x.iter().map(|v| f32::rounded(*v)).collect();
        let mut plan = ForwardPlan::new(x.len(), &mut FftCache::new());
        let mut x_hat = vec![Complex::default(); plan.n_bins()];
        plan.process(&x, &mut x_hat);
        x_hat
    }

    fn machine(motor: &str) -> Machine {
        let text = format!("[machine]\nid='m'\n[[shaft]]\nid='s'\nspeed_hz=24.3\n{motor}");
        file::parse(&text, "m.toml").unwrap()
    }

    /// Ten seconds of unit noise and lines of these frequencies, Hz.
    fn record(lines: &[f64]) -> Vec<f64> {
        let mut x = gaussian_noise(50_000, 3);
        for (i, v) in x.iter_mut().enumerate() {
            *v += lines.iter().map(|f| 0.5 * (TAU * f * i as f64 / RATE.0).sin()).sum::<f64>();
        }
        x
    }

    #[test]
    fn hum_is_told_unless_a_motor_or_a_shaft_explains_it() {
        let told = |motor: &str, first: f64, lines: &[f64]| {
            let x = record(lines);
            hum(&machine(motor), Some(Hz(first)), &spectrum(&x), x.len(), RATE)
        };
        let hum = [60.0, 180.0, 300.0];
        assert!(told("", 24.3, &hum).unwrap().contains("60 Hz"));
        let motor = "[[motor]]\nshaft='s'\npoles=4\nline_frequency_hz=60.0\n";
        assert_eq!(told(motor, 24.3, &hum), None);
        assert_eq!(told("", 59.9, &hum), None, "the shaft's own harmonics");
        assert_eq!(told("", 24.3, &[60.0, 300.0]), None, "two lines are not enough");
        assert_eq!(told("", 24.3, &[]), None);
    }

    #[test]
    fn a_zero_that_wanders_more_than_the_machine_shakes_is_told() {
        let told = |x: &[f64]| drift(&machine(""), Some(Hz(24.3)), &spectrum(x), x.len(), RATE);
        let vibration = record(&[24.3, 48.6]);
        assert_eq!(told(&vibration), None);
        // A random walk has 1/f²; its steps are these parts of the noise.
        let walk = |part: f64| -> Vec<f64> {
            let mut at = 0.0;
            let wandering = |(v, step): (&f64, f64)| {
                at += step;
                v + part * at
            };
            vibration.iter().zip(gaussian_noise(vibration.len(), 17)).map(wandering).collect()
        };
        assert!(told(&walk(0.1)).unwrap().contains("below 6.1 Hz"));
        assert_eq!(told(&walk(0.001)), None, "there, but little");
    }

    #[test]
    fn a_spectrum_that_falls_is_filtered() {
        let white = gaussian_noise(50_000, 9);
        assert!(folding(&spectrum(&white), RATE).unwrap().contains("2500 Hz"));
        // x[i] + x[i−1] vanishes at half the rate.
        let smooth: Vec<f64> = white.windows(2).map(|w| w[0] + w[1]).collect();
        assert_eq!(folding(&spectrum(&smooth), RATE), None);
    }
}
