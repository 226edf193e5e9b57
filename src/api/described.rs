//! What the document of the API says of every operation alike: its id, that it takes a token, of which role, and how it is
//! refused without one; and what OpenAPI asks for that no handler says.

use super::entry::needed;
use axum::http::{Method, StatusCode};
use std::collections::BTreeMap;
use utoipa::openapi::content::ContentBuilder;
use utoipa::openapi::path::{Operation, PathItem};
use utoipa::openapi::response::ResponseBuilder;
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityRequirement, SecurityScheme};
use utoipa::openapi::{Components, OpenApi, RefOr, Schema};

/// The scheme's name in the document.
const SCHEME: &str = "token";

/// Paths that are open to everybody.
const OPEN: [&str; 1] = ["/livez"];

/// Describes tokens, and who needs which.
pub(super) fn secure(document: &mut OpenApi) {
    let description = "An access token (`rotorwatch token create`). Needed where the daemon has tokens; without, \
                       everybody on its computer may do everything.";
    let scheme = HttpBuilder::new().scheme(HttpAuthScheme::Bearer).description(Some(description));
    let components = document.components.get_or_insert_with(Components::new);
    components.add_security_scheme(SCHEME, SecurityScheme::Http(scheme.build()));
    for (path, item) in &mut document.paths.paths {
        if OPEN.contains(&path.as_str()) {
            continue;
        }
        let PathItem { get, post, put, delete, .. } = item;
        for (method, operation) in
            [(Method::GET, get), (Method::POST, post), (Method::PUT, put), (Method::DELETE, delete)]
        {
            if let Some(operation) = operation {
                describe(operation, &method, path);
            }
        }
    }
}

/// Gives every operation an id of its own, every answer a description, and lets parts of a schema be joined with others.
pub(super) fn complete(document: &mut OpenApi) {
    for (path, item) in &mut document.paths.paths {
        let PathItem { get, post, put, delete, .. } = item;
        for (method, operation) in [("get", get), ("post", post), ("put", put), ("delete", delete)]
        {
            let Some(operation) = operation else { continue };
            operation.operation_id = Some(id_of(method, path));
            for (status, response) in &mut operation.responses.responses {
                if let RefOr::T(response) = response
                    && response.description.is_empty()
                {
                    response.description = meaning(status).to_owned();
                }
            }
        }
    }
    if let Some(components) = &mut document.components {
        join(&mut components.schemas);
    }
}

/// `GET /api/v1/machines/{id}/health` is `get_machines_id_health`.
fn id_of(method: &str, path: &str) -> String {
    let parts =
        path.trim_start_matches("/api/v1").split(['/', '.']).filter(|part| !part.is_empty());
    let parts = parts.map(|part| part.trim_matches(['{', '}']));
    std::iter::once(method).chain(parts).collect::<Vec<_>>().join("_")
}

/// What a status means.
fn meaning(status: &str) -> &'static str {
    let known = status.parse().ok().and_then(|code| StatusCode::from_u16(code).ok());
    known.and_then(|status| status.canonical_reason()).unwrap_or("An answer")
}

/// Objects that are parts of others (`allOf`) must not forbid what the other parts have: all of them together say what there is.
fn join(schemas: &mut BTreeMap<String, RefOr<Schema>>) {
    let mut parts = Vec::new();
    for schema in schemas.values() {
        let RefOr::T(Schema::OneOf(choice)) = schema else { continue };
        for one in &choice.items {
            let RefOr::T(Schema::AllOf(joined)) = one else { continue };
            let names = joined.items.iter().filter_map(|part| match part {
                RefOr::Ref(reference) => reference.ref_location.rsplit('/').next(),
                RefOr::T(_) => None,
            });
            parts.extend(names.map(str::to_owned));
        }
    }
    for name in parts {
        if let Some(RefOr::T(Schema::Object(object))) = schemas.get_mut(&name) {
            object.additional_properties = None;
        }
    }
}

fn describe(operation: &mut Operation, method: &Method, path: &str) {
    let role = needed(method, path).name();
    // Without tokens nothing is needed: an empty requirement is the other way in.
    operation.security = Some(vec![
        SecurityRequirement::new(SCHEME, Vec::<String>::new()),
        SecurityRequirement::default(),
    ]);
    let text = operation.description.take().unwrap_or_default();
    operation.description = Some(format!("{text}\n\nRole: {role}.").trim().to_owned());
    for (status, why) in [
        ("401", "No token, or none that is known".to_owned()),
        (
            "403",
            format!("The token's role is not {role} or above, or a page of another server asks"),
        ),
        (
            "429",
            "Too many failures of this address, or requests of this token or address".to_owned(),
        ),
    ] {
        operation.responses.responses.entry(status.to_owned()).or_insert_with(|| problem(why));
    }
}

fn problem(description: String) -> RefOr<utoipa::openapi::Response> {
    let schema = utoipa::openapi::Ref::from_schema_name("ProblemWire");
    let content = ContentBuilder::new().schema(Some(schema)).build();
    let response = ResponseBuilder::new()
        .description(description)
        .content("application/problem+json", content);
    RefOr::T(response.build())
}
