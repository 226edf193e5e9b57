//! `[ingest]`: how senders of samples are let in.

use super::raw;
use super::resolve::Resolver;
use sha2::Digest;
use sha2::Sha256;
use std::fmt;
use std::net::Ipv4Addr;
use std::net::SocketAddr;

/// Fewest characters of a token.
const MIN_TOKEN_CHARS: usize = 16;

/// Most tokens of a file.
const MAX_TOKENS: usize = 1000;

/// How senders of samples are let in.
#[derive(Debug, Clone, PartialEq)]
pub struct Ingest {
    /// Where they are listened to over TCP. Port 0: any free port.
    pub bind: SocketAddr,
    /// Tokens of which each sender must have one; empty: none is needed.
    pub tokens: Vec<Token>,
    /// Senders at a time.
    pub max_connections: usize,
}

impl Default for Ingest {
    fn default() -> Self {
        let bind = SocketAddr::from((Ipv4Addr::LOCALHOST, 8081));
        Self { bind, tokens: Vec::new(), max_connections: 256 }
    }
}

/// A token, known by its digest only: it cannot be shown.
#[derive(Clone, PartialEq, Eq)]
pub struct Token([u8; 32]);

impl Token {
    /// Of this text.
    #[must_use]
    pub fn new(text: &str) -> Self {
        Self(Sha256::digest(text.as_bytes()).into())
    }

    /// Whether a text is it; the time that takes says nothing of how much of it is right.
    #[must_use]
    pub fn is(&self, text: &str) -> bool {
        let other = Self::new(text);
        self.0.iter().zip(other.0).fold(0, |different, (a, b)| different | (a ^ b)) == 0
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token")
    }
}

impl Resolver<'_> {
    pub(super) fn ingest(&mut self, raw: raw::Ingest) -> Ingest {
        let default = Ingest::default();
        let tokens = raw.token_file.filter(|file| !file.is_empty()).map(|file| self.tokens(&file));
        let bind = raw.bind.and_then(|text| {
            let address = text.parse::<SocketAddr>();
            if address.is_err() {
                let message =
                    format!("{text:?} is not an address with port, such as \"127.0.0.1:8081\"");
                self.report("ingest.bind", message);
            }
            address.ok()
        });
        let bind = bind.unwrap_or(default.bind);
        if !bind.ip().is_loopback() && tokens.is_none() {
            let message = format!(
                "{bind} can be reached from other hosts: give ingest.token_file, or bind 127.0.0.1 or [::1]"
            );
            self.report("ingest.bind", message);
        }
        let max_connections = raw.max_connections.unwrap_or(default.max_connections);
        Ingest { bind, tokens: tokens.unwrap_or_default(), max_connections }
    }

    /// Reads a file with a token a line; no message says what stands in it.
    fn tokens(&mut self, file: &str) -> Vec<Token> {
        let path = self.base.join(file);
        let text = match self.read(&path) {
            Ok(text) => text,
            Err(error) => {
                let message = format!("{} cannot be read: {error}", path.display());
                self.report("ingest.token_file", message);
                return Vec::new();
            }
        };
        let is_token = |line: &&str| !line.is_empty() && !line.starts_with('#');
        let lines: Vec<&str> = text.lines().map(str::trim).filter(is_token).collect();
        let is_short = lines.iter().any(|line| line.chars().count() < MIN_TOKEN_CHARS);
        if lines.is_empty() || lines.len() > MAX_TOKENS || is_short {
            let message = format!(
                "{}: 1 to {MAX_TOKENS} tokens are needed, one a line, each of {MIN_TOKEN_CHARS} characters at least",
                path.display()
            );
            self.report("ingest.token_file", message);
        }
        lines.into_iter().map(Token::new).collect()
    }
}
