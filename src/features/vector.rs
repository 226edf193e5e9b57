//! The vector of 1×: what turns with the first shaft, by its size and where it points behind the tacho's mark.
//!
//! Its parts where a limit asks for them; of probes always where it points, for trends and baselines. Must not know what of it is too much.

use super::Feature;
use super::speed::Phase;
use crate::dsp::line;
use crate::units::Hz;
use crate::units::Unit;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Name of the cosine part A·cos φ of the vector of 1×.
pub const COS: &str = "vector_1x_cos";

/// Name of the sine part A·sin φ of the vector of 1×; φ is the lag behind the mark.
pub const SIN: &str = "vector_1x_sin";

/// Names of cos φ and sin φ of a probe's vector: where it points. Its size is that of the 1× line.
pub const DIRECTION: [&str; 2] = ["direction_1x_cos", "direction_1x_sin"];

/// Power of a 1× over the noise (F11) from which it points somewhere: noise turns it by 1/√(2·25) rad, 8°, in the mean square.
const POINTING: f64 = 25.0;

/// Whether a feature is a part of a direction: kept by baselines as it is, not as a logarithm.
#[must_use]
pub fn is_direction(name: &str) -> bool {
    DIRECTION.contains(&name)
}

/// Whether a feature is a part of the vector: either sign, so that it has no logarithm.
#[must_use]
pub fn is_part(name: &str) -> bool {
    name == COS || name == SIN
}

/// Reads it from all samples, if a mark on the first shaft gives its angle; `start_s`: stream time of the first of `samples`, as
/// sampled.
#[must_use]
pub fn read(
    (samples, rate): (&[f32], Hz),
    start_s: f64,
    phase: Option<&Phase>,
    unit: Unit,
) -> Vec<Feature> {
    let found = parts((samples, rate), start_s, phase);
    let feature = |(name, value): (&str, f64)| Feature { name: Arc::from(name), value, unit };
    found.map_or_else(Vec::new, |(cos, sin)| [(COS, cos), (SIN, sin)].map(feature).to_vec())
}

/// Where it points, of a probe whose shaft's 1× stands over the noise by the power `over_floor`; nothing if it is lost in it.
#[must_use]
pub fn direction(
    run: (&[f32], Hz),
    start_s: f64,
    phase: Option<&Phase>,
    over_floor: f64,
) -> Vec<Feature> {
    let found = if over_floor >= POINTING { parts(run, start_s, phase) } else { None };
    let Some((cos, sin)) = found.filter(|(cos, sin)| cos.hypot(*sin) > 0.0) else {
        return Vec::new();
    };
    let size = cos.hypot(sin);
    let feature = |(name, value): (&str, f64)| Feature {
        name: Arc::from(name),
        value: value / size,
        unit: Unit::One,
    };
    DIRECTION.into_iter().zip([cos, sin]).map(feature).collect()
}

fn parts((samples, rate): (&[f32], Hz), start_s: f64, phase: Option<&Phase>) -> Option<(f64, f64)> {
    let phase = phase.filter(|phase| phase.is_marked)?;
    let turns = |i: usize| phase.track.revolutions_at(start_s - phase.start_s + i as f64 / rate.0);
    once_a_revolution(samples, turns)
}

