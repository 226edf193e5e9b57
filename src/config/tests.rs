//! Every mistake is reported at its place, and the reference tells the truth.

use super::*;
use crate::capture::hints::Hints;
use crate::units::Hz;
use std::ffi::OsString;
use std::os::unix::fs::PermissionsExt;
use tempfile::TempDir;

const MACHINE: &str =
    "[machine]\nid = \"rig-1\"\nname = \"Rig\"\n[[shaft]]\nid = \"main\"\nspeed_hz = 10.0\n";

/// A folder with `rig.toml`, `x.h5` and the configuration.
fn folder(config: &str) -> TempDir {
    let dir = TempDir::new().unwrap();
    fs::write(dir.path().join("rig.toml"), MACHINE).unwrap();
    fs::write(dir.path().join("x.h5"), "").unwrap();
    fs::write(dir.path().join("serve.toml"), config).unwrap();
    dir
}

fn load_text(config: &str, environment: &[(&str, &str)]) -> Result<Config, ConfigErrors> {
    let dir = folder(config);
    load_with(
        &dir.path().join("serve.toml"),
        environment.iter().map(|(k, v)| ((*k).to_owned(), OsString::from(v))),
    )
}

/// The mistakes, with `file:` cut to the file's name.
fn mistakes(config: &str, environment: &[(&str, &str)]) -> Vec<String> {
    let errors = load_text(config, environment).unwrap_err();
    let line = |p: &Problem| p.to_string().rsplit("serve.toml:").next().unwrap().to_owned();
    errors.0.iter().map(line).collect()
}

const RIG: &str = r#"
[[machine]]
file = "rig.toml"
[[source]]
kind = "replay"
machine = "rig-1"
file = "x.h5"
"#;

#[test]
fn the_reference_parses_to_the_defaults() {
    let dir = folder(REFERENCE);
    let config = load_with(&dir.path().join("serve.toml"), []).unwrap();
    let store = Store { directory: dir.path().join("data"), ..Store::default() };
    assert_eq!(config.files.0, [dir.path().join("serve.toml")]);
    assert_eq!(config, Config { store, files: config.files.clone(), ..Config::default() });
}

#[test]
fn the_reference_names_every_key_its_range_and_its_variable() {
    for key in keys::KEYS {
        let name = &key.name;
        let assigned = REFERENCE
            .lines()
            .find(|line| line.trim_start_matches("# ").starts_with(&format!("{name} = ")));
        assert!(assigned.is_some(), "{name}");
        let Some(variable) = key.variable() else { continue };
        let at = REFERENCE.find(&format!("# {variable}\n{name} = ")).expect(&variable);
        let comment = REFERENCE[..at].rsplit("\n\n").next().unwrap();
        let comment = comment.rsplit("\nROTORWATCH").next().unwrap().replace("\n# ", " ");
        let range = match key.kind {
            keys::Kind::Whole(low, high) => format!("{low} to {high}"),
            keys::Kind::Number(low, high) => format!("{low} to {high}"),
            keys::Kind::Text | keys::Kind::Texts | keys::Kind::Flag | keys::Kind::Speed => continue,
        };
        assert!(comment.contains(&range), "{name}: {range} is not in: {comment}");
    }
}

#[test]
fn a_complete_configuration_is_read() {
    let text = format!(
        "[pipeline]\nworkers = 2\nwindow_seconds = 4\nhop_seconds = 2\n{RIG}speed = 2.5\nloop = true\n"
    );
    let dir = folder(&text);
    let config = load_with(&dir.path().join("serve.toml"), []).unwrap();
    assert_eq!(config.workers, 2);
    assert_eq!((config.monitor.window_s, config.monitor.hop_s), (4.0, 2.0));
    let [machine] = &config.machines[..] else { panic!("one machine") };
    assert_eq!(machine.machine.id, "rig-1");
    let file = dir.path().join("x.h5");
    let speed = replay::Speed::Times(2.5);
    assert_eq!(
        machine.source,
        SourceConfig::Replay(replay::Settings {
            file,
            hints: Hints::default(),
            speed,
            repeat: true
        })
    );
}

