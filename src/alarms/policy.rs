//! When a verdict becomes an alarm level: on-delay, off-delay and what may never clear.
//!
//! Delays count *evidence time*: stream time that judged windows really covered. Between two
//! verdicts it grows by their distance, but by no more than the newer window's length, and not at
//! all with a verdict that could not look. So a gap, a stopped machine or an `undetermined` holds
//! every clock, and a replay at any speed gives the same alarms.

use crate::diagnosis::fault::State;
use crate::diagnosis::verdict::OperatingState;
use crate::tape::Reader;
use crate::tape::Tape;

/// Policy of the alarm engine.
///
/// The defaults raise at once and return late. A verdict already averages a window of seconds and
/// holds its declared false-alarm rate, so a further on-delay buys little and would keep a short
/// recording (one or two windows) from ever raising. Overlapping windows share a disturbance, so
/// counting consecutive verdicts would not reject one either. What must not happen is chatter, and
/// the off-delay bounds that: a lone bad window in a long stream raises one alarm, which stays for
/// a minute of healthy evidence; one alarm cannot be raised more often than once in that time.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Evidence time for which a level must persist before it is raised, s, ≥ 0.
    pub on_delay_s: f64,
    /// Evidence time for which a level must be absent before it is left, s, ≥ 0.
    pub off_delay_s: f64,
    /// Events kept; older ones are dropped and counted.
    pub history_len: usize,
    /// Time without data after which that is an alarm of its own, s, ≥ 0.
    pub missing_after_s: f64,
    /// Longest time an alarm can be shelved for, s, > 0.
    pub max_shelving_s: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            on_delay_s: 0.0,
            off_delay_s: 60.0,
            history_len: 1000,
            missing_after_s: 10.0,
            max_shelving_s: super::action::MAX_SHELVING_S,
        }
    }
}

/// Level of an alarm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// Proven, severity below 0.5.
    Warning,
    /// Proven, severity from 0.5.
    Damaged,
}

impl Level {
    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Warning => "warning",
            Self::Damaged => "damaged",
        }
    }

    /// Writes a level or none.
    pub fn write(level: Option<Self>, tape: &mut Tape) {
        tape.write_count(match level {
            None => 0,
            Some(Self::Warning) => 1,
            Some(Self::Damaged) => 2,
        });
    }

    /// Reads what [`Self::write`] wrote; `None`: it is something else.
    #[must_use]
    pub fn read(tape: &mut Reader<'_>) -> Option<Option<Self>> {
        match tape.count()? {
            0 => Some(None),
            1 => Some(Some(Self::Warning)),
            2 => Some(Some(Self::Damaged)),
            _ => None,
        }
    }
}

/// What one verdict says about the level of a component.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Observation {
    /// Nothing: it could not look, or the machine stands still.
    NotJudged,
    /// No fault.
    Healthy,
    /// A fault.
    Accused(Level),
}

impl Observation {
    /// Reads a component's state. A stopped machine proves no health.
    #[must_use]
    pub fn of(state: State, operating: OperatingState) -> Self {
        match state {
            State::Undetermined => Self::NotJudged,
            State::Healthy => match operating {
                OperatingState::Stopped => Self::NotJudged,
                OperatingState::Running | OperatingState::Transient | OperatingState::Unknown => {
                    Self::Healthy
                }
            },
            State::Warning => Self::Accused(Level::Warning),
            State::Damaged => Self::Accused(Level::Damaged),
        }
    }
}

/// A switch that follows its input after an on- or off-delay.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct DelayedSwitch {
    on: bool,
    /// Evidence time since the input first differed from `on`; `None` while it agrees.
    differs_for_s: Option<f64>,
}

impl DelayedSwitch {
    fn write(&self, tape: &mut Tape) {
        tape.write_flag(self.on);
        tape.write_option(self.differs_for_s);
    }

    fn read(tape: &mut Reader<'_>) -> Option<Self> {
        Some(Self { on: tape.flag()?, differs_for_s: tape.option()? })
    }

    fn follow(&mut self, input: bool, evidence_s: f64, settings: &Settings) {
        if input == self.on {
            self.differs_for_s = None;
            return;
        }
        let persisted_s = self.differs_for_s.map_or(0.0, |t| t + evidence_s);
        let delay_s = if input { settings.on_delay_s } else { settings.off_delay_s };
        if persisted_s >= delay_s {
            *self = Self { on: input, differs_for_s: None };
        } else {
            self.differs_for_s = Some(persisted_s);
        }
    }
}

/// Follows one component's verdicts and gives its alarm level: two delayed switches, "at least
/// warning" and "damaged", so that damaged steps down to warning only after the off-delay too.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LevelTracker {
    warning: DelayedSwitch,
    damaged: DelayedSwitch,
}

impl LevelTracker {
    /// Writes all of it.
    pub fn write(&self, tape: &mut Tape) {
        self.warning.write(tape);
        self.damaged.write(tape);
    }

