//! The direction of dependency, as a test.
//!
//! Every file or folder directly under `src/` is a module with a line in `MAY_USE`. Core modules
//! may not name the outside world. Write one `use crate::module::…` per module.

#![expect(clippy::unwrap_used, reason = "a test may panic; clippy exempts only #[test] functions")]

use std::{fs, path::Path};

/// Each module, bottom up, with the modules it may use.
const MAY_USE: &[(&str, &[&str])] = &[
    ("units", &[]),
    ("signal", &["units"]),
    ("machine", &["units"]),
    ("dsp", &["units", "signal"]),
    ("buffer", &["units", "signal"]),
    ("features", &["units", "signal", "machine", "dsp"]),
    ("diagnosis", &["units", "signal", "machine", "features"]),
    ("alarms", &["units", "signal", "machine", "features", "diagnosis"]),
    (
        "pipeline",
        &["units", "signal", "machine", "dsp", "buffer", "features", "diagnosis", "alarms"],
    ),
    ("capture", &["units", "signal", "machine"]),
    ("offline", &["units", "signal", "machine", "features", "diagnosis", "pipeline", "capture"]),
    ("ingest", &["units", "signal", "machine", "capture"]),
    ("demo", &["units", "machine", "capture"]),
    (
        "api",
        &[
            "units",
            "signal",
            "machine",
            "dsp",
            "buffer",
            "features",
            "diagnosis",
            "alarms",
            "pipeline",
            "capture",
        ],
    ),
    ("dashboard", &[]),
    ("telemetry", &[]),
    ("config", &["units", "signal", "machine", "diagnosis", "alarms", "pipeline", "ingest", "api"]),
    ("app", &["*"]),
    ("cli", &["*"]),
];

/// Modules that are pure and synchronous.
const CORE: &[&str] =
    &["units", "signal", "machine", "dsp", "buffer", "features", "diagnosis", "alarms", "pipeline"];

/// What a core module may not mention.
const OUTSIDE: &[&str] =
    &["tokio", "axum", "hdf5", "std::fs", "std::net", "std::env", "Instant::now", "SystemTime"];

#[test]
fn modules_depend_downwards_only() {
    let mut faults = Vec::new();
    for_each_source(Path::new("src"), &mut |module, path, text| {
        if module == "lib" || module == "main" {
            return;
        }
        let Some((_, allowed)) = MAY_USE.iter().find(|(name, _)| *name == module) else {
            faults.push(format!("{path}: module `{module}` has no line in MAY_USE"));
            return;
        };
        for line in text.lines().map(str::trim).filter(|line| !line.starts_with("//")) {
            for used in line.match_indices("crate::").map(|(at, _)| ident_at(&line[at + 7..])) {
                let known = used == module || allowed.contains(&used) || allowed.contains(&"*");
                if !known {
                    faults.push(format!("{path}: `{module}` may not use `{used}`"));
                }
            }
            for word in OUTSIDE.iter().filter(|word| line.contains(**word)) {
                if CORE.contains(&module) {
                    faults.push(format!("{path}: core may not mention `{word}`"));
                }
            }
        }
    });
    assert!(faults.is_empty(), "\n{}", faults.join("\n"));
}

fn ident_at(text: &str) -> &str {
    let end = text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len());
    &text[..end]
}

fn for_each_source(dir: &Path, visit: &mut dyn FnMut(&str, &str, &str)) {
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            for_each_source(&path, visit);
        } else if path.extension().is_some_and(|ext| ext == "rs") {
            let module = path.components().nth(1).unwrap().as_os_str().to_str().unwrap();
            let text = fs::read_to_string(&path).unwrap();
            visit(module.trim_end_matches(".rs"), &path.display().to_string(), &text);
        }
    }
}
