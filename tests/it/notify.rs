//! Webhooks of the running daemon: nothing lost, nothing doubled but by id, signed, and no secret told.

use crate::hook::Hook;
use crate::hook::Message;
use crate::support;
use crate::support::Daemon;
use serde_json::Value;
use serde_json::json;
use std::collections::BTreeMap;
use std::collections::BTreeSet;
use std::io::Write;
use std::process::Command;
use std::process::Stdio;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering;
use std::thread;
use tempfile::TempDir;

/// Limits, each with an alarm and an operator of its own.
const N_LIMITS: usize = 3;

/// Answers between two kills, at most.
const MAX_ANSWERS: u64 = 30;

/// What must never be shown.
const SECRETS: [&str; 3] = ["k3y-0f-the-w3bh00k-abcdef", "t0ken-in-a-h3ader", "path-t0ken"];

fn machine() -> String {
    let limit = |n| {
        format!(
            "[[limits.alarm]]\nid = \"limit-{n}\"\nkind = \"feature\"\nfeature = \"rms\"\n\
             warning_above = 1e-6\n"
        )
    };
    format!("{}{}", support::MACHINE, (0..N_LIMITS).map(limit).collect::<String>())
}

/// A folder whose daemon plays a capture once and tells `hooks`, each with further keys.
pub(crate) fn folder(hooks: &[(&str, &str, &str)]) -> TempDir {
    let mut config =
        "[server]\nbind = \"127.0.0.1:0\"\n[[machine]]\nfile = \"rig.toml\"\n[[source]]\n\
                      kind = \"replay\"\nmachine = \"rig-1\"\nfile = \"x.h5\"\n"
            .to_owned();
    for (name, url, more) in hooks {
        config.push_str(&format!(
            "[[notify.webhook]]\nname = \"{name}\"\nurl = \"{url}\"\nmax_backoff_s = 1\n{more}\n"
        ));
    }
    let dir = support::folder(&config, &[("rig.toml", machine().as_bytes())]);
    support::write_ramp(&dir, "x.h5", 1000.0, 30_000);
    dir
}

/// The whole history as the store has it, as ids of messages.
pub(crate) fn history(daemon: &Daemon) -> Vec<String> {
    let mut ids = Vec::new();
    let mut after = String::new();
    loop {
        let (_, page) =
            daemon.get_json(&format!("/api/v1/alarms/history?machine=rig-1&limit=100{after}"));
        ids.extend(
            page["items"].as_array().unwrap().iter().map(|e| format!("rig-1#{}", e["sequence"])),
        );
        let Some(next) = page["next"].as_str() else { break };
        after = format!("&after={next}");
    }
    ids.reverse();
    ids
}

fn receiver(daemon: &Daemon, name: &str) -> Value {
    let (_, system) = daemon.get_json("/api/v1/system");
    let all = system["receivers"].as_array().unwrap();
    all.iter().find(|receiver| receiver["name"] == name).unwrap().clone()
}

/// Waits until a receiver was told of as many transitions as the history has, or of `n`.
fn wait_told(daemon: &Daemon, name: &str, n: Option<usize>) {
    support::wait_until("everything to be told", || {
        let n = n.unwrap_or_else(|| history(daemon).len());
        let receiver = receiver(daemon, name);
        (receiver["delivered"] == n && receiver["waiting"] == 0).then_some(())
    });
}

/// Alarms that stand, with their states, when all do.
pub(crate) fn alarms(daemon: &Daemon) -> BTreeMap<String, String> {
    support::wait_until("the alarms of all limits", || {
        let (_, list) = daemon.get_json("/api/v1/alarms?machine=rig-1");
        let items = list["items"].as_array().unwrap();
        let of_limits = items.iter().filter(|item| item["source"] == "limit");
        let text = |value: &Value| value.as_str().unwrap().to_owned();
        let found: BTreeMap<_, _> =
            of_limits.map(|item| (text(&item["id"]), text(&item["state"]))).collect();
        (found.len() == N_LIMITS).then_some(found)
    })
}

/// Shelves and unshelves an alarm until the daemon no longer answers; counts the answers.
pub(crate) fn operate(base_url: &str, id: &str, mut state: String, n_answers: &AtomicU64) {
    let config = ureq::Agent::config_builder().http_status_as_error(false).build();
    let agent: ureq::Agent = config.into();
    loop {
        let (act, body) = match state.as_str() {
            "shelved" => ("unshelve", json!({ "author": "O" })),
            _ => ("shelve", json!({ "author": "O", "for_s": 3600.0 })),
        };
        let url = format!("{base_url}/api/v1/alarms/{id}/{act}");
        let Ok(mut response) = agent.post(url).send_json(&body) else { return };
        let Ok(after) = response.body_mut().read_json::<Value>() else { return };
        // A daemon that is ending answers that it does.
        let Some(now) = after["state"].as_str() else { return };
        state = now.to_owned();
        n_answers.fetch_add(1, Ordering::SeqCst);
    }
}

