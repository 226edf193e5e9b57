//! What stands in the retained topics of a broker, and what of it is due to be published.

use crate::api::handles::MachineHandle;
use crate::api::wire::alarms::AlarmWire;
use crate::api::wire::events;
use crate::api::wire::machines::HealthWire;
use crate::notify::topics::Topics;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A text that changes in nothing but numbers and words is published again after this time, s.
const REFRESH_S: f64 = 60.0;

/// What one topic shall hold.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Retained {
    /// What makes it news: it is published at once when this changes.
    key: String,
    /// The whole text.
    payload: String,
}

impl Retained {
    /// What all topics of machines and alarms shall hold.
    pub(super) fn of(
        machines: &[MachineHandle],
        topics: &Topics,
    ) -> Result<BTreeMap<String, Self>, serde_json::Error> {
        let mut standing = BTreeMap::new();
        for handle in machines {
            let view = Arc::clone(&handle.view.borrow());
            let machine = &view.machine;
            let health = HealthWire::new(machine, &view);
            let keys = std::iter::once(format!(
                "{:?} {:?} {}",
                health.state, health.since, health.data.source
            ))
            .chain(
                health
                    .components
                    .iter()
                    .map(|c| format!("{:?} {:?} {:?}", c.state, c.fault, c.since)),
            );
            for ((subject, payload), key) in events::state_payloads(&health)?.into_iter().zip(keys)
            {
                standing.insert(topics.health(&machine.id, &subject), Self { key, payload });
            }
            for alarm in view.alarms.iter() {
                let wire = AlarmWire::new(&machine.id, alarm, view.start_time);
                let key = format!(
                    "{:?} {:?} {:?} {}",
                    wire.state, wire.level, wire.fault, wire.changed_at
                );
                let payload = events::alarm_payload(&wire)?;
                standing.insert(topics.alarm(&machine.id, alarm.id), Self { key, payload });
            }
        }
        Ok(standing)
    }
}

/// What a broker was told in this session.
#[derive(Debug, Default)]
pub(super) struct States {
    told: BTreeMap<String, (Retained, f64)>,
}

impl States {
    /// What is to be published at `now_s`, topic and payload; a topic that nothing stands in any more gets an
    /// empty one, by which the broker forgets it.
    pub(super) fn due(
        &mut self,
        standing: BTreeMap<String, Retained>,
        now_s: f64,
    ) -> Vec<(String, String)> {
        let gone: Vec<String> =
            self.told.keys().filter(|topic| !standing.contains_key(*topic)).cloned().collect();
        let mut due = Vec::new();
        for topic in gone {
            self.told.remove(&topic);
            due.push((topic, String::new()));
        }
        for (topic, retained) in standing {
            let is_due = self.told.get(&topic).is_none_or(|(told, at_s)| {
                told.key != retained.key
                    || (told.payload != retained.payload && now_s - at_s >= REFRESH_S)
            });
            if is_due {
                due.push((topic.clone(), retained.payload.clone()));
                self.told.insert(topic, (retained, now_s));
            }
        }
        due
    }

    /// Whether a retained alarm that the broker still has is of one of our machines and stands no more.
    pub(super) fn is_of_nobody(
        &self,
        topic: &str,
        machines: &[MachineHandle],
        topics: &Topics,
    ) -> bool {
        let is_ours = |handle: &MachineHandle| {
            let any = topics.alarm(&handle.id, 0);
            let folder = any.trim_end_matches('0');
            topic.strip_prefix(folder).is_some_and(|number| number.parse::<u64>().is_ok())
        };
        !self.told.contains_key(topic) && machines.iter().any(is_ours)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn retained(key: &str, payload: &str) -> Retained {
        Retained { key: key.to_owned(), payload: payload.to_owned() }
    }

    fn standing(items: &[(&str, &str, &str)]) -> BTreeMap<String, Retained> {
        items.iter().map(|(topic, key, text)| ((*topic).to_owned(), retained(key, text))).collect()
    }

    fn due(states: &mut States, items: &[(&str, &str, &str)], now_s: f64) -> Vec<String> {
        let due = states.due(standing(items), now_s);
        due.into_iter().map(|(topic, payload)| format!("{topic}={payload}")).collect()
    }

    #[test]
    fn news_is_published_at_once_words_after_a_minute_and_what_is_gone_is_emptied() {
        let mut states = States::default();
        assert_eq!(due(&mut states, &[("a", "k", "1"), ("b", "k", "1")], 0.0), ["a=1", "b=1"]);
        assert!(due(&mut states, &[("a", "k", "1"), ("b", "k", "2")], 1.0).is_empty());
        assert_eq!(due(&mut states, &[("a", "l", "3"), ("b", "k", "2")], 2.0), ["a=3"]);
        assert_eq!(due(&mut states, &[("a", "l", "3"), ("b", "k", "2")], 60.0), ["b=2"]);
        assert_eq!(due(&mut states, &[("b", "k", "2")], 61.0), ["a="]);
        assert!(due(&mut states, &[("b", "k", "2")], 62.0).is_empty());
    }
}
