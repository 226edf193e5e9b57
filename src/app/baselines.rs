//! Baselines in the daemon: which records its machines begin with, recordings to learn from, and the watch
//! over what others write into the store.

use super::recording;
use super::start_error::StartError;
use super::stop::Stop;
use crate::api::handles::BaselineHandle;
use crate::api::handles::MachineHandle;
use crate::api::view::Measured;
use crate::api::view::ShardRequest;
use crate::capture::recording::store::recording as recording_file;
use crate::causes::with_causes;
use crate::config::Config;
use crate::config::FileText;
use crate::config::MachineConfig;
use crate::config::change::described_otherwise;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::baseline::Record;
use crate::machine::Machine;
use crate::machine::file;
use crate::offline;
use crate::offline::Reference;
use crate::offline::names;
use crate::store::Act;
use crate::store::BaselineStore;
use crate::store::SqliteBaselines;
use crate::store::StoreError;
use crate::store::active_records;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::time::Duration;
use tokio::sync::oneshot;

/// Time between two looks at the store.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// Measures the healthy captures that the configuration names for a machine, each once however often it is named.
pub(super) fn named(entry: &MachineConfig) -> Result<Baseline, StartError> {
    let reference = Reference { machine: Some(Arc::clone(&entry.machine)), ..Reference::default() };
    let machine = entry.machine.id.as_str();
    let (files, again) = names::distinct(&entry.baseline);
    for (file, earlier) in again {
        let (file, earlier) = (file.display(), earlier.display());
        tracing::warn!(machine, %file, %earlier, "a baseline is an earlier one by another name, counted once");
    }
    let records = files.into_iter().map(|file| {
        let learned = offline::learn_and_judge(file, &reference, &mut |_| ());
        let (record, accused) = learned.map_err(|source| StartError::Baseline {
            machine: machine.to_owned(),
            file: file.clone(),
            source: Box::new(source),
        })?;
        for accused in &accused {
            tracing::warn!(machine, file = %file.display(), "the baseline: {accused}");
        }
        Ok::<Record, StartError>(record)
    });
    Ok(Baseline { records: records.collect::<Result<_, _>>()?, provisional: false })
}

/// Who marks baselines as stale.
const AUTHOR: &str = "rotorwatch";

/// Baselines of a machine are used no more: `parts` of it are described otherwise than when they were used.
pub(super) fn retire(
    store: &dyn BaselineStore,
    machine: &str,
    ids: &[String],
    parts: &[&str],
) -> Result<(), StoreError> {
    if ids.is_empty() {
        return Ok(());
    }
    let comment = format!("stale: described otherwise: {}", parts.join(", "));
    let act = Act { author: AUTHOR, comment: &comment, at: super::wall_clock() };
    store.retire(machine, ids, &act)?;
    let ids = ids.join(", ");
    tracing::warn!(machine, ids, comment, "baselines are not used any more");
    Ok(())
}

/// Before the start: what was learned of machines that are described otherwise since is stale, also if nobody was
/// there to see it change.
fn retire_of_others(config: &Config, store: &dyn BaselineStore) -> Result<(), StoreError> {
    for entry in &config.machines {
        let machine = entry.machine.id.as_str();
        for (id, text) in store.described(machine)? {
            // A file of an earlier version that cannot be read any more says nothing of what has changed.
            let Some(Ok(was)) = text.map(|text| file::parse(&text, "as it was")) else { continue };
            let parts = described_otherwise(&was, &entry.machine);
            if !parts.is_empty() {
                retire(store, machine, &[id], &parts)?;
            }
        }
        store.describe(machine, &entry.text.0)?;
    }
    Ok(())
}

/// The machine files that hold, by machine: with them baselines are used that are learned from now on.
pub(super) type Descriptions = Arc<Mutex<BTreeMap<String, FileText>>>;

/// The machine files of a configuration.
pub(super) fn descriptions(config: &Config) -> BTreeMap<String, FileText> {
    let of = |entry: &MachineConfig| (entry.machine.id.clone(), entry.text.clone());
    config.machines.iter().map(of).collect()
}

