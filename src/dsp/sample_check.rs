//! What is wrong with raw samples before anything is computed from them.
//!
//! Counts samples that are no numbers and flags clipping. Must not know what is done about it.

use crate::dsp::real::Real;

/// Equal samples in succession at an extreme that count as clipped where the full scale is unknown: a
/// smooth peak sampled twice alike happens, three times alike hardly.
const MIN_RUN: usize = 3;

/// A sample this close to full scale, relative, is at it: 20 bits.
const AT_FULL_SCALE: f64 = 1e-6;

/// Faults of a block of samples (D76).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SampleCheck {
    /// Samples looked at.
    pub n: usize,
    /// NaN or infinite.
    pub n_not_finite: usize,
    /// At full scale; without one: in runs of three or more at the largest or smallest value.
    pub n_clipped: usize,
    /// Longest run of clipped samples.
    pub longest_clipped: usize,
}

impl SampleCheck {
    /// Looks at `x`, unit u; `full_scale`: largest |x| the converter gives, u, if known.
    ///
    /// A constant block is not clipped where the full scale is unknown.
    #[must_use]
    pub fn of<T: Real>(x: &[T], full_scale: Option<f64>) -> Self {
        let finite = || x.iter().map(|value| value.to_f64()).filter(|value| value.is_finite());
        let low = finite().fold(f64::INFINITY, f64::min);
        let high = finite().fold(f64::NEG_INFINITY, f64::max);
        let limit = full_scale.map(|full| full.abs() * (1.0 - AT_FULL_SCALE));
        let side = |value: f64| match limit {
            Some(limit) if value >= limit => 1,
            Some(limit) if value <= -limit => -1,
            None if low < high && value >= high => 1,
            None if low < high && value <= low => -1,
            _ => 0,
        };
        let least = if limit.is_some() { 1 } else { MIN_RUN };
        let mut found =
            Self { n: x.len(), n_not_finite: x.len() - finite().count(), ..Self::default() };
        let (mut run, mut run_side) = (0, 0);
        let mut close = |run: usize, run_side: i32| {
            if run_side != 0 && run >= least {
                found.n_clipped += run;
                found.longest_clipped = found.longest_clipped.max(run);
            }
        };
        for value in x {
            let value_side = side(value.to_f64());
            if value_side != run_side {
                close(run, run_side);
                (run, run_side) = (0, value_side);
            }
            run += 1;
        }
        close(run, run_side);
        found
    }

    /// Whether anything is wrong.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        self.n_not_finite == 0 && self.n_clipped == 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::reference::gaussian_noise;
    use crate::dsp::reference::narrow;
    use crate::dsp::reference::sine;

    #[test]
    fn clipping_is_counted_sample_by_sample() {
        let x = sine(1000, 1000.0, 10.0, 1.5, 0.2);
        let clipped: Vec<f64> = x.iter().map(|v| v.clamp(-1.0, 1.0)).collect();
        let exact = x.iter().filter(|v| v.abs() >= 1.0).count();
        for full_scale in [None, Some(1.0)] {
            let found = SampleCheck::of(&narrow::<f32>(&clipped), full_scale);
            assert_eq!((found.n_clipped, found.n_not_finite), (exact, 0), "{full_scale:?}");
            // |1.5·cos| > 1 over 2·acos(2/3)/2π of 100 samples, at each peak.
            assert!((26..=28).contains(&found.longest_clipped), "{found:?}");
        }
        // One side only, and a full scale that is not reached.
        let one_sided: Vec<f64> = x.iter().map(|v| v.min(1.2)).collect();
        assert!(SampleCheck::of(&one_sided, None).n_clipped > 0);
        assert!(SampleCheck::of(&one_sided, Some(2.0)).is_sound());
    }

    #[test]
    fn sound_signals_are_sound() {
        assert!(SampleCheck::of(&narrow::<f32>(&gaussian_noise(100_000, 3)), None).is_sound());
        assert!(SampleCheck::of(&sine(10_000, 1e4, 50.0, 1.0, 0.0), None).is_sound());
        for constant in [vec![], vec![0.0_f32; 100], vec![5.0; 7]] {
            assert!(SampleCheck::of(&constant, None).is_sound());
        }
        assert_eq!(SampleCheck::of(&[1.0_f32; 9], Some(1.0)).n_clipped, 9);
    }

    #[test]
    fn what_is_no_number_is_counted_and_hides_nothing() {
        let mut x = vec![0.5_f64, 1.0, 1.0, 1.0, 0.2, -1.0, f64::NAN, -1.0, f64::INFINITY];
        let found = SampleCheck::of(&x, None);
        assert_eq!((found.n, found.n_not_finite, found.n_clipped), (9, 2, 3));
        x.fill(f64::NAN);
        assert_eq!(SampleCheck::of(&x, None).n_not_finite, 9);
    }
}
