//! Raw → validated: what no single key can tell (references, files, relations between keys).

use super::CAPTURES;
use super::Captures;
use super::Config;
use super::Exposure;
use super::Files;
use super::LogLevel;
use super::RECORDING;
use super::SourceConfig;
use super::Store;
use super::keys;
use super::machines::ReadMachine;
use super::raw;
use super::raw::Raw;
use super::scan::Scan;
use crate::alarms;
use crate::capture::hints::Hints;
use crate::capture::map::ChannelMap;
use crate::capture::recording::machine as recording;
use crate::diagnosis::rate;
use crate::ingest::replay;
use crate::ingest::simulated;
use crate::pipeline;
use crate::simulator::scenario;
use crate::simulator::scenario::Wanted;
use crate::simulator::scene::Scene;
use crate::simulator::scene::builtin;
use crate::store::trends::Retention;
use crate::units::Hz;
use crate::units::SourceUnit;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::fs;
use std::net::SocketAddr;
use std::path::Path;
use std::path::PathBuf;

/// Keys of a source that only one kind of it has.
const OF_REPLAY: &[&str] = &["file", "loop", "unit"];
const OF_SIMULATED: &[&str] = &["scene", "scenario", "seed"];
const OF_MQTT: &[&str] =
    &["host", "port", "tls", "ca_file", "client_id", "user", "password_file", "topics"];

/// Makes the configuration; mistakes go to `scan`, with defaults in their place.
pub(super) fn config(
    raw: Raw,
    base: &Path,
    scan: &mut Scan,
    variables: &BTreeMap<String, String>,
    exposure: Exposure,
) -> Config {
    let default = Config::default();
    let mut resolver = Resolver { base, scan, variables, files: Vec::new(), knows_machines: true };
    let max_bytes = raw.store.max_bytes.unwrap_or(default.store.max_bytes);
    let n_machines = raw.machine.len() as u64;
    let machines = resolver.machines(raw.machine, raw.source);
    let notify = resolver.receivers(raw.notify, &machines);
    let trends = retention(&raw.store, default.store.trends);
    let monitor = resolver.monitor(&raw.pipeline, &raw.alarms, default.monitor);
    let access = resolver.access(&raw.server, exposure);
    let bind = resolver.bind(raw.server.bind).unwrap_or(default.bind);
    resolver.check_exposure("server.bind", bind, &access);
    let config = Config {
        bind,
        ingest: resolver.ingest(raw.ingest, &access),
        access,
        store: Store {
            directory: base
                .join(raw.store.directory.map_or(default.store.directory, PathBuf::from)),
            max_bytes,
            trends,
        },
        recording: resolver.recording(&raw.recording, n_machines, max_bytes),
        captures: resolver.captures(&raw.captures, &monitor, max_bytes),
        workers: raw.pipeline.workers.unwrap_or(default.workers),
        memory_limit_bytes: raw.pipeline.memory_limit_bytes.unwrap_or(default.memory_limit_bytes),
        monitor: super::held_to(
            monitor.clone(),
            raw.diagnosis.false_alarms_per_component_year.unwrap_or(rate::A_COMPONENT_YEAR),
        ),
        lengthen_windows: raw.pipeline.lengthen_windows.unwrap_or(default.lengthen_windows),
        notify,
        log: resolver.log_level(raw.log.level),
        machines,
        files: Files::default(),
    };
    Config { files: Files(resolver.files), ..config }
}

/// What the steps share.
pub(super) struct Resolver<'a> {
    /// Folder that relative paths start from.
    pub(super) base: &'a Path,
    /// The file's places, and the mistakes so far.
    scan: &'a mut Scan,
    /// Variables that override keys.
    variables: &'a BTreeMap<String, String>,
    /// Files that were read.
    files: Vec<PathBuf>,
    /// Whether the ids of all machines are known: every machine file could be read.
    pub(super) knows_machines: bool,
}

