//! `[[machine]]`: machine files, each joined with its source.

use super::FileText;
use super::MachineConfig;
use super::raw;
use super::resolve::Resolver;
use crate::machine::Machine;
use std::path::Path;
use std::path::PathBuf;
use std::sync::Arc;

/// A machine file that was read.
pub(super) struct ReadMachine {
    /// Path of its entry, for messages.
    path: String,
    file: PathBuf,
    text: FileText,
    pub(super) machine: Arc<Machine>,
    baseline: Vec<PathBuf>,
}

impl Resolver<'_> {
    pub(super) fn machines(
        &mut self,
        machines: Vec<raw::Machine>,
        sources: Vec<raw::Source>,
    ) -> Vec<MachineConfig> {
        let machines = self.read_machines(machines);
        let mut sources = self.sources(sources, &machines);
        let mut complete = Vec::new();
        for read in machines {
            match sources.remove(&read.machine.id) {
                Some(source) => complete.extend(source.map(|source| MachineConfig {
                    file: read.file,
                    text: read.text,
                    machine: read.machine,
                    baseline: read.baseline,
                    source,
                })),
                None => self.report(
                    &read.path,
                    format!(
                        "machine {id:?} has no source: add a [[source]] with machine = {id:?}",
                        id = read.machine.id
                    ),
                ),
            }
        }
        complete
    }

    /// Reads the machine files; machines that cannot be read are left out and reported.
    fn read_machines(&mut self, raw: Vec<raw::Machine>) -> Vec<ReadMachine> {
        let mut machines: Vec<ReadMachine> = Vec::new();
        for (i, entry) in raw.into_iter().enumerate() {
            let path = format!("machine[{i}]");
            let baseline = self.files(&format!("{path}.baseline"), entry.baseline);
            let file = self.required(&path, "file", entry.file).map(|file| self.base.join(file));
            let read = file.and_then(|file| {
                let (machine, text) = self.machine(&format!("{path}.file"), &file)?;
                Some((file, machine, text))
            });
            let Some((file, machine, text)) = read else {
                self.knows_machines = false;
                continue;
            };
            if machines.iter().any(|other| other.machine.id == machine.id) {
                let message = format!("machine id {:?} is already used above", machine.id);
                self.report(&format!("{path}.file"), message);
                continue;
            }
            machines.push(ReadMachine { path, file, text, machine: Arc::new(machine), baseline });
        }
        machines
    }

    fn machine(&mut self, path: &str, file: &Path) -> Option<(Machine, FileText)> {
        let text = match self.read(file) {
            Ok(text) => text,
            Err(error) => {
                self.report(path, format!("{} cannot be read: {error}", file.display()));
                return None;
            }
        };
        match crate::machine::file::parse(&text, &file.display().to_string()) {
            Ok(machine) => Some((machine, FileText(text.into()))),
            Err(errors) => {
                self.foreign_mistakes(file.display().to_string(), &errors.to_string());
                None
            }
        }
    }
}
