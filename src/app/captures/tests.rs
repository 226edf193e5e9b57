//! When captures end: by the slowest channel, without data, and when nobody ends them.

use super::Capturer;
use super::Captures;
use super::Job;
use super::QUEUE;
use crate::app::Clock;
use crate::app::capturing::Asked;
use crate::app::capturing::Capturing;
use crate::app::capturing::Seen;
use crate::app::room::CapturesGiveWay;
use crate::app::trouble::Troubles;
use crate::capture::received::NumberType;
use crate::capture::received::RawSamples;
use crate::capture::received::Received;
use crate::capture::received::ReceivedChannel;
use crate::capture::writer::CaptureHeader;
use crate::config::CAPTURES;
use crate::config::Config;
use crate::config::Store;
use crate::evidence::kept::Judged;
use crate::pipeline::SpeedHints;
use crate::signal::ChannelIndex;
use crate::signal::SampleIndex;
use crate::store::captures::CaptureEntry;
use crate::store::captures::CaptureIndex;
use crate::store::captures::CaptureQuery;
use crate::store::captures::CaptureState;
use crate::store::sqlite;
use crate::telemetry::Metrics;
use crate::units::Hz;
use std::sync::Arc;
use std::sync::mpsc;
use std::thread;
use std::thread::JoinHandle;
use std::time::Duration;
use tempfile::TempDir;
use tokio::sync::oneshot;

const SEEN: Seen<'static> = Seen { monitor: None, diagnosis: None };

/// Captures of a machine with the channels `fast` and `slow`, 10 samples a second each.
fn capturing(capturer: Capturer) -> Capturing {
    let channel = |name: &str| ReceivedChannel {
        name: name.to_owned(),
        sample_rate: Hz(10.0),
        number_type: NumberType::I16,
        scale: 1.0,
        offset: 0.0,
        raw_zero: 0.0,
        unit: None,
        sensor: None,
    };
    let judged = Judged {
        received: vec![channel("fast"), channel("slow")],
        channels: Vec::new(),
        hints: SpeedHints::default(),
        settings: Config::default().monitor,
    };
    Capturing::new("rig-1", CAPTURES, capturer, CaptureHeader::default(), (judged, String::new()))
}

fn capturer(n_jobs: usize) -> (Capturer, mpsc::Receiver<Job>) {
    let (jobs, inbox) = mpsc::sync_channel(n_jobs);
    let max_waiting = Arc::new((1 << 20).into());
    (Capturer { jobs, waiting: Arc::default(), max_waiting, keys: Arc::default() }, inbox)
}

impl Capturing {
    /// Takes in the second of a channel that begins at `second`.
    fn feed(&mut self, channel: usize, second: u16) {
        let run = Received {
            channel: ChannelIndex(channel),
            start: SampleIndex(u64::from(second) * 10),
            segment: 0,
            time_s: second.into(),
            raw: RawSamples::I16(vec![0; 10]),
        };
        self.receive(&Arc::new(run));
        self.end_those_complete();
    }

    /// An operator asks for a capture at `time_s` with 10 s more.
    fn begin(&mut self, time_s: f64) {
        let [author, comment] = ["M. Ito", "why"].map(str::to_owned);
        let (reply, _) = oneshot::channel();
        let after_s = Some(10.0);
        self.ask(Asked { author, comment, before_s: None, after_s, reply }, time_s, SEEN);
    }
}

/// Both channels have come for 20 s, and a capture has begun.
fn begun() -> (Capturing, mpsc::Receiver<Job>) {
    let (capturer, inbox) = capturer(QUEUE);
    let mut capturing = capturing(capturer);
    (0..20).for_each(|second| [0, 1].into_iter().for_each(|c| capturing.feed(c, second)));
    capturing.begin(20.0);
    (capturing, inbox)
}

/// The notes of the captures that were ended.
fn ended(inbox: &mpsc::Receiver<Job>) -> Vec<Option<String>> {
    let jobs = inbox.try_iter().filter_map(|job| match job {
        Job::End(_, note) => Some(note),
        Job::Begin(..) | Job::GoOn(..) | Job::CutShort(_) | Job::Refuse { .. } => None,
    });
    jobs.collect()
}

