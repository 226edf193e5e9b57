//! Pictures of every view for the documentation; looked at by whoever changes the page.
//!
//! `ROTORWATCH_PICTURES=docs/images cargo test --test it pictures -- --ignored`, then
//! `pngquant --ext .png --force --skip-if-larger docs/images/*.png`: a third of the bytes, nothing to be seen.

use crate::browser::{Browser, Demo, Size, skipped};
use std::path::Path;

/// Folder for the pictures.
const PICTURES: &str = "ROTORWATCH_PICTURES";

/// Longest part of a page in a picture, px.
const MOST_PX: f64 = 1500.0;

/// Name, address and what tells that it is complete, of every view.
pub(crate) const VIEWS: [(&str, &str, &str); 8] = [
    ("fleet", "#/", "document.querySelector('.spark path') !== null"),
    (
        "machine",
        "#/machine/rig-1/bearing/right",
        "document.querySelectorAll('[data-proof] canvas').length >= 3",
    ),
    (
        "signals",
        "#/signals/rig-1?channel=right_y&kind=envelope&to=300&window_s=8&lines=bearing/right%23BPFI",
        "document.querySelector('.stage[data-kind=envelope] canvas') !== null && \
         document.querySelector('.numbers .matches') !== null",
    ),
    (
        "scalogram",
        "#/signals/rig-1?channel=right_x&kind=scalogram",
        "document.querySelector('.stage[data-kind=scalogram] canvas') !== null",
    ),
    (
        "orbit",
        "#/signals/rig-1?channel=mid_x&kind=orbit",
        "document.querySelector('.stage[data-kind=orbit] canvas') !== null",
    ),
    ("alarms", "#/alarms", "document.querySelector('.alarm') !== null"),
    (
        "captures",
        "#/captures",
        "document.querySelector('[data-capture]') !== null && document.querySelector('.signed') !== null",
    ),
    ("simulation", "#/simulation", "document.querySelector('.verdicts li') !== null"),
];

#[test]
#[ignore = "needs chromium and chromium-driver; makes the pictures of the documentation"]
fn pictures_of_every_view() {
    let test = "pictures_of_every_view";
    let Some(folder) = std::env::var_os(PICTURES) else {
        return skipped(test, "ROTORWATCH_PICTURES names no folder");
    };
    let demo = Demo::start("GG_GS_BB");
    for (size, size_name) in [(Size::Desktop, "desktop"), (Size::Phone, "phone")] {
        let Some(browser) = Browser::open(test, size) else { return };
        browser.go(&format!("{}/", demo.url));
        browser.wait("document.querySelector('#nav [data-view=\"alarms\"] .count') !== null");
        for theme in ["light", "dark"] {
            browser.run(&format!(
                "localStorage.setItem('rotorwatch.preferences', JSON.stringify({{ theme: '{theme}', zone: 'utc' }}))"
            ));
            for (name, address, ready) in VIEWS {
                browser.go(&format!("{}/?{theme}{name}{address}", demo.url));
                browser.wait(ready);
                // Fonts and the last frame.
                browser.run_async("await document.fonts.ready; await new Promise((r) => requestAnimationFrame(() => requestAnimationFrame(r))); return true");
                let wide = browser.run(
                    "const d = document.documentElement; return d.scrollWidth - d.clientWidth",
                );
                assert!(
                    wide.as_f64().unwrap() <= 0.0,
                    "{name} on {size_name} is too wide by {wide} px"
                );
                let png = browser.picture(MOST_PX);
                let file = Path::new(&folder).join(format!("{name}-{size_name}-{theme}.png"));
                std::fs::write(&file, png).unwrap();
            }
        }
    }
}
