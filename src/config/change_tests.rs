//! What each change takes: nothing, other limits, a machine anew, a restart.

use super::super::Exposure;
use super::super::FileText;
use super::super::Identity;
use super::super::Live;
use super::super::SourceConfig;
use super::super::TokenList;
use super::super::held_to;
use super::*;
use crate::capture::hints::Hints;
use crate::config::LogLevel;
use crate::ingest::replay;
use crate::machine::file;
use std::path::PathBuf;
use std::sync::Arc;

const MACHINE: &str = "[machine]\nid = 'rig'\n[[shaft]]\nid = 'main'\nspeed_hz = 10\n\
     [[bearing]]\nid = 'right'\nshaft = 'main'\ncatalogue = 'SKF 6205'\n\
     [[sensor]]\nchannel = 'x'\nkind = 'accelerometer'\nunit = 'm/s^2'\nat = { bearing = 'right' }\n";

fn entry(text: &str) -> MachineConfig {
    MachineConfig {
        file: PathBuf::from("rig.toml"),
        text: FileText(text.into()),
        machine: Arc::new(file::parse(text, "rig.toml").unwrap()),
        baseline: Vec::new(),
        source: SourceConfig::Replay(replay::Settings {
            hints: Hints::default(),
            file: PathBuf::from("x.h5"),
            speed: replay::Speed::Max,
            repeat: false,
        }),
    }
}

fn config() -> Config {
    let other = MACHINE.replace("'rig'", "'other'");
    Config { machines: vec![entry(MACHINE), entry(&other)], ..Config::default() }
}

/// The configuration with another file of the first machine.
fn with(text: &str) -> Config {
    let mut changed = config();
    changed.machines[0] = entry(text);
    changed
}

fn tokens(label: &str) -> TokenList {
    let secret = crate::access::Secret::of(&[label.as_bytes()[0]; 32]);
    let who = (label, crate::access::Role::Viewer);
    let token = crate::access::Token::new(&secret, who, &[], (None, None)).unwrap();
    let mut tokens = TokenList::default();
    tokens.0.add(token).unwrap();
    tokens
}

fn tls(name: &str) -> Tls {
    let made = rcgen::generate_simple_self_signed(vec![name.to_owned()]).unwrap();
    let identity = Identity::of_pem(&made.cert.pem(), &made.signing_key.serialize_pem()).unwrap();
    Tls { identity, of_ingest: true }
}

