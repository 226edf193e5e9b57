//! HTTP: what the monitor knows, as JSON under `/api/v1` (OpenAPI 3.1 beside it).
//!
//! Reads the snapshots the shards publish and asks them for more; never blocks them. Routes and the
//! document come from one registration ([`routes`]), so they cannot drift. Must not decide anything
//! about machines: it shows, thins and converts.

pub mod handles;
pub mod view;
pub mod wire;
pub mod error;
pub mod state;
mod extract;
mod files;
pub mod entry;
mod conditional;
mod guard;
mod waiting;
mod described;
mod exposition;
mod machines;
mod recordings;
mod signals;
mod trends;
mod pairs;
mod points;
mod parameters;
mod turning;
mod bins;
mod recent;
mod spectra;
mod cwt;
mod joint;
mod orbit;
mod alarms;
mod acts;
mod silences;
mod maintenance;
mod feedback;
mod events;
mod live;
mod audit;
mod service;
mod system;
mod simulation;
mod ingest;
mod baselines;
mod captures;
#[cfg(test)]
mod played;
#[cfg(test)]
pub(crate) mod support;
#[cfg(test)]
mod tests;

use axum::Router;
use axum::extract::DefaultBodyLimit;
use axum::http::StatusCode;
use axum::middleware::{from_fn, from_fn_with_state};
use entry::Shared;
use error::ApiError;
use state::ApiState;
use std::sync::Arc;
use std::time::Duration;
use tower::ServiceBuilder;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::compression::CompressionLayer;
use tower_http::compression::predicate::{DefaultPredicate, NotForContentType, Predicate};
use tower_http::timeout::TimeoutLayer;
use utoipa::OpenApi;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

/// Longest body taken.
pub(crate) const MAX_BODY_BYTES: usize = 64 * 1024;

#[derive(OpenApi)]
#[openapi(
    info(
        title = "rotorwatch",
        description = "Condition monitor for gear-rotor-bearing drivetrains. Errors are problem \
                       details (RFC 9457); series are columns of equal length; numbers that are \
                       not finite are null.",
        license(name = "MIT OR Apache-2.0", identifier = "MIT OR Apache-2.0"),
    ),
    tags(
        (name = "service", description = "The daemon itself"),
        (name = "machines", description = "Machines and their health"),
        (name = "signals", description = "Waveforms, spectra, scalograms, trends"),
        (name = "alarms", description = "Alarms and operators' acts"),
        (name = "events", description = "What happens, as it happens"),
        (name = "audit", description = "Who did what, which configurations ran"),
        (name = "captures", description = "Raw data around alarms, to be judged again"),
        (name = "baselines", description = "What is normal of a machine, by operating state"),
        (name = "ingest", description = "Samples from senders on a network"),
        (name = "simulation", description = "Simulated sources and their damage"),
    ),
)]
struct Document;

/// Every route with its description, but `/livez`.
fn routes() -> OpenApiRouter<Shared> {
    OpenApiRouter::with_openapi(Document::openapi())
        .routes(routes!(service::readyz))
        .routes(routes!(service::metrics))
        .routes(routes!(system::system))
        .routes(routes!(service::log))
        .routes(routes!(service::openapi_json))
        .routes(routes!(machines::list))
        .routes(routes!(machines::describe))
        .routes(routes!(machines::health))
        .routes(routes!(machines::diagnosis))
        .routes(routes!(feedback::list, feedback::say))
        .routes(routes!(signals::channels))
        .routes(routes!(signals::waveform))
        .routes(routes!(trends::trend))
        .routes(routes!(trends::component))
        .routes(routes!(spectra::spectrum))
        .routes(routes!(cwt::cwt))
        .routes(routes!(joint::joint))
        .routes(routes!(orbit::orbit))
        .routes(routes!(alarms::list))
        .routes(routes!(alarms::history))
        .routes(routes!(alarms::show))
        .routes(routes!(alarms::load))
        .routes(routes!(acts::acknowledge))
        .routes(routes!(acts::shelve))
        .routes(routes!(acts::unshelve))
        .routes(routes!(acts::suppress))
        .routes(routes!(acts::unsuppress))
        .routes(routes!(acts::out_of_service))
        .routes(routes!(acts::return_to_service))
        .routes(routes!(acts::reset))
        .routes(routes!(silences::list, silences::announce))
        .routes(routes!(silences::revoke))
        .routes(routes!(maintenance::show, maintenance::begin, maintenance::end))
        .routes(routes!(events::follow))
        .routes(routes!(audit::list))
        .routes(routes!(audit::configurations))
        .routes(routes!(captures::list))
        .routes(routes!(captures::download))
        .routes(routes!(captures::request))
        .routes(routes!(recordings::list))
        .routes(routes!(recordings::download))
        .routes(routes!(baselines::list))
        .routes(routes!(baselines::show, baselines::remove))
        .routes(routes!(baselines::activate))
        .routes(routes!(ingest::connect))
        .routes(routes!(simulation::scenarios, simulation::change))
}