/// First arrivals by id, after checking that what came again under an id says the same.
pub(crate) fn first_arrivals(messages: &[Message]) -> Vec<String> {
    let mut bodies: BTreeMap<String, String> = BTreeMap::new();
    let mut order = Vec::new();
    for message in messages {
        let id = message.id();
        assert_eq!(message.headers["webhook-id"], id);
        match bodies.get(&id) {
            Some(body) => assert_eq!(*body, message.body, "{id} came again as another"),
            None => {
                order.push(id.clone());
                bodies.insert(id, message.body.clone());
            }
        }
    }
    order
}

/// Kills and restarts a daemon so many times while operators act and a receiver is up or down.
fn kill_and_restart(n_rounds: u64, seed: u64) {
    let hook = Hook::start(200);
    let mut dir = folder(&[("room", &hook.url, "")]);
    let mut random = seed;
    for round in 0..n_rounds {
        let mut daemon = Daemon::start_in(dir);
        let standing = alarms(&daemon);
        random =
            random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let kill_after = 1 + (random >> 33) % MAX_ANSWERS;
        hook.answer(if round % 3 == 1 { 503 } else { 200 });
        let n_answers = AtomicU64::new(0);
        thread::scope(|scope| {
            for (id, state) in standing {
                let (url, n_answers) = (&daemon.base_url, &n_answers);
                scope.spawn(move || operate(url, &id, state, n_answers));
            }
            while n_answers.load(Ordering::SeqCst) < kill_after {
                thread::yield_now();
            }
            daemon.signal("KILL");
        });
        assert!(daemon.child.wait().unwrap().code().is_none(), "killed");
        dir = std::mem::replace(&mut daemon.dir, TempDir::new().unwrap());
    }
    hook.answer(200);
    let daemon = Daemon::start_in(dir);
    wait_told(&daemon, "room", None);
    let expected = history(&daemon);
    assert!(expected.len() as u64 > n_rounds, "{expected:?}");
    assert_eq!(first_arrivals(&hook.messages()), expected, "in order, none lost, none invented");
    let taken: BTreeSet<String> = hook.taken().into_iter().collect();
    assert_eq!(taken.len(), expected.len());
    // Doubled is at most what was under way at a kill.
    let n_doubled = hook.taken().len() - taken.len();
    assert!(n_doubled as u64 <= n_rounds, "{n_doubled} of {}", expected.len());
    #[expect(clippy::print_stdout, reason = "a figure")]
    {
        println!("{n_rounds} kills: {} transitions, {n_doubled} sent twice", expected.len());
    }
    assert_eq!(daemon.terminate().status.code(), Some(0));
}

#[test]
fn kills_lose_no_notification_and_double_none_but_by_id() {
    kill_and_restart(6, 3);
}

/// Verifies with Python's library, nothing of ours.
fn verify(message: &Message, key: &str) {
    const SCRIPT: &str = "import sys,hmac,hashlib,base64\n\
        key,id,time,signature=sys.argv[1:5]\n\
        body=sys.stdin.buffer.read()\n\
        signed=hmac.new(key.encode(),f'{id}.{time}.'.encode()+body,hashlib.sha256).digest()\n\
        want='v1,'+base64.b64encode(signed).decode()\n\
        sys.exit(not hmac.compare_digest(want,signature))\n";
    let header = |name: &str| message.headers[name].as_str();
    let arguments =
        [key, header("webhook-id"), header("webhook-timestamp"), header("webhook-signature")];
    let mut python = Command::new("python3")
        .args(["-c", SCRIPT])
        .args(arguments)
        .stdin(Stdio::piped())
        .spawn()
        .unwrap();
    python.stdin.take().unwrap().write_all(message.body.as_bytes()).unwrap();
    assert!(python.wait().unwrap().success(), "{message:?}");
    let sent_s: i64 = header("webhook-timestamp").parse().unwrap();
    #[expect(clippy::disallowed_methods, reason = "what a receiver does")]
    let now = std::time::SystemTime::now();
    let since = now.duration_since(std::time::UNIX_EPOCH).unwrap();
    assert!((since.as_secs().cast_signed() - sent_s).abs() < 300, "{sent_s}");
}

