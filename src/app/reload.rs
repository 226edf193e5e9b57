//! Settings that change while the daemon runs: sees that files are others or is asked, reads, decides, hands out.
//!
//! What is read is taken over as a whole or refused as a whole: everything that can fail is done before anything is
//! changed. Shards take their part between two blocks. What waits for a restart is named. Must not know what a change
//! reaches; that is `config::change`.

use super::baselines;
use super::baselines::Descriptions;
use super::build::configuration_hash;
use super::keeper::Keeper;
use super::link::Input;
use super::link::Link;
use super::notify::Notifier;
use super::renewal::InForce;
use super::renewal::Renewed;
use super::stop::Stop;
use super::tls::Tls;
use super::trending;
use super::trending::NewLimits;
use crate::access::Door;
use crate::api::handles::MachineHandle;
use crate::api::view::ConfigurationView;
use crate::causes::with_causes;
use crate::config;
use crate::config::Config;
use crate::config::TokenList;
use crate::config::change;
use crate::config::change::Change;
use crate::config::change::Extent;
use crate::diagnosis::baseline::Baseline;
use crate::pipeline::Renewal;
use crate::store::BaselineStore;
use crate::store::ConfigurationEntry;
use crate::store::events::ConfigurationChange;
use crate::store::events::ConfigurationOutcome;
use crate::telemetry;
use crate::telemetry::ConfigurationMetrics;
use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::mpsc;
use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;
use std::time::SystemTime;
use tokio::sync::watch;

/// Time between two looks at the files. A change is taken up when they have not moved from one look to the next: an
/// editor, or a tool that writes several of them, has ended then.
const LOOK_EVERY: Duration = Duration::from_millis(500);

/// While what is on the disk is refused, files that are not known yet may be the cause: it is read again after so many
/// looks.
const READ_AGAIN_AFTER: u32 = 10;

/// Longest wait for a shard to take settings over.
const SHARD_TAKES: Duration = Duration::from_secs(10);

/// Mistakes told with an event, at most; all of them are in the log and in `/api/v1/system`.
const MAX_TOLD: usize = 5;

/// Longest text of an event, characters.
const MAX_TEXT_CHARS: usize = 2000;

/// What a change moves.
pub(super) struct Levers {
    /// In the order of the configuration.
    pub(super) links: Vec<Link>,
    /// In the same order.
    pub(super) in_force: Vec<watch::Sender<InForce>>,
    pub(super) machines: Vec<MachineHandle>,
    pub(super) door: Arc<Door>,
    pub(super) tls: Option<Tls>,
    pub(super) limits: NewLimits,
    pub(super) baselines: Arc<dyn BaselineStore>,
    pub(super) descriptions: Descriptions,
    pub(super) notifier: Arc<Mutex<Notifier>>,
    pub(super) keeper: Keeper,
    pub(super) told: watch::Sender<ConfigurationView>,
    pub(super) metrics: ConfigurationMetrics,
}

/// Follows the files of the configuration.
pub(super) struct Reloader {
    file: PathBuf,
    current: Config,
    restart: Vec<String>,
    /// Why the newest was refused.
    refused: Option<Vec<String>>,
    levers: Levers,
}

/// What tells a file from what it was: when it was changed, how long and which one it is; `None`: it is not there.
type Stamp = Option<(SystemTime, u64, u64)>;

fn stamp(file: &Path) -> Stamp {
    let found = fs::metadata(file).ok()?;
    Some((found.modified().ok()?, found.len(), found.ino()))
}

impl Reloader {
    pub(super) fn new(file: PathBuf, current: Config, levers: Levers) -> Self {
        Self { file, current, restart: Vec::new(), refused: None, levers }
    }

    /// Follows until the stop. `asked`: somebody wants the files read now; ends when nobody can ask any more.
    pub(super) fn run(mut self, asked: &mpsc::Receiver<()>, stop: &Stop) {
        let mut read = self.stamps();
        let mut seen = read.clone();
        let mut n_looks = 0;
        loop {
            let is_asked = match asked.recv_timeout(LOOK_EVERY) {
                Ok(()) => true,
                Err(RecvTimeoutError::Timeout) => false,
                Err(RecvTimeoutError::Disconnected) => return,
            };
            if stop.is_set() {
                return;
            }
            let now = self.stamps();
            n_looks += 1;
            let is_changed = now != read && now == seen;
            let is_again = self.refused.is_some() && n_looks >= READ_AGAIN_AFTER;
            seen = now;
            if is_asked || is_changed || is_again {
                n_looks = 0;
                self.read(is_asked || is_changed);
                // A file that changed while it was read is seen to have: its stamp is that of before.
                read = self.stamps();
                read.extend(seen.iter().map(|(file, stamp)| (file.clone(), *stamp)));
                read.retain(|file, _| self.files().any(|known| known == file));
                seen.clone_from(&read);
            }
        }
    }

    fn files(&self) -> impl Iterator<Item = &PathBuf> {
        std::iter::once(&self.file).chain(&self.current.files.0)
    }

