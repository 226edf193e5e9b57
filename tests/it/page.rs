//! The dashboard in a browser.

use crate::browser::{Browser, Demo, ENTER, Size, TAB, skipped};
use crate::pictures;
use crate::scene;
use crate::simulated;
use crate::support;
use crate::support::Daemon;

/// What `[data-component="bearing/right"]` of the fleet shows.
const RIGHT: &str = "document.querySelector('[data-component=\"bearing/right\"]')";

#[test]
#[ignore = "needs chromium and chromium-driver: apt install them, or set CHROMIUM and CHROMEDRIVER"]
fn a_fault_turns_its_component_red_and_its_lines_carry_the_cursors() {
    let test = "a_fault_turns_its_component_red_and_its_lines_carry_the_cursors";
    let Some(browser) = Browser::open(test, Size::Desktop) else { return };
    let demo = Demo::start("GG_GS_GB");
    browser.go(&format!("{}/", demo.url));
    browser.wait(&format!("{RIGHT}?.classList.contains('healthy')"));
    assert!(browser.text("[data-machine=\"rig-1\"] h2").contains("Gear-rotor-bearing rig"));
    // Gone if the page were loaded anew.
    browser.run("window.isTheSame = true");
    browser.click("#nav [data-view=\"simulation\"]");
    browser.click("[data-scenario=\"GG_GS_BB\"]");
    browser.click("#nav [data-view=\"\"]");
    browser.wait(&format!("{RIGHT}?.classList.contains('damaged')"));
    browser
        .wait("document.querySelector('#nav [data-view=\"alarms\"] .count')?.textContent === '1'");
    assert_eq!(browser.run("return window.isTheSame"), true);
    assert!(browser.text("[data-machine=\"rig-1\"] .headline").contains("inner race"));

    // One click from the component to the plot that proves it.
    browser.click("[data-component=\"bearing/right\"] a");
    for proof in ["envelope", "absolute"] {
        let row = format!("[data-proof=\"{proof}\"] tr[data-line=\"BPFI\"]");
        browser.wait(&format!("document.querySelector({}) !== null", serde_json::json!(row)));
        let line = browser.run(&format!(
            "return {{ ...document.querySelector({}).dataset }}",
            serde_json::json!(row)
        ));
        let number = |key: &str| line[key].as_str().unwrap().parse::<f64>().unwrap();
        // BPFI of 11 balls of 7.9375 mm on 33.5 mm at 10 r/s; the resolution is 0.1 Hz, slip is below 1 %.
        assert!((number("expected") - 68.03).abs() < 0.1, "{line}");
        assert!((number("found") - number("expected")).abs() < 0.3, "{line}");
    }
    browser.wait("document.querySelectorAll('[data-proof=\"envelope\"] tr.matched').length >= 3");
    browser.no_errors();
}

#[test]
#[ignore = "needs chromium and chromium-driver: apt install them, or set CHROMIUM and CHROMEDRIVER"]
fn an_alarm_is_acknowledged_by_keys_alone_and_stays_so() {
    let test = "an_alarm_is_acknowledged_by_keys_alone_and_stays_so";
    let Some(browser) = Browser::open(test, Size::Desktop) else { return };
    let daemon = damaged_bearing();
    browser.go(&format!("{}/#/alarms", daemon.base_url));
    browser.wait("document.querySelector('[data-act=\"ack\"]') !== null");
    // From the top of the page to the button, by the tabulator.
    browser.run("document.querySelector('.skip').focus()");
    for _ in 0..60 {
        if browser.run("return document.activeElement.dataset.act ?? ''") == "ack" {
            break;
        }
        browser.keys(TAB);
    }
    assert_eq!(browser.run("return document.activeElement.dataset.act"), "ack");
    browser.keys(ENTER);
    browser.wait("document.activeElement.name === 'author'");
    browser.keys(&format!("M. Ito{TAB}bearing ordered{ENTER}"));
    let told =
        "document.querySelector('.state-text')?.textContent.includes('M. Ito: bearing ordered')";
    browser.wait(told);
    assert_eq!(browser.run("return document.querySelector('dialog') === null"), true);
    browser.reload();
    browser.wait(told);
    assert_eq!(browser.run("return document.querySelector('[data-act=\"ack\"]') === null"), true);
    browser.no_errors();
}