impl Resolver<'_> {
    /// Reads a file, and notes that it was.
    pub(super) fn read(&mut self, file: &Path) -> std::io::Result<String> {
        self.files.push(file.to_owned());
        fs::read_to_string(file)
    }

    /// Notes a mistake where the value came from: the environment, else the file.
    pub(super) fn report(&mut self, path: &str, message: String) {
        let variable = path
            .rsplit_once('.')
            .and_then(|(section, name)| keys::find(section, name)?.variable())
            .filter(|variable| self.variables.contains_key(variable));
        match variable {
            Some(variable) => self.scan.problems.push(super::Problem {
                place: "environment".to_owned(),
                message: format!("{variable}: {message}"),
            }),
            None => self.scan.report(path, message),
        }
    }

    fn log_level(&mut self, text: Option<String>) -> LogLevel {
        let Some(text) = text else { return LogLevel::default() };
        LogLevel::parse(&text).unwrap_or_else(|| {
            let levels = LogLevel::ALL.map(|level| format!("{:?}", level.name())).join(", ");
            self.report("log.level", format!("{text:?} is no level: {levels}"));
            LogLevel::default()
        })
    }

    fn bind(&mut self, text: Option<String>) -> Option<SocketAddr> {
        let text = text?;
        let Ok(address) = text.parse::<SocketAddr>() else {
            self.report(
                "server.bind",
                format!("{text:?} is not an address with port, such as \"127.0.0.1:8080\""),
            );
            return None;
        };
        Some(address)
    }

    /// Checks that finished recordings can give way before those being written fill the store.
    fn recording(
        &mut self,
        raw: &raw::Recording,
        n_machines: u64,
        max_bytes: u64,
    ) -> Option<recording::Settings> {
        let default = RECORDING;
        let settings = recording::Settings {
            segment_s: raw.segment_seconds.unwrap_or(default.segment_s),
            segment_bytes: raw.segment_bytes.unwrap_or(default.segment_bytes),
            flush_s: raw.flush_seconds.unwrap_or(default.flush_s),
            gzip: raw.compression.map_or(default.gzip, |level| (level > 0).then_some(level)),
        };
        if raw.enabled != Some(true) {
            return None;
        }
        let needed = settings.segment_bytes.saturating_mul(n_machines + 1);
        if needed > max_bytes {
            let message = format!(
                "{} for each of {n_machines} machines and one to spare is more than \
                 store.max_bytes ({max_bytes}): shorten the files or enlarge the store",
                settings.segment_bytes
            );
            self.report("recording.segment_bytes", message);
        }
        Some(settings)
    }

    /// Checks that a capture holds every window that raises an alarm, and that captures fit into the store.
    fn captures(
        &mut self,
        raw: &raw::Captures,
        monitor: &pipeline::Settings,
        max_bytes: u64,
    ) -> Option<Captures> {
        let captures = Captures {
            before_s: raw.seconds_before.unwrap_or(CAPTURES.holding(monitor).before_s),
            after_s: raw.seconds_after.unwrap_or(CAPTURES.after_s),
            most_per_hour: raw.most_per_hour.unwrap_or(CAPTURES.most_per_hour),
            max_bytes: raw.max_bytes.unwrap_or(CAPTURES.max_bytes.min(max_bytes / 4)),
        };
        if raw.enabled == Some(false) {
            return None;
        }
        if captures.before_s < monitor.window_s {
            let message = format!(
                "{} s is shorter than window_seconds ({} s): no window would be whole in a capture",
                captures.before_s, monitor.window_s
            );
            self.report("captures.seconds_before", message);
        }
        if captures.max_bytes > max_bytes {
            let message =
                format!("{} is more than store.max_bytes ({max_bytes})", captures.max_bytes);
            self.report("captures.max_bytes", message);
        }
        Some(captures)
    }

    fn monitor(
        &mut self,
        raw: &raw::Pipeline,
        alarms: &raw::Alarms,
        default: pipeline::Settings,
    ) -> pipeline::Settings {
        let settings = pipeline::Settings {
            window_s: raw.window_seconds.unwrap_or(default.window_s),
            hop_s: raw.hop_seconds.unwrap_or(default.hop_s),
            ring_s: raw.ring_seconds.unwrap_or(default.ring_s),
            alarms: alarm_settings(alarms, &default.alarms),
            ..default
        };
        if settings.hop_s > settings.window_s {
            let message = format!(
                "{} s is longer than window_seconds ({} s): samples between windows would never \
                 be judged",
                settings.hop_s, settings.window_s
            );
            self.report("pipeline.hop_seconds", message);
        }
        if settings.ring_s < settings.window_s + settings.hop_s {
            let message = format!(
                "{} s is too short: a window of {} s and a hop of {} s need {} s",
                settings.ring_s,
                settings.window_s,
                settings.hop_s,
                settings.window_s + settings.hop_s
            );
            self.report("pipeline.ring_seconds", message);
        }
        settings
    }

    /// Takes over the mistakes of another file, a line each.
    pub(super) fn foreign_mistakes(&mut self, place: String, mistakes: &str) {
        let prefix = format!("{place}:");
        self.scan.problems.extend(mistakes.lines().map(|line| super::Problem {
            place: place.clone(),
            message: line.strip_prefix(&prefix).unwrap_or(line).to_owned(),
        }));
    }

    /// Reports a machine that is not there; it may be one whose file has been reported already.
    pub(super) fn unknown_machine<'k>(
        &mut self,
        path: &str,
        id: &str,
        known: impl Iterator<Item = &'k str>,
    ) {
        if self.knows_machines {
            let known: Vec<&str> = known.collect();
            self.report(path, format!("no machine has the id {id:?}, known: {}", known.join(", ")));
        }
    }

    /// Gives the source of each machine id; `None` for one that was reported.
    pub(super) fn sources(
        &mut self,
        raw: Vec<raw::Source>,
        machines: &[ReadMachine],
    ) -> BTreeMap<String, Option<SourceConfig>> {
        let mut sources = BTreeMap::new();
        for (i, entry) in raw.into_iter().enumerate() {
            let path = format!("source[{i}]");
            let machine = self.required(&path, "machine", entry.machine.clone());
            let source = self.source(&path, entry);
            let Some(machine) = machine else { continue };
            if !machines.iter().any(|known| known.machine.id == machine) {
                let known = machines.iter().map(|known| known.machine.id.as_str());
                self.unknown_machine(&format!("{path}.machine"), &machine, known);
                continue;
            }
            match sources.entry(machine) {
                Entry::Vacant(entry) => {
                    entry.insert(source);
                }
                Entry::Occupied(mut entry) => self.join(&path, entry.get_mut(), source),
            }
        }
        sources
    }

    fn source(&mut self, path: &str, raw: raw::Source) -> Option<SourceConfig> {
        let kind = self.required(path, "kind", raw.kind.clone())?;
        match kind.as_str() {
            "replay" => self.replay(path, raw),
            "simulated" => self.simulated(path, raw),
            "tcp" => {
                for keys in [OF_REPLAY, OF_SIMULATED, OF_MQTT, &["speed", "rate_hz"]] {
                    self.foreign_keys(path, "tcp", keys);
                }
                Some(SourceConfig::Live(super::Live::listening()))
            }
            "mqtt" => {
                for keys in [OF_REPLAY, OF_SIMULATED, &["speed"]] {
                    self.foreign_keys(path, "mqtt", keys);
                }
                self.subscription(path, raw)
            }
            _ => {
                let message = format!(
                    "{kind:?} is no kind of source, allowed: \"replay\", \"simulated\", \"tcp\", \"mqtt\""
                );
                self.report(&format!("{path}.kind"), message);
                None
            }
        }
    }

    /// Reports keys that another kind of source has.
    fn foreign_keys(&mut self, path: &str, kind: &str, keys: &[&str]) {
        for key in keys {
            let place = format!("{path}.{key}");
            if self.scan.has(&place) {
                self.report(&place, format!("a source of the kind {kind:?} has no such key"));
            }
        }
    }

    fn simulated(&mut self, path: &str, raw: raw::Source) -> Option<SourceConfig> {
        for keys in [OF_REPLAY, OF_MQTT, &["rate_hz"]] {
            self.foreign_keys(path, "simulated", keys);
        }
        let name = self.required(path, "scene", raw.scene)?;
        let scene = self.scene(&format!("{path}.scene"), &name)?;
        let speed = match raw.speed {
            Some(raw::Speed::Factor(factor)) => replay::Speed::Times(factor),
            Some(raw::Speed::Word(raw::SpeedWord::Max)) => replay::Speed::Max,
            None => replay::Speed::Times(1.0),
        };
        let scenario = raw.scenario.map(Wanted::Combination);
        if let Some(Err(error)) = scenario.as_ref().map(|wanted| scenario::faults(&scene, wanted)) {
            self.report(&format!("{path}.scenario"), error.to_string());
        }
        let seed = raw.seed.unwrap_or(scene.seed);
        let settings = simulated::Settings { scene, seed, speed, scenario };
        Some(SourceConfig::Simulated(Box::new(settings)))
    }

    /// Reads a scene by file or by name; files come first.
    fn scene(&mut self, path: &str, name: &str) -> Option<Scene> {
        let file = self.base.join(name);
        let (text, place) = if file.is_file() {
            match self.read(&file) {
                Ok(text) => (text, file.display().to_string()),
                Err(error) => {
                    self.report(path, format!("{} cannot be read: {error}", file.display()));
                    return None;
                }
            }
        } else if let Some(text) = builtin::text(name) {
            (text.to_owned(), name.to_owned())
        } else {
            let known = builtin::names().collect::<Vec<_>>().join(", ");
            let message = format!(
                "there is no file {} and no built-in scene of that name: {known}",
                file.display()
            );
            self.report(path, message);
            return None;
        };
        match Scene::parse(&text, &place) {
            Ok(scene) => Some(scene),
            Err(errors) => {
                self.foreign_mistakes(place, &errors.to_string());
                None
            }
        }
    }

    fn replay(&mut self, path: &str, raw: raw::Source) -> Option<SourceConfig> {
        for keys in [OF_SIMULATED, OF_MQTT] {
            self.foreign_keys(path, "replay", keys);
        }
        let file = self.required(path, "file", raw.file)?;
        let file = self.files(&format!("{path}.file"), vec![file]).pop()?;
        let speed = match raw.speed {
            Some(raw::Speed::Factor(factor)) => replay::Speed::Times(factor),
            Some(raw::Speed::Word(raw::SpeedWord::Max)) | None => replay::Speed::Max,
        };
        let unit = raw.unit.filter(|unit| self.is_unit(path, unit));
        let hints = Hints { map: ChannelMap::default(), rate: raw.rate_hz.map(Hz), unit };
        Some(SourceConfig::Replay(replay::Settings {
            hints,
            file,
            speed,
            repeat: raw.r#loop.unwrap_or(false),
        }))
    }

    /// Whether a source's unit is known; reports it if not.
    fn is_unit(&mut self, path: &str, unit: &str) -> bool {
        let is_known = SourceUnit::parse(unit).is_some();
        if !is_known {
            let allowed = SourceUnit::ACCEPTED.join(", ");
            self.report(&format!("{path}.unit"), format!("{unit:?} is none of {allowed}"));
        }
        is_known
    }

    /// Resolves paths and reports those that are no files.
    pub(super) fn files(&mut self, path: &str, names: Vec<String>) -> Vec<PathBuf> {
        let files: Vec<_> = names.iter().map(|name| self.base.join(name)).collect();
        for file in files.iter().filter(|file| !file.is_file()) {
            self.report(path, format!("there is no file {}", file.display()));
        }
        files.into_iter().filter(|file| file.is_file()).collect()
    }

    /// Reports a key that is missing, unless it is there and was reported as wrong.
    pub(super) fn required<T>(&mut self, path: &str, name: &str, value: Option<T>) -> Option<T> {
        if value.is_none() && !self.scan.has(&format!("{path}.{name}")) {
            self.report(path, format!("the key {name:?} is missing"));
        }
        value
    }
}

/// How long trends are kept.
fn retention(raw: &raw::Store, default: Retention) -> Retention {
    Retention {
        windows_days: raw.trend_days.unwrap_or(default.windows_days),
        minutes_days: raw.trend_1min_days.unwrap_or(default.minutes_days),
        hours_days: raw.trend_1h_days.unwrap_or(default.hours_days),
    }
}

/// Fills the alarm engine's settings.
fn alarm_settings(raw: &raw::Alarms, default: &alarms::Settings) -> alarms::Settings {
    alarms::Settings {
        on_delay_s: raw.on_delay_s.unwrap_or(default.on_delay_s),
        off_delay_s: raw.off_delay_s.unwrap_or(default.off_delay_s),
        history_len: raw.history_len.unwrap_or(default.history_len),
        missing_after_s: raw.missing_after_s.unwrap_or(default.missing_after_s),
        max_shelving_s: raw.max_shelving_s.unwrap_or(default.max_shelving_s),
    }
}
