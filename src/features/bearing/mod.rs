//! Bearing defect lines in the squared-envelope spectrum: searched, read, not judged.
//!
//! For each bearing, channel, demodulation band and defect line the fundamental is searched within
//! slip and geometry tolerance, then its harmonics are read at multiples of what was found. What is
//! handed on are power ratios to the local noise floor and modulation depths, with everything the
//! false-alarm probability needs: cells searched, degrees of freedom of the floor (docs/theory.md,
//! F5–F8).

mod carrier;
mod covered;
mod mirrored;
mod noise;
mod outdone;
mod read;
mod slower;
mod spread;
mod task;

use super::Feature;
use super::bands;
use super::bands::Band;
use super::reach::searched_range;
use super::targets;
use super::trace::Trace;
use crate::machine::BearingIndex;
use crate::machine::Machine;
use crate::machine::bearing::FaultRates;
use crate::machine::bearing::RotatingRing;
use crate::machine::uncertainty::OrderBands;
use crate::machine::uncertainty::RelativeBand;
use crate::signal::ChannelIndex;
use crate::units::Hz;
use crate::units::Unit;
use std::sync::Arc;

pub use carrier::leading_tone;
pub use covered::Covered;
pub use covered::STANDS_ALONE;
pub use covered::read_covered;
pub use read::coinciding;
pub(super) use read::depth_at;
pub use read::read_line;
pub use task::DepthSpectrum;
pub use task::KnownLine;
pub use task::LineTask;

/// Harmonics read of each line, the fundamental included.
pub const N_HARMONICS: usize = 4;

/// A defect's line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum DefectLine {
    /// Inner race.
    Bpfi,
    /// Outer race.
    Bpfo,
    /// Rolling element: it strikes both races, so twice the ball-spin rate.
    TwoBsf,
    /// Cage.
    Ftf,
}

impl DefectLine {
    /// All lines, in the order they are searched.
    pub const ALL: [Self; 4] = [Self::Bpfi, Self::Bpfo, Self::TwoBsf, Self::Ftf];

    /// The line of a defect on the race that turns with this ring.
    #[must_use]
    pub fn of_turning_race(ring: RotatingRing) -> Self {
        match ring {
            RotatingRing::Inner => Self::Bpfi,
            RotatingRing::Outer => Self::Bpfo,
        }
    }

    /// The line of a defect on the race at rest while this ring turns.
    #[must_use]
    pub fn of_race_at_rest(ring: RotatingRing) -> Self {
        match ring {
            RotatingRing::Inner => Self::Bpfo,
            RotatingRing::Outer => Self::Bpfi,
        }
    }

    /// The field's name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Bpfi => "BPFI",
            Self::Bpfo => "BPFO",
            Self::TwoBsf => "2·BSF",
            Self::Ftf => "FTF",
        }
    }

    /// Name in indicators.
    #[must_use]
    pub fn slug(self) -> &'static str {
        match self {
            Self::Bpfi => "bpfi",
            Self::Bpfo => "bpfo",
            Self::TwoBsf => "2bsf",
            Self::Ftf => "ftf",
        }
    }

    /// Kinematic rate of the line, without sign.
    #[must_use]
    pub fn rate_of(self, rates: &FaultRates) -> Hz {
        match self {
            Self::Bpfi => rates.bpfi,
            Self::Bpfo => rates.bpfo,
            Self::TwoBsf => rates.two_bsf(),
            Self::Ftf => Hz(rates.ftf.0.abs()),
        }
    }

    /// Relative tolerance of the line's rate around the kinematic value: slip −2…+1 % for the races
    /// and the cage, ± 2 % for the rolling element, whose contact angle varies. A cage 2 % slow lowers BPFO by as much and raises BPFI by up to
    /// 1.4 % (of 2 % the part (1 − γ)/(1 + γ), γ = 0.17 and more).
    #[must_use]
    pub fn tolerance(self) -> RelativeBand {
        match self {
            Self::Bpfi => RelativeBand { low: -0.02, high: 0.014 },
            Self::Bpfo | Self::Ftf => RelativeBand { low: -0.02, high: 0.01 },
            Self::TwoBsf => RelativeBand { low: -0.02, high: 0.02 },
        }
    }

    /// What a bearing's geometry leaves open of this line's rate.
    #[must_use]
    pub fn band_of(self, bands: &OrderBands) -> RelativeBand {
        match self {
            Self::Bpfi => bands.bpfi,
            Self::Bpfo => bands.bpfo,
            Self::TwoBsf => bands.two_bsf,
            Self::Ftf => bands.ftf,
        }
    }
}

