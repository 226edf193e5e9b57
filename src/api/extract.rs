//! Path, query and body of a request; what does not fit becomes an [`ApiError`].

use super::error::ApiError;
use axum::extract::{FromRequest, FromRequestParts};
use serde::Deserialize;
use std::sync::Arc;
use utoipa::IntoParams;

/// The daemon as the caller may see it ([`super::entry`]).
#[derive(Debug)]
pub(super) struct State<T>(pub(super) Arc<T>);

/// Query string.
#[derive(Debug, FromRequestParts)]
#[from_request(via(axum::extract::Query), rejection(ApiError))]
pub(super) struct Query<T>(pub(super) T);

/// Variable parts of the path.
#[derive(Debug, FromRequestParts)]
#[from_request(via(axum::extract::Path), rejection(ApiError))]
pub(super) struct Path<T>(pub(super) T);

/// JSON body.
#[derive(Debug, FromRequest)]
#[from_request(via(axum::Json), rejection(ApiError))]
pub(super) struct Body<T>(pub(super) T);

/// Gives `value`, or `default` where it is absent, if it lies in `min..=max`.
///
/// # Errors
/// When it does not; the message names the allowed range.
pub(super) fn in_range<T: PartialOrd + std::fmt::Display>(
    name: &str,
    value: Option<T>,
    default: T,
    min: T,
    max: T,
) -> Result<T, ApiError> {
    let value = value.unwrap_or(default);
    // Not `value < min`: that would let NaN pass.
    if value >= min && value <= max {
        Ok(value)
    } else {
        Err(ApiError::Invalid(format!("{name} is {value}, allowed are {min} to {max}")))
    }
}

/// Cuts what was found, one more than `limit` where there is more, down to a page; gives the name behind which the
/// next page begins, none at the end.
pub(super) fn cut_page<T>(
    found: &mut Vec<T>,
    limit: usize,
    name: impl FnOnce(&T) -> String,
) -> Option<String> {
    let next = found.get(limit).and_then(|_| found.get(limit.checked_sub(1)?)).map(name);
    found.truncate(limit);
    next
}

/// Which page of a list that grows at its head.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub(super) struct PageQuery {
    /// Items a page.
    #[param(minimum = 1, maximum = 1000, default = 100)]
    limit: Option<usize>,
    /// `next` of the page before.
    after: Option<String>,
}

impl PageQuery {
    /// The number behind which the page begins and how many items it holds.
    pub(super) fn page(&self) -> Result<(u64, usize), ApiError> {
        Ok((cursor(self.after.as_deref())?, page_limit(self.limit)?))
    }
}

/// Items a page holds at most.
pub(super) const MAX_LIMIT: usize = 1000;

/// Items of a page: 100 where nothing is said.
pub(super) fn page_limit(limit: Option<usize>) -> Result<usize, ApiError> {
    in_range("limit", limit, 100, 1, MAX_LIMIT)
}

/// The number that the `next` of another page names; above all numbers where there is none.
pub(super) fn cursor(after: Option<&str>) -> Result<u64, ApiError> {
    let Some(after) = after else { return Ok(u64::MAX) };
    after.parse().map_err(|_| {
        ApiError::Invalid(format!("after is {after:?}, allowed is the `next` of another page"))
    })
}
