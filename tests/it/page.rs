//! The status page in a browser: what an operator sees, not what the server sends.

#![expect(clippy::print_stdout, reason = "a test that skips itself says so")]

use crate::scene;
use crate::support;
use crate::support::Daemon;
use std::process::Command;

/// Text of the page as Chromium shows it after `budget_ms` of its own time.
fn shown(url: &str, budget_ms: u32) -> Option<String> {
    let profile = tempfile::tempdir().unwrap();
    let browser = std::env::var_os("CHROMIUM").unwrap_or_else(|| "chromium".into());
    let output = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"])
        .args(["--disable-background-networking", "--disable-component-update", "--disable-sync"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg(format!("--virtual-time-budget={budget_ms}"))
        .args(["--dump-dom", url])
        .output()
        .ok()?;
    Some(String::from_utf8_lossy(&output.stdout).into_owned())
}

#[test]
#[ignore = "needs chromium: apt install chromium, or set CHROMIUM"]
fn the_page_shows_the_damaged_bearing_and_its_alarm() {
    let config = "[server]\nbind = \"127.0.0.1:0\"\n[[machine]]\nfile = \"rig.toml\"\n[[source]]\n\
         kind = \"replay\"\nmachine = \"rig-1\"\nfile = \"x.h5\"\nspeed = \"max\"\n";
    let dir = support::folder(config, &[("rig.toml", scene::MACHINE.as_bytes())]);
    scene::write(&dir.path().join("x.h5"), &scene::samples(1), None);
    let daemon = Daemon::start_in(dir);
    daemon.wait_finished("rig-1");
    let Some(page) = shown(&format!("{}/", daemon.base_url), 8000) else {
        println!("SKIPPED the_page_shows_the_damaged_bearing_and_its_alarm: no chromium");
        return;
    };
    for text in ["right", "inner race", "damaged", "BPFI", "unacknowledged", "Acknowledge"] {
        assert!(page.contains(text), "{text} is not on the page:\n{page}");
    }
    assert!(!page.contains("NaN") && !page.contains("undefined"), "{page}");
}
