//! One token: whose it is, what it may do, how it is known.

use crate::signal::Timestamp;
use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use sha2::Digest;
use sha2::Sha256;
use std::fmt;

/// Random bytes of a secret.
const SECRET_BYTES: usize = 32;

/// What every secret begins with: programs that look for secrets in texts find it by that.
const PREFIX: &str = "rotorwatch_";

/// Most characters of a label, and machines of a token.
const MAX_LABEL_CHARS: usize = 64;
const MAX_MACHINES: usize = 100;

/// What a token may do. Each of the first three may do what those before it may.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    /// Sends samples, and nothing else.
    Ingest,
    /// Sees everything but who did what.
    Viewer,
    /// Acts on alarms, silences, captures.
    Operator,
    /// Decides what is normal; may do everything.
    Admin,
}

impl Role {
    /// Every role.
    pub const ALL: [Self; 4] = [Self::Viewer, Self::Operator, Self::Admin, Self::Ingest];

    /// As it is written.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Ingest => "ingest",
            Self::Viewer => "viewer",
            Self::Operator => "operator",
            Self::Admin => "admin",
        }
    }

    /// Reads a name.
    #[must_use]
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|role| role.name() == name)
    }

    /// Whether it may do what takes `needed`.
    #[must_use]
    pub fn may(self, needed: Self) -> bool {
        match needed {
            Self::Ingest => matches!(self, Self::Ingest | Self::Admin),
            Self::Viewer | Self::Operator | Self::Admin => self >= needed,
        }
    }
}

/// A new secret; told once.
#[derive(Clone, PartialEq, Eq)]
pub struct Secret(String);

impl Secret {
    /// Of random bytes, which must come from the operating system.
    #[must_use]
    pub fn of(random: &[u8; SECRET_BYTES]) -> Self {
        Self(format!("{PREFIX}{}", URL_SAFE_NO_PAD.encode(random)))
    }

    /// The text that is told, once.
    #[must_use]
    pub fn reveal(&self) -> &str {
        &self.0
    }
}

impl fmt::Debug for Secret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Secret")
    }
}

/// SHA-256 of a secret. Secrets are random and long: nothing is gained by a slow hash, and a table of them is no use.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) struct Fingerprint([u8; 32]);

impl Fingerprint {
    /// Of what somebody says.
    pub(super) fn of(text: &str) -> Self {
        Self(Sha256::digest(text.as_bytes()).into())
    }

    /// Reads 64 hexadecimal digits.
    pub(super) fn parse(hex: &str) -> Option<Self> {
        if hex.len() != 64 || !hex.bytes().all(|byte| byte.is_ascii_hexdigit()) {
            return None;
        }
        let mut bytes = [0; 32];
        for (i, byte) in bytes.iter_mut().enumerate() {
            *byte = u8::from_str_radix(hex.get(2 * i..2 * i + 2)?, 16).ok()?;
        }
        Some(Self(bytes))
    }

    /// As it is written.
    pub(super) fn hex(self) -> String {
        self.0.iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// Whether both are the same; the time it takes says nothing of where they differ.
    pub(super) fn is(self, other: Self) -> bool {
        self.0.iter().zip(other.0).fold(0, |different, (a, b)| different | (a ^ b)) == 0
    }
}

/// Why a token cannot be.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TokenError {
    /// The label is none.
    #[error(
        "a label has 1 to {MAX_LABEL_CHARS} characters, none of them a control character or at an end a space"
    )]
    Label,
    /// Machines are too many, or one has no name.
    #[error("a token is of at most {MAX_MACHINES} machines, each by its id")]
    Machines,
}

/// A token, without its secret.
#[derive(Clone, PartialEq, Eq)]
pub struct Token {
    label: String,
    role: Role,
    machines: Vec<String>,
    created: Option<Timestamp>,
    expires: Option<Timestamp>,
    fingerprint: Fingerprint,
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Token").field("label", &self.label).field("role", &self.role).finish()
    }
}

impl Token {
    /// The token of a secret.
    ///
    /// # Errors
    /// When label or machines are not allowed.
    pub fn new(
        secret: &Secret,
        (label, role): (&str, Role),
        machines: &[String],
        (created, expires): (Option<Timestamp>, Option<Timestamp>),
    ) -> Result<Self, TokenError> {
        let fingerprint = Fingerprint::of(secret.reveal());
        Self::with(fingerprint, (label, role), machines, (created, expires))
    }

    pub(super) fn with(
        fingerprint: Fingerprint,
        (label, role): (&str, Role),
        machines: &[String],
        (created, expires): (Option<Timestamp>, Option<Timestamp>),
    ) -> Result<Self, TokenError> {
        let n_chars = label.chars().count();
        let is_label = (1..=MAX_LABEL_CHARS).contains(&n_chars)
            && label.trim() == label
            && !label.chars().any(char::is_control);
        if !is_label {
            return Err(TokenError::Label);
        }
        if machines.len() > MAX_MACHINES || machines.iter().any(String::is_empty) {
            return Err(TokenError::Machines);
        }
        let (label, machines) = (label.to_owned(), machines.to_vec());
        Ok(Self { label, role, machines, created, expires, fingerprint })
    }

    /// Whose it is: the author of what is done with it.
    #[must_use]
    pub fn label(&self) -> &str {
        &self.label
    }

    /// What it may do.
    #[must_use]
    pub fn role(&self) -> Role {
        self.role
    }

    /// The machines it is of; empty: all.
    #[must_use]
    pub fn machines(&self) -> &[String] {
        &self.machines
    }

    /// When it was made, UTC.
    #[must_use]
    pub fn created(&self) -> Option<Timestamp> {
        self.created
    }

    /// When it ends, UTC; `None`: never.
    #[must_use]
    pub fn expires(&self) -> Option<Timestamp> {
        self.expires
    }

    /// Whether there is a machine for it.
    #[must_use]
    pub fn sees(&self, machine: &str) -> bool {
        self.machines.is_empty() || self.machines.iter().any(|known| known == machine)
    }

    /// Whether it is of some machines only.
    #[must_use]
    pub fn is_restricted(&self) -> bool {
        !self.machines.is_empty()
    }

    /// Whether it is over.
    #[must_use]
    pub fn is_expired(&self, now: Timestamp) -> bool {
        self.expires.is_some_and(|expires| now >= expires)
    }

    pub(super) fn fingerprint(&self) -> Fingerprint {
        self.fingerprint
    }
}