    /// Reads what [`Self::write`] wrote; `None`: it is something else.
    #[must_use]
    pub fn read(tape: &mut Reader<'_>) -> Option<Self> {
        Some(Self { warning: DelayedSwitch::read(tape)?, damaged: DelayedSwitch::read(tape)? })
    }

    /// Stands at a level, as after a restart.
    #[must_use]
    pub fn at(level: Option<Level>) -> Self {
        let switch = |on| DelayedSwitch { on, differs_for_s: None };
        Self { warning: switch(level.is_some()), damaged: switch(level == Some(Level::Damaged)) }
    }

    /// Takes an observation that adds `evidence_s` of evidence time, gives the level.
    pub fn observe(
        &mut self,
        observation: Observation,
        evidence_s: f64,
        settings: &Settings,
    ) -> Option<Level> {
        let seen = match observation {
            Observation::NotJudged => return self.level(),
            Observation::Healthy => None,
            Observation::Accused(level) => Some(level),
        };
        self.warning.follow(seen.is_some(), evidence_s, settings);
        self.damaged.follow(seen == Some(Level::Damaged), evidence_s, settings);
        self.level()
    }

    /// The level now.
    #[must_use]
    pub fn level(&self) -> Option<Level> {
        if self.damaged.on {
            Some(Level::Damaged)
        } else {
            self.warning.on.then_some(Level::Warning)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Observation::{Accused, Healthy, NotJudged};
    use proptest::prelude::*;

    const D: Observation = Accused(Level::Damaged);
    const W: Observation = Accused(Level::Warning);

    fn settings(on_delay_s: f64, off_delay_s: f64) -> Settings {
        Settings { on_delay_s, off_delay_s, ..Settings::default() }
    }

    /// Levels after each observation, one second of evidence apart.
    fn run(settings: &Settings, observations: &[Observation]) -> Vec<Option<Level>> {
        let mut tracker = LevelTracker::default();
        observations.iter().map(|o| tracker.observe(*o, 1.0, settings)).collect()
    }

    #[test]
    fn delays_of_both_levels_are_their_own() {
        let (w, d) = (Some(Level::Warning), Some(Level::Damaged));
        assert_eq!(run(&settings(0.0, 0.0), &[W, D, W, Healthy]), [w, d, w, None]);
        // On-delay 2 s: the third verdict of a run completes it; a healthy one restarts it.
        assert_eq!(
            run(&settings(2.0, 0.0), &[W, W, Healthy, W, D, D, D]),
            [None, None, None, None, None, w, d]
        );
        // Off-delay 2 s: down one level at a time, each after two seconds below it.
        assert_eq!(
            run(&settings(0.0, 2.0), &[D, W, W, W, Healthy, Healthy, Healthy]),
            [d, d, d, w, w, w, None]
        );
    }

    #[test]
    fn what_was_not_judged_holds_every_clock() {
        let w = Some(Level::Warning);
        assert_eq!(
            run(&settings(0.0, 2.0), &[W, Healthy, NotJudged, NotJudged, NotJudged, Healthy]),
            [w; 6]
        );
        assert_eq!(
            run(&settings(2.0, 2.0), &[W, W, NotJudged, W]),
            [None, None, None, w],
            "an unjudged window does not restart an on-delay"
        );
    }

    #[test]
    fn a_stopped_machine_proves_no_health_but_may_be_accused() {
        for operating in [
            OperatingState::Running,
            OperatingState::Transient,
            OperatingState::Unknown,
            OperatingState::Stopped,
        ] {
            let stopped = operating == OperatingState::Stopped;
            let healthy = Observation::of(State::Healthy, operating);
            assert_eq!(healthy, if stopped { NotJudged } else { Healthy });
            assert_eq!(Observation::of(State::Undetermined, operating), NotJudged);
            assert_eq!(Observation::of(State::Warning, operating), W);
            assert_eq!(Observation::of(State::Damaged, operating), D);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// Damaged implies the warning switch, and no level ever appears that was not observed.
        #[test]
        fn level_never_exceeds_the_worst_observed(
            inputs in prop::collection::vec((0_u8..4, 0.0_f64..5.0), 1..60),
            on_delay_s in 0.0_f64..10.0,
            off_delay_s in 0.0_f64..10.0,
        ) {
            let settings = settings(on_delay_s, off_delay_s);
            let mut tracker = LevelTracker::default();
            let mut worst = None;
            for (kind, evidence_s) in inputs {
                let observation = [NotJudged, Healthy, W, D][usize::from(kind)];
                if let Accused(level) = observation {
                    worst = worst.max(Some(level));
                }
                let before = tracker.level();
                let after = tracker.observe(observation, evidence_s, &settings);
                prop_assert!(after <= worst);
                prop_assert!(!tracker.damaged.on || tracker.warning.on);
                match observation {
                    NotJudged => prop_assert_eq!(before, after),
                    Healthy => prop_assert!(after <= before),
                    Accused(_) => {}
                }
            }
        }
    }
}
