//! For tests of the API: a sample diagnosis, a machine, a small shard thread with known signals.

use super::handles::{
    BaselineHandle, CaptureHandle, EventsHandle, MachineHandle, StoreHandle, TrendHandle,
};
use super::played::{sample_simulation, shard};
use super::router;
use super::state::{ApiState, Settings};
use super::view::{MachineView, ShardBusy, SourceState};
use crate::alarms::load;
use crate::alarms::{self, AlarmEngine};
use crate::buffer::RingStatus;
use crate::diagnosis::fault::{ComponentKind, Detector, FaultMode, State};
use crate::diagnosis::verdict::{
    BaselineUse, ComponentDiagnosis, Coverage, DataQuality, Diagnosis, Evidence, GearFinding,
    OperatingState, OtherFault, Timeline,
};
use crate::features::speed::SpeedSource;
use crate::features::{ChannelFeatures, Feature};
use crate::machine::file;
use crate::signal::{ChannelIndex, ChannelInfo, SampleIndex, Timestamp};
use crate::units::{Hz, Unit};
use axum::Router;
use axum::body::{Body, Bytes, to_bytes};
use axum::http::{HeaderMap, Request, StatusCode, header};
use axum::response::Response;
use serde_json::Value;
use std::f64::consts::TAU;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::sync_channel;
use tokio::sync::watch;
use tower::ServiceExt;

/// First sample the shard holds.
pub(crate) const HELD_FROM: u64 = 1000;
/// Samples a second of all channels but the probe.
pub(crate) const FS_HZ: f64 = 4096.0;
/// Length of what is held, s.
pub(crate) const HELD_S: u32 = 8;
/// Address the tests' service believes to be bound to.
pub(crate) const HOST: &str = "127.0.0.1:8080";

const MACHINE: &str = r#"
[machine]
id = "rig-1"
name = "Test rig"
[[shaft]]
id = "motor"
speed_hz = 10.0
[[shaft]]
id = "main"
[[bearing]]
id = "right"
shaft = "main"
elements = 11
element_diameter_mm = 7.9375
pitch_diameter_mm = 33.5
[[gear]]
id = "mesh-1"
driving = { shaft = "motor", teeth = 28 }
driven = { shaft = "main", teeth = 28 }
[[sensor]]
channel = "right_x"
kind = "accelerometer"
unit = "m/s^2"
at = { bearing = "right" }
axis_deg = 0.0
[[sensor]]
channel = "right_y"
kind = "accelerometer"
unit = "m/s^2"
at = { bearing = "right" }
axis_deg = 90.0
"#;

/// Compares `text` with the committed file at `path`; `UPDATE_GOLDEN=1` writes it instead.
pub(crate) fn golden(path: &str, text: &str) {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
        return;
    }
    let committed = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(committed == text, "{} is not current: run with UPDATE_GOLDEN=1", path.display());
}

