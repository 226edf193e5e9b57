//! The direction of dependency, as a test.
//!
//! Every file or folder directly under `src/` is a module with a line in `MAY_USE`. Core modules
//! may not name the outside world, and a few things may be named in one place only. Write one
//! `use crate::module::…` per module. Each rule is a function of a file, so that a second test can
//! hand it a file that breaks the rule.

#![expect(clippy::unwrap_used, reason = "a test may panic; clippy exempts only #[test] functions")]

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// Each module, bottom up, with the modules it may use.
const MAY_USE: &[(&str, &[&str])] = &[
    ("units", &[]),
    ("signal", &["units"]),
    ("tape", &[]),
    ("machine", &["units"]),
    ("dsp", &["units", "signal"]),
    ("buffer", &["units", "signal"]),
    ("features", &["units", "signal", "tape", "machine", "dsp"]),
    ("diagnosis", &["units", "signal", "tape", "machine", "features"]),
    ("alarms", &["units", "signal", "tape", "machine", "features", "diagnosis"]),
    (
        "pipeline",
        &["units", "signal", "tape", "machine", "dsp", "buffer", "features", "diagnosis", "alarms"],
    ),
    ("simulator", &["units", "signal", "machine"]),
    ("evaluation", &["diagnosis"]),
    (
        "trials",
        &[
            "units",
            "signal",
            "machine",
            "dsp",
            "features",
            "diagnosis",
            "pipeline",
            "simulator",
            "evaluation",
        ],
    ),
    ("plot", &[]),
    ("html", &["units", "signal", "machine", "dsp", "features", "diagnosis", "plot"]),
    ("notify", &["units", "signal", "machine", "features", "diagnosis", "alarms"]),
    ("wire", &[]),
    ("causes", &[]),
    ("access", &["signal"]),
    ("capture", &["units", "signal", "machine", "causes"]),
    ("offline", &["units", "signal", "machine", "features", "diagnosis", "pipeline", "capture"]),
    ("ingest", &["units", "signal", "machine", "simulator", "wire", "capture"]),
    (
        "bench",
        &[
            "units",
            "signal",
            "machine",
            "dsp",
            "features",
            "pipeline",
            "simulator",
            "evaluation",
            "trials",
            "plot",
        ],
    ),
    ("store", &["units", "signal", "tape", "features", "diagnosis", "alarms", "notify", "causes"]),
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
            "simulator",
            "evaluation",
            "plot",
            "notify",
            "wire",
            "access",
            "capture",
            "ingest",
            "store",
        ],
    ),
    (
        "evidence",
        &[
            "units",
            "signal",
            "tape",
            "machine",
            "features",
            "diagnosis",
            "alarms",
            "pipeline",
            "causes",
            "capture",
            "api",
        ],
    ),
    ("dashboard", &[]),
    ("telemetry", &[]),
    (
        "config",
        &[
            "units",
            "signal",
            "machine",
            "diagnosis",
            "alarms",
            "pipeline",
            "simulator",
            "notify",
            "access",
            "capture",
            "ingest",
            "store",
            "api",
        ],
    ),
    ("app", &["*"]),
    ("cli", &["*"]),
];

/// Modules that are pure and synchronous.
const CORE: &[&str] = &[
    "units",
    "signal",
    "tape",
    "machine",
    "dsp",
    "buffer",
    "features",
    "diagnosis",
    "alarms",
    "pipeline",
    "simulator",
    "evaluation",
    "trials",
    "plot",
    "html",
    "notify",
    "wire",
];

/// What a core module may not mention.
const OUTSIDE: &[&str] = &[
    "tokio",
    "axum",
    "hdf5",
    "std::fs",
    "std::net",
    "std::env",
    "std::thread",
    "std::process",
    "Instant::now",
    "SystemTime",
    "Serialize",
];