#[test]
#[ignore = "needs chromium and chromium-driver: apt install them, or set CHROMIUM and CHROMEDRIVER"]
fn what_is_of_an_unknown_day_is_told_by_its_place_in_the_record() {
    let test = "what_is_of_an_unknown_day_is_told_by_its_place_in_the_record";
    let Some(browser) = Browser::open(test, Size::Desktop) else { return };
    let daemon = damaged_bearing();
    for (view, at) in [
        ("", "[data-component=\"bearing/right\"] .since"),
        ("alarms", "article.alarm .since"),
        ("machine/rig-1/bearing/right", ".machine-head .soft"),
        ("machine/rig-1/bearing/right", "dl.facts"),
        ("machine/rig-1/bearing/right", ".alarm-line"),
    ] {
        browser.go(&format!("{}/#/{view}", daemon.base_url));
        browser.wait(&format!("document.querySelector({})", serde_json::json!(at)));
        let text = browser.text(at);
        assert!(text.contains(" s of the record"), "{at}: {text}");
        let page = browser.text("#view");
        assert!(
            !page.contains("1970-") && !page.contains(" ago") && !page.contains(" d "),
            "{page}"
        );
    }
    browser.no_errors();
}

#[test]
#[ignore = "needs chromium and chromium-driver: apt install them, or set CHROMIUM and CHROMEDRIVER"]
fn a_sparkline_has_gaps_where_nothing_was_judged_and_no_value_of_now() {
    let test = "a_sparkline_has_gaps_where_nothing_was_judged_and_no_value_of_now";
    let Some(browser) = Browser::open(test, Size::Desktop) else { return };
    let demo = Demo::start("GG_GS_GB");
    browser.go(&format!("{}/", demo.url));
    let drawn = |values: &str| {
        browser.run_async(&format!(
            "const {{ draw }} = await import('/dashboard/sparkline.js'); \
             const picture = document.createElementNS('http://www.w3.org/2000/svg', 'svg'); \
             draw(picture, {{ time_s: [0, 10, 20, 30, 40], value: {values} }}, 'right'); \
             const d = picture.querySelector('path').getAttribute('d'); \
             const circle = picture.querySelector('circle'); \
             return [d.split('M').length - 1, d.split(' ').at(-1), circle === null, picture.getAttribute('aria-label')]"
        ))
    };
    let whole = drawn("[0.1, 0.2, 0.3, 0.4, 0.5]");
    assert_eq!((&whole[0], &whole[2]), (&1.into(), &false.into()), "{whole}");
    let open = drawn("[0.1, 0.2, null, 0.4, null]");
    assert_eq!((&open[0], &open[2]), (&2.into(), &true.into()), "{open}");
    assert_eq!(open[3], "severity of right over 40 s: 0.10 to 0.40, not judged since");
}

#[test]
#[ignore = "needs chromium and chromium-driver: apt install them, or set CHROMIUM and CHROMEDRIVER"]
fn every_representation_of_a_signal_shows_something() {
    let test = "every_representation_of_a_signal_shows_something";
    let Some(mut browser) = Browser::open(test, Size::Desktop) else { return };
    // A loaded daemon tells a reader to come again, and the console keeps a note of it.
    browser.tolerated = vec!["503 (Service Unavailable)"];
    let demo = Demo::start("GG_GS_BB");
    browser.go(&format!("{}/", demo.url));
    browser.wait(&format!("{RIGHT}?.classList.contains('damaged')"));
    for (channel, kind) in [
        ("right_x", "waveform"),
        ("right_x", "amplitude"),
        ("right_x", "psd"),
        ("right_x", "envelope"),
        ("right_x", "absolute"),
        ("right_x", "order"),
        ("right_x", "cepstrum"),
        ("right_x", "scalogram"),
        ("right_x", "waterfall"),
        ("mid_x", "orbit"),
        ("right_x", "trend"),
    ] {
        // Of one window yet there is a point; more come.
        let live = if kind == "trend" { "&live=1" } else { "" };
        browser.go(&format!("{}/#/signals/rig-1?channel={channel}&kind={kind}{live}", demo.url));
        browser.wait(&format!("document.querySelector('.stage')?.dataset.kind === '{kind}'"));
        // A field of one colour has one, with its grid two; a curve has more by its soft edges, one that is level few.
        let found = browser.wait_for(kind, &colours(4));
        assert!(found.as_u64().unwrap() > 4, "{kind}: {found}");
        assert_eq!(
            browser.run("return document.querySelector('.failed') === null"),
            true,
            "{kind}"
        );
    }
    for kind in ["scalogram", "waterfall"] {
        browser.go(&format!("{}/#/signals/rig-1?channel=right_x&kind={kind}", demo.url));
        browser.wait(&format!("document.querySelector('.stage')?.dataset.kind === '{kind}'"));
        // Of the field alone, without axes and bar: of 256 colours.
        browser.wait(&colours(60));
    }
    browser.no_errors();
}

