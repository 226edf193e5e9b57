//! The documents say what the code does: equations, sources, tests and examples named in them exist.
//!
//! Each check is a function of texts, so that a second test can hand it a text that is wrong.

#![expect(clippy::unwrap_used, reason = "a test may panic; clippy exempts only #[test] functions")]

mod fences;

use clap::Parser;
use fences::fenced;
use rotorwatch::cli::Cli;
use rotorwatch::config;
use rotorwatch::machine::file;
use rotorwatch::simulator::scene::Scene;
use std::collections::BTreeMap;
use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::path::PathBuf;

/// Letters of the equation series in docs/theory.md.
const SERIES: &str = "KDFCSJR";

/// A source file: its path in modules (`["dsp", "stats"]`) and its text.
struct Source {
    module: Vec<String>,
    place: String,
    text: String,
}

/// An equation as a document defines it.
#[derive(Debug, PartialEq)]
struct Equation {
    number: String,
    paths: Vec<String>,
}

#[test]
fn every_equation_names_its_function_and_every_function_its_equation() {
    let theory: String = documents("theory").iter().map(|(_, text)| text.as_str()).collect();
    let equations = equations(&theory);
    assert!(equations.len() > 50, "only {} equations found", equations.len());
    let faults = equation_faults(&equations, &sources("src"));
    assert!(faults.is_empty(), "\n{}", faults.join("\n"));
}

#[test]
fn a_wrong_equation_is_seen() {
    let source = Source {
        module: vec!["dsp".to_owned(), "stats".to_owned()],
        place: "src/dsp/stats.rs".to_owned(),
        text: "/// The mean (D1), not (D9).\nimpl Moments {\n    fn of() {}\n}".to_owned(),
    };
    let faults =
        |theory: &str| equation_faults(&equations(theory), std::slice::from_ref(&source)).join(";");
    assert_eq!(
        faults("**D1** a — `dsp::stats::Moments::of`\n**D9** b — `dsp::stats::Moments`"),
        ""
    );
    let unknown = faults("**D1** a — `dsp::stats::Moments::of`");
    assert!(unknown.contains("D9") && !unknown.contains("D1 "), "{unknown}");
    let rest = "**D9** b — `dsp::stats::Moments`\n";
    assert!(faults(&format!("{rest}**D1** a = b")).contains("D1 names no function"));
    assert!(faults(&format!("{rest}| D1 | a | `dsp::stats::Moments::off` |")).contains("`off`"));
    assert!(faults(&format!("{rest}| D1 | a | `stat::of` |")).contains("no such module"));
    let silent = faults(&format!("{rest}**D1** a — `dsp::stats::of`\n**D2** c — `dsp::stats::of`"));
    assert!(silent.contains("src/dsp/stats.rs does not name D2"), "{silent}");
}

#[test]
fn every_source_cited_is_listed_and_every_source_listed_is_cited() {
    let bib = fs::read_to_string("docs/references.bib").unwrap();
    let listed: BTreeSet<&str> = bib
        .lines()
        .filter_map(|line| line.strip_prefix('@')?.split_once('{')?.1.strip_suffix(','))
        .collect();
    let mut cited = BTreeSet::new();
    for (_, text) in documents("") {
        cited.extend(bracketed(&text).filter(|key| is_bib_key(key)).map(str::to_owned));
    }
    let cited: BTreeSet<&str> = cited.iter().map(String::as_str).collect();
    assert!(listed.len() > 10);
    assert_eq!(cited, listed);
}

#[test]
fn every_invariant_names_a_test_or_a_lint_that_exists() {
    let architecture = fs::read_to_string("ARCHITECTURE.md").unwrap();
    let (n, faults) = invariant_faults(&architecture, &known_guards());
    assert!(n >= 10, "only {n} invariants found");
    assert!(faults.is_empty(), "\n{}", faults.join("\n"));
}

