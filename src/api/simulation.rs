//! Simulated sources: what they simulate, and another scenario for one of them.

use super::error::ApiError;
use super::extract::{Body, State};
use super::handles::{MachineHandle, NotTaken, ScenarioRequest, SimulationHandle};
use super::state::{ApiState, newest};
use super::wire::problem::ProblemWire;
use super::wire::simulation::{ScenarioBody, SimulationListWire, SimulationWire};
use crate::simulator::scenario::ScenarioError;
use axum::Json;
use std::sync::Arc;
use tokio::sync::oneshot;

/// Says what the simulated sources simulate, and whether they keep their pace.
#[utoipa::path(
    get,
    path = "/api/v1/simulation/scenario",
    tag = "simulation",
    responses(
        (status = OK, body = SimulationListWire),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json",
         description = "No machine is simulated"),
    )
)]
pub(super) async fn scenarios(
    State(state): State<ApiState>,
) -> Result<Json<SimulationListWire>, ApiError> {
    let items: Vec<SimulationWire> = simulated(&state)
        .map(|(id, handle, simulation)| {
            let status = Arc::clone(&simulation.view.borrow());
            SimulationWire::new(id, &status, &newest(handle))
        })
        .collect();
    if items.is_empty() { Err(none_simulated()) } else { Ok(Json(SimulationListWire { items })) }
}

/// Damages a simulated machine, lets damage grow, heals it, or lets it turn at another speed.
#[utoipa::path(
    post,
    path = "/api/v1/simulation/scenario",
    tag = "simulation",
    request_body = ScenarioBody,
    responses(
        (status = OK, body = SimulationWire, description = "The simulation after the change"),
        (status = BAD_REQUEST, body = ProblemWire, content_type = "application/problem+json"),
        (status = NOT_FOUND, body = ProblemWire, content_type = "application/problem+json",
         description = "No machine is simulated, or no machine has the id"),
        (status = CONFLICT, body = ProblemWire, content_type = "application/problem+json",
         description = "The machine is not simulated, or its simulation has ended"),
        (status = PAYLOAD_TOO_LARGE, body = ProblemWire, content_type = "application/problem+json"),
        (status = UNSUPPORTED_MEDIA_TYPE, body = ProblemWire,
         content_type = "application/problem+json"),
        (status = SERVICE_UNAVAILABLE, body = ProblemWire,
         content_type = "application/problem+json"),
    )
)]
pub(super) async fn change(
    State(state): State<ApiState>,
    Body(body): Body<ScenarioBody>,
) -> Result<Json<SimulationWire>, ApiError> {
    let (id, handle, simulation) = chosen(&state, body.machine.as_deref())?;
    let (wanted, grow_s) = body.wanted().map_err(ApiError::Invalid)?;
    let turn_hz = body.shaft_speed_hz;
    let (reply, answer) = oneshot::channel();
    let ended = || ApiError::Conflict(format!("the simulation of {id:?} has ended"));
    (simulation.submit)(ScenarioRequest { wanted, grow_s, turn_hz, reply }).map_err(|refused| {
        match refused {
            NotTaken::Busy => ApiError::Busy("other scenarios are waiting"),
            NotTaken::Ended => ended(),
        }
    })?;
    let changed = match tokio::time::timeout(state.settings.reply_timeout, answer).await {
        Ok(Ok(changed)) => changed,
        Ok(Err(_)) => return Err(ended()),
        Err(_) => return Err(ApiError::Timeout),
    };
    let status = changed.map_err(|error: ScenarioError| ApiError::Invalid(error.to_string()))?;
    Ok(Json(SimulationWire::new(id, &status, &newest(handle))))
}

type Simulated<'s> = (&'s str, &'s MachineHandle, &'s SimulationHandle);

fn simulated(state: &ApiState) -> impl Iterator<Item = Simulated<'_>> {
    let machines = state.machines.iter();
    machines.filter_map(|(id, handle)| Some((id.as_str(), handle, handle.simulation.as_ref()?)))
}

/// The machine asked for, or the only one.
fn chosen<'s>(state: &'s ApiState, machine: Option<&str>) -> Result<Simulated<'s>, ApiError> {
    let all: Vec<Simulated<'s>> = simulated(state).collect();
    if all.is_empty() {
        return Err(none_simulated());
    }
    let ids = || all.iter().map(|(id, ..)| *id).collect::<Vec<_>>().join(", ");
    let Some(id) = machine else {
        return match &all[..] {
            [only] => Ok(*only),
            _ => Err(ApiError::Invalid(format!(
                "several machines are simulated, say which: {}",
                ids()
            ))),
        };
    };
    state.machine(id)?;
    let found = all.iter().find(|(known, ..)| *known == id).copied();
    found.ok_or_else(|| {
        ApiError::Conflict(format!("machine {id:?} is not simulated; simulated are: {}", ids()))
    })
}

fn none_simulated() -> ApiError {
    let text = "no machine is simulated; a source of kind = \"simulated\" in the configuration is";
    ApiError::NotFound(text.to_owned())
}
