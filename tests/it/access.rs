//! Tokens and certificates of the built daemon: who comes in, who does not any more, and what is told of either.

use crate::support;
use crate::support::Daemon;
use crate::support::MACHINE;
use serde_json::Value;
use serde_json::json;
use std::fs;
use std::io::BufRead;
use std::io::BufReader;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::time::Duration;
use tempfile::TempDir;
use ureq::Agent;
use ureq::tls::Certificate;
use ureq::tls::RootCerts;
use ureq::tls::TlsConfig;

/// Two machines, each with a short replay.
pub(crate) const MACHINES: &str = r#"
[[machine]]
file = "rig.toml"
[[source]]
kind = "replay"
machine = "rig-1"
file = "x.h5"
speed = "max"
[[machine]]
file = "other.toml"
[[source]]
kind = "replay"
machine = "rig-2"
file = "x.h5"
speed = "max"
"#;

/// Somebody who asks a daemon.
pub(crate) struct Client {
    agent: Agent,
    base_url: String,
    token: Option<String>,
}

impl Client {
    /// Trusts `ca` (PEM) alone, if it is given.
    pub(crate) fn new(daemon: &Daemon, token: Option<&str>, ca: Option<&str>) -> Self {
        let mut config = Agent::config_builder()
            .http_status_as_error(false)
            .timeout_global(Some(Duration::from_secs(30)));
        if let Some(ca) = ca {
            let provider = rustls::crypto::ring::default_provider();
            let ca = Certificate::from_pem(ca.as_bytes()).unwrap();
            config = config.tls_config(
                TlsConfig::builder()
                    .root_certs(RootCerts::from(vec![ca]))
                    .unversioned_rustls_crypto_provider(std::sync::Arc::new(provider))
                    .build(),
            );
        }
        let (base_url, token) = (daemon.base_url.clone(), token.map(str::to_owned));
        Self { agent: config.build().into(), base_url, token }
    }

    fn signed<B>(&self, request: ureq::RequestBuilder<B>) -> ureq::RequestBuilder<B> {
        match &self.token {
            Some(token) => request.header("authorization", format!("Bearer {token}")),
            None => request,
        }
    }

    pub(crate) fn get(&self, path: &str) -> (u16, Value) {
        let mut response = self.signed(self.agent.get(self.url(path))).call().unwrap();
        let text = response.body_mut().read_to_string().unwrap();
        let document = serde_json::from_str(&text).unwrap_or(Value::String(text));
        (response.status().as_u16(), document)
    }

    fn post(&self, path: &str, body: &Value) -> (u16, Value) {
        let mut response = self.signed(self.agent.post(self.url(path))).send_json(body).unwrap();
        let text = response.body_mut().read_to_string().unwrap();
        (response.status().as_u16(), serde_json::from_str(&text).unwrap())
    }

    fn url(&self, path: &str) -> String {
        format!("{}{path}", self.base_url)
    }

    pub(crate) fn metric(&self, sample: &str) -> u64 {
        let (status, text) = self.get("/metrics");
        assert_eq!(status, 200);
        let text = text.as_str().unwrap().to_owned();
        let value = text.lines().find_map(|line| line.strip_prefix(sample)?.strip_prefix(' '));
        value.unwrap_or_else(|| panic!("no {sample} in {text}")).parse().unwrap()
    }
}

pub(crate) fn folder(server: &str, machines: &str) -> TempDir {
    let config = format!("[server]\nbind = \"127.0.0.1:0\"\n{server}\n{machines}");
    let other = MACHINE.replace("rig-1", "rig-2");
    let files = [("rig.toml", MACHINE.as_bytes()), ("other.toml", other.as_bytes())];
    let dir = support::folder(&config, &files);
    support::write_ramp(&dir, "x.h5", 1000.0, 30_000);
    dir
}

