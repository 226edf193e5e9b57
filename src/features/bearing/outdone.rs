//! Side bands that are higher than their line: then it is a side band of theirs (F28). Must not know what the line is of.

use super::DepthSpectrum;
use super::Harmonic;
use super::LineTask;
use super::least_part;
use super::read::coinciding;
use super::read::depth_at;
use super::read::highest_within;
use crate::units::Hz;

/// Side bands to either side that are held against the line.
pub(super) const SIDE_BANDS: u32 = 2;

/// How far a cage's rate may lie from the kinematic one, relative (F5).
const CAGE_SLIP: f64 = 0.02;

/// How far beyond the searched range an element's line may lie, relative: as far again as it is searched.
const BEYOND: f64 = 0.02;

/// How much higher one must be than the line: a defect that is struck once a turn has side bands as high as its line, and what else stands there
/// or rings on into the next strike adds to them.
const HIGHER: f64 = 1.2;

/// The highest of the side bands, if it is surely higher than the line itself and its double higher than the line's (F28): strikes that a load
/// modulates, which is never negative, have none such. What lies a side band beside a strike's rate has its double two side bands beside. Of a
/// race's line at the cage's rate, too, where the higher one is an element's beyond what is searched: what is found is a side band of that.
pub(super) fn higher_side_band(
    spectrum: &DepthSpectrum<'_>,
    task: &LineTask<'_>,
    (frequency_hz, fundamental): (f64, Harmonic),
) -> Option<Hz> {
    let is_higher = |depth: f64| {
        let over_floor = fundamental.power_ratio * (depth / fundamental.depth).powi(2);
        depth * least_part(over_floor) > HIGHER * fundamental.depth
    };
    let beside = |k: u32| [-1.0, 1.0].map(|sign| sign * f64::from(k));
    let away = || (1..=SIDE_BANDS).flat_map(beside);
    let of_shaft = away().map(|k| {
        let hz = frequency_hz + k * task.side_band_spacing.0;
        (hz, depth_at(spectrum, hz))
    });
    let of_cage = cage_rate(task).into_iter().flat_map(|cage| {
        let place = move |k: f64| (frequency_hz + k * cage.0, k.abs() * CAGE_SLIP * cage.0);
        away().map(place).map(|(hz, reach_hz)| highest_within(spectrum, hz, reach_hz))
    });
    let places = of_shaft.chain(of_cage.filter(|(hz, _)| may_be_elements(task, *hz)));
    let is_known = |hz: f64| coinciding(Hz(hz), task.known, task.resolution).is_some();
    let top_hz = spectrum.depth.len() as f64 * spectrum.bin_hz;
    let double_is_higher = |hz: f64| {
        let (own, other) = (2.0 * frequency_hz, 2.0 * hz);
        let is_unread = own.max(other) >= top_hz || is_known(own) || is_known(other);
        is_unread || depth_at(spectrum, other) > depth_at(spectrum, own)
    };
    let highest = places
        .filter(|(hz, _)| *hz > task.resolution.0 && !is_known(*hz) && double_is_higher(*hz))
        .max_by(|a, b| a.1.total_cmp(&b.1))?;
    is_higher(highest.1).then_some(Hz(highest.0))
}

/// Whether an element's line may lie there, outside of what is searched for it.
fn may_be_elements(task: &LineTask<'_>, hz: f64) -> bool {
    task.element_range.is_some_and(|(Hz(low), Hz(high))| {
        let is_searched = (low..=high).contains(&hz);
        !is_searched && ((1.0 - BEYOND) * low..=(1.0 + BEYOND) * high).contains(&hz)
    })
}

/// The cage's rate, of a race's line.
fn cage_rate(task: &LineTask<'_>) -> Option<Hz> {
    let seen = task.cage_spacing?.0;
    Some(Hz(if task.is_at_rest { seen } else { (task.shaft_speed.0 - seen).abs() }))
}

#[cfg(test)]
mod tests {
    use super::super::KnownLine;
    use super::super::read_line;
    use super::super::tests::BAND;
    use super::super::tests::of_ten_seconds;
    use super::super::tests::spectrum_of;
    use super::super::tests::task;
    use super::*;

    /// What is higher than a line at 100 Hz.
    fn outdone(task: &LineTask<'_>, beside: &[(f64, f64)]) -> Option<f64> {
        let depth = spectrum_of(&[&[(100.0, 0.5), (200.0, 0.3)], beside].concat(), 0.05);
        let reading = read_line(&of_ten_seconds(&depth), BAND, task, &mut Vec::new()).unwrap();
        reading.outdone_by.map(|hz| hz.0.round())
    }

    #[test]
    fn a_side_band_higher_than_the_line_is_what_the_line_is_a_side_band_of() {
        // Side bands 25 Hz apart.
        let outdone = |beside: &[(f64, f64)], known: &[KnownLine]| outdone(&task(known), beside);
        assert_eq!(outdone(&[(125.0, 0.7), (250.0, 0.4)], &[]), Some(125.0));
        assert_eq!(outdone(&[(125.0, 0.7), (250.0, 0.2)], &[]), None, "its double is no other's");
        let below = [(75.0, 0.6), (150.0, 0.4), (50.0, 0.7)];
        assert_eq!(outdone(&below, &[]), Some(50.0), "the highest, and twice that is the line");
        assert_eq!(
            outdone(&[(125.0, 0.48), (75.0, 0.4)], &[]),
            None,
            "a load that is never negative"
        );
        assert_eq!(outdone(&[(125.0, 0.56)], &[]), None, "struck once a turn");
        assert_eq!(outdone(&[(25.0, 0.9), (112.0, 0.9)], &[]), None, "no side bands");
        let mains =
            KnownLine { frequency: Hz(125.0), spacing: Hz(125.0), label: "mains".to_owned() };
        assert_eq!(outdone(&[(125.0, 0.7)], &[mains]), None, "the mains'");
    }

    #[test]
    fn a_race_whose_line_is_a_side_band_of_an_elements_is_outdone_by_that() {
        // The cage turns at 11 Hz, the shaft at 28 Hz; the element's line is at 89.1 Hz, the cage 1 % slow.
        let element_range = Some((Hz(90.0), Hz(93.7)));
        let at_rest =
            LineTask { cage_spacing: Some(Hz(11.0)), element_range, is_at_rest: true, ..task(&[]) };
        let turning = LineTask { cage_spacing: Some(Hz(17.0)), element_range, ..task(&[]) };
        let elsewhere = LineTask { element_range: Some((Hz(70.0), Hz(78.0))), ..turning.clone() };
        let two_away = LineTask { element_range: Some((Hz(79.0), Hz(82.0))), ..turning.clone() };
        let searched = LineTask { element_range: Some((Hz(88.0), Hz(92.0))), ..turning.clone() };
        let higher = [(89.1, 0.7), (178.2, 0.4)];
        for race in [&at_rest, &turning] {
            assert_eq!(outdone(race, &higher), Some(89.0));
            assert_eq!(outdone(race, &[(89.1, 0.48), (110.9, 0.4)]), None, "elements that differ");
            assert_eq!(outdone(race, &[(95.0, 0.9), (190.0, 0.4)]), None, "at no side band");
        }
        assert_eq!(outdone(&two_away, &[(78.2, 0.7), (156.4, 0.4)]), Some(78.0));
        assert_eq!(outdone(&elsewhere, &higher), None, "nobody's: hum, or another shaft's");
        assert_eq!(outdone(&searched, &higher), None, "it is held against the races itself");
    }
}