#[test]
fn all_mistakes_are_reported_at_their_places() {
    let text = r#"
[server]
bind = "0.0.0.0:8080"
port = 8080
[pipeline]
workers = -1
hop_seconds = 20
window_seconds = "long"
[alarm]
[[machine]]
file = "rig.toml"
baseline = ["healthy.h5"]
[[source]]
kind = "opc"
machine = "rig-2"
speed = "fast"
"#;
    let expected = [
        "4:1: server.port: unknown key, allowed here: bind, token_file, hosts, cors_origins, max_requests_per_s, max_connections, max_event_streams",
        "6:1: pipeline.workers: -1 is not a whole number from 0 to 256",
        "8:1: pipeline.window_seconds: \"long\" is not a number from 1 to 600",
        "9:2: alarm: unknown key, allowed here: server, server.tls, ingest, store, recording, captures, pipeline, diagnosis, alarms, log, machine, source",
        "16:1: source[0].speed: \"fast\" is not \"max\" or a number above 0",
        "3:1: server.bind: 0.0.0.0:8080 can be reached from other hosts",
        "7:1: pipeline.hop_seconds: 20 s is longer than window_seconds (10 s)",
        "14:1: source[0].kind: \"opc\" is no kind of source, allowed: \"replay\", \"simulated\", \"tcp\", \"mqtt\"",
        "15:1: source[0].machine: no machine has the id \"rig-2\", known: rig-1",
        "12:1: machine[0].baseline: there is no file",
        "10:1: machine[0]: machine \"rig-1\" has no source",
    ];
    let found = mistakes(text, &[]);
    for expected in expected {
        assert!(found.iter().any(|m| m.starts_with(expected)), "{expected}\nnot in {found:#?}");
    }
    assert_eq!(found.len(), expected.len(), "{found:#?}");
}

#[test]
fn brokers_are_asked_beside_senders_and_each_topic_is_one() {
    let text = "[[machine]]\nfile = \"rig.toml\"\n[[source]]\nkind = \"tcp\"\nmachine = \"rig-1\"\n[[source]]\n\
                kind = \"mqtt\"\nmachine = \"rig-1\"\nrate_hz = 1\nhost = \"broker\"\n";
    let with = |topics: &str| format!("{text}topics = {topics}\n");
    let config =
        load_text(&with("[\"load: plant/a:b/load\", \"speed: plant/speed\"]"), &[]).unwrap();
    let SourceConfig::Live(live) = &config.machines[0].source else { panic!("senders") };
    let broker = &live.brokers[0];
    assert!(live.listens);
    assert_eq!((broker.connection.port, broker.connection.host.as_str()), (1883, "broker"));
    let expected = [("load", "plant/a:b/load"), ("speed", "plant/speed")];
    assert_eq!(broker.topics, expected.map(|(c, t)| (c.to_owned(), t.to_owned())));
    for (topics, expected) in [
        ("[]", "0 are given"),
        ("[\"load\"]", "not of the form"),
        ("[\"load: plant/+\"]", "not of the form"),
        ("[\"load: a\", \"load: b\"]", "line before it"),
    ] {
        let found = mistakes(&with(topics), &[]);
        assert!(found.iter().any(|m| m.contains(expected)), "{topics}: {found:#?}");
    }
    let twice = format!("{}[[source]]\nkind = \"tcp\"\nmachine = \"rig-1\"\n", with("[\"x: x\"]"));
    assert!(mistakes(&twice, &[])[0].contains("already has a source"));
    let fast = with("[\"x: x\"]").replace("rate_hz = 1", "rate_hz = 1000");
    assert!(mistakes(&fast, &[])[0].contains("over TCP"));
    let foreign = with("[\"x: x\"]").replace("rate_hz", "loop = true\nrate_hz");
    assert!(mistakes(&foreign, &[])[0].contains("no such key"));
}

