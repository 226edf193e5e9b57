//! What a machine with live senders needs on its shard when its stream becomes known: monitor, captures, trends.

use crate::alarms::AlarmEngine;
use crate::alarms::AlarmEvent;
use crate::alarms::Decisions;
use crate::alarms::Kept;
use crate::alarms::Moment;
use crate::app::captures;
use crate::app::captures::Capturer;
use crate::app::capturing::Capturing;
use crate::app::fitted;
use crate::app::fitted::Fitted;
use crate::app::stores;
use crate::app::trending::TrendKeeper;
use crate::app::trending::Trending;
use crate::causes::with_causes;
use crate::config::Config;
use crate::config::MachineConfig;
use crate::diagnosis::baseline::Baseline;
use crate::ingest::replay::StreamInfo;
use crate::pipeline::Monitor;
use crate::pipeline::Renewal;
use crate::pipeline::Settings;
use crate::store::BaselineStore;
use crate::store::StreamKey;
use crate::store::active_records;
use crate::telemetry::Metrics;
use std::sync::Arc;

/// Opens streams of one machine.
pub struct Opener {
    pub(in crate::app) config: Arc<Config>,
    pub(in crate::app) entry: MachineConfig,
    /// The captures that the configuration names as healthy.
    pub(in crate::app) baseline: Baseline,
    pub(in crate::app) signed: Arc<dyn BaselineStore>,
    pub(in crate::app) trends: TrendKeeper,
    pub(in crate::app) key: StreamKey,
    pub(in crate::app) capturer: Option<Capturer>,
    pub(in crate::app) metrics: Arc<Metrics>,
    /// Delays and hysteresis of before the start, for the first stream.
    pub(in crate::app) kept: Option<Decisions>,
    /// Bytes of captures that may wait for the disk on account of this machine.
    pub(in crate::app) waiting_bytes: usize,
}

impl std::fmt::Debug for Opener {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Opener").field("machine", &self.entry.machine.id).finish_non_exhaustive()
    }
}

/// A stream that is open.
pub(in crate::app) struct Fresh {
    pub(in crate::app) monitor: Monitor,
    pub(in crate::app) alarm_events: Vec<AlarmEvent>,
    pub(in crate::app) capturing: Option<Capturing>,
    pub(in crate::app) trending: Trending,
}

impl Opener {
    /// Streams are opened by other settings from now on.
    pub(in crate::app) fn renew(
        &mut self,
        config: &Arc<Config>,
        entry: &MachineConfig,
        configuration: &str,
        (renewal, baseline): (Option<Renewal>, &Baseline),
    ) {
        self.config = Arc::clone(config);
        self.entry = entry.clone();
        self.key.judged_by = Some(configuration.to_owned());
        if renewal == Some(Renewal::Rebuilt) {
            self.baseline = baseline.clone();
        }
    }

    /// Opens a stream; the alarms go on as they are.
    ///
    /// # Errors
    /// Why the machine cannot be monitored with it.
    pub(in crate::app) fn open(
        &mut self,
        info: &StreamInfo,
        alarms: &AlarmEngine,
        now: Moment,
    ) -> Result<Fresh, String> {
        let (config, entry) = (&self.config, &self.entry);
        let (hints, fitted) = (fitted::hints(info), Fitted::of(config, &entry.machine, info));
        let settings = Settings { baseline: self.baseline.clone(), ..fitted.settings };
        let machine = Arc::clone(&entry.machine);
        let mut monitor = Monitor::new(machine, info.channels.clone(), hints, &settings)
            .map_err(|error| with_causes(&error))?;
        match active_records(&*self.signed, &entry.machine.id) {
            Ok(records) => monitor.use_signed(records),
            Err(error) => {
                let (machine, error) = (&entry.machine.id, with_causes(&error));
                tracing::error!(machine, error, "signed baselines cannot be read, none are used");
            }
        }
        let kept = Kept {
            alarms: alarms.standing(),
            history: alarms.history().iter().cloned().collect(),
            last_id: alarms.last_id(),
            last_sequence: alarms.last_sequence(),
            // Stream time goes on; what senders with other buffers say again of a time that was judged is no news.
            judged_until_s: alarms.judged_until_s(),
            decisions: self.kept.take().or_else(|| Some(alarms.decisions())),
            advance: alarms.advance().to_vec(),
            last_advance: alarms.last_advance(),
        };
        let alarm_events = monitor.alarms_mut().restore(kept, now);
        if let Some(capturer) = &self.capturer {
            let needed = captures::waiting_bytes(fitted.captures, &info.received);
            capturer.allow_more(needed.saturating_sub(self.waiting_bytes));
            self.waiting_bytes = self.waiting_bytes.max(needed);
        }
        let capturer = self.capturer.clone();
        let capturing =
            capturer.and_then(|capturer| stores::capturing(config, entry, info, capturer));
        if let Some(capturing) = &capturing {
            capturing.prepare(&mut monitor);
        }
        let trends = self.trends.clone();
        let trending = Trending::new(trends, &entry.machine.id, &self.key, &info.channels);
        Ok(Fresh { monitor, alarm_events, capturing, trending })
    }
}
