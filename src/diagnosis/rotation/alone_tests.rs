//! What is made of 1×, 2× and 3× of a housing.

use super::tests::by_tacho;
use super::tests::channels;
use super::tests::judged_against;
use super::tests::machine;
use super::tests::window;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::features::ChannelFeatures;
use crate::features::Feature;
use crate::features::WindowFeatures;
use crate::signal::ChannelIndex;
use crate::units::Hz;
use crate::units::Unit;
use std::sync::Arc;

/// Amplitudes of the acceleration: 1×, 2×, 3×, those that the sampling reaches; the whole and the rest as RMS.
struct Heard<'a> {
    lines: &'a [f64],
    whole: f64,
    rest: f64,
}

impl Heard<'_> {
    fn features(&self) -> Vec<ChannelFeatures> {
        let names = ["line_1x_main", "line_2x_main", "line_3x_main"];
        let lines = names.into_iter().zip(self.lines.iter().copied());
        let others =
            [("cwt_1x_main", self.lines[0]), ("rms", self.whole), ("rms_beside_shafts", self.rest)];
        let feature =
            |(name, value): (&str, f64)| Feature { name: Arc::from(name), value, unit: Unit::One };
        let values = lines.chain(others).map(feature).collect();
        vec![ChannelFeatures { channel: ChannelIndex(1), sample_range: (0, 1), values }]
    }
}

/// The verdict on the shaft at 10 Hz without gear and probe, sampled at this rate.
fn judged(healthy: &Heard<'_>, now: &Heard<'_>, rate: Hz) -> ComponentDiagnosis {
    let mut channels = channels();
    channels[1].sample_rate = rate;
    let features = WindowFeatures { speed: by_tacho(Hz(10.0)), ..window(now.features()) };
    judged_against(&machine(false), &channels, healthy.features(), &features)
}

#[test]
fn harmonics_that_are_small_beside_1x_leave_an_unbalance() {
    let healthy = Heard { lines: &[1.0, 0.05, 0.05], whole: 2.0, rest: 1.8 };
    let told = |second: f64, third: f64| {
        let now = Heard { lines: &[8.0, second, third], whole: 6.0, rest: 1.9 };
        judged(&healthy, &now, Hz(1e4)).fault
    };
    // Ten times what they were, but 3.1 % and 2.1 % of 1× as velocity.
    assert_eq!(told(0.5, 0.5), Some(FaultMode::Unbalance));
    // A fifth of 1× as velocity is 3.2 at 2× and 4.8 at 3×.
    assert_eq!(told(3.1, 4.7), Some(FaultMode::Unbalance));
    assert_eq!(told(3.3, 0.1), None);
    assert_eq!(told(0.1, 4.9), None);
}

#[test]
fn harmonics_beyond_the_sampling_leave_an_unbalance_that_is_less_sure_where_1x_is_most() {
    // 19 samples a second: 2× lies at 20 Hz.
    let healthy = Heard { lines: &[1.0], whole: 2.0, rest: 1.8 };
    let told = |rest: f64| judged(&healthy, &Heard { lines: &[8.0], whole: 6.0, rest }, Hz(19.0));
    let most = told(4.2);
    assert_eq!(most.fault, Some(FaultMode::Unbalance), "{}", most.why);
    assert!(most.confidence.unwrap() <= 0.6 && most.why.contains("beyond the sampling"));
    // 4.3² is more than half of 6².
    assert_eq!(told(4.3).fault, None);
    // Within reach, but not in the baseline: not known.
    let sampled = judged(&healthy, &Heard { lines: &[8.0], whole: 6.0, rest: 1.9 }, Hz(1e4));
    assert_eq!(sampled.fault, None, "{}", sampled.why);
}

#[test]
fn a_rise_of_the_whole_channel_is_no_shafts() {
    let healthy = Heard { lines: &[1.0, 0.5, 0.5], whole: 2.0, rest: 1.8 };
    let now = Heard { lines: &[8.0, 0.5, 0.5], whole: 10.0, rest: 1.8 * 4.1 };
    assert!(judged(&healthy, &now, Hz(1e4)).why.ends_with("the whole channel rose with it"));
}