    fn stamps(&self) -> BTreeMap<PathBuf, Stamp> {
        self.files().map(|file| (file.clone(), stamp(file))).collect()
    }

    /// Reads the files and takes them over, or says why not. `is_news`: that it is refused is told even if it was
    /// refused for the same reasons before.
    fn read(&mut self, is_news: bool) {
        let loaded = config::load_as(&self.file, self.current.access.exposure);
        let taken = match loaded {
            Ok(new) => self.take_over(new).map_err(|why| vec![why]),
            Err(errors) => Err(errors.0.iter().map(ToString::to_string).collect()),
        };
        match taken {
            Ok(()) => {
                self.refused = None;
                self.levers.metrics.failing.set(0);
                self.levers.told.send_modify(|view| view.rejected = None);
            }
            Err(problems) if is_news || self.refused.as_ref() != Some(&problems) => {
                self.refuse(problems);
            }
            Err(_) => {}
        }
    }

    fn refuse(&mut self, problems: Vec<String>) {
        for problem in &problems {
            tracing::error!(problem, "the configuration is refused, that of before holds");
        }
        let rest = problems.len().saturating_sub(MAX_TOLD);
        let rest = (rest > 0).then(|| format!("and {rest} more"));
        let told: Vec<String> = problems.iter().take(MAX_TOLD).cloned().chain(rest).collect();
        let outcome = ConfigurationOutcome::Rejected;
        let hash = configuration_hash(&self.current);
        let change = news(None, outcome, hash, &told.join("; "));
        self.levers.keeper.tell(vec![change], None);
        self.levers.metrics.rejected.inc();
        self.levers.metrics.failing.set(1);
        let rejected = Some((super::wall_clock(), problems.clone()));
        self.levers.told.send_modify(|view| view.rejected = rejected);
        self.refused = Some(problems);
    }

    /// Takes a configuration over.
    ///
    /// # Errors
    /// Why it cannot be; nothing has changed then.
    fn take_over(&mut self, new: Config) -> Result<(), String> {
        let change = change::between(&self.current, new);
        let prepared = self.prepare(&change)?;
        let is_same = change.applied.is_empty() && change.restart == self.restart;
        self.apply(&change, prepared);
        let Change { config, applied, restart, machines } = change;
        if is_same {
            tracing::info!("the configuration says what it said before");
            self.current = config;
            return Ok(());
        }
        let hash = configuration_hash(&config);
        let text = words(&applied, &restart);
        tracing::info!(hash, text, "the configuration is taken over");
        let mut changes = vec![news(None, ConfigurationOutcome::Applied, hash.clone(), &text)];
        for (entry, extent) in config.machines.iter().zip(&machines) {
            if let Extent::Rebuilt { parts, stale } = extent {
                let stale = if *stale { "; its baselines are stale" } else { "" };
                let text = format!("described otherwise: {}{stale}", parts.join(", "));
                let machine = Some(entry.machine.id.clone());
                changes.push(news(machine, ConfigurationOutcome::Rebuilt, hash.clone(), &text));
            }
        }
        let since = super::wall_clock();
        let version = env!("CARGO_PKG_VERSION").to_owned();
        let holds = ConfigurationEntry { hash: hash.clone(), version, since };
        self.levers.keeper.tell(changes, Some(holds));
        self.levers.metrics.applied.inc();
        self.levers.metrics.waiting.set(i64::try_from(restart.len()).unwrap_or(i64::MAX));
        let rejected = None;
        let shown = ConfigurationView { hash, since, restart: restart.clone(), rejected };
        self.levers.told.send_replace(shown);
        (self.current, self.restart) = (config, restart);
        Ok(())
    }

    /// Does everything that may fail: sees whether it fits, learns what must be learned anew, and last marks what is
    /// stale. Gives the healthy captures of each machine that is rebuilt.
    fn prepare(&self, change: &Change) -> Result<Vec<Baseline>, String> {
        let config = &change.config;
        if config.store != self.current.store {
            let n_channels =
                self.levers.machines.iter().map(|one| one.view.borrow().channels.len());
            trending::limits(config, n_channels.sum()).map_err(|error| with_causes(&error))?;
        }
        let notifier = self.levers.notifier.lock().unwrap_or_else(PoisonError::into_inner);
        notifier.check(&config.notify).map_err(|error| with_causes(&error))?;
        drop(notifier);
        let mut learned = Vec::new();
        for (entry, extent) in config.machines.iter().zip(&change.machines) {
            learned.push(match extent {
                Extent::Rebuilt { .. } => {
                    baselines::named(entry).map_err(|error| with_causes(&error))?
                }
                Extent::Untouched | Extent::Judged => Baseline::default(),
            });
        }
        for (entry, extent) in config.machines.iter().zip(&change.machines) {
            if let Extent::Rebuilt { parts, stale: true } = extent {
                let (store, machine) = (&*self.levers.baselines, entry.machine.id.as_str());
                let active = store.described(machine).map_err(|error| with_causes(&error))?;
                let ids: Vec<String> = active.into_iter().map(|(id, _)| id).collect();
                baselines::retire(store, machine, &ids, parts)
                    .map_err(|error| with_causes(&error))?;
            }
        }
        Ok(learned)
    }