/// Makes a token with the built program; gives its secret.
pub(crate) fn create(dir: &Path, arguments: &[&str]) -> String {
    let mut command = support::command();
    command.args(["token", "create", "--config"]).arg(dir.join("serve.toml")).args(arguments);
    let ended = support::run(&mut command);
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
    let secret = ended.stdout.trim_end().to_owned();
    assert!(secret.starts_with("rotorwatch_") && secret.len() == 54, "{secret}");
    assert!(!ended.stderr.contains(&secret), "{}", ended.stderr);
    secret
}

fn token(dir: &Path, arguments: &[&str]) -> support::Ended {
    let mut command = support::command();
    command.arg("token").args(arguments).arg("--config").arg(dir.join("serve.toml"));
    support::run(&mut command)
}

#[test]
fn tokens_are_made_listed_and_revoked_while_the_daemon_runs() {
    let dir = folder("token_file = \"tokens.toml\"", MACHINES);
    let viewer = create(dir.path(), &["--label", "wall", "--role", "viewer"]);
    let file = dir.path().join("tokens.toml");
    assert_eq!(fs::metadata(&file).unwrap().permissions().mode() & 0o777, 0o600);
    let again = token(dir.path(), &["create", "--label", "wall", "--role", "admin"]);
    assert_eq!(again.status.code(), Some(2));
    assert!(again.stderr.contains("have the same label"), "{}", again.stderr);
    let daemon = Daemon::start_in(dir);
    let dir = daemon.dir.path().to_owned();
    let nobody = Client::new(&daemon, None, None);
    for path in ["/api/v1/machines", "/api/v1/machines/rig-9", "/nothing", "/metrics", "/readyz"] {
        let (status, problem) = nobody.get(path);
        assert_eq!((status, &problem["title"]), (401, &json!("A token is needed")), "{path}");
    }
    assert_eq!((nobody.get("/livez").0, nobody.get("/").0), (200, 200));
    let wall = Client::new(&daemon, Some(&viewer), None);
    support::wait_until("the end of the replays", || {
        let (_, list) = wall.get("/api/v1/machines");
        list["items"]
            .as_array()
            .unwrap()
            .iter()
            .all(|item| item["source"] == "finished")
            .then_some(())
    });
    let silence =
        json!({ "silence": "suppressed", "channel": "right_x", "author": "the director" });
    let (status, problem) = wall.post("/api/v1/machines/rig-1/silences", &silence);
    assert_eq!(status, 403, "{problem}");
    assert!(problem["detail"].as_str().unwrap().contains("with the role operator"), "{problem}");
    // One that comes is in within a moment, without any signal; of a machine that it is not of, it hears nothing.
    let operator = create(&dir, &["--label", "M. Ito", "--role", "operator", "--machine", "rig-2"]);
    let ito = Client::new(&daemon, Some(&operator), None);
    support::wait_until("the new token", || (ito.get("/api/v1/machines").0 == 200).then_some(()));
    let (_, list) = ito.get("/api/v1/machines");
    assert_eq!(list["items"].as_array().unwrap().len(), 1, "{list}");
    let [other, none] =
        ["rig-1", "rig-9"].map(|id| ito.get(&format!("/api/v1/machines/{id}/health")));
    assert_eq!(other.1.to_string().replace("rig-1", "rig-9"), none.1.to_string());
    assert_eq!(ito.post("/api/v1/machines/rig-1/silences", &silence).0, 404);
    let (status, said) = ito.post("/api/v1/machines/rig-2/silences", &silence);
    assert_eq!((status, &said["author"]), (201, &json!("M. Ito")), "{said}");
    let (_, audit) = ito.get("/api/v1/audit");
    assert_eq!(audit["items"][0]["author"], "M. Ito", "{audit}");
    assert_eq!(audit["items"][0]["machine"], "rig-2");
    // A stream of events ends with its token.
    let events = ito.signed(ito.agent.get(ito.url("/api/v1/events"))).call().unwrap();
    let mut events = BufReader::new(events.into_body().into_reader());
    let mut line = String::new();
    events.read_line(&mut line).unwrap();
    assert_eq!(line.trim_end(), "event: begin");
    let listed = token(&dir, &["list", "--format", "json"]);
    let listed: Value = serde_json::from_str(&listed.stdout).unwrap();
    assert_eq!(listed["items"][1]["label"], "M. Ito");
    assert_eq!(listed["items"][1]["machines"], json!(["rig-2"]));
    assert_eq!(token(&dir, &["revoke", "nobody"]).status.code(), Some(2));
    assert_eq!(token(&dir, &["revoke", "M. Ito"]).status.code(), Some(0));
    daemon.signal("HUP");
    support::wait_until("its end", || (ito.get("/api/v1/machines").0 == 401).then_some(()));
    // What is not private is refused, and what held before holds.
    fs::set_permissions(&file, fs::Permissions::from_mode(0o644)).unwrap();
    daemon.signal("HUP");
    support::wait_until("the refusal", || {
        (wall.metric("rotorwatch_config_failing") == 1).then_some(())
    });
    assert!(wall.metric("rotorwatch_access_denied_total{reason=\"missing\"}") >= 5);
    assert!(wall.metric("rotorwatch_access_denied_total{reason=\"role\"}") >= 1);
    let ((_, metrics), kept) = (wall.get("/metrics"), fs::read_to_string(&file).unwrap());
    let ended = daemon.terminate();
    let told = format!("{}{kept}{metrics}{audit}{listed}", ended.stderr);
    for secret in [&viewer, &operator] {
        assert!(!told.contains(secret.as_str()), "{told}");
    }
    assert!(ended.stderr.contains("a token was revoked"), "{}", ended.stderr);
}

