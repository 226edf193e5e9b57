//! The running daemon: starts the threads in order and ends them in bounded time.

use super::access;
use super::access::Guard;
use super::baselines::Watch;
use super::build;
use super::build::Plan;
use super::http;
use super::http::ReadinessCheck;
use super::link::ShardQueue;
use super::live;
use super::live::Hub;
use super::live::values::Listener;
use super::notify::Notifier;
use super::reload::Levers;
use super::reload::Reloader;
use super::shard::Heartbeat;
use super::start_error::StartError;
use super::stop::Stop;
use super::supervisor;
use super::supervisor::Moves;
use super::threads::Crew;
use super::threads::Threads;
use super::tls::Tls;
use crate::access::Door;
use crate::api::handles::MachineHandle;
use crate::api::handles::StoreHandle;
use crate::api::state;
use crate::api::view::ConfigurationView;
use crate::config::Config;
use crate::telemetry;
use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::net::TcpListener;
use std::path::Path;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::mpsc;
use std::time::Duration;
use tokio::runtime::Runtime;
use tokio::signal::unix::Signal;
use tokio::signal::unix::SignalKind;
use tokio::signal::unix::signal;
use tokio::sync::watch;
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

/// Threads of the HTTP runtime; the work is done by the shards.
const HTTP_THREADS: usize = 2;

/// Threads for spectra on demand.
const MAX_BLOCKING_THREADS: usize = 4;

/// How long shards and sources may take to end. With [`http::GRACE`], which runs before it, and
/// [`RUNTIME_GRACE`] after it, this stays below the five seconds promised.
const THREAD_GRACE: Duration = Duration::from_secs(2);

/// How long the runtime may take to end.
const RUNTIME_GRACE: Duration = Duration::from_millis(500);

/// A shard that has not come round for this long is stuck or hopelessly behind.
const STALE_AFTER: Duration = Duration::from_secs(10);

/// The running daemon.
pub struct Daemon {
    address: SocketAddr,
    /// Where senders are listened to.
    ingest: Option<SocketAddr>,
    handles: Vec<MachineHandle>,
    stop: Arc<Stop>,
    queues: Vec<Arc<ShardQueue>>,
    runtime: Runtime,
    server: JoinHandle<()>,
    notifier: Arc<Mutex<Notifier>>,
    /// What other settings move; `None`: somebody follows the configuration already.
    levers: Option<Levers>,
    config: Config,
    server_stop: CancellationToken,
    signals: Signals,
    threads: Threads,
}

impl fmt::Debug for Daemon {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Daemon").field("address", &self.address).finish_non_exhaustive()
    }
}

