//! Several machines in one daemon: what ails one does not harm the other.

use crate::scene;
use crate::support;
use crate::support::Daemon;

const CONFIG: &str = r#"
[server]
bind = "127.0.0.1:0"
[[machine]]
file = "rig.toml"
[[source]]
kind = "replay"
machine = "rig-1"
file = "x.h5"
[[machine]]
file = "broken.toml"
[[source]]
kind = "replay"
machine = "rig-2"
file = "broken.h5"
"#;

#[test]
fn a_broken_capture_fails_its_own_machine_only() {
    let second = scene::MACHINE.replace("rig-1", "rig-2");
    let files: [(&str, &[u8]); 2] =
        [("rig.toml", scene::MACHINE.as_bytes()), ("broken.toml", second.as_bytes())];
    let dir = support::folder(CONFIG, &files);
    let (good, broken) = (dir.path().join("x.h5"), dir.path().join("broken.h5"));
    scene::write(&good, &scene::samples(4), None);
    // Half of a capture: it opens as HDF5 or not, but never gives all its samples.
    let bytes = std::fs::read(&good).unwrap();
    std::fs::write(&broken, &bytes[..bytes.len() / 2]).unwrap();

    let daemon = Daemon::start_in(dir);
    daemon.wait_finished("rig-1");
    support::wait_until("the failure of the second machine", || {
        (daemon.source_of("rig-2") == "failed").then_some(())
    });
    let (status, health) = daemon.get_json("/api/v1/machines/rig-1/health");
    assert_eq!((status, &health["state"]), (200, &"damaged".into()), "{health:#}");
    let (status, health) = daemon.get_json("/api/v1/machines/rig-2/health");
    assert_eq!((status, &health["state"]), (200, &"undetermined".into()), "{health:#}");
    let reason = health["data"]["reason"].as_str().unwrap();
    assert!(reason.contains("broken.h5"), "{reason}");
    let (status, not_ready) = daemon.get_text("/readyz");
    assert!(status == 503 && not_ready.contains("rig-2"), "{status} {not_ready}");
    assert!(!not_ready.contains("rig-1"), "{not_ready}");
    assert_eq!(daemon.terminate().status.code(), Some(0));
}