/// A diagnosis with every part filled.
pub(crate) fn sample_diagnosis() -> Diagnosis {
    let component = |id: &str, kind, state, fault| ComponentDiagnosis {
        id: id.to_owned(),
        kind,
        state,
        fault,
        severity: (state != State::Undetermined).then_some(0.62),
        confidence: (state != State::Undetermined).then_some(0.97),
        why: format!("{id} is {}", state.name()),
        evidence: Vec::new(),
        other_faults: Vec::new(),
        gear: None,
    };
    let mut right =
        component("right", ComponentKind::Bearing, State::Damaged, Some(FaultMode::InnerRace));
    right.evidence = vec![Evidence {
        indicator: "absolute_vibration_bpfi".to_owned(),
        channel: "right_x+right_y".to_owned(),
        detector: Some(Detector::ZeroToPeak),
        frequency: Some(Hz(68.0)),
        expected: Some(Hz(68.1)),
        order: Some(6.8),
        value: 0.31,
        unit: Unit::MetrePerSecondSquared,
        threshold: Some(0.04),
        false_alarm_probability: Some(1e-6),
        sample_range: Some((0, 120_000)),
    }];
    right.other_faults = vec![OtherFault {
        fault: FaultMode::Cage,
        state: State::Warning,
        severity: 0.3,
        confidence: 0.6,
        why: "FTF stands over the floor".to_owned(),
        evidence: Vec::new(),
    }];
    let main = component("main", ComponentKind::Shaft, State::Undetermined, None);
    let mut mesh = component("mesh-1", ComponentKind::Gear, State::Healthy, None);
    mesh.gear = Some(GearFinding { angle_deg: Some(123.0), ..GearFinding::default() });
    Diagnosis {
        machine: "rig-1".to_owned(),
        duration_s: 10.0,
        samples_used: 240_000,
        samples_rejected: 3,
        rejected_because: vec!["3 samples were not finite".to_owned()],
        shaft_speed: Some(Hz(10.0)),
        shaft_speeds: vec![("main".to_owned(), Hz(10.0))],
        speed_source: Some(SpeedSource::Estimated),
        speed_confidence: 0.9,
        operating_state: OperatingState::Running,
        state: State::Damaged,
        coverage: Coverage { judged: 2, undetermined: vec!["main".to_owned()] },
        data_quality: DataQuality::Ok,
        components: vec![right, main, mesh],
        warnings: vec!["the speeds of file and capture differ by 3 %".to_owned()],
        notes: vec!["guessed: separator ';', decimal comma".to_owned()],
        baselines: vec![BaselineUse {
            name: "healthy.h5".to_owned(),
            used: true,
            reason: "speed within 5 %".to_owned(),
            id: Some("343e1662793c64bf6f0d3597ba446f18".into()),
            n_windows: 60,
        }],
        provisional_baseline: None,
        timeline: Some(Timeline {
            time_s: vec![0.0, 10.0],
            state: vec![State::Healthy, State::Damaged],
            component: vec![None, Some("right".to_owned())],
            severity: vec![None, Some(0.62)],
        }),
        first_warning_s: Some(10.0),
        first_damaged_s: Some(10.0),
        sample_ranges: vec![("right_x".to_owned(), 0, 120_000)],
    }
}

/// How the shard thread behaves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Behaviour {
    /// Answers.
    Answers,
    /// Takes requests and keeps the replies.
    Silent,
    /// Takes no request.
    Full,
    /// Answers; the second channel comes from another sender, that counts from elsewhere.
    TwoSenders,
}

/// Length of the page `/large`, bytes: two find room among the answers that wait, a third does not.
pub(crate) const LARGE: usize = 30 << 20;

/// A service over one machine with known signals, to which tests send requests.
pub(crate) struct Service {
    router: Router,
    /// Publishes snapshots.
    pub(crate) view: watch::Sender<Arc<MachineView>>,
    /// What the handlers share.
    pub(crate) state: ApiState,
}

/// An answer.
#[derive(Debug)]
pub(crate) struct Answer {
    pub(crate) status: StatusCode,
    pub(crate) headers: HeaderMap,
    pub(crate) body: Bytes,
}

impl Answer {
    /// The body as JSON.
    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body)
            .unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(&self.body)))
    }

    /// A header as text.
    pub(crate) fn header(&self, name: &str) -> &str {
        self.headers.get(name).map_or("", |value| value.to_str().unwrap())
    }

    /// The detail of a problem with this status.
    pub(crate) fn problem(&self, status: u16) -> String {
        assert_eq!(self.status.as_u16(), status, "{}", String::from_utf8_lossy(&self.body));
        assert_eq!(self.header("content-type"), "application/problem+json");
        let json = self.json();
        assert_eq!(json["status"], status);
        assert!(json["type"].as_str().unwrap().starts_with("urn:rotorwatch:problem:"));
        for key in ["title", "instance"] {
            assert!(!json[key].as_str().unwrap().is_empty(), "{key}");
        }
        json["detail"].as_str().unwrap().to_owned()
    }
}

impl Service {
    pub(crate) fn new() -> Self {
        Self::with(Behaviour::Answers, |_| {})
    }

    pub(crate) fn with(behaviour: Behaviour, change: impl FnOnce(&mut Settings)) -> Self {
        let mut engine = AlarmEngine::new("rig-1", alarms::Settings::default());
        engine.observe(&sample_diagnosis(), 10.0);
        Self::over(engine, behaviour, change)
    }