#[test]
fn senders_need_tokens_where_others_reach_and_no_message_shows_one() {
    let tcp = "[[machine]]\nfile = \"rig.toml\"\n[[source]]\nkind = \"tcp\"\nmachine = \"rig-1\"\n";
    let config = load_text(tcp, &[]).unwrap();
    assert_eq!(config.machines[0].source, SourceConfig::Live(Live::listening()));
    assert_eq!(config.ingest, Ingest::default());
    let found = mistakes(&format!("{tcp}speed = 1\nscene = \"GG_GS_GB\"\n"), &[]);
    assert!(
        found.iter().all(|m| m.contains("a source of the kind \"tcp\" has no such key")),
        "{found:#?}"
    );
    assert_eq!(found.len(), 2, "{found:#?}");
    let open = format!("[ingest]\nbind = \"0.0.0.0:8081\"\n{tcp}");
    let found = mistakes(&open, &[]);
    assert!(found[0].starts_with("2:1: ingest.bind: 0.0.0.0:8081 can be reached"), "{found:#?}");
    let moved = mistakes(&format!("[ingest]\ntoken_file = \"tokens\"\n{tcp}"), &[]);
    assert!(moved[0].contains("rotorwatch token create --role ingest"), "{moved:#?}");
    // Private, or whoever may read or change it decides who comes in.
    let with = |tokens: &str, mode: u32| {
        let dir = folder(&format!("[server]\ntoken_file = \"tokens\"\n{open}"));
        let file = dir.path().join("tokens");
        fs::write(&file, tokens).unwrap();
        fs::set_permissions(&file, fs::Permissions::from_mode(mode)).unwrap();
        load_with(&dir.path().join("serve.toml"), [])
    };
    let list = format!("[[token]]\nlabel = 'a'\nrole = 'ingest'\nsha256 = '{}'\n", "7f".repeat(32));
    for mode in [0o600, 0o400, 0o640] {
        let config = with(&list, mode).unwrap();
        assert_eq!(
            config.access.tokens.as_ref().unwrap().0.labels().into_iter().collect::<Vec<_>>(),
            ["a"]
        );
        assert!(!format!("{config:?}").contains("7f7f"));
    }
    for mode in [0o644, 0o604, 0o660, 0o602] {
        let errors = with(&list, mode).unwrap_err().to_string();
        assert!(errors.contains("server.token_file") && errors.contains("chmod 600"), "{errors}");
    }
    // Without any token nobody comes in.
    assert!(with("", 0o600).unwrap().access.tokens.is_some());
    for wrong in ["rotorwatch_7f7f7f7f", "[[token]]\nlabel = 'rotorwatch_7f7f7f7f'\n"] {
        let errors = with(wrong, 0o600).unwrap_err().to_string();
        assert!(errors.contains("server.token_file") && !errors.contains("7f7f"), "{errors}");
    }
    let missing = format!("[server]\ntoken_file = \"none\"\n{tcp}");
    assert!(mistakes(&missing, &[])[0].contains("none cannot be read"));
}

#[test]
fn an_address_that_others_reach_needs_tokens_or_the_word_insecure() {
    let dir = folder(&format!("[server]\nbind = \"192.0.2.1:8080\"\n{RIG}"));
    let file = dir.path().join("serve.toml");
    let refused = load_with(&file, []).unwrap_err().to_string();
    assert!(refused.contains("192.0.2.1:8080 can be reached from other hosts"), "{refused}");
    assert!(refused.contains("token_file") && refused.contains("--insecure"), "{refused}");
    let insecure = read(&file, [], Exposure::Insecure).unwrap();
    assert_eq!((insecure.access.exposure, insecure.access.tokens), (Exposure::Insecure, None));
}

#[test]
fn names_and_origins_are_lists_in_the_file_and_texts_in_the_environment() {
    let text = format!(
        "[server]\nhosts = [\"monitor.example.org\", \"gate:9000\"]\ncors_origins = [\"https://a.example\"]\n{RIG}"
    );
    let access = load_text(&text, &[]).unwrap().access;
    assert_eq!(access.hosts, ["monitor.example.org", "gate:9000"]);
    assert_eq!(access.cors_origins, ["https://a.example"]);
    let environment = [("ROTORWATCH__SERVER__HOSTS", "a.example, b:1")];
    assert_eq!(load_text(&text, &environment).unwrap().access.hosts, ["a.example", "b:1"]);
    for (key, wrong) in [
        ("hosts", "http://a.example"),
        ("hosts", "u@a.example"),
        ("hosts", ""),
        ("cors_origins", "*"),
        ("cors_origins", "https://a.example/x"),
        ("cors_origins", "a.example"),
    ] {
        let text = format!("[server]\n{key} = [\"{wrong}\"]\n{RIG}");
        let found = mistakes(&text, &[]);
        assert!(
            found[0].starts_with(&format!("2:1: server.{key}: {wrong:?} is not")),
            "{found:#?}"
        );
    }
}

