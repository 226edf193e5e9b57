//! Orbits: what a pair of sensors sees of the shaft over whole revolutions.

use super::error::ApiError;
use super::extract::{Path, Query, State, in_range};
use super::pairs::{fetch_pair, pairs, partner, together, worse};
use super::signals::{MAX_SAMPLES, Run};
use super::state::{ApiState, channel, newest};
use super::turning::{Turner, Watched, last_whole};
use super::view::MachineView;
use super::wire::orbit::{EllipseWire, OrbitWire};
use super::wire::problem::ProblemWire;
use super::wire::signals::{AngleFrom, Validity};
use super::wire::{finite, finite_column};
use crate::dsp::full_spectrum::Orbit;
use crate::dsp::line::line_at;
use crate::dsp::order::PhaseTrack;
use crate::dsp::stats::mean;
use crate::machine::Machine;
use crate::machine::sensor::SensorKind;
use crate::machine::shaft::Rotation;
use axum::Json;
use serde::Deserialize;
use utoipa::IntoParams;

/// Orders whose ellipses are given.
const ORDERS: [u8; 3] = [1, 2, 3];

/// Which orbit.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct OrbitQuery {
    /// A channel of the pair; by default of the first pair of probes, else of the first pair.
    x: Option<String>,
    /// The other channel; by default the sensor 90° from it, and the one from which the other is reached by +90° is x.
    y: Option<String>,
    /// Whole revolutions of the shaft, the newest.
    #[param(minimum = 1, maximum = 64, default = 4)]
    revolutions: Option<usize>,
    /// One past the last sample of x; the newest by default, of which both are held.
    end: Option<u64>,
    /// At most this many points, at equal steps.
    #[param(minimum = 16, maximum = 20_000, default = 4000)]
    max_points: Option<usize>,
}

/// Gives the motion that a pair of sensors sees over whole revolutions, its mean left out.
#[utoipa::path(
    get,
    path = "/api/v1/machines/{id}/orbit",
    tag = "signals",
    params(("id" = String, Path, description = "Machine id"), OrbitQuery),
    responses(
        (status = OK, body = OrbitWire),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json",
         description = "No such machine or channel, no pair of sensors, or no whole revolution is held"),
        (status = CONFLICT, body = ProblemWire, content_type = "application/problem+json",
         description = "The speed of the shaft is not known"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire, content_type = "application/problem+json"),
    )
)]
pub(super) async fn orbit(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    Query(query): Query<OrbitQuery>,
) -> Result<Json<OrbitWire>, ApiError> {
    let view = newest(state.machine(&id)?);
    let revolutions = in_range("revolutions", query.revolutions, 4, 1, 64)?;
    let max_points = in_range("max_points", query.max_points, 4000, 16, 20_000)?;
    let (x, y) = chosen(&view, &query)?;
    let (_, info) = channel(&view, &x)?;
    channel(&view, &y)?;
    let turner = Turner::of_channel(&view, &x)?;
    let n_wanted = turner.samples_of(info, revolutions as f64);
    if n_wanted > MAX_SAMPLES {
        return Err(ApiError::Invalid(format!(
            "{revolutions} revolutions are {n_wanted} samples, allowed are {MAX_SAMPLES}"
        )));
    }
    let (run_x, run_y) = fetch_pair(&state, &id, (&x, &y), query.end, n_wanted).await?;
    let watched = turner.watch(&state, &id, &run_x).await?;
    let request = OrbitRequest { channels: [x, y], revolutions, max_points };
    state.compute(move || request.compute(&view.machine, &run_x, &run_y, &watched)).await.map(Json)
}

/// Channels of x and y.
fn chosen(view: &MachineView, query: &OrbitQuery) -> Result<(String, String), ApiError> {
    let machine = &view.machine;
    let owned = |(x, y): (&str, &str)| (x.to_owned(), y.to_owned());
    let is_probe = |name: &str| {
        machine.sensors.iter().any(|s| s.channel == name && s.kind == SensorKind::Proximitor)
    };
    let (one, other) = match (query.x.as_deref(), query.y.as_deref()) {
        (Some(x), Some(y)) => return Ok(owned((x, y))),
        (Some(one), None) => (channel(view, one).and(partner(machine, one, "y"))?, one),
        (None, Some(one)) => (channel(view, one).and(partner(machine, one, "x"))?, one),
        (None, None) => {
            let probes = pairs(machine).find(|(x, _)| is_probe(x));
            return probes.or_else(|| pairs(machine).next()).map(owned).ok_or_else(|| {
                ApiError::NotFound(
                    "no two sensors of one kind and place stand 90° ± 5° apart; name channels by x= and y="
                        .to_owned(),
                )
            });
        }
    };
    let known = pairs(machine).find(|pair| *pair == (one, other) || *pair == (other, one));
    Ok(owned(known.unwrap_or((one, other))))
}