#[test]
fn failures_of_a_peer_are_told_to_wait_and_a_right_token_is_not() {
    let dir = folder("token_file = \"tokens.toml\"", "");
    let secret = create(dir.path(), &["--label", "wall", "--role", "viewer"]);
    let daemon = Daemon::start_in(dir);
    let wrong = Client::new(&daemon, Some("rotorwatch_wrong"), None);
    let refused = support::wait_until("too many failures", || {
        let (status, problem) = wrong.get("/api/v1/machines");
        (status == 429).then_some(problem)
    });
    assert_eq!(refused["type"], "urn:rotorwatch:problem:too-many-failures");
    let right = Client::new(&daemon, Some(&secret), None);
    assert_eq!(right.get("/api/v1/machines").0, 200);
    assert!(right.metric("rotorwatch_access_denied_total{reason=\"too_many\"}") >= 1);
}

#[test]
fn what_others_can_reach_needs_tokens_or_the_word_insecure() {
    let config = "[server]\nbind = \"0.0.0.0:0\"\n";
    let refused = support::refused(config, &[]);
    assert_eq!(refused.status.code(), Some(2));
    assert!(
        refused.stderr.contains("0.0.0.0:0 can be reached from other hosts"),
        "{}",
        refused.stderr
    );
    let dir = support::folder(config, &[]);
    let daemon = Daemon::start_with(dir, |command| {
        command.arg("--insecure");
    });
    let port = daemon.base_url.rsplit_once(':').unwrap().1.to_owned();
    let here =
        Client { base_url: format!("http://127.0.0.1:{port}"), ..Client::new(&daemon, None, None) };
    let (_, system) = here.get("/api/v1/system");
    let warnings = system["security"]["warnings"].as_array().unwrap();
    assert_eq!(warnings.len(), 2, "{system}");
    assert_eq!(here.metric("rotorwatch_insecure{what=\"no_tokens\"}"), 1);
    assert_eq!(here.metric("rotorwatch_insecure{what=\"plain_text\"}"), 1);
    let ended = daemon.terminate();
    assert!(ended.stderr.contains("INSECURE"), "{}", ended.stderr);
}

/// A certificate for this computer, with its key, as PEM.
pub(crate) fn certificate() -> (String, String) {
    let names = vec!["127.0.0.1".to_owned(), "localhost".to_owned()];
    let made = rcgen::generate_simple_self_signed(names).unwrap();
    (made.cert.pem(), made.signing_key.serialize_pem())
}

