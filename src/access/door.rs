//! The door: says who comes in, and whether who is in may stay.

use super::buckets::Buckets;
use super::buckets::network;
use super::list::Tokens;
use super::token::Token;
use crate::signal::Timestamp;
use prometheus_client::metrics::counter::Counter;
use std::fmt;
use std::net::IpAddr;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::RwLock;

/// Longest text that is looked at as a secret, bytes.
const MAX_SECRET_BYTES: usize = 256;

/// Unknown tokens that a peer may try at once, and how many it gets back a second.
const FAILURES: (f64, f64) = (10.0, 0.2);

/// Requests that somebody may make at once, in seconds of what may come on and on.
const BURST_S: f64 = 4.0;

/// Requests a second that somebody may make unless the configuration says otherwise: a page with eight live plots makes 20.
pub const REQUESTS_A_SECOND: f64 = 500.0;

/// UTC, and seconds of a clock that only goes forward.
pub type Now = Arc<dyn Fn() -> (Timestamp, f64) + Send + Sync>;

/// Why somebody is not let in.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Denied {
    /// No token was said.
    #[error("a token is needed; say it as: authorization: Bearer TOKEN")]
    Missing,
    /// No token is like this.
    #[error("the token is not known here")]
    Unknown,
    /// It is over.
    #[error("the token has expired")]
    Expired,
    /// Too many requests, though with a right token or from an address that needs none.
    #[error("more requests than one may make; try again in {} s (server.max_requests_per_s)", after_s.ceil())]
    TooFast {
        /// When another is answered, s.
        after_s: f64,
    },
    /// Too many tokens of this peer that are not known.
    #[error("too many wrong tokens from this address; try again in {} s, a right one is let in at once", after_s.ceil())]
    TooMany {
        /// When another is answered, s.
        after_s: f64,
    },
}

/// Counts of those who were not let in, or not allowed, by reason.
#[derive(Debug, Clone, Default)]
pub struct Counters {
    /// No token.
    pub missing: Counter,
    /// An unknown one.
    pub unknown: Counter,
    /// One that is over.
    pub expired: Counter,
    /// Its role does not allow it.
    pub role: Counter,
    /// Answered with "too many" instead.
    pub limited: Counter,
    /// Answered with "too fast", though let in.
    pub fast: Counter,
}

/// Whose requests are counted together.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
enum Who {
    Token(String),
    Peer(IpAddr),
}

/// The door. Open as long as it has no tokens.
pub struct Door {
    tokens: RwLock<Option<Arc<Tokens>>>,
    failures: Mutex<Buckets<IpAddr>>,
    requests: Mutex<Buckets<Who>>,
    counters: Counters,
    now: Now,
}

impl fmt::Debug for Door {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Door").field("is_open", &self.is_open()).finish_non_exhaustive()
    }
}

impl Door {
    /// A door for these tokens; `None`: an open one.
    #[must_use]
    pub fn new(tokens: Option<Tokens>, counters: Counters, now: Now) -> Self {
        let tokens = RwLock::new(tokens.map(Arc::new));
        let failures = Mutex::new(Buckets::new(FAILURES.0, FAILURES.1));
        let requests = Mutex::new(Buckets::new(REQUESTS_A_SECOND * BURST_S, REQUESTS_A_SECOND));
        Self { tokens, failures, requests, counters, now }
    }

    /// Lets everybody make so many requests a second, and four times as many at once.
    #[must_use]
    pub fn with_requests(self, a_second: f64) -> Self {
        Self { requests: Mutex::new(Buckets::new(a_second * BURST_S, a_second)), ..self }
    }