/// Words that only some places may use, and those places: a module, or a file of it.
const ONLY_IN: &[(&str, &[&str])] = &[
    ("::hdf5", &["src/capture/hdf5/"]),
    ("rust_hdf5", &["src/capture/hdf5/"]),
    ("rusqlite", &["src/store/"]),
    ("ureq::", &["src/app/", "src/cli/"]),
    ("rumqttc::", &["src/app/"]),
    ("tungstenite::", &["src/app/"]),
    ("Serialize", &["src/api/wire/"]),
    ("Instant::now", &["src/app/", "src/bench/", "src/cli/"]),
    ("SystemTime::now", &["src/app/", "src/bench/", "src/cli/"]),
    ("Timestamp::now", &["src/app/", "src/bench/", "src/cli/"]),
    ("thread::spawn", &["src/app/", "src/bench/", "src/cli/"]),
    ("thread::Builder", &["src/app/", "src/bench/", "src/cli/"]),
    ("tokio::spawn", &["src/app/"]),
    ("anyhow", &[]),
    // What is tested is what is released (docs/adr/0051); figures say which build they are of.
    ("debug_assertions", &["src/bench/computer.rs"]),
];

/// One source file: its module directly under `src/`, its path with `/`, its text.
struct Source {
    module: String,
    place: String,
    text: String,
}

impl Source {
    /// Lines of code with their numbers: no comments, and no unit tests, which end a file.
    fn code(&self) -> impl Iterator<Item = (usize, &str)> {
        let is_test_file = ["tests.rs", "support.rs"].iter().any(|end| self.place.ends_with(end))
            || self.place.contains("/tests/");
        let lines = self.text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
        lines
            .take_while(move |(_, line)| !is_test_file && *line != "#[cfg(test)]")
            .filter(|(_, line)| !line.starts_with("//"))
    }
}

#[test]
fn modules_depend_downwards_only() {
    assert_none(&sources().iter().flat_map(arrow_faults).collect::<Vec<_>>());
}

#[test]
fn what_has_one_place_is_named_there_only() {
    let sources = sources();
    assert_none(&sources.iter().flat_map(place_faults).collect::<Vec<_>>());
    for (word, places) in ONLY_IN.iter().filter(|(_, places)| !places.is_empty()) {
        let at_home = |s: &&Source| places.iter().any(|place| s.place.starts_with(place));
        let is_named = |s: &Source| s.text.contains(word);
        let others = ["rust_hdf5", "Timestamp::now", "thread::spawn", "tokio::spawn"];
        assert!(
            others.contains(word) || sources.iter().filter(at_home).any(is_named),
            "the rule on `{word}` guards nothing"
        );
    }
}

#[test]
fn the_table_is_in_reading_order() {
    let lib = fs::read_to_string("src/lib.rs").unwrap();
    let modules: Vec<&str> =
        lib.lines().filter_map(|line| line.strip_prefix("pub mod ")?.strip_suffix(';')).collect();
    let table: Vec<&str> = MAY_USE.iter().map(|(name, _)| *name).collect();
    assert_eq!(modules.iter().collect::<BTreeSet<_>>(), table.iter().collect::<BTreeSet<_>>());
    let mut above = BTreeSet::new();
    for (name, uses) in MAY_USE {
        let upwards: Vec<_> = uses.iter().filter(|u| **u != "*" && !above.contains(*u)).collect();
        assert!(upwards.is_empty(), "`{name}` stands before {upwards:?}");
        above.insert(name);
    }
    for (name, uses) in MAY_USE.iter().filter(|(name, _)| CORE.contains(name)) {
        let outside: Vec<_> = uses.iter().filter(|used| !CORE.contains(used)).collect();
        assert!(outside.is_empty(), "core module `{name}` may use {outside:?}");
    }
    let n_core = modules.iter().take_while(|name| CORE.contains(name)).count();
    assert_eq!(n_core, CORE.len(), "the core stands first in src/lib.rs");
}