#[test]
fn an_invariant_without_a_guard_is_seen() {
    let guards = BTreeSet::from(["a_test".to_owned(), "unsafe_code".to_owned()]);
    let text = "# A\n- no invariant\n## Invariants\n\n- **One.** Text.\n  Held by `a_test`.\n\
                - **Two.** Text.\n- **Three.** Held by `b_test`, `unsafe_code`.\n## Next\n- four";
    let (n, faults) = invariant_faults(text, &guards);
    assert_eq!(n, 3);
    assert_eq!(faults.len(), 2, "{faults:?}");
    assert!(faults[0].contains("Two") && faults[1].contains("b_test"), "{faults:?}");
}

#[test]
fn examples_in_the_documents_are_valid() {
    let folder = tempfile::tempdir().unwrap();
    let machines = folder.path().join("machines");
    fs::create_dir(&machines).unwrap();
    for entry in fs::read_dir("config/machines").unwrap() {
        let from = entry.unwrap().path();
        fs::copy(&from, machines.join(from.file_name().unwrap())).unwrap();
    }
    std::os::unix::fs::symlink(fs::canonicalize("config").unwrap(), folder.path().join("config"))
        .unwrap();
    let made = rcgen::generate_simple_self_signed(vec!["monitor.example.org".to_owned()]).unwrap();
    for (name, text) in [
        ("tokens.toml", String::new()),
        ("monitor.pem", made.cert.pem()),
        ("monitor.key", made.signing_key.serialize_pem()),
    ] {
        let file = folder.path().join(name);
        fs::write(&file, text).unwrap();
        fs::set_permissions(&file, fs::Permissions::from_mode(0o600)).unwrap();
    }
    let (mut n_machines, mut n_configs) = (0, 0);
    for (place, text) in documents("") {
        for block in fenced(&text, "toml") {
            if block.lines().any(|line| line == "[scene]") {
                let scene = Scene::parse(&block, &place);
                assert!(scene.is_ok(), "{place}: {}", scene.unwrap_err());
            } else if block.lines().any(|line| line == "[machine]") {
                let machine = file::parse(&block, &place);
                assert!(machine.is_ok(), "{place}: {}", machine.unwrap_err());
                fs::write(folder.path().join("machine.toml"), &block).unwrap();
                n_machines += 1;
            } else {
                for name in block.split('"').filter(|word| word.ends_with(".h5")) {
                    fs::write(folder.path().join(name), "").unwrap();
                }
                let path = folder.path().join("rotorwatch.toml");
                fs::write(&path, &block).unwrap();
                let read = config::load_with(&path, []);
                assert!(read.is_ok(), "{place}: {}", read.unwrap_err());
                n_configs += 1;
            }
        }
    }
    assert!(n_machines >= 1 && n_configs >= 2, "{n_machines} machines, {n_configs} configurations");
}

#[test]
fn the_configuration_of_the_readme_works_in_a_clean_clone() {
    let readme = fs::read_to_string("README.md").unwrap();
    let blocks = fenced(&readme, "toml");
    let block = blocks.iter().find(|block| block.contains("[[source]]")).unwrap();
    let clone = tempfile::tempdir().unwrap();
    std::os::unix::fs::symlink(fs::canonicalize("config").unwrap(), clone.path().join("config"))
        .unwrap();
    // What a command of the section makes.
    let commands = fenced(&readme, "sh").concat();
    for name in block.split('"').filter(|word| word.ends_with(".h5")) {
        assert!(commands.contains(&format!("--out {name}\n")), "no command makes {name}");
        fs::write(clone.path().join(name), "").unwrap();
    }
    let path = clone.path().join("rotorwatch.toml");
    fs::write(&path, block).unwrap();
    let read = config::load_with(&path, []);
    assert!(read.is_ok(), "{}", read.unwrap_err());
    assert!(!block.contains(":8080"), "the port of the demo, which may run");
    let bare = commands.lines().find(|line| line.starts_with("rotorwatch "));
    assert_eq!(bare, None, "not installed by anything printed before");
}

