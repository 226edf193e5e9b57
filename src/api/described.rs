//! What the document of the API says of every operation alike: that it takes a token, of which role, and how it is
//! refused without one.

use super::entry::needed;
use axum::http::Method;
use utoipa::openapi::content::ContentBuilder;
use utoipa::openapi::path::{Operation, PathItem};
use utoipa::openapi::response::ResponseBuilder;
use utoipa::openapi::security::{HttpAuthScheme, HttpBuilder, SecurityRequirement, SecurityScheme};
use utoipa::openapi::{Components, OpenApi, RefOr};

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
