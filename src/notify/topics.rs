//! Topics of MQTT: where what stands.

use super::Subject;

/// Topics below one prefix.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topics {
    prefix: String,
}

impl Topics {
    /// Begins every topic with `prefix`.
    #[must_use]
    pub fn new(prefix: &str) -> Self {
        Self { prefix: prefix.trim_matches('/').to_owned() }
    }

    /// Whether the daemon is there: `online` or `offline`, retained.
    #[must_use]
    pub fn availability(&self) -> String {
        format!("{}/availability", self.prefix)
    }

    /// State of a machine or component, retained.
    #[must_use]
    pub fn health(&self, machine: &str, subject: &Subject) -> String {
        match subject {
            Subject::Machine => format!("{}/{}/state", self.prefix, level(machine)),
            Subject::Component(kind, id) => {
                format!(
                    "{}/{}/components/{}/{}",
                    self.prefix,
                    level(machine),
                    kind.name(),
                    level(id)
                )
            }
        }
    }

    /// One alarm, retained as long as it is not over.
    #[must_use]
    pub fn alarm(&self, machine: &str, number: u64) -> String {
        format!("{}/{}/alarms/{number}", self.prefix, level(machine))
    }

    /// All alarms.
    #[must_use]
    pub fn all_alarms(&self) -> String {
        format!("{}/+/alarms/+", self.prefix)
    }

    /// Transitions as they come, not retained.
    #[must_use]
    pub fn events(&self, machine: &str) -> String {
        format!("{}/{}/events", self.prefix, level(machine))
    }
}

/// A name as one level of a topic: what has a meaning there is written as %XX.
fn level(name: &str) -> String {
    let mut text = String::with_capacity(name.len());
    for c in name.chars() {
        if matches!(c, '/' | '+' | '#' | '%' | '$') || c.is_control() {
            let mut bytes = [0; 4];
            for byte in c.encode_utf8(&mut bytes).bytes() {
                text.push_str(&format!("%{byte:02X}"));
            }
        } else {
            text.push(c);
        }
    }
    text
}
