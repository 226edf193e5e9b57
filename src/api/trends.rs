//! Trends: of channels from memory or from the store, of components from the store.

use super::error::ApiError;
use super::extract::{Path, Query, State, in_range};
use super::handles::TrendHandle;
use super::points::{Columns, Part, append, of_memory, of_store, shown};
use super::signals::MAX_POINTS;
use super::state::{ApiState, channel, newest};
use super::view::{MachineView, ShardRequest, SourceState, Trend};
use super::wire::problem::ProblemWire;
use super::wire::signals::{ComponentTrendWire, TrendWire, Validity};
use super::wire::{KindName, TierName, rfc3339};
use crate::diagnosis::fault::{ComponentKind, FaultMode};
use crate::signal::Timestamp;
use crate::store::StoreError;
use crate::store::trends::{Subject, Tier, TrendQuery as StoredQuery, tier_for};
use axum::Json;
use serde::Deserialize;
use std::sync::Arc;
use utoipa::IntoParams;

/// Span of an answer without `from`, s.
const DEFAULT_SPAN_S: f64 = 86_400.0;

/// Which part of a trend.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct TrendQuery {
    /// Names, with commas between; all by default.
    features: Option<String>,
    /// At most this many points a feature, smallest and largest of each stretch.
    #[param(minimum = 2, maximum = 200_000, default = 2000)]
    max_points: Option<usize>,
    /// At this time (RFC 3339) or later, from the store; a day before `to` by default. In a stream without a
    /// start times are at 1970-01-01 and the stream time.
    from: Option<String>,
    /// Before this time (RFC 3339); now by default, which is the newest sample of a stream that has one.
    to: Option<String>,
    /// How finely, from the store; by default as the span asks for.
    tier: Option<TierName>,
}

/// Which part of the store is asked for; `None`: none, memory is.
fn span(
    query: &TrendQuery,
    view: &MachineView,
) -> Result<Option<(Timestamp, Timestamp)>, ApiError> {
    let from = query.from.as_deref().map(|text| time("from", text)).transpose()?;
    let to = query.to.as_deref().map(|text| time("to", text)).transpose()?;
    if from.is_none() && to.is_none() && query.tier.is_none() {
        return Ok(None);
    }
    // `to` is not part of the span, now is.
    let now = view.start_time.unwrap_or_default().plus_seconds(view.stream_time_s + 1e-3);
    let to = to.unwrap_or(now);
    let from = from.unwrap_or_else(|| to.plus_seconds(-DEFAULT_SPAN_S));
    if from < to {
        Ok(Some((from, to)))
    } else {
        Err(ApiError::Invalid(format!(
            "from {} is not before to {}",
            rfc3339(Some(from), 0.0),
            rfc3339(Some(to), 0.0)
        )))
    }
}

fn time(name: &str, text: &str) -> Result<Timestamp, ApiError> {
    let read = text.parse::<jiff::Timestamp>().ok();
    let time = read.and_then(|time| i64::try_from(time.as_nanosecond()).ok());
    time.map(Timestamp).ok_or_else(|| {
        let message = "allowed is a time such as 2026-05-04T12:00:00Z";
        ApiError::Invalid(format!("{name} is {text:?}, {message}"))
    })
}

/// What the newest verdict and the source say of what a trend rests on; of what it does not reach to they say nothing.
fn validity(
    view: &MachineView,
    subject: &Subject,
    span: Option<(Timestamp, Timestamp)>,
) -> Validity {
    let newest = view.start_time.unwrap_or_default().plus_seconds(view.stream_time_s);
    if span.is_some_and(|(_, to)| to <= newest) {
        return Validity::Ok;
    }
    let is_clipped = |channel: &str| {
        let components = view.diagnosis.iter().flat_map(|diagnosis| &diagnosis.components);
        let mut its =
            components.filter(|one| one.kind == ComponentKind::Sensor && one.id == channel);
        its.any(|one| one.fault == Some(FaultMode::Clipped))
    };
    match subject {
        Subject::Channel(name) if view.is_stale(name) || channel(view, name).is_err() => {
            Validity::Stale
        }
        Subject::Channel(name) if is_clipped(name) => Validity::Clipped,
        Subject::Component(..)
            if view.no_data().is_some() || matches!(view.source, SourceState::Failed(_)) =>
        {
            Validity::Stale
        }
        Subject::Channel(_) | Subject::Component(..) => Validity::Ok,
    }
}

/// The names asked for.
fn names(query: &TrendQuery) -> Option<Vec<String>> {
    let names = query.features.as_deref()?;
    Some(names.split(',').map(|name| name.trim().to_owned()).collect())
}

