//! From one stream of a machine to the next: the alarms stay, rings and windows begin anew.

use super::Monitored;
use super::PANICKED;
use crate::api::view::SourceState;
use crate::app::learning::Seen;
use crate::app::trend::TrendStore;
use crate::app::trend::VerdictStore;
use crate::app::trending::Trending;
use crate::ingest::replay::StreamInfo;
use std::panic::AssertUnwindSafe;
use std::panic::catch_unwind;
use std::sync::Arc;

impl Monitored {
    /// Goes on with another stream: the alarms stay, rings and windows begin anew.
    pub(super) fn open(&mut self, info: &StreamInfo, queue_bytes: usize) {
        let outcomes = self.guarded(|monitor, emit| monitor.finish(emit));
        self.take_outcomes(outcomes, None, queue_bytes);
        self.trending.iter_mut().for_each(Trending::close);
        if let Some(capturing) = &mut self.capturing {
            capturing.end_all();
        }
        let now = self.alarming.moment(self.stream_time_s());
        // The rings that were go before those that come are made, and no block of another stream meets them.
        self.give_up_monitor();
        (self.capturing, self.trending) = (None, None);
        let (opener, alarms) = (&mut self.opener, &self.idle_alarms);
        let opened =
            catch_unwind(AssertUnwindSafe(|| Some(opener.as_mut()?.open(info, alarms, now))));
        let fresh = match opened.unwrap_or_else(|_| Some(Err(PANICKED.to_owned()))) {
            Some(Ok(fresh)) => fresh,
            Some(Err(reason)) => {
                self.note_source(SourceState::Failed(reason));
                return self.publish(queue_bytes);
            }
            None => return,
        };
        if matches!(self.source, SourceState::Failed(_)) {
            tracing::info!(
                machine = self.machine.id,
                "the source is opened again after its failure"
            );
            self.source = SourceState::Starting;
        }
        let Some(opener) = &self.opener else { return };
        let monitor = fresh.monitor;
        let channels = monitor.channels().to_vec();
        self.meters.take_channels(&opener.metrics, &self.machine.id, &channels);
        self.trends = vec![TrendStore::default(); channels.len()];
        self.verdicts = VerdictStore::default();
        self.channels = Arc::new(channels);
        self.monitor = Some(monitor);
        self.capturing = fresh.capturing;
        self.trending = Some(fresh.trending);
        self.seen = Seen::default();
        self.features = Arc::default();
        self.window_end_s = None;
        self.keep(fresh.alarm_events, Vec::new());
        self.publish(queue_bytes);
    }

    /// Goes on without a monitor. Alarms are moved between windows only: what stands, stands.
    pub(super) fn give_up_monitor(&mut self) {
        if let Some(monitor) = self.monitor.take() {
            self.idle_alarms = monitor.alarms().clone();
        }
    }
}
