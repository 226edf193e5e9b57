//! The page of a daemon that needs tokens: asks for one, once, and says why it was not taken.

use crate::access;
use crate::browser::Browser;
use crate::browser::ENTER;
use crate::browser::Size;
use crate::browser::TAB;
use crate::support::Daemon;
use serde_json::json;

/// Escape by its code point in the protocol.
const ESCAPE: &str = "\u{e00c}";

/// How many machines the page shows.
const SHOWN: &str = "document.querySelectorAll('[data-machine]').length";

/// Whether the question is open, and waits for what is typed.
const ASKED: &str =
    "document.activeElement?.name === 'token' && document.activeElement.value === ''";

/// Whether the question is open and says this.
fn said(words: &str) -> String {
    format!("{ASKED} && document.querySelector('#token-note').textContent.includes('{words}')")
}

/// A daemon of two machines, its viewer's token, and a page of it that asks for one.
fn asked(browser: &Browser) -> (Daemon, String) {
    let dir = access::folder("token_file = \"tokens.toml\"", access::MACHINES);
    let viewer = access::create(dir.path(), &["--role", "viewer", "--label", "wall"]);
    let daemon = Daemon::start_in(dir);
    browser.go(&format!("{}/", daemon.base_url));
    browser.wait(ASKED);
    (daemon, viewer)
}

#[test]
#[ignore = "needs chromium and chromium-driver: apt install them, or set CHROMIUM and CHROMEDRIVER"]
fn a_token_is_asked_for_until_it_is_right_and_kept_for_the_tab() {
    let test = "a_token_is_asked_for_until_it_is_right_and_kept_for_the_tab";
    let Some(mut browser) = Browser::open(test, Size::Desktop) else { return };
    browser.tolerated = vec!["401 (Unauthorized)", "403 (Forbidden)"];
    let (daemon, viewer) = asked(&browser);
    assert_eq!(browser.run(&format!("return {SHOWN}")), 0, "nothing is shown before");
    browser.keys(&format!("wrong{ENTER}"));
    browser.wait(&said("refused the token: the token is not known here"));
    browser.keys(&format!("falsch\u{df}{ENTER}"));
    browser.wait(&said("no token has such characters"));
    browser.keys(&format!("{viewer}{ENTER}"));
    browser.wait(&format!("{SHOWN} === 2"));
    browser.wait("document.querySelector('#link').textContent === 'live'");
    browser.reload();
    browser.wait(&format!("{SHOWN} === 2"));
    let kept = browser.run("return JSON.stringify(localStorage)");
    assert!(!kept.as_str().unwrap().contains("rotorwatch_"), "{kept}");
    // A role that does not suffice is told in the form, and nothing else happens.
    browser.go(&format!("{}/#/machine/rig-1", daemon.base_url));
    browser.click("[data-act=\"maintenance\"]");
    browser.wait("document.activeElement?.name === 'author'");
    browser.keys(&format!("M. Ito{TAB}new belt{ENTER}"));
    browser.wait("document.querySelector('dialog .said')?.textContent.includes('role operator')");
    browser.no_errors();
}

#[test]
#[ignore = "needs chromium and chromium-driver: apt install them, or set CHROMIUM and CHROMEDRIVER"]
fn who_gives_no_token_is_left_alone_and_who_gives_wrong_ones_is_told_to_wait() {
    let test = "who_gives_no_token_is_left_alone_and_who_gives_wrong_ones_is_told_to_wait";
    let Some(mut browser) = Browser::open(test, Size::Desktop) else { return };
    browser.tolerated = vec!["401 (Unauthorized)", "429 (Too Many Requests)"];
    let (daemon, viewer) = asked(&browser);
    let client = access::Client::new(&daemon, Some(&viewer), None);
    let denied = |reason: &str| {
        client.metric(&format!("rotorwatch_access_denied_total{{reason=\"{reason}\"}}"))
    };
    browser.keys(ESCAPE);
    browser.wait("document.querySelector('#link button')?.textContent === 'Enter a token'");
    // As the stream and the clock of the page try again: nothing is sent, and nobody is asked.
    let n = denied("missing");
    browser.run_async(
        "const { look } = await import('/dashboard/store.js'); \
         for (let i = 0; i < 20; i += 1) await look(); return true",
    );
    assert_eq!(denied("missing"), n);
    assert_eq!(browser.run("return document.querySelector('dialog')"), json!(null));
    browser.click(".fleet button");
    browser.wait(ASKED);

    // Each attempt is one request; beyond ten it says how long to wait, and a right one is taken all the same.
    let note = "document.querySelector('#token-note')";
    let mut attempts = 0;
    loop {
        attempts += 1;
        // What an older question says is not taken for the answer.
        browser.run(&format!("{note}.textContent = ''"));
        browser.keys(&format!("wrong{attempts}{ENTER}"));
        browser.wait(&said("refused the token"));
        if browser
            .text("#token-note")
            .contains("too many wrong tokens from this address; try again in ")
        {
            break;
        }
        assert!(attempts < 40, "on and on");
    }
    assert!(attempts > 10, "{attempts}");
    assert_eq!((denied("unknown"), denied("too_many")), (attempts, 1));
    browser.keys(&format!("{viewer}{ENTER}"));
    browser.wait(&format!("{SHOWN} === 2"));
    browser.no_errors();
}
