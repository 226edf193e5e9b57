//! What becomes of a configuration that is read while the daemon runs: what is in effect at once, which machines must be
//! rebuilt for it, and what waits for a restart.
//!
//! A pure function of two configurations. Every field of both is named here, so that a new one does not compile before
//! it has its place. A machine file is taken as a whole: if one part of it needs a restart, all of it waits.

use super::Access;
use super::Captures;
use super::Config;
use super::Ingest;
use super::Limits;
use super::MachineConfig;
use super::Store;
use super::Tls;
use crate::alarms;
use crate::capture::recording::machine as recording;
use crate::machine::Machine;
use crate::machine::sensor::Sensor;
use crate::notify::settings as receivers;
use crate::pipeline;

/// What becomes of a new configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// What holds from now on: the new configuration, with the old values of what waits for a restart.
    pub config: Config,
    /// What is other than before and in effect at once.
    pub applied: Vec<String>,
    /// What is other than before and waits for a restart.
    pub restart: Vec<String>,
    /// One a machine, in the order of [`Config::machines`].
    pub machines: Vec<Extent>,
}

/// How far a change reaches into a machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Extent {
    /// Not at all.
    Untouched,
    /// Limits, delays, thresholds: its alarms are judged by others, what was measured stays.
    Judged,
    /// It is described otherwise: it is measured anew, its rings stay.
    Rebuilt {
        /// What is described otherwise.
        parts: Vec<&'static str>,
        /// Whether that makes what was learned of it stale.
        stale: bool,
    },
}

/// Notes what has changed, by class.
#[derive(Debug, Default)]
struct Notes {
    applied: Vec<String>,
    restart: Vec<String>,
}

impl Notes {
    /// A field that is in effect at once.
    fn live<T: PartialEq>(&mut self, name: &str, old: &T, new: &T) {
        if old != new {
            self.applied.push(name.to_owned());
        }
    }

    /// A field that waits for a restart: the old value stays.
    fn fixed<T: PartialEq + Clone>(&mut self, name: &str, old: &T, new: &mut T) {
        if old != new {
            self.restart.push(name.to_owned());
            new.clone_from(old);
        }
    }
}

/// What becomes of `new` where `old` holds.
#[must_use]
pub fn between(old: &Config, mut new: Config) -> Change {
    let mut notes = Notes::default();
    let Config {
        bind,
        access,
        ingest,
        store,
        workers,
        memory_limit_bytes,
        recording,
        captures,
        monitor,
        lengthen_windows,
        notify,
        log,
        machines,
        // Where it was read from says nothing.
        files: _,
    } = &mut new;
    notes.fixed("server.bind", &old.bind, bind);
    of_access(&mut notes, &old.access, access);
    of_ingest(&mut notes, &old.ingest, ingest);
    of_store(&mut notes, &old.store, store);
    notes.fixed("pipeline.workers", &old.workers, workers);
    notes.fixed("pipeline.memory_limit_bytes", &old.memory_limit_bytes, memory_limit_bytes);
    of_recording(&mut notes, old.recording.as_ref(), recording);
    of_captures(&mut notes, old.captures.as_ref(), captures);
    of_monitor(&mut notes, &old.monitor, monitor);
    notes.fixed("pipeline.lengthen_windows", &old.lengthen_windows, lengthen_windows);
    of_receivers(&mut notes, &old.notify, notify);
    notes.live("log.level", &old.log, log);
    let is_judged_otherwise = old.monitor != *monitor;
    let machines = of_machines(&mut notes, old, machines, is_judged_otherwise);
    let Notes { applied, restart } = notes;
    Change { config: new, applied, restart, machines }
}

fn of_access(notes: &mut Notes, old: &Access, new: &mut Access) {
    let Access { tokens, tls, hosts, cors_origins, limits, exposure } = new;
    // Whether anybody needs one, and whether anything is encrypted, was decided with the address.
    if tokens.is_some() == old.tokens.is_some() {
        notes.live("server.token_file", &old.tokens, tokens);
    } else {
        notes.fixed("server.token_file", &old.tokens, tokens);
    }
    if let (Some(old), Some(tls)) = (&old.tls, &mut *tls) {
        let Tls { identity, of_ingest } = tls;
        notes.live("server.tls.cert_file", &old.identity, identity);
        notes.fixed("server.tls.ingest", &old.of_ingest, of_ingest);
    } else {
        notes.fixed("server.tls", &old.tls, tls);
    }
    notes.fixed("server.hosts", &old.hosts, hosts);
    notes.fixed("server.cors_origins", &old.cors_origins, cors_origins);
    let Limits { max_requests_per_s, max_connections, max_event_streams } = limits;
    let before = &old.limits;
    notes.fixed("server.max_requests_per_s", &before.max_requests_per_s, max_requests_per_s);
    notes.fixed("server.max_connections", &before.max_connections, max_connections);
    notes.fixed("server.max_event_streams", &before.max_event_streams, max_event_streams);
    // Said on the command line: the same as long as the daemon runs.
    notes.fixed("--insecure", &old.exposure, exposure);
}