#[test]
fn messages_are_signed_filtered_and_no_secret_is_told() {
    let (hook, dead, refusing) = (Hook::start(200), Hook::start(503), Hook::start(307));
    let signed = "secret_file = \"key\"\nheaders = [\"X-Site: mill 3\"]\nheaders_file = \"headers\"\n\
                  transitions = [\"raised\"]";
    let direct = format!("secret = \"{}\"", SECRETS[0]);
    let dead_url = format!("{}/{}", dead.url, SECRETS[2]);
    let dir = folder(&[
        ("room", &hook.url, signed),
        ("dead", &dead_url, &direct),
        ("moved", &refusing.url, &direct),
        ("nobody", &format!("http://127.0.0.1:1/{}", SECRETS[2]), &direct),
    ]);
    std::fs::write(dir.path().join("key"), format!("{}\n", SECRETS[0])).unwrap();
    std::fs::write(dir.path().join("headers"), format!("Authorization: Bearer {}\n", SECRETS[1]))
        .unwrap();
    let daemon = Daemon::start_logging(dir, "trace");
    let standing = alarms(&daemon);
    let id = standing.keys().next().unwrap();
    let act = json!({ "author": "M. Ito", "comment": "seen" });
    assert_eq!(daemon.post_json(&format!("/api/v1/alarms/{id}/ack"), &act).0, 200);
    wait_told(&daemon, "room", Some(N_LIMITS));
    let messages = hook.messages();
    assert!(messages.len() >= N_LIMITS);
    for message in &messages {
        let body = message.json();
        assert_eq!(
            (&body["event"], &body["schema"]),
            (&json!("raised"), &json!("rotorwatch.notification/1"))
        );
        assert_eq!(message.headers["content-type"], "application/json");
        assert_eq!(message.headers["x-site"], "mill 3");
        assert_eq!(message.headers["authorization"], format!("Bearer {}", SECRETS[1]));
        verify(message, SECRETS[0]);
    }
    let changed =
        Message { body: messages[0].body.replace("raised", "erased"), ..messages[0].clone() };
    assert!(std::panic::catch_unwind(|| verify(&changed, SECRETS[0])).is_err());
    for (name, words) in [("dead", "503"), ("moved", "307"), ("nobody", "refuses the connection")] {
        let told = support::wait_until("a failure", || {
            let told = receiver(&daemon, name);
            told["failure"].is_string().then_some(told)
        });
        assert!(told["failure"].as_str().unwrap().contains(words), "{told}");
        assert_eq!(
            daemon.metric(&format!("rotorwatch_receiver_failing{{receiver=\"{name}\"}}")),
            Some(1.0)
        );
        assert!(told["waiting"].as_u64().unwrap() > 0);
    }
    assert!(refusing.messages().iter().all(|message| message.status == 307), "not followed");
    let mut told = String::new();
    for path in ["/metrics", "/api/v1/system", "/readyz", "/api/v1/alarms", "/api/v1/openapi.json"]
    {
        told.push_str(&daemon.get_text(path).1);
    }
    let state_db = std::fs::read(daemon.dir.path().join("data/state.db")).unwrap();
    told.push_str(&String::from_utf8_lossy(&state_db));
    let ended = daemon.terminate();
    assert_eq!(ended.status.code(), Some(0));
    assert!(ended.stderr.contains("cannot be told"), "{}", ended.stderr);
    told.push_str(&ended.stderr);
    for secret in SECRETS {
        let at = told.find(secret);
        assert!(at.is_none(), "…{}…", &told[at.unwrap().saturating_sub(300)..][..300]);
    }
}

#[test]
fn an_encrypted_webhook_is_told_only_by_who_trusts_its_certificate() {
    let (hook, certificate) = Hook::start_tls();
    let dir = folder(&[
        ("trusting", &hook.url, "ca_file = \"ca.pem\""),
        ("strange", &hook.url, "ca_file = \"other.pem\""),
    ]);
    let other = rcgen::generate_simple_self_signed(vec!["localhost".to_owned()]).unwrap();
    std::fs::write(dir.path().join("ca.pem"), certificate).unwrap();
    std::fs::write(dir.path().join("other.pem"), other.cert.pem()).unwrap();
    let daemon = Daemon::start_in(dir);
    alarms(&daemon);
    wait_told(&daemon, "trusting", None);
    assert_eq!(hook.taken(), history(&daemon), "by one of two");
    let told = support::wait_until("a failure", || {
        receiver(&daemon, "strange")["failure"].as_str().map(str::to_owned)
    });
    assert_eq!(told, "its certificate or TLS is not accepted");
}