impl Daemon {
    /// Starts everything: sources are opened and memory is checked before the port is bound, and
    /// samples flow only after it.
    ///
    /// # Errors
    /// See [`StartError`].
    pub fn start(config: &Config) -> Result<Self, StartError> {
        let (stop, server_stop) = (Arc::new(Stop::default()), CancellationToken::new());
        let Ready {
            plan,
            runtime,
            http: (address, listener),
            senders,
            guard,
            hub,
            brokers,
            signals,
        } = Ready::of(config, &stop)?;
        let Guard { door, tls, warnings } = guard;
        let ingest = senders.as_ref().map(|(address, _)| *address);
        let open = hub.clone().filter(|_| senders.is_some());
        let (metrics_text, readiness) = (plan.metrics_text(hub.clone()), readiness(&plan));
        runtime.spawn(supervisor::feed(moves(&plan), server_stop.clone()));
        let Plan { shards, sources, handles, metrics, keeper, keeping, baselines, .. } = plan;
        let (events, feedback, mut notifier) = (plan.events, plan.feedback, plan.notify);
        let (links, in_force) = (plan.links, plan.in_force);
        let (trending, trends) = (plan.trending, plan.trends);
        let limits = Arc::clone(&trending.limits);
        let (writing, captures) = plan.captures.unzip();
        let descriptions = Arc::new(Mutex::new(super::baselines::descriptions(config)));
        let watch =
            Watch::new(&config.store.directory, handles.clone(), Arc::clone(&descriptions))?;
        let queues: Vec<_> = shards.iter().map(|shard| Arc::clone(&shard.queue)).collect();
        let crew = Crew {
            keeping,
            watch,
            trending,
            writing: writing.map(|plan| (plan, keeper.clock)),
            listening: hub.zip(senders.map(|(_, listener)| listener)),
            brokers,
            shards,
            sources,
        };
        let (threads, started) = crew.start(&metrics, &stop);
        let started =
            started.and_then(|()| notifier.start(runtime.handle(), &handles, &server_stop));
        if let Err(source) = started {
            queues.iter().for_each(|queue| queue.close());
            stop.set();
            return Err(system("threads for shards and sources", source));
        }
        let notifier = Arc::new(Mutex::new(notifier));
        let since = super::wall_clock();
        let hash = build::configuration_hash(config);
        let holds = ConfigurationView { hash, since, restart: Vec::new(), rejected: None };
        let (told, configuration) = watch::channel(holds);
        let levers = Levers {
            links,
            in_force,
            machines: handles.clone(),
            door: Arc::clone(&door),
            tls: tls.clone(),
            limits,
            baselines: Arc::clone(&baselines.store),
            descriptions,
            notifier: Arc::clone(&notifier),
            keeper: keeper.clone(),
            told,
            metrics: metrics.configuration(),
        };
        let settings = state::Settings {
            started_at: Some(since),
            is_encrypted: tls.is_some(),
            warnings,
            ..api_settings(config, address)
        };
        let max_connections = config.access.limits.max_connections;
        super::descriptors::provide(max_connections);
        state_capacities(config, &metrics, &queues);
        let listener = http::Patient::new(listener, events.stalled.clone(), max_connections)
            .with_tls(tls.as_ref())
            .counting_refused(metrics.access().connections_refused);
        let state = state::ApiState::new(handles.clone(), settings, metrics_text, readiness)
            .with_door(door)
            .with_store(StoreHandle { archive: keeper.archive, status: keeper.status })
            .with_baselines(baselines)
            .with_feedback(feedback)
            .with_log(telemetry::newest_log_lines)
            .with_events(events)
            .with_trends(trends)
            .with_captures(captures)
            .with_recordings(super::recording::root(config))
            .with_configuration(configuration)
            .with_ingest(open.map(live::pipe::handle));
        let router = http::measured(http::router(state), metrics.http());
        let server = runtime.spawn(http::serve(listener, router, server_stop.clone()));
        tracing::info!(%address, n_machines = handles.len(), n_shards = queues.len(), "started");
        Ok(Self {
            address,
            ingest,
            handles,
            stop,
            queues,
            runtime,
            server,
            notifier,
            levers: Some(levers),
            config: config.clone(),
            server_stop,
            signals,
            threads,
        })
    }

    /// Address of HTTP with its real port.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Address at which senders are listened to with its real port; `None`: no source has any.
    #[must_use]
    pub fn ingest_address(&self) -> Option<SocketAddr> {
        self.ingest
    }

    /// The machines, in the order of the configuration.
    #[must_use]
    pub fn machines(&self) -> &[MachineHandle] {
        &self.handles
    }

    /// Follows the configuration in `file`, of which the daemon was started: what is changed in it, or in the files it
    /// names, is taken over as far as that is possible, at once when SIGHUP comes.
    ///
    /// # Errors
    /// When the signal cannot be caught or the thread cannot be started.
    pub fn follow(&mut self, file: &Path) -> Result<(), StartError> {
        let Some(levers) = self.levers.take() else { return Ok(()) };
        let (ask, asked) = mpsc::sync_channel(1);
        let context = self.runtime.enter();
        let caught = signal(SignalKind::hangup());
        drop(context);
        let mut hangup = caught.map_err(|source| system("the signal SIGHUP", source))?;
        let stopped = self.server_stop.clone();
        let _detached = self.runtime.spawn(async move {
            loop {
                tokio::select! {
                    () = stopped.cancelled() => return,
                    came = hangup.recv() => if came.is_none() { return },
                }
                tracing::info!(signal = "SIGHUP", "the configuration is read again");
                // One that waits already is as good.
                let _waits = ask.try_send(());
            }
        });
        let reloader = Reloader::new(file.to_owned(), self.config.clone(), levers);
        let stop = Arc::clone(&self.stop);
        let started =
            self.threads.start("settings".to_owned(), move || reloader.run(&asked, &stop));
        started.map_err(|source| system("the thread for settings", source))
    }

