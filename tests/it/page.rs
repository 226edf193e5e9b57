//! The status page in a browser: what an operator sees, not what the server sends.

#![expect(clippy::print_stdout, reason = "a test that skips itself says so")]

use crate::scene;
use crate::simulated;
use crate::support;
use crate::support::Daemon;
use rotorwatch::simulator::scenario::COMBINATIONS;
use rotorwatch::simulator::scene::builtin;
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

/// Folder for a picture of the page, if somebody wants to see it.
const PICTURES: &str = "ROTORWATCH_PICTURES";

/// Takes a picture of the page if [`PICTURES`] names a folder.
fn picture(url: &str, name: &str) {
    let Some(folder) = std::env::var_os(PICTURES) else { return };
    let profile = tempfile::tempdir().unwrap();
    let browser = std::env::var_os("CHROMIUM").unwrap_or_else(|| "chromium".into());
    let file = std::path::Path::new(&folder).join(name);
    let taken = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-gpu", "--window-size=1200,1600"])
        .arg(format!("--user-data-dir={}", profile.path().display()))
        .arg("--virtual-time-budget=8000")
        .arg(format!("--screenshot={}", file.display()))
        .arg(url)
        .output();
    assert!(taken.is_ok(), "{taken:?}");
}

#[test]
#[ignore = "needs chromium: apt install chromium, or set CHROMIUM"]
fn the_page_offers_scenarios_of_a_simulated_machine_only() {
    let daemon = Daemon::start_in(simulated::folder("", &["rig-1"]));
    let path = "/api/v1/simulation/scenario";
    let bent = serde_json::json!({ "scenario": "GG_BS_GB" });
    assert_eq!(daemon.post_json(path, &bent).0, 200);
    simulated::wait_for_shaft(&daemon, "rig-1", "damaged", Some("bow"));
    let url = format!("{}/", daemon.base_url);
    let Some(page) = shown(&url, 8000) else {
        println!("SKIPPED the_page_offers_scenarios_of_a_simulated_machine_only: no chromium");
        return;
    };
    let section = "<section id=\"simulation\" aria-labelledby=\"simulation-title\"";
    assert!(page.contains(&format!("{section}>")), "{page}");
    for text in [
        "GG_GS_GB: nothing bad",
        "GG_BS_GB: shaft bad",
        "Scenario GG_BS_GB since ",
        "bow of 203 µm",
        "as fast as it is analysed",
    ] {
        assert!(page.contains(text), "{text} is not on the page:\n{page}");
    }
    assert!(!page.contains("GG_GS_BB"), "the scene has no ball bearing");
    assert!(!page.contains("NaN") && !page.contains("undefined"), "{page}");
    picture(&url, "simulation.png");
    let config = "[[machine]]\nfile = \"rig.toml\"\n[[source]]\nkind = \"replay\"\n\
                  machine = \"rig-1\"\nfile = \"x.h5\"\n";
    let dir = support::folder(
        &format!("[server]\nbind = \"127.0.0.1:0\"\n{config}"),
        &[("rig.toml", support::MACHINE.as_bytes())],
    );
    support::write_ramp(&dir, "x.h5", 1000.0, 20_000);
    let replayed = Daemon::start_in(dir);
    let page = shown(&format!("{}/", replayed.base_url), 8000).unwrap();
    assert!(page.contains(&format!("{section} hidden")), "{page}");
}

#[test]
#[ignore = "needs chromium: apt install chromium, or set CHROMIUM"]
fn the_page_offers_all_eight_combinations_of_the_rig_with_the_gear() {
    let config = "[server]\nbind = \"127.0.0.1:0\"\n[[machine]]\nfile = \"rig.toml\"\n[[source]]\n\
         kind = \"simulated\"\nmachine = \"rig-1\"\nscene = \"GG_GS_GB\"\n";
    let rig = builtin::machine("../machines/rig.toml").unwrap();
    let daemon = Daemon::start_in(support::folder(config, &[("rig.toml", rig.as_bytes())]));
    let bad = serde_json::json!({ "scenario": "BG_GS_GB" });
    assert_eq!(daemon.post_json("/api/v1/simulation/scenario", &bad).0, 200);
    let url = format!("{}/", daemon.base_url);
    let Some(page) = shown(&url, 8000) else {
        println!(
            "SKIPPED the_page_offers_all_eight_combinations_of_the_rig_with_the_gear: no chromium"
        );
        return;
    };
    for name in COMBINATIONS {
        assert!(page.contains(&format!("<option value=\"{name}\">{name}: ")), "{name}:\n{page}");
    }
    for text in ["BG_BS_BB: gear, shaft, bearing bad", "tooth 23 of mesh-1: worn, 12.7 µm deep"] {
        assert!(page.contains(text), "{text} is not on the page:\n{page}");
    }
    assert!(!page.contains("NaN") && !page.contains("undefined"), "{page}");
    picture(&url, "gears.png");
}
