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

#[test]
fn out_replaces_no_file_that_a_command_reads_and_nothing_in_the_store() {
    let config = "[server]\nbind = \"127.0.0.1:0\"\n[[machine]]\nfile = \"rig.toml\"\n\
                  [[source]]\nkind = \"replay\"\nmachine = \"rig-1\"\nfile = \"x.h5\"\n";
    let dir = support::folder(config, &[("rig.toml", support::MACHINE.as_bytes())]);
    support::write_ramp(&dir, "x.h5", 2000.0, 4000);
    let at = |name: &str| dir.path().join(name);
    std::fs::create_dir(at("data")).unwrap();
    std::fs::write(at("data/state.db"), "a database").unwrap();
    std::os::unix::fs::symlink(at("data/state.db"), at("link.csv")).unwrap();
    std::fs::write(at("scene.toml"), include_str!("../../config/scenes/seed-bow-2hz.toml"))
        .unwrap();
    let read = ["serve.toml", "rig.toml", "x.h5", "data/state.db", "scene.toml"];
    let contents = || read.map(|name| std::fs::read(at(name)).unwrap());
    let before = contents();
    let refused = |arguments: &[&str], out: &str, why: &str| {
        let mut command = support::command();
        command.current_dir(dir.path()).args(arguments).args(["--out", out]);
        let ended = support::run(&mut command);
        assert_eq!(ended.status.code(), Some(2), "{arguments:?} {out}: {}", ended.stderr);
        assert!(ended.stderr.contains(why), "{arguments:?} {out}: {}", ended.stderr);
    };
    let (is_read, in_store) =
        ("--out would replace a file that is read", "--out is inside the store's folder");
    let export = ["export", "--config", "serve.toml", "--machine", "rig-1", "--format"];
    for more in [&["csv"][..], &["hdf5"], &["csv", "--alarms"], &["csv", "--feedback"]] {
        let export = [&export[..], more].concat();
        for out in ["serve.toml", "./rig.toml", "data/../x.h5"] {
            refused(&export, out, is_read);
        }
        for out in ["data/state.db", "link.csv", "data/new.csv"] {
            refused(&export, out, in_store);
        }
    }
    let rerun = ["replay-alarms", "--config", "serve.toml", "--with", "rig.toml"];
    refused(&rerun, "rig.toml", is_read);
    refused(&rerun, "data/state.db", in_store);
    refused(&["backup", "--config", "serve.toml"], "data/backup.tar.gz", in_store);
    refused(&["support-bundle", "--config", "serve.toml"], "data/support.tar.gz", in_store);
    let token = ["token", "create", "--label", "x", "--role", "viewer"];
    refused(&[&token[..], &["--file", "t1.toml"]].concat(), "./t1.toml", is_read);
    assert!(!at("t1.toml").exists(), "neither the list nor the secret");
    refused(&["simulate", "scene.toml"], "./scene.toml", is_read);
    assert!(contents() == before, "a file was changed");
}
