//! The machine and its lines as aligned text for people (`rotorwatch check`).
//!
//! Text only: the numbers come from [`super::kinematics`]. Must not know where the text goes.

use super::Machine;
use super::catalogue;
use super::kinematics::FrequencyTable;
use super::kinematics::coincidence::{Coincidence, MAX_COINCIDENCES};
use super::kinematics::line::FrequencyLine;
use crate::units::Hz;

/// Most coincidences written out.
const MAX_LISTED: usize = 40;

/// One line on what the file describes: `rig-1: 2 shafts, 2 bearings, 1 gear, …`, and its notes.
#[must_use]
pub fn summary(machine: &Machine) -> String {
    let counts = [
        (machine.shafts.len(), "shaft"),
        (machine.bearings.len(), "bearing"),
        (machine.gears.len(), "gear"),
        (machine.motors.len(), "motor"),
        (machine.sensors.len(), "sensor"),
        (machine.sensor_pairs().len(), "x/y pair"),
    ];
    let counts: Vec<String> = counts
        .iter()
        .filter(|&&(n, _)| n > 0)
        .map(|&(n, name)| format!("{n} {name}{}", if n == 1 { "" } else { "s" }))
        .collect();
    let mut text = format!("{}: {}\n", machine.id, counts.join(", "));
    for note in &machine.notes {
        text.push_str(&format!("note: {note}\n"));
    }
    text
}

/// The frequency table as aligned columns, what is not listed and why, and the lines that coincide
/// within `resolution`.
#[must_use]
pub fn frequencies(machine: &Machine, table: &FrequencyTable, resolution: Hz) -> String {
    let first = machine.shafts.first().map_or("", |shaft| shaft.id.as_str());
    let speed = table.first_shaft_speed;
    let mut text =
        format!("lines at {:.4} Hz ({:.1} r/min) of {first}\n\n", speed.0, speed.to_rpm().0);
    text.push_str(&columns(&rows(machine, table)));
    if !table.unlisted.is_empty() {
        text.push_str("\nnot listed\n");
        for &(owner, why) in &table.unlisted {
            let line = format!("  {} {}: {}\n", owner.kind_name(), owner.id(machine), why.reason());
            text.push_str(&line);
        }
    }
    text.push_str(&coinciding(table, resolution));
    text
}

/// A row of cells: part, id, line, Hz, order, shaft, limits.
type Row = [String; 7];

fn rows(machine: &Machine, table: &FrequencyTable) -> Vec<Row> {
    let any_band = table.lines.iter().any(|line| !line.band.is_zero());
    let band = if any_band { "geometry" } else { "" };
    let head = ["part", "id", "line", "Hz", "order", "of shaft", band].map(str::to_owned);
    let row = |line: &FrequencyLine| {
        let order = line.order.map_or("-".to_owned(), |order| format!("{:.4}", order.0));
        [
            line.owner.kind_name().to_owned(),
            line.owner_id.clone(),
            line.kind.label(),
            format!("{:.4}", line.frequency.0),
            order,
            machine.shaft(line.shaft).id.clone(),
            if line.band.is_zero() { String::new() } else { catalogue::percent(line.band) },
        ]
    };
    std::iter::once(head).chain(table.lines.iter().map(row)).collect()
}

