//! No secret of a daemon that has all kinds of them is told anywhere: log, errors, metrics, answers, bundle, manifest.

use crate::access;
use crate::access::Client;
use crate::support;
use crate::support::Daemon;
use flate2::read::GzDecoder;
use std::fs;
use std::io::Read;
use std::path::Path;

/// Texts of a gzipped tar by their names.
pub(crate) fn unpacked(archive: &Path) -> Vec<(String, String)> {
    let file = fs::File::open(archive).unwrap();
    let mut archive = tar::Archive::new(GzDecoder::new(file));
    let read = |entry: std::io::Result<tar::Entry<'_, _>>| {
        let mut entry: tar::Entry<'_, GzDecoder<fs::File>> = entry.unwrap();
        let name = entry.path().unwrap().to_string_lossy().into_owned();
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).unwrap();
        (name, String::from_utf8_lossy(&bytes).into_owned())
    };
    archive.entries().unwrap().map(read).collect()
}

/// Paths of the API document that need nothing filled in, and some that do.
fn paths(client: &Client) -> Vec<String> {
    let (_, document) = client.get("/api/v1/openapi.json");
    let all = document["paths"].as_object().unwrap().iter();
    let read = all.filter(|(path, item)| item["get"].is_object() && !path.contains("ingest"));
    let named = read.map(|(path, _)| path.replace("{id}", "rig-1").replace("{name}", "right_x"));
    named.filter(|path| !path.contains('{') && path != "/api/v1/events").collect()
}

#[test]
fn no_secret_is_told_anywhere() {
    let random = || format!("{:032x}", rand::random::<u128>());
    let [hook, header, place, password, typed] = std::array::from_fn(|_| random());
    let notify = format!(
        "{}[[notify.webhook]]\nname = \"room\"\nurl = \"http://127.0.0.1:1/{place}\"\nsecret = \"{hook}\"\n\
         headers = [\"Authorization: Bearer {header}\"]\n[[notify.mqtt]]\nname = \"plant\"\nhost = \"127.0.0.1\"\n\
         port = 1\nprefix = \"plant\"\nuser = \"watch\"\npassword_file = \"password\"\n",
        access::MACHINES
    );
    let server = "token_file = \"tokens.toml\"\n[server.tls]\ncert_file = \"cert.pem\"\nkey_file = \"key.pem\"";
    let dir = access::folder(server, &notify);
    fs::write(dir.path().join("password"), &password).unwrap();
    let certificate = access::certificate();
    access::put(dir.path(), &certificate);
    let [admin, viewer] = ["admin", "viewer"]
        .map(|role| access::create(dir.path(), &["--role", role, "--label", role]));
    fs::write(dir.path().join("admin.token"), &admin).unwrap();
    let daemon = Daemon::start_logging(dir, "trace");
    let at = daemon.dir.path().to_owned();
    let mut told = String::new();
    let client = |token: Option<&str>| Client::new(&daemon, token, Some(&certificate.0));
    // Two words of it right, and one that somebody typed wrong: it may be right elsewhere.
    for token in [None, Some(&*viewer), Some(&*admin), Some(&*typed)] {
        let client = client(token);
        for path in ["/metrics", "/api/v1/system", "/api/v1/log", "/api/v1/audit", "/api/v1/none"] {
            told += &client.get(path).1.to_string();
        }
    }
    let mut n_answered = 0;
    for path in paths(&client(Some(&admin))) {
        let (status, answer) = client(Some(&admin)).get(&path);
        n_answered += usize::from(status == 200);
        told += &answer.to_string();
    }
    assert!(n_answered > 15, "{n_answered}");
    // A mistake beside each secret.
    let config = fs::read_to_string(at.join("serve.toml")).unwrap();
    let broken = config.replace("name = \"room\"", "name = 7").replace("\nurl = ", "\nuri = ");
    fs::write(at.join("serve.toml"), &broken).unwrap();
    daemon.signal("HUP");
    let rejected = support::wait_until("the mistakes", || {
        let (_, system) = client(Some(&admin)).get("/api/v1/system");
        let why = system["configuration"]["rejected_because"].clone();
        why.as_array().is_some_and(|why| why.len() > 1).then_some(why)
    });
    told += &rejected.to_string();
    let run = |arguments: &[&str]| {
        let mut command = support::command();
        command.current_dir(&at).args(arguments);
        let ended = support::run(&mut command);
        format!("{}{}", ended.stdout, ended.stderr)
    };
    told += &run(&["check", "serve.toml"]);
    let url = &daemon.base_url;
    let asked = ["--url", url, "--ca-file", "cert.pem", "--token-file", "admin.token"];
    let bundle = |out: &str| {
        run(&[&["support-bundle", "--config", "serve.toml", "--out", out], &asked[..]].concat())
    };
    told += &bundle("broken.tar.gz");
    fs::write(at.join("serve.toml"), &config).unwrap();
    told += &bundle("support.tar.gz");
    told += &run(&[&["status"], &asked[..]].concat());
    told += &run(&["backup", "--config", "serve.toml", "--out", "backup.tar.gz"]);
    for archive in ["broken.tar.gz", "support.tar.gz"] {
        for (name, text) in unpacked(&at.join(archive)) {
            told += &format!("{name}\n{text}\n");
        }
    }
    for part in [
        "daemon/metrics.txt",
        "daemon/log.txt",
        "daemon/rig-1-channels.json",
        "uri",
        "somebody was not let in",
    ] {
        assert!(told.contains(part), "{part}");
    }
    let backup = unpacked(&at.join("backup.tar.gz"));
    let manifest = &backup.last().unwrap().1;
    assert!(
        manifest.contains("rotorwatch.backup/1") && manifest.contains("tokens.toml"),
        "{manifest}"
    );
    told += manifest;
    told += &String::from_utf8_lossy(&fs::read(at.join("data/state.db")).unwrap());
    told += &daemon.terminate().stderr;
    let key = certificate.1.lines().filter(|line| !line.starts_with("---")).map(str::to_owned);
    let secrets = [hook, header, place, password, typed, admin, viewer];
    for secret in secrets.into_iter().chain(key) {
        let at = told.find(&secret).map(|at| &told[at.saturating_sub(200)..at + 40]);
        assert_eq!(at, None, "told");
    }
}
