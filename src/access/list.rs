//! The tokens of a daemon, and the text of the file that keeps them.

use super::token::Fingerprint;
use super::token::Role;
use super::token::Token;
use super::token::TokenError;
use crate::signal::Timestamp;
use serde::Deserialize;
use std::collections::BTreeSet;
use std::fmt::Write;
use std::sync::Arc;

/// Most tokens of a file.
pub const MAX_TOKENS: usize = 1000;

const HEAD: &str = "\
# Access tokens of rotorwatch, written by `rotorwatch token`. No secret can be made of what stands here, but who writes
# this file decides who may do what: chmod 600.
";

/// Why the text of a file is no list of tokens. None of what stands in it is told: it may be a secret in a wrong place.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ListError {
    /// It is no TOML, or has other keys.
    #[error(
        "line {line}: not a list of [[token]] with label, role, sha256 and optionally machines, created, expires"
    )]
    Text {
        /// Where, from 1.
        line: usize,
    },
    /// A token cannot be.
    #[error("token {number}: {source}")]
    Token {
        /// Which, from 1.
        number: usize,
        /// Why.
        source: TokenError,
    },
    /// A field of a token cannot be.
    #[error("token {number}: {field} is not {allowed}")]
    Field {
        /// Which token, from 1.
        number: usize,
        /// Its field.
        field: &'static str,
        /// What it may be.
        allowed: &'static str,
    },
    /// Two have the same label or secret.
    #[error("tokens {first} and {second} have the same {what}")]
    Double {
        /// One of them.
        first: usize,
        /// The other.
        second: usize,
        /// Label or secret.
        what: &'static str,
    },
    /// There are too many.
    #[error("more than {MAX_TOKENS} tokens")]
    TooMany,
}

/// The tokens of a daemon; none of them opens a door without one.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Tokens(Vec<Arc<Token>>);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawList {
    #[serde(default)]
    token: Vec<RawToken>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawToken {
    label: String,
    role: String,
    sha256: String,
    #[serde(default)]
    machines: Vec<String>,
    created: Option<String>,
    expires: Option<String>,
}

impl RawToken {
    fn read(self, number: usize) -> Result<Token, ListError> {
        let field = |field, allowed| ListError::Field { number, field, allowed };
        let role = Role::parse(&self.role)
            .ok_or(field("role", "\"viewer\", \"operator\", \"admin\" or \"ingest\""))?;
        let fingerprint = Fingerprint::parse(&self.sha256).ok_or(field(
            "sha256",
            "the 64 hexadecimal digits that `rotorwatch token create` writes",
        ))?;
        let time = |text: Option<String>, name| {
            let read = |text: String| text.parse::<jiff::Timestamp>().ok();
            let nanoseconds = |time: jiff::Timestamp| i64::try_from(time.as_nanosecond()).ok();
            let wrong = field(name, "a time such as 2027-01-01T00:00:00Z");
            text.map(|text| read(text).and_then(nanoseconds).map(Timestamp).ok_or(wrong))
                .transpose()
        };
        let times = (time(self.created, "created")?, time(self.expires, "expires")?);
        Token::with(fingerprint, (&self.label, role), &self.machines, times)
            .map_err(|source| ListError::Token { number, source })
    }
}

impl Tokens {
    /// Reads the text of a file.
    ///
    /// # Errors
    /// With the first mistake.
    pub fn parse(text: &str) -> Result<Self, ListError> {
        let raw: RawList = toml::from_str(text).map_err(|error| {
            let at = error.span().map_or(0, |span| span.start).min(text.len());
            let before = text.bytes().take(at);
            ListError::Text { line: 1 + before.filter(|byte| *byte == b'\n').count() }
        })?;
        if raw.token.len() > MAX_TOKENS {
            return Err(ListError::TooMany);
        }
        let numbered = (1..).zip(raw.token);
        let read = numbered.map(|(number, token)| token.read(number).map(Arc::new));
        let tokens = Self(read.collect::<Result<_, _>>()?);
        tokens.check_different()?;
        Ok(tokens)
    }

    fn check_different(&self) -> Result<(), ListError> {
        for (i, token) in self.0.iter().enumerate() {
            for (j, other) in self.0.iter().enumerate().take(i) {
                let what = if token.label() == other.label() {
                    "label"
                } else if token.fingerprint() == other.fingerprint() {
                    "secret"
                } else {
                    continue;
                };
                return Err(ListError::Double { first: j + 1, second: i + 1, what });
            }
        }
        Ok(())
    }

    /// The text of a file.
    #[must_use]
    pub fn text(&self) -> String {
        let quoted = |text: &str| toml::Value::String(text.to_owned()).to_string();
        let mut out = HEAD.to_owned();
        for token in &self.0 {
            let mut field = |name: &str, value: String| {
                // A text takes whatever is written into it.
                let _never = writeln!(out, "{name} = {value}");
            };
            field("\n[[token]]\nlabel", quoted(token.label()));
            field("role", quoted(token.role().name()));
            field("sha256", quoted(&token.fingerprint().hex()));
            if token.is_restricted() {
                let machines: Vec<String> = token.machines().iter().map(|id| quoted(id)).collect();
                field("machines", format!("[{}]", machines.join(", ")));
            }
            for (name, time) in [("created", token.created()), ("expires", token.expires())] {
                let time =
                    time.and_then(|time| jiff::Timestamp::from_nanosecond(time.0.into()).ok());
                if let Some(time) = time {
                    field(name, quoted(&time.to_string()));
                }
            }
        }
        out
    }

    /// All of them, in the order of the file.
    pub fn iter(&self) -> impl Iterator<Item = &Arc<Token>> {
        self.0.iter()
    }

    /// Adds one.
    ///
    /// # Errors
    /// When there is one of that label, or as many as may be.
    pub fn add(&mut self, token: Token) -> Result<(), ListError> {
        if self.0.len() >= MAX_TOKENS {
            return Err(ListError::TooMany);
        }
        self.0.push(Arc::new(token));
        self.check_different().inspect_err(|_| {
            self.0.pop();
        })
    }

    /// Takes one away by its label; says whether there was one.
    pub fn revoke(&mut self, label: &str) -> bool {
        let n_before = self.0.len();
        self.0.retain(|token| token.label() != label);
        self.0.len() < n_before
    }

    /// The token of a secret. Every one is looked at, whatever it begins with.
    pub(super) fn find(&self, secret: &str) -> Option<&Arc<Token>> {
        let said = Fingerprint::of(secret);
        self.0
            .iter()
            .fold(None, |found, one| if one.fingerprint().is(said) { Some(one) } else { found })
    }

    /// Labels of tokens, in their order.
    #[must_use]
    pub fn labels(&self) -> BTreeSet<&str> {
        self.0.iter().map(|token| token.label()).collect()
    }
}
