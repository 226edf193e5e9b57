//! What the page costs in a browser: figures for docs/performance.md, printed; time is not asserted.

#![expect(clippy::print_stdout, reason = "figures are told")]

use crate::browser::Browser;
use crate::browser::Demo;
use crate::browser::Size;
use serde_json::Value;
use serde_json::json;
use std::thread;
use std::time::Duration;

/// What shows that the first verdict has come.
const RIGHT: &str = "document.querySelector('[data-component=\"bearing/right\"]') !== null";

/// Eight live plots of the Signals view, below each other, each asking for itself as one alone does.
const EIGHT: &str = "const { openSignals } = await import('/dashboard/signals.js'); \
     const { state } = await import('/dashboard/store.js'); \
     const main = document.getElementById('view'); \
     for (const [channel, kind] of [['left_x', 'amplitude'], ['left_y', 'amplitude'], ['right_x', 'amplitude'], \
       ['right_y', 'envelope'], ['mid_x', 'waveform'], ['mid_y', 'waveform'], ['left_x', 'psd'], ['right_x', 'order']]) { \
       const root = document.createElement('div'); main.append(root); \
       const query = new URLSearchParams({ channel, kind, live: '1' }); \
       openSignals(root, { parts: ['signals', 'rig-1'], query, state }).update(state); } \
     return true";

/// What makes the figures those of docs/performance.md: without it they are measured more shortly.
const FIGURES: &str = "ROTORWATCH_FIGURES";

/// How long is measured.
#[derive(Clone, Copy)]
struct Extent {
    /// Before a view is measured, s, and while it is.
    settling_s: u64,
    measured_s: u64,
    /// Hundreds of looks at the state between two readings of the heap.
    hundreds: u32,
}

impl Extent {
    fn of_run() -> Self {
        if std::env::var_os(FIGURES).is_some() {
            return Self { settling_s: 10, measured_s: 20, hundreds: 54 };
        }
        Self { settling_s: 3, measured_s: 6, hundreds: 2 }
    }

    fn settle(self) {
        thread::sleep(Duration::from_secs(self.settling_s));
    }
}

/// A page's own accounts.
struct Meter<'a>(&'a Browser);

impl<'a> Meter<'a> {
    fn new(browser: &'a Browser) -> Self {
        browser.chromium("Performance.enable", &json!({}));
        Self(browser)
    }

    fn read(&self, name: &str) -> f64 {
        let all = self.0.chromium("Performance.getMetrics", &json!({}));
        let found = all["metrics"].as_array().unwrap().iter().find(|m| m["name"] == name);
        found.unwrap()["value"].as_f64().unwrap()
    }

    /// Shares of a core that the page's main thread and its whole process take for some time, %.
    fn spent(&self, seconds: u64) -> [f64; 2] {
        let names = ["TaskDuration", "ProcessTime", "Timestamp"];
        let before = names.map(|name| self.read(name));
        thread::sleep(Duration::from_secs(seconds));
        let after = names.map(|name| self.read(name));
        [0, 1].map(|i| 100.0 * (after[i] - before[i]) / (after[2] - before[2]))
    }

    fn tell(&self, what: &str, extent: Extent) {
        let [thread, process] = self.spent(extent.measured_s);
        println!(
            "{what}: {thread:.1} % of a core in the page's main thread, {process:.1} % in its process"
        );
    }
}

#[test]
#[ignore = "needs chromium and chromium-driver; figures for docs/performance.md take minutes, with ROTORWATCH_FIGURES=1"]
fn figures_of_the_page() {
    let test = "figures_of_the_page";
    let Some(browser) = Browser::open(test, Size::Desktop) else { return };
    let extent = Extent::of_run();
    let demo = Demo::start("GG_GS_BB");
    browser.go(&format!("{}/", demo.url));
    browser.wait(RIGHT);
    let mut paints: Vec<f64> = (0..9)
        .map(|_| {
            browser.reload();
            browser.wait(RIGHT);
            let script = "return performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? null";
            browser.run(script).as_f64().unwrap()
        })
        .collect();
    paints.sort_by(f64::total_cmp);
    println!("first contentful paint, ms: median {:.0}, slowest {:.0}", paints[4], paints[8]);
    let meter = Meter::new(&browser);
    for (what, address) in [
        ("fleet", "#/"),
        ("live amplitude spectrum", "#/signals/rig-1?channel=right_x&kind=amplitude&live=1"),
        ("live waterfall", "#/signals/rig-1?channel=right_x&kind=waterfall&live=1"),
    ] {
        browser.go(&format!("{}/{address}", demo.url));
        extent.settle();
        meter.tell(what, extent);
    }
    browser.go(&format!("{}/#/nothing", demo.url));
    browser.run("performance.setResourceTimingBufferSize(10000)");
    assert_eq!(browser.run_async(EIGHT), true);
    browser.wait("document.querySelectorAll('.stage canvas').length === 8");
    extent.settle();
    let asked = "return performance.getEntriesByType('resource').filter((one) => /channels\\/\\w+\\/(spectrum|waveform)/.test(one.name)).length";
    let before = browser.run(asked).as_f64().unwrap();
    meter.tell("eight live plots", extent);
    let n = browser.run(asked).as_f64().unwrap() - before;
    println!("eight live plots were answered {n} times meanwhile");
    assert!(n >= 8.0, "they are live");

    // A day of looks at the state, as fast as they are answered: every 4 s makes 21,600 a day.
    browser.go(&format!("{}/#/", demo.url));
    browser.reload();
    browser.wait(RIGHT);
    let heap = || {
        browser.chromium("HeapProfiler.collectGarbage", &json!({}));
        meter.read("JSHeapUsedSize") / 1e6
    };
    for part in 0..=4 {
        let nodes: Value = browser.run("return document.querySelectorAll('*').length");
        let n_looks = part * 100 * extent.hundreds;
        println!("after {n_looks} looks: heap {:.2} MB, {nodes} elements", heap());
        if part < 4 {
            for _ in 0..extent.hundreds {
                browser.run_async(
                    "const { look } = await import('/dashboard/store.js'); \
                     for (let i = 0; i < 100; i += 1) await look(); return true",
                );
            }
        }
    }
}