/// One harmonic as read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Harmonic {
    /// Power of the line ÷ expected power of the noise floor at its place (1 = floor).
    pub power_ratio: f64,
    /// Modulation depth: amplitude of the squared envelope ÷ its mean.
    pub depth: f64,
    /// Independent spectral estimates the floor rests on.
    pub floor_dof: f64,
    /// What the maximum was taken over.
    pub searched: Searched,
}

/// Which bins of a spectrum padded twice a maximum was taken over (F5): what a search costs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Searched {
    /// Bins, half a step of 1/T apart, that nothing else covers.
    pub bins: f64,
    /// Runs of bins that were taken as they are, whether local maxima or not: at its ends a run may hold the skirt of
    /// what lies outside. 0 where only local maxima count.
    pub runs: f64,
}

/// √((1 − r)/(1 + r)) of the amplitudes of noise, Hann window, in bins half a step apart: r = S(½)/S(0) = 0.9054, S the
/// transform of the squared window.
const HALF_STEP: f64 = 0.2228;

impl Searched {
    /// Local maxima among so many bins.
    #[must_use]
    pub const fn peaks(bins: f64) -> Self {
        Self { bins, runs: 0.0 }
    }

    /// The largest of so many bins in so many runs.
    #[must_use]
    pub const fn largest(bins: f64, runs: f64) -> Self {
        Self { bins, runs }
    }

    /// Independent cells the search is worth at a power ratio (F5): the peaks of noise get narrower with their height, so more
    /// of them find room. `power_ratio` over the floor that is known to be there.
    #[must_use]
    pub fn cells(&self, power_ratio: f64) -> f64 {
        let apart = libm::erf(HALF_STEP * power_ratio.max(0.0).sqrt());
        self.bins * apart + self.runs * (1.0 - apart)
    }
}

/// Standard deviations below a measured amplitude that must still matter: one side, 5 %.
const DEVIATIONS: f64 = 1.645;

/// Lower end of an amplitude in noise over the one measured (C9): noise adds to it with a standard deviation of 1/√(2·R) of it, R its
/// power over the noise's.
#[must_use]
pub fn least_part(power_ratio: f64) -> f64 {
    let spread = if power_ratio > 0.0 { DEVIATIONS / (2.0 * power_ratio).sqrt() } else { 0.0 };
    (1.0 - spread).max(0.0)
}

/// A line as read in one band.
#[derive(Debug, Clone, PartialEq)]
pub struct BandReading {
    /// The band.
    pub band: Band,
    /// Rate found: least squares over the harmonics that stand out.
    pub frequency: Hz,
    /// Harmonics 1…; `None` where a known line of the machine lies or the spectrum ends.
    pub harmonics: [Option<Harmonic>; N_HARMONICS],
    /// The stronger of the two side bands at ± the spacing around the fundamental, or the harmonic that stands for it (F5).
    pub side_band: Option<Harmonic>,
    /// Of a race's line that stands out: the stronger of the two side bands at ± the cage's rate seen from that race, at which one element comes back.
    pub cage_band: Option<Harmonic>,
    /// Depth of the deeper of the two shaft harmonics around the fundamental; 0 if neither can be read.
    pub shaft_depth: f64,
    /// Of the line of the turning race: depth at the rate at which elements pass the race at rest; `None` of other lines.
    pub passing_depth: Option<f64>,
    /// A slower rate whose harmonic the line is: what is struck at that rate has lines at every multiple.
    pub slower: Option<Hz>,
    /// Whether a race at rest or a rolling element shows stronger side bands at the shaft's speed than full modulation makes:
    /// then the events are the shaft's, and passing elements modulate them.
    pub is_shaft_product: bool,
    /// Whether a line half as deep stands as far on the other side of the nearest shaft harmonic: then both are side lines of that, of events of the
    /// shaft that swing.
    pub is_mirrored: bool,
    /// A tone that carries most of the band's energy and is none of the line's multiples: what is read then is
    /// that tone's modulation, not impacts.
    pub carrier: Option<Hz>,
    /// A side band surely higher than the fundamental, or the harmonic that stands for it: its own never is, so the line is a side
    /// band of that (F28).
    pub outdone_by: Option<Hz>,
    /// Mean of the squared envelope, u².
    pub mean_square: f64,
}