#[test]
fn a_breach_of_each_rule_is_seen() {
    let source = |place: &str, text: &str| Source {
        module: place.split('/').nth(1).unwrap().trim_end_matches(".rs").to_owned(),
        place: place.to_owned(),
        text: text.to_owned(),
    };
    let arrow = |place: &str, text: &str| arrow_faults(&source(place, text)).len();
    assert_eq!(arrow("src/dsp/mod.rs", "use crate::signal::Block;"), 0);
    assert_eq!(arrow("src/dsp/mod.rs", "// use crate::machine::Machine;"), 0);
    assert_eq!(arrow("src/dsp/mod.rs", "use crate::machine::Machine;"), 1);
    assert_eq!(arrow("src/dsp/mod.rs", "let m = crate::api::x();"), 1);
    assert_eq!(arrow("src/dsp/mod.rs", "use crate::{signal, machine};"), 1, "groups hide names");
    assert_eq!(arrow("src/unheard_of.rs", ""), 1);
    assert_eq!(arrow("src/alarms/mod.rs", "let t = std::time::SystemTime::now();"), 1);
    assert_eq!(arrow("src/alarms/mod.rs", "std::thread::sleep(s);"), 1);
    let place = |place: &str, text: &str| place_faults(&source(place, text)).len();
    assert_eq!(place("src/capture/hdf5/mod.rs", "use ::hdf5::H5File;"), 0);
    assert_eq!(place("src/capture/root.rs", "use ::hdf5::H5File;"), 1);
    assert_eq!(place("src/capture/root.rs", "use super::hdf5::File;"), 0);
    assert_eq!(place("src/ingest/replay.rs", "use hdf5::File;"), 1);
    assert_eq!(place("src/diagnosis/verdict.rs", "#[derive(Serialize)]"), 1);
    assert_eq!(place("src/api/wire/alarms.rs", "#[derive(Serialize)]"), 0);
    assert_eq!(place("src/api/view.rs", "let now = Instant::now();"), 1);
    assert_eq!(place("src/ingest/replay.rs", "thread::spawn(run);"), 1);
    assert_eq!(place("src/dsp/fft.rs", "if cfg!(debug_assertions) {"), 1);
    assert_eq!(place("src/dsp/fft.rs", "debug_assert!(done.is_ok());"), 0);
    assert_eq!(place("src/ingest/replay.rs", "#[cfg(test)]\nthread::spawn(run);"), 0);
}

/// Uses of modules that stand higher, and core modules that name the outside world.
fn arrow_faults(source: &Source) -> Vec<String> {
    let Source { module, place, .. } = source;
    if module == "lib" || module == "main" {
        return Vec::new();
    }
    let Some((_, allowed)) = MAY_USE.iter().find(|(name, _)| name == module) else {
        return vec![format!("{place}: module `{module}` has no line in MAY_USE")];
    };
    let mut faults = Vec::new();
    // Unit tests, too, may use only what their module may.
    let lines = source.text.lines().map(str::trim).filter(|line| !line.starts_with("//"));
    for line in lines {
        for used in line.match_indices("crate::").map(|(at, _)| ident_at(&line[at + 7..])) {
            let known = used == module || allowed.contains(&used) || allowed.contains(&"*");
            if !known {
                faults.push(format!("{place}: `{module}` may not use `{used}`"));
            }
        }
        let is_core = CORE.contains(&module.as_str());
        for word in OUTSIDE.iter().filter(|word| is_core && line.contains(**word)) {
            faults.push(format!("{place}: core may not mention `{word}`"));
        }
    }
    faults
}

/// Words out of their place.
fn place_faults(source: &Source) -> Vec<String> {
    let place = &source.place;
    let mut faults = Vec::new();
    for (n, line) in source.code() {
        for (word, places) in ONLY_IN {
            let is_home = places.iter().any(|home| place.starts_with(home));
            if !is_home && names(line, word) {
                faults.push(format!("{place}:{n}: `{word}` only in {places:?}"));
            }
        }
        if line.starts_with("use hdf5::") && !place.starts_with("src/capture/") {
            faults.push(format!("{place}:{n}: the HDF5 library only in src/capture/hdf5/"));
        }
    }
    faults
}

/// Whether a line holds the word, not as a part of a longer path or name.
fn names(line: &str, word: &str) -> bool {
    line.match_indices(word).any(|(at, _)| {
        let before = line[..at].chars().next_back();
        let after = line[at + word.len()..].chars().next();
        let joined = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || c == '_');
        !joined(before) && !joined(after)
    })
}

fn assert_none(faults: &[String]) {
    assert!(faults.is_empty(), "\n{}", faults.join("\n"));
}

fn ident_at(text: &str) -> &str {
    let end = text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len());
    &text[..end]
}

fn sources() -> Vec<Source> {
    let mut waiting = vec![Path::new("src").to_owned()];
    let mut found = Vec::new();
    while let Some(path) = waiting.pop() {
        if path.is_dir() {
            waiting.extend(fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().path()));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let parts: Vec<&str> = path.iter().map(|part| part.to_str().unwrap()).collect();
            found.push(Source {
                module: parts[1].trim_end_matches(".rs").to_owned(),
                place: parts.join("/"),
                text: fs::read_to_string(&path).unwrap(),
            });
        }
    }
    assert!(found.len() > 50, "only {} files under src", found.len());
    found
}
