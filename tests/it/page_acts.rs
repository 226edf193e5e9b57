//! What operators do on the page beside alarms: maintenance, feedback, captures; and fleets of hundreds.

use crate::browser::Browser;
use crate::browser::ENTER;
use crate::browser::Size;
use crate::browser::TAB;
use crate::page;
use crate::support;
use crate::support::Daemon;
use serde_json::Value;
use serde_json::json;

/// Machines of a large fleet.
const N_MACHINES: usize = 500;

#[test]
#[ignore = "needs chromium and chromium-driver: apt install them, or set CHROMIUM and CHROMEDRIVER"]
fn a_machine_is_maintained_judged_by_people_and_its_capture_again_from_the_page() {
    let test = "a_machine_is_maintained_judged_by_people_and_its_capture_again_from_the_page";
    let Some(browser) = Browser::open(test, Size::Desktop) else { return };
    let daemon = page::damaged_bearing();
    browser.go(&format!("{}/#/machine/rig-1", daemon.base_url));
    browser.wait(
        "document.querySelector('[data-act=\"maintenance\"]')?.textContent === 'Maintenance'",
    );
    browser.click("[data-act=\"maintenance\"]");
    browser.wait("document.activeElement?.name === 'author'");
    browser.keys(&format!("M. Ito{TAB}new belt{ENTER}"));
    browser.wait(
        "document.querySelector('.note.maintained')?.textContent.includes('by M. Ito: new belt')",
    );
    browser.go(&format!("{}/#/", daemon.base_url));
    browser.wait(
        "document.querySelector('.pill.maintained')?.textContent.startsWith('maintenance until')",
    );
    // Nobody is asked for while it lasts.
    browser.wait("document.querySelector('#nav [data-view=\"alarms\"] .count') === null");
    browser.go(&format!("{}/#/machine/rig-1", daemon.base_url));
    browser.wait(
        "document.querySelector('[data-act=\"maintenance\"]')?.textContent === 'End maintenance'",
    );
    browser.click("[data-act=\"maintenance\"]");
    browser.wait("document.activeElement?.name === 'author'");
    browser.keys(&format!("{TAB}runs{ENTER}"));
    browser.wait("document.querySelector('.note.maintained') === null");
    browser
        .wait("document.querySelector('#nav [data-view=\"alarms\"] .count')?.textContent === '1'");

    browser.click("[data-feedback=\"confirmed\"]");
    browser.wait("document.activeElement?.name === 'author'");
    browser.keys(&format!("{TAB}spall of 3 mm{ENTER}"));
    browser.wait("document.querySelector('.feedback-list')?.textContent.includes('confirmed: spall of 3 mm')");
    let (_, said) = daemon.get_json("/api/v1/machines/rig-1/diagnosis/feedback");
    assert_eq!(said["items"][0]["outcome"], "confirmed");

    let captured = || {
        let (_, list) = daemon.get_json("/api/v1/captures");
        (list["items"][0]["state"] == "complete").then_some(())
    };
    support::wait_until("the capture", captured);
    browser.go(&format!("{}/#/captures", daemon.base_url));
    browser.wait("document.querySelector('[data-judge]:not([disabled])') !== null");
    browser.click("[data-judge]");
    browser.wait("document.querySelector('dialog [data-judged]') !== null");
    let told = browser.text("dialog");
    assert!(told.contains("bearing") && told.contains("windows are the same bit by bit"), "{told}");
    browser.no_errors();
}