/// A harmonic modulated in full has side lines of half its height: cos a·(1 + cos b).
const FULL_MODULATION: f64 = 0.5;

/// How much higher than the shaft's own lines a line is that no events of the shaft make: however sharply what passes modulates them, they
/// have side lines no higher than themselves (F12, C49).
pub const OVER_SHAFT: f64 = 1.2;

/// Depth of the shaft's harmonics from which its events may hide a defect (F31): as deep as a line that accuses, a quarter of the band's energy.
const HIDING_DEPTH: f64 = 0.5;

/// The elements are taken to modulate this much deeper than the line at their rate says (6 dB): other lines may
/// stand at the same place and against it.
const PASSING_MARGIN: f64 = 2.0;

impl BandReading {
    /// For tests: harmonics at `frequency` in `band`, with nothing else to explain them.
    #[cfg(test)]
    pub(crate) fn of_test(band: Band, frequency: Hz, harmonics: &[Harmonic]) -> Self {
        let mut read = [None; N_HARMONICS];
        read.iter_mut().zip(harmonics).for_each(|(slot, harmonic)| *slot = Some(*harmonic));
        Self {
            band,
            frequency,
            harmonics: read,
            side_band: None,
            cage_band: None,
            shaft_depth: 0.0,
            passing_depth: None,
            slower: None,
            is_shaft_product: false,
            is_mirrored: false,
            carrier: None,
            outdone_by: None,
            mean_square: 1.0,
        }
    }

    /// Whether the fundamental may be a side line of what happens once a revolution (F12): events of
    /// the shaft that passing elements modulate have lines k·f ± BPFO, one of which is BPFI, and none
    /// higher than half the shaft's harmonics beside it, times the depth at BPFO itself, which shows how
    /// far the elements modulate. A defect's own impacts stand over them.
    #[must_use]
    pub fn is_modulated_shaft(&self) -> bool {
        let modulation = self.passing_depth.map_or(1.0, |depth| (PASSING_MARGIN * depth).min(1.0));
        self.harmonics[0]
            .is_some_and(|h| h.depth <= FULL_MODULATION * self.shaft_depth * modulation)
    }

    /// Whether the shaft's events hold a quarter of the band's energy at this line's place: of what else there is the depth is small then, however
    /// far it stands out (F31).
    #[must_use]
    pub fn is_under_events(&self) -> bool {
        self.shaft_depth >= HIDING_DEPTH
    }

    /// Whether this line of the turning race is higher than any side line of events that elements modulate which pass the race at
    /// rest: with harmonics of twice the mean at most, none is higher than the depth at the elements' own rate.
    #[must_use]
    pub fn stands_over_passing(&self) -> bool {
        let depth = self.harmonics[0].map_or(0.0, |h| h.depth);
        self.passing_depth.is_some_and(|passing| depth > PASSING_MARGIN * passing)
    }

    /// Depth of the fundamental over that of the shaft's events around it; infinite where there are none.
    #[must_use]
    pub fn over_events(&self) -> f64 {
        self.harmonics[0].map_or(0.0, |h| h.depth / self.shaft_depth)
    }

    /// Whether something else than a defect explains the fundamental: the shaft's events, strikes at a
    /// slower rate, or one tone that is modulated.
    #[must_use]
    pub fn is_explained(&self) -> bool {
        self.slower.is_some()
            || self.carrier.is_some()
            || self.is_shaft_product
            || self.is_mirrored
            || self.is_modulated_shaft()
    }

    /// Whether side bands at the shaft's speed that are more than half as high are all that explains it (F12): a load that turns with the
    /// shaft makes as high ones beside a defect of the race at rest.
    #[must_use]
    pub fn is_of_turning_load(&self) -> bool {
        let rest = Self { is_shaft_product: false, ..self.clone() };
        self.is_shaft_product && !rest.is_explained()
    }

    /// The reading without the higher harmonics that `explained` claims: what is another's adds nothing.
    #[must_use]
    pub fn without_harmonics(&self, explained: impl Fn(Hz) -> bool) -> Self {
        let mut own = self.clone();
        for (k, harmonic) in own.harmonics.iter_mut().enumerate().skip(1) {
            if explained(Hz((k + 1) as f64 * self.frequency.0)) {
                *harmonic = None;
            }
        }
        own
    }

