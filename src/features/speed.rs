//! Speed of the first shaft: everything else is read at multiples of it.
//!
//! Precedence: tacho, speed channel, option, capture, machine file. The last three are nominal and
//! are moved onto what `shaft_lines` finds of the shaft within ± 3 % (docs/theory.md, F1–F3, F21, F26).

use super::Elsewhere;
use super::shaft_lines::Comb;
use super::turning::Turning;
use crate::dsp::order::PhaseTrack;
use crate::units::Hz;

/// Where the speed of the first shaft came from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SpeedSource {
    /// Tacho pulses.
    Tacho,
    /// A speed channel.
    SpeedChannel,
    /// The capture's `shaft_speed_hz`.
    Capture,
    /// The machine file.
    Machine,
    /// The operator's option.
    Option,
    /// A nominal speed moved by more than 0.1 % onto shaft harmonics.
    Estimated,
}

impl SpeedSource {
    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Tacho => "tacho",
            Self::SpeedChannel => "speed_channel",
            Self::Capture => "capture",
            Self::Machine => "machine",
            Self::Option => "option",
            Self::Estimated => "estimated",
        }
    }
}

/// Nominal speeds of the first shaft offered with the data.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SpeedHints {
    /// The operator's `--speed`.
    pub option: Option<Hz>,
    /// The capture's `shaft_speed_hz`.
    pub capture: Option<Hz>,
}

/// The angle of the first shaft over a window.
#[derive(Debug, Clone)]
pub struct Phase {
    /// Revolutions over time from the tacho's first sample; of several tachos' marks they count from that of the machine's first.
    pub track: PhaseTrack,
    /// Stream time of that sample, s.
    pub start_s: f64,
    /// Whether revolution 0 is a mark on the shaft: one pulse a revolution.
    pub is_marked: bool,
}

/// The speed of a window.
#[derive(Debug, Clone)]
pub struct Speed {
    /// Mean speed of the first shaft; `None`: unknown.
    pub first: Option<Hz>,
    /// Where it came from.
    pub source: Option<SpeedSource>,
    /// 0…1.
    pub confidence: f64,
    /// (max − min)/mean of the speed within the window; 0 where only a mean is known.
    pub excursion: f64,
    /// Angle of the first shaft, when a tacho gives it.
    pub phase: Option<Phase>,
    /// How the first shaft turned, when it was measured.
    pub turning: Option<Turning>,
    /// Whether lines were read at equal angles because the speed changes.
    pub is_evened: bool,
    /// Things the user should know.
    pub notes: Vec<String>,
}

/// A speed that changes by more than this within a window smears the lines of the fifth shaft
/// harmonic over tens of cells, and moves every level: such a window is transient.
pub const TRANSIENT_EXCURSION: f64 = 0.01;

impl Speed {
    /// Whether the speed changes so much that levels and lines cannot be held against those of another
    /// speed.
    #[must_use]
    pub fn is_transient(&self) -> bool {
        self.excursion > TRANSIENT_EXCURSION
    }

    /// Whether the speed is only written down, or told by one line that may be something else's: nothing in the signal confirms it,
    /// and the shaft may turn up to [`REFINE_RANGE`] faster or slower.
    #[must_use]
    pub fn is_unconfirmed(&self) -> bool {
        let is_nominal = matches!(
            self.source,
            Some(
                SpeedSource::Capture
                    | SpeedSource::Machine
                    | SpeedSource::Option
                    | SpeedSource::Estimated
            )
        );
        is_nominal && self.turning.is_none() && self.confidence <= WRITTEN
    }

    /// What it is told to, relative.
    #[must_use]
    pub fn told_to(&self) -> f64 {
        if self.is_unconfirmed() { TOLD_TO } else { CONFIRMED_TO }
    }

    /// What is said of a window whose speed changes.
    #[must_use]
    pub fn change(&self) -> String {
        format!("the speed changes by {:.1} % within the window", 100.0 * self.excursion)
    }

