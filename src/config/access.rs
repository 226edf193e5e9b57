//! `[server]`: who may reach the daemon, by which names, with which tokens and certificate.

use super::raw;
use super::resolve::Resolver;
use crate::access::REQUESTS_A_SECOND;
use crate::access::Tokens;
use rustls::crypto::ring;
use rustls::sign::CertifiedKey;
use rustls_pki_types::CertificateDer;
use rustls_pki_types::PrivateKeyDer;
use rustls_pki_types::pem::PemObject;
use sha2::Digest;
use sha2::Sha256;
use std::fmt;
use std::fs;
use std::net::SocketAddr;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::sync::Arc;

/// Most names and origins.
const MAX_NAMES: usize = 100;

/// Whether an address that other hosts can reach may go without tokens.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Exposure {
    /// It may not.
    #[default]
    Guarded,
    /// Somebody said so on the command line.
    Insecure,
}

/// Who may reach the daemon.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Access {
    /// Tokens of which everybody must have one; `None`: nobody needs any.
    pub tokens: Option<TokenList>,
    /// How connections are encrypted; `None`: not at all.
    pub tls: Option<Tls>,
    /// Names by which it is asked besides those of this computer; with a port where only that one is meant.
    pub hosts: Vec<String>,
    /// Pages of these origins may ask it too.
    pub cors_origins: Vec<String>,
    /// How much of it there may be.
    pub limits: Limits,
    /// What the command line said.
    pub exposure: Exposure,
}

/// How much HTTP there may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Requests a second of one token, or of one address without.
    pub max_requests_per_s: f64,
    /// Connections open at a time.
    pub max_connections: usize,
    /// Streams of events open at a time.
    pub max_event_streams: usize,
}

impl Default for Limits {
    fn default() -> Self {
        let max_requests_per_s = REQUESTS_A_SECOND;
        Self { max_requests_per_s, max_connections: 768, max_event_streams: 256 }
    }
}

/// Tokens. They say nothing of what is judged, and are no part of a hash.
#[derive(Clone, PartialEq, Eq, Default)]
pub struct TokenList(pub Tokens);

impl fmt::Debug for TokenList {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Tokens")
    }
}

/// How connections are encrypted.
#[derive(Debug, Clone, PartialEq)]
pub struct Tls {
    /// What is shown to clients, and proven.
    pub identity: Identity,
    /// Whether senders over TCP must encrypt too.
    pub of_ingest: bool,
}

/// A certificate with its key; no part of a hash, and never shown.
#[derive(Clone)]
pub struct Identity {
    /// The chain and the key.
    pub certified: Arc<CertifiedKey>,
    /// Tells one identity from another.
    digest: [u8; 32],
}

impl PartialEq for Identity {
    fn eq(&self, other: &Self) -> bool {
        self.digest == other.digest
    }
}

impl fmt::Debug for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Identity")
    }
}

impl Identity {
    /// Of a chain, the server's own certificate first, and its key, both as PEM.
    ///
    /// # Errors
    /// Why they cannot be used; nothing of the key is told.
    pub fn of_pem(chain: &str, key: &str) -> Result<Self, String> {
        let certificates: Result<Vec<_>, _> =
            CertificateDer::pem_slice_iter(chain.as_bytes()).collect();
        let certificates = certificates.ok().filter(|found| !found.is_empty());
        let certificates = certificates.ok_or("cert_file holds no certificates (PEM)")?;
        let private = PrivateKeyDer::from_pem_slice(key.as_bytes());
        let private =
            private.map_err(|_| "key_file holds no private key (PEM: PKCS #8, PKCS #1 or SEC1)")?;
        let mut hash = Sha256::new();
        for certificate in &certificates {
            hash.update(certificate);
        }
        hash.update(private.secret_der());
        let certified = CertifiedKey::from_der(certificates, private, &ring::default_provider());
        let certified = certified.map_err(|error| {
            if matches!(error, rustls::Error::InconsistentKeys(_)) {
                return "the key is not that of the first certificate".to_owned();
            }
            format!("certificate and key cannot be used: {error}")
        })?;
        Ok(Self { certified: Arc::new(certified), digest: hash.finalize().into() })
    }
}

