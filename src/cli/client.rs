//! A running daemon, asked over its HTTP API: where it is, who asks, what it answers.

use super::secret;
use crate::app::client;
use crate::app::client::ClientError;
use crate::notify::endpoint::Endpoint;
use clap::Args;
use serde_json::Value;
use serde_json::json;
use std::io;
use std::path::PathBuf;
use ureq::Agent;

/// Address of a daemon with the usual configuration.
const URL: &str = "http://127.0.0.1:8080";

/// Longest time for one request, s.
const TIMEOUT_S: f64 = 15.0;

/// Longest answer that is read, bytes.
const MAX_ANSWER_BYTES: u64 = 64 << 20;

/// Most items of a page of the API.
const PAGE: usize = 1000;

/// Where a daemon is, and who asks it.
#[derive(Debug, Clone, Args)]
pub struct DaemonArguments {
    /// Address of the daemon: https, or http to this computer [default: http://127.0.0.1:8080].
    #[arg(long, global = true, value_name = "URL", env = "ROTORWATCH_URL")]
    pub url: Option<String>,
    /// Certificates (PEM) of the authorities to trust instead of the system's.
    #[arg(long, global = true, value_name = "FILE")]
    pub ca_file: Option<PathBuf>,
    /// File whose first line is the access token.
    #[arg(long, global = true, value_name = "FILE", env = "ROTORWATCH_TOKEN_FILE")]
    pub token_file: Option<PathBuf>,
}

