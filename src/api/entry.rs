//! Who comes in, and what of the daemon is there for them.
//!
//! Every request but those of the page and of `/livez` passes `enter`. What a handler sees is the [`ApiState`] as its
//! caller may see it: machines that a token is not of are not in it, so no handler can name them. Handlers cannot have the
//! other one: the router's state is `Shared`, which opens to this module alone.

use super::error::ApiError;
use super::extract::State;
use super::state::ApiState;
use crate::access::Role;
use crate::access::Token;
use axum::extract::ConnectInfo;
use axum::extract::FromRequestParts;
use axum::extract::MatchedPath;
use axum::extract::Request;
use axum::http::HeaderMap;
use axum::http::Method;
use axum::http::header;
use axum::http::request::Parts;
use axum::middleware::Next;
use axum::response::IntoResponse;
use axum::response::Response;
use std::convert::Infallible;
use std::net::IpAddr;
use std::net::SocketAddr;
use std::sync::Arc;

/// Where a request comes from; the server puts it there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Peer(pub SocketAddr);

/// The state of the router.
#[derive(Clone, Debug)]
pub(super) struct Shared(Arc<ApiState>);

/// Whose token it was.
#[derive(Clone)]
struct Caller(Arc<Token>);

impl Shared {
    pub(super) fn new(state: Arc<ApiState>) -> Self {
        Self(state)
    }
}

impl FromRequestParts<Shared> for State<ApiState> {
    type Rejection = Infallible;

    async fn from_request_parts(parts: &mut Parts, shared: &Shared) -> Result<Self, Infallible> {
        let Shared(all) = shared;
        Ok(Self(match parts.extensions.get::<Caller>() {
            None => Arc::clone(all),
            Some(Caller(token)) => Arc::new(all.seen_by(Arc::clone(token))),
        }))
    }
}

/// The role that a request takes, by method and path as it is registered.
pub(super) fn needed(method: &Method, path: &str) -> Role {
    let is_read = matches!(*method, Method::GET | Method::HEAD);
    match path {
        "/api/v1/ingest" => Role::Ingest,
        // Who did what is for those who act.
        "/api/v1/audit" | "/api/v1/configurations" => Role::Operator,
        // What it tells of the computer is for those who keep it.
        "/api/v1/log" => Role::Admin,
        _ if is_read => Role::Viewer,
        // What is normal, and what a simulation shows, is not a matter of a shift.
        "/api/v1/simulation/scenario"
        | "/api/v1/machines/{id}/baselines"
        | "/api/v1/machines/{id}/baselines/{bid}"
        | "/api/v1/machines/{id}/baselines/{bid}/activate" => Role::Admin,
        _ => Role::Operator,
    }
}

/// What is of all machines at once: no token of some of them has it.
fn is_of_all(path: &str) -> bool {
    matches!(path, "/metrics" | "/api/v1/log")
}

/// Where a request comes from.
pub(super) fn peer(request: &Request) -> Option<IpAddr> {
    request.extensions().get::<ConnectInfo<Peer>>().map(|ConnectInfo(Peer(peer))| peer.ip())
}

/// The token that a request says.
fn secret(headers: &HeaderMap) -> Option<&str> {
    let said = headers.get(header::AUTHORIZATION)?.to_str().ok()?;
    let (scheme, secret) = said.split_once(' ')?;
    scheme.eq_ignore_ascii_case("bearer").then(|| secret.trim())
}

/// Lets in who has a token that may do what is asked for. Before that nothing is said of what there is: not even
/// whether the path exists.
pub(super) async fn enter(
    axum::extract::State(state): axum::extract::State<Arc<ApiState>>,
    matched: Option<MatchedPath>,
    mut request: Request,
    next: Next,
) -> Response {
    let peer = peer(&request);
    let admitted = state.door.admit(secret(request.headers()), peer).and_then(|token| {
        state.door.pace(token.as_deref(), peer)?;
        Ok(token)
    });
    let token = match admitted {
        Ok(None) => return next.run(request).await,
        Ok(Some(token)) => token,
        Err(denied) => return ApiError::from(denied).into_response(),
    };
    let path = matched.as_ref().map_or("", MatchedPath::as_str);
    let needed = needed(request.method(), path);
    if !token.role().may(needed) {
        state.door.note_role(&token);
        let why = format!(
            "this takes a token with the role {}, and yours is {}",
            needed.name(),
            token.role().name()
        );
        return ApiError::Forbidden(why).into_response();
    }
    if token.is_restricted() && is_of_all(path) {
        state.door.note_role(&token);
        let why = "this is of all machines at once, and your token is of some".to_owned();
        return ApiError::Forbidden(why).into_response();
    }
    request.extensions_mut().insert(Caller(token));
    next.run(request).await
}
