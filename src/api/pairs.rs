//! Two channels of one place: who is whose partner, and the samples that both hold.

use super::error::ApiError;
use super::signals::{Run, fetch};
use super::state::{ApiState, newest};
use super::view::End;
use super::wire::signals::Validity;
use crate::dsp::real::floor_index;
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

/// Asks for runs of two channels over one time, at most `max_samples` of each: before sample `end` of x, or, without one, the newest
/// that both hold. By time, as [`together`] joins them: a sample of one sender has another index at the other.
pub(super) async fn fetch_pair(
    state: &ApiState,
    machine: &str,
    (x, y): (&str, &str),
    end: Option<u64>,
    max_samples: usize,
) -> Result<(Run, Run), ApiError> {
    let mut run_x = fetch(state, machine, x, end, max_samples).await?;
    let end_s = run_x.end_s();
    let mut run_y = fetch(state, machine, y, End::At(end_s), max_samples).await?;
    if end.is_some() {
        return Ok((run_x, run_y));
    }
    let reached_s = run_y.end_s();
    if reached_s + 0.5 / run_y.info.sample_rate.0 < end_s {
        // The newest samples of y are behind: blocks of two senders do not come together.
        let is_stale = run_x.validity == Validity::Stale;
        run_x = fetch(state, machine, x, End::At(reached_s), max_samples).await?;
        run_y = fetch(state, machine, y, End::At(reached_s), max_samples).await?;
        run_x.validity = if is_stale { Validity::Stale } else { run_x.validity };
    }
    if newest(state.machine(machine)?).is_stale(y) {
        run_y.validity = Validity::Stale;
    }
    Ok((run_x, run_y))
}

/// First sample of x at an instant, to half a sample, that two runs share, and the samples of both from there on, equally many.
/// Not by their indices: those of two senders count from different instants.
pub(super) fn together<'r>(
    x: &'r Run,
    y: &'r Run,
) -> Result<(u64, &'r [f32], &'r [f32]), ApiError> {
    if x.info.unit != y.info.unit || x.info.sample_rate != y.info.sample_rate {
        return Err(ApiError::Invalid(
            "the two channels of a pair need one unit and one rate".to_owned(),
        ));
    }
    let later_s = y.waveform.start_time_s - x.waveform.start_time_s;
    let later = (later_s * x.info.sample_rate.0).round();
    // So many samples of the one that begins first come before the other begins.
    let (from_x, from_y) = (floor_index(later.max(0.0)), floor_index((-later).max(0.0)));
    let (x_rest, y_rest) = (x.waveform.samples.get(from_x..), y.waveform.samples.get(from_y..));
    let n = x_rest.map_or(0, <[f32]>::len).min(y_rest.map_or(0, <[f32]>::len));
    match (x_rest.and_then(|x| x.get(..n)), y_rest.and_then(|y| y.get(..n))) {
        (Some(xs), Some(ys)) if n > 0 => Ok((x.waveform.start + from_x as u64, xs, ys)),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::api::view::Waveform;
    use crate::signal::ChannelInfo;
    use crate::units::Hz;
    use crate::units::Unit;

    /// Fifty samples, ten a second, 0, 1, 2 ….
    fn run(start: u64, start_time_s: f64) -> Run {
        let info = ChannelInfo {
            name: "x".to_owned(),
            sample_rate: Hz(10.0),
            unit: Unit::Micrometre,
            offset: 0.0,
            unit_conflict: None,
            full_scale: None,
        };
        let samples = (0..50_u8).map(f32::from).collect();
        Run { info, waveform: Waveform { start, start_time_s, samples }, validity: Validity::Ok }
    }

    #[test]
    fn runs_are_laid_side_by_side_by_their_times() {
        let (x, y) = (run(100, 7.0), run(100, 7.0));
        let (first, xs, ys) = together(&x, &y).unwrap();
        assert_eq!((first, xs.len(), xs == ys), (100, 50, true));
        // The other sender began 2 s later, so that its sample 100 is sample 120 of the first.
        let late = run(100, 9.0);
        let (first, xs, ys) = together(&x, &late).unwrap();
        assert_eq!((first, xs.len(), ys.len()), (120, 30, 30));
        assert_eq!((xs[0], ys[0]), (20.0, 0.0));
        let (first, xs, ys) = together(&late, &x).unwrap();
        assert_eq!((first, xs[0], ys[0], xs.len()), (100, 0.0, 20.0, 30));
        assert!(together(&x, &run(100, 13.0)).is_err(), "nothing in common");
    }
}