/// Why the daemon did not answer, or what it refused.
#[derive(Debug, thiserror::Error)]
pub enum AskError {
    /// The address is none.
    #[error("--url: {0}")]
    Address(String),
    /// No connection can be tried.
    #[error("the daemon cannot be asked")]
    Client(#[from] ClientError),
    /// The token cannot be read.
    #[error("{}: the token cannot be read", file.display())]
    Token {
        /// The file.
        file: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// No answer.
    #[error("the daemon at {endpoint} {why}: is it running, and is --url right?")]
    NoAnswer {
        /// Where.
        endpoint: String,
        /// Why.
        why: &'static str,
    },
    /// It refused.
    #[error("{detail} (status {status})")]
    Refused {
        /// HTTP status.
        status: u16,
        /// What it says.
        detail: String,
    },
    /// The answer is none of this API.
    #[error("the answer of {endpoint} is none of a rotorwatch daemon")]
    Foreign {
        /// Where.
        endpoint: String,
    },
}

/// The daemon's API.
pub(super) struct Api {
    agent: Agent,
    /// Without a slash at its end.
    base: String,
    endpoint: Endpoint,
    /// What is said of who asks.
    token: Option<String>,
}

impl Api {
    /// A client of the daemon.
    ///
    /// # Errors
    /// When its address, a certificate or the token cannot be used.
    pub(super) fn new(arguments: &DaemonArguments) -> Result<Self, AskError> {
        let url = arguments.url.as_deref().unwrap_or(URL);
        let endpoint = Endpoint::parse(url, false).map_err(AskError::Address)?;
        let agent = client::agent(endpoint.encrypts(), arguments.ca_file.as_deref(), TIMEOUT_S)?;
        let base = url.trim_end_matches('/').to_owned();
        let token = arguments.token_file.as_ref().map(|file| {
            let read = secret::read(file);
            read.map_err(|source| AskError::Token { file: file.clone(), source })
        });
        let token = token.transpose()?.map(|token| format!("Bearer {token}"));
        Ok(Self { agent, base, endpoint, token })
    }

    fn url(&self, path: &[&str]) -> String {
        let path: String = path.iter().map(|part| format!("/{}", escaped(part))).collect();
        format!("{}/api/v1{path}", self.base)
    }

    fn signed<B>(&self, request: ureq::RequestBuilder<B>) -> ureq::RequestBuilder<B> {
        match &self.token {
            Some(token) => request.header("authorization", token),
            None => request,
        }
    }

    /// A document.
    ///
    /// # Errors
    /// When it is refused, or nobody answers.
    pub(super) fn get(&self, path: &[&str], query: &[(&str, &str)]) -> Result<Value, AskError> {
        let request = self.agent.get(self.url(path)).query_pairs(query.iter().copied());
        self.answer(self.signed(request).call())
    }

    /// A text that is no document, by its path from the root.
    ///
    /// # Errors
    /// When it is refused, or nobody answers.
    pub(super) fn text(&self, path: &str) -> Result<String, AskError> {
        let endpoint = self.endpoint.to_string();
        let no_answer = |error: ureq::Error| AskError::NoAnswer {
            endpoint: endpoint.clone(),
            why: client::why(&error),
        };
        let request = self.signed(self.agent.get(format!("{}{path}", self.base)));
        let mut answer = request.call().map_err(no_answer)?;
        let status = answer.status().as_u16();
        let text = answer.body_mut().with_config().limit(MAX_ANSWER_BYTES).read_to_string();
        let text = text.map_err(no_answer)?;
        if status < 300 {
            return Ok(text);
        }
        Err(self.refused(status, &serde_json::from_str(&text).unwrap_or_default()))
    }

    /// Whether the daemon does its work, and the problem if not.
    ///
    /// # Errors
    /// When it is refused, or nobody answers.
    pub(super) fn readiness(&self) -> Result<(bool, Value), AskError> {
        let request = self.agent.get(format!("{}/readyz", self.base));
        let (status, document) = self.document(self.signed(request).call())?;
        match status {
            200 => Ok((true, document)),
            503 => Ok((false, document)),
            _ => Err(self.refused(status, &document)),
        }
    }

    /// Has something done.
    ///
    /// # Errors
    /// When it is refused, or nobody answers.
    pub(super) fn post(&self, path: &[&str], body: &Value) -> Result<Value, AskError> {
        self.answer(self.signed(self.agent.post(self.url(path))).send_json(body))
    }

    /// The document of an answer, or what the daemon says against it.
    fn answer(
        &self,
        answer: Result<http::Response<ureq::Body>, ureq::Error>,
    ) -> Result<Value, AskError> {
        let (status, document) = self.document(answer)?;
        if status < 300 { Ok(document) } else { Err(self.refused(status, &document)) }
    }

    /// What the daemon says against it.
    fn refused(&self, status: u16, document: &Value) -> AskError {
        match document["detail"].as_str() {
            Some(detail) => AskError::Refused { status, detail: detail.to_owned() },
            None => AskError::Foreign { endpoint: self.endpoint.to_string() },
        }
    }

    /// Status and document of an answer, whatever the status.
    fn document(
        &self,
        answer: Result<http::Response<ureq::Body>, ureq::Error>,
    ) -> Result<(u16, Value), AskError> {
        let endpoint = self.endpoint.to_string();
        let no_answer = |error: ureq::Error| AskError::NoAnswer {
            endpoint: endpoint.clone(),
            why: client::why(&error),
        };
        let mut answer = answer.map_err(no_answer)?;
        let status = answer.status().as_u16();
        let text = answer.body_mut().with_config().limit(MAX_ANSWER_BYTES).read_to_string();
        let document: Result<Value, _> = serde_json::from_str(&text.map_err(no_answer)?);
        document.map(|document| (status, document)).map_err(|_| AskError::Foreign { endpoint })
    }

    /// All items, page by page, at most `limit`.
    ///
    /// # Errors
    /// When they are refused, or nobody answers.
    pub(super) fn pages(
        &self,
        path: &[&str],
        filters: &[(&str, Option<&String>)],
        limit: usize,
    ) -> Result<Value, AskError> {
        let mut items = Vec::new();
        let mut after: Option<String> = None;
        while items.len() < limit {
            let page = (limit - items.len()).min(PAGE).to_string();
            let set =
                filters.iter().filter_map(|(name, value)| Some((*name, value.as_ref()?.as_str())));
            let mut query: Vec<(&str, &str)> = set.collect();
            query.push(("limit", &page));
            query.extend(after.iter().map(|after| ("after", after.as_str())));
            let mut found = self.get(path, &query)?;
            let Value::Array(more) = found["items"].take() else {
                return Err(AskError::Foreign { endpoint: self.endpoint.to_string() });
            };
            items.extend(more);
            after = found["next"].as_str().map(str::to_owned);
            if after.is_none() {
                break;
            }
        }
        Ok(json!({ "items": items }))
    }
}

/// One part of a path.
fn escaped(part: &str) -> String {
    let mut text = String::with_capacity(part.len());
    for byte in part.bytes() {
        if byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_' | b'.' | b'~' | b':') {
            text.push(char::from(byte));
        } else {
            text.push_str(&format!("%{byte:02X}"));
        }
    }
    text
}

/// A text of a document without what could move a terminal's cursor; empty if there is none.
fn text_of(value: &Value) -> &str {
    value.as_str().unwrap_or_default()
}

/// A text of a document, on one line.
pub(super) fn shown(value: &Value) -> String {
    text_of(value).chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_one_part_of_a_path_and_texts_move_no_cursor() {
        assert_eq!(escaped("rig-1:12"), "rig-1:12");
        assert_eq!(escaped("a/../b?c#d ü"), "a%2F..%2Fb%3Fc%23d%20%C3%BC");
        assert_eq!(shown(&json!("a\u{1b}[2Jb\nc")), "a [2Jb c");
    }
}
