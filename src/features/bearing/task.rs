//! What a reader is given: a band's depth spectrum, the line to look for, and the lines of the machine to keep clear of.
//!
//! Must not know how a line is read.

use super::DefectLine;
use crate::machine::uncertainty::RelativeBand;
use crate::units::Hz;

/// A known line of the machine that must not be read as a defect's.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownLine {
    /// Its rate.
    pub frequency: Hz,
    /// Distance of the lines of its series.
    pub spacing: Hz,
    /// What it is, for people.
    pub label: String,
}

/// What a search needs to know besides the spectrum.
#[derive(Debug, Clone)]
pub struct LineTask<'a> {
    /// Which line.
    pub line: DefectLine,
    /// Kinematic rate.
    pub expected: Hz,
    /// Limits of that rate which the geometry leaves, slip not counted.
    pub band: RelativeBand,
    /// Spacing of the side bands: 1× for races that turn, FTF for the rolling element.
    pub side_band_spacing: Hz,
    /// Of a race's line: the cage's rate seen from that race.
    pub cage_spacing: Option<Hz>,
    /// Of a race's line: where that of the rolling elements is searched.
    pub element_range: Option<(Hz, Hz)>,
    /// Whether it is the line of the race that does not turn.
    pub is_at_rest: bool,
    /// Of the line of the race that turns: the sum of both races' rates. What the line lacks to it is the rate at which
    /// elements pass the race at rest.
    pub sum_of_races: Option<Hz>,
    /// Speed of the bearing's shaft.
    pub shaft_speed: Hz,
    /// Lines to keep clear of.
    pub known: &'a [KnownLine],
    /// Relative error of their rates: what the speed is told to.
    pub known_to: f64,
    /// Half width of what a known line occupies, Hz.
    pub resolution: Hz,
    /// Half width of the noise floor's neighbourhood, Hz.
    pub floor_half_width: Hz,
}

/// Modulation-depth spectrum of one band: bin k at k·`bin_hz`.
#[derive(Debug, Clone, Copy)]
pub struct DepthSpectrum<'a> {
    /// Depths.
    pub depth: &'a [f32],
    /// Bin spacing, Hz (half the resolution 1/T: padded twice).
    pub bin_hz: f64,
    /// Duration T of the window, s.
    pub duration_s: f64,
    /// Mean of the squared envelope, u².
    pub mean_square: f64,
    /// The tone that carries most of the band's energy, if one does.
    pub tone: Option<Hz>,
}