    /// Hands everything out; nothing of it can be refused.
    fn apply(&self, change: &Change, learned: Vec<Baseline>) {
        let (old, new) = (&self.current, &change.config);
        if let Some(tokens) = new.access.tokens.as_ref().filter(|_| old.access != new.access) {
            tell_tokens(old.access.tokens.as_ref(), tokens);
            self.levers.door.set(tokens.0.clone());
        }
        if let Some((shown, tls)) = self.levers.tls.as_ref().zip(new.access.tls.as_ref()) {
            shown.show(&tls.identity);
        }
        if old.store != new.store {
            let (retention, max_bytes) = (new.store.trends, new.bytes_beside_captures());
            let mut limits = self.levers.limits.lock().unwrap_or_else(PoisonError::into_inner);
            *limits = Some(trending::Limits { retention, max_bytes });
        }
        if old.log != new.log {
            telemetry::set_log_level(new.log.name());
        }
        if old.notify != new.notify {
            let mut notifier = self.levers.notifier.lock().unwrap_or_else(PoisonError::into_inner);
            notifier.change(&new.notify);
        }
        let mut descriptions =
            self.levers.descriptions.lock().unwrap_or_else(PoisonError::into_inner);
        *descriptions = baselines::descriptions(new);
        drop(descriptions);
        let (config, hash) = (Arc::new(new.clone()), configuration_hash(new));
        let configuration: Arc<str> = hash.into();
        // Before the shards: a stream that is opened meanwhile is recorded as its shard will judge it.
        for (entry, in_force) in new.machines.iter().zip(&self.levers.in_force) {
            let (config, configuration) = (Arc::clone(&config), Arc::clone(&configuration));
            in_force.send_replace(InForce { config, entry: entry.clone(), configuration });
        }
        let (done, taken) = mpsc::sync_channel(self.levers.links.len().max(1));
        let mut n_told = 0;
        let machines = new.machines.iter().zip(&change.machines).zip(learned);
        for (link, ((entry, extent), baseline)) in self.levers.links.iter().zip(machines) {
            let renewal = match extent {
                Extent::Untouched => None,
                Extent::Judged => Some(Renewal::Judged),
                Extent::Rebuilt { .. } => Some(Renewal::Rebuilt),
            };
            let renewed = Renewed {
                config: Arc::clone(&config),
                configuration: Arc::clone(&configuration),
                entry: entry.clone(),
                renewal,
                baseline,
                done: done.clone(),
            };
            // Closed: the daemon is stopping.
            n_told += usize::from(link.send(Input::Renew(Box::new(renewed))).is_ok());
        }
        for _ in 0..n_told {
            if taken.recv_timeout(SHARD_TAKES).is_err() {
                tracing::warn!("a shard has not come to the settings yet, it takes them later");
                break;
            }
        }
    }
}

/// What is in effect and what waits for a restart, for people; neither: what waited was taken back.
fn words(applied: &[String], restart: &[String]) -> String {
    let (now, later) = (applied.join(", "), restart.join(", "));
    match (applied.is_empty(), restart.is_empty()) {
        (true, true) => "nothing waits for a restart any more".to_owned(),
        (false, true) => format!("in effect: {now}"),
        (true, false) => format!("waits for a restart: {later}"),
        (false, false) => format!("in effect: {now}; waits for a restart: {later}"),
    }
}

/// Says in the log whose tokens came and went.
fn tell_tokens(old: Option<&TokenList>, new: &TokenList) {
    let old = old.cloned().unwrap_or_default();
    let (before, now) = (old.0.labels(), new.0.labels());
    for label in now.difference(&before) {
        tracing::info!(label, "a token came");
    }
    for label in before.difference(&now) {
        tracing::info!(label, "a token was revoked");
    }
}

fn news(
    machine: Option<String>,
    outcome: ConfigurationOutcome,
    hash: String,
    text: &str,
) -> ConfigurationChange {
    let text = text.chars().take(MAX_TEXT_CHARS).collect();
    ConfigurationChange { machine, outcome, hash, text }
}

#[cfg(test)]
mod tests {
    use super::words;

    #[test]
    fn a_change_says_what_holds_and_what_waits_and_that_nothing_does_any_more() {
        let [none, log, bind] = [vec![], vec!["log".to_owned()], vec!["server.bind".to_owned()]];
        assert_eq!(words(&none, &none), "nothing waits for a restart any more");
        assert_eq!(words(&log, &none), "in effect: log");
        assert_eq!(words(&none, &bind), "waits for a restart: server.bind");
        assert_eq!(words(&log, &bind), "in effect: log; waits for a restart: server.bind");
    }
}
