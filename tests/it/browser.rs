//! A real Chromium, driven by the W3C WebDriver protocol: what an operator sees and does, not what the server sends.
//!
//! The protocol is JSON over HTTP; half of what is needed here are Chromium's own commands, which no library types
//! (docs/adr/0024).

#![expect(clippy::print_stdout, reason = "a test that skips itself says so")]

use crate::support;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use std::io::BufRead;
use std::io::BufReader;
use std::path::Path;
use std::process::Child;
use std::process::Command;
use std::process::Stdio;
use std::thread;
use std::time::Duration;

/// Longest wait for anything: a verdict needs a window of samples in real time, on a loaded computer too.
const LIMIT: Duration = Duration::from_secs(180);

/// Key that stands for an element in answers.
const ELEMENT: &str = "element-6066-11e4-a52e-4f735466cecf";

/// Keys by their code points in the protocol.
pub(crate) const ENTER: &str = "\u{e007}";
pub(crate) const TAB: &str = "\u{e004}";

/// How large the window is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Size {
    /// 1280 × 720.
    Desktop,
    /// 390 × 844 with a finger.
    Phone,
}

/// Says that a test did not run.
pub(crate) fn skipped(test: &str, why: &str) {
    println!("SKIPPED {test}: {why}");
}

/// A browser with one window; closed when dropped.
#[derive(Debug)]
pub(crate) struct Browser {
    driver: Child,
    session: String,
    agent: ureq::Agent,
    /// Messages that a page may leave in the console, by a part of them.
    pub(crate) tolerated: Vec<&'static str>,
}

impl Browser {
    /// Opens a browser; `None`, and says so, where there is none.
    pub(crate) fn open(test: &str, size: Size) -> Option<Self> {
        let driver = std::env::var_os("CHROMEDRIVER").unwrap_or_else(|| "chromedriver".into());
        let started = Command::new(driver)
            .arg("--port=0")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn();
        let Ok(mut driver) = started else {
            skipped(test, "no chromedriver");
            return None;
        };
        // Ends by itself: with the line, or with the process.
        let mut lines = BufReader::new(driver.stdout.take().unwrap()).lines();
        let port = lines.find_map(|line| {
            line.ok()?.split("successfully on port ").nth(1)?.trim_end_matches('.').parse().ok()
        });
        let port: u16 = port.unwrap();
        // What it says later is taken, so that it never waits for a reader.
        thread::spawn(move || lines.for_each(drop));
        let config = ureq::Agent::config_builder();
        let agent = config.http_status_as_error(false).timeout_global(Some(LIMIT)).build().into();
        let mut browser = Self {
            driver,
            session: format!("http://127.0.0.1:{port}/session"),
            agent,
            tolerated: Vec::new(),
        };
        let made = browser.post("", &capabilities(size));
        browser.session = format!("{}/{}", browser.session, made["sessionId"].as_str().unwrap());
        Some(browser)
    }

    fn post(&self, command: &str, body: &Value) -> Value {
        self.try_post(command, body).unwrap_or_else(|why| panic!("{command} {body}: {why}"))
    }

    /// What a command gives; `Err`: what it says instead.
    fn try_post(&self, command: &str, body: &Value) -> Result<Value, Value> {
        let url = format!("{}{command}", self.session);
        let mut response = self.agent.post(&url).send_json(body).unwrap();
        let text = response.body_mut().with_config().limit(1 << 26).read_to_string().unwrap();
        let mut answer: Value = serde_json::from_str(&text).unwrap();
        let value = answer["value"].take();
        if response.status().is_success() { Ok(value) } else { Err(value) }
    }

    /// Opens an address.
    pub(crate) fn go(&self, url: &str) {
        self.post("/url", &json!({ "url": url }));
    }

    /// Loads the page anew.
    pub(crate) fn reload(&self) {
        self.post("/refresh", &json!({}));
    }

    /// Runs a function's body in the page.
    pub(crate) fn run(&self, script: &str) -> Value {
        self.post("/execute/sync", &json!({ "script": script, "args": [] }))
    }

    /// Runs the body of an asynchronous function in the page and waits for what it gives.
    pub(crate) fn run_async(&self, script: &str) -> Value {
        let script = format!(
            "const done = arguments[arguments.length - 1];\n\
             (async () => {{ {script} }})().then(done, (error) => done(`failed: ${{error}}`));"
        );
        self.post("/execute/async", &json!({ "script": script, "args": [] }))
    }

    /// Looks until an expression of the page is neither null nor false.
    pub(crate) fn wait(&self, expression: &str) -> Value {
        self.wait_for(expression, expression)
    }

    /// The same, and says `what` was waited for.
    pub(crate) fn wait_for(&self, what: &str, expression: &str) -> Value {
        let script = format!("return ({expression}) ?? null;");
        support::wait_within(LIMIT, what, || {
            let found = self.run(&script);
            (!found.is_null() && found != json!(false)).then_some(found)
        })
    }

    /// Waits for an element; gives its text.
    pub(crate) fn text(&self, selector: &str) -> String {
        let found = self.wait(&format!("document.querySelector({})?.textContent", json!(selector)));
        found.as_str().unwrap().to_owned()
    }

