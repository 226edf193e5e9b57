//! `rotorwatch diagnose`: captures → verdicts.

use crate::diagnosis::baseline::Baseline;
use crate::offline;
use crate::offline::Reference;
use clap::Args;
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

/// Arguments of `diagnose`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Captures; each is diagnosed on its own.
    #[arg(required = true)]
    pub captures: Vec<PathBuf>,
    /// Machine file.
    #[arg(long)]
    pub machine: Option<PathBuf>,
    /// Healthy capture of the same machine; may be repeated.
    #[arg(long)]
    pub baseline: Vec<PathBuf>,
    /// Speed.
    #[arg(long)]
    pub speed: Option<f64>,
}

/// Runs.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    let mut reference =
        Reference { speed: arguments.speed.map(crate::units::Hz), ..Reference::default() };
    if let Some(file) = &arguments.machine {
        let text = std::fs::read_to_string(file).unwrap_or_default();
        match crate::machine::file::parse(&text, &file.display().to_string()) {
            Ok(machine) => reference.machine = Some(Arc::new(machine)),
            Err(e) => return super::fail(&e),
        }
    }
    let mut records = Vec::new();
    for file in &arguments.baseline {
        match offline::learn(file, &reference, &mut |_| ()) {
            Ok(record) => records.push(record),
            Err(e) => return super::fail(&e),
        }
    }
    reference.baseline = Baseline { records, provisional: false };
    let mut out = String::new();
    for file in &arguments.captures {
        match offline::diagnose(file, &reference, &mut |_| ()) {
            Ok(d) => {
                let _ = writeln!(
                    out,
                    "== {} {} speed {:?} {:?} conf {:.2}",
                    file.display(),
                    d.state.name(),
                    d.shaft_speed,
                    d.speed_source,
                    d.speed_confidence
                );
                for c in &d.components {
                    let _ = writeln!(
                        out,
                        "  {:?} {} {} {:?} sev {:?} conf {:?}: {}",
                        c.kind,
                        c.id,
                        c.state.name(),
                        c.fault.map(|f| f.name()),
                        c.severity,
                        c.confidence,
                        c.why
                    );
                    for e in &c.evidence {
                        let _ = writeln!(
                            out,
                            "      {} {} f {:?} v {:.3} p {:?}",
                            e.indicator,
                            e.channel,
                            e.frequency.map(|f| f.0),
                            e.value,
                            e.false_alarm_probability
                        );
                    }
                }
                let _ = writeln!(
                    out,
                    "   warn {:?} first {:?} {:?}",
                    d.warnings, d.first_warning_s, d.first_damaged_s
                );
            }
            Err(e) => return super::fail(&e),
        }
    }
    super::print(out.as_bytes())
}
