//! The settings of a monitor as TOML and back, bit by bit.

use crate::alarms;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::rate::FalseAlarms;
use crate::pipeline::Settings;
use crate::pipeline::SpeedHints;
use crate::units::Hz;
use toml::Table;
use toml::Value;

/// Settings and speeds as a table; the baseline is kept apart.
pub(super) fn table(settings: &Settings, hints: &SpeedHints) -> Table {
    let Settings { window_s, hop_s, ring_s, alarms, load, false_alarms, .. } = settings;
    let mut table = numbers([
        ("window_s", Some(*window_s)),
        ("hop_s", Some(*hop_s)),
        ("ring_s", Some(*ring_s)),
        ("load", *load),
        ("speed_option_hz", hints.option.map(|hz| hz.0)),
        ("speed_capture_hz", hints.capture.map(|hz| hz.0)),
    ]);
    let FalseAlarms { per_decision, a_year } = *false_alarms;
    let false_alarms =
        numbers([("per_decision", Some(per_decision)), ("a_component_year", a_year)]);
    table.insert("false_alarms".to_owned(), Value::Table(false_alarms));
    let mut policy = numbers([
        ("on_delay_s", Some(alarms.on_delay_s)),
        ("off_delay_s", Some(alarms.off_delay_s)),
        ("missing_after_s", Some(alarms.missing_after_s)),
        ("max_shelving_s", Some(alarms.max_shelving_s)),
    ]);
    let history_len = i64::try_from(alarms.history_len).unwrap_or(i64::MAX);
    policy.insert("history_len".to_owned(), Value::Integer(history_len));
    table.insert("alarms".to_owned(), Value::Table(policy));
    table
}

/// Reads what [`table`] made; `None`: it is something else.
pub(super) fn read(table: &Table) -> Option<(Settings, SpeedHints)> {
    let number = |table: &Table, key: &str| table.get(key)?.as_float();
    let optional = |table: &Table, key: &str| match table.get(key) {
        None => Some(None),
        Some(value) => value.as_float().map(Some),
    };
    let false_alarms = table.get("false_alarms")?.as_table()?;
    let policy = table.get("alarms")?.as_table()?;
    let history_len = usize::try_from(policy.get("history_len")?.as_integer()?).ok()?;
    let settings = Settings {
        window_s: number(table, "window_s")?,
        hop_s: number(table, "hop_s")?,
        ring_s: number(table, "ring_s")?,
        baseline: Baseline::default(),
        provisional_segments: None,
        alarms: alarms::Settings {
            on_delay_s: number(policy, "on_delay_s")?,
            off_delay_s: number(policy, "off_delay_s")?,
            history_len,
            missing_after_s: number(policy, "missing_after_s")?,
            max_shelving_s: number(policy, "max_shelving_s")?,
        },
        load: optional(table, "load")?,
        false_alarms: FalseAlarms {
            per_decision: number(false_alarms, "per_decision")?,
            a_year: optional(false_alarms, "a_component_year")?,
        },
    };
    let hints = SpeedHints {
        option: optional(table, "speed_option_hz")?.map(Hz),
        capture: optional(table, "speed_capture_hz")?.map(Hz),
    };
    Some((settings, hints))
}

fn numbers<const N: usize>(entries: [(&str, Option<f64>); N]) -> Table {
    let present = entries.into_iter().filter_map(|(key, number)| Some((key, number?)));
    present.map(|(key, number)| (key.to_owned(), Value::Float(number))).collect()
}
