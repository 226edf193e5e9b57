//! How often a peer has failed: the answer gets slower to come by, the table does not grow.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::net::Ipv6Addr;

/// Failures that a peer may have at once, and how many it gets back a second.
const BURST: f64 = 10.0;
const A_SECOND: f64 = 0.2;

/// Peers that are remembered.
const MAX_PEERS: usize = 1024;

/// Failures of peers.
#[derive(Debug, Default)]
pub(super) struct Failures {
    /// What a peer has left, and when that was, s.
    peers: BTreeMap<IpAddr, (f64, f64)>,
}

impl Failures {
    /// Takes a failure in; `Err`: there are too many, with the seconds until the next is answered.
    pub(super) fn note(&mut self, peer: IpAddr, now_s: f64) -> Result<(), f64> {
        let peer = network(peer);
        if !self.peers.contains_key(&peer) && self.peers.len() >= MAX_PEERS {
            self.forget(now_s);
        }
        let (left, since_s) = self.peers.get(&peer).copied().unwrap_or((BURST, now_s));
        let left = (left + (now_s - since_s).max(0.0) * A_SECOND).min(BURST);
        let is_allowed = left >= 1.0;
        let left = if is_allowed { left - 1.0 } else { left };
        self.peers.insert(peer, (left, now_s));
        if is_allowed { Ok(()) } else { Err(((1.0 - left) / A_SECOND).max(1.0)) }
    }

    /// Forgets those who have all their failures back, and else the one that was quiet for longest.
    fn forget(&mut self, now_s: f64) {
        self.peers.retain(|_, (left, since_s)| *left + (now_s - *since_s) * A_SECOND < BURST);
        if self.peers.len() < MAX_PEERS {
            return;
        }
        let oldest =
            self.peers.iter().min_by(|a, b| a.1.1.total_cmp(&b.1.1)).map(|(peer, _)| *peer);
        if let Some(oldest) = oldest {
            self.peers.remove(&oldest);
        }
    }

    #[cfg(test)]
    pub(super) fn len(&self) -> usize {
        self.peers.len()
    }
}

/// Who counts as one peer: an address, or the /64 that a single computer has of IPv6.
fn network(peer: IpAddr) -> IpAddr {
    match peer.to_canonical() {
        IpAddr::V4(address) => IpAddr::V4(address),
        IpAddr::V6(address) => {
            let bits = u128::from(address) & (u128::MAX << 64);
            IpAddr::V6(Ipv6Addr::from(bits))
        }
    }
}
