//! The daemon's threads: what each does, and that their end has a limit.
//!
//! Must not know HTTP.

use super::Clock;
use super::baselines::Watch;
use super::build::ShardPlan;
use super::build::SourcePlan;
use super::build::Work;
use super::captures::CapturesPlan;
use super::keeper::KeeperPlan;
use super::live;
use super::live::Hub;
use super::live::values::Listener;
use super::shard;
use super::simulated;
use super::source;
use super::stop::Stop;
use super::trending::TrendPlan;
use crate::ingest::replay;
use crate::telemetry::Metrics;
use std::io;
use std::net::TcpListener;
use std::sync::Arc;
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

/// Everything that has a thread of its own.
pub(super) struct Crew {
    pub(super) keeping: KeeperPlan,
    pub(super) watch: Watch,
    pub(super) trending: TrendPlan,
    /// Who writes captures, if anybody.
    pub(super) writing: Option<(CapturesPlan, Clock)>,
    /// Where senders are listened to, if anywhere.
    pub(super) listening: Option<(Arc<Hub>, TcpListener)>,
    pub(super) brokers: Vec<Listener>,
    pub(super) shards: Vec<ShardPlan>,
    pub(super) sources: Vec<SourcePlan>,
}

impl Crew {
    /// Starts them, what is needed by others first. An error leaves those before it running, until `stop` and their queues' end.
    pub(super) fn start(self, metrics: &Metrics, stop: &Arc<Stop>) -> (Threads, io::Result<()>) {
        // Store, baselines, trends, captures, senders, and who follows the settings, later.
        let n_of_one = 6;
        let n_max = n_of_one + self.brokers.len() + self.shards.len() + self.sources.len();
        let mut threads = Threads::new(n_max);
        let started = self.start_in(&mut threads, metrics, stop);
        (threads, started)
    }

    fn start_in(
        self,
        threads: &mut Threads,
        metrics: &Metrics,
        stop: &Arc<Stop>,
    ) -> io::Result<()> {
        let Self { keeping, watch, trending, writing, listening, brokers, shards, sources } = self;
        threads.start("store".to_owned(), move || keeping.run())?;
        let stopped = Arc::clone(stop);
        threads.start("baselines".to_owned(), move || watch.run(&stopped))?;
        let stopped = Arc::clone(stop);
        threads.start("trends".to_owned(), move || trending.run(&stopped))?;
        if let Some((writing, clock)) = writing {
            threads.start("captures".to_owned(), move || writing.run(clock))?;
        }
        if let Some((hub, listener)) = listening {
            let stop = Arc::clone(stop);
            threads.start("senders".to_owned(), move || live::tcp::run(&listener, &hub, &stop))?;
        }
        for (i, broker) in brokers.into_iter().enumerate() {
            let stop = Arc::clone(stop);
            threads.start(format!("broker-{i}"), move || broker.run(&stop))?;
        }
        start_machines(threads, (shards, sources), metrics, stop)
    }
}

/// Starts the shards, then what feeds them.
fn start_machines(
    threads: &mut Threads,
    (shards, sources): (Vec<ShardPlan>, Vec<SourcePlan>),
    metrics: &Metrics,
    stop: &Arc<Stop>,
) -> io::Result<()> {
    for (number, plan) in (0_u64..).zip(shards) {
        let measured = metrics.shard(number);
        let ShardPlan { queue, mut machines, heartbeat } = plan;
        threads.start(format!("shard-{number}"), move || {
            shard::run(&queue, &mut machines, &heartbeat, &measured);
        })?;
    }
    for plan in sources {
        let stop = Arc::clone(stop);
        threads.start(format!("source-{}", plan.machine.id), move || {
            let SourcePlan { machine, work, link, recording, is_captured } = plan;
            match work {
                Work::Replay(settings) => {
                    let is_received = recording.is_some() || is_captured;
                    let mut open = || {
                        let open =
                            if is_received { replay::open_with_received } else { replay::open };
                        open(&settings.file, &machine, &settings.hints)
                    };
                    source::run(&settings, &mut open, &link, &stop, (recording, is_captured));
                }
                Work::Simulate(mut source, desk) => {
                    let kept = (recording, is_captured);
                    simulated::run(&machine.id, &mut source, &desk, &link, &stop, kept);
                }
            }
        })?;
    }
    Ok(())
}

/// Threads that tell when they have ended, so that waiting for them has a limit.
pub(super) struct Threads {
    n_running: usize,
    ended: mpsc::SyncSender<()>,
    endings: mpsc::Receiver<()>,
}

impl Threads {
    fn new(n_max: usize) -> Self {
        let (ended, endings) = mpsc::sync_channel(n_max);
        Self { n_running: 0, ended, endings }
    }

    pub(super) fn start(
        &mut self,
        name: String,
        work: impl FnOnce() + Send + 'static,
    ) -> io::Result<()> {
        let ended = Ended(self.ended.clone());
        let _detached = thread::Builder::new().name(name).spawn(move || {
            let _ended = ended;
            work();
        })?;
        self.n_running += 1;
        Ok(())
    }

    /// Waits until all have ended, at most `limit`; gives the number that has not.
    pub(super) fn wait(mut self, limit: Duration) -> usize {
        let deadline = super::now() + limit;
        while self.n_running > 0 {
            let left = deadline.saturating_duration_since(super::now());
            if self.endings.recv_timeout(left).is_err() {
                break;
            }
            self.n_running -= 1;
        }
        self.n_running
    }
}

/// Tells the end of its thread, by return or by panic.
struct Ended(mpsc::SyncSender<()>);

impl Drop for Ended {
    fn drop(&mut self) {
        // The channel has room for every thread; without a receiver nobody waits.
        let _nobody_waits = self.0.try_send(());
    }
}