#[test]
fn commands_in_the_documents_are_commands() {
    let mut n = 0;
    for (place, text) in documents("") {
        for line in fenced(&text, "sh").iter().flat_map(|block| block.lines()) {
            let Some(arguments) = rotorwatch_arguments(line) else { continue };
            let parsed = Cli::try_parse_from(&arguments);
            assert!(parsed.is_ok(), "{place}: {line}\n{}", parsed.unwrap_err());
            n += 1;
        }
    }
    assert!(n >= 4, "only {n} commands found");
}

#[test]
fn links_between_documents_lead_somewhere() {
    let mut n = 0;
    for (place, text) in documents("") {
        let folder = Path::new(&place).parent().unwrap().to_owned();
        for target in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            let path = target.split('#').next().unwrap();
            if path.is_empty() || path.contains("://") {
                continue;
            }
            assert!(folder.join(path).exists(), "{place}: {target} is missing");
            n += 1;
        }
    }
    assert!(n >= 10, "only {n} links found");
}

#[test]
fn abbreviations_are_in_the_glossary() {
    let glossary = fs::read_to_string("docs/glossary.md").unwrap();
    let known: BTreeSet<String> = glossary
        .lines()
        .filter_map(|line| line.strip_prefix("| ")?.split(" |").next())
        .flat_map(abbreviations)
        .collect();
    assert!(known.len() > 20);
    let mut missing = BTreeMap::new();
    for (place, text) in documents("") {
        for word in abbreviations(&prose(&text)).filter(|word| !known.contains(word)) {
            missing.entry(word).or_insert(place.clone());
        }
    }
    assert!(missing.is_empty(), "not in docs/glossary.md: {missing:#?}");
}

// Reading the tree.

/// Markdown documents, by path, whose file name begins with `prefix`.
fn documents(prefix: &str) -> Vec<(String, String)> {
    let mut found = Vec::new();
    for folder in [".", "docs", "docs/adr"] {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap().to_owned();
            if name.ends_with(".md") && name.starts_with(prefix) {
                found.push((path.display().to_string(), fs::read_to_string(&path).unwrap()));
            }
        }
    }
    found.sort();
    assert!(!found.is_empty());
    found
}

/// Rust files under `folder`.
fn sources(folder: &str) -> Vec<Source> {
    let mut waiting = vec![PathBuf::from(folder)];
    let mut found = Vec::new();
    while let Some(path) = waiting.pop() {
        if path.is_dir() {
            waiting.extend(fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().path()));
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let parts = path.with_extension("");
            let parts = parts.iter().skip(1).map(|part| part.to_str().unwrap().to_owned());
            found.push(Source {
                module: parts.filter(|part| part != "mod").collect(),
                place: path.display().to_string(),
                text: fs::read_to_string(&path).unwrap(),
            });
        }
    }
    assert!(!found.is_empty());
    found
}

/// Names of the tests in the tree and of the lints in Cargo.toml.
fn known_guards() -> BTreeSet<String> {
    let mut guards = BTreeSet::new();
    for source in sources("src").into_iter().chain(sources("tests")) {
        let mut is_test = false;
        for line in source.text.lines().map(str::trim) {
            if line == "#[test]" || line == "#[tokio::test]" {
                is_test = true;
            } else if let Some(rest) =
                line.trim_start_matches("async ").strip_prefix("fn ").filter(|_| is_test)
            {
                guards.insert(identifier(rest).to_owned());
                is_test = false;
            }
        }
    }
    let manifest: toml::Table = fs::read_to_string("Cargo.toml").unwrap().parse().unwrap();
    // A test without the harness is one function: it goes by its file.
    for test in manifest["test"].as_array().unwrap() {
        if test.get("harness").is_some_and(|harness| harness.as_bool() == Some(false)) {
            guards.insert(format!("tests/{}.rs", test["name"].as_str().unwrap()));
        }
    }
    for tool in ["rust", "clippy"] {
        guards.extend(manifest["lints"][tool].as_table().unwrap().keys().cloned());
    }
    guards
}

// Checks.