impl Resolver<'_> {
    /// Reads who may reach the daemon at `bind`.
    pub(super) fn access(&mut self, raw: &raw::Server, exposure: Exposure) -> Access {
        let tokens = raw.token_file.as_deref().filter(|file| !file.is_empty());
        let tokens = tokens.map(|file| TokenList(self.tokens(file)));
        let tls = self.tls(&raw.tls);
        let hosts = self.names(
            "server.hosts",
            &raw.hosts,
            is_host,
            "a host name, such as \"monitor.example.org\"",
        );
        let allowed = "an origin, such as \"https://dashboards.example.org\"";
        let cors_origins = self.names("server.cors_origins", &raw.cors_origins, is_origin, allowed);
        let usual = Limits::default();
        let limits = Limits {
            max_requests_per_s: raw.max_requests_per_s.unwrap_or(usual.max_requests_per_s),
            max_connections: raw.max_connections.unwrap_or(usual.max_connections),
            max_event_streams: raw.max_event_streams.unwrap_or(usual.max_event_streams),
        };
        if limits.max_event_streams > limits.max_connections {
            let (streams, connections) = (limits.max_event_streams, limits.max_connections);
            self.report(
                "server.max_event_streams",
                format!("{streams} is more than server.max_connections ({connections}): each stream is a connection"),
            );
        }
        Access { tokens, tls, hosts, cors_origins, limits, exposure }
    }

    /// Refuses an address that other hosts can reach, unless it needs tokens or somebody wants it so.
    pub(super) fn check_exposure(&mut self, key: &str, bind: SocketAddr, access: &Access) {
        let is_guarded = access.tokens.is_some() || access.exposure == Exposure::Insecure;
        if bind.ip().is_loopback() || is_guarded {
            return;
        }
        let message = format!(
            "{bind} can be reached from other hosts: make tokens (rotorwatch token create) and name their file in \
             server.token_file, or bind 127.0.0.1 or [::1]; `serve --insecure` lets everybody in"
        );
        self.report(key, message);
    }

    /// Reads a file that nobody else may change or see; `None`: it was reported.
    fn private(&mut self, key: &str, path: &Path) -> Option<String> {
        let text = match self.read(path) {
            Ok(text) => text,
            Err(error) => {
                self.report(key, format!("{} cannot be read: {error}", path.display()));
                return None;
            }
        };
        // Looked at after it was read: a file that is exchanged meanwhile is looked at again anyway.
        let mode = fs::metadata(path).map_or(0, |found| found.mode()) & 0o777;
        if mode & 0o027 != 0 {
            let message = format!(
                "{} has mode {mode:03o}, others may read or change it: chmod 600 (or 640 with a group of the daemon alone)",
                path.display()
            );
            self.report(key, message);
        }
        Some(text)
    }

    fn tokens(&mut self, file: &str) -> Tokens {
        let (key, path) = ("server.token_file", self.base.join(file));
        let Some(text) = self.private(key, &path) else { return Tokens::default() };
        Tokens::parse(&text).unwrap_or_else(|error| {
            self.report(key, format!("{}: {error}", path.display()));
            Tokens::default()
        })
    }

    fn tls(&mut self, raw: &raw::Tls) -> Option<Tls> {
        let key = "server.tls";
        let named = |file: &Option<String>| file.clone().filter(|file| !file.is_empty());
        let (cert_file, key_file) = match (named(&raw.cert_file), named(&raw.key_file)) {
            (None, None) => return None,
            (Some(cert_file), Some(key_file)) => (cert_file, key_file),
            (Some(_), None) | (None, Some(_)) => {
                self.report(key, "cert_file and key_file are both needed".to_owned());
                return None;
            }
        };
        let path = self.base.join(cert_file);
        let chain = self.read(&path).map_err(|error| {
            let message = format!("{} cannot be read: {error}", path.display());
            self.report("server.tls.cert_file", message);
        });
        let private = self.private("server.tls.key_file", &self.base.join(key_file));
        let identity = Identity::of_pem(&chain.ok()?, &private?);
        let identity = identity.map_err(|why| self.report(key, why)).ok()?;
        Some(Tls { identity, of_ingest: raw.ingest.unwrap_or(true) })
    }

    fn names(
        &mut self,
        key: &str,
        raw: &raw::Names,
        is_one: fn(&str) -> bool,
        allowed: &str,
    ) -> Vec<String> {
        let names = raw.list();
        if names.len() > MAX_NAMES {
            self.report(key, format!("{} names, allowed are {MAX_NAMES}", names.len()));
        }
        for wrong in names.iter().filter(|name| !is_one(name)) {
            self.report(key, format!("{wrong:?} is not {allowed}"));
        }
        names
    }
}

/// A name or address, with a port or without.
fn is_host(text: &str) -> bool {
    let parsed = text.parse::<http::uri::Authority>();
    parsed.is_ok_and(|authority| !authority.host().is_empty() && !text.contains('@'))
}

/// Scheme and host, and nothing behind them.
fn is_origin(text: &str) -> bool {
    let host = text.strip_prefix("https://").or_else(|| text.strip_prefix("http://"));
    host.is_some_and(|host| is_host(host) && !host.contains('/'))
}
