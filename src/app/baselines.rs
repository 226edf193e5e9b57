//! Baselines in the daemon: which records its machines begin with, recordings to learn from, and the watch
//! over what others write into the store.

use super::recording;
use super::start_error::StartError;
use super::stop::Stop;
use crate::api::view::BaselineHandle;
use crate::api::view::MachineHandle;
use crate::api::view::ShardRequest;
use crate::capture::recording::store::recording as recording_file;
use crate::causes::with_causes;
use crate::config::Config;
use crate::config::MachineConfig;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::baseline::Record;
use crate::machine::Machine;
use crate::offline;
use crate::offline::Reference;
use crate::store::BaselineStore;
use crate::store::SqliteBaselines;
use crate::store::StoreError;
use crate::store::active_records;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::oneshot;

/// Time between two looks at the store.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// Measures the healthy captures that the configuration names for a machine.
pub(super) fn named(entry: &MachineConfig) -> Result<Baseline, StartError> {
    let reference = Reference { machine: Some(Arc::clone(&entry.machine)), ..Reference::default() };
    let records = entry.baseline.iter().map(|file| {
        offline::learn(file, &reference, &mut |_| ()).map_err(|source| StartError::Baseline {
            machine: entry.machine.id.clone(),
            file: file.clone(),
            source: Box::new(source),
        })
    });
    Ok(Baseline { records: records.collect::<Result<_, _>>()?, provisional: false })
}

/// What HTTP needs for baselines.
pub(super) fn handle(config: &Config) -> Result<BaselineHandle, StoreError> {
    let store = Arc::new(SqliteBaselines::join(&config.store.directory)?);
    let root = config.store.directory.join(recording::FOLDER);
    let measure = move |machine: &Arc<Machine>, name: &str| measure(&root, machine, name);
    let measure = Arc::new(measure);
    Ok(BaselineHandle { store, measure, wall_clock: super::wall_clock })
}

/// Measures a recording in the store.
fn measure(root: &Path, machine: &Arc<Machine>, name: &str) -> Result<Record, String> {
    let shown: String = name.chars().take(100).collect();
    let Some(file) = recording_file(root, &machine.id, name) else {
        return Err(format!(
            "no recording {shown:?} of machine {:?} is in the store; captures elsewhere are learned from by \
             `rotorwatch baseline learn`",
            machine.id
        ));
    };
    let reference = Reference { machine: Some(Arc::clone(machine)), ..Reference::default() };
    let learned = offline::learn(&file, &reference, &mut |_| ());
    let record = learned.map_err(|error| format!("{shown}: {}", with_causes(&error)))?;
    Ok(Record { name: name.to_owned(), ..record })
}

/// Hands the machines what others write: the command line, or HTTP when a shard was busy.
pub(super) struct Watch {
    /// A connection of its own sees what every other writes.
    store: SqliteBaselines,
    machines: Vec<MachineHandle>,
}

impl Watch {
    /// A watch for these machines.
    ///
    /// # Errors
    /// When the store cannot be opened once more.
    pub(super) fn new(directory: &Path, machines: Vec<MachineHandle>) -> Result<Self, StoreError> {
        Ok(Self { store: SqliteBaselines::join(directory)?, machines })
    }

    /// Watches until the stop.
    pub(super) fn run(&self, stop: &Stop) {
        let (mut seen, mut is_failing) = (None, false);
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

    /// Hands out what is active if the store is another than `seen`; gives what has been seen by all.
    fn look(&self, seen: Option<i64>) -> Result<Option<i64>, StoreError> {
        let now = self.store.version()?;
        if seen == Some(now) {
            return Ok(seen);
        }
        let mut all_told = true;
        for handle in &self.machines {
            let records = active_records(&self.store, &handle.id)?;
            let (reply, _nobody_waits) = oneshot::channel();
            all_told &= (handle.submit)(ShardRequest::UseBaselines { records, reply }).is_ok();
        }
        Ok(all_told.then_some(now))
    }
}