    /// Whether all its harmonics stand out.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        self.harmonics.iter().all(|harmonic| harmonic.is_some_and(read::stands_out))
    }

    /// Root of the summed squared depths of all harmonics read: the effect size D (F8).
    #[must_use]
    pub fn total_depth(&self) -> f64 {
        self.harmonics.iter().flatten().map(|h| h.depth * h.depth).sum::<f64>().sqrt()
    }
}

/// Why a line could not be looked for.
#[derive(Debug, Clone, PartialEq)]
pub enum Unreadable {
    /// The channel's band ends below what demodulation of this line needs.
    TooSlow {
        /// Upper end of the usable band.
        usable: Hz,
        /// Needed.
        needed: Hz,
    },
    /// The window holds too few revolutions or cannot separate the line from its neighbours.
    TooShort {
        /// Length needed, s.
        needed_s: f64,
    },
    /// The limits of the bearing's geometry leave room for two lines at one place.
    GeometryUncertain {
        /// The other line.
        with: DefectLine,
        /// Limits of this line's rate.
        band: RelativeBand,
    },
}

/// The search for one line of one bearing in one channel.
#[derive(Debug, Clone, PartialEq)]
pub struct LineSearch {
    /// Which bearing.
    pub bearing: BearingIndex,
    /// Which channel.
    pub channel: ChannelIndex,
    /// Which line.
    pub line: DefectLine,
    /// Whether it is that of the race at rest, which all elements pass.
    pub is_at_rest: bool,
    /// Kinematic rate.
    pub expected: Hz,
    /// Limits of that rate which the geometry leaves, slip not counted.
    pub band: RelativeBand,
    /// Speed of the bearing's shaft.
    pub shaft_speed: Hz,
    /// Spacing of the line's side bands.
    pub side_band_spacing: Hz,
    /// Smallest distance at which two lines can be told apart, Hz.
    pub resolution: Hz,
    /// First sample and one past the last.
    pub sample_range: (u64, u64),
    /// The readings, one a band, or why there are none.
    pub outcome: Result<Vec<BandReading>, Unreadable>,
    /// What stands where known lines of the machine lie, within the resolution, one a band at most.
    pub covered: Vec<Covered>,
    /// The known line within the resolution of the kinematic rate, if any: slip alone takes the line out of its reach.
    pub coincides: Option<String>,
    /// The readings in the octaves of the lowest band where that is wide, from the lowest up (F4): they tell what is below from what rings above, and
    /// are asked nothing else.
    pub octaves: Vec<BandReading>,
}

impl LineSearch {
    /// Whether it is the line of the race that turns.
    #[must_use]
    pub fn is_of_turning_race(&self) -> bool {
        !self.is_at_rest && matches!(self.line, DefectLine::Bpfi | DefectLine::Bpfo)
    }

    /// Length of the window, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        targets::HANN_LOBE / self.resolution.0
    }

    /// Revolutions of the bearing's shaft in the window.
    #[must_use]
    pub fn revolutions(&self) -> f64 {
        self.duration_s() * self.shaft_speed.0
    }

    /// Depth of the fundamental, or of what noise leaves in its place, that a quarter of the bands reach (F27): what baselines and trends hold.
    /// `None` where it could not be read, or where most of it lies.
    #[must_use]
    pub fn usual_depth(&self) -> Option<f64> {
        let readings = self.outcome.as_deref().ok().filter(|_| self.coincides.is_none())?;
        let depth = |r: &BandReading| r.harmonics[0].map_or(0.0, |h| h.depth);
        Some(bands::quarter_reach(readings.iter().map(depth))).filter(|depth| *depth > 0.0)
    }
}

/// Name of the feature "modulation depth of `line` of `bearing`" of a channel (F27).
#[must_use]
pub fn line_name(line: DefectLine, bearing: &str) -> String {
    format!("envelope_{}_{bearing}", line.slug())
}

/// Adds the depths of the lines to the features of their channels.
pub(super) fn keep(machine: &Machine, searches: &[LineSearch], traces: &mut [Trace<'_>]) {
    for trace in traces {
        let own = searches.iter().filter(|search| search.channel == trace.channel);
        trace.features.extend(own.filter_map(|search| {
            let name = Arc::from(line_name(search.line, &machine.bearing(search.bearing).id));
            search.usual_depth().map(|value| Feature { name, value, unit: Unit::One })
        }));
    }
}

#[cfg(test)]
mod tests;