#[test]
#[ignore = "needs chromium and chromium-driver: apt install them, or set CHROMIUM and CHROMEDRIVER"]
fn a_fleet_of_five_hundred_machines_is_shown_sorted_searched_and_scrolled() {
    let test = "a_fleet_of_five_hundred_machines_is_shown_sorted_searched_and_scrolled";
    let Some(browser) = Browser::open(test, Size::Desktop) else { return };
    let daemon = fleet();
    browser.go(&format!("{}/", daemon.base_url));
    let shown = "document.querySelectorAll('[data-machine]').length";
    browser.wait(&format!("{shown} === {N_MACHINES}"));
    // The one with an alarm of a limit that its replay exceeds is not lost among those that wait for data.
    browser.wait("document.querySelector('[data-machine] .pill.alarm') !== null");
    let first: Value = browser.run("return [...document.querySelectorAll('[data-machine]')].slice(0, 3).map((m) => m.className)");
    let ranks: Value = browser.run(
        "const rank = { damaged: 0, warning: 1, undetermined: 2, healthy: 3 }; \
         const all = [...document.querySelectorAll('[data-machine]')].map((m) => rank[m.className.split(' ').at(-1)]); \
         return all.every((r, i) => i === 0 || all[i - 1] <= r)",
    );
    assert_eq!(ranks, true, "the worst first: {first}");
    // A look at the whole, drawn anew, blocks the page for less than a tenth of a second... on a fast computer; here it is bounded.
    let took = browser.run_async(
        "const { look } = await import('/dashboard/store.js'); const begun = performance.now(); await look(); \
         await new Promise((next) => requestAnimationFrame(() => requestAnimationFrame(next))); return performance.now() - begun",
    );
    assert!(took.as_f64().unwrap() < 5000.0, "{took} ms");
    browser.run("document.querySelector('[type=search]').focus()");
    browser.keys("rig-0499");
    browser.wait(&format!("{shown} === 1"));
    browser.run("const s = document.querySelector('[type=search]'); s.value = ''; s.dispatchEvent(new Event('input'))");
    browser.wait(&format!("{shown} === {N_MACHINES}"));
    browser.run("document.querySelector('[data-machine=\"rig-0499\"]').scrollIntoView()");
    browser.wait("window.scrollY > 5000");
    // It stays where it was scrolled to over looks that find every row changed: their ages count by twenty seconds.
    let here =
        "return document.querySelector('[data-machine=\"rig-0499\"]').getBoundingClientRect().top";
    browser.run("window.row = document.querySelector('[data-machine=\"rig-0499\"] h2')");
    let frames =
        "await new Promise((next) => requestAnimationFrame(() => requestAnimationFrame(next)))";
    browser.run_async(&format!("{frames}; return true"));
    let before = browser.run(here).as_f64().unwrap();
    // A look while another is under way is that one.
    browser.run_async(&format!(
        "const {{ look }} = await import('/dashboard/store.js'); const now = Date.now; \
         Date.now = () => now() + 60_000; while (window.row.isConnected) await look(); Date.now = now; {frames}; return true"
    ));
    let after = browser.run(here).as_f64().unwrap();
    assert!((after - before).abs() < 2.0, "moved by {} pixels", after - before);
    browser.no_errors();
}

/// A daemon of 500 machines that wait for senders, but for one that is replayed beyond its limit.
fn fleet() -> Daemon {
    let mut config = "[server]\nbind = \"127.0.0.1:0\"\n[pipeline]\nring_seconds = 15\n".to_owned();
    let mut files = Vec::new();
    for n in 0..N_MACHINES {
        let id = format!("rig-{n:04}");
        let limit = "[[limits.alarm]]\nid = \"level\"\nkind = \"feature\"\nfeature = \"rms\"\nwarning_above = 0.001\n";
        let machine = support::MACHINE.replace("rig-1", &id);
        let source = if n == 250 {
            "kind = \"replay\"\nfile = \"x.h5\"\nspeed = \"max\"".to_owned()
        } else {
            "kind = \"tcp\"".to_owned()
        };
        config += &format!(
            "[[machine]]\nfile = \"{id}.toml\"\n[[source]]\nmachine = \"{id}\"\n{source}\n"
        );
        files.push((format!("{id}.toml"), format!("{machine}{limit}")));
    }
    config += "[ingest]\nbind = \"127.0.0.1:0\"\n";
    let named: Vec<(&str, &[u8])> =
        files.iter().map(|(name, text)| (name.as_str(), text.as_bytes())).collect();
    let dir = support::folder(&config, &named);
    support::write_ramp(&dir, "x.h5", 1000.0, 30_000);
    let daemon = Daemon::start_in(dir);
    daemon.wait_finished("rig-0250");
    let (_, list) = daemon.get_json("/api/v1/machines");
    assert_eq!(list["items"].as_array().map(Vec::len), Some(N_MACHINES), "{}", json!(list["next"]));
    daemon
}
