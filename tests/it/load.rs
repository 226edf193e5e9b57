//! How much a daemon answers while it watches, and what idle readers cost: figures for docs/performance.md.

#![expect(clippy::print_stdout, reason = "a test that skips itself says so, and figures are told")]

use crate::support;
use crate::support::Daemon;
use std::fs;
use std::io::Read;
use std::io::Write;
use std::net::TcpStream;

/// Readers that do nothing but listen.
const N_READERS: usize = 1000;

/// Resident bytes of a process.
fn resident(pid: u32) -> u64 {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
    line.trim().trim_end_matches(" kB").parse::<u64>().unwrap() * 1024
}

#[test]
#[ignore = "opens 1000 connections, which takes seconds and 2000 file descriptors; run by .ci/run"]
fn a_thousand_idle_readers_of_events_take_less_than_50_mb() {
    let config = "[server]\nbind = \"127.0.0.1:0\"\nmax_connections = 1100\nmax_event_streams = 1000\n\
                  [[machine]]\nfile = \"rig.toml\"\n[[source]]\nkind = \"replay\"\nmachine = \"rig-1\"\nfile = \"x.h5\"\n";
    let dir = support::folder(config, &[("rig.toml", support::MACHINE.as_bytes())]);
    support::write_ramp(&dir, "x.h5", 1000.0, 30_000);
    let daemon = Daemon::start_in(dir);
    daemon.wait_finished("rig-1");
    let address = daemon.base_url.strip_prefix("http://").unwrap().to_owned();
    let open = || {
        let mut stream = TcpStream::connect(&address).unwrap();
        write!(stream, "GET /api/v1/events HTTP/1.1\r\nhost: {address}\r\n\r\n").unwrap();
        // Its first event has come: the stream is open as a whole.
        let mut found = String::new();
        let mut buffer = [0; 2048];
        while !found.contains("event: begin") {
            let n = stream.read(&mut buffer).unwrap();
            assert!(n > 0, "{found}");
            found += std::str::from_utf8(&buffer[..n]).unwrap();
        }
        stream
    };
    let first = open();
    let before = resident(daemon.child.id());
    let readers: Vec<TcpStream> = (1..N_READERS).map(|_| open()).collect();
    let more = resident(daemon.child.id()).saturating_sub(before);
    println!(
        "{N_READERS} idle readers of events: {:.1} MB, {} bytes each",
        more as f64 / 1e6,
        more / N_READERS as u64
    );
    assert!(more < 50_000_000, "{more}");
    assert_eq!(daemon.metric("rotorwatch_event_streams"), Some(1000.0));
    // One more is told so, and those who go make room.
    assert_eq!(daemon.get_json("/api/v1/events").0, 503);
    assert_eq!(daemon.metric("rotorwatch_event_streams_refused_total"), Some(1.0));
    drop((first, readers));
    support::wait_until("room", || {
        (daemon.metric("rotorwatch_event_streams")? == 0.0).then_some(())
    });
}
