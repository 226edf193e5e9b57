//! How often somebody may do something: a few at once, then so many a second. The table does not grow.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::net::Ipv6Addr;

/// Those who are remembered.
const MAX_HELD: usize = 1024;

/// What everybody has left.
#[derive(Debug)]
pub(super) struct Buckets<K> {
    /// How many at once, and how many come back a second.
    burst: f64,
    a_second: f64,
    /// What is left, and when that was, s.
    held: BTreeMap<K, (f64, f64)>,
}

impl<K: Ord + Clone> Buckets<K> {
    /// With so many at once, and so many a second.
    pub(super) fn new(burst: f64, a_second: f64) -> Self {
        Self { burst, a_second, held: BTreeMap::new() }
    }

    /// Takes one; `Err`: there is none left, with the seconds until there is.
    pub(super) fn take(&mut self, who: K, now_s: f64) -> Result<(), f64> {
        if !self.held.contains_key(&who) && self.held.len() >= MAX_HELD {
            self.forget(now_s);
        }
        let (burst, a_second) = (self.burst, self.a_second);
        let (left, since_s) = self.held.entry(who).or_insert((burst, now_s));
        *left = (*left + (now_s - *since_s).max(0.0) * a_second).min(burst);
        *since_s = now_s;
        if *left >= 1.0 {
            *left -= 1.0;
            return Ok(());
        }
        Err(((1.0 - *left) / a_second).max(1.0))
    }

    /// Forgets those who have everything back, and else the one that was quiet for longest.
    fn forget(&mut self, now_s: f64) {
        let (burst, a_second) = (self.burst, self.a_second);
        self.held.retain(|_, (left, since_s)| *left + (now_s - *since_s) * a_second < burst);
        if self.held.len() < MAX_HELD {
            return;
        }
        let oldest = self.held.iter().min_by(|a, b| a.1.1.total_cmp(&b.1.1));
        if let Some(oldest) = oldest.map(|(who, _)| who.clone()) {
            self.held.remove(&oldest);
        }
    }

    #[cfg(test)]
    pub(super) fn len(&self) -> usize {
        self.held.len()
    }
}

/// Who counts as one peer: an address, or the /64 that a single computer has of IPv6.
pub(super) fn network(peer: IpAddr) -> IpAddr {
    match peer.to_canonical() {
        IpAddr::V4(address) => IpAddr::V4(address),
        IpAddr::V6(address) => {
            let bits = u128::from(address) & (u128::MAX << 64);
            IpAddr::V6(Ipv6Addr::from(bits))
        }
    }
}
