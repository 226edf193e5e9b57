//! The HTTP and TLS client of the program: who is trusted, and what a failure may say.

use rustls::RootCertStore;
use rustls_pki_types::CertificateDer;
use rustls_pki_types::pem::PemObject;
use std::io::ErrorKind;
use std::path::Path;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use ureq::Agent;
use ureq::tls::Certificate;
use ureq::tls::RootCerts;
use ureq::tls::TlsConfig;

/// Why no connection can be tried.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// Certificates cannot be read.
    #[error("no certificates of authorities can be read from {}", file.display())]
    Certificates {
        /// The file.
        file: PathBuf,
    },
    /// The system's certificates cannot be read.
    #[error(
        "the system has no certificates of authorities: install ca-certificates, or name a file"
    )]
    NoSystemCertificates,
    /// The TLS library refuses its own settings.
    #[error("TLS cannot be set up")]
    Tls(#[from] rustls::Error),
}

/// Who signs certificates that are accepted: those of `file`, or the system's.
fn authorities(file: Option<&Path>) -> Result<Vec<CertificateDer<'static>>, ClientError> {
    let Some(file) = file else {
        let found = rustls_native_certs::load_native_certs().certs;
        return if found.is_empty() { Err(ClientError::NoSystemCertificates) } else { Ok(found) };
    };
    let refused = || ClientError::Certificates { file: file.to_owned() };
    let read = CertificateDer::pem_file_iter(file).map_err(|_| refused())?;
    let found = read.collect::<Result<Vec<_>, _>>().map_err(|_| refused())?;
    if found.is_empty() { Err(refused()) } else { Ok(found) }
}

fn provider() -> Arc<rustls::crypto::CryptoProvider> {
    Arc::new(rustls::crypto::ring::default_provider())
}

/// TLS for protocols other than HTTP.
///
/// # Errors
/// When nobody can be trusted.
pub fn tls(ca_file: Option<&Path>) -> Result<Arc<rustls::ClientConfig>, ClientError> {
    let mut roots = RootCertStore::empty();
    roots.add_parsable_certificates(authorities(ca_file)?);
    let config = rustls::ClientConfig::builder_with_provider(provider())
        .with_safe_default_protocol_versions()?
        .with_root_certificates(roots)
        .with_no_client_auth();
    Ok(Arc::new(config))
}

/// A client of HTTP that follows no redirection, uses no proxy and takes any status as an answer. `encrypts`:
/// whether TLS is used at all.
///
/// # Errors
/// When nobody can be trusted.
pub fn agent(encrypts: bool, ca_file: Option<&Path>, timeout_s: f64) -> Result<Agent, ClientError> {
    let authorities = if encrypts { authorities(ca_file)? } else { Vec::new() };
    let authorities: Vec<Certificate<'static>> =
        authorities.iter().map(|one| Certificate::from_der(one).to_owned()).collect();
    let tls = TlsConfig::builder()
        .root_certs(RootCerts::from(authorities))
        .unversioned_rustls_crypto_provider(provider())
        .build();
    let config = Agent::config_builder()
        .tls_config(tls)
        .http_status_as_error(false)
        .max_redirects(0)
        .max_redirects_will_error(false)
        .proxy(None)
        .user_agent(concat!("rotorwatch/", env!("CARGO_PKG_VERSION")))
        .timeout_global(Duration::try_from_secs_f64(timeout_s).ok())
        .max_idle_connections(1)
        .build();
    Ok(config.into())
}

/// Why there was no answer; nothing of an address or a secret is in it.
#[must_use]
#[expect(clippy::wildcard_enum_match_arm, reason = "a library's errors may become more")]
pub fn why(error: &ureq::Error) -> &'static str {
    match error {
        ureq::Error::Timeout(_) => "does not answer in time",
        ureq::Error::HostNotFound => "its host is not found",
        ureq::Error::ConnectionFailed => "cannot be connected to",
        ureq::Error::Tls(_) | ureq::Error::Rustls(_) | ureq::Error::Pem(_) => {
            "its certificate or TLS is not accepted"
        }
        ureq::Error::Io(error) => why_io(error.kind()),
        _ => "cannot be asked",
    }
}

/// As [`why`], for a socket.
#[must_use]
#[expect(clippy::wildcard_enum_match_arm, reason = "a library's errors may become more")]
pub fn why_io(kind: ErrorKind) -> &'static str {
    match kind {
        ErrorKind::ConnectionRefused => "refuses the connection",
        ErrorKind::TimedOut => "does not answer in time",
        // The TLS library reports whom it does not trust so.
        ErrorKind::InvalidData => "its certificate or TLS is not accepted",
        _ => "the connection broke",
    }
}
