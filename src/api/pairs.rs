//! Two channels of one place: who is whose partner, and the samples that both hold.

use super::error::ApiError;
use super::signals::Run;
use super::wire::signals::Validity;
use crate::machine::Machine;

/// Finds the channel of the sensor that forms a pair with the one of `name`; `parameter` is what names another one.
pub(super) fn partner<'m>(
    machine: &'m Machine,
    name: &str,
    parameter: &str,
) -> Result<&'m str, ApiError> {
    pairs(machine)
        .find_map(|(x, y)| if x == name { Some(y) } else { (y == name).then_some(x) })
        .ok_or_else(|| {
            ApiError::Invalid(format!(
                "no sensor of the same kind and place stands 90° ± 5° from {name:?}; name the other \
                 channel by {parameter}="
            ))
        })
}

/// Channels of the machine's pairs, x before y.
pub(super) fn pairs(machine: &Machine) -> impl Iterator<Item = (&str, &str)> {
    let channel = |index: usize| machine.sensors[index].channel.as_str();
    machine.sensor_pairs().into_iter().map(move |pair| (channel(pair.x), channel(pair.y)))
}

/// First sample that two runs share, and the samples of both from there on, equally many.
pub(super) fn together<'r>(
    x: &'r Run,
    y: &'r Run,
) -> Result<(u64, &'r [f32], &'r [f32]), ApiError> {
    if x.info.unit != y.info.unit || x.info.sample_rate != y.info.sample_rate {
        return Err(ApiError::Invalid(
            "the two channels of a pair need one unit and one rate".to_owned(),
        ));
    }
    let end = |run: &Run| run.waveform.start + run.waveform.samples.len() as u64;
    let first = x.waveform.start.max(y.waveform.start);
    let n = usize::try_from(end(x).min(end(y)).saturating_sub(first)).unwrap_or(0);
    let part = |run: &'r Run| {
        let from = usize::try_from(first - run.waveform.start).ok()?;
        run.waveform.samples.get(from..)?.get(..n)
    };
    match (part(x), part(y)) {
        (Some(x), Some(y)) if n > 0 => Ok((first, x, y)),
        _ => Err(ApiError::NotFound("the two channels hold no samples of one time".to_owned())),
    }
}

/// The worse of two validities.
pub(super) fn worse(a: Validity, b: Validity) -> Validity {
    let rank = |validity: Validity| match validity {
        Validity::Ok => 0,
        Validity::Gap => 1,
        Validity::Clipped => 2,
        Validity::Stale => 3,
    };
    if rank(b) > rank(a) { b } else { a }
}
