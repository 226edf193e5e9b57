//! The one place where configuration meets the machine file's parser.

use crate::machine::Machine;
use crate::machine::limits::Limits;

/// Reads a machine file's text; gives every mistake found, each with line and key.
pub(super) fn parse(text: &str) -> Result<Machine, Vec<String>> {
    // Stands in for `machine::file::parse` until that lands: id and name only.
    let table: toml::Table =
        toml::from_str(text).map_err(|error| vec![error.message().to_owned()])?;
    let text_of = |key: &str| {
        table.get("machine")?.get(key)?.as_str().map(str::to_owned).filter(|text| !text.is_empty())
    };
    let id = text_of("id").ok_or_else(|| vec!["machine.id: missing".to_owned()])?;
    Ok(Machine {
        name: text_of("name").unwrap_or_else(|| id.clone()),
        id,
        iso_group: None,
        power_kw: None,
        shafts: Vec::new(),
        bearings: Vec::new(),
        motors: Vec::new(),
        gears: Vec::new(),
        sensors: Vec::new(),
        limits: Limits::default(),
    })
}
