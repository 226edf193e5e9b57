//! What operators do to alarms.

use super::alarms::find;
use super::captures;
use super::error::ApiError;
use super::extract::{Body, Path, State};
use super::state::{ApiState, newest};
use super::view::ShardRequest;
use super::wire::alarms::{ActBody, AlarmWire, ShelveBody};
use super::wire::problem::ProblemWire;
use crate::alarms::{Act, Action};
use axum::Json;

/// Has the shard do it; answers when it is stored.
async fn act(
    state: &ApiState,
    id: &str,
    action: Action,
    body: ActBody,
) -> Result<Json<AlarmWire>, ApiError> {
    let (machine, alarm, handle) = find(state, id)?;
    let ActBody { author, comment } = body;
    let author = state.author(author);
    let act = Act { alarm, action, author, comment };
    let alarm = state.ask(handle, |reply| ShardRequest::Act { act, reply }).await??;
    let mut told = AlarmWire::new(machine, &alarm, newest(handle).start_time);
    // The act is done, whether or not its capture can be told.
    let _untold = captures::link(state, &mut [&mut told]).await;
    Ok(Json(told))
}

macro_rules! acts {
    ($($(#[doc = $doc:literal])+ $name:ident = $path:literal, $body:ty, $action:expr;)+) => {
        $(
            $(#[doc = $doc])+
            #[utoipa::path(
                post,
                path = $path,
                tag = "alarms",
                params(("id" = String, Path, description = "Alarm id, e.g. `rig-1:12`")),
                request_body = $body,
                responses(
                    (status = OK, body = AlarmWire,
                     description = "The alarm after the act, which is stored"),
                    (status = BAD_REQUEST, body = ProblemWire,
                     content_type = "application/problem+json"),
                    (status = NOT_FOUND, body = ProblemWire,
                     content_type = "application/problem+json"),
                    (status = CONFLICT, body = ProblemWire,
                     content_type = "application/problem+json",
                     description = "The act does not fit the alarm's state"),
                    (status = PAYLOAD_TOO_LARGE, body = ProblemWire,
                     content_type = "application/problem+json"),
                    (status = UNSUPPORTED_MEDIA_TYPE, body = ProblemWire,
                     content_type = "application/problem+json"),
                    (status = SERVICE_UNAVAILABLE, body = ProblemWire,
                     content_type = "application/problem+json",
                     description = "Not answered in time, or in effect but not stored yet"),
                )
            )]
            pub(super) async fn $name(
                State(state): State<ApiState>,
                Path(id): Path<String>,
                Body(body): Body<$body>,
            ) -> Result<Json<AlarmWire>, ApiError> {
                let read: fn($body) -> (Action, ActBody) = $action;
                let (action, body) = read(body);
                act(&state, &id, action, body).await
            }
        )+
    };
}

acts! {
    /// Acknowledges an alarm.
    acknowledge = "/api/v1/alarms/{id}/ack", ActBody, |body| (Action::Acknowledge, body);
    /// Puts an alarm on the shelf for a limited time.
    shelve = "/api/v1/alarms/{id}/shelve", ShelveBody, |body: ShelveBody| {
        let ShelveBody { author, comment, for_s } = body;
        (Action::Shelve { for_s }, ActBody { author, comment })
    };
    /// Takes an alarm off the shelf before its time.
    unshelve = "/api/v1/alarms/{id}/unshelve", ActBody, |body| (Action::Unshelve, body);
    /// Suppresses an alarm by design.
    suppress = "/api/v1/alarms/{id}/suppress", ActBody, |body| (Action::Suppress, body);
    /// Ends the suppression of an alarm.
    unsuppress = "/api/v1/alarms/{id}/unsuppress", ActBody, |body| (Action::Unsuppress, body);
    /// Takes an alarm out of service.
    out_of_service = "/api/v1/alarms/{id}/out-of-service", ActBody, |body| {
        (Action::TakeOutOfService, body)
    };
    /// Returns an alarm to service.
    return_to_service = "/api/v1/alarms/{id}/return", ActBody, |body| {
        (Action::ReturnToService, body)
    };
    /// Resets a latched alarm.
    reset = "/api/v1/alarms/{id}/reset", ActBody, |body| (Action::Reset, body);
}
