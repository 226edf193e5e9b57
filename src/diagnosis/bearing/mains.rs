//! Lines that the mains may make where the machine file does not say how fast they are (docs/theory.md, C48).

use super::candidate::Candidate;
use super::doubt::Seen;
use crate::features::bearing::DefectLine;
use crate::machine::motor::MAINS_HZ;
use crate::machine::motor::MAINS_WANDER;
use crate::units::Hz;

/// Multiples of the mains at which something happens: magnets pull and rectifiers conduct in both half waves of one, two
/// or three phases.
const MULTIPLES: [f64; 3] = [2.0, 4.0, 6.0];

/// The mains frequency of which the line may be a multiple, where no motor of the machine file states one and no side bands tell that
/// it comes from a bearing, and which multiple.
pub(super) fn of_mains(line: &Candidate<'_>, seen: &Seen<'_>) -> Option<(Hz, f64)> {
    let frequency = line.best.as_ref()?.frequency;
    if seen.context.machine.motors.iter().any(|motor| motor.line_frequency.is_some()) {
        return None;
    }
    // Those of a race at rest would be at the shaft's speed, of a load that turns; those of a rotor in its field are, too.
    let has_own = line.search.is_of_turning_race() || line.search.line == DefectLine::TwoBsf;
    if has_own && line.has_side_band() {
        return None;
    }
    let pairs =
        MAINS_HZ.iter().flat_map(|mains_hz| MULTIPLES.map(|multiple| (*mains_hz, multiple)));
    let is_at = |(mains_hz, multiple): &(f64, f64)| {
        let hz = mains_hz * multiple;
        (frequency.0 - hz).abs() <= 0.5 * line.search.resolution.0 + MAINS_WANDER * hz
    };
    pairs.into_iter().find(is_at).map(|(mains_hz, multiple)| (Hz(mains_hz), multiple))
}