    /// A service over a machine with these alarms.
    pub(crate) fn over(
        engine: AlarmEngine,
        behaviour: Behaviour,
        change: impl FnOnce(&mut Settings),
    ) -> Self {
        let (view, receiver) = watch::channel(Arc::new(sample_view(&engine)));
        let (requests, inbox) = sync_channel(16);
        std::thread::spawn(move || shard(&inbox, engine, behaviour));
        let submit = move |request| {
            if behaviour == Behaviour::Full {
                return Err(ShardBusy);
            }
            requests.try_send(request).map_err(|_| ShardBusy)
        };
        let handle = MachineHandle {
            recording: None,
            simulation: Some(sample_simulation(behaviour)),
            ingest: None,
            id: "rig-1".to_owned(),
            view: receiver,
            submit: Arc::new(submit),
        };
        let mut settings = Settings::new(HOST.parse().unwrap());
        change(&mut settings);
        let state = ApiState::new(
            vec![handle],
            settings,
            Arc::new(|| "# EOF\n".to_owned()),
            Arc::new(Vec::new),
        );
        Self::of_state(state, view)
    }

    /// The same service behind a door.
    pub(crate) fn with_door(self, door: Arc<crate::access::Door>) -> Self {
        Self::of_state(self.state.with_door(door), self.view)
    }

    /// The same service with a store.
    pub(crate) fn with_store(self, store: StoreHandle) -> Self {
        Self::of_state(self.state.with_store(store), self.view)
    }

    /// The same service with a store of baselines.
    pub(crate) fn with_baselines(self, baselines: BaselineHandle) -> Self {
        Self::of_state(self.state.with_baselines(baselines), self.view)
    }

    /// The same service with a store of what people found.
    pub(crate) fn with_feedback(self, feedback: super::handles::FeedbackHandle) -> Self {
        Self::of_state(self.state.with_feedback(feedback), self.view)
    }

    /// The same service with a log of events.
    pub(crate) fn with_events(self, events: EventsHandle) -> Self {
        Self::of_state(self.state.with_events(events), self.view)
    }

    /// The same service with captures.
    pub(crate) fn with_captures(self, captures: CaptureHandle) -> Self {
        Self::of_state(self.state.with_captures(Some(captures)), self.view)
    }

    /// The same service with a folder of recordings.
    pub(crate) fn with_recordings(self, root: PathBuf) -> Self {
        Self::of_state(self.state.with_recordings(root), self.view)
    }

    /// The same service with stored trends.
    pub(crate) fn with_trends(self, trends: TrendHandle) -> Self {
        Self::of_state(self.state.with_trends(trends), self.view)
    }

    /// The service after its state was changed.
    pub(crate) fn renewed(self) -> Self {
        Self::of_state(self.state, self.view)
    }

    fn of_state(state: ApiState, view: watch::Sender<Arc<MachineView>>) -> Self {
        let pages = Router::new()
            .route("/", axum::routing::get(async || "a page"))
            .route("/panics", axum::routing::get(panics))
            .route("/large", axum::routing::get(async || "x".repeat(LARGE)))
            .route("/hangs", axum::routing::get(std::future::pending::<String>));
        Self { router: router(state.clone(), pages), view, state }
    }

    /// Sends a GET.
    pub(crate) async fn get(&self, path: &str) -> Answer {
        self.send(Request::get(path)).await
    }

    /// Sends a request without body; the host is set if it is not yet.
    pub(crate) async fn send(&self, request: axum::http::request::Builder) -> Answer {
        self.send_body(request, Body::empty()).await
    }

    /// Posts JSON.
    pub(crate) async fn post(&self, path: &str, body: impl Into<Body>) -> Answer {
        let request = Request::post(path).header(header::CONTENT_TYPE, "application/json");
        self.send_body(request, body.into()).await
    }

    /// Sends a request.
    pub(crate) async fn send_body(
        &self,
        request: axum::http::request::Builder,
        body: Body,
    ) -> Answer {
        let (parts, body) = self.begin(request, body).await.into_parts();
        let body = to_bytes(body, usize::MAX).await.unwrap();
        Answer { status: parts.status, headers: parts.headers, body }
    }

