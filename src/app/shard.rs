//! A shard: one thread that owns whole machines and takes their blocks and questions in turn.

use super::link::Input;
use super::link::ShardQueue;
use super::monitored::Monitored;
use super::queue::Popped;
use crate::pipeline::Plans;
use crate::telemetry::ShardMetrics;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::time::Duration;
use std::time::Instant;

/// Snapshots are published at least this often.
pub const PUBLISH_EVERY: Duration = Duration::from_millis(500);

/// When a shard last came round; HTTP's readiness asks.
#[derive(Debug)]
pub struct Heartbeat(Mutex<Instant>);

impl Heartbeat {
    /// A first beat.
    #[must_use]
    pub fn new() -> Self {
        Self(Mutex::new(super::now()))
    }

    /// Time since the last beat.
    #[must_use]
    pub fn age(&self) -> Duration {
        let last = *self.0.lock().unwrap_or_else(PoisonError::into_inner);
        super::now().saturating_duration_since(last)
    }

    fn beat(&self, now: Instant) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = now;
    }
}

impl Default for Heartbeat {
    fn default() -> Self {
        Self::new()
    }
}

/// Works until the queue is closed.
pub fn run(
    queue: &Arc<ShardQueue>,
    machines: &mut [Monitored],
    heartbeat: &Heartbeat,
    metrics: &ShardMetrics,
) {
    let mut publish_at = super::now();
    let mut plans = Plans::new();
    loop {
        let popped = queue.pop(publish_at);
        let begun = super::now();
        match popped {
            Popped::Item((machine, input)) => {
                if let Input::Block(_, arrived) = &input {
                    metrics.wait_s.observe(begun.saturating_duration_since(*arrived).as_secs_f64());
                }
                if let Some(machine) = machines.get_mut(machine) {
                    machine.note_taken();
                    machine.exchange_plans(&mut plans);
                    machine.take(input, queue.bytes());
                    machine.exchange_plans(&mut plans);
                }
            }
            Popped::Request((machine, request)) => {
                if let Some(machine) = machines.get_mut(machine) {
                    machine.answer(request, queue.bytes());
                }
            }
            Popped::Timeout => {}
            Popped::Closed => return machines.iter_mut().for_each(Monitored::end),
        }
        let now = super::now();
        heartbeat.beat(now);
        if now >= publish_at {
            let bytes = queue.bytes();
            metrics.queue_bytes.set(i64::try_from(bytes).unwrap_or(i64::MAX));
            for machine in &mut *machines {
                machine.tick(bytes);
            }
            publish_at = now + PUBLISH_EVERY;
        }
        metrics.busy_s.inc_by(super::now().saturating_duration_since(begun).as_secs_f64());
    }
}

/// Deals machines out to `n_shards` shards by load, samples a second; gives each one's shard.
///
/// Each goes to the least loaded shard so far, in the order of the ids: the same configuration
/// gives the same shards. `loads`: id and samples a second of each machine.
#[must_use]
pub fn assign(loads: &[(&str, f64)], n_shards: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..loads.len()).collect();
    order.sort_by_key(|&machine| loads[machine].0);
    let mut shard_loads = vec![0.0_f64; n_shards.max(1)];
    let mut shards = vec![0; loads.len()];
    for machine in order {
        let least = (1..shard_loads.len()).fold(0, |least, shard| {
            if shard_loads[shard] < shard_loads[least] { shard } else { least }
        });
        // A machine without a stream still costs something: it shall not pile up on one shard.
        shard_loads[least] += loads[machine].1.max(1.0);
        shards[machine] = least;
    }
    shards
}
