//! What goes wrong with the store besides alarms: the alarm of the store says it.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::time::Duration;
use std::time::Instant;

/// For how long a loss is told after it: longer than the wait before the next attempt, so that what fails again
/// and again is one alarm.
pub(super) const TOLD_FOR: Duration = Duration::from_secs(60);

/// Parts that are told by name.
const MAX_TOLD: usize = 5;

/// What is told, of one part after another; cheap to clone.
#[derive(Debug, Clone, Default)]
pub struct Troubles {
    parts: Arc<Mutex<BTreeMap<String, Trouble>>>,
}

#[derive(Debug)]
struct Trouble {
    why: String,
    /// `None`: until it is told that it is over.
    until: Option<Instant>,
}

impl Troubles {
    /// Says what a part cannot do; `None`: it can.
    pub fn note(&self, part: &str, why: Option<String>) {
        self.set(part, why.map(|why| Trouble { why, until: None }));
    }

    /// Says what a part has lost at `now`.
    pub fn lost(&self, part: &str, why: String, now: Instant) {
        self.set(part, Some(Trouble { why, until: Some(now + TOLD_FOR) }));
    }

    /// All that is to be told at `now`, in one sentence.
    #[must_use]
    pub fn told(&self, now: Instant) -> Option<String> {
        let mut parts = self.parts.lock().unwrap_or_else(PoisonError::into_inner);
        parts.retain(|_, trouble| trouble.until.is_none_or(|until| now < until));
        let first: Vec<&str> = parts.values().take(MAX_TOLD).map(|t| t.why.as_str()).collect();
        let more = match parts.len().saturating_sub(MAX_TOLD) {
            0 => String::new(),
            n => format!("; and {n} more, see the log"),
        };
        (!first.is_empty()).then(|| format!("{}{more}", first.join("; ")))
    }

    fn set(&self, part: &str, trouble: Option<Trouble>) {
        let mut parts = self.parts.lock().unwrap_or_else(PoisonError::into_inner);
        match trouble {
            Some(trouble) => drop(parts.insert(part.to_owned(), trouble)),
            None => drop(parts.remove(part)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lasts_is_told_until_it_is_over_and_a_loss_for_a_while() {
        let (troubles, now) = (Troubles::default(), crate::app::now());
        assert_eq!(troubles.told(now), None);
        troubles.note("trends", Some("trends are refused".to_owned()));
        troubles.lost("recording", "samples are lost".to_owned(), now);
        assert_eq!(troubles.told(now).unwrap(), "samples are lost; trends are refused");
        let later = now + TOLD_FOR;
        assert_eq!(troubles.told(later).unwrap(), "trends are refused");
        (0..MAX_TOLD).for_each(|n| troubles.note(&format!("part {n}"), Some(format!("no {n}"))));
        assert_eq!(
            troubles.told(later).unwrap(),
            "no 0; no 1; no 2; no 3; no 4; and 1 more, see the log"
        );
        (0..MAX_TOLD).for_each(|n| troubles.note(&format!("part {n}"), None));
        troubles.note("trends", None);
        assert_eq!(troubles.told(later), None);
    }
}
