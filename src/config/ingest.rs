//! `[ingest]`: how senders of samples are let in.

use super::Access;
use super::raw;
use super::resolve::Resolver;
use std::net::Ipv4Addr;
use std::net::SocketAddr;

/// How senders of samples are let in.
#[derive(Debug, Clone, PartialEq)]
pub struct Ingest {
    /// Where they are listened to over TCP. Port 0: any free port.
    pub bind: SocketAddr,
    /// Senders at a time.
    pub max_connections: usize,
}

impl Default for Ingest {
    fn default() -> Self {
        let bind = SocketAddr::from((Ipv4Addr::LOCALHOST, 8081));
        Self { bind, max_connections: 256 }
    }
}

impl Resolver<'_> {
    pub(super) fn ingest(&mut self, raw: raw::Ingest, access: &Access) -> Ingest {
        let default = Ingest::default();
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
        self.check_exposure("ingest.bind", bind, access);
        let max_connections = raw.max_connections.unwrap_or(default.max_connections);
        Ingest { bind, max_connections }
    }
}