    /// Counts a request of somebody who is let in: of a token together, else of a peer. Who is on this computer and needs
    /// no token is not held back: there is nobody to tell apart.
    ///
    /// # Errors
    /// When it is more than one may make.
    pub fn pace(&self, token: Option<&Token>, peer: Option<IpAddr>) -> Result<(), Denied> {
        let who = match (token, peer) {
            (Some(token), _) => Who::Token(token.label().to_owned()),
            (None, Some(peer)) if !peer.to_canonical().is_loopback() => Who::Peer(network(peer)),
            (None, _) => return Ok(()),
        };
        let mut requests = self.requests.lock().unwrap_or_else(PoisonError::into_inner);
        requests.take(who, (self.now)().1).map_err(|after_s| {
            self.counters.fast.inc();
            Denied::TooFast { after_s }
        })
    }

    /// One that is always open.
    #[must_use]
    pub fn open() -> Self {
        Self::new(None, Counters::default(), Arc::new(|| (Timestamp::default(), 0.0)))
    }

    fn tokens(&self) -> Option<Arc<Tokens>> {
        self.tokens.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Whether nobody needs a token.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.tokens().is_none()
    }

    /// Lets other tokens in from now on. An open door stays open, and one with tokens does not open: the address was bound
    /// for what it is.
    pub fn set(&self, tokens: Tokens) {
        let mut held = self.tokens.write().unwrap_or_else(PoisonError::into_inner);
        if let Some(held) = held.as_mut() {
            *held = Arc::new(tokens);
        }
    }

    /// Who somebody is by what is said; `None`: nobody needs to be anybody. A right token is let in however often its
    /// peer has failed, so that nobody can lock others out. Only an unknown token is a failure: who says none, or one that
    /// was right once, guesses nothing (a page that is opened does so), and is paced as those who are let in.
    ///
    /// # Errors
    /// When there is no such token.
    pub fn admit(
        &self,
        secret: Option<&str>,
        peer: Option<IpAddr>,
    ) -> Result<Option<Arc<Token>>, Denied> {
        let Some(tokens) = self.tokens() else { return Ok(None) };
        let (utc, now_s) = (self.now)();
        let denied = match secret.map(|secret| (secret.len() <= MAX_SECRET_BYTES, secret)) {
            None | Some((_, "")) => Denied::Missing,
            Some((false, _)) => Denied::Unknown,
            Some((true, secret)) => match tokens.find(secret) {
                Some(token) if token.is_expired(utc) => Denied::Expired,
                Some(token) => return Ok(Some(Arc::clone(token))),
                None => Denied::Unknown,
            },
        };
        let counted = match denied {
            Denied::Missing => &self.counters.missing,
            Denied::Unknown | Denied::TooMany { .. } | Denied::TooFast { .. } => {
                &self.counters.unknown
            }
            Denied::Expired => &self.counters.expired,
        };
        let n = counted.inc() + 1;
        // A flood of failures shall not flood the log: the counter has them all.
        if n <= 10 || n.is_power_of_two() {
            let peer = peer.map(|peer| peer.to_string()).unwrap_or_default();
            tracing::warn!(peer, why = %denied, n, "somebody was not let in");
        }
        if denied != Denied::Unknown {
            self.pace(None, peer)?;
            return Err(denied);
        }
        let Some(peer) = peer else { return Err(denied) };
        let mut failures = self.failures.lock().unwrap_or_else(PoisonError::into_inner);
        failures.take(network(peer), now_s).map_err(|after_s| {
            self.counters.limited.inc();
            Denied::TooMany { after_s }
        })?;
        Err(denied)
    }

    /// Counts somebody whose role did not allow what was asked for.
    pub fn note_role(&self, token: &Token) {
        let n = self.counters.role.inc() + 1;
        if n <= 10 || n.is_power_of_two() {
            let (label, role) = (token.label(), token.role().name());
            tracing::warn!(label, role, n, "a token's role does not allow what was asked for");
        }
    }

    /// Whether who came in so may stay: its token has neither been revoked nor changed, and is not over.
    #[must_use]
    pub fn holds(&self, who: Option<&Arc<Token>>) -> bool {
        let (tokens, Some(token)) = (self.tokens(), who) else { return self.is_open() };
        let is_held = |tokens: Arc<Tokens>| tokens.iter().any(|one| one == token);
        !token.is_expired((self.now)().0) && tokens.is_some_and(is_held)
    }
}
