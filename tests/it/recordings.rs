//! A recording of a real machine through the daemon, where there is one.

#![expect(clippy::print_stdout, reason = "a test that skips itself says so")]

use crate::support::Daemon;
use std::path::Path;

#[test]
#[ignore = "needs the real recordings: set ROTORWATCH_DATA"]
fn the_inner_race_of_a_real_motor_is_named_over_http() {
    let Some(data) = std::env::var_os("ROTORWATCH_DATA") else {
        let name = "the_inner_race_of_a_real_motor_is_named_over_http";
        println!("SKIPPED {name}: ROTORWATCH_DATA does not name the real recordings");
        return;
    };
    let data = std::fs::canonicalize(Path::new(&data)).unwrap();
    let config = format!(
        "[[machine]]\nfile = {:?}\n[[source]]\nkind = \"replay\"\nmachine = \"cwru\"\nfile = {:?}\n",
        data.join("machines/cwru.toml"),
        data.join("cwru/105_12k_Drive_End_IR007_0.h5")
    );
    let daemon = Daemon::start(&config, &[]);
    daemon.wait_finished("cwru");
    let (_, health) = daemon.get_json("/api/v1/machines/cwru/health");
    let components = health["components"].as_array().unwrap();
    let accused: Vec<_> = components
        .iter()
        .filter(|c| c["state"] == "damaged" || c["state"] == "warning")
        .map(|c| (c["id"].as_str().unwrap(), c["fault"].as_str().unwrap_or("not proven")))
        .collect();
    assert_eq!(accused, [("drive-end", "inner_race")], "{health:#}");
    let (_, alarms) = daemon.get_json("/api/v1/alarms");
    assert_eq!(alarms["items"].as_array().unwrap().len(), 1, "{alarms:#}");
}