fn certificate(name: &str) -> (String, String) {
    let made = rcgen::generate_simple_self_signed(vec![name.to_owned()]).unwrap();
    (made.cert.pem(), made.signing_key.serialize_pem())
}

#[test]
fn a_certificate_must_be_that_of_its_key_and_the_key_private() {
    let tls = "[server.tls]\ncert_file = \"cert.pem\"\nkey_file = \"key.pem\"\n";
    let with = |(cert, key): (&str, &str), mode: u32| {
        let dir = folder(&format!("{tls}{RIG}"));
        fs::write(dir.path().join("cert.pem"), cert).unwrap();
        let file = dir.path().join("key.pem");
        fs::write(&file, key).unwrap();
        fs::set_permissions(&file, fs::Permissions::from_mode(mode)).unwrap();
        load_with(&dir.path().join("serve.toml"), [])
    };
    let ((cert, key), (other_cert, other_key)) = (certificate("a"), certificate("b"));
    let right = with((&cert, &key), 0o600).unwrap();
    assert_eq!(right.files.0.len(), 6 - 2, "both are followed: {:?}", right.files.0);
    let other = with((&other_cert, &other_key), 0o600).unwrap();
    assert_ne!(right.access.tls, other.access.tls);
    assert_eq!(
        format!("{:?}", right.access.tls),
        format!("{:?}", other.access.tls),
        "no part of a hash"
    );
    for ((cert, key), mode, expected) in [
        (
            (cert.as_str(), other_key.as_str()),
            0o600,
            "the key is not that of the first certificate",
        ),
        (("none", key.as_str()), 0o600, "holds no certificates"),
        ((cert.as_str(), "none"), 0o600, "holds no private key"),
        ((cert.as_str(), key.as_str()), 0o644, "chmod 600"),
    ] {
        let errors = with((cert, key), mode).unwrap_err().to_string();
        assert!(errors.contains(expected) && !errors.contains(key), "{expected}: {errors}");
    }
    let half = mistakes(&format!("[server.tls]\ncert_file = \"cert.pem\"\n{RIG}"), &[]);
    assert!(half[0].contains("server.tls: cert_file and key_file are both needed"), "{half:#?}");
    let flat = mistakes(&format!("[server]\ntls = true\n{RIG}"), &[]);
    assert!(flat[0].contains("write it as [server.tls]"), "{flat:#?}");
}

#[test]
fn recording_is_off_unless_enabled_and_must_fit_into_the_store() {
    assert_eq!(
        load_text(&format!("[recording]\ncompression = 4\n{RIG}"), &[]).unwrap().recording,
        None
    );
    let on = format!("[recording]\nenabled = true\ncompression = 4\n{RIG}");
    let settings = load_text(&on, &[]).unwrap().recording.unwrap();
    assert_eq!(settings, recording::Settings { gzip: Some(4), ..RECORDING });
    // One machine's file and one to spare: twice 500 MB.
    let environment = [("ROTORWATCH__STORE__MAX_BYTES", "999999999")];
    let found = mistakes(&on, &environment);
    assert!(found[0].contains("recording.segment_bytes: 500000000 for each of 1"), "{found:#?}");
    let enough = [("ROTORWATCH__STORE__MAX_BYTES", "1000000000")];
    assert!(load_text(&on, &enough).is_ok());
}

#[test]
fn every_syntax_error_has_its_place() {
    let found = mistakes("[server]\nbind = \n[store]\nmax_bytes = 1x\n", &[]);
    assert!(found[0].starts_with("2:"), "{found:#?}");
    assert!(found.iter().any(|m| m.starts_with("4:")), "{found:#?}");
}