fn rebuilt(parts: &[&'static str], stale: bool) -> Extent {
    Extent::Rebuilt { parts: parts.to_vec(), stale }
}

#[test]
fn what_says_the_same_changes_nothing() {
    let mut same = config();
    same.files.0.push(PathBuf::from("elsewhere.toml"));
    same.machines[0].text = FileText(format!("# a remark\n{MACHINE}").as_str().into());
    same.machines[0].file = PathBuf::from("moved.toml");
    let change = between(&config(), same.clone());
    assert!(change.applied.is_empty() && change.restart.is_empty(), "{change:?}");
    assert_eq!(change.machines, [Extent::Untouched, Extent::Untouched]);
    assert_eq!(change.config, same);
}

#[test]
fn a_machine_file_takes_as_much_as_what_has_changed_in_it() {
    let limit = "[[limits.alarm]]\nid = 'v'\nkind = 'velocity_rms'\nwarning_above = 2.0\n";
    let sensor = "[[sensor]]\nchannel = 'y'\nkind = 'accelerometer'\nunit = 'm/s^2'\n\
                  at = { bearing = 'right' }\n";
    for (text, extent, n_restart) in [
        (format!("{MACHINE}{limit}"), Extent::Judged, 0),
        (format!("{MACHINE}[limits]\nvelocity_rms_warning_mm_per_s = 2.0\n"), Extent::Judged, 0),
        (MACHINE.replace("id = 'rig'", "id = 'rig'\nname = 'New'"), Extent::Judged, 0),
        (MACHINE.replace("id = 'rig'", "id = 'rig'\niso_group = '2-rigid'"), Extent::Judged, 0),
        (MACHINE.replace("6205", "6206"), rebuilt(&["bearing"], true), 0),
        (MACHINE.replace("= 10", "= 12"), rebuilt(&["shaft"], true), 0),
        (format!("{MACHINE}axis_deg = 90.0\n"), rebuilt(&["sensor"], true), 0),
        // Samples would be other numbers, or come from elsewhere.
        (MACHINE.replace("m/s^2", "g"), Extent::Untouched, 1),
        (format!("{MACHINE}{sensor}"), Extent::Untouched, 1),
        (MACHINE.replace("'x'", "'y'"), Extent::Untouched, 1),
        (format!("{MACHINE}[capture.map]\nx = '/a'\n"), Extent::Untouched, 1),
        // Taken as a whole, or not at all.
        (MACHINE.replace("m/s^2", "g").replace("6205", "6206"), Extent::Untouched, 1),
    ] {
        let new = with(&text);
        let change = between(&config(), new.clone());
        assert_eq!(change.machines, [extent.clone(), Extent::Untouched], "{text}");
        assert_eq!(change.restart.len(), n_restart, "{text}: {:?}", change.restart);
        assert_eq!(change.applied.is_empty(), extent == Extent::Untouched, "{text}");
        let holds = if n_restart == 0 { new } else { config() };
        assert_eq!(change.config, holds, "{text}");
    }
}

#[test]
fn another_healthy_capture_is_learned_from_and_makes_nothing_stale() {
    let mut new = config();
    new.machines[0].baseline.push(PathBuf::from("healthy.h5"));
    assert_eq!(between(&config(), new).machines[0], rebuilt(&["baseline"], false));
}

/// A change, by what it does to a configuration.
type Step = (&'static str, fn(&mut Config));

#[test]
fn what_needs_a_restart_says_so_and_stays_as_it_was() {
    let steps: [Step; 23] = [
        ("server.bind", |c| c.bind.set_port(9)),
        ("ingest.bind", |c| c.ingest.bind.set_port(9)),
        ("server.token_file", |c| c.access.tokens = Some(tokens("a"))),
        ("server.tls", |c| c.access.tls = Some(tls("a"))),
        ("server.hosts", |c| c.access.hosts.push("a".to_owned())),
        ("server.cors_origins", |c| c.access.cors_origins.push("https://a".to_owned())),
        ("server.max_requests_per_s", |c| c.access.limits.max_requests_per_s = 9.0),
        ("server.max_connections", |c| c.access.limits.max_connections = 9),
        ("server.max_event_streams", |c| c.access.limits.max_event_streams = 9),
        ("--insecure", |c| c.access.exposure = Exposure::Insecure),
        ("ingest.max_connections", |c| c.ingest.max_connections = 9),
        ("store.directory", |c| c.store.directory = PathBuf::from("elsewhere")),
        ("pipeline.workers", |c| c.workers = 9),
        ("pipeline.memory_limit_bytes", |c| c.memory_limit_bytes = 9),
        ("recording.enabled", |c| c.recording = Some(super::super::RECORDING)),
        ("captures.enabled", |c| c.captures = None),
        ("captures.seconds_before", |c| {
            c.captures = c.captures.map(|k| Captures { before_s: 9.0, ..k })
        }),
        ("captures.most_per_hour", |c| {
            c.captures = c.captures.map(|k| Captures { most_per_hour: 9, ..k })
        }),
        ("pipeline.window_seconds", |c| c.monitor.window_s = 9.0),
        ("pipeline.hop_seconds", |c| c.monitor.hop_s = 9.0),
        ("pipeline.ring_seconds", |c| c.monitor.ring_s = 99.0),
        ("pipeline.lengthen_windows", |c| c.lengthen_windows = true),
        ("the source of machine \"rig\"", |c| {
            c.machines[0].source = SourceConfig::Live(Live::default())
        }),
    ];
    for (name, step) in steps {
        let mut new = config();
        step(&mut new);
        assert_ne!(new, config(), "{name}");
        let change = between(&config(), new);
        assert_eq!((change.restart, change.applied), (vec![name.to_owned()], vec![]));
        assert_eq!(change.config, config(), "{name}");
        assert_eq!(change.machines, [Extent::Untouched, Extent::Untouched], "{name}");
    }
}

#[test]
fn what_is_in_effect_at_once_is_named_and_reaches_the_machines_it_concerns() {
    let all = [Extent::Judged, Extent::Judged];
    let none = [Extent::Untouched, Extent::Untouched];
    let steps: [(Step, &[Extent; 2]); 9] = [
        (("alarms.on_delay_s", |c| c.monitor.alarms.on_delay_s = 9.0), &all),
        (("alarms.off_delay_s", |c| c.monitor.alarms.off_delay_s = 9.0), &all),
        (("alarms.history_len", |c| c.monitor.alarms.history_len = 9), &all),
        (("alarms.missing_after_s", |c| c.monitor.alarms.missing_after_s = 9.0), &all),
        (("alarms.max_shelving_s", |c| c.monitor.alarms.max_shelving_s = 9.0), &all),
        (
            ("diagnosis.false_alarms_per_component_year", |c| {
                c.monitor = held_to(c.monitor.clone(), 5.0);
            }),
            &all,
        ),
        (("store.max_bytes", |c| c.store.max_bytes += 1), &none),
        (("store.trend_days", |c| c.store.trends.windows_days += 1), &none),
        (("log.level", |c| c.log = LogLevel::Warn), &none),
    ];
    for ((name, step), machines) in steps {
        let mut new = config();
        step(&mut new);
        let change = between(&config(), new.clone());
        assert_eq!((change.applied, change.restart), (vec![name.to_owned()], vec![]));
        assert_eq!(change.machines, *machines, "{name}");
        // What a verdict is held to follows from the on-delay too, whoever wrote the rest.
        new.monitor = held_to(new.monitor.clone(), new.monitor.false_alarms.a_year.unwrap());
        assert_eq!(change.config, new, "{name}");
    }
}

#[test]
fn tokens_and_certificates_take_the_place_of_others_at_once() {
    let with = |name: &str| {
        let mut config = config();
        config.access.tokens = Some(tokens(name));
        config.access.tls = Some(tls(name));
        config
    };
    let (old, new) = (with("a"), with("b"));
    let change = between(&old, new.clone());
    assert_eq!(change.applied, ["server.token_file", "server.tls.cert_file"]);
    assert_eq!((change.restart.len(), &change.config), (0, &new));
    let mut none_left = old.clone();
    none_left.access.tokens = Some(TokenList::default());
    assert_eq!(between(&old, none_left).applied, ["server.token_file"]);
    // Whether anybody needs one was decided with the address: it stays so until a restart, even if both change at once.
    let mut open = old.clone();
    open.access.tokens = None;
    open.access.tls = None;
    let change = between(&old, open);
    assert_eq!(change.restart, ["server.token_file", "server.tls"]);
    assert_eq!(change.config, old);
    let mut plain_ingest = old.clone();
    plain_ingest.access.tls.as_mut().unwrap().of_ingest = false;
    assert_eq!(between(&old, plain_ingest).restart, ["server.tls.ingest"]);
}

#[test]
fn windows_that_stay_decide_what_a_verdict_is_held_to() {
    let mut new = config();
    new.monitor = held_to(pipeline::Settings { hop_s: 1.0, ..new.monitor }, 5.0);
    let change = between(&config(), new);
    assert_eq!(change.restart, ["pipeline.hop_seconds"]);
    assert_eq!(change.config.monitor, held_to(config().monitor, 5.0));
}

#[test]
fn machines_keep_their_places_until_a_restart() {
    let mut new = config();
    new.machines.remove(0);
    new.machines.push(entry(&MACHINE.replace("'rig'", "'third'")));
    let change = between(&config(), new);
    assert_eq!(change.restart, ["machine \"rig\" is gone", "machine \"third\" is new"]);
    assert_eq!(change.config, config());
    let mut turned = config();
    turned.machines.reverse();
    let change = between(&config(), turned);
    assert_eq!((change.restart.len(), change.config), (0, config()), "the order says nothing");
}
