//! Lines that the mains may make where the machine file does not say how fast they are (docs/theory.md, C48).

use super::candidate::Candidate;
use super::doubt::Seen;
use crate::features::bearing::DefectLine;
use crate::machine::Machine;
use crate::machine::motor::MAINS_HZ;
use crate::machine::motor::MAINS_WANDER;
use crate::units::Hz;

/// Highest multiple of the mains that is looked at: rectifiers of twelve pulses have strong ones so far.
const HIGHEST: u32 = 12;

/// The mains frequency of which the line may be a multiple, where no motor of the machine file states one and no side bands tell that
/// it comes from a bearing, and which multiple.
pub(super) fn of_mains(line: &Candidate<'_>, seen: &Seen<'_>) -> Option<(Hz, f64)> {
    // Those of a race at rest would be at the shaft's speed, of a load that turns; those of a rotor in its field are, too.
    let has_own = line.search.is_of_turning_race() || line.search.line == DefectLine::TwoBsf;
    if has_own && line.has_side_band() {
        return None;
    }
    let frequency = line.best.as_ref()?.frequency;
    multiple(seen.context.machine, frequency, line.search.resolution)
}

/// The mains frequency of which a rate may be a multiple, where no motor states one, and which multiple. `resolution`: 2/T.
pub(super) fn multiple(machine: &Machine, rate: Hz, resolution: Hz) -> Option<(Hz, f64)> {
    if machine.motors.iter().any(|motor| motor.line_frequency.is_some()) {
        return None;
    }
    let of = |mains_hz: f64| (1..=HIGHEST).map(move |multiple| (mains_hz, f64::from(multiple)));
    let mut pairs = MAINS_HZ.iter().flat_map(|mains_hz| of(*mains_hz));
    let is_at = |(mains_hz, multiple): &(f64, f64)| {
        let hz = mains_hz * multiple;
        (rate.0 - hz).abs() <= 0.5 * resolution.0 + MAINS_WANDER * hz
    };
    pairs.find(is_at).map(|(mains_hz, multiple)| (Hz(mains_hz), multiple))
}