/// A·cos φ and A·sin φ of the part A·cos(θ − φ) that turns with the shaft (F17), θ = 2π·`turns`(i);
/// Hann-weighted over the samples whose angle is known. `None` below three revolutions.
pub(super) fn once_a_revolution(
    samples: &[f32],
    turns: impl Fn(usize) -> Option<f64>,
) -> Option<(f64, f64)> {
    let known: Vec<(f64, f64)> =
        samples.iter().enumerate().filter_map(|(i, x)| Some((f64::from(*x), turns(i)?))).collect();
    let n = known.len() as f64;
    let (from, to) = (known.first()?.1, known.last()?.1);
    if to - from < line::MIN_PERIODS {
        return None;
    }
    let mean = known.iter().map(|(x, _)| x).sum::<f64>() / n;
    let (mut cos, mut sin, mut weights) = (0.0, 0.0, 0.0);
    for (i, (x, turns)) in known.iter().enumerate() {
        let weight = 0.5 - 0.5 * (TAU * (i as f64 + 0.5) / n).cos();
        let (s, c) = (TAU * turns.fract()).sin_cos();
        cos += weight * (x - mean) * c;
        sin += weight * (x - mean) * s;
        weights += weight;
    }
    Some((2.0 * cos / weights, 2.0 * sin / weights))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::real::Real;
    use crate::dsp::reference::gaussian_noise;
    use crate::features::ChannelWindow;
    use crate::features::Extractor;
    use crate::features::Window;
    use crate::features::speed::SpeedHints;
    use crate::machine::file;
    use crate::signal::ChannelIndex;
    use crate::signal::ChannelInfo;

    #[test]
    fn the_vector_is_that_of_the_part_that_turns() {
        // 1× of 3 at 40° of lag, 2× of 5, a line beside, over 50.3 turns at a speed that rises.
        let n = 20_000;
        let turns = |i: usize| {
            let t = i as f64 / f64::from(n);
            50.0 * t + 0.3 * t * t
        };
        let x: Vec<f32> = (0..n)
            .map(|i| {
                let i = usize::try_from(i).unwrap();
                let angle = TAU * turns(i);
                let other = (TAU * 17.3 * i as f64 / f64::from(n)).cos();
                let lag = 40.0_f64.to_radians();
                f32::rounded(3.0 * (angle - lag).cos() + 5.0 * (2.0 * angle).cos() + other + 1.0)
            })
            .collect();
        let (cos, sin) = once_a_revolution(&x, |i| Some(turns(i))).unwrap();
        // Lines 30 and more cells away: Hann's 1/d³ leaves below 1e-4 of them.
        assert!((cos.hypot(sin) - 3.0).abs() < 1e-3, "{cos} {sin}");
        assert!((sin.atan2(cos).to_degrees() - 40.0).abs() < 0.02, "{cos} {sin}");
        assert_eq!(once_a_revolution(&x[..1000], |i| Some(turns(i))), None, "2.5 turns");
        assert_eq!(once_a_revolution(&x, |_| None), None);
    }

    #[test]
    fn a_probe_tells_where_its_1x_points_unless_it_is_lost_in_noise() {
        let machine = |probe_at: &str| {
            let text = format!(
                "[machine]\nid = 'm'\n[[shaft]]\nid = 'main'\nspeed_hz = 10\n\
                 [[shaft]]\nid = 'slow'\nratio_to = {{ shaft = 'main', ratio = 0.37 }}\n\
                 [[sensor]]\nchannel = 'gap'\nkind = 'proximitor'\nunit = 'um'\nat = {{ shaft = '{probe_at}' }}\n\
                 [[sensor]]\nchannel = 'mark'\nkind = 'tacho'\npulses_per_rev = 1\nat = {{ shaft = 'main' }}\n"
            );
            Arc::new(file::parse(&text, "m.toml").unwrap())
        };
        let rate = Hz(2000.0);
        let told = |probe_at: &str, size: f64| {
            let channel = |name: &str, unit| ChannelInfo {
                name: name.to_owned(),
                sample_rate: rate,
                unit,
                offset: 0.0,
                unit_conflict: None,
                full_scale: None,
            };
            let channels = vec![channel("gap", Unit::Micrometre), channel("mark", Unit::Volt)];
            let noise = gaussian_noise(20_000, 3);
            let line = |i: usize| (TAU * 10.0 * i as f64 / rate.0 - 40.0_f64.to_radians()).cos();
            let x: Vec<f32> =
                (0..).zip(noise).map(|(i, e)| f32::rounded(size * line(i) + e)).collect();
            let mark: Vec<f32> =
                (0..20_000).map(|i| if i % 200 < 20 { 5.0 } else { 0.0 }).collect();
            let run = |samples| Some(ChannelWindow { start: 0, time_s: 0.0, samples });
            let window =
                Window { time_s: (0.0, 10.0), channels: vec![run(&x[..]), run(&mark[..])] };
            let mut extractor = Extractor::new(machine(probe_at), channels, SpeedHints::default());
            let found = extractor.extract(&window);
            let of_probe = found.channel(ChannelIndex(0)).unwrap();
            assert_eq!((of_probe.get(COS), of_probe.get(SIN)), (None, None), "no limit asks");
            let [cos, sin] = DIRECTION.map(|name| of_probe.get(name));
            Some(sin?.atan2(cos?).to_degrees())
        };
        // The edge of a pulse is known to a sample: 1.8°.
        assert!((told("main", 5.0).unwrap() - 40.0).abs() < 2.0, "{:?}", told("main", 5.0));
        // Noise of unit RMS: a line of 0.005 has a thousandth of its power in a cell.
        assert_eq!(told("main", 0.005), None);
        assert_eq!(told("slow", 5.0), None, "the mark is of another shaft");
    }
}