    /// No speed.
    #[must_use]
    pub fn unknown() -> Self {
        Self {
            first: None,
            source: None,
            confidence: 0.0,
            excursion: 0.0,
            phase: None,
            turning: None,
            is_evened: false,
            notes: Vec::new(),
        }
    }
}

/// Most confidence in a nominal speed that no line confirms.
const WRITTEN: f64 = 0.85;

/// Nominal speeds may be moved this far, relative.
pub const REFINE_RANGE: f64 = 0.03;

/// Relative error of a speed that came with the record and that nothing in it confirms.
pub const TOLD_TO: f64 = 3e-3;

/// Relative error of one that something in it confirms, at most (F1).
const CONFIRMED_TO: f64 = 1e-3;

/// A move of more than this makes the source `estimated`.
pub(super) const MOVED: f64 = 1e-3;

/// Chooses the nominal speed by precedence and refines it by the comb, if one was found.
#[must_use]
pub fn nominal(hints: SpeedHints, machine: Option<Hz>) -> Option<(Hz, SpeedSource)> {
    let offers = [
        (hints.option, SpeedSource::Option),
        (hints.capture, SpeedSource::Capture),
        (machine, SpeedSource::Machine),
    ];
    offers.into_iter().find_map(|(speed, source)| speed.map(|s| (s, source)))
}

/// Turns a nominal speed and what the spectrum says into the window's speed. Unless what it says `is_sure`, the confidence is
/// no more than in a figure that was written down (F26).
#[must_use]
pub fn settle(nominal: Hz, source: SpeedSource, comb: Option<Comb>, is_sure: bool) -> Speed {
    // Until calibrated: a comb leaves little doubt; a figure written down by an operator or a rig is
    // worth more than a name plate.
    let (first, source, confidence) = match comb {
        Some(comb) => {
            let is_moved = (comb.speed.0 / nominal.0 - 1.0).abs() > MOVED;
            let confidence = match (comb.harmonics, is_moved) {
                _ if !is_sure => WRITTEN,
                (1, _) => 0.9,
                (_, true) => 0.95,
                (_, false) => 0.98,
            };
            (comb.speed, if is_moved { SpeedSource::Estimated } else { source }, confidence)
        }
        None => match source {
            SpeedSource::Machine => (nominal, source, 0.7),
            SpeedSource::Tacho
            | SpeedSource::SpeedChannel
            | SpeedSource::Capture
            | SpeedSource::Option
            | SpeedSource::Estimated => (nominal, source, WRITTEN),
        },
    };
    Speed {
        first: Some(first),
        source: Some(source),
        confidence,
        excursion: 0.0,
        phase: None,
        turning: None,
        is_evened: false,
        notes: Vec::new(),
    }
}

/// Speeds at which a shaft is looked at as well if nothing confirms its speed (F22): with the slip of −2…+1 % they
/// reach from 5 % below to 4 % above.
pub(super) fn elsewhere(speed: &Speed) -> Vec<Elsewhere> {
    let around = speed.first.filter(|_| speed.is_unconfirmed());
    let at =
        |first: Hz, part: f64| Elsewhere { first: Hz(first.0 * (1.0 + part)), lines: Vec::new() };
    around.map_or_else(Vec::new, |first| vec![at(first, REFINE_RANGE), at(first, -REFINE_RANGE)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn precedence_is_option_capture_machine() {
        let hints = SpeedHints { option: Some(Hz(1.0)), capture: Some(Hz(2.0)) };
        assert_eq!(nominal(hints, Some(Hz(3.0))), Some((Hz(1.0), SpeedSource::Option)));
        assert_eq!(
            nominal(SpeedHints::default(), Some(Hz(3.0))),
            Some((Hz(3.0), SpeedSource::Machine))
        );
        assert_eq!(nominal(SpeedHints::default(), None), None);
    }
}