pub(crate) fn put(dir: &Path, (cert, key): &(String, String)) {
    for (name, text) in [("key.pem", key), ("cert.pem", cert)] {
        // As a tool that renews certificates does: whole files take the place of others.
        fs::write(dir.join("new"), text).unwrap();
        fs::set_permissions(dir.join("new"), fs::Permissions::from_mode(0o600)).unwrap();
        fs::rename(dir.join("new"), dir.join(name)).unwrap();
    }
}

#[test]
fn a_certificate_is_exchanged_while_the_daemon_runs_and_a_bad_one_is_not() {
    let tls = "[server.tls]\ncert_file = \"cert.pem\"\nkey_file = \"key.pem\"";
    let (first, second) = (certificate(), certificate());
    let dir = folder(tls, "");
    put(dir.path(), &first);
    let daemon = Daemon::start_in(dir);
    let dir = daemon.dir.path().to_owned();
    assert!(daemon.base_url.starts_with("https://"), "{}", daemon.base_url);
    let of = |ca: &(String, String)| Client::new(&daemon, None, Some(&ca.0));
    let (before, after) = (of(&first), of(&second));
    assert_eq!(before.get("/livez").0, 200);
    assert!(before.get("/api/v1/system").1["security"]["encrypted"].as_bool().unwrap());
    assert!(
        after.agent.get(after.url("/livez")).call().is_err(),
        "an authority that is not trusted"
    );
    // In plain text nobody is answered.
    let answer = daemon_speaks_plain(&daemon);
    assert!(!answer.starts_with(b"HTTP"), "{answer:?}");
    put(&dir, &second);
    daemon.signal("HUP");
    support::wait_until("the new certificate", || {
        of(&second).agent.get(after.url("/livez")).call().is_ok().then_some(())
    });
    assert!(of(&first).agent.get(before.url("/livez")).call().is_err());
    fs::write(dir.join("cert.pem"), &first.0).unwrap();
    daemon.signal("HUP");
    support::wait_until("the refusal", || {
        (after.metric("rotorwatch_config_failing") == 1).then_some(())
    });
    let (_, system) = of(&second).get("/api/v1/system");
    let why = system["configuration"]["rejected_because"][0].as_str().unwrap();
    assert!(why.contains("the key is not that of the first certificate"), "{why}");
    let ended = daemon.terminate();
    for key in [&first.1, &second.1] {
        let line = key.lines().nth(1).unwrap();
        assert!(!ended.stderr.contains(line), "{}", ended.stderr);
    }
}

fn daemon_speaks_plain(daemon: &Daemon) -> Vec<u8> {
    use std::io::Read;
    use std::io::Write;
    let address = daemon.base_url.strip_prefix("https://").unwrap();
    let mut stream = std::net::TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    let mut answer = Vec::new();
    let _cut = stream
        .write_all(b"GET /livez HTTP/1.1\r\nhost: localhost\r\n\r\n")
        .and_then(|()| stream.read_to_end(&mut answer).map(drop));
    answer
}

