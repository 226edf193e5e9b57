//! For tests of the API: what is played behind it, a shard thread and a simulated source.

use super::handles::{NotTaken, ScenarioRequest, SimulationHandle};
use super::support::{Behaviour, channel_infos, ring_status, sample};
use super::tests::baselines::sample_measured;
use super::view::{AlarmHistory, End, ShardRequest, Trend, Waveform};
use crate::alarms::{AlarmEngine, Moment};
use crate::dsp::real::floor_index;
use crate::ingest::simulated::{Lag, Status};
use crate::simulator::scenario::{ScenarioError, Wanted};
use crate::simulator::scene::Faults;
use crate::units::Unit;
use std::sync::Arc;
use std::sync::mpsc::Receiver;
use tokio::sync::watch;

/// Index at which the other of two senders stands where the first has 0.
const SECOND_SENDER: u64 = 1_000_000;

/// A simulated source that takes combinations of a bad bearing only.
pub(super) fn sample_simulation(behaviour: Behaviour) -> SimulationHandle {
    let status = Status {
        scene: "GG_GS_GB".to_owned(),
        scenario: Some("GG_GS_GB"),
        possible: vec!["GG_GS_GB", "GG_GS_BB"],
        wanted: Faults::default(),
        present: Faults::default(),
        since_s: 2.0,
        grown_at_s: 2.0,
        simulated_s: 12.0,
        shaft_speed_hz: Some(10.0),
        speed: Some(1.0),
        lag: Lag::default(),
        keeps_pace: true,
        warnings: Vec::new(),
    };
    let (publisher, view) = watch::channel(Arc::new(status.clone()));
    let submit = move |request: ScenarioRequest| {
        // Kept with its owner, so that the snapshot stays readable.
        let _kept = &publisher;
        let ScenarioRequest { wanted, grow_s, turn_hz, reply } = request;
        let answer = match wanted {
            _ if behaviour == Behaviour::Full => return Err(NotTaken::Busy),
            _ if behaviour == Behaviour::Silent => return Err(NotTaken::Ended),
            None => Ok(Arc::new(Status { shaft_speed_hz: turn_hz, ..status.clone() })),
            Some(Wanted::Combination(name)) if name == "GG_GS_BB" => {
                let grown_at_s = 12.0 + grow_s;
                let scenario = Some("GG_GS_BB");
                Ok(Arc::new(Status { scenario, since_s: 12.0, grown_at_s, ..status.clone() }))
            }
            Some(Wanted::Combination(_) | Wanted::Faults(_)) => {
                Err(ScenarioError::Refused("not this one".to_owned()))
            }
        };
        let _ = reply.send(answer);
        Ok(())
    };
    SimulationHandle { view, submit: Arc::new(submit) }
}

/// Answers requests until all senders are gone.
pub(super) fn shard(inbox: &Receiver<ShardRequest>, mut engine: AlarmEngine, behaviour: Behaviour) {
    let mut kept = Vec::new();
    for request in inbox {
        if behaviour == Behaviour::Silent {
            kept.push(request);
            continue;
        }
        // A client that no longer waits is no fault.
        match request {
            ShardRequest::Waveform { channel, end, max_samples, reply } => {
                let _ = reply.send(held(channel, end, max_samples, behaviour));
            }
            ShardRequest::Trend { reply, .. } => {
                let _ = reply.send(sample_trend());
            }
            ShardRequest::Verdicts { component, reply, .. } => {
                let newest =
                    if component == "right" { sample_verdicts() } else { Trend::default() };
                let _ = reply.send(newest);
            }
            ShardRequest::Act { act, reply } => {
                let done = engine.act(&act, Moment::of_stream(12.0));
                let _ = reply.send(done.map(|(alarm, _)| alarm).map_err(Into::into));
            }
            ShardRequest::Announce { wanted, reply } => {
                let done = engine.announce(&wanted, Moment::of_stream(12.0));
                let _ = reply.send(done.map(|(said, _)| said).map_err(Into::into));
            }
            ShardRequest::Revoke { number, by: (author, comment), reply } => {
                let now = Moment::of_stream(12.0);
                let done = engine.revoke(number, (&author, &comment), now);
                let _ = reply.send(done.map(|(ended, _)| ended).map_err(Into::into));
            }
            ShardRequest::AlarmHistory { reply } => {
                let events = engine.history().iter().cloned().collect();
                let _ = reply.send(AlarmHistory { events, dropped: engine.history_dropped() });
            }
            ShardRequest::Capture { reply, .. } => {
                let _ = reply.send(Ok("rig-1-00000007".to_owned()));
            }
            ShardRequest::Measure { span, reply } => {
                let _ = reply.send(sample_measured(span));
            }
            ShardRequest::UseBaselines { reply, .. } => {
                let _ = reply.send(());
            }
        }
    }
}

fn held(channel: usize, end: End, max_samples: usize, behaviour: Behaviour) -> Option<Waveform> {
    let info = &channel_infos()[channel];
    let ring = ring_status(info);
    // What the channel's sender counts from.
    let first = if channel == 1 && behaviour == Behaviour::TwoSenders { SECOND_SENDER } else { 0 };
    let end = match end {
        End::Newest => u64::MAX,
        End::Before(end) => end.saturating_sub(first),
        End::At(time_s) => floor_index((time_s * info.sample_rate.0 - 1e-3).ceil()) as u64,
    };
    // The other sender is behind by some samples.
    let end = end.min(ring.newest.0 - if first > 0 { 100 } else { 0 });
    let start = end.saturating_sub(max_samples as u64).max(ring.oldest.0);
    (start < end).then(|| Waveform {
        start: start + first,
        start_time_s: start as f64 / info.sample_rate.0,
        samples: (start..end).map(|i| sample(channel, i)).collect(),
    })
}

fn sample_verdicts() -> Trend {
    let columns = [("state", 3.0), ("severity", 0.62), ("confidence", 0.97)];
    Trend {
        time_s: vec![2.5, 5.0],
        columns: columns.map(|(name, x)| (name.to_owned(), Unit::One, vec![x; 2])).into(),
        n_samples: Vec::new(),
    }
}

fn sample_trend() -> Trend {
    let n = 1000;
    let column = |value: fn(usize) -> f64| (0..n).map(value).collect::<Vec<f64>>();
    Trend {
        time_s: column(|i| 10.0 + i as f64),
        columns: vec![
            ("rms".to_owned(), Unit::MetrePerSecondSquared, column(|i| i as f64)),
            (
                "kurtosis".to_owned(),
                Unit::One,
                column(|i| if i == 777 { f64::INFINITY } else { 3.0 }),
            ),
        ],
        n_samples: vec![40_960; n],
    }
}
