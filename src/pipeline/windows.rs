//! Where windows lie: how long they are for a machine, and a grid of hops from the start of each contiguous run of stream time.

use super::Settings;
use crate::features::speed;
use crate::features::speed::SpeedHints;
use crate::machine::Machine;
use crate::signal::ChannelInfo;

/// Longest window of a record of a machine at usual speeds, s: one of 10 s is one window.
const USUAL_S: f64 = 12.0;

/// Revolutions that a window of a slower machine holds: as many as one of the usual length at 10 Hz. Lines are told from a shaft's
/// harmonics by revolutions, not by seconds.
const REVOLUTIONS: f64 = 120.0;

/// No window is longer, s: the limit of `window_seconds` in the daemon's file.
const LONGEST_S: f64 = 600.0;

/// Samples of a channel in a window of the daemon that is lengthened, at most.
const MOST_SAMPLES: f64 = 4_194_304.0;

/// Longest window of a record of `machine`, s: long enough for the slowest shaft with a bearing, as far as its speed is stated.
#[must_use]
pub fn longest_s(machine: &Machine, hints: SpeedHints) -> f64 {
    let stated = speed::nominal(hints, machine.nominal_speed());
    let speed_hz = |first| {
        let shafts = machine.bearings.iter().map(|bearing| bearing.shaft);
        shafts.filter_map(move |shaft| machine.shaft_speed(shaft, first)).map(|speed| speed.0)
    };
    let slowest_hz = stated.into_iter().flat_map(|(first, _)| speed_hz(first));
    let needed_s = slowest_hz.filter(|hz| *hz > 0.0).map(|hz| REVOLUTIONS / hz);
    needed_s.fold(USUAL_S, f64::max).min(LONGEST_S)
}

/// `settings` with windows as long as the slowest shaft with a bearing needs where that turns at less than 10 Hz, as far as its speed
/// is stated ([`longest_s`]), and hops and the delays of alarms in proportion; never shorter ones.
///
/// No window has more than 4 million samples of a channel: what is held in memory, and what a window costs, has an end.
#[must_use]
pub fn lengthened(
    settings: &Settings,
    (machine, hints): (&Machine, SpeedHints),
    channels: &[ChannelInfo],
) -> Settings {
    let needed_s = longest_s(machine, hints);
    let fastest_hz = channels.iter().map(|c| c.sample_rate.0).fold(f64::MIN_POSITIVE, f64::max);
    let window_s = needed_s.min(MOST_SAMPLES / fastest_hz);
    if needed_s <= USUAL_S || window_s <= settings.window_s {
        return settings.clone();
    }
    settings.in_windows(window_s, settings.hop_s * window_s / settings.window_s)
}

/// Length of the fewest equal windows that lie end to end in a record and are no longer than `longest_s`, s.
#[must_use]
pub fn equal_s(duration_s: f64, longest_s: f64) -> f64 {
    duration_s / (duration_s / longest_s).ceil().max(1.0)
}

/// Lays the windows of one stream.
#[derive(Debug, Clone)]
pub(super) struct WindowGrid {
    window_s: f64,
    hop_s: f64,
    run: Option<Run>,
}

#[derive(Debug, Clone, Copy)]
struct Run {
    start_s: f64,
    n_windows: u32,
    judged_to_s: f64,
}

impl WindowGrid {
    /// Windows of at most `window_s` that end every `hop_s`.
    #[must_use]
    pub(super) fn new(window_s: f64, hop_s: f64) -> Self {
        Self { window_s, hop_s, run: None }
    }

    /// Where the run under way began, s: windows end a whole number of hops after it.
    #[must_use]
    pub(super) fn origin_s(&self) -> Option<f64> {
        self.run.map(|run| run.start_s)
    }

    /// Begins a run at `start_s`, unless one is under way.
    pub(super) fn begin(&mut self, start_s: f64) {
        self.run.get_or_insert(Run { start_s, n_windows: 0, judged_to_s: start_s });
    }

    /// The next window whose end lies at or before `reached_s`: start and end, s.
    pub(super) fn next_due(&mut self, reached_s: f64) -> Option<(f64, f64)> {
        let (window_s, hop_s) = (self.window_s, self.hop_s);
        let run = self.run.as_mut()?;
        let end = run.start_s + f64::from(run.n_windows + 1) * hop_s;
        // A millionth of a hop against the rounding of index/rate.
        if end > reached_s + 1e-6 * hop_s {
            return None;
        }
        run.n_windows += 1;
        run.judged_to_s = end;
        Some(((end - window_s).max(run.start_s), end))
    }