/// Gives the features of a channel over time.
///
/// Without `from`, `to` and `tier`: over the windows held in memory. With any of them: from the store, also of
/// before a restart; windows of the last minute that are not stored yet come from memory.
#[utoipa::path(
    get,
    path = "/api/v1/machines/{id}/channels/{name}/trend",
    tag = "signals",
    params(
        ("id" = String, Path, description = "Machine id"),
        ("name" = String, Path, description = "Channel name"),
        TrendQuery,
    ),
    responses(
        (status = OK, body = TrendWire),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn trend(
    State(state): State<ApiState>,
    Path((id, name)): Path<(String, String)>,
    Query(query): Query<TrendQuery>,
) -> Result<Json<TrendWire>, ApiError> {
    let max_points = in_range("max_points", query.max_points, 2000, 2, MAX_POINTS)?;
    let handle = state.machine(&id)?;
    let view: Arc<MachineView> = newest(handle);
    let wanted = names(&query);
    let found = channel(&view, &name);
    let in_memory = match &found {
        Ok((index, _)) => {
            let index = *index;
            state.ask(handle, |reply| ShardRequest::Trend { channel: index, reply }).await?
        }
        Err(_) => Trend::default(),
    };
    let span = span(&query, &view)?;
    let validity = validity(&view, &Subject::Channel(name.clone()), span);
    let part = |tier| Part { tier, start: view.start_time, max_points, validity };
    let Some(span) = span else {
        found?;
        let part = part(Tier::Windows);
        let points = shown(&of_memory(&in_memory), &part, wanted.as_deref(), &name)?;
        return Ok(Json(TrendWire { channel: name, points }));
    };
    let subject = Subject::Channel(name.clone());
    let (tier, mut columns) = stored(&state, &id, (&subject, &query, &view), span).await?;
    if tier == Tier::Windows {
        append(&mut columns, &of_memory(&in_memory), span, view.start_time);
    }
    if columns.is_empty() {
        found?;
    }
    let points = shown(&columns, &part(tier), wanted.as_deref(), &name)?;
    Ok(Json(TrendWire { channel: name, points }))
}

/// Gives state, severity and confidence of the verdicts on a component over time, from the store and, of the newest windows, from memory.
#[utoipa::path(
    get,
    path = "/api/v1/machines/{id}/components/{kind}/{component}/trend",
    tag = "machines",
    params(
        ("id" = String, Path, description = "Machine id"),
        ("kind" = KindName, Path, description = "Component's kind"),
        ("component" = String, Path, description = "Component's id"),
        TrendQuery,
    ),
    responses(
        (status = OK, body = ComponentTrendWire),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn component(
    State(state): State<ApiState>,
    Path((id, kind, component)): Path<(String, KindName, String)>,
    Query(query): Query<TrendQuery>,
) -> Result<Json<ComponentTrendWire>, ApiError> {
    let max_points = in_range("max_points", query.max_points, 2000, 2, MAX_POINTS)?;
    let view = newest(state.machine(&id)?);
    let query = match query {
        TrendQuery { from: None, to: None, tier: None, .. } => {
            TrendQuery { tier: Some(TierName::Windows), ..query }
        }
        query => query,
    };
    let subject = Subject::Component(kind.into(), component.clone());
    let span = span(&query, &view)?.unwrap_or_default();
    let validity = validity(&view, &subject, Some(span));
    let (tier, mut columns) = stored(&state, &id, (&subject, &query, &view), span).await?;
    if tier == Tier::Windows {
        let handle = state.machine(&id)?;
        let (kind, component) = (kind.into(), component.clone());
        let newest = |reply| ShardRequest::Verdicts { kind, component, reply };
        append(&mut columns, &of_memory(&state.ask(handle, newest).await?), span, view.start_time);
    }
    let has_any = columns.columns.iter().any(|column| column.value.iter().any(|v| !v.is_nan()));
    if !has_any {
        let handle = trends(&state)?;
        let (archive, id) = (Arc::clone(&handle.archive), id.clone());
        let known = state.compute(move || Ok(archive.subjects(&id)?)).await?;
        let judged = view.diagnosis.iter().flat_map(|diagnosis| &diagnosis.components);
        let mut judged = judged.filter(|one| one.id == component);
        let is_judged = judged.any(|one| KindName::from(one.kind) == kind);
        if is_judged && !known.contains(&subject) {
            // Judged, and not yet stored: a history without points.
            let part = Part { tier, start: view.start_time, max_points, validity };
            let points = shown(&columns, &part, None, &component)?;
            return Ok(Json(ComponentTrendWire { kind, component, points }));
        }
        if !known.contains(&subject) {
            let list = known.iter().filter_map(|subject| match subject {
                Subject::Component(kind, id) => Some(format!("{} {id}", kind.name())),
                Subject::Channel(_) => None,
            });
            let list = list.collect::<Vec<_>>().join(", ");
            let kind = crate::diagnosis::fault::ComponentKind::from(kind).name();
            return Err(ApiError::NotFound(format!(
                "no verdicts on {kind} {component:?} are stored; there is: {list}"
            )));
        }
    }
    let part = Part { tier, start: view.start_time, max_points, validity };
    let points = shown(&columns, &part, names(&query).as_deref(), &component)?;
    Ok(Json(ComponentTrendWire { kind, component, points }))
}

fn trends(state: &ApiState) -> Result<&TrendHandle, ApiError> {
    state.trends.as_ref().ok_or_else(|| ApiError::NotFound("no trends are stored".to_owned()))
}

/// Reads the store beside the event loop.
async fn stored(
    state: &ApiState,
    machine: &str,
    (subject, query, view): (&Subject, &TrendQuery, &MachineView),
    (from, to): (Timestamp, Timestamp),
) -> Result<(Tier, Columns), ApiError> {
    let archive = Arc::clone(&trends(state)?.archive);
    let wanted = StoredQuery {
        machine: machine.to_owned(),
        subject: subject.clone(),
        from,
        to,
        tier: Tier::Windows,
        features: names(query),
        origin: view.start_time,
    };
    let tier = query.tier.map(Tier::from);
    let rate_hz = match subject {
        Subject::Channel(name) => channel(view, name).ok().map(|(_, info)| info.sample_rate.0),
        Subject::Component(..) => None,
    };
    let counts_samples = matches!(subject, Subject::Channel(_));
    let work = move || {
        let tier = match tier {
            Some(tier) => tier,
            None => tier_for(&*archive, &wanted.machine, (from, to))?,
        };
        let table = match archive.trend(&StoredQuery { tier, ..wanted }) {
            Err(error) if matches!(error, StoreError::TooMuch { .. }) => {
                return Err(ApiError::Invalid(error.to_string()));
            }
            read => read?,
        };
        let columns = of_store(&table, rate_hz);
        Ok((tier, if counts_samples { columns } else { columns.without_samples() }))
    };
    state.compute(work).await
}
