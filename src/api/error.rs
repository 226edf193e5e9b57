//! What can go wrong with a request, and its status.
//!
//! Handlers return an [`ApiError`]; `guard::problems` writes the problem+json body (RFC 9457) for it
//! and for every other answer from status 400, so that no error leaves in another shape.

use super::view::ActFailure;
use crate::access::Denied;
use crate::alarms::ActionError;
use crate::diagnosis::baseline::signed::SignError;
use crate::store::StoreError;
use axum::extract::rejection::{JsonRejection, PathRejection, QueryRejection};
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};

/// Why a request was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ApiError {
    /// A value in path, query or body is not allowed.
    #[error("{0}")]
    Invalid(String),
    /// There is no such thing; says what there is.
    #[error("{0}")]
    NotFound(String),
    /// Nothing has been judged yet.
    #[error("{detail}")]
    NotJudged {
        /// When it will be, and where to look meanwhile.
        detail: String,
        /// What stands accused from before.
        standing: Vec<String>,
    },
    /// The path does not take this method.
    #[error("this path does not take this method; see the Allow header")]
    MethodNotAllowed,
    /// None of the formats asked for can be sent.
    #[error("{0}")]
    NotAcceptable(String),
    /// The thing is not in a state for this act.
    #[error("{0}")]
    Conflict(String),
    /// The body is too long.
    #[error("the body is longer than {max_bytes} bytes")]
    TooLarge {
        /// Longest body taken.
        max_bytes: usize,
    },
    /// A body must be JSON.
    #[error("the body must be JSON, with content-type: application/json")]
    UnsupportedMediaType,
    /// The Host header names another server (DNS rebinding); says which. Its own names are not for strangers.
    #[error(
        "the host {0:?} is not this server, which is asked by its address, as localhost, or by a name in server.hosts"
    )]
    ForeignHost(String),
    /// A page of another server wants something done.
    #[error("{0}")]
    ForeignOrigin(String),
    /// Nobody comes in without a token.
    #[error("{0}")]
    Unauthorised(Denied),
    /// The token's role does not allow it; says which does.
    #[error("{0}")]
    Forbidden(String),
    /// The daemon does not do its work; the reasons.
    #[error("the daemon is not ready")]
    NotReady(Vec<String>),
    /// An act took effect but could not be stored; says why.
    #[error("{0}; it will be stored when the store recovers")]
    NotStored(String),
    /// The store refused and nothing has changed; says why.
    #[error("{0}; nothing has changed")]
    StoreRefused(String),
    /// Too much to do; says of what.
    #[error("{0}; try again")]
    Busy(&'static str),
    /// No answer in time.
    #[error("no answer in time; try again")]
    Timeout,
    /// A fault of the daemon.
    #[error("a fault inside the daemon; its log says more")]
    Internal,
    /// Any other status of the HTTP library.
    #[error("{}", .0.canonical_reason().unwrap_or("refused"))]
    Other(StatusCode),
}

impl ApiError {
    /// Makes an error from a bare status.
    #[must_use]
    pub fn of_status(status: StatusCode) -> Self {
        match status {
            StatusCode::METHOD_NOT_ALLOWED => Self::MethodNotAllowed,
            StatusCode::NOT_FOUND => Self::NotFound("nothing is at this path".to_owned()),
            StatusCode::SERVICE_UNAVAILABLE => Self::Timeout,
            StatusCode::INTERNAL_SERVER_ERROR => Self::Internal,
            other => Self::Other(other),
        }
    }

    /// HTTP status.
    #[must_use]
    pub fn status(&self) -> StatusCode {
        match self {
            Self::Invalid(_) => StatusCode::BAD_REQUEST,
            Self::NotFound(_) | Self::NotJudged { .. } => StatusCode::NOT_FOUND,
            Self::MethodNotAllowed => StatusCode::METHOD_NOT_ALLOWED,
            Self::NotAcceptable(_) => StatusCode::NOT_ACCEPTABLE,
            Self::Conflict(_) => StatusCode::CONFLICT,
            Self::TooLarge { .. } => StatusCode::PAYLOAD_TOO_LARGE,
            Self::UnsupportedMediaType => StatusCode::UNSUPPORTED_MEDIA_TYPE,
            Self::ForeignHost(_) => StatusCode::MISDIRECTED_REQUEST,
            Self::Unauthorised(Denied::TooMany { .. } | Denied::TooFast { .. }) => {
                StatusCode::TOO_MANY_REQUESTS
            }
            Self::Unauthorised(_) => StatusCode::UNAUTHORIZED,
            Self::ForeignOrigin(_) | Self::Forbidden(_) => StatusCode::FORBIDDEN,
            Self::NotReady(_)
            | Self::NotStored(_)
            | Self::StoreRefused(_)
            | Self::Busy(_)
            | Self::Timeout => StatusCode::SERVICE_UNAVAILABLE,
            Self::Internal => StatusCode::INTERNAL_SERVER_ERROR,
            Self::Other(status) => *status,
        }
    }