    /// Ends the run at `end_s`: the last window, if at least half a hop has not been judged yet, or
    /// nothing of the run has.
    pub(super) fn finish(&mut self, end_s: f64) -> Option<(f64, f64)> {
        let run = self.run.take()?;
        let left = end_s - run.judged_to_s;
        let untouched = run.n_windows == 0 && left > 0.0;
        (untouched || left >= 0.5 * self.hop_s)
            .then(|| ((end_s - self.window_s).max(run.start_s), end_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnosis::rate::FalseAlarms;
    use crate::units::Hz;
    use crate::units::Unit;

    fn longest(toml: &str, hints: SpeedHints) -> f64 {
        longest_s(&crate::machine::file::parse(toml, "m").unwrap(), hints)
    }

    #[test]
    fn a_window_holds_enough_revolutions_of_the_slowest_shaft_with_a_bearing() {
        let machine = "[machine]\nid = \"m\"\nname = \"m\"\n[[shaft]]\nid = \"fast\"\nspeed_hz = 20.0\n\
             [[shaft]]\nid = \"slow\"\nratio_to = { shaft = \"fast\", ratio = 0.1 }\n[[bearing]]\nid = \"b\"\nshaft = \"SHAFT\"\n\
             elements = 9\nelement_diameter_mm = 8.0\npitch_diameter_mm = 40.0\ncontact_angle_deg = 0.0\n";
        let on = |shaft: &str| machine.replace("SHAFT", shaft);
        let unsaid = SpeedHints::default();
        let is = |found: f64, wanted: f64| assert!((found - wanted).abs() < 1e-9, "{found}");
        // The slow shaft has no bearing.
        is(longest(&on("fast"), unsaid), 12.0);
        is(longest(&on("slow"), unsaid), 60.0);
        let written = SpeedHints { capture: Some(crate::units::Hz(5.0)), ..unsaid };
        is(longest(&on("slow"), written), 240.0);
        let creeping = SpeedHints { option: Some(crate::units::Hz(0.1)), ..unsaid };
        is(longest(&on("slow"), creeping), 600.0);
        let unstated = on("fast").replace("speed_hz = 20.0\n", "");
        is(longest(&unstated, unsaid), 12.0);
    }

    #[test]
    fn slow_machines_get_longer_windows_of_as_many_false_alarms_a_year() {
        let alarms = crate::alarms::Settings {
            on_delay_s: 20.0,
            off_delay_s: 30.0,
            ..crate::alarms::Settings::default()
        };
        let false_alarms = FalseAlarms::a_year(0.1, (10.0, 5.0), 20.0);
        let settings = Settings { alarms, false_alarms, ..Settings::default() };
        let fitted = |speed_hz: f64, sample_rate: f64| {
            let machine = format!(
                "[machine]\nid = 'm'\n[[shaft]]\nid = 's'\nspeed_hz = {speed_hz:?}\n[[bearing]]\nid = 'b'\nshaft = 's'\n\
                 elements = 9\nelement_diameter_mm = 8.0\npitch_diameter_mm = 40.0\n"
            );
            let machine = crate::machine::file::parse(&machine, "m").unwrap();
            let channel = ChannelInfo {
                name: "a".to_owned(),
                sample_rate: Hz(sample_rate),
                unit: Unit::MetrePerSecondSquared,
                full_scale: None,
                offset: 0.0,
                unit_conflict: None,
            };
            lengthened(&settings, (&machine, SpeedHints::default()), &[channel])
        };
        assert_eq!(fitted(10.0, 1e4), settings);
        let slow = fitted(2.0, 1e4);
        let (window_s, hop_s, ring_s) = (slow.window_s, slow.hop_s, slow.ring_s);
        let is = |found: f64, wanted: f64| assert!((found - wanted).abs() < 1e-9, "{found}");
        is(window_s, 60.0);
        is(hop_s, 30.0);
        is(ring_s, 90.0);
        is(slow.alarms.on_delay_s, 120.0);
        is(slow.alarms.off_delay_s, 180.0);
        assert_eq!(slow.false_alarms, FalseAlarms::a_year(0.1, (window_s, hop_s), 120.0));
        // Another delay that comes while it runs is in proportion, too.
        let alarms = crate::alarms::Settings { off_delay_s: 5.0, ..settings.alarms.clone() };
        let renewed = slow.renewed(&Settings { alarms, ..settings.clone() });
        is(renewed.alarms.off_delay_s, 30.0);
        assert_eq!((renewed.window_s, renewed.false_alarms), (window_s, slow.false_alarms));
        // 4,194,304 samples.
        is(fitted(0.2, 51_200.0).window_s, 81.92);
    }

    #[test]
    fn windows_grow_to_their_length_and_then_slide() {
        let mut grid = WindowGrid::new(10.0, 5.0);
        grid.begin(2.0);
        assert_eq!(grid.next_due(6.9), None);
        assert_eq!(grid.next_due(30.0), Some((2.0, 7.0)));
        assert_eq!(grid.next_due(30.0), Some((2.0, 12.0)));
        assert_eq!(grid.next_due(30.0), Some((7.0, 17.0)));
    }

    #[test]
    fn what_is_left_is_judged_once() {
        let mut grid = WindowGrid::new(10.0, 5.0);
        grid.begin(0.0);
        assert_eq!(grid.finish(0.1), Some((0.0, 0.1)), "a snapshot is a window");
        assert_eq!(grid.finish(0.1), None);
        grid.begin(0.0);
        assert!(grid.next_due(5.0).is_some());
        assert_eq!(grid.finish(7.4), None, "less than half a hop");
        grid.begin(0.0);
        assert!(grid.next_due(5.0).is_some());
        assert_eq!(grid.finish(7.6), Some((0.0, 7.6)));
    }
}
