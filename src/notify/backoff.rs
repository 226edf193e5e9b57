//! How long to wait before it is tried again.

/// Exponential back-off with jitter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Backoff {
    /// Longest wait after the first failure, s, > 0.
    pub first_s: f64,
    /// Longest wait after any number of failures, s.
    pub max_s: f64,
}

impl Default for Backoff {
    fn default() -> Self {
        Self { first_s: 1.0, max_s: 60.0 }
    }
}

/// Doublings beyond which a wait is as long as it may be, whatever the settings.
const MAX_DOUBLINGS: u32 = 40;

impl Backoff {
    /// Wait after `n_failures` in a row (from 1), s: between half and the whole of a time that doubles with
    /// each. `jitter`, 0 to 1, says where, so that many senders do not come back at once.
    #[must_use]
    pub fn wait_s(&self, n_failures: u32, jitter: f64) -> f64 {
        let doublings = n_failures.saturating_sub(1).min(MAX_DOUBLINGS);
        let whole_s = (self.first_s * 2.0_f64.powi(doublings.cast_signed())).min(self.max_s);
        // Written so that NaN is no jitter.
        let jitter = if jitter > 0.0 { jitter.min(1.0) } else { 0.0 };
        whole_s * (0.5 + 0.5 * jitter)
    }
}
