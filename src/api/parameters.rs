//! What may stand in the query of each path, as the OpenAPI document has it: all else is refused with what is allowed.
//!
//! Ranges are the handlers' own. Paths outside the API, which probes and collectors ask, take anything.

use super::error::ApiError;
use axum::extract::{MatchedPath, Query, Request};
use axum::http::Method;
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::sync::LazyLock;

/// Longest part of a request that is shown again, characters.
const SHOWN: usize = 100;

/// Parameters of an operation, by name, with what is allowed.
type Parameters = BTreeMap<String, Takes>;

/// Those of all operations, by path and method.
static OPERATIONS: LazyLock<BTreeMap<(String, String), Parameters>> = LazyLock::new(|| {
    // A document made of texts, numbers and lists always has a JSON form.
    let document = serde_json::to_value(super::openapi()).unwrap_or_default();
    let none = Map::new();
    let mut operations = BTreeMap::new();
    for (path, methods) in document["paths"].as_object().unwrap_or(&none) {
        for (method, operation) in methods.as_object().unwrap_or(&none) {
            let listed = operation["parameters"].as_array().map_or(&[][..], Vec::as_slice);
            let of_query = listed.iter().filter(|one| one["in"] == "query");
            let named = of_query.filter_map(|one| {
                Some((one["name"].as_str()?.to_owned(), Takes::of(&one["schema"])))
            });
            operations.insert((path.clone(), method.to_uppercase()), named.collect());
        }
    }
    operations
});

/// What a parameter takes.
#[derive(Debug, Clone, PartialEq)]
enum Takes {
    /// A whole number from 0 on; what is allowed in words.
    Whole(String),
    /// A number; what is allowed in words.
    Number(String),
    /// `true` or `false`.
    Flag,
    /// What the handler says.
    Other,
}

impl Takes {
    fn of(schema: &Value) -> Self {
        let range = |what: &str| match (&schema["minimum"], &schema["maximum"]) {
            (Value::Number(min), Value::Number(max)) => format!("allowed are {min} to {max}"),
            (Value::Number(min), _) => format!("allowed are {what}s from {min} on"),
            (_, _) => format!("allowed is a {what}"),
        };
        match schema["type"].as_str() {
            Some("integer") => Self::Whole(range("whole number")),
            Some("number") => Self::Number(range("number")),
            Some("boolean") => Self::Flag,
            Some(_) | None => Self::Other,
        }
    }

    /// What is allowed instead of `value`; `None`: it is.
    fn instead_of(&self, value: &str) -> Option<&str> {
        match self {
            Self::Whole(allowed) => value.parse::<u64>().is_err().then_some(allowed),
            Self::Number(allowed) => value.parse::<f64>().is_err().then_some(allowed),
            Self::Flag => {
                (!["true", "false"].contains(&value)).then_some("allowed are true and false")
            }
            Self::Other => None,
        }
    }
}

/// Refuses parameters that an operation of the API does not have, and values that are of another type.
pub(super) async fn check(path: MatchedPath, request: Request, next: Next) -> Response {
    let method = if request.method() == Method::HEAD { &Method::GET } else { request.method() };
    // Probes and collectors add parameters of their own to paths of the service, and are no users to be told.
    if !path.as_str().starts_with("/api/") {
        return next.run(request).await;
    }
    let operation = OPERATIONS.get(&(path.as_str().to_owned(), method.as_str().to_owned()));
    let said = Query::<Vec<(String, String)>>::try_from_uri(request.uri());
    // What cannot be read at all, and methods that there are not, are told by what comes behind.
    if let (Some(known), Ok(Query(said))) = (operation, said) {
        let wrong = said.iter().find_map(|(name, value)| wrong(known, name, value));
        if let Some(why) = wrong {
            return ApiError::Invalid(why).into_response();
        }
    }
    next.run(request).await
}

fn wrong(known: &Parameters, name: &str, value: &str) -> Option<String> {
    let short = |text: &str| text.chars().take(SHOWN).collect::<String>();
    let Some(takes) = known.get(name) else {
        let name = short(name);
        let all: Vec<&str> = known.keys().map(String::as_str).collect();
        return Some(match &all[..] {
            [] => format!("unknown parameter {name:?}: this path takes none"),
            all => format!("unknown parameter {name:?}, allowed are {}", all.join(", ")),
        });
    };
    let allowed = takes.instead_of(value)?;
    Some(format!("{name} is {:?}, {allowed}", short(value)))
}
