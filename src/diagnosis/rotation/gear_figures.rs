//! Figures of merit shown beside a verdict on a gear, with what Gaussian noise has. They decide nothing.

use super::gear_place;
use crate::diagnosis::Context;
use crate::diagnosis::verdict::Evidence;
use crate::features::WindowFeatures;
use crate::features::gear;
use crate::features::gear::GearReading;
use crate::features::gear::Part;
use crate::units::Unit;

/// FM0, FM4, M6A, M8A, energy ratio, side-band level factor and NA4* of the whole average behind a reading; NB4* and the swing of the phase
/// around the mesh harmonic that was the strongest when healthy.
pub(super) fn figures(
    found: &GearReading,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> Vec<Evidence> {
    let of = |part| gear_place::beside(found, found.shaft, part, features, context);
    let Some(whole) = of(Part::Whole) else { return Vec::new() };
    let around = of(Part::Around(strongest_harmonic(whole, context)));
    let all = [
        ("fm0", whole.figures.fm0, Unit::One),
        ("fm4", whole.figures.fm4, Unit::One),
        ("m6a", whole.figures.m6a, Unit::One),
        ("m8a", whole.figures.m8a, Unit::One),
        ("energy_ratio", whole.figures.energy_ratio, Unit::One),
        ("sideband_level_factor", whole.figures.sideband_level_factor, Unit::One),
        ("na4_star", against_healthy(whole, context), Unit::One),
        ("nb4_star", around.and_then(|r| against_healthy(r, context)), Unit::One),
        ("mesh_phase_swing_rad", around.and_then(|r| r.phase_swing_rad), Unit::One),
    ];
    let machine = context.machine;
    let (gear, shaft) = (&machine.gear(found.gear).id, &machine.shaft(found.shaft).id);
    let evidence = |(name, value, unit): (&str, Option<f64>, Unit)| {
        Some(Evidence {
            indicator: format!("{name}_{gear}_{shaft}"),
            channel: context.channel_name(found.channel).to_owned(),
            detector: None,
            frequency: None,
            expected: None,
            order: None,
            value: value?,
            unit,
            threshold: None,
            false_alarm_probability: None,
            sample_range: Some(found.sample_range),
        })
    };
    all.into_iter().filter_map(evidence).collect()
}

/// Fourth moment over the square of the baseline's variance (D67 with V of the baseline).
fn against_healthy(reading: &GearReading, context: &Context<'_>) -> Option<f64> {
    let shape = reading.shape?;
    let machine = context.machine;
    let (gear, shaft) = (&machine.gear(reading.gear).id, &machine.shaft(reading.shaft).id);
    let name = gear::shape_name(reading.part, gear, shaft);
    let channel = context.channel_name(reading.channel);
    let compared = context.baseline.compare(channel, &name, shape.deviation)?;
    Some(shape.kurtosis * compared.ratio.powi(4))
}

/// The mesh harmonic with the largest amplitude in the baseline; without one, now.
fn strongest_harmonic(whole: &GearReading, context: &Context<'_>) -> usize {
    let machine = context.machine;
    let (gear, shaft) = (&machine.gear(whole.gear).id, &machine.shaft(whole.shaft).id);
    let channel = context.channel_name(whole.channel);
    let amplitude = |(i, now): (usize, &f64)| {
        let usual = context.baseline.usual(channel, &gear::mesh_name(i + 1, gear, shaft));
        let sum: f64 = usual.iter().map(|u| u.log_value).sum();
        let healthy = (!usual.is_empty()).then(|| (sum / usual.len() as f64).exp());
        (i + 1, healthy.unwrap_or(*now))
    };
    let all = whole.mesh.iter().enumerate().map(amplitude);
    all.fold((1, 0.0), |best, next| if next.1 > best.1 { next } else { best }).0
}
