//! Where a webhook goes: what an address may be.

use core::net::IpAddr;
use http::Uri;
use std::fmt;

/// A checked address. Its `Debug` and `Display` name the host alone: a path may be as good as a password.
#[derive(Clone, PartialEq, Eq)]
pub struct Endpoint {
    uri: Uri,
}

impl Endpoint {
    /// Reads an address. `https`, or `http` to this computer; `allows_plain`: `http` to others too.
    ///
    /// # Errors
    /// What is wrong and what is allowed, without the address's path.
    pub fn parse(text: &str, allows_plain: bool) -> Result<Self, String> {
        let uri: Uri = text.parse().map_err(|_| "the address is not a URL".to_owned())?;
        let host = uri.host().unwrap_or_default();
        if host.is_empty() {
            return Err("the address names no host, write https://HOST/PATH".to_owned());
        }
        if uri.authority().is_some_and(|authority| authority.as_str().contains('@')) {
            return Err("the address holds a user or password, use headers_file".to_owned());
        }
        match uri.scheme_str() {
            Some("https") => Ok(Self { uri }),
            Some("http") if allows_plain || is_this_computer(host) => Ok(Self { uri }),
            Some("http") => Err(format!(
                "http to {host} would be sent in the clear: use https, or plain_http = true in a network you \
                 trust"
            )),
            _ => {
                Err("the address must begin with https://, or http:// to this computer".to_owned())
            }
        }
    }

    /// Whether what is sent there is encrypted.
    #[must_use]
    pub fn encrypts(&self) -> bool {
        self.uri.scheme_str() == Some("https")
    }

    /// The whole address, for the one who sends.
    #[must_use]
    pub fn uri(&self) -> &Uri {
        &self.uri
    }
}

/// Whether a host is a loopback name or address.
fn is_this_computer(host: &str) -> bool {
    let literal = host.strip_prefix('[').and_then(|h| h.strip_suffix(']')).unwrap_or(host);
    match literal.parse::<IpAddr>() {
        Ok(address) => address.is_loopback(),
        Err(_) => host.eq_ignore_ascii_case("localhost"),
    }
}

impl fmt::Display for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let scheme = self.uri.scheme_str().unwrap_or_default();
        let authority = self.uri.authority().map_or("", |authority| authority.as_str());
        write!(f, "{scheme}://{authority}")
    }
}

impl fmt::Debug for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Endpoint({self})")
    }
}
