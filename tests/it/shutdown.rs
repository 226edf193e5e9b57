//! However the daemon is busy, a signal ends it with code 0.

use crate::support;
use crate::support::Daemon;
use std::io::Read;
use std::io::Write;
use std::net::TcpStream;
use std::os::unix::net::UnixDatagram;
use std::time::Duration;

const BROKEN_SOURCE: &str = r#"
[[machine]]
file = "rig.toml"
[[source]]
kind = "replay"
machine = "rig-1"
file = "broken.h5"
"#;

#[test]
fn a_failed_source_does_not_end_the_daemon() {
    let files: [(&str, &[u8]); 2] =
        [("rig.toml", support::MACHINE.as_bytes()), ("broken.h5", b"not a capture")];
    let daemon = Daemon::start(BROKEN_SOURCE, &files);
    assert!(daemon.base_url.starts_with("http://127.0.0.1:"), "{}", daemon.base_url);
    assert_eq!(daemon.get_text("/livez").0, 200);
    let (status, metrics) = daemon.get_text("/metrics");
    assert_eq!(status, 200);
    assert!(metrics.contains("rotorwatch_build_info"), "{metrics}");
    let ended = daemon.terminate();
    assert_eq!(ended.status.code(), Some(0), "{}", ended.stderr);
    assert!(ended.stderr.contains("source failed"), "{}", ended.stderr);
    assert!(ended.stderr.contains("broken.h5"), "{}", ended.stderr);
}

#[test]
fn the_service_manager_is_told_of_the_start_the_life_and_the_end() {
    let sockets = tempfile::tempdir().unwrap();
    let path = sockets.path().join("notify");
    let socket = UnixDatagram::bind(&path).unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    let told = || {
        let mut buffer = [0; 1024];
        let n = socket.recv(&mut buffer).unwrap();
        String::from_utf8(buffer[..n].to_vec()).unwrap()
    };
    let dir = support::folder("[server]\nbind = \"127.0.0.1:0\"\n", &[]);
    let daemon = Daemon::start_with(dir, |command| {
        command.env("NOTIFY_SOCKET", &path).env("WATCHDOG_USEC", "150000");
    });
    // It may have said that it lives before it was ready.
    let first = std::iter::repeat_with(told).find(|text| !text.starts_with("WATCHDOG")).unwrap();
    assert_eq!(first, format!("READY=1\nSTATUS=listening on {}\n", daemon.base_url));
    assert_eq!(told(), "WATCHDOG=1\n");
    daemon.signal("TERM");
    let last = std::iter::repeat_with(told).find(|text| !text.starts_with("WATCHDOG")).unwrap();
    assert_eq!(last, "STOPPING=1\n");
    assert_eq!(daemon.wait().status.code(), Some(0));
}

#[test]
fn sigint_ends_it_too() {
    let daemon = Daemon::start("", &[]);
    daemon.signal("INT");
    assert_eq!(daemon.wait().status.code(), Some(0));
}

#[test]
fn an_open_connection_does_not_hold_the_end_up() {
    let daemon = Daemon::start("", &[]);
    let address = daemon.base_url.strip_prefix("http://").unwrap();
    let mut half_a_request = TcpStream::connect(address).unwrap();
    let request = format!("GET /livez HTTP/1.1\r\nHost: {address}\r\n");
    half_a_request.write_all(request.as_bytes()).unwrap();
    let mut kept_alive = TcpStream::connect(address).unwrap();
    kept_alive.write_all(format!("{request}\r\n").as_bytes()).unwrap();
    let mut answer = [0; 15];
    kept_alive.read_exact(&mut answer).unwrap();
    assert_eq!(&answer, b"HTTP/1.1 200 OK");
    assert_eq!(daemon.terminate().status.code(), Some(0));
}
