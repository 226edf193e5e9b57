//! What the levels of the next window rest on beside the window: delays, hysteresis, clocks. Kept with an alarm's
//! evidence, so that it can be decided again, and over a restart. Must not know alarms' lives: what operators did decides no level.

use super::AlarmEngine;
use super::policy::Level;
use super::policy::LevelTracker;
use super::slot::Slot;
use super::stated::StatedDecisions;
use crate::diagnosis::fault::ComponentKind;
use crate::tape::Reader;
use crate::tape::Tape;

/// Everything the levels of the next window rest on beside the window.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Decisions {
    last_verdict_s: Option<f64>,
    judged_until_s: Option<f64>,
    components: Vec<((ComponentKind, String), LevelTracker)>,
    stated: StatedDecisions,
}

impl Decisions {
    /// Writes all of it.
    pub fn write(&self, tape: &mut Tape) {
        tape.write_option(self.last_verdict_s);
        tape.write_option(self.judged_until_s);
        tape.write_count(self.components.len());
        for ((kind, id), tracker) in &self.components {
            tape.write_word(kind.name());
            tape.write_word(id);
            tracker.write(tape);
        }
        tape.write_option(self.stated.startup_since_s);
        tape.write_count(self.stated.limits.len());
        for (tracker, levels) in &self.stated.limits {
            tracker.write(tape);
            tape.write_count(levels.len());
            levels.iter().for_each(|level| Level::write(*level, tape));
        }
        tape.write_count(self.stated.channels.len());
        self.stated.channels.iter().for_each(|tracker| tracker.write(tape));
    }

    /// Reads what [`Self::write`] wrote; `None`: it is something else.
    #[must_use]
    pub fn read(tape: &mut Reader<'_>) -> Option<Self> {
        let (last_verdict_s, judged_until_s) = (tape.option()?, tape.option()?);
        let components = tape.list(|tape| {
            let name = tape.word()?;
            let kind = ComponentKind::ALL.into_iter().find(|kind| kind.name() == name)?;
            Some(((kind, tape.word()?.to_owned()), LevelTracker::read(tape)?))
        })?;
        let startup_since_s = tape.option()?;
        let limits =
            tape.list(|tape| Some((LevelTracker::read(tape)?, tape.list(Level::read)?)))?;
        let channels = tape.list(LevelTracker::read)?;
        let stated = StatedDecisions { startup_since_s, limits, channels };
        Some(Self { last_verdict_s, judged_until_s, components, stated })
    }
}

impl AlarmEngine {
    /// What the levels of the next window rest on beside the window.
    #[must_use]
    pub fn decisions(&self) -> Decisions {
        let of_component =
            |(key, slot): (&(ComponentKind, String), &Slot)| (key.clone(), slot.tracker);
        Decisions {
            last_verdict_s: self.last_verdict_s,
            judged_until_s: Some(self.judged_until_s).filter(|time_s| time_s.is_finite()),
            components: self.components.iter().map(of_component).collect(),
            stated: self.stated.decisions(),
        }
    }

    /// Goes on with what [`Self::decisions`] gave, without its alarms; false: it is of another machine.
    pub fn resume(&mut self, kept: &Decisions) -> bool {
        self.last_verdict_s = kept.last_verdict_s;
        self.judged_until_s = kept.judged_until_s.unwrap_or(f64::NEG_INFINITY);
        for (key, tracker) in &kept.components {
            self.components.entry(key.clone()).or_default().tracker = *tracker;
        }
        self.stated.resume(&kept.stated)
    }

    /// Takes up delays and hysteresis of before a restart; `is_same`: of the same stream, so that its times mean the
    /// same. What does not fit to an alarm that stands, or to the machine file, begins anew.
    pub(super) fn go_on(&mut self, kept: &Decisions, is_same: bool) {
        for (key, tracker) in &kept.components {
            if self.stated.has(key.0, &key.1) {
                self.components.entry(key.clone()).or_default().go_on(*tracker);
            }
        }
        self.stated.go_on(&kept.stated, is_same);
    }

    /// What stands above its level now, in words, with it: `bearing right`, `limit overall`, `channel x`.
    #[must_use]
    pub fn raised(&self) -> Vec<(String, Level)> {
        let of_component = |((kind, id), slot): (&(ComponentKind, String), &Slot)| {
            Some((format!("{} {id}", kind.name()), slot.tracker.level()?))
        };
        let components = self.components.iter().filter_map(of_component);
        components.chain(self.stated.raised()).collect()
    }
}