/// Equations of a text: from `**X1**` to the end of the paragraph that names its functions, or a
/// table row `| X1 | … |`.
fn equations(theory: &str) -> Vec<Equation> {
    let mut found: Vec<Equation> = Vec::new();
    let mut is_open = false;
    for line in theory.lines() {
        let paragraph = line.strip_prefix("**").and_then(|rest| rest.split_once("**"));
        let row = line.strip_prefix("| ").and_then(|rest| rest.split_once(" |"));
        let begun = paragraph.or(row).filter(|(number, _)| is_number(number));
        if let Some((number, _)) = begun {
            found.push(Equation { number: number.to_owned(), paths: Vec::new() });
            is_open = true;
        } else if line.starts_with('#')
            || line.is_empty() && found.last().is_some_and(|equation| !equation.paths.is_empty())
        {
            is_open = false;
        }
        if let Some(equation) = found.last_mut().filter(|_| is_open) {
            let quoted = line.split('`').skip(1).step_by(2).filter(|word| word.contains("::"));
            equation.paths.extend(quoted.flat_map(expand));
        }
        if row.is_some() && begun.is_some() {
            is_open = false;
        }
    }
    found
}

/// `a::{b, c}` as `a::b` and `a::c`.
fn expand(path: &str) -> Vec<String> {
    match path.split_once("::{") {
        Some((head, tail)) => {
            let names = tail.trim_end_matches('}').split(", ");
            names.map(|name| format!("{head}::{name}")).collect()
        }
        None => vec![path.to_owned()],
    }
}

fn equation_faults(equations: &[Equation], sources: &[Source]) -> Vec<String> {
    let mut faults = Vec::new();
    let mut defined = BTreeSet::new();
    for equation in equations {
        let number = &equation.number;
        if !defined.insert(number.as_str()) {
            faults.push(format!("{number} is defined twice"));
        }
        if equation.paths.is_empty() {
            faults.push(format!("{number} names no function"));
        }
        for path in &equation.paths {
            match locate(path, sources) {
                Err(why) => faults.push(format!("{number} ({path}): {why}")),
                Ok(files) if !files.iter().any(|file| cited(file).contains(number)) => {
                    let place = &files[0].place;
                    faults.push(format!("{place} does not name {number}, {path} does it"));
                }
                Ok(_) => {}
            }
        }
    }
    for source in sources {
        for number in cited(source).iter().filter(|number| !defined.contains(number.as_str())) {
            faults.push(format!("{}: {number} is not in docs/theory.md", source.place));
        }
    }
    faults
}

/// The files of the module of `a::b::Type::function`, if they define an item of each name left.
fn locate<'a>(path: &str, sources: &'a [Source]) -> Result<Vec<&'a Source>, String> {
    let parts: Vec<&str> = path.split("::").collect();
    let files_of = |n: usize| -> Vec<&Source> {
        let is_in = |source: &&Source| source.module.iter().take(n).eq(parts[..n].iter());
        sources.iter().filter(|source| source.module.len() >= n).filter(is_in).collect()
    };
    let longest = (1..parts.len()).rev().map(|n| (n, files_of(n)));
    let Some((n, files)) = longest.into_iter().find(|(_, files)| !files.is_empty()) else {
        return Err("no such module".to_owned());
    };
    match parts[n..].iter().find(|item| !files.iter().any(|file| defines(file, item))) {
        Some(item) => Err(format!("`{item}` is not defined in {}", parts[..n].join("::"))),
        None => Ok(files),
    }
}

/// Whether a file holds a function or type, or its methods.
fn defines(source: &Source, item: &str) -> bool {
    let of = |line: &str| {
        ["fn ", "struct ", "enum ", "impl "].iter().any(|keyword| {
            line.split(keyword)
                .skip(1)
                .any(|rest| identifier(rest) == item || rest.contains(&format!("> {item}")))
        })
    };
    source.text.lines().filter(|line| !line.trim_start().starts_with("//")).any(of)
}

