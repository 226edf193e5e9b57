//! Channels and raw samples.

use super::error::ApiError;
use super::extract::{Path, Query, State, in_range};
use super::state::{ApiState, channel, newest};
use super::view::{End, MAX_WAVEFORM_SAMPLES, MachineView, ShardRequest, Waveform};
use super::wire::problem::ProblemWire;
use super::wire::signals::{ChannelListWire, ChannelWire, LedgerWire, Validity, WaveformWire};
use super::wire::{finite, finite_column};
use crate::plot::decimate;
use crate::signal::ChannelInfo;
use axum::Json;
use axum::body::Bytes;
use axum::http::{HeaderMap, HeaderName, HeaderValue, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use utoipa::IntoParams;

/// Most samples of one answer.
pub(super) const MAX_SAMPLES: usize = MAX_WAVEFORM_SAMPLES;

/// Most points of a JSON column.
pub(super) const MAX_POINTS: usize = 200_000;

/// Lists the channels of a machine's stream.
#[utoipa::path(
    get,
    path = "/api/v1/machines/{id}/channels",
    tag = "signals",
    params(("id" = String, Path, description = "Machine id")),
    responses(
        (status = OK, body = ChannelListWire),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
    )
)]
pub(super) async fn channels(
    State(state): State<ApiState>,
    Path(id): Path<String>,
) -> Result<Json<ChannelListWire>, ApiError> {
    let handle = state.machine(&id)?;
    let view = newest(handle);
    let senders = handle.ingest.as_ref().map(|status| status());
    let items = view.channels.iter().enumerate().map(|(index, info)| {
        let ring = view.rings.get(index).copied().unwrap_or_default();
        let sensor = view.machine.sensors.iter().find(|sensor| sensor.channel == info.name);
        ChannelWire {
            name: info.name.clone(),
            unit: info.unit.symbol().to_owned(),
            sample_rate_hz: finite(info.sample_rate.0),
            offset: finite(info.offset),
            sensor: sensor.map(|sensor| sensor.kind.name().to_owned()),
            unit_conflict: info.unit_conflict.clone().map(|(data, file)| [data, file]),
            oldest_sample: ring.oldest.0,
            end_sample: ring.newest.0,
            end_time_s: (ring.received > 0).then(|| finite(ring.newest_time_s)).flatten(),
            received: ring.received,
            missing: ring.missing,
            gaps: ring.gaps,
            duplicated: ring.duplicated,
            clipped: ring.clipped,
            ledger: senders.as_ref().and_then(|senders| {
                // Both are in the order of the stream; a snapshot may be of the one before.
                let it = senders.channels.get(index).filter(|channel| channel.name == info.name);
                it.map(LedgerWire::new)
            }),
        }
    });
    Ok(Json(ChannelListWire { items: items.collect() }))
}

/// Which samples.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct WaveformQuery {
    /// At most this many samples; one second by default.
    #[param(minimum = 1, maximum = 4_194_304)]
    samples: Option<usize>,
    /// One past the last sample; the newest by default.
    end: Option<u64>,
    /// JSON only: at most this many points, smallest and largest sample of each stretch.
    #[param(minimum = 2, maximum = 200_000, default = 2000)]
    max_points: Option<usize>,
}