fn of_ingest(notes: &mut Notes, old: &Ingest, new: &mut Ingest) {
    let Ingest { bind, max_connections } = new;
    notes.fixed("ingest.bind", &old.bind, bind);
    notes.fixed("ingest.max_connections", &old.max_connections, max_connections);
}

fn of_store(notes: &mut Notes, old: &Store, new: &mut Store) {
    let Store { directory, max_bytes, trends } = new;
    notes.fixed("store.directory", &old.directory, directory);
    notes.live("store.max_bytes", &old.max_bytes, max_bytes);
    notes.live("store.trend_days", &old.trends.windows_days, &trends.windows_days);
    notes.live("store.trend_1min_days", &old.trends.minutes_days, &trends.minutes_days);
    notes.live("store.trend_1h_days", &old.trends.hours_days, &trends.hours_days);
}

fn of_recording(
    notes: &mut Notes,
    old: Option<&recording::Settings>,
    new: &mut Option<recording::Settings>,
) {
    let (Some(old), Some(settings)) = (old, &mut *new) else {
        return notes.fixed("recording.enabled", &old.copied(), new);
    };
    let recording::Settings { segment_s, segment_bytes, flush_s, gzip } = settings;
    notes.fixed("recording.segment_seconds", &old.segment_s, segment_s);
    notes.fixed("recording.segment_bytes", &old.segment_bytes, segment_bytes);
    notes.fixed("recording.flush_seconds", &old.flush_s, flush_s);
    notes.fixed("recording.compression", &old.gzip, gzip);
}

fn of_captures(notes: &mut Notes, old: Option<&Captures>, new: &mut Option<Captures>) {
    let (Some(old), Some(captures)) = (old, &mut *new) else {
        return notes.fixed("captures.enabled", &old.copied(), new);
    };
    let Captures { before_s, after_s, most_per_hour, max_bytes } = captures;
    notes.fixed("captures.seconds_before", &old.before_s, before_s);
    notes.fixed("captures.seconds_after", &old.after_s, after_s);
    notes.fixed("captures.most_per_hour", &old.most_per_hour, most_per_hour);
    notes.fixed("captures.max_bytes", &old.max_bytes, max_bytes);
}

fn of_monitor(notes: &mut Notes, old: &pipeline::Settings, new: &mut pipeline::Settings) {
    let stated_a_year = new.false_alarms.a_year;
    let pipeline::Settings {
        window_s,
        hop_s,
        ring_s,
        // These three are of a machine and its stream, not of the configuration.
        baseline: _,
        provisional_segments: _,
        load: _,
        alarms,
        false_alarms,
    } = new;
    notes.fixed("pipeline.window_seconds", &old.window_s, window_s);
    notes.fixed("pipeline.hop_seconds", &old.hop_s, hop_s);
    notes.fixed("pipeline.ring_seconds", &old.ring_s, ring_s);
    of_alarms(notes, &old.alarms, alarms);
    notes.live(
        "diagnosis.false_alarms_per_component_year",
        &old.false_alarms.a_year,
        &false_alarms.a_year,
    );
    // What a verdict is held to follows from the windows, and these may have stayed as they were.
    if let Some(a_year) = stated_a_year {
        *new = super::held_to(new.clone(), a_year);
    }
}

fn of_alarms(notes: &mut Notes, old: &alarms::Settings, new: &alarms::Settings) {
    let alarms::Settings { on_delay_s, off_delay_s, history_len, missing_after_s, max_shelving_s } =
        new;
    notes.live("alarms.on_delay_s", &old.on_delay_s, on_delay_s);
    notes.live("alarms.off_delay_s", &old.off_delay_s, off_delay_s);
    notes.live("alarms.history_len", &old.history_len, history_len);
    notes.live("alarms.missing_after_s", &old.missing_after_s, missing_after_s);
    notes.live("alarms.max_shelving_s", &old.max_shelving_s, max_shelving_s);
}

fn of_receivers(notes: &mut Notes, old: &receivers::Settings, new: &receivers::Settings) {
    let receivers::Settings { webhooks, brokers } = new;
    notes.live("notify.webhook", &old.webhooks, webhooks);
    notes.live("notify.mqtt", &old.brokers, brokers);
}

/// Machines that come or go wait for a restart, and those that stay keep their places.
fn of_machines(
    notes: &mut Notes,
    old: &Config,
    machines: &mut Vec<MachineConfig>,
    is_judged_otherwise: bool,
) -> Vec<Extent> {
    let mut new = std::mem::take(machines);
    let mut extents = Vec::new();
    for was in &old.machines {
        let id = &was.machine.id;
        let Some(at) = new.iter().position(|entry| entry.machine.id == *id) else {
            notes.restart.push(format!("machine {id:?} is gone"));
            machines.push(was.clone());
            extents.push(at_least(Extent::Untouched, is_judged_otherwise));
            continue;
        };
        let (entry, extent) = of_machine(notes, was, new.swap_remove(at));
        machines.push(entry);
        extents.push(at_least(extent, is_judged_otherwise));
    }
    let come = new.iter().map(|entry| format!("machine {:?} is new", entry.machine.id));
    notes.restart.extend(come);
    extents
}