#[test]
fn alarms_are_listed_and_acted_on_from_the_command_line() {
    let daemon = Daemon::start_in(folder(&[]));
    let standing = alarms(&daemon);
    let ids: Vec<&str> = standing.keys().map(String::as_str).collect();
    let run = |arguments: &[&str]| {
        let mut command = support::command();
        command.arg("alarms").args(arguments).args(["--url", &daemon.base_url]);
        support::run(&mut command)
    };
    let json = |ended: &support::Ended| -> Value { serde_json::from_str(&ended.stdout).unwrap() };
    let list = run(&["list", "--machine", "rig-1", "--state", "unacknowledged"]);
    assert!(ids.iter().all(|id| list.stdout.contains(id)), "{}", list.stdout);
    let signed = ["--author", "M. Ito", "--comment", "bearing ordered"];
    let acked = run(
        &[&["ack", ids[0], ids[1], "rig-1:99999"][..], &signed, &["--format", "json"]].concat()
    );
    assert_eq!(acked.status.code(), Some(2), "one of three is unknown");
    assert!(acked.stderr.contains("no alarm 99999 is standing"), "{}", acked.stderr);
    assert_eq!(json(&acked)["items"].as_array().unwrap().len(), 2);
    let acts = [
        ("shelve", "shelved"),
        ("unshelve", "unacknowledged"),
        ("suppress", "suppressed"),
        ("unsuppress", "unacknowledged"),
        ("out-of-service", "out_of_service"),
        ("return", "unacknowledged"),
    ];
    for (act, state) in acts {
        let for_s = if act == "shelve" { &["--for", "8h"][..] } else { &[] };
        let done = run(&[&[act, ids[0]][..], &signed, for_s, &["--format", "json"]].concat());
        assert_eq!(done.status.code(), Some(0), "{act}: {}", done.stderr);
        assert_eq!(json(&done)["items"][0]["state"], state, "{act}");
    }
    let refused = run(&[&["reset", ids[0]][..], &signed].concat());
    assert_eq!(refused.status.code(), Some(2));
    assert!(refused.stderr.contains("(status 409)"), "{}", refused.stderr);
    let history = run(&["history", "--limit", "3"]);
    assert_eq!(history.stdout.lines().count(), 3, "{}", history.stdout);
    assert!(history.stdout.contains("by M. Ito: bearing ordered"), "{}", history.stdout);
    let shown = run(&["show", ids[0]]);
    assert!(shown.stdout.contains("returned_to_service"), "{}", shown.stdout);
    let (_, audit) = daemon.get_json("/api/v1/audit?author=M.%20Ito&limit=2");
    assert_eq!(audit["items"][0]["action"], "returned_to_service", "{audit}");
    assert_eq!(audit["items"][0]["alarm"], ids[0]);
    let next = audit["next"].as_str().unwrap();
    let (_, page) = daemon.get_json(&format!("/api/v1/audit?author=M.%20Ito&after={next}"));
    assert_eq!(
        (page["items"].as_array().unwrap().len(), &page["next"]),
        (6, &Value::Null),
        "{page}"
    );
    let (_, ran) = daemon.get_json("/api/v1/configurations");
    let (_, system) = daemon.get_json("/api/v1/system");
    assert_eq!(ran["items"][0]["hash"], system["configuration_hash"]);
    let nobody =
        support::run(support::command().args(["alarms", "list", "--url", "http://127.0.0.1:1"]));
    assert_eq!(nobody.status.code(), Some(2));
    assert!(nobody.stderr.contains("refuses the connection"), "{}", nobody.stderr);
    let clear =
        support::run(support::command().args(["alarms", "list", "--url", "http://example.org"]));
    assert!(clear.stderr.contains("in the clear"), "{}", clear.stderr);
}

#[test]
fn mistakes_name_the_place_and_no_secret() {
    let config = format!(
        "[[notify.webhook]]\nname = \"a b\"\nurl = \"http://example.org/{p}\"\nsecret = \"{s}\"\n\
         headers = [\"no colon {h}\", \"Webhook-Id: {h}\"]\n\
         [[notify.webhook]]\nname = \"b\"\nurl = 5\nsecret = \"short\"\nlevels = [\"bad\"]\n\
         secret_file = \"none\"\nmachines = [\"rig-9\"]\n\
         [[notify.mqtt]]\nname = \"b\"\nprefix = \"a/#\"\npassword_file = \"none\"\nport = 0\n\
         [[notify.email]]\nto = \"{s}\"\n",
        p = SECRETS[2],
        s = SECRETS[0],
        h = SECRETS[1]
    );
    let ended = support::refused(&config, &[]);
    assert_eq!(ended.status.code(), Some(2));
    for words in [
        "name of 1 to 64",
        "in the clear",
        "header 1 is not written",
        "Webhook-Id is set by the program",
        "notify.webhook[1].url",
        "notify.mqtt[0].port",
        "notify.mqtt[0]: the key \"host\" is missing",
        "notify.email: unknown key, allowed here: notify.webhook, notify.mqtt",
    ] {
        assert!(ended.stderr.contains(words), "{words} is not in\n{}", ended.stderr);
    }
    for secret in SECRETS {
        assert!(!ended.stderr.contains(secret), "{}", ended.stderr);
    }
}
