//! Both ends of every number of the configuration: the daemon works with it, or refuses it with a reason.

#![expect(clippy::print_stdout, reason = "an ignored test says what it saw")]

use crate::support;
use crate::support::Daemon;
use crate::support::Ended;
use rotorwatch::config::keys::KEYS;
use rotorwatch::config::keys::Key;
use rotorwatch::config::keys::Kind;
use std::ops::ControlFlow;

/// Samples of the capture, at 1 kHz.
const N_SAMPLES: u32 = 30_000;

/// Starts a daemon that replays half a minute with one key changed by its variable.
fn start(key: &Key, value: &str) -> Result<Daemon, Ended> {
    // Captures are taken and recordings made, so that their keys matter.
    let config = "[server]\nbind = \"127.0.0.1:0\"\n[pipeline]\nring_seconds = 15\n[recording]\nenabled = true\n\
        [[machine]]\nfile = \"rig.toml\"\n[[source]]\nmachine = \"rig-1\"\nkind = \"replay\"\nfile = \"x.h5\"\nspeed = \"max\"\n";
    let limit = "[[limits.alarm]]\nid = \"level\"\nkind = \"feature\"\nfeature = \"rms\"\nwarning_above = 0.001\n";
    let machine = format!("{}{limit}", support::MACHINE);
    let dir = support::folder(config, &[("rig.toml", machine.as_bytes())]);
    support::write_ramp(&dir, "x.h5", 1000.0, N_SAMPLES);
    let variable = key.variable().unwrap();
    Daemon::try_with(dir, |command| {
        command.env(variable, value);
    })
}

/// Whether the daemon worked; `Break`: it said why it does not.
fn tried(key: &Key, value: &str) -> ControlFlow<String> {
    let name = format!("{}.{} = {value}", key.section, key.name);
    let daemon = match start(key, value) {
        Ok(daemon) => daemon,
        Err(ended) => {
            assert_eq!(ended.status.code(), Some(2), "{name}: {}", ended.stderr);
            // By its name, or by what it would be: "a window of 600 s needs more of pipeline.ring_seconds".
            let words = [key.name, &key.variable().unwrap(), value.trim_end_matches(".0")];
            let names_it = words.iter().any(|word| ended.stderr.contains(word));
            assert!(names_it, "{name} is refused without a reason that names it: {}", ended.stderr);
            assert!(!ended.stderr.contains("panicked"), "{name}: {}", ended.stderr);
            return ControlFlow::Break(ended.stderr);
        }
    };
    daemon.wait_finished("rig-1");
    let (status, health) = daemon.get_json("/api/v1/machines/rig-1/health");
    assert_eq!(status, 200, "{name}: {health}");
    let samples = "rotorwatch_samples_received_total{machine=\"rig-1\",channel=\"right_x\"}";
    let n = daemon.metric(samples);
    assert!(n.is_some_and(|n| (n - f64::from(N_SAMPLES)).abs() < 0.5), "{name}: {n:?} samples");
    let ended = daemon.terminate();
    assert!(ended.status.success(), "{name}: {:?} {}", ended.status, ended.stderr);
    assert!(!ended.stderr.contains("panicked"), "{name}: {}", ended.stderr);
    ControlFlow::Continue(())
}

#[test]
#[ignore = "starts a daemon a hundred times: some minutes; run by .ci/run"]
fn both_ends_of_every_number_of_the_configuration_work_or_are_refused_with_a_reason() {
    let (mut n_work, mut refused) = (0, Vec::new());
    for key in KEYS.iter().filter(|key| key.variable().is_some()) {
        let (inside, outside) = match key.kind {
            Kind::Whole(low, high) => {
                let beyond = (i128::from(low) - 1, i128::from(high) + 1);
                ([low.to_string(), high.to_string()], [beyond.0.to_string(), beyond.1.to_string()])
            }
            Kind::Number(low, high) => {
                let beyond = (low - 1e-3 * low.abs().max(1e-9), high * 1.001);
                (
                    [format!("{low:?}"), format!("{high:?}")],
                    [beyond.0, beyond.1].map(|x| format!("{x:?}")),
                )
            }
            Kind::Text | Kind::Texts | Kind::Flag | Kind::Speed => continue,
        };
        for value in inside {
            match tried(key, &value) {
                ControlFlow::Continue(()) => n_work += 1,
                ControlFlow::Break(why) => refused.push(format!("{} = {value}: {why}", key.name)),
            }
        }
        for value in outside {
            assert!(tried(key, &value).is_break(), "{} = {value} is accepted", key.name);
        }
    }
    println!("{n_work} ends work, {} are refused:\n{}", refused.len(), refused.join("\n"));
    assert!(n_work > 40, "{n_work}");
}
