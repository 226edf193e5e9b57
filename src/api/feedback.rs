//! What people found of verdicts: kept beside the verdict as it was, listed, never learned from by itself.

use super::error::ApiError;
use super::events::read;
use super::extract::{Body, PageQuery, Path, Query, State, cut_page};
use super::handles::FeedbackHandle;
use super::state::{ApiState, newest};
use super::view::MachineView;
use super::wire::feedback::{FeedbackBody, FeedbackListWire, FeedbackWire};
use super::wire::problem::ProblemWire;
use crate::alarms::MAX_TEXT_CHARS;
use crate::diagnosis::fault::{ComponentKind, FaultMode};
use crate::store::feedback::{Feedback, FeedbackQuery, Finding, Judgement};
use axum::Json;
use axum::http::StatusCode;
use std::sync::Arc;

/// Lists what people found of the verdicts on a machine, newest first.
#[utoipa::path(
    get,
    path = "/api/v1/machines/{id}/diagnosis/feedback",
    tag = "machines",
    params(("id" = String, Path, description = "Machine id"), PageQuery),
    responses(
        (status = OK, body = FeedbackListWire),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire, content_type = "application/problem+json"),
    )
)]
pub(super) async fn list(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    Query(query): Query<PageQuery>,
) -> Result<Json<FeedbackListWire>, ApiError> {
    state.machine(&id)?;
    let (before, limit) = query.page()?;
    let wanted = FeedbackQuery { machine: id, before, limit: limit + 1 };
    let store = Arc::clone(&handle(&state)?.store);
    let mut found = read(&store, move |store| store.list(&wanted)).await?;
    let next = cut_page(&mut found, limit, |(number, _)| number.to_string());
    let items = found.iter().map(|(number, entry)| FeedbackWire::new(*number, entry)).collect();
    Ok(Json(FeedbackListWire { items, next }))
}

/// Keeps what somebody found of the verdict that stands on a component. Nothing is learned from it by itself.
#[utoipa::path(
    post,
    path = "/api/v1/machines/{id}/diagnosis/feedback",
    tag = "machines",
    params(("id" = String, Path, description = "Machine id")),
    request_body = FeedbackBody,
    responses(
        (status = CREATED, body = FeedbackWire, description = "It is stored, with the verdict as it is"),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json",
         description = "No such machine, or no verdict on such a component"),
        (status = PAYLOAD_TOO_LARGE, body = ProblemWire, content_type = "application/problem+json"),
        (status = UNSUPPORTED_MEDIA_TYPE, body = ProblemWire, content_type = "application/problem+json"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire, content_type = "application/problem+json"),
    )
)]
pub(super) async fn say(
    State(state): State<ApiState>,
    Path(id): Path<String>,
    Body(mut body): Body<FeedbackBody>,
) -> Result<(StatusCode, Json<FeedbackWire>), ApiError> {
    body.author = state.author(body.author);
    let view = newest(state.machine(&id)?);
    let FeedbackHandle { store, wall_clock } = handle(&state)?;
    let [author, note] = [text("author", &body.author)?, text("note", &body.note)?];
    let (finding, found): (Finding, Option<FaultMode>) =
        (body.outcome.into(), body.fault.map(Into::into));
    check(finding, found, &author, &note)?;
    let component: (ComponentKind, String) = (body.kind.into(), body.component);
    let judgement = judgement(&view, &component)?;
    let at = wall_clock();
    let entry = Feedback { machine: id, at, author, finding, component, found, note, judgement };
    let kept = entry.clone();
    let number = read(store, move |store| store.add(&kept)).await?;
    Ok((StatusCode::CREATED, Json(FeedbackWire::new(number, &entry))))
}

fn handle(state: &ApiState) -> Result<&FeedbackHandle, ApiError> {
    let none = || ApiError::NotFound("this service has no store".to_owned());
    state.feedback.as_ref().ok_or_else(none)
}

fn text(field: &str, given: &str) -> Result<String, ApiError> {
    let found = given.trim().chars().count();
    if found > MAX_TEXT_CHARS {
        let problem =
            format!("{field} has {found} characters, at most {MAX_TEXT_CHARS} are allowed");
        return Err(ApiError::Invalid(problem));
    }
    Ok(given.trim().to_owned())
}

/// Whether what is said is whole.
fn check(
    finding: Finding,
    found: Option<FaultMode>,
    author: &str,
    note: &str,
) -> Result<(), ApiError> {
    let invalid = |why: &str| Err(ApiError::Invalid(why.to_owned()));
    if author.is_empty() {
        return invalid("the author must not be empty");
    }
    match (finding, found) {
        (Finding::OtherCause, None) if note.is_empty() => {
            invalid("say the cause that was found, as fault or in the note")
        }
        (Finding::OtherCause, _) | (_, None) => Ok(()),
        (Finding::Confirmed | Finding::Wrong, Some(_)) => invalid(
            "fault is the cause that was found instead: say it with the outcome other_cause",
        ),
    }
}

/// The verdict that stands on a component.
fn judgement(
    view: &MachineView,
    (kind, id): &(ComponentKind, String),
) -> Result<Judgement, ApiError> {
    let diagnosis = view.diagnosis.as_deref();
    let components = diagnosis.map_or(&[][..], |diagnosis| &diagnosis.components);
    let is_it =
        |one: &&crate::diagnosis::verdict::ComponentDiagnosis| one.kind == *kind && one.id == *id;
    let Some(one) = components.iter().find(is_it) else {
        let problem = format!("there is no verdict on a {} {id:?}", kind.name());
        return Err(ApiError::NotFound(problem));
    };
    Ok(Judgement {
        state: one.state,
        fault: one.fault,
        severity: one.severity,
        confidence: one.confidence,
        why: one.why.clone(),
        at: view.start_time.map(|start| start.plus_seconds(view.stream_time_s)),
        judged_by: view.judged_by.to_string(),
    })
}