/// Pads every column to its widest cell.
fn columns(rows: &[Row]) -> String {
    let mut widths = [0; 7];
    for row in rows {
        for (width, cell) in widths.iter_mut().zip(row) {
            *width = cell.chars().count().max(*width);
        }
    }
    let mut text = String::new();
    for row in rows {
        let mut line = String::new();
        for (index, (cell, width)) in row.iter().zip(widths).enumerate() {
            let number = index == 3 || index == 4;
            let padding = " ".repeat(width - cell.chars().count());
            let gap = if index == 0 { "" } else { "  " };
            let (before, after) =
                if number { (padding, String::new()) } else { (String::new(), padding) };
            line.push_str(&[gap, &before, cell, &after].concat());
        }
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text
}

/// Names the lines a spectrum of this resolution cannot tell apart.
fn coinciding(table: &FrequencyTable, resolution: Hz) -> String {
    let pairs = table.coincidences(resolution);
    if pairs.is_empty() {
        return format!("\nno lines closer than {} Hz\n", resolution.0);
    }
    let mut text = format!("\ncloser than {} Hz, not told apart by frequency\n", resolution.0);
    for pair in pairs.iter().take(MAX_LISTED) {
        text.push_str(&coincidence(table, pair));
    }
    if pairs.len() > MAX_LISTED {
        let more = pairs.len() - MAX_LISTED;
        let at_least = if pairs.len() == MAX_COINCIDENCES { "at least " } else { "" };
        text.push_str(&format!("  and {at_least}{more} more\n"));
    }
    text
}

fn coincidence(table: &FrequencyTable, pair: &Coincidence) -> String {
    let name = |index: usize| {
        let line = &table.lines[index];
        format!("{} {}", line.owner_id, line.kind.label())
    };
    let frequency = table.lines[pair.a].frequency.0;
    format!("  {frequency:.4} Hz: {} and {}\n", name(pair.a), name(pair.b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::file;
    use crate::machine::kinematics;

    const STAND: &str = include_str!("../../config/machines/motor-stand.toml");

    #[test]
    fn summary_counts_what_there_is() {
        let stand = file::parse(STAND, "motor-stand.toml").unwrap();
        let text = summary(&stand);
        let first = text.lines().next().unwrap();
        assert_eq!(first, "motor-stand: 1 shaft, 2 bearings, 1 motor, 3 sensors");
        assert!(text.lines().nth(1).unwrap().starts_with("note: line "), "{text}");
    }

    #[test]
    fn table_is_aligned_and_names_what_it_cannot_tell_apart() {
        let text = "[machine]\nid='m'\n[[shaft]]\nid='s'\n[[shaft]]\nid='loose'\n\
                    [[motor]]\nshaft='s'\npoles=2\nsynchronous=true\n";
        let machine = file::parse(text, "m.toml").unwrap();
        let table = kinematics::frequency_table(&machine, Hz(12.5));
        let expected = "\
lines at 12.5000 Hz (750.0 r/min) of s

part   id        line                        Hz   order  of shaft
shaft  s         1x                     12.5000  1.0000  s
shaft  s         2x                     25.0000  2.0000  s
shaft  s         3x                     37.5000  3.0000  s
motor  motor[0]  synchronous supply     12.5000  1.0000  s
motor  motor[0]  2x synchronous supply  25.0000  2.0000  s

not listed
  shaft loose: its speed is not connected to the first shaft by speed_hz, ratio_to or gears

closer than 0.5 Hz, not told apart by frequency
  12.5000 Hz: s 1x and motor[0] synchronous supply
  25.0000 Hz: s 2x and motor[0] 2x synchronous supply
";
        assert_eq!(frequencies(&machine, &table, Hz(0.5)), expected);
    }

    #[test]
    fn lines_of_a_catalogue_bearing_show_what_its_geometry_leaves() {
        let text = "[machine]\nid='m'\n[[shaft]]\nid='s'\n\
                    [[bearing]]\nid='b'\nshaft='s'\ncatalogue='SKF 6205'\n";
        let machine = file::parse(text, "m.toml").unwrap();
        let table = kinematics::frequency_table(&machine, Hz(10.0));
        let text = frequencies(&machine, &table, Hz(0.001));
        let line = text.lines().find(|line| line.contains("  BPFO ")).unwrap();
        assert!(line.ends_with("±0.4 %"), "{line}");
        let shaft = text.lines().find(|line| line.starts_with("shaft")).unwrap();
        assert!(shaft.ends_with("  s"), "{shaft}");
    }

    #[test]
    fn long_lists_of_coincidences_are_cut_and_counted() {
        let stand = file::parse(STAND, "motor-stand.toml").unwrap();
        let table = kinematics::frequency_table(&stand, Hz(29.5));
        let n_pairs = table.coincidences(Hz(50.0)).len();
        let text = frequencies(&stand, &table, Hz(50.0));
        assert!(n_pairs > MAX_LISTED);
        assert!(text.ends_with(&format!("  and {} more\n", n_pairs - MAX_LISTED)), "{text}");
        assert!(frequencies(&stand, &table, Hz(0.0)).ends_with("no lines closer than 0 Hz\n"));
    }
}
