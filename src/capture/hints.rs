//! What the caller knows of a file that does not say it itself.

use super::map::ChannelMap;
use crate::units::{Hz, SourceUnit};
use std::collections::BTreeMap;

/// Facts beside the file; all optional.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Hints {
    /// Where the channels stand, over the machine file's `[capture.map]`.
    pub map: ChannelMap,
    /// Samples a second of every channel whose rate nothing else states.
    pub rate: Option<Hz>,
    /// Unit of every channel whose unit nothing else states, one of
    /// [`crate::units::SourceUnit::ACCEPTED`].
    pub unit: Option<String>,
}

/// Rates closer than this part of themselves are the same.
const SAME_RATE: f64 = 1e-6;

/// Hints that a file contradicts, whose word holds: what it says, and of which channels.
#[derive(Debug, Default)]
pub(super) struct Overruled {
    told: BTreeMap<String, Vec<String>>,
}

impl Overruled {
    /// The file states this rate of the channel at `place`.
    pub(super) fn rate(&mut self, hints: &Hints, place: &str, found: Hz) {
        let Some(asked) = hints.rate else { return };
        if (found.0 - asked.0).abs() > SAME_RATE * asked.0 {
            self.add(
                place,
                format!("the file says {} Hz; --rate {} is not used", found.0, asked.0),
            );
        }
    }

    /// The file states this unit of the channel at `place`.
    pub(super) fn unit(&mut self, hints: &Hints, place: &str, found: &str) {
        let Some(asked) = &hints.unit else { return };
        if SourceUnit::parse(found) != SourceUnit::parse(asked) {
            self.add(place, format!("the file says {found}; --unit {asked} is not used"));
        }
    }

    fn add(&mut self, place: &str, words: String) {
        self.told.entry(words).or_default().push(place.to_owned());
    }

    /// A line each contradiction, of a capture of `n_channels`.
    pub(super) fn notes(&self, n_channels: usize) -> Vec<String> {
        let line = |(words, places): (&String, &Vec<String>)| {
            let of = match places.len() {
                n if n > 1 && n == n_channels => format!("all {n} channels"),
                _ => places.join(", "),
            };
            format!("{of}: {words}")
        };
        self.told.iter().map(line).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hint_that_is_overruled_is_one_line_for_all_that_are_alike() {
        let unit = Some("mm/s".to_owned());
        let hints = Hints { rate: Some(Hz(6000.0)), unit, ..Hints::default() };
        let mut overruled = Overruled::default();
        for place in ["channels/a", "channels/b"] {
            overruled.rate(&hints, place, Hz(12_000.0));
        }
        overruled.rate(&hints, "channels/c", Hz(6000.0));
        overruled.unit(&hints, "channels/a", "g");
        overruled.unit(&hints, "channels/b", "mm/s");
        let rate = "the file says 12000 Hz; --rate 6000 is not used";
        let unit = "channels/a: the file says g; --unit mm/s is not used".to_owned();
        assert_eq!(overruled.notes(2), [format!("all 2 channels: {rate}"), unit.clone()]);
        assert_eq!(overruled.notes(3), [format!("channels/a, channels/b: {rate}"), unit]);
        let mut silent = Overruled::default();
        silent.rate(&Hints::default(), "channels/a", Hz(12_000.0));
        silent.unit(&Hints::default(), "channels/a", "g");
        assert!(silent.notes(1).is_empty());
    }
}
