//! `rotorwatch openapi`: prints the API document, or the schema of the diagnosis document.

use crate::api;
use crate::api::wire::diagnosis;
use crate::api::wire::evaluation;
use crate::api::wire::evidence;
use crate::api::wire::rerun;
use clap::Args;
use clap::ValueEnum;
use std::process::ExitCode;

/// Shown below `--help`.
pub const EXAMPLES: &str = "\
Examples:
  rotorwatch openapi > openapi.json
  rotorwatch openapi --schema diagnosis > diagnosis-1.schema.json";

/// Arguments of `openapi`.
#[derive(Debug, Args)]
pub struct Arguments {
    /// The JSON Schema of a document instead.
    #[arg(long, value_enum, value_name = "DOCUMENT")]
    pub schema: Option<Schema>,
}

/// Documents with a published schema.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Schema {
    /// What `diagnose --format json` prints: `rotorwatch.diagnosis/1`.
    Diagnosis,
    /// What `evaluate --format json` prints: `rotorwatch.evaluation/1`.
    Evaluation,
    /// What `diagnose --evidence --format json` prints: `rotorwatch.evidence/1`.
    Evidence,
    /// What `replay-alarms --format json` prints: `rotorwatch.replay-alarms/1`.
    ReplayAlarms,
}

/// Prints the OpenAPI 3.1 document of the HTTP API, or a schema, as indented JSON.
#[must_use]
pub fn run(arguments: &Arguments) -> ExitCode {
    let schema = match arguments.schema {
        None => return super::print(api::openapi_text().as_bytes()),
        Some(Schema::Diagnosis) => diagnosis::json_schema(),
        Some(Schema::Evaluation) => evaluation::json_schema(),
        Some(Schema::Evidence) => evidence::json_schema(),
        Some(Schema::ReplayAlarms) => rerun::json_schema(),
    };
    match serde_json::to_string_pretty(&schema) {
        Ok(text) => super::print((text + "\n").as_bytes()),
        Err(error) => super::fail(&error),
    }
}