fn at_least(extent: Extent, is_judged_otherwise: bool) -> Extent {
    match extent {
        Extent::Untouched if is_judged_otherwise => Extent::Judged,
        Extent::Untouched | Extent::Judged | Extent::Rebuilt { .. } => extent,
    }
}

fn of_machine(
    notes: &mut Notes,
    old: &MachineConfig,
    new: MachineConfig,
) -> (MachineConfig, Extent) {
    let id = &old.machine.id;
    // The file's place and its text say nothing; what stands in it does.
    let MachineConfig { file, text, machine, baseline, mut source } = new;
    notes.fixed(&format!("the source of machine {id:?}"), &old.source, &mut source);
    let parts = parts(&old.machine, &machine);
    if !parts.restart.is_empty() {
        let names = parts.restart.join(", ");
        notes.restart.push(format!("the file of machine {id:?} ({names})"));
        return (MachineConfig { source, ..old.clone() }, Extent::Untouched);
    }
    let mut rebuilt = parts.rebuilt;
    let stale = !rebuilt.is_empty();
    if old.baseline != baseline {
        rebuilt.push("baseline");
    }
    let mut all = parts.judged;
    all.extend(&rebuilt);
    if !all.is_empty() {
        notes.applied.push(format!("machine {id:?} ({})", all.join(", ")));
    }
    let extent = match (rebuilt.is_empty(), all.is_empty()) {
        (_, true) => Extent::Untouched,
        (true, false) => Extent::Judged,
        (false, false) => Extent::Rebuilt { parts: rebuilt, stale },
    };
    (MachineConfig { file, text, machine, baseline, source }, extent)
}

/// What of a machine is described otherwise, so that what was measured of it means something else.
#[must_use]
pub fn described_otherwise(old: &Machine, new: &Machine) -> Vec<&'static str> {
    let mut parts = parts(old, new).rebuilt;
    if converts_otherwise(old, new) {
        parts.push(CONVERSION);
    }
    parts
}

/// Part of a sensor that says what its samples are.
const CONVERSION: &str = "sensor: channel, kind, unit or sensitivity";

/// What has changed in a machine file, by what it takes.
#[derive(Debug, Default)]
struct Parts {
    judged: Vec<&'static str>,
    rebuilt: Vec<&'static str>,
    restart: Vec<&'static str>,
}

fn parts(old: &Machine, new: &Machine) -> Parts {
    let Machine {
        id: _,
        name,
        iso_group,
        power_kw,
        shafts,
        bearings,
        motors,
        gears,
        sensors,
        limits,
        alarm_limits,
        capture_map,
        // Remarks of the reader on what stands in the other fields.
        notes: _,
    } = new;
    let named = |list: &[(&'static str, bool)]| {
        list.iter().filter(|(_, is_other)| *is_other).map(|(name, _)| *name).collect()
    };
    Parts {
        judged: named(&[
            ("name", *name != old.name),
            ("iso_group", *iso_group != old.iso_group),
            ("power_kw", *power_kw != old.power_kw),
            ("limits", *limits != old.limits),
            ("limits.alarm", *alarm_limits != old.alarm_limits),
        ]),
        rebuilt: named(&[
            ("shaft", *shafts != old.shafts),
            ("bearing", *bearings != old.bearings),
            ("motor", *motors != old.motors),
            ("gear", *gears != old.gears),
            ("sensor", *sensors != old.sensors),
        ]),
        restart: named(&[
            (CONVERSION, converts_otherwise(old, new)),
            ("capture.map", *capture_map != old.capture_map),
        ]),
    }
}

/// Whether samples become other numbers: they are converted where they are received, and what rings hold is converted
/// already.
fn converts_otherwise(old: &Machine, new: &Machine) -> bool {
    let conversions = |machine: &Machine| {
        let mut all: Vec<_> = machine.sensors.iter().map(conversion).collect();
        all.sort_by(|a, b| a.0.cmp(&b.0));
        all
    };
    conversions(old) != conversions(new)
}

type Conversion = (
    String,
    crate::machine::sensor::SensorKind,
    Option<(String, crate::units::SourceUnit)>,
    Option<f64>,
);

fn conversion(sensor: &Sensor) -> Conversion {
    let Sensor {
        channel,
        kind,
        unit,
        sensitivity_v_per_unit,
        at: _,
        axis_deg: _,
        direction: _,
        usable: _,
        gap_v: _,
        tacho: _,
    } = sensor;
    (channel.clone(), *kind, unit.clone(), *sensitivity_v_per_unit)
}

#[cfg(test)]
#[path = "change_tests.rs"]
mod tests;
