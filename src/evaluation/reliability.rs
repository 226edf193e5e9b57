//! Whether a confidence is a frequency: verdicts sorted by the confidence given, and the share of them that was right.

use super::interval::Rate;
use rand::RngExt;
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

/// Ends of the bins; each holds its lower end, the last one both.
pub const EDGES: [f64; 8] = [0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0];

/// Bins there are.
const N_BINS: usize = EDGES.len() - 1;

/// Times that records are drawn anew (C33): 2.5 % of them are 50, which scatters by a seventh.
const N_DRAWS: usize = 2000;

/// Seed of the draws: the same verdicts give the same table.
const SEED: u64 = 0x626f_6f74;

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
    /// Those that were right; the interval is the wider, at either end, of C20 and C33.
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

/// Verdicts of one record: of each bin how many there are, how many were right.
type Counts = [(usize, usize); N_BINS];

/// The reliability diagram as a table: one bin between two [`EDGES`]; judgements that are no numbers are left out.
///
/// `records`: the judgements of each. Verdicts of one record share its speed and its sensors, and are right or wrong together:
/// the interval takes no more from them than records drawn anew allow.
#[must_use]
pub fn table<'a>(
    records: impl Iterator<Item = &'a [Judgement]>,
    is_of_table: impl Fn(&Judgement) -> bool,
) -> Vec<Bin> {
    let mut sums = [0.0; N_BINS];
    let mut counts: Vec<Counts> = Vec::new();
    for record in records {
        let mut of_record = Counts::default();
        for judgement in record.iter().filter(|j| j.confidence.is_finite() && is_of_table(j)) {
            let inner = &EDGES[1..N_BINS];
            let at = inner.iter().filter(|e| **e <= judgement.confidence).count();
            sums[at] += judgement.confidence;
            of_record[at].0 += 1;
            of_record[at].1 += usize::from(judgement.right);
        }
        counts.push(of_record);
    }
    let drawn = by_records(&counts);
    let bin = |(at, ends): (usize, &[f64])| {
        let n = counts.iter().map(|c| c[at].0).sum::<usize>();
        let mut right = Rate::new(counts.iter().map(|c| c[at].1).sum(), n);
        right.interval = (right.interval.0.min(drawn[at].0), right.interval.1.max(drawn[at].1));
        let mean = (n > 0).then(|| sums[at] / n as f64);
        Bin { confidence: (ends[0], ends[1]), mean, right }
    };
    EDGES.windows(2).enumerate().map(bin).collect()
}

/// Interval of the share that was right in each bin, by drawing as many records as there are, with repetition (C33); a bin
/// without verdicts has none: (1, 0).
fn by_records(counts: &[Counts]) -> [(f64, f64); N_BINS] {
    let mut random = Pcg64Mcg::seed_from_u64(SEED);
    let mut shares: [Vec<f64>; N_BINS] = Default::default();
    for _ in 0..N_DRAWS {
        let mut sums = Counts::default();
        for _ in counts {
            let record = &counts[random.random_range(0..counts.len())];
            for (sum, count) in sums.iter_mut().zip(record) {
                *sum = (sum.0 + count.0, sum.1 + count.1);
            }
        }
        for (shares, (n, n_right)) in shares.iter_mut().zip(sums) {
            shares.extend((n > 0).then(|| n_right as f64 / n as f64));
        }
    }
    shares.map(|mut shares| {
        shares.sort_by(f64::total_cmp);
        // 2.5 % at either end leave 95 %.
        let outside = shares.len() / 40;
        let last = shares.len().wrapping_sub(1 + outside);
        match (shares.get(outside), shares.get(last)) {
            (Some(low), Some(high)) => (*low, *high),
            (_, _) => (1.0, 0.0),
        }
    })
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
        let bins = table(std::iter::once(&found[..]), |_| true);
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
        let bins = |n_right: usize| table(of(n_right).chunks(1), |j| j.accused);
        assert_eq!(bins(92)[5].is_calibrated(), Some(true));
        assert_eq!(bins(50)[5].is_calibrated(), Some(false));
        assert_eq!(bins(50)[0].is_calibrated(), None);
        assert_eq!(table(of(50).chunks(1), |j| !j.accused)[5].right.of, 0);
    }

    #[test]
    fn verdicts_that_are_right_and_wrong_together_prove_less() {
        let width = |each: usize| {
            // 80 of 100 records right, `each` verdicts in every one.
            let records: Vec<Vec<Judgement>> =
                (0..100).map(|i| vec![judged(0.8, i < 80); each]).collect();
            let bin = table(records.iter().map(Vec::as_slice), |_| true).swap_remove(4);
            bin.right.interval.1 - bin.right.interval.0
        };
        // A binomial share of 0.8 in 100: 2·1.96·√(0.8·0.2/100) = 0.157; ten times as many verdicts tell no more.
        let (one, ten) = (width(1), width(10));
        assert!((0.14..0.19).contains(&one), "{one}");
        assert!((0.14..0.19).contains(&ten), "{ten}: √10 times less if they were independent");
    }
}