    /// Waits for SIGTERM or SIGINT.
    pub fn wait_for_signal(&mut self) {
        let signals = &mut self.signals;
        let name = self.runtime.block_on(async {
            tokio::select! {
                _ = signals.terminate.recv() => "SIGTERM",
                _ = signals.interrupt.recv() => "SIGINT",
            }
        });
        tracing::info!(signal = name, "stopping");
    }

    /// Ends everything within five seconds: no new connections, sources, shards, open connections.
    /// Threads that do not end in time are left to the end of the process.
    pub fn stop(mut self) {
        // The store ends when nobody can send it anything any more.
        self.levers = None;
        self.server_stop.cancel();
        self.stop.set();
        let n_bytes: usize = self.queues.iter().map(|queue| queue.bytes()).sum();
        if n_bytes > 0 {
            tracing::info!(n_bytes, "blocks waiting in the queues were not analysed");
        }
        self.queues.iter().for_each(|queue| queue.close());
        if let Err(error) = self.runtime.block_on(self.server) {
            tracing::error!(%error, "http server panicked");
        }
        // While receivers are exchanged they end by themselves.
        let endings = self.notifier.try_lock().map_or_else(|_| Vec::new(), |mut n| n.endings());
        self.runtime.block_on(async {
            let goodbyes = async {
                for ended in endings {
                    // Told or dropped: it has ended.
                    let _ended = ended.await;
                }
            };
            if tokio::time::timeout(http::GRACE, goodbyes).await.is_err() {
                tracing::warn!("a receiver of notifications was left without goodbye");
            }
        });
        let n_left = self.threads.wait(THREAD_GRACE);
        if n_left > 0 {
            tracing::warn!(n_left, "threads did not end in time");
        }
        self.runtime.shutdown_timeout(RUNTIME_GRACE);
        tracing::info!("stopped");
    }
}

/// What a start needs and what can fail: all of it before the first thread.
struct Ready {
    plan: Plan,
    runtime: Runtime,
    http: (SocketAddr, tokio::net::TcpListener),
    senders: Option<(SocketAddr, TcpListener)>,
    guard: Guard,
    hub: Option<Arc<Hub>>,
    brokers: Vec<Listener>,
    signals: Signals,
}

impl Ready {
    fn of(config: &Config, stop: &Arc<Stop>) -> Result<Self, StartError> {
        let plan = build::plan(config)?;
        if plan.handles.is_empty() {
            tracing::warn!("no machine is configured, nothing will be monitored");
        }
        let runtime = runtime().map_err(|source| system("threads for http", source))?;
        let http = bind(config.bind, &runtime)?;
        let listens = plan.ports.iter().any(|port| port.live().listens);
        let senders = listens.then(|| bind_senders(config.ingest.bind)).transpose()?;
        let ingest = senders.as_ref().map(|(address, _)| *address);
        let guard = access::guard(config, (http.0, ingest), &plan.metrics.access())?;
        let hub = hub(config, &plan, (&guard.door, guard.tls.as_ref()), stop);
        let brokers = hub.as_ref().map(Hub::listeners).transpose()?.unwrap_or_default();
        let signals =
            Signals::catch(&runtime).map_err(|source| system("signal handlers", source))?;
        Ok(Self { plan, runtime, http, senders, guard, hub, brokers, signals })
    }
}

