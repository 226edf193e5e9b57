//! Trends: of channels from memory or from the store, of components from the store.

use super::error::ApiError;
use super::extract::{Path, Query, State, in_range};
use super::handles::TrendHandle;
use super::signals::MAX_POINTS;
use super::state::{ApiState, channel, newest};
use super::view::{MachineView, ShardRequest, Trend};
use super::wire::problem::ProblemWire;
use super::wire::signals::{ComponentTrendWire, TrendColumnWire, TrendPointsWire, TrendWire};
use super::wire::{KindName, TierName, finite, finite_column, rfc3339};
use crate::plot::decimate;
use crate::signal::Timestamp;
use crate::store::StoreError;
use crate::store::trends::{Subject, Table, Tier, TrendQuery as StoredQuery, tier_for};
use axum::Json;
use serde::Deserialize;
use std::sync::Arc;
use utoipa::IntoParams;

/// Span of an answer without `from`, s.
const DEFAULT_SPAN_S: f64 = 86_400.0;

/// Distance of two points, in those that are usual, from which there is a gap between them.
const GAP: f64 = 1.5;

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
    let Some(span) = span(&query, &view)? else {
        found?;
        let part = Part { tier: Tier::Windows, start: view.start_time, max_points };
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
    let part = Part { tier, start: view.start_time, max_points };
    let points = shown(&columns, &part, wanted.as_deref(), &name)?;
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
            let part = Part { tier, start: view.start_time, max_points };
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
    let part = Part { tier, start: view.start_time, max_points };
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
        Ok((tier, of_store(&table)))
    };
    state.compute(work).await
}

/// How a trend is shown.
struct Part {
    tier: Tier,
    start: Option<Timestamp>,
    max_points: usize,
}

/// A trend on its way to JSON, from wherever it comes.
#[derive(Default)]
struct Columns {
    time_s: Vec<f64>,
    columns: Vec<Shown>,
    unreadable: Vec<String>,
}

/// A feature of it.
struct Shown {
    name: String,
    unit: &'static str,
    value: Vec<f64>,
    low: Vec<f64>,
    high: Vec<f64>,
}

impl Columns {
    fn is_empty(&self) -> bool {
        self.time_s.is_empty()
    }
}

fn of_memory(trend: &Trend) -> Columns {
    let columns = trend.columns.iter().map(|(name, unit, values)| Shown {
        name: name.clone(),
        unit: unit.symbol(),
        value: values.clone(),
        low: Vec::new(),
        high: Vec::new(),
    });
    let (time_s, columns) = (trend.time_s.clone(), columns.collect());
    Columns { time_s, columns, unreadable: Vec::new() }
}

fn of_store(table: &Table) -> Columns {
    let wide = |values: &[f32]| values.iter().copied().map(f64::from).collect();
    let columns = table.columns.iter().map(|column| Shown {
        name: column.name.to_string(),
        unit: column.unit.symbol(),
        value: wide(&column.value),
        low: wide(&column.low),
        high: wide(&column.high),
    });
    let (time_s, unreadable) = (table.time_s.clone(), table.unreadable.clone());
    Columns { time_s, columns: columns.collect(), unreadable }
}

/// Adds what memory holds behind what is stored, inside the span.
fn append(
    columns: &mut Columns,
    memory: &Columns,
    (from, to): (Timestamp, Timestamp),
    start: Option<Timestamp>,
) {
    let newest_s = columns.time_s.last().copied().unwrap_or(f64::NEG_INFINITY);
    let at = |time_s: f64| start.unwrap_or_default().plus_seconds(time_s);
    let is_new = |time_s: f64| time_s > newest_s + 1e-6 && at(time_s) >= from && at(time_s) < to;
    let places: Vec<usize> =
        (0..memory.time_s.len()).filter(|place| is_new(memory.time_s[*place])).collect();
    if places.is_empty() {
        return;
    }
    let n_before = columns.time_s.len();
    columns.time_s.extend(places.iter().map(|place| memory.time_s[*place]));
    for held in &memory.columns {
        let at = columns.columns.iter().position(|column| column.name == held.name);
        let at = at.unwrap_or_else(|| {
            let (name, unit, value) = (held.name.clone(), held.unit, vec![f64::NAN; n_before]);
            columns.columns.push(Shown { name, unit, value, low: Vec::new(), high: Vec::new() });
            columns.columns.len() - 1
        });
        let values = places.iter().map(|place| held.value.get(*place).copied().unwrap_or(f64::NAN));
        columns.columns[at].value.extend(values);
    }
    for column in &mut columns.columns {
        column.value.resize(columns.time_s.len(), f64::NAN);
    }
}