/// A checked request.
#[derive(Debug)]
struct OrbitRequest {
    channels: [String; 2],
    revolutions: usize,
    max_points: usize,
}

impl OrbitRequest {
    fn compute(
        self,
        machine: &Machine,
        x: &Run,
        y: &Run,
        watched: &Watched,
    ) -> Result<OrbitWire, ApiError> {
        let (first_sample, xs, ys) = together(x, y)?;
        let fs_hz = x.info.sample_rate.0;
        let start_s = x.waveform.start_time_s + (first_sample - x.waveform.start) as f64 / fs_hz;
        let turns = watched.turns(start_s)?;
        let end_s = (xs.len() - 1) as f64 / fs_hz;
        let whole = last_whole(&turns.track, (0.0, end_s), self.revolutions);
        let (begin, last, times_s) = whole.ok_or_else(|| {
            ApiError::NotFound("no whole revolution of the shaft is held".to_owned())
        })?;
        let [from, to] = times_s.map(|time_s| nearest(time_s * fs_hz, xs.len()));
        let (xs, ys) = (&xs[from..to], &ys[from..to]);
        let mean_of = |samples: &[f32]| mean(samples).unwrap_or(0.0);
        let [mean_x, mean_y] = [mean_of(xs), mean_of(ys)];
        let step = xs.len().div_ceil(self.max_points).max(1);
        let kept = || (0..xs.len()).step_by(step);
        let speed_hz = (last - begin) / (times_s[1] - times_s[0]);
        let time_s = |i: usize| (from + i) as f64 / fs_hz;
        let angle_deg = |i| turns.track.revolutions_at(time_s(i)).map(|r| 360.0 * (r - begin));
        let [x_channel, y_channel] = self.channels;
        let validity = worse(x.validity, y.validity);
        let is_short = last - begin < self.revolutions as f64;
        Ok(OrbitWire {
            x_channel,
            y_channel,
            unit: x.info.unit.symbol().to_owned(),
            sample_rate_hz: finite(fs_hz),
            shaft: watched.turner.shaft().to_owned(),
            shaft_speed_hz: finite(speed_hz),
            rotation: rotation(machine, watched.turner.shaft()).map(str::to_owned),
            angle_from: turns.from,
            revolutions: finite(last - begin),
            start_sample: first_sample + from as u64,
            n_samples: xs.len(),
            validity: if is_short { worse(validity, Validity::Gap) } else { validity },
            step,
            time_s: finite_column(kept().map(|i| start_s + time_s(i))),
            angle_deg: finite_column(kept().map(|i| angle_deg(i).unwrap_or(f64::NAN))),
            x: finite_column(kept().map(|i| f64::from(xs[i]) - mean_x)),
            y: finite_column(kept().map(|i| f64::from(ys[i]) - mean_y)),
            marks: marks(&turns.track, turns.from, (begin, last), |time_s| {
                nearest(time_s * fs_hz, from + xs.len()).saturating_sub(from) / step
            }),
            ellipses: ORDERS
                .into_iter()
                .filter_map(|order| {
                    let hz = f64::from(order) * speed_hz;
                    let orbit = Orbit::of_lines(line_at(xs, fs_hz, hz)?, line_at(ys, fs_hz, hz)?);
                    Some(EllipseWire::new(order, orbit))
                })
                .collect(),
        })
    }
}

/// Points at which the mark of the shaft passed its probe; none where there is no mark.
fn marks(
    track: &PhaseTrack,
    from: AngleFrom,
    (begin, last): (f64, f64),
    point_at: impl Fn(f64) -> usize,
) -> Vec<usize> {
    if from != AngleFrom::Mark {
        return Vec::new();
    }
    let revolutions = std::iter::successors(Some(begin), |revolution| Some(revolution + 1.0));
    let whole = revolutions.take_while(|revolution| *revolution < last);
    whole.filter_map(|revolution| track.time_at(revolution)).map(point_at).collect()
}

fn rotation(machine: &Machine, shaft: &str) -> Option<&'static str> {
    let shaft = machine.shafts.iter().find(|s| s.id == shaft)?;
    Some(match shaft.rotation? {
        Rotation::Ccw => "ccw",
        Rotation::Cw => "cw",
    })
}

/// The sample at a place between two, at most `end`.
fn nearest(place: f64, end: usize) -> usize {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "float to int casts saturate, and the number is not negative"
    )]
    let index = place.round().max(0.0) as usize;
    index.min(end)
}