    /// Waits for an element and clicks on it; the page may put another one like it in its place meanwhile.
    pub(crate) fn click(&self, selector: &str) {
        let search = json!({ "using": "css selector", "value": selector });
        support::wait_within(LIMIT, selector, || {
            let found = self.try_post("/element", &search).ok()?;
            let id = found[ELEMENT].as_str()?;
            let clicked = self.try_post(&format!("/element/{id}/click"), &json!({}));
            match clicked.as_ref().map_err(|why| why["error"].as_str()) {
                Ok(_) => Some(()),
                Err(Some("stale element reference")) => None,
                Err(why) => panic!("{selector}: {why:?}"),
            }
        });
    }

    /// Types at whatever has the focus.
    pub(crate) fn keys(&self, text: &str) {
        let one = |key: char| {
            [json!({ "type": "keyDown", "value": key }), json!({ "type": "keyUp", "value": key })]
        };
        let actions: Vec<Value> = text.chars().flat_map(one).collect();
        let keys = json!({ "type": "key", "id": "keyboard", "actions": actions });
        self.post("/actions", &json!({ "actions": [keys] }));
    }

    /// A command of Chromium's own.
    pub(crate) fn chromium(&self, command: &str, parameters: &Value) -> Value {
        self.post("/goog/cdp/execute", &json!({ "cmd": command, "params": parameters }))
    }

    /// The page from its top to its end, at most `most` px of it, as PNG.
    pub(crate) fn picture(&self, most: f64) -> Vec<u8> {
        let size =
            self.run("const d = document.documentElement; return [innerWidth, d.scrollHeight]");
        let [width, height] = [0_usize, 1].map(|i| size[i].as_f64().unwrap());
        let clip =
            json!({ "x": 0, "y": 0, "width": width, "height": height.min(most), "scale": 1 });
        let shot = json!({ "format": "png", "captureBeyondViewport": true, "clip": clip });
        let shot = self.chromium("Page.captureScreenshot", &shot);
        STANDARD.decode(shot["data"].as_str().unwrap()).unwrap()
    }

    /// Fails if the page left an error in the console.
    pub(crate) fn no_errors(&self) {
        let log = self.post("/se/log", &json!({ "type": "browser" }));
        let is_tolerated = |text: &str| self.tolerated.iter().any(|part| text.contains(part));
        let errors: Vec<&Value> = log
            .as_array()
            .unwrap()
            .iter()
            .filter(|entry| entry["level"] == "SEVERE")
            .filter(|entry| !is_tolerated(entry["message"].as_str().unwrap()))
            .collect();
        assert!(errors.is_empty(), "the console holds errors: {errors:#?}");
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // Closes Chromium; a driver that is killed leaves it behind.
        let _closed = self.agent.delete(&self.session).call();
        let _ended = self.driver.kill();
        let _ended = self.driver.wait();
    }
}

fn capabilities(size: Size) -> Value {
    let mut args = vec![
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-dev-shm-usage",
        "--hide-scrollbars",
        "--disable-background-networking",
        "--no-first-run",
    ];
    let mut options = json!({});
    match size {
        Size::Desktop => args.push("--window-size=1280,720"),
        Size::Phone => {
            let metrics = json!({ "width": 390, "height": 844, "pixelRatio": 1.5, "touch": true });
            options["mobileEmulation"] = json!({ "deviceMetrics": metrics });
        }
    }
    options["args"] = json!(args);
    if let Some(binary) = std::env::var_os("CHROMIUM") {
        options["binary"] = json!(binary.to_string_lossy());
    }
    json!({ "capabilities": { "alwaysMatch": {
        "browserName": "chrome",
        "goog:chromeOptions": options,
        "goog:loggingPrefs": { "browser": "ALL" },
        "timeouts": { "script": 120_000 },
    } } })
}

/// A demonstration with its own folder and a free port; killed when dropped.
#[derive(Debug)]
pub(crate) struct Demo {
    child: Child,
    /// Such as `http://127.0.0.1:40123`.
    pub(crate) url: String,
}

impl Demo {
    /// Starts `rotorwatch demo` with a scenario.
    pub(crate) fn start(scenario: &str) -> Self {
        Self::spawn(support::command().args(["demo", "--scenario", scenario]))
    }

    /// The same, with its files in a folder that stays.
    pub(crate) fn kept(folder: &Path, scenario: &str) -> Self {
        Self::spawn(support::command().args(["demo", "--scenario", scenario, "--dir"]).arg(folder))
    }

    fn spawn(command: &mut Command) -> Self {
        command.args(["--bind", "127.0.0.1:0"]);
        let mut child = command.stderr(Stdio::null()).spawn().unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let first = lines.next().unwrap().unwrap();
        thread::spawn(move || lines.for_each(drop));
        Self { child, url: first.strip_prefix("listening on ").unwrap().to_owned() }
    }
}

impl Drop for Demo {
    fn drop(&mut self) {
        // SIGTERM, so that it removes its folder; already ended: nothing to end.
        let pid = self.child.id().to_string();
        let _sent = Command::new("kill").args(["-s", "TERM", &pid]).status();
        let _ended = self.child.wait();
    }
}
