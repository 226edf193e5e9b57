//! File descriptors: each connection takes one, and a process is given 1024 unless it asks.

use rustix::process::Resource;
use rustix::process::Rlimit;
use rustix::process::getrlimit;
use rustix::process::setrlimit;

/// What the store, sources, senders and the log need beside connections.
const BESIDE: u64 = 256;

/// Asks for as many as `n_connections` need; says so if there are fewer.
pub(super) fn provide(n_connections: usize) {
    let needed = n_connections as u64 + BESIDE;
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    if current.is_none_or(|current| current >= needed) {
        return;
    }
    let wanted = maximum.map_or(needed, |maximum| maximum.min(needed));
    let asked = setrlimit(Resource::Nofile, Rlimit { current: Some(wanted), maximum });
    let has = if asked.is_ok() { wanted } else { current.unwrap_or(wanted) };
    if has < needed {
        tracing::warn!(
            has,
            needed,
            "fewer file descriptors than connections may need: raise LimitNOFILE of the unit or ulimit -n, or lower server.max_connections"
        );
    }
}