/// Equations that the comments of a file name: `D9`, `(D9, D10)`, `K2–K5`.
fn cited(source: &Source) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for line in source.text.lines().map(str::trim).filter(|line| line.starts_with("//")) {
        let words = line.split(|c: char| !c.is_alphanumeric() && c != '–' && c != '_');
        for word in words {
            match word.split_once('–') {
                Some((first, last)) if is_number(first) && is_number(last) => {
                    let range = ordinal(first)..=ordinal(last);
                    found.extend(range.map(|n| format!("{}{n}", &first[..1])));
                }
                Some(_) => {}
                None => found.extend(is_number(word).then(|| word.to_owned())),
            }
        }
    }
    found
}

fn is_number(word: &str) -> bool {
    let Some(rest) = word.strip_prefix(|c: char| SERIES.contains(c)) else { return false };
    (1..=2).contains(&rest.len()) && rest.bytes().all(|b| b.is_ascii_digit())
}

fn ordinal(number: &str) -> u32 {
    number[1..].parse().unwrap()
}

fn identifier(text: &str) -> &str {
    let end = text.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(text.len());
    &text[..end]
}

/// Invariants found, and those without a guard that exists.
fn invariant_faults(architecture: &str, guards: &BTreeSet<String>) -> (usize, Vec<String>) {
    let section = architecture.split("## Invariants").nth(1).unwrap_or("");
    let section = section.split("\n## ").next().unwrap_or("");
    let mut faults = Vec::new();
    let items: Vec<&str> = section.split("\n- ").skip(1).collect();
    for item in &items {
        let title = item.lines().next().unwrap_or("");
        let Some((_, held_by)) = item.split_once("Held by") else {
            faults.push(format!("no guard: {title}"));
            continue;
        };
        let named: Vec<&str> = held_by.split('`').skip(1).step_by(2).collect();
        if named.is_empty() {
            faults.push(format!("no guard: {title}"));
        }
        let unknown = named.into_iter().filter(|name| !guards.contains(*name));
        faults.extend(unknown.map(|name| format!("no test or lint `{name}`: {title}")));
    }
    (items.len(), faults)
}

/// A line that calls the program, as its arguments; without a redirection.
fn rotorwatch_arguments(line: &str) -> Option<Vec<String>> {
    let line = line.split(['>', '|', '&', '#']).next()?.trim();
    let rest = ["cargo run --release -- ", "target/release/rotorwatch ", "rotorwatch "]
        .iter()
        .find_map(|start| line.strip_prefix(start))?;
    let words = rest.split_whitespace().map(str::to_owned);
    Some(std::iter::once("rotorwatch".to_owned()).chain(words).collect())
}

/// What stands in square brackets.
fn bracketed(text: &str) -> impl Iterator<Item = &str> {
    text.split('[').skip(1).filter_map(|rest| rest.split(']').next())
}

/// `name2011`, `name2011a` or `iso20816-3`.
fn is_bib_key(key: &str) -> bool {
    let letters = key.bytes().take_while(u8::is_ascii_lowercase).count();
    let rest = key[letters..].trim_end_matches(|c: char| c.is_ascii_lowercase());
    let digits = rest.bytes().filter(u8::is_ascii_digit).count();
    letters >= 3 && digits >= 4 && rest.bytes().all(|b| b.is_ascii_digit() || b == b'-')
}

/// A document without code, addresses and links.
fn prose(text: &str) -> String {
    let mut out = String::new();
    let mut in_fence = false;
    for line in text.lines() {
        if line.starts_with("```") {
            in_fence = !in_fence;
        } else if !in_fence {
            let text: String = line.split('`').step_by(2).collect();
            let mut parts = text.split("](");
            out.push_str(parts.next().unwrap_or(""));
            out.extend(parts.filter_map(|part| part.split_once(')')).map(|(_, rest)| rest));
            out.push('\n');
        }
    }
    out
}

/// Words of at least three capital letters, digits aside.
fn abbreviations(text: &str) -> impl Iterator<Item = String> {
    let words = text.split(|c: char| !c.is_alphanumeric());
    words.filter(|w| w.len() >= 3 && w.bytes().all(|b| b.is_ascii_uppercase())).map(str::to_owned)
}
