//! How often a machine's stream may be opened: each opening begins its windows anew, so that a sender which says
//! another hello again and again would keep the machine from ever being judged.
//!
//! A bucket of tokens: enough at once for many senders that come together at a start, few from then on.

use super::Refusal;
use crate::signal::Timestamp;
use crate::wire::ErrorCode;

/// Openings one after another: as many senders may come to one machine at the same time.
const AT_ONCE: u32 = 128;

/// Time in which one more is earned, ns: longer than most windows, so that verdicts go on between two.
const EARNED_IN_NS: i64 = 60_000_000_000;

/// Openings of the stream of one machine.
#[derive(Debug, Default)]
pub(super) struct Openings {
    /// Those not earned back.
    spent: u32,
    /// Until when was counted.
    at: Timestamp,
}

impl Openings {
    /// Whether the stream may be opened now; a clock that goes back earns nothing.
    ///
    /// # Errors
    /// When it was opened too often.
    pub(super) fn check(&mut self, machine: &str, now: Timestamp) -> Result<(), Refusal> {
        let passed = now.0.saturating_sub(self.at.0);
        if self.spent == 0 || passed < 0 {
            self.at = now;
        } else {
            let earned = passed / EARNED_IN_NS;
            self.at = Timestamp(self.at.0.saturating_add(earned.saturating_mul(EARNED_IN_NS)));
            self.spent = self.spent.saturating_sub(u32::try_from(earned).unwrap_or(u32::MAX));
        }
        if self.spent < AT_ONCE {
            return Ok(());
        }
        let text = format!(
            "the stream of machine {machine:?} was opened {AT_ONCE} times, and once a minute from then on is taken: describe \
             channels alike in every hello, and send those that belong together in one"
        );
        Err(Refusal::new(ErrorCode::ReopenedTooOften, text))
    }

    /// The stream was opened.
    pub(super) fn spend(&mut self) {
        self.spent += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_at_once_then_one_a_minute() {
        let mut openings = Openings::default();
        let at = |seconds: f64| Timestamp(1_700_000_000_000_000_000).plus_seconds(seconds);
        for _ in 0..AT_ONCE {
            openings.check("rig", at(0.0)).unwrap();
            openings.spend();
        }
        let refusal = openings.check("rig", at(59.0)).unwrap_err();
        assert_eq!(refusal.code, ErrorCode::ReopenedTooOften);
        openings.check("rig", at(61.0)).unwrap();
        openings.spend();
        openings.check("rig", at(119.0)).unwrap_err();
        openings.check("rig", at(30.0)).unwrap_err();
        // The clock was set back to 30 s: from there on.
        openings.check("rig", at(91.0)).unwrap();
        openings.check("rig", at(1e9)).unwrap();
        openings.spend();
        assert_eq!(openings.spent, 1, "all is earned back, and no more");
    }
}