/// What takes longer than a request may.
fn slow_routes() -> OpenApiRouter<Shared> {
    OpenApiRouter::new().routes(routes!(captures::judge)).routes(routes!(baselines::learn))
}

/// Longest time of one of them.
const SLOW: Duration = Duration::from_secs(60);

/// `/livez` answers whatever the load.
fn live_routes() -> OpenApiRouter<Shared> {
    OpenApiRouter::new().routes(routes!(service::livez))
}

/// Gives the OpenAPI 3.1 document.
#[must_use]
pub fn openapi() -> utoipa::openapi::OpenApi {
    let mut document = routes().merge(slow_routes()).merge(live_routes()).into_openapi();
    described::secure(&mut document);
    described::complete(&mut document);
    document
}

/// Gives the OpenAPI document as indented JSON.
#[must_use]
pub fn openapi_text() -> String {
    // A document made of texts, numbers and lists always has a JSON form.
    openapi().to_pretty_json().unwrap_or_default() + "\n"
}

/// Gives the whole service: the API, and `pages` (the dashboard) under the same guards.
pub fn router(state: ApiState, pages: Router) -> Router {
    let state = Arc::new(state);
    let shared = Shared::new(Arc::clone(&state));
    // Paths that are not there are behind the door, too.
    let limited = Router::from(routes())
        .route_layer(from_fn(parameters::check))
        .with_state(shared.clone())
        .fallback(async || ApiError::of_status(StatusCode::NOT_FOUND))
        .layer(from_fn(conditional::conditional))
        .layer(from_fn_with_state(Arc::clone(&state), entry::enter))
        .merge(pages.layer(from_fn(conditional::conditional)))
        .layer(from_fn_with_state(Arc::clone(&state), guard::concurrency));
    let within = |longest| TimeoutLayer::with_status_code(StatusCode::SERVICE_UNAVAILABLE, longest);
    let slow = Router::from(slow_routes())
        .route_layer(from_fn(parameters::check))
        .with_state(shared.clone())
        .layer(from_fn_with_state(Arc::clone(&state), entry::enter))
        .layer(within(SLOW));
    let live =
        Router::from(live_routes()).route_layer(from_fn(parameters::check)).with_state(shared);
    let usual = limited.merge(live).layer(within(state.settings.request_timeout));
    // Outermost first.
    let guards = ServiceBuilder::new()
        .layer(from_fn(guard::headers))
        .layer(CompressionLayer::new().compress_when(
            DefaultPredicate::new().and(NotForContentType::const_new(files::CONTENT_TYPE)),
        ))
        .option_layer(guard::cors(&state.settings))
        .layer(from_fn(guard::problems))
        .layer(from_fn_with_state(Arc::clone(&state), waiting::waiting))
        .layer(from_fn_with_state(Arc::clone(&state), guard::origin))
        .layer(from_fn_with_state(state, guard::host))
        .layer(CatchPanicLayer::custom(guard::panicked))
        .layer(DefaultBodyLimit::max(MAX_BODY_BYTES));
    usual.merge(slow).layer(guards)
}