#[test]
fn a_capture_is_streamed_encrypted_by_who_may() {
    let tls = "token_file = \"tokens.toml\"\n[server.tls]\ncert_file = \"cert.pem\"\nkey_file = \"key.pem\"\n\
               [ingest]\nbind = \"127.0.0.1:0\"";
    let source = "[[machine]]\nfile = \"rig.toml\"\n[[source]]\nkind = \"tcp\"\nmachine = \"rig-1\"\n\
                  [[machine]]\nfile = \"other.toml\"\n[[source]]\nkind = \"tcp\"\nmachine = \"rig-2\"\n";
    let pair = certificate();
    let dir = folder(tls, source);
    put(dir.path(), &pair);
    let at = dir.path().to_owned();
    let ingest = |label: &str, machine: &str| {
        let out = at.join(format!("{label}.token"));
        let mut command = support::command();
        command.args([
            "token",
            "create",
            "--role",
            "ingest",
            "--label",
            label,
            "--machine",
            machine,
        ]);
        command.arg("--config").arg(at.join("serve.toml")).arg("--out").arg(&out);
        let ended = support::run(&mut command);
        assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
        assert!(!ended.stdout.contains("rotorwatch_"), "{}", ended.stdout);
        assert_eq!(fs::metadata(&out).unwrap().permissions().mode() & 0o777, 0o600);
        out
    };
    let (one, two) = (ingest("one", "rig-1"), ingest("two", "rig-2"));
    let viewer = create(&at, &["--label", "wall", "--role", "viewer"]);
    fs::write(at.join("viewer.token"), &viewer).unwrap();
    let (daemon, line) = Daemon::start_with_second_line(dir);
    let address = line.strip_prefix("ingest on tls://").unwrap().to_owned();
    let send = |to: &str, machine: &str, token: &Path, ca: &str| {
        let mut command = support::command();
        command.args(["replay", "--speed", "max", "--machine", machine, "--to", to]);
        command.arg("--token-file").arg(token).arg("--ca-file").arg(at.join(ca));
        support::run(command.arg(at.join("x.h5")))
    };
    let (over_tls, over_https) = (format!("tls://{address}"), daemon.base_url.clone());
    let other = certificate();
    fs::write(at.join("other.pem"), other.0).unwrap();
    for (to, machine, token, ca, expected) in [
        (&over_tls, "rig-1", &one, "other.pem", "certificate"),
        (&over_https, "rig-1", &one, "other.pem", "certificate"),
        (&over_tls, "rig-1", &two, "cert.pem", "unknown-machine"),
        (&over_https, "rig-1", &two, "cert.pem", "unknown-machine"),
        (&over_tls, "rig-1", &at.join("viewer.token"), "cert.pem", "unauthorised"),
        (&over_https, "rig-1", &at.join("viewer.token"), "cert.pem", "unauthorised"),
    ] {
        let refused = send(to, machine, token, ca);
        assert_eq!(refused.status.code(), Some(2), "{to}");
        assert!(refused.stderr.contains(expected), "{to} {expected}: {}", refused.stderr);
    }
    for (to, machine, token) in [(&over_tls, "rig-1", &one), (&over_https, "rig-2", &two)] {
        let sent = send(to, machine, token, "cert.pem");
        assert_eq!(sent.status.code(), Some(0), "{to}: {}", sent.stderr);
    }
    let wall = Client::new(&daemon, Some(&viewer), Some(&pair.0));
    for machine in ["rig-1", "rig-2"] {
        support::wait_until("every sample", || {
            let (_, list) = wall.get(&format!("/api/v1/machines/{machine}/channels"));
            (list["items"][0]["ledger"]["used"] == 30_000).then_some(())
        });
    }
    let secrets = [&one, &two].map(|file| fs::read_to_string(file).unwrap());
    let ended = daemon.terminate();
    for secret in secrets {
        assert!(!ended.stderr.contains(secret.trim()), "{}", ended.stderr);
    }
}

#[test]
fn a_token_that_asks_too_often_is_told_when_to_come_again_and_counted() {
    let dir = folder("token_file = \"tokens.toml\"\nmax_requests_per_s = 1", "");
    let secret = create(dir.path(), &["--role", "viewer", "--label", "wall"]);
    let other = create(dir.path(), &["--role", "viewer", "--label", "desk"]);
    let daemon = Daemon::start_in(dir);
    let client = Client::new(&daemon, Some(&secret), None);
    let told = (0..20).map(|_| client.get("/api/v1/machines")).find(|(status, _)| *status == 429);
    let (_, problem) = told.unwrap();
    assert_eq!(problem["type"], "urn:rotorwatch:problem:too-many-requests");
    assert!(problem["detail"].as_str().unwrap().contains("server.max_requests_per_s"), "{problem}");
    let other = Client::new(&daemon, Some(&other), None);
    assert!(other.metric("rotorwatch_access_denied_total{reason=\"too_fast\"}") >= 1);
    assert_eq!(other.metric("rotorwatch_capacity{what=\"event_streams\"}"), 256);
    let answers =
        "rotorwatch_http_answers_total{method=\"GET\",route=\"/api/v1/machines\",status=\"429\"}";
    assert!(other.metric(answers) >= 1);
}