    /// Sends a request and reads nothing of the answer's body.
    pub(crate) async fn begin(
        &self,
        mut request: axum::http::request::Builder,
        body: Body,
    ) -> Response {
        if !request.headers_ref().unwrap().contains_key(header::HOST) {
            request = request.header(header::HOST, HOST);
        }
        self.router.clone().oneshot(request.body(body).unwrap()).await.unwrap()
    }
}

async fn panics() -> String {
    panic!("a handler's own fault")
}

/// Sample `i` (counted from the start of the stream) of a channel.
pub(crate) fn sample(channel: usize, i: u64) -> f32 {
    let info = &channel_infos()[channel];
    let t = i as f64 / info.sample_rate.0;
    let value = match channel {
        // Amplitude 2 at 64 Hz.
        0 => 2.0 * (TAU * 64.0 * t).sin(),
        // 1024 Hz, amplitude modulated by half at 32 Hz.
        1 => (1.0 + 0.5 * (TAU * 32.0 * t).cos()) * (TAU * 1024.0 * t).cos(),
        // A full-scale square wave.
        2 => (TAU * 16.0 * t).sin().signum(),
        _ => 0.0,
    };
    #[expect(clippy::cast_possible_truncation, reason = "samples are f32")]
    let sample = value as f32;
    sample
}

pub(super) fn channel_infos() -> Vec<ChannelInfo> {
    let info = |name: &str, sample_rate, unit, full_scale| ChannelInfo {
        name: name.to_owned(),
        sample_rate: Hz(sample_rate),
        unit,
        offset: 0.0,
        unit_conflict: None,
        full_scale,
    };
    vec![
        info("right_x", FS_HZ, Unit::MetrePerSecondSquared, None),
        info("right_y", FS_HZ, Unit::MetrePerSecondSquared, None),
        info("probe", 2048.0, Unit::Micrometre, Some((-1.0, 1.0))),
        info("zero", FS_HZ, Unit::MetrePerSecondSquared, None),
    ]
}

pub(super) fn ring_status(info: &ChannelInfo) -> RingStatus {
    let n_probe = u64::from(2048 * HELD_S);
    let n = if info.name == "probe" { n_probe } else { 2 * n_probe };
    RingStatus {
        oldest: SampleIndex(HELD_FROM),
        newest: SampleIndex(HELD_FROM + n),
        newest_time_s: (HELD_FROM + n) as f64 / info.sample_rate.0,
        received: n,
        missing: HELD_FROM,
        gaps: 1,
        duplicated: 0,
        clipped: 0,
    }
}

/// The snapshot after one verdict.
pub(crate) fn sample_view(engine: &AlarmEngine) -> MachineView {
    let channels = channel_infos();
    MachineView {
        machine: Arc::new(file::parse(MACHINE, "rig.toml").unwrap()),
        judged_by: "crc32:00000000".into(),
        source: SourceState::Running,
        stream_time_s: ring_status(&channels[0]).newest_time_s,
        start_time: Some(Timestamp(1_700_000_000_000_000_000)),
        rings: channels.iter().map(ring_status).collect(),
        channels: Arc::new(channels),
        diagnosis: Some(Arc::new(sample_diagnosis())),
        state_since_s: vec![10.0, 0.0, 0.0, 10.0],
        features: Arc::new(vec![ChannelFeatures {
            channel: ChannelIndex(0),
            sample_range: (0, 40_960),
            values: vec![
                Feature { name: "rms".into(), value: 1.414, unit: Unit::MetrePerSecondSquared },
                Feature { name: "cwt_ratio_1x_main".into(), value: 1.5, unit: Unit::One },
            ],
        }]),
        window_end_s: Some(10.0),
        alarm_load: load::of(engine.history(), &engine.standing(), 12.0),
        alarms: Arc::new(engine.standing()),
        advance: engine.advance().into(),
        queue_bytes: 0,
        queue_wait_s: Some(0.25),
        dropped: (0, 0),
    }
}
