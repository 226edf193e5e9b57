//! Whether a confidence is a frequency: verdicts sorted by the confidence given, and the share of them that was right.

use super::interval::Rate;

/// Ends of the bins; each holds its lower end, the last one both.
pub const EDGES: [f64; 8] = [0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0];

/// A verdict on a component with its confidence, and whether it was right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Judgement {
    /// Probability given that state and fault are right.
    pub confidence: f64,
    /// Whether they were.
    pub right: bool,
    /// Whether the component was accused, or called healthy.
    pub accused: bool,
}

/// Verdicts of about equal confidence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bin {
    /// Ends of the confidence.
    pub confidence: (f64, f64),
    /// Mean of the confidences given; `None` in an empty bin.
    pub mean: Option<f64>,
    /// Those that were right.
    pub right: Rate,
}

impl Bin {
    /// Whether the mean given lies inside the interval of the share that was right.
    #[must_use]
    pub fn is_calibrated(&self) -> Option<bool> {
        let (low, high) = self.right.interval;
        self.mean.map(|mean| low <= mean && mean <= high)
    }
}

/// The reliability diagram as a table: one bin between two [`EDGES`]; judgements that are no numbers are left out.
///
/// Intervals take verdicts as independent; those of one record are not quite.
#[must_use]
pub fn table<'a>(judgements: impl Iterator<Item = &'a Judgement>) -> Vec<Bin> {
    let mut sums = [(0.0, 0_usize, 0_usize); EDGES.len() - 1];
    for judgement in judgements.filter(|j| j.confidence.is_finite()) {
        let at = EDGES[1..EDGES.len() - 1].iter().filter(|e| **e <= judgement.confidence).count();
        let (sum, n, n_right) = &mut sums[at];
        *sum += judgement.confidence;
        *n += 1;
        *n_right += usize::from(judgement.right);
    }
    let bin = |(ends, (sum, n, n_right)): (&[f64], (f64, usize, usize))| Bin {
        confidence: (ends[0], ends[1]),
        mean: (n > 0).then(|| sum / n as f64),
        right: Rate::new(n_right, n),
    };
    EDGES.windows(2).zip(sums).map(bin).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judged(confidence: f64, right: bool) -> Judgement {
        Judgement { confidence, right, accused: true }
    }

    #[test]
    fn verdicts_are_sorted_by_what_was_given() {
        let found = [
            judged(0.9, true),
            judged(0.94, true),
            judged(0.95, false),
            judged(1.0, true),
            judged(0.1, false),
            judged(f64::NAN, true),
        ];
        let bins = table(found.iter());
        let counts: Vec<_> = bins.iter().map(|b| (b.right.count, b.right.of)).collect();
        assert_eq!(counts, [(0, 1), (0, 0), (0, 0), (0, 0), (0, 0), (2, 2), (1, 2)]);
        assert!((bins[5].mean.unwrap() - 0.92).abs() < 1e-12);
        assert_eq!(bins[1].mean, None);
    }

    #[test]
    fn nine_right_in_ten_given_nine_tenths_is_calibrated_and_five_is_not() {
        let of = |n_right: usize| -> Vec<Judgement> {
            (0..100).map(|i| judged(0.92, i < n_right)).collect()
        };
        assert_eq!(table(of(92).iter())[5].is_calibrated(), Some(true));
        assert_eq!(table(of(50).iter())[5].is_calibrated(), Some(false));
        assert_eq!(table(of(50).iter())[0].is_calibrated(), None);
    }
}
