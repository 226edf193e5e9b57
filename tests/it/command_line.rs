//! What the program prints and how it ends without a daemon.

use crate::support;

#[test]
fn a_bad_configuration_ends_with_2_and_every_mistake() {
    let config = "[server]\nbind = \"0.0.0.0:80\"\nport = 1\n[pipeline]\nworkers = \"all\"\n";
    let ended = support::refused(config, &[]);
    assert_eq!(ended.status.code(), Some(2));
    assert_eq!(ended.stdout, "");
    for mistake in [
        "serve.toml:2:1: server.bind: 0.0.0.0:80 can be reached from other hosts",
        "serve.toml:3:1: server.port: unknown key",
        "serve.toml:5:1: pipeline.workers: \"all\" is not a whole number",
    ] {
        assert!(ended.stderr.contains(mistake), "{mistake}\nnot in\n{}", ended.stderr);
    }
    assert!(!ended.stderr.contains("panicked"), "{}", ended.stderr);
}

#[test]
fn a_baseline_that_cannot_be_read_ends_with_2() {
    let config = "[server]\nbind = \"127.0.0.1:0\"\n[[machine]]\nfile = \"rig.toml\"\n\
                  baseline = [\"healthy.h5\"]\n[[source]]\nkind = \"replay\"\n\
                  machine = \"rig-1\"\nfile = \"x.h5\"\n";
    let files: [(&str, &[u8]); 3] = [
        ("rig.toml", support::MACHINE.as_bytes()),
        ("healthy.h5", b"not a capture"),
        ("x.h5", b"not a capture"),
    ];
    let dir = support::folder(config, &files);
    support::write_ramp(&dir, "x.h5", 2000.0, 4000);
    let ended = support::refused_in(&dir);
    assert_eq!(ended.status.code(), Some(2), "{}", ended.stderr);
    assert_eq!(ended.stdout, "");
    assert!(ended.stderr.contains("healthy.h5"), "{}", ended.stderr);
}

#[test]
fn a_taken_port_ends_with_2() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap();
    let ended = support::refused(&format!("[server]\nbind = \"{address}\"\n"), &[]);
    assert_eq!(ended.status.code(), Some(2));
    assert_eq!(ended.stdout, "");
    assert!(ended.stderr.contains(&address.to_string()), "{}", ended.stderr);
}

#[test]
fn the_reference_is_printed_as_it_is() {
    let ended = support::run(support::command().args(["serve", "--print-config"]));
    assert!(ended.status.success());
    assert_eq!(ended.stdout, include_str!("../../config/default.toml"));
}

#[test]
fn help_shows_examples() {
    let ended = support::run(support::command().arg("--help"));
    assert!(ended.status.success());
    assert!(ended.stdout.contains("Examples:"), "{}", ended.stdout);
}