#[test]
fn a_capture_waits_for_the_slowest_channel_that_delivers() {
    let (mut capturing, inbox) = begun();
    (20..40).for_each(|second| capturing.feed(0, second));
    (20..29).for_each(|second| capturing.feed(1, second));
    let of_slow = |job: &Job| matches!(job, Job::GoOn(_, run) if run.channel.0 == 1);
    let jobs: Vec<Job> = inbox.try_iter().collect();
    assert!(!jobs.iter().any(|job| matches!(job, Job::End(..))));
    assert_eq!(jobs.iter().filter(|job| of_slow(job)).count(), 9);
    capturing.feed(1, 29);
    assert_eq!(ended(&inbox), [None]);
}

#[test]
fn a_capture_waits_for_a_channel_only_so_long_and_says_which_is_short() {
    let (mut capturing, inbox) = begun();
    (20..59).for_each(|second| capturing.feed(0, second));
    assert!(ended(&inbox).is_empty());
    capturing.feed(0, 59); // 60 s are reached: 30 s after the end
    let notes = ended(&inbox);
    assert!(
        matches!(&notes[..], [Some(note)] if note.starts_with("`slow` ended early")),
        "{notes:?}"
    );
    // By now nobody waits for it.
    capturing.begin(60.0);
    (60..70).for_each(|second| capturing.feed(0, second));
    assert_eq!(ended(&inbox), [None]);
}

#[test]
fn an_end_that_finds_no_room_is_said_again() {
    let (capturer, inbox) = capturer(1);
    let mut capturing = capturing(capturer);
    capturing.feed(0, 0);
    capturing.begin(1.0);
    capturing.end_for_silence(); // the queue is full
    assert!(ended(&inbox).is_empty());
    capturing.tick();
    assert_eq!(ended(&inbox), [Some("it ends early: no data come any more".to_owned())]);
    capturing.tick();
    assert!(ended(&inbox).is_empty());
}

/// The thread that writes, which closes after a second what nothing comes for.
struct Writing {
    capturer: Capturer,
    index: Arc<dyn CaptureIndex>,
    thread: JoinHandle<()>,
    _folder: TempDir,
}

fn writing() -> Writing {
    let folder = TempDir::new().unwrap();
    drop(sqlite::open(folder.path()).unwrap()); // the index joins the store of alarms
    let store = Store { directory: folder.path().to_owned(), ..Store::default() };
    let config = Config { store, ..Config::default() };
    let metrics = Metrics::new();
    let (counted, troubles) = ((metrics.captures(), metrics.room()), Troubles::default());
    let give_way = Arc::<CapturesGiveWay>::default();
    let opened = super::open(&config, 1 << 20, counted, (troubles, give_way)).unwrap().unwrap();
    let Captures { capturer, mut plan, handle } = opened;
    plan.idle = Duration::from_secs(1);
    let thread = thread::spawn(move || plan.run(Clock::start()));
    Writing { capturer, index: handle.index, thread, _folder: folder }
}

impl Writing {
    fn wait_for_complete(&self) -> CaptureEntry {
        let deadline = crate::app::now() + Duration::from_secs(30);
        loop {
            let query = CaptureQuery { limit: 10, ..CaptureQuery::default() };
            let found = self.index.list(&query).unwrap();
            if let Some(entry) = found.into_iter().find(|e| e.state == CaptureState::Complete) {
                return entry;
            }
            assert!(crate::app::now() < deadline);
            thread::sleep(Duration::from_millis(20));
        }
    }
}

#[test]
fn a_capture_that_gets_nothing_and_is_not_ended_is_closed() {
    let writing = writing();
    let mut capturing = capturing(writing.capturer.clone());
    (0..20).for_each(|second| [0, 1].into_iter().for_each(|c| capturing.feed(c, second)));
    capturing.begin(20.0);
    let note = writing.wait_for_complete().note;
    assert_eq!(note.as_deref(), Some("nothing came for it for 1 s"));
    drop((capturing, writing.capturer));
    writing.thread.join().unwrap();
}