    /// Stable name of the kind of problem and its title.
    #[must_use]
    pub fn kind(&self) -> (&'static str, &'static str) {
        match self {
            Self::Invalid(_) => ("invalid-request", "Request not allowed"),
            Self::NotFound(_) | Self::NotJudged { .. } => ("not-found", "Not found"),
            Self::MethodNotAllowed => ("method-not-allowed", "Method not allowed"),
            Self::NotAcceptable(_) => ("not-acceptable", "Format not available"),
            Self::Conflict(_) => ("conflict", "Not in this state"),
            Self::TooLarge { .. } => ("body-too-large", "Body too large"),
            Self::UnsupportedMediaType => ("unsupported-media-type", "Body is not JSON"),
            Self::ForeignHost(_) => ("foreign-host", "Host not served here"),
            Self::ForeignOrigin(_) => ("foreign-origin", "Page of another server"),
            Self::Unauthorised(Denied::TooMany { .. }) => {
                ("too-many-failures", "Too many failures")
            }
            Self::Unauthorised(Denied::TooFast { .. }) => {
                ("too-many-requests", "Too many requests")
            }
            Self::Unauthorised(_) => ("unauthorised", "A token is needed"),
            Self::Forbidden(_) => ("forbidden", "Not with this token"),
            Self::NotReady(_) => ("not-ready", "Not ready"),
            Self::NotStored(_) => ("not-stored", "In effect but not stored"),
            Self::StoreRefused(_) => ("store-refused", "Not stored, nothing has changed"),
            Self::Busy(_) => ("busy", "Busy"),
            Self::Timeout => ("timeout", "No answer in time"),
            Self::Internal => ("internal", "Fault inside the daemon"),
            Self::Other(_) => ("refused", "Request refused"),
        }
    }

    /// What says to a client how to come in (RFC 6750), or when.
    fn challenge(&self) -> Option<(header::HeaderName, HeaderValue)> {
        let value = match self {
            Self::Unauthorised(Denied::TooMany { after_s } | Denied::TooFast { after_s }) => {
                let after = HeaderValue::from_str(&format!("{:.0}", after_s.ceil())).ok()?;
                return Some((header::RETRY_AFTER, after));
            }
            Self::Unauthorised(Denied::Missing) => "Bearer realm=\"rotorwatch\"",
            Self::Unauthorised(_) => "Bearer realm=\"rotorwatch\", error=\"invalid_token\"",
            Self::Forbidden(_) => "Bearer realm=\"rotorwatch\", error=\"insufficient_scope\"",
            Self::Invalid(_)
            | Self::NotFound(_)
            | Self::NotJudged { .. }
            | Self::MethodNotAllowed
            | Self::NotAcceptable(_)
            | Self::Conflict(_)
            | Self::TooLarge { .. }
            | Self::UnsupportedMediaType
            | Self::ForeignHost(_)
            | Self::ForeignOrigin(_)
            | Self::NotReady(_)
            | Self::NotStored(_)
            | Self::StoreRefused(_)
            | Self::Busy(_)
            | Self::Timeout
            | Self::Internal
            | Self::Other(_) => return None,
        };
        Some((header::WWW_AUTHENTICATE, HeaderValue::from_static(value)))
    }

    /// Single faults, where there are several.
    #[must_use]
    pub fn errors(&self) -> &[String] {
        if let Self::NotReady(all) | Self::NotJudged { standing: all, .. } = self {
            all
        } else {
            &[]
        }
    }
}

impl IntoResponse for ApiError {
    fn into_response(self) -> Response {
        let mut response = self.status().into_response();
        if let Some((name, value)) = self.challenge() {
            response.headers_mut().insert(name, value);
        }
        response.extensions_mut().insert(self);
        response
    }
}

impl From<Denied> for ApiError {
    fn from(denied: Denied) -> Self {
        Self::Unauthorised(denied)
    }
}

impl From<QueryRejection> for ApiError {
    fn from(rejection: QueryRejection) -> Self {
        Self::Invalid(strip(&rejection.body_text(), "Failed to deserialize query string: "))
    }
}

impl From<PathRejection> for ApiError {
    fn from(rejection: PathRejection) -> Self {
        Self::Invalid(rejection.body_text())
    }
}

impl From<JsonRejection> for ApiError {
    fn from(rejection: JsonRejection) -> Self {
        match rejection.status() {
            StatusCode::PAYLOAD_TOO_LARGE => Self::TooLarge { max_bytes: super::MAX_BODY_BYTES },
            StatusCode::UNSUPPORTED_MEDIA_TYPE => Self::UnsupportedMediaType,
            _ => Self::Invalid(strip(
                &rejection.body_text(),
                "Failed to deserialize the JSON body into the target type: ",
            )),
        }
    }
}

impl From<ActionError> for ApiError {
    fn from(error: ActionError) -> Self {
        match error {
            ActionError::UnknownAlarm { .. } => Self::NotFound(error.to_string()),
            ActionError::AlreadyAcknowledged { .. } | ActionError::NotInState { .. } => {
                Self::Conflict(error.to_string())
            }
            ActionError::NoAuthor
            | ActionError::TextTooLong { .. }
            | ActionError::ShelvingTime { .. } => Self::Invalid(error.to_string()),
        }
    }
}

impl From<ActFailure> for ApiError {
    fn from(failure: ActFailure) -> Self {
        match failure {
            ActFailure::Refused(error) => error.into(),
            ActFailure::NotStored(_) => Self::NotStored(failure.to_string()),
        }
    }
}

impl From<SignError> for ApiError {
    fn from(error: SignError) -> Self {
        match error {
            SignError::Empty { .. } | SignError::States { .. } => Self::Conflict(error.to_string()),
            SignError::None | SignError::NoAuthor | SignError::TextTooLong { .. } => {
                Self::Invalid(error.to_string())
            }
        }
    }
}

impl From<StoreError> for ApiError {
    fn from(error: StoreError) -> Self {
        tracing::error!(%error, "the store cannot be read");
        Self::Internal
    }
}

fn strip(text: &str, prefix: &str) -> String {
    text.strip_prefix(prefix).unwrap_or(text).to_owned()
}
