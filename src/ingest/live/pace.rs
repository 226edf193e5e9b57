//! Where values that come by themselves, one at a time and not quite evenly, lie in a channel of a fixed rate.

use crate::signal::Timestamp;

/// How far a value may be from its place and still be the one that is due there, periods: a little late or early is jitter of
/// the network, more is a value that is missing, or one too many.
const TOLERANCE: f64 = 0.75;

/// The places of one channel.
#[derive(Debug, Clone)]
pub struct Pace {
    rate_hz: f64,
    /// When the first value was taken.
    begin: Option<Timestamp>,
    /// One past the newest place.
    next: u64,
}

impl Pace {
    /// Of so many values a second.
    #[must_use]
    pub fn new(rate_hz: f64) -> Self {
        Self { rate_hz, begin: None, next: 0 }
    }

    /// The place of a value that was taken at this time: the next one if it is about due, else the nearest. One that has
    /// been given already, or lies before it, is of a value too many or too late.
    pub fn place(&mut self, at: Timestamp) -> u64 {
        let begin = *self.begin.get_or_insert(at);
        let since_s = (i128::from(at.0) - i128::from(begin.0)) as f64 / 1e9;
        let exact = since_s * self.rate_hz;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "float to int casts saturate"
        )]
        let nearest = exact.round().clamp(0.0, MAX_PLACE) as u64;
        let is_due = (exact - self.next as f64).abs() <= TOLERANCE;
        let place = if is_due { self.next } else { nearest };
        self.next = self.next.max(place + 1);
        place
    }
}

/// The highest place that frames can state, 2⁵³ - 1.
const MAX_PLACE: f64 = 9_007_199_254_740_991.0;

#[cfg(test)]
mod tests {
    use super::*;

    fn places(at_s: &[f64]) -> Vec<u64> {
        let mut pace = Pace::new(2.0);
        at_s.iter()
            .map(|s| pace.place(Timestamp(1_700_000_000_000_000_000).plus_seconds(*s)))
            .collect()
    }

    #[test]
    fn jitter_moves_no_value_and_a_missing_one_leaves_its_place_empty() {
        assert_eq!(places(&[0.0, 0.6, 0.9, 1.7, 1.8]), [0, 1, 2, 3, 4]);
        assert_eq!(places(&[0.0, 0.5, 2.0, 2.5]), [0, 1, 4, 5], "two are missing");
        assert_eq!(places(&[0.0, 0.5, 0.55, 1.0]), [0, 1, 1, 2], "one too many");
        assert_eq!(places(&[0.0, 0.5, 1.0, 0.5, 1.5, -3.0]), [0, 1, 2, 1, 3, 0], "late ones");
    }

    #[test]
    fn a_clock_that_drifts_costs_a_place_now_and_then_and_no_more() {
        // A thousand values, 1 % too slow: the place before each is missing once in a hundred.
        let at_s: Vec<f64> = (0..1000).map(|i| 0.505 * f64::from(i)).collect();
        let found = places(&at_s);
        assert!(found.windows(2).all(|pair| pair[1] > pair[0]), "none doubled");
        let n_missing = found[999] - 999;
        assert!((8..=12).contains(&n_missing), "{n_missing}");
    }
}
