//! What one stream said in one minute, as it grows in memory and as it is stored.

use super::Tier;
use crate::alarms::past::PastStream;
use crate::alarms::past::PastWindow;
use crate::features::ChannelFeatures;
use crate::units::Unit;
use std::sync::Arc;

/// The windows of a stream that end in one minute of UTC.
#[derive(Debug, Clone, PartialEq)]
pub struct Minute {
    /// The stream.
    pub stream: Arc<PastStream>,
    /// Minutes since 1970-01-01.
    pub minute: i64,
    /// The windows, by rising end.
    pub windows: Vec<PastWindow>,
    /// The channels that had features, in the order in which they came.
    pub channels: Vec<ChannelMinute>,
}

/// The features of one channel in the windows of a minute.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelMinute {
    /// Place in the stream's channels.
    pub channel: usize,
    /// Name and unit of each feature.
    pub features: Vec<(Arc<str>, Unit)>,
    /// One column a feature, as long as the windows; NaN where a window has no such value.
    pub columns: Vec<Vec<f32>>,
}

impl Minute {
    /// A minute without windows.
    #[must_use]
    pub fn new(stream: Arc<PastStream>, minute: i64) -> Self {
        Self { stream, minute, windows: Vec::new(), channels: Vec::new() }
    }

    /// The minute in which a window of `stream` lies that ends at `time_s`.
    #[must_use]
    pub fn of(stream: &PastStream, time_s: f64) -> i64 {
        Tier::Windows.block_at(stream.utc(time_s))
    }

    /// Adds a window that ends after all others, with what was measured in it.
    pub fn push(&mut self, window: PastWindow, measured: &[ChannelFeatures]) {
        let place = self.windows.len();
        self.windows.push(window);
        for features in measured {
            let channel = features.channel.0;
            let at = self.channels.iter().position(|held| held.channel == channel);
            let at = at.unwrap_or_else(|| {
                let (features, columns) = (Vec::new(), Vec::new());
                self.channels.push(ChannelMinute { channel, features, columns });
                self.channels.len() - 1
            });
            self.channels[at].push(features, place);
        }
        for channel in &mut self.channels {
            channel.fill(self.windows.len());
        }
    }

    /// Points (a window in a channel; at least one a window).
    #[must_use]
    pub fn n_points(&self) -> u64 {
        (self.windows.len() * self.channels.len().max(1)) as u64
    }

    /// About how many bytes it takes in memory.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let verdicts: usize = self.windows.iter().map(|window| window.verdicts.len()).sum();
        let columns: usize = self.channels.iter().map(|channel| channel.features.len()).sum();
        512 + 256 * self.windows.len() + 160 * verdicts + columns * (72 + 4 * self.windows.len())
    }

    /// Adds the windows of `other`, another part of the same minute, that are not there yet; gives their
    /// number.
    pub(super) fn merge(&mut self, other: &Self) -> usize {
        let is_new = |window: &&PastWindow| {
            !self.windows.iter().any(|held| held.time_s.to_bits() == window.time_s.to_bits())
        };
        let new: Vec<usize> = other
            .windows
            .iter()
            .enumerate()
            .filter(|(_, window)| is_new(window))
            .map(|(place, _)| place)
            .collect();
        if new.is_empty() {
            return 0;
        }
        let n_before = self.windows.len();
        self.windows.extend(new.iter().map(|place| other.windows[*place].clone()));
        for channel in &other.channels {
            let at = self.channels.iter().position(|held| held.channel == channel.channel);
            let at = at.unwrap_or_else(|| {
                let (features, columns) = (Vec::new(), Vec::new());
                self.channels.push(ChannelMinute { channel: channel.channel, features, columns });
                self.channels.len() - 1
            });
            let held = &mut self.channels[at];
            held.fill(n_before);
            for ((name, unit), column) in channel.features.iter().zip(&channel.columns) {
                let at = held.column(name, *unit, n_before);
                held.columns[at].extend(new.iter().map(|place| column[*place]));
            }
        }
        for channel in &mut self.channels {
            channel.fill(self.windows.len());
        }
        self.sort();
        new.len()
    }

    /// Leaves the windows that are to be kept.
    pub(super) fn retain(&mut self, is_kept: impl Fn(&PastWindow) -> bool) {
        let kept = (0..self.windows.len()).filter(|place| is_kept(&self.windows[*place]));
        let kept: Vec<usize> = kept.collect();
        self.take(&kept);
    }

    /// Lays windows and columns by rising end.
    fn sort(&mut self) {
        let mut order: Vec<usize> = (0..self.windows.len()).collect();
        order.sort_by(|a, b| self.windows[*a].time_s.total_cmp(&self.windows[*b].time_s));
        self.take(&order);
    }

    fn take(&mut self, order: &[usize]) {
        self.windows = order.iter().map(|place| self.windows[*place].clone()).collect();
        for column in self.channels.iter_mut().flat_map(|channel| &mut channel.columns) {
            *column = order.iter().map(|place| column[*place]).collect();
        }
    }
}

impl ChannelMinute {
    /// Adds the values of the window at `place`.
    fn push(&mut self, measured: &ChannelFeatures, place: usize) {
        for (hint, feature) in measured.values.iter().enumerate() {
            let at = match self.features.get(hint) {
                Some((name, unit)) if *name == feature.name && *unit == feature.unit => hint,
                Some(_) | None => self.column(&feature.name, feature.unit, place),
            };
            let column = &mut self.columns[at];
            column.resize(place, f32::NAN);
            #[expect(clippy::cast_possible_truncation, reason = "what is stored is f32")]
            column.push(feature.value as f32);
        }
    }

    /// Place of a feature's column; makes one without `n_before` values.
    fn column(&mut self, name: &Arc<str>, unit: Unit, n_before: usize) -> usize {
        let known = self.features.iter().position(|(n, u)| n == name && *u == unit);
        known.unwrap_or_else(|| {
            self.features.push((Arc::clone(name), unit));
            self.columns.push(vec![f32::NAN; n_before]);
            self.columns.len() - 1
        })
    }

    /// Makes every column `n` long.
    fn fill(&mut self, n: usize) {
        for column in &mut self.columns {
            column.resize(n, f32::NAN);
        }
    }
}