/// Thins a trend and lays its gaps open.
fn shown(
    trend: &Columns,
    part: &Part,
    wanted: Option<&[String]>,
    of: &str,
) -> Result<TrendPointsWire, ApiError> {
    let known = |wanted: &&String| trend.columns.iter().any(|column| column.name == **wanted);
    if !trend.is_empty()
        && let Some(missing) = wanted.into_iter().flatten().find(|wanted| !known(wanted))
    {
        let names: Vec<&str> = trend.columns.iter().map(|column| column.name.as_str()).collect();
        return Err(ApiError::Invalid(format!(
            "no feature {missing:?} of {of:?} is held, allowed are: {}",
            names.join(", ")
        )));
    }
    let n_windows = trend.time_s.len();
    let gaps = gaps(&trend.time_s, part.tier);
    let is_wanted = |c: &&Shown| wanted.is_none_or(|wanted| wanted.contains(&c.name));
    let columns = trend.columns.iter().filter(is_wanted);
    Ok(TrendPointsWire {
        decimated: n_windows > part.max_points,
        n_windows,
        tier: part.tier.into(),
        start_time: part.start.map(|start| rfc3339(Some(start), 0.0)),
        gaps: gaps
            .iter()
            .map(|place| [finite(trend.time_s[*place]), finite(trend.time_s[place + 1])])
            .collect(),
        unreadable: trend.unreadable.clone(),
        features: columns.map(|c| column(c, &trend.time_s, &gaps, part.max_points)).collect(),
    })
}

/// Places after which points are missing.
fn gaps(time_s: &[f64], tier: Tier) -> Vec<usize> {
    let mut steps: Vec<f64> = time_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let after = |steps: &[f64], usual_s: f64| -> Vec<usize> {
        let is_gap = |step: &f64| *step > GAP * usual_s;
        steps.iter().enumerate().filter(|(_, s)| is_gap(s)).map(|(place, _)| place).collect()
    };
    if let Some(step_s) = tier.step_s() {
        return after(&steps, step_s as f64);
    }
    let all = steps.clone();
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).map_or(Vec::new(), |usual_s| after(&all, *usual_s))
}

/// One feature, thinned so that its extremes stay; each gap is a point without a value.
fn column(shown: &Shown, time_s: &[f64], gaps: &[usize], max_points: usize) -> TrendColumnWire {
    let n = time_s.len().min(shown.value.len());
    let is_coarse = !shown.low.is_empty();
    let mut kept = if is_coarse {
        // The extremes of minutes and hours stand beside their means.
        let mut both = decimate::min_max(n, (max_points / 2).max(2), |i| shown.low[i]);
        both.extend(decimate::min_max(n, (max_points / 2).max(2), |i| shown.high[i]));
        if n <= max_points { (0..n).collect() } else { both }
    } else {
        decimate::min_max(n, max_points, |i| shown.value[i])
    };
    kept.sort_unstable();
    kept.dedup();
    let slots = with_gaps(&kept, gaps);
    let with = |from: &[f64]| {
        finite_column(slots.iter().map(|slot| match slot {
            Slot::Point(place) => from[*place],
            Slot::Gap(_) => f64::NAN,
        }))
    };
    let times = slots.iter().map(|slot| match slot {
        Slot::Point(place) => time_s[*place],
        Slot::Gap(place) => 0.5 * (time_s[*place] + time_s[place + 1]),
    });
    let times = finite_column(times);
    let extremes = |from: &[f64]| if is_coarse { with(from) } else { Vec::new() };
    TrendColumnWire {
        name: shown.name.clone(),
        unit: shown.unit.to_owned(),
        time_s: times,
        value: with(&shown.value),
        low: extremes(&shown.low),
        high: extremes(&shown.high),
    }
}

/// A point that is shown, or the gap behind a point.
enum Slot {
    Point(usize),
    Gap(usize),
}

/// The points that are kept, with the gaps between them; of several gaps between two points the last.
fn with_gaps(kept: &[usize], gaps: &[usize]) -> Vec<Slot> {
    let mut slots = Vec::with_capacity(kept.len());
    let mut next = gaps.iter().copied().peekable();
    for place in kept {
        let mut gap = None;
        while let Some(before) = next.next_if(|gap| gap < place) {
            gap = Some(before);
        }
        slots.extend(gap.filter(|_| !slots.is_empty()).map(Slot::Gap));
        slots.push(Slot::Point(*place));
    }
    slots
}
