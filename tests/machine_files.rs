//! The machine files of the real recordings must read.

#![expect(clippy::unwrap_used, reason = "a test may panic; clippy exempts only #[test] functions")]
#![expect(clippy::print_stdout, reason = "a skipped test says so on stdout")]

use std::path::{Path, PathBuf};

use rotorwatch::machine::{Machine, file, kinematics, report};
use rotorwatch::units::Hz;

/// Every machine file of a folder, read, by file name.
fn machines_in(folder: &Path) -> Vec<(PathBuf, Machine)> {
    let mut paths: Vec<PathBuf> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "toml"));
    paths.sort();
    let read = |path: PathBuf| {
        let text = std::fs::read_to_string(&path).unwrap();
        let machine = file::parse(&text, &path.display().to_string());
        assert!(machine.is_ok(), "{}", machine.unwrap_err());
        (path, machine.unwrap())
    };
    paths.into_iter().map(read).collect()
}

/// What must hold of any machine that reads.
fn assert_sound(path: &Path, machine: &Machine) {
    let place = path.display();
    let speed = machine.nominal_speed().unwrap_or(Hz(25.0));
    let table = kinematics::frequency_table(machine, speed);
    assert!(!table.lines.is_empty(), "{place}");
    for bearing in machine.bearings.iter().filter(|bearing| bearing.geometry.is_some()) {
        let n_lines = table.lines.iter().filter(|line| line.owner_id == bearing.id).count();
        assert!(n_lines >= 13, "{place}: {} has {n_lines} lines", bearing.id);
    }
    let text = report::frequencies(machine, &table, Hz(0.5));
    assert!(text.lines().count() > table.lines.len(), "{place}");
}

#[test]
fn every_example_reads() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/machines");
    let machines = machines_in(&folder);
    assert!(machines.len() >= 2);
    for (path, machine) in &machines {
        assert_sound(path, machine);
    }
}

#[test]
#[ignore = "needs the real recordings: set ROTORWATCH_DATA"]
fn every_machine_of_the_recordings_reads() {
    let Some(data) = std::env::var_os("ROTORWATCH_DATA") else {
        println!("SKIPPED every_machine_of_the_recordings_reads: ROTORWATCH_DATA is not set");
        return;
    };
    let machines = machines_in(&Path::new(&data).join("machines"));
    assert!(!machines.is_empty());
    for (path, machine) in &machines {
        assert_sound(path, machine);
    }
}
