//! Programs of others that read and write HDF5: h5py with hdf5plugin, and h5dump.

use std::path::Path;
use std::process::Command;

/// Runs a script of this folder with `$PYTHON`; `None`, told as skipped, without the packages.
pub(crate) fn python(test: &str, script: &str, arguments: &[&Path]) -> Option<String> {
    let python = std::env::var("PYTHON").unwrap_or_else(|_| "python3".into());
    let there = Command::new(&python).args(["-c", "import h5py, hdf5plugin"]).output();
    if !there.is_ok_and(|output| output.status.success()) {
        println!("SKIPPED {test}: {python} has no h5py and hdf5plugin");
        return None;
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/conformance").join(script);
    Some(output(Command::new(&python).arg(script).args(arguments)))
}

/// Runs `$H5DUMP`; `None`, told as skipped, if there is none.
pub(crate) fn h5dump(test: &str, arguments: &[&str], file: &Path) -> Option<String> {
    let h5dump = std::env::var("H5DUMP").unwrap_or_else(|_| "h5dump".into());
    if Command::new(&h5dump).arg("--version").output().is_err() {
        println!("SKIPPED {test}: no program {h5dump}");
        return None;
    }
    Some(output(Command::new(&h5dump).args(arguments).arg(file)))
}

fn output(command: &mut Command) -> String {
    let output = command.output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{command:?}: {errors}");
    String::from_utf8(output.stdout).unwrap()
}