#[test]
fn the_environment_overrides_the_file() {
    let config = load_text(
        &format!("[server]\nbind = \"127.0.0.1:1\"\n{RIG}"),
        &[
            ("ROTORWATCH__SERVER__BIND", "127.0.0.1:0"),
            ("ROTORWATCH__PIPELINE__WORKERS", "3"),
            ("ROTORWATCH__PIPELINE__RING_SECONDS", "45.5"),
            ("ROTORWATCH__STORE__DIRECTORY", "7"), // a text that looks like a number
            ("ROTORWATCH_LOG", "debug"),           // another variable, not a key
        ],
    )
    .unwrap();
    assert_eq!(config.bind.port(), 0);
    assert_eq!((config.workers, config.monitor.ring_s), (3, 45.5));
    assert!(config.store.directory.ends_with("7"));
}

#[test]
fn a_machine_file_with_a_mistake_is_told_once_and_not_as_a_machine_that_is_missing() {
    let text = "[[machine]]\nfile = \"none.toml\"\n[[source]]\nkind = \"tcp\"\nmachine = \"rig-9\"\n\
                [[notify.webhook]]\nname = \"n\"\nurl = \"http://127.0.0.1:1/\"\nmachines = [\"rig-9\"]\n";
    let found = mistakes(text, &[]);
    assert_eq!(found.len(), 1, "{found:#?}");
    assert!(found[0].contains("none.toml cannot be read"), "{found:#?}");
}

#[test]
fn mistakes_in_the_environment_name_the_variable() {
    let found = mistakes(
        RIG,
        &[
            ("ROTORWATCH__PIPELINE__WORKERS", "many"),
            ("ROTORWATCH__PIPELINE__WORKER", "1"),
            ("ROTORWATCH__MACHINE__FILE", "x"),
            ("ROTORWATCH__SERVER__BIND", "192.0.2.1:80"),
        ],
    );
    assert_eq!(found.len(), 4, "{found:#?}");
    assert!(found[0].contains("PIPELINE__WORKERS: \"many\" is not a whole number"), "{found:#?}");
    assert!(found[1].contains("PIPELINE__WORKER: no such setting"), "{found:#?}");
    assert!(found[2].contains("MACHINE__FILE: no such setting"), "{found:#?}");
    assert!(found[3].starts_with("environment: ROTORWATCH__SERVER__BIND: 192"), "{found:#?}");
}

#[test]
fn one_source_a_machine() {
    let twice =
        format!("{RIG}[[source]]\nkind = \"replay\"\nmachine = \"rig-1\"\nfile = \"x.h5\"\n");
    assert!(mistakes(&twice, &[])[0].contains("already has a source"));
    let same_id = format!("{RIG}[[machine]]\nfile = \"rig.toml\"\n");
    assert!(mistakes(&same_id, &[])[0].contains("\"rig-1\" is already used"));
    let absent = "[[machine]]\nbaseline = []\n[[source]]\nkind = \"replay\"\n";
    let found = mistakes(absent, &[]);
    assert_eq!(found.len(), 3, "{found:#?}"); // machine.file, source.machine, source.file
}

#[test]
fn what_a_file_does_not_say_its_source_says() {
    let config = load_text(&format!("{RIG}rate_hz = 12000\nunit = \"g\"\n"), &[]).unwrap();
    let SourceConfig::Replay(replay) = &config.machines[0].source else { panic!("a replay") };
    let hints = (replay.hints.rate, replay.hints.unit.as_deref());
    assert_eq!(hints, (Some(Hz(12_000.0)), Some("g")));
    let found = mistakes(&format!("{RIG}rate_hz = 0\nunit = \"furlong\"\n"), &[]);
    assert_eq!(found.len(), 2, "{found:#?}");
    assert!(
        found[0].contains("source[0].rate_hz: 0 is not a number from 0.000001 to"),
        "{found:#?}"
    );
    assert!(found[1].contains("source[0].unit: \"furlong\" is none of g, m/s^2"), "{found:#?}");
}

#[test]
fn a_missing_file_is_named() {
    let error = load_with(Path::new("/nonexistent/serve.toml"), []).unwrap_err();
    assert!(error.to_string().contains("/nonexistent/serve.toml"), "{error}");
}