/// What HTTP needs for baselines.
pub(super) fn handle(config: &Config) -> Result<BaselineHandle, StoreError> {
    let store = Arc::new(SqliteBaselines::join(&config.store.directory)?);
    retire_of_others(config, &*store)?;
    let root = config.store.directory.join(recording::FOLDER);
    let measure = move |machine: &Arc<Machine>, name: &str| measure(&root, machine, name);
    let measure = Arc::new(measure);
    Ok(BaselineHandle { store, measure, wall_clock: super::wall_clock })
}

/// Measures a recording in the store.
fn measure(root: &Path, machine: &Arc<Machine>, name: &str) -> Result<Measured, String> {
    let shown: String = name.chars().take(100).collect();
    let Some(file) = recording_file(root, &machine.id, name) else {
        return Err(format!(
            "no recording {shown:?} of machine {:?} is in the store; captures elsewhere are learned from by \
             `rotorwatch baseline learn`",
            machine.id
        ));
    };
    let reference = Reference { machine: Some(Arc::clone(machine)), ..Reference::default() };
    let learned = offline::learn_and_judge(&file, &reference, &mut |_| ());
    let (record, accused) = learned.map_err(|error| format!("{shown}: {}", with_causes(&error)))?;
    let warnings = accused.iter().map(|accused| format!("{name}: {accused}")).collect();
    Ok(Measured { record: Record { name: name.to_owned(), ..record }, warnings })
}

/// Hands the machines what others write: the command line, or HTTP when a shard was busy.
pub(super) struct Watch {
    /// A connection of its own sees what every other writes.
    store: SqliteBaselines,
    machines: Vec<MachineHandle>,
    descriptions: Descriptions,
}

/// How far the store has been seen by all machines.
#[derive(Debug, Clone, Copy, Default)]
struct Seen {
    version: Option<i64>,
    newest_act: Option<i64>,
}

impl Watch {
    /// A watch for these machines.
    ///
    /// # Errors
    /// When the store cannot be opened once more.
    pub(super) fn new(
        directory: &Path,
        machines: Vec<MachineHandle>,
        descriptions: Descriptions,
    ) -> Result<Self, StoreError> {
        Ok(Self { store: SqliteBaselines::join(directory)?, machines, descriptions })
    }

    /// Watches until the stop.
    pub(super) fn run(&self, stop: &Stop) {
        let (mut seen, mut is_failing) = (Seen::default(), false);
        loop {
            match self.look(seen) {
                Ok(now) => (seen, is_failing) = (now, false),
                Err(error) if !is_failing => {
                    tracing::error!(error = with_causes(&error), "baselines cannot be read");
                    is_failing = true;
                }
                Err(_) => {}
            }
            if stop.wait_until(super::now() + LOOK_EVERY) {
                return;
            }
        }
    }

    /// Hands out what is active if somebody has acted on a baseline since `seen`; gives what has been seen by all.
    fn look(&self, seen: Seen) -> Result<Seen, StoreError> {
        let version = Some(self.store.version()?);
        if seen.version == version {
            return Ok(seen);
        }
        // Alarms and delays change the store as well, every second where machines are many.
        let newest_act = Some(self.store.newest_act()?);
        if seen.newest_act == newest_act {
            return Ok(Seen { version, newest_act });
        }
        let mut all_told = true;
        for handle in &self.machines {
            let records = active_records(&self.store, &handle.id)?;
            let (reply, _nobody_waits) = oneshot::channel();
            all_told &= (handle.submit)(ShardRequest::UseBaselines { records, reply }).is_ok();
        }
        self.describe()?;
        Ok(if all_told { Seen { version, newest_act } } else { Seen::default() })
    }

    /// What is new was learned of the machines as they are described now.
    fn describe(&self) -> Result<(), StoreError> {
        let descriptions = self.descriptions.lock().unwrap_or_else(PoisonError::into_inner);
        let machines = descriptions.clone();
        drop(descriptions);
        machines.iter().try_for_each(|(id, FileText(text))| self.store.describe(id, text))
    }
}
