//! Which bands one channel is demodulated in, and to which searches what is read in them goes.
//!
//! Must not know how a band is read.

use super::bands::Band;
use super::bearing::BandReading;
use super::bearing::LineSearch;
use super::targets::Target;
use std::sync::Arc;

/// What one channel's envelopes tell of all lines of all bearings that its sensor listens to.
#[derive(Debug, Default)]
pub struct ChannelLines {
    /// At the speed.
    pub here: Vec<LineSearch>,
    /// The same in the sets of bands below (F4), widest first.
    pub lower: Vec<Vec<LineSearch>>,
    /// As `here`, but lines of races that turn read between the shaft's events where these hide them (F31); `None` where they hide none.
    pub between: Option<Vec<LineSearch>>,
    /// As `here` at each of the other speeds.
    pub elsewhere: Vec<Vec<LineSearch>>,
}

/// The searches of all channels in each set of bands below, each channel in its lowest where it has fewer, or in its only one (F4).
#[must_use]
pub fn lower_lines(channels: &[ChannelLines]) -> Arc<[Vec<LineSearch>]> {
    let n_sets = channels.iter().map(|channel| channel.lower.len()).max().unwrap_or(0);
    let of_channel = |channel: &ChannelLines, set: usize| {
        let lowest = channel.lower.get(set).or_else(|| channel.lower.last());
        lowest.unwrap_or(&channel.here).clone()
    };
    let of_set = |set| channels.iter().flat_map(|channel| of_channel(channel, set)).collect();
    (0..n_sets).map(of_set).collect()
}

/// The searches of all channels between the shaft's events, of those as they are that hide nothing; empty where no channel's do (F31).
#[must_use]
pub fn between_lines(channels: &[ChannelLines]) -> Arc<[LineSearch]> {
    if channels.iter().all(|channel| channel.between.is_none()) {
        return Arc::default();
    }
    channels.iter().flat_map(|c| c.between.as_ref().unwrap_or(&c.here).iter().cloned()).collect()
}

/// The bands that one channel is demodulated in.
pub(super) struct Sets {
    /// Those of the usable band.
    pub(super) whole: Vec<Band>,
    pub(super) octaves: Vec<Band>,
    /// The sets below, widest first.
    pub(super) lower: Vec<Vec<Band>>,
}

/// One band and what was read in it of every line that was asked for.
pub(super) struct BandLines {
    pub(super) band: Band,
    pub(super) read: Vec<Option<BandReading>>,
    /// By place in `read`: what stands between the shaft's events that hide it.
    pub(super) between: Vec<(usize, BandReading)>,
}

/// What there is of the first searches besides the bands of all of the spectrum.
#[derive(Default)]
pub(super) struct Besides {
    pub(super) lower: Vec<Vec<LineSearch>>,
    pub(super) between: Option<Vec<LineSearch>>,
}

impl Sets {
    /// Each band once: sets share those of the sets above them.
    pub(super) fn distinct(&self) -> Vec<Band> {
        let all = self.whole.iter().chain(&self.octaves).chain(self.lower.iter().flatten());
        let mut distinct: Vec<Band> = Vec::new();
        for band in all {
            if !distinct.contains(band) {
                distinct.push(*band);
            }
        }
        distinct
    }

    /// Whether a band is asked for lines at other speeds, too: those of the lower sets are not.
    pub(super) fn is_for_all(&self, band: &Band) -> bool {
        self.whole.contains(band) || self.octaves.contains(band)
    }

    /// Hands what was `read` of each pending line to its search; what else there is of the first `n_here` searches.
    pub(super) fn hand_out(
        &self,
        read: &[BandLines],
        (pending, n_here): (&[(usize, Target)], usize),
        searches: &mut [LineSearch],
    ) -> Besides {
        let of = |bands: &[Band], line: usize| -> Vec<BandReading> {
            let readings = |band: &Band| read.iter().find(|lines| lines.band == *band);
            bands.iter().filter_map(|band| readings(band)?.read[line].clone()).collect()
        };
        for (line, (place, _)) in pending.iter().enumerate() {
            searches[*place].outcome = Ok(of(&self.whole, line));
            searches[*place].octaves = of(&self.octaves, line);
        }
        let in_set = |set: &Vec<Band>| {
            let mut there = searches[..n_here].to_vec();
            for (line, (place, _)) in pending.iter().enumerate().filter(|(_, p)| p.0 < n_here) {
                there[*place].outcome = Ok(of(set, line));
                there[*place].octaves = Vec::new();
            }
            there
        };
        let lower = self.lower.iter().map(in_set).collect();
        let mut between = None;
        for lines in read {
            for (line, reading) in &lines.between {
                let there: &mut Vec<LineSearch> =
                    between.get_or_insert_with(|| searches[..n_here].to_vec());
                let readings = there[pending[*line].0].outcome.iter_mut().flatten();
                readings.filter(|r| r.band == lines.band).for_each(|r| r.clone_from(reading));
            }
        }
        Besides { lower, between }
    }
}
