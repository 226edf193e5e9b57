//! The file and the environment key by key: places, unknown keys, wrong types, ranges.

use super::ConfigErrors;
use super::Problem;
use super::keys;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::Path;
use toml::de::DeTable;
use toml::de::DeValue;

/// Environment variables with this beginning are ours.
const PREFIX: &str = "ROTORWATCH__";

/// A file read key by key.
#[derive(Debug)]
pub(super) struct Scan {
    /// Name of the file, for messages.
    file: String,
    /// Byte offset of every key present, by path (`pipeline.workers`, `machine[0].file`).
    offsets: BTreeMap<String, usize>,
    /// Byte offsets at which lines begin.
    lines: Vec<usize>,
    /// The values that passed.
    pub(super) values: toml::Table,
    /// What did not.
    pub(super) problems: Vec<Problem>,
}

impl Scan {
    /// Whether the file has this key, right or wrong.
    pub(super) fn has(&self, path: &str) -> bool {
        self.offsets.contains_key(path)
    }

    /// Notes a mistake at a key, or at the nearest section around it that is present.
    pub(super) fn report(&mut self, path: &str, message: String) {
        let nearest = std::iter::successors(Some(path), |p| p.rfind('.').map(|dot| &p[..dot]))
            .find_map(|p| self.offsets.get(p));
        let place = match nearest {
            Some(&offset) => self.place(offset),
            None => self.file.clone(),
        };
        self.problems.push(Problem { place, message: format!("{path}: {message}") });
    }

    /// `file:line:column` of a byte offset, counted from 1.
    fn place(&self, offset: usize) -> String {
        let line = self.lines.partition_point(|&start| start <= offset);
        let column = offset - self.lines[line.saturating_sub(1)] + 1;
        format!("{}:{line}:{column}", self.file)
    }
}

/// Reads a file's text.
///
/// # Errors
/// When the text is not TOML; every other mistake goes to [`Scan::problems`].
pub(super) fn file(path: &Path, text: &str) -> Result<Scan, ConfigErrors> {
    let mut scan = Scan {
        file: path.display().to_string(),
        offsets: BTreeMap::new(),
        lines: std::iter::once(0).chain(text.match_indices('\n').map(|(at, _)| at + 1)).collect(),
        values: toml::Table::new(),
        problems: Vec::new(),
    };
    let (tree, errors) = DeTable::parse_recoverable(text);
    let table: Result<toml::Table, _> = toml::from_str(text);
    if errors.is_empty()
        && let Ok(table) = table
    {
        note_offsets(tree.get_ref(), "", &mut scan.offsets);
        check_sections(table, &mut scan);
        return Ok(scan);
    }
    let first_only = table.err().filter(|_| errors.is_empty());
    let problems = errors.iter().chain(&first_only).map(|error| Problem {
        place: scan.place(error.span().map_or(0, |span| span.start)),
        message: error.message().to_owned(),
    });
    Err(ConfigErrors(problems.collect()))
}

/// Picks our variables out of the environment, checks them, and gives those that passed.
pub(super) fn environment(
    variables: impl IntoIterator<Item = (String, OsString)>,
    problems: &mut Vec<Problem>,
) -> BTreeMap<String, String> {
    let mut passed = BTreeMap::new();
    for (name, value) in variables {
        let upper = name.to_uppercase();
        let Some(rest) = upper.strip_prefix(PREFIX) else { continue };
        let path = rest.to_lowercase();
        let key = path.rsplit_once("__");
        let key = key.and_then(|(section, key)| keys::find(&section.replace("__", "."), key));
        let checked = match (key.filter(|key| key.variable().is_some()), value.to_str()) {
            (Some(key), Some(text)) => key.check_text(text),
            (Some(_), None) => Err("the value is not UTF-8".to_owned()),
            (None, _) => Err(format!(
                "no such setting: allowed are {}; machines and sources are set in the file",
                variable_names()
            )),
        };
        match (checked, value.into_string()) {
            (Ok(()), Ok(text)) => {
                passed.insert(upper, text);
            }
            (Err(message), _) => problems.push(Problem {
                place: "environment".to_owned(),
                message: format!("{name}: {message}"),
            }),
            (Ok(()), Err(_)) => {} // check_text saw it as UTF-8
        }
    }
    passed
}

fn variable_names() -> String {
    keys::KEYS.iter().filter_map(keys::Key::variable).collect::<Vec<_>>().join(", ")
}

