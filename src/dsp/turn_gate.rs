//! Leaves out of a squared envelope what happens at the same angle of every turn.
//!
//! Blows of a shaft (a worn tooth, a knock) fill a small part of its turn, and hide what is struck all over
//! it. Must not know machines, lines or bands.

use crate::dsp::real::Real;
use crate::dsp::real::floor_index;

/// Cells a turn is cut into, where it has samples enough.
const MOST_CELLS: usize = 64;

/// Fewest samples of a turn for a cell.
const SAMPLES_A_CELL: f64 = 2.0;

/// Which part of a turn is left out: the loudest eighth of its cells.
const PARTS: usize = 8;

/// Replaces the samples of `e2` in the loudest eighth of the turn by the mean of the rest (D113).
///
/// `e2`: squared envelope, any unit; `turns_per_sample`: speed ÷ sample rate, constant. Which angles are the loudest is what the mean
/// over all turns says. `false`, and nothing is changed, where a turn has fewer than 16 samples.
pub fn leave_out_loudest<T: Real>(e2: &mut [T], turns_per_sample: f64) -> bool {
    let per_turn = 1.0 / turns_per_sample;
    if !per_turn.is_finite() || per_turn < SAMPLES_A_CELL * PARTS as f64 {
        return false;
    }
    let cells = floor_index(per_turn / SAMPLES_A_CELL).min(MOST_CELLS) / PARTS * PARTS;
    let cell = |i: usize| {
        let turns = i as f64 * turns_per_sample;
        floor_index((turns - turns.floor()) * cells as f64).min(cells - 1)
    };
    let mut sums = vec![(0.0_f64, 0_usize); cells];
    for (i, value) in e2.iter().enumerate() {
        let (sum, n) = &mut sums[cell(i)];
        *sum += value.to_f64();
        *n += 1;
    }
    let mean = |at: usize| sums[at].0 / sums[at].1.max(1) as f64;
    let mut by_loudness: Vec<usize> = (0..cells).collect();
    by_loudness.sort_by(|a, b| mean(*b).total_cmp(&mean(*a)));
    let (out, kept) = by_loudness.split_at(cells / PARTS);
    let (sum, n) = kept.iter().fold((0.0, 0), |(sum, n), at| (sum + sums[*at].0, n + sums[*at].1));
    let rest = T::rounded(sum / n.max(1) as f64);
    let mut is_out = vec![false; cells];
    out.iter().for_each(|at| is_out[*at] = true);
    for (i, value) in e2.iter_mut().enumerate() {
        if is_out[cell(i)] {
            *value = rest;
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::envelope::EnvelopeSpectrumPlan;
    use crate::dsp::fft::FftCache;

    /// Samples a second, speed and rate of what is struck all over the turn, in a record of 10 s.
    const RATE_HZ: f64 = 2000.0;
    const SPEED_HZ: f64 = 10.0;
    const STRUCK_HZ: f64 = 54.3;

    /// A floor of 1, blows of a height once a turn that last a twentieth of it, and blows at another rate.
    fn record(once_a_turn: f64, all_over: f64) -> Vec<f64> {
        let blow = |t: f64, rate_hz: f64, part: f64| {
            let turns = t * rate_hz;
            f64::from(turns - turns.floor() < part)
        };
        (0..20_000)
            .map(|i| f64::from(i) / RATE_HZ)
            .map(|t| {
                1.0 + once_a_turn * blow(t, SPEED_HZ, 0.05) + all_over * blow(t, STRUCK_HZ, 0.2)
            })
            .collect()
    }

    /// Modulation depth of `e2` at a rate.
    fn depth_at(e2: &[f64], rate_hz: f64) -> f64 {
        let mut plan = EnvelopeSpectrumPlan::new(e2.len(), &mut FftCache::new());
        let mut depth = vec![0.0; plan.n_bins()];
        plan.process(e2, &mut depth).unwrap();
        depth[floor_index((rate_hz / plan.bin_width_hz(RATE_HZ)).round())]
    }

    #[test]
    fn blows_once_a_turn_no_longer_hide_what_is_struck_all_over_it() {
        let alone = record(0.0, 2.0);
        let mut both = record(100.0, 2.0);
        let (before, sound) = (depth_at(&both, STRUCK_HZ), depth_at(&alone, STRUCK_HZ));
        assert!(leave_out_loudest(&mut both, SPEED_HZ / RATE_HZ));
        let after = depth_at(&both, STRUCK_HZ);
        assert!(before < 0.3 * sound, "{before} of {sound}");
        // An eighth of its own blows are left out with them.
        assert!((after / sound - 7.0 / 8.0).abs() < 0.01, "{after} of {sound}");
        assert!(depth_at(&both, SPEED_HZ) < 0.05, "nothing of the events is left");
    }

    #[test]
    fn what_is_left_out_is_the_loudest_eighth_and_weighs_nothing() {
        let before = record(100.0, 2.0);
        let mut after = before.clone();
        assert!(leave_out_loudest(&mut after, SPEED_HZ / RATE_HZ));
        let changed = |i: &usize| (before[*i] - after[*i]).abs() > 1e-9;
        let at: Vec<usize> = (0..before.len()).filter(changed).collect();
        // 200 samples a turn are 64 cells; blows last 10 samples, of cells of 3 or 4.
        assert!(at.iter().all(|i| i % 200 < 25 || i % 200 >= 175 || before[*i] < 10.0));
        let kept: Vec<f64> = (0..before.len()).filter(|i| !changed(i)).map(|i| before[i]).collect();
        let (mean, of_kept) =
            (after.iter().sum::<f64>() / 2e4, kept.iter().sum::<f64>() / kept.len() as f64);
        assert!((mean / of_kept - 1.0).abs() < 0.01, "{mean}, {of_kept}");
        assert!(after.iter().all(|v| *v < 10.0), "no blow of the shaft is left");
    }

    #[test]
    fn turns_of_few_samples_and_no_turns_are_left_as_they_are() {
        for turns_per_sample in [0.0, 1.0 / 15.9, 1.0, f64::NAN, -0.01] {
            let before = record(100.0, 2.0);
            let mut after = before.clone();
            assert!(!leave_out_loudest(&mut after, turns_per_sample), "{turns_per_sample}");
            assert_eq!(before, after);
        }
        assert!(leave_out_loudest(&mut Vec::<f32>::new(), 0.01), "nothing is nothing");
    }
}