/// Gives raw samples: JSON columns, or little-endian f32 for `Accept: application/octet-stream`.
///
/// The run is contiguous: it ends at `end` or before and never spans a gap. The binary form has its
/// facts in the headers `x-rotorwatch-start-sample`, `-start-time-s`, `-sample-rate-hz`, `-unit`,
/// `-offset`, `-n-samples` and `-validity`.
#[utoipa::path(
    get,
    path = "/api/v1/machines/{id}/channels/{name}/waveform",
    tag = "signals",
    params(
        ("id" = String, Path, description = "Machine id"),
        ("name" = String, Path, description = "Channel name"),
        WaveformQuery,
    ),
    responses(
        (status = OK, content(
            (WaveformWire = "application/json"),
            (Vec<u8> = "application/octet-stream"),
        )),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_ACCEPTABLE, body = ProblemWire, content_type = "application/problem+json"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn waveform(
    State(state): State<ApiState>,
    Path((id, name)): Path<(String, String)>,
    Query(query): Query<WaveformQuery>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    let binary = wants_binary(&headers)?;
    let max_points = in_range("max_points", query.max_points, 2000, 2, MAX_POINTS)?;
    if binary && query.max_points.is_some() {
        return Err(ApiError::Invalid(
            "max_points thins JSON columns only, the binary form holds every sample".to_owned(),
        ));
    }
    let view = newest(state.machine(&id)?);
    let (_, info) = channel(&view, &name)?;
    let one_second = samples_in(info, 1.0).clamp(1, MAX_SAMPLES);
    let max_samples = in_range("samples", query.samples, one_second, 1, MAX_SAMPLES)?;
    let run = fetch(&state, &id, &name, query.end, max_samples).await?;
    if binary {
        return Ok(binary_response(&run));
    }
    let Run { info, waveform, validity } = run;
    let samples = &waveform.samples;
    let kept = decimate::min_max(samples.len(), max_points, |i| f64::from(samples[i]));
    let time_s = |i: &usize| waveform.start_time_s + *i as f64 / info.sample_rate.0;
    Ok(Json(WaveformWire {
        channel: name,
        unit: info.unit.symbol().to_owned(),
        sample_rate_hz: finite(info.sample_rate.0),
        offset: finite(info.offset),
        start_sample: waveform.start,
        n_samples: samples.len(),
        validity,
        decimated: kept.len() < samples.len(),
        time_s: finite_column(kept.iter().map(time_s)),
        value: finite_column(kept.iter().map(|i| f64::from(samples[*i]))),
    })
    .into_response())
}

/// A run of samples with what is known of it.
#[derive(Debug)]
pub(super) struct Run {
    /// The channel.
    pub(super) info: ChannelInfo,
    /// The samples, at least one.
    pub(super) waveform: Waveform,
    /// Whether they can be trusted.
    pub(super) validity: Validity,
}

impl Run {
    /// Stream time of one past the last sample, s.
    pub(super) fn end_s(&self) -> f64 {
        self.waveform.start_time_s + self.waveform.samples.len() as f64 / self.info.sample_rate.0
    }
}

/// Asks a machine's shard for the newest `max_samples` samples of a channel before `end`.
pub(super) async fn fetch(
    state: &ApiState,
    machine: &str,
    name: &str,
    end: impl Into<End>,
    max_samples: usize,
) -> Result<Run, ApiError> {
    let end = end.into();
    let handle = state.machine(machine)?;
    let view = newest(handle);
    let (index, info) = channel(&view, name)?;
    let question = |reply| ShardRequest::Waveform { channel: index, end, max_samples, reply };
    let held = state.ask(handle, question).await?.filter(|waveform| !waveform.samples.is_empty());
    let Some(waveform) = held else {
        let ring = view.rings.get(index).copied().unwrap_or_default();
        let before = match end {
            End::Newest => String::new(),
            End::Before(end) => format!(" before sample {end}"),
            End::At(time_s) => format!(" before {time_s:.3} s of stream time"),
        };
        return Err(ApiError::NotFound(format!(
            "no samples of {name:?} are held{before}; held are {} to {}",
            ring.oldest.0, ring.newest.0
        )));
    };
    let validity = validity(&view, info, &waveform, end, max_samples);
    Ok(Run { info: info.clone(), waveform, validity })
}

/// Worst first: samples of a source that failed or delivers no more, then clipping, then too few samples. A run that reaches back to
/// the start of the stream is short, but has no gap.
fn validity(
    view: &MachineView,
    info: &ChannelInfo,
    waveform: &Waveform,
    end: End,
    wanted: usize,
) -> Validity {
    let is_clipped =
        |(low, high): (f32, f32)| waveform.samples.iter().any(|x| *x <= low || *x >= high);
    let n_held = waveform.samples.len();
    let is_short = match end {
        End::Newest => false,
        End::Before(end) => waveform.start + (n_held as u64) < end,
        End::At(time_s) => {
            (time_s - waveform.start_time_s) * info.sample_rate.0 > n_held as f64 + 0.5
        }
    };
    if end == End::Newest && view.is_stale(&info.name) {
        Validity::Stale
    } else if info.full_scale.is_some_and(is_clipped) {
        Validity::Clipped
    } else if is_short || n_held < wanted && waveform.start > 0 {
        Validity::Gap
    } else {
        Validity::Ok
    }
}

/// Number of samples in `seconds`, rounded.
pub(super) fn samples_in(info: &ChannelInfo, seconds: f64) -> usize {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "float to int casts saturate, and the number is not negative"
    )]
    let n = (info.sample_rate.0 * seconds).round().max(0.0) as usize;
    n
}

fn wants_binary(headers: &HeaderMap) -> Result<bool, ApiError> {
    let accept: Vec<&str> =
        headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok()).collect();
    let has = |kinds: &[&str]| {
        accept
            .iter()
            .flat_map(|value| value.split(','))
            .filter_map(|part| part.split(';').next())
            .any(|kind| kinds.contains(&kind.trim()))
    };
    if has(&["application/octet-stream"]) {
        Ok(true)
    } else if accept.is_empty() || has(&["application/json", "application/*", "*/*"]) {
        Ok(false)
    } else {
        Err(ApiError::NotAcceptable(
            "waveforms are sent as application/json or application/octet-stream".to_owned(),
        ))
    }
}

fn binary_response(run: &Run) -> Response {
    let Run { info, waveform, validity } = run;
    let bytes: Vec<u8> = waveform.samples.iter().flat_map(|x| x.to_le_bytes()).collect();
    let validity = match validity {
        Validity::Ok => "ok",
        Validity::Gap => "gap",
        Validity::Clipped => "clipped",
        Validity::Stale => "stale",
    };
    let facts = [
        ("x-rotorwatch-start-sample", waveform.start.to_string()),
        ("x-rotorwatch-start-time-s", waveform.start_time_s.to_string()),
        ("x-rotorwatch-sample-rate-hz", info.sample_rate.0.to_string()),
        ("x-rotorwatch-unit", info.unit.symbol().to_owned()),
        ("x-rotorwatch-offset", info.offset.to_string()),
        ("x-rotorwatch-n-samples", waveform.samples.len().to_string()),
        ("x-rotorwatch-validity", validity.to_owned()),
    ];
    let mut response =
        ([(header::CONTENT_TYPE, "application/octet-stream")], Bytes::from(bytes)).into_response();
    for (name, value) in facts {
        // Digits, signs and unit symbols: always a valid header.
        if let Ok(value) = HeaderValue::from_str(&value) {
            response.headers_mut().insert(HeaderName::from_static(name), value);
        }
    }
    response
}