/// Notes where each key of sections and of the tables in lists begins.
fn note_offsets(table: &DeTable<'_>, prefix: &str, offsets: &mut BTreeMap<String, usize>) {
    for (key, value) in table {
        let path = format!("{prefix}{}", key.get_ref());
        offsets.insert(path.clone(), key.span().start);
        match value.get_ref() {
            DeValue::Table(inner) => note_offsets(inner, &format!("{path}."), offsets),
            DeValue::Array(items) => {
                for (i, item) in items.iter().enumerate() {
                    offsets.insert(format!("{path}[{i}]"), item.span().start);
                    if let DeValue::Table(inner) = item.get_ref() {
                        note_offsets(inner, &format!("{path}[{i}]."), offsets);
                    }
                }
            }
            DeValue::String(_)
            | DeValue::Integer(_)
            | DeValue::Float(_)
            | DeValue::Boolean(_)
            | DeValue::Datetime(_) => {}
        }
    }
}

/// Checks every section; what passed goes to `scan.values`.
fn check_sections(table: toml::Table, scan: &mut Scan) {
    for (section, value) in table {
        if keys::LISTS.iter().any(|list| list.starts_with(&format!("{section}."))) {
            check_lists_below(section, value, scan);
        } else if keys::SECTIONS.contains(&section.as_str()) {
            let Some(entries) = value.as_table() else {
                scan.report(&section, format!("write it as [{section}]"));
                continue;
            };
            let passed = check_entries(&section, &section, entries, scan);
            scan.values.insert(section, toml::Value::Table(passed));
        } else if keys::LISTS.contains(&section.as_str()) {
            if let Some(passed) = check_list(&section, &value, scan) {
                scan.values.insert(section, passed);
            }
        } else {
            let allowed = [keys::SECTIONS, keys::LISTS].concat().join(", ");
            scan.report(&section, format!("unknown key, allowed here: {allowed}"));
        }
    }
}

/// Checks the lists that stand below a section, as `[[notify.webhook]]`.
fn check_lists_below(section: String, value: toml::Value, scan: &mut Scan) {
    let toml::Value::Table(lists) = value else {
        scan.report(&section, format!("write it as [[{section}.…]]"));
        return;
    };
    let mut passed = toml::Table::new();
    for (name, value) in lists {
        let list = format!("{section}.{name}");
        if keys::LISTS.contains(&list.as_str()) {
            passed.extend(check_list(&list, &value, scan).map(|items| (name, items)));
        } else {
            let below = keys::LISTS.iter().filter(|list| list.starts_with(&format!("{section}.")));
            let allowed = below.copied().collect::<Vec<_>>().join(", ");
            scan.report(&list, format!("unknown key, allowed here: {allowed}"));
        }
    }
    scan.values.insert(section, toml::Value::Table(passed));
}

/// Checks a repeated section.
fn check_list(section: &str, value: &toml::Value, scan: &mut Scan) -> Option<toml::Value> {
    let items = value.as_array().map(|items| items.iter().map(toml::Value::as_table));
    let Some(items) = items.and_then(|items| items.collect::<Option<Vec<_>>>()) else {
        scan.report(section, format!("write each one as [[{section}]]"));
        return None;
    };
    let passed = items.into_iter().enumerate().map(|(i, entries)| {
        let path = format!("{section}[{i}]");
        toml::Value::Table(check_entries(section, &path, entries, scan))
    });
    Some(toml::Value::Array(passed.collect()))
}

/// Checks the keys of one section and keeps those that passed.
fn check_entries(section: &str, path: &str, entries: &toml::Table, scan: &mut Scan) -> toml::Table {
    let mut passed = toml::Table::new();
    for (name, value) in entries {
        let place = format!("{path}.{name}");
        let below = format!("{section}.{name}");
        if keys::SECTIONS.contains(&below.as_str()) {
            let Some(entries) = value.as_table() else {
                scan.report(&place, format!("write it as [{below}]"));
                continue;
            };
            let inner = check_entries(&below, &place, entries, scan);
            passed.insert(name.clone(), toml::Value::Table(inner));
            continue;
        }
        match keys::find(section, name).map(|key| key.check(value)) {
            Some(Ok(())) => {
                passed.insert(name.clone(), value.clone());
            }
            Some(Err(message)) => scan.report(&place, message),
            None => {
                let message = match keys::moved(section, name) {
                    Some(remedy) => remedy.to_owned(),
                    None => format!("unknown key, allowed here: {}", keys::names_of(section)),
                };
                scan.report(&place, message);
            }
        }
    }
    passed
}