/// Number of colours inside the plot's field if there are more than `least`.
fn colours(least: usize) -> String {
    format!(
        "(() => {{ const canvas = document.querySelector('.stage canvas'); if (!canvas || !canvas.width) return null; \
         const {{ width: w, height: h }} = canvas; \
         const data = canvas.getContext('2d').getImageData(w * 0.1, h * 0.1, w * 0.75, h * 0.7).data; \
         const seen = new Set(); for (let i = 0; i < data.length; i += 4) \
         seen.add((data[i] << 16) | (data[i + 1] << 8) | data[i + 2]); \
         return seen.size > {least} ? seen.size : null; }})()"
    )
}

#[test]
#[ignore = "needs chromium and chromium-driver: apt install them, or set CHROMIUM and CHROMEDRIVER"]
fn only_a_simulated_machine_can_be_damaged_and_with_what_its_scene_has() {
    let test = "only_a_simulated_machine_can_be_damaged_and_with_what_its_scene_has";
    let Some(browser) = Browser::open(test, Size::Desktop) else { return };
    let daemon = Daemon::start_in(simulated::folder("", &["rig-1"]));
    let bent = serde_json::json!({ "scenario": "GG_BS_GB" });
    assert_eq!(daemon.post_json("/api/v1/simulation/scenario", &bent).0, 200);
    browser.go(&format!("{}/#/simulation", daemon.base_url));
    browser.wait(
        "document.querySelector('[aria-label=\"Truth\"]')?.textContent.includes('bow of 203 µm')",
    );
    browser.wait("document.querySelector('.verdicts')?.textContent.includes('shaft main: bow')");
    let offered = browser.run(
        "return [...document.querySelectorAll('[data-scenario]')].map((b) => b.dataset.scenario)",
    );
    assert_eq!(
        offered,
        serde_json::json!(["GG_GS_GB", "GG_BS_GB"]),
        "the scene has no ball bearing"
    );
    let page = browser.text("#view");
    assert!(!page.contains("NaN") && !page.contains("undefined "), "{page}");
    drop(daemon);
    // The daemon has gone: what is shown is marked as old.
    browser.wait("document.body.classList.contains('stale')");
    browser.wait("document.querySelector('#link').textContent.includes('trying again')");

    let replayed = damaged_bearing();
    browser.go(&format!("{}/#/simulation", replayed.base_url));
    // What is shown first is that it loads.
    browser.wait(
        "document.querySelector('#view').innerText.trim().startsWith('No machine is simulated')",
    );
    assert_eq!(
        browser.run("return document.querySelector('#view').innerText.includes('Loading')"),
        false
    );
    assert_eq!(
        browser.run("return document.querySelector('#nav [data-view=\"simulation\"]') === null"),
        true
    );
}

#[test]
#[ignore = "needs chromium, chromium-driver and axe-core: .ci/run installs them, AXE names axe.min.js"]
fn every_view_passes_the_accessibility_check_in_light_and_dark() {
    let test = "every_view_passes_the_accessibility_check_in_light_and_dark";
    let Some(axe) = std::env::var_os("AXE") else { return skipped(test, "no AXE") };
    let axe = std::fs::read_to_string(axe).unwrap();
    let Some(browser) = Browser::open(test, Size::Desktop) else { return };
    let demo = Demo::start("GG_GS_BB");
    browser.go(&format!("{}/", demo.url));
    browser.wait("document.querySelector('#nav [data-view=\"alarms\"] .count') !== null");
    for theme in ["light", "dark"] {
        browser.run(&format!(
            "localStorage.setItem('rotorwatch.preferences', JSON.stringify({{ theme: '{theme}' }}))"
        ));
        for (name, address, ready) in pictures::VIEWS {
            browser.go(&format!("{}/?{theme}{name}{address}", demo.url));
            browser.wait(ready);
            browser.run(&axe);
            let found = browser.run_async(
                "const found = await axe.run(document, { runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'best-practice'] }); \
                 return found.violations.map((v) => `${v.id}: ${v.nodes.map((n) => n.html.slice(0, 160) + ' ' + n.failureSummary).join(' | ')}`)",
            );
            assert_eq!(found, serde_json::json!([]), "{name}, {theme}");
        }
    }
}

/// A daemon that has judged a bearing with a damaged inner race.
pub(crate) fn damaged_bearing() -> Daemon {
    let config = "[server]\nbind = \"127.0.0.1:0\"\n[[machine]]\nfile = \"rig.toml\"\n[[source]]\n\
         kind = \"replay\"\nmachine = \"rig-1\"\nfile = \"x.h5\"\nspeed = \"max\"\n";
    let dir = support::folder(config, &[("rig.toml", scene::MACHINE.as_bytes())]);
    scene::write(&dir.path().join("x.h5"), &scene::samples(1), None);
    let daemon = Daemon::start_in(dir);
    daemon.wait_finished("rig-1");
    daemon
}