/// What takes senders' samples in, where any machine has them.
fn hub(
    config: &Config,
    plan: &Plan,
    (door, tls): (&Arc<Door>, Option<&Tls>),
    stop: &Arc<Stop>,
) -> Option<Arc<Hub>> {
    if plan.ports.is_empty() {
        return None;
    }
    let (ports, metrics) = (plan.ports.clone(), plan.metrics.ingest());
    let of_ingest = config.access.tls.as_ref().is_some_and(|tls| tls.of_ingest);
    let guard = (Arc::clone(door), tls.filter(|_| of_ingest).cloned());
    Some(Arc::new(Hub::new(&config.ingest, guard, ports, metrics, Arc::clone(stop))))
}

fn runtime() -> io::Result<Runtime> {
    tokio::runtime::Builder::new_multi_thread()
        .worker_threads(HTTP_THREADS)
        .max_blocking_threads(MAX_BLOCKING_THREADS)
        .thread_name("http")
        .enable_all()
        .build()
}

fn bind(
    address: SocketAddr,
    runtime: &Runtime,
) -> Result<(SocketAddr, tokio::net::TcpListener), StartError> {
    let _context = runtime.enter();
    let bound = TcpListener::bind(address).and_then(|listener| {
        listener.set_nonblocking(true)?;
        Ok((listener.local_addr()?, tokio::net::TcpListener::from_std(listener)?))
    });
    bound.map_err(|source| StartError::Bind { address, source })
}

/// Binds the port of senders.
fn bind_senders(address: SocketAddr) -> Result<(SocketAddr, TcpListener), StartError> {
    let bound = TcpListener::bind(address).and_then(|listener| {
        listener.set_nonblocking(true)?;
        Ok((listener.local_addr()?, listener))
    });
    bound.map_err(|source| StartError::BindSenders { address, source })
}

fn system(what: &'static str, source: io::Error) -> StartError {
    StartError::System { what, source }
}

/// What the interface may be asked, by the configuration.
fn api_settings(config: &Config, address: SocketAddr) -> state::Settings {
    let access = &config.access;
    state::Settings {
        hosts: access.hosts.clone(),
        cors_origins: access.cors_origins.clone(),
        max_streams: access.limits.max_event_streams,
        ..state::Settings::new(address)
    }
}

/// Tells how much there may be of what saturates.
fn state_capacities(config: &Config, metrics: &telemetry::Metrics, queues: &[Arc<ShardQueue>]) {
    let queue_bytes = queues.iter().map(|queue| queue.max_bytes()).max().unwrap_or(0);
    metrics.state_capacity("http_connections", config.access.limits.max_connections);
    metrics.state_capacity("event_streams", config.access.limits.max_event_streams);
    metrics.state_capacity("ingest_connections", config.ingest.max_connections);
    metrics.state_capacity("queue_bytes", queue_bytes);
}

/// Names the shards that do not come round, and why alarms cannot be stored.
fn readiness(plan: &Plan) -> ReadinessCheck {
    let status = Arc::clone(&plan.keeper.status);
    let trends = Arc::clone(&plan.trends.status);
    let heartbeats = heartbeats(plan);
    Arc::new(move || {
        let stale = heartbeats.iter().enumerate().filter(|(_, beat)| beat.age() > STALE_AFTER);
        stale
            .map(|(shard, beat)| {
                format!("shard {shard} has not moved for {} s", beat.age().as_secs())
            })
            .chain(status.failure().map(|why| format!("alarms cannot be stored: {why}")))
            .chain(trends.failure().map(|why| format!("trends cannot be stored: {why}")))
            .collect()
    })
}

fn heartbeats(plan: &Plan) -> Vec<Arc<Heartbeat>> {
    plan.shards.iter().map(|shard| Arc::clone(&shard.heartbeat)).collect()
}

/// Whether every shard comes round.
fn moves(plan: &Plan) -> Moves {
    let heartbeats = heartbeats(plan);
    Arc::new(move || heartbeats.iter().all(|beat| beat.age() <= STALE_AFTER))
}

/// The signals that end the daemon.
struct Signals {
    terminate: Signal,
    interrupt: Signal,
}

impl Signals {
    fn catch(runtime: &Runtime) -> io::Result<Self> {
        let _context = runtime.enter();
        Ok(Self {
            terminate: signal(SignalKind::terminate())?,
            interrupt: signal(SignalKind::interrupt())?,
        })
    }
}
