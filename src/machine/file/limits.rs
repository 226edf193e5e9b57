//! `[limits]`: the levels of the diagnosis, and the limits that raise alarms of their own.

use super::general::ID;
use super::general::NAME;
use super::range::NumberRange;
use super::reader::Ids;
use super::reader::Need;
use super::reader::Section;
use crate::machine::ShaftIndex;
use crate::machine::alarm_limit::AlarmLimit;
use crate::machine::alarm_limit::AlarmLimits;
use crate::machine::alarm_limit::CRITERION_II_PART;
use crate::machine::alarm_limit::JudgedIn;
use crate::machine::alarm_limit::MOST_ABOVE_BOUNDARY;
use crate::machine::alarm_limit::Quantity;
use crate::machine::alarm_limit::Reference;
use crate::machine::alarm_limit::SpeedRange;
use crate::machine::alarm_limit::Startup;
use crate::machine::alarm_limit::Thresholds;
use crate::machine::limits::IsoGroup;
use crate::machine::limits::Limits;
use crate::machine::limits::VelocityZones;
use crate::machine::limits::shaft_zones;
use crate::machine::sensor::Sensor;
use crate::machine::sensor::SensorKind;
use crate::units::Hz;
use crate::units::SourceUnit;
use crate::units::Unit;

/// Velocities of limits, mm/s.
const VELOCITY_MM_PER_S: NumberRange = NumberRange::positive_up_to(10_000.0);

/// Any threshold.
const THRESHOLD: NumberRange = NumberRange::closed(-1e9, 1e9);

/// Frequencies and speeds, Hz.
const FREQUENCY_HZ: NumberRange = NumberRange::closed(0.0, 1e6);

/// Loads, in whatever unit.
const LOAD: NumberRange = NumberRange::closed(-1e12, 1e12);

/// Bins of load, at most.
const MAX_LOAD_BINS: usize = 100;

/// Delays, s.
const DELAY_S: NumberRange = NumberRange::closed(0.0, 86_400.0);

/// Part of a threshold by which a value must come back, unless stated.
const HYSTERESIS_PERCENT: f64 = 5.0;

/// Kinds of limits with their spelling.
const KINDS: &[(&str, Kind)] = &[
    ("velocity_rms", Kind::VelocityRms),
    ("displacement_rms", Kind::DisplacementRms),
    ("shaft_displacement", Kind::ShaftDisplacement),
    ("gap", Kind::Gap),
    ("band", Kind::Band),
    ("order", Kind::Order),
    ("not_1x", Kind::NotOnce),
    ("feature", Kind::Feature),
    ("velocity_change", Kind::VelocityChange),
    ("vector_change", Kind::VectorChange),
    ("vote", Kind::Vote),
];

/// Operating states with their spelling.
const STATES: [&str; 4] = ["running", "transient", "stopped", "unknown"];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    VelocityRms,
    DisplacementRms,
    ShaftDisplacement,
    Gap,
    Band,
    Order,
    NotOnce,
    Feature,
    VelocityChange,
    VectorChange,
    Vote,
}

/// What limits refer to.
pub(super) struct Parts<'p, 's> {
    pub(super) shafts: &'p Ids<'s>,
    pub(super) channels: &'p Ids<'s>,
    pub(super) sensors: &'p [Option<Sensor>],
    pub(super) iso_group: Option<IsoGroup>,
    /// Nominal speed of the first shaft.
    pub(super) speed: Option<Hz>,
}

/// Reads `[limits]`.
pub(super) fn read(mut section: Section<'_>, parts: &Parts<'_, '_>) -> (Limits, AlarmLimits) {
    let mut velocity = |key| section.number(key, Need::Optional, VELOCITY_MM_PER_S);
    let limits = Limits {
        velocity_rms_warning_mm_per_s: velocity("velocity_rms_warning_mm_per_s"),
        velocity_rms_damaged_mm_per_s: velocity("velocity_rms_damaged_mm_per_s"),
        load_bins: section.rising("load_bins", LOAD, MAX_LOAD_BINS).unwrap_or_default(),
    };
    let ends = limits.velocity_rms_warning_mm_per_s.zip(limits.velocity_rms_damaged_mm_per_s);
    if let Some((warning, _)) = ends.filter(|(warning, damaged)| warning >= damaged) {
        let allowed = format!("a number above velocity_rms_warning_mm_per_s = {warning}");
        section.refuse("velocity_rms_damaged_mm_per_s", allowed);
    }
    let startup = section.table("startup", Need::Optional).and_then(read_startup);
    let mut alarms = section.tables("alarm", Need::Optional);
    section.finish();
    let ids = Ids::read("limits.alarm", "id", &mut alarms, &ID);
    let read = alarms.into_iter().enumerate().map(|(place, section)| {
        let id = ids.get(place).map(str::to_owned);
        LimitReader { section, parts, ids: &ids, place, has_startup: startup.is_some() }.read(id)
    });
    // Where one is wrong the file is refused: places of the others do not matter then.
    let limits_read = read.collect::<Vec<_>>().into_iter().flatten().collect();
    (limits, AlarmLimits { limits: limits_read, startup })
}

fn read_startup(mut section: Section<'_>) -> Option<Startup> {
    let speed = section.interval("speed_hz", FREQUENCY_HZ);
    let max_s = section.number("max_s", Need::Required, NumberRange::positive_up_to(86_400.0));
    if !section.has("speed_hz") {
        section.missing("speed_hz", "[low, high], the speeds that a start-up passes through");
    }
    section.finish();
    let (low, high) = speed?;
    Some(Startup { speed: (Hz(low), Hz(high)), max_s: max_s? })
}

/// One `[[limits.alarm]]`.
struct LimitReader<'r, 'p, 's> {
    section: Section<'s>,
    parts: &'r Parts<'p, 's>,
    ids: &'r Ids<'s>,
    place: usize,
    has_startup: bool,
}

impl LimitReader<'_, '_, '_> {
    fn read(mut self, id: Option<String>) -> Option<AlarmLimit> {
        let kind = self.section.choice("kind", Need::Required, KINDS)?;
        let (unit, factor) = self.unit(kind);
        let quantity = self.quantity(kind, factor);
        let relative_to_baseline = self.relative(kind);
        let sensors = if kind == Kind::Vote { Vec::new() } else { self.sensors(kind, unit) };
        let (thresholds, by_speed) = self.thresholds(kind, factor);
        let n = match &quantity {
            Some(Quantity::Vote(of)) => of.len(),
            Some(_) | None => sensors.len(),
        };
        let votes = self.votes(n, kind == Kind::Vote);
        let percent = NumberRange::from_to_below(0.0, 100.0);
        let hysteresis = self.section.number("hysteresis_percent", Need::Optional, percent);
        let on_delay_s = self.section.number("on_delay_s", Need::Optional, DELAY_S);
        let off_delay_s = self.section.number("off_delay_s", Need::Optional, DELAY_S);
        let latching = self.section.flag("latching").unwrap_or(false);
        let raises = self.section.flag("raises_alarm").unwrap_or(true);
        let judged_in = self.judged_in(kind);
        let startup_multiply = self.startup_multiply();
        self.section.finish();
        Some(AlarmLimit {
            id: id?,
            quantity: quantity?,
            unit: if relative_to_baseline { Unit::One } else { unit },
            relative_to_baseline,
            sensors,
            thresholds,
            by_speed,
            hysteresis: hysteresis.unwrap_or(HYSTERESIS_PERCENT) / 100.0,
            votes,
            on_delay_s,
            off_delay_s,
            latching,
            raises,
            judged_in,
            startup_multiply,
        })
    }

    /// Canonical unit of the thresholds, and what the file's are multiplied by.
    fn unit(&mut self, kind: Kind) -> (Unit, f64) {
        let stated = match kind {
            Kind::VelocityRms | Kind::VelocityChange => {
                return (Unit::MillimetrePerSecond, 1.0);
            }
            Kind::DisplacementRms | Kind::ShaftDisplacement => return (Unit::Micrometre, 1.0),
            Kind::Vote => return (Unit::One, 1.0),
            Kind::Gap
            | Kind::Band
            | Kind::Order
            | Kind::NotOnce
            | Kind::Feature
            | Kind::VectorChange => self.section.text("unit", Need::Optional, &NAME),
        };
        let Some(stated) = stated else {
            let is_relative = self.section.has("relative_to") || kind == Kind::Feature;
            if !is_relative && !self.section.has("unit") {
                self.section.missing("unit", SourceUnit::ACCEPTED.join(", "));
            }
            return (Unit::One, 1.0);
        };
        match SourceUnit::parse(stated) {
            Some(unit) => (unit.canonical, unit.factor),
            None => {
                self.section.refuse("unit", SourceUnit::ACCEPTED.join(", "));
                (Unit::One, 1.0)
            }
        }
    }

    fn quantity(&mut self, kind: Kind, factor: f64) -> Option<Quantity> {
        match kind {
            Kind::VelocityRms => Some(Quantity::VelocityRms),
            Kind::DisplacementRms => Some(Quantity::DisplacementRms),
            Kind::ShaftDisplacement => Some(Quantity::PeakToPeak),
            Kind::Gap => Some(Quantity::Gap),
            Kind::Band => {
                let band = self.section.interval("band_hz", FREQUENCY_HZ);
                if !self.section.has("band_hz") {
                    self.section.missing("band_hz", "[low, high] in Hz");
                }
                band.map(|(low, high)| Quantity::Band { low: Hz(low), high: Hz(high) })
            }
            Kind::Order => {
                let range = NumberRange::positive_up_to(200.0);
                let order = self.section.number("order", Need::Required, range);
                let shaft = self.shaft();
                Some(Quantity::Order { shaft: shaft?, order: order? })
            }
            Kind::NotOnce => self.shaft().map(|shaft| Quantity::NotOnce { shaft }),
            Kind::Feature => {
                let name = self.section.text("feature", Need::Required, &NAME);
                name.map(|name| Quantity::Feature(name.to_owned()))
            }
            Kind::VelocityChange => {
                let range = NumberRange::closed(0.0, 10_000.0);
                let reference = self.section.number("reference_mm_per_s", Need::Required, range);
                reference.map(|mm_per_s| Quantity::Change(Reference::VelocityRms { mm_per_s }))
            }
            Kind::VectorChange => {
                let range = NumberRange::closed(0.0, 1e9);
                let amplitude = self.section.number("reference", Need::Required, range);
                let degrees = NumberRange::closed(-360.0, 360.0);
                let phase_deg = self.section.number("reference_phase_deg", Need::Required, degrees);
                Some(Quantity::Change(Reference::Vector {
                    amplitude: amplitude? * factor,
                    phase_deg: phase_deg?,
                }))
            }
            Kind::Vote => {
                let of = self.section.references("of", Need::Required, self.ids)?;
                // Only limits above, and no vote of itself: so none can wait for another.
                if of.iter().any(|place| *place >= self.place) || of.is_empty() {
                    self.section.refuse("of", "ids of one or more [[limits.alarm]] above this one");
                    return None;
                }
                Some(Quantity::Vote(of))
            }
        }
    }

    /// The shaft named, or the first.
    fn shaft(&mut self) -> Option<ShaftIndex> {
        if !self.section.has("shaft") {
            // Known, so that it is listed among the keys.
            let _absent = self.section.reference("shaft", Need::Optional, self.parts.shafts);
            return Some(ShaftIndex(0));
        }
        self.section.reference("shaft", Need::Required, self.parts.shafts).map(ShaftIndex)
    }

    fn relative(&mut self, kind: Kind) -> bool {
        let can_be = matches!(kind, Kind::Band | Kind::Order | Kind::NotOnce | Kind::Feature);
        let choices: &[(&str, bool)] = &[("baseline", true)];
        can_be && self.section.choice("relative_to", Need::Optional, choices).unwrap_or(false)
    }

    /// Sensors by their channels, or all that the kind applies to.
    fn sensors(&mut self, kind: Kind, unit: Unit) -> Vec<usize> {
        let applies = |sensor: &Sensor| match kind {
            Kind::Gap | Kind::ShaftDisplacement => sensor.kind == SensorKind::Proximitor,
            Kind::VelocityRms | Kind::DisplacementRms | Kind::VelocityChange => {
                matches!(sensor.kind, SensorKind::Accelerometer | SensorKind::Velocity)
            }
            Kind::Band
            | Kind::Order
            | Kind::NotOnce
            | Kind::Feature
            | Kind::VectorChange
            | Kind::Vote => sensor.kind.is_vibration(),
        };
        let has_unit = |sensor: &Sensor| {
            kind == Kind::Feature
                || unit == Unit::One
                || sensor.canonical_unit().is_none_or(|own| own == unit)
                || matches!(kind, Kind::VelocityRms | Kind::DisplacementRms | Kind::VelocityChange)
        };
        let fits = |sensor: &Sensor| applies(sensor) && has_unit(sensor);
        let sensors = self.parts.sensors;
        let Some(named) = self.section.references("channels", Need::Optional, self.parts.channels)
        else {
            let all = sensors.iter().enumerate();
            let all = all.filter(|(_, sensor)| sensor.as_ref().is_some_and(fits));
            let all: Vec<usize> = all.map(|(place, _)| place).collect();
            if all.is_empty() && !self.section.has("channels") {
                self.section.missing("channels", "a [[sensor]] that this limit applies to");
            }
            return all;
        };
        let misfit = named.iter().filter_map(|place| sensors[*place].as_ref());
        if let Some(sensor) = misfit.into_iter().find(|sensor| !fits(sensor)) {
            let allowed = format!(
                "channels of sensors that this kind and unit apply to; `{}` is not one",
                sensor.channel
            );
            self.section.refuse("channels", allowed);
        }
        named
    }

    fn thresholds(&mut self, kind: Kind, factor: f64) -> (Thresholds, Vec<SpeedRange>) {
        if kind == Kind::Vote {
            return (Thresholds::default(), Vec::new());
        }
        let baseline = (kind == Kind::VelocityRms)
            .then(|| self.section.number("baseline_mm_per_s", Need::Optional, VELOCITY_MM_PER_S))
            .flatten();
        let mut number =
            |key| self.section.number(key, Need::Optional, THRESHOLD).map(|value| value * factor);
        let mut stated = Thresholds {
            warning_above: number("warning_above"),
            damaged_above: number("damaged_above"),
            ..Thresholds::default()
        };
        if kind == Kind::Gap {
            stated.warning_below = number("warning_below");
            stated.damaged_below = number("damaged_below");
        }
        let rows = self.section.rows(
            "by_speed",
            Need::Optional,
            4,
            "rows of [from Hz, to Hz, warning_above, damaged_above], rising",
        );
        let by_speed = rows.map_or(Vec::new(), |rows| self.by_speed(&rows, factor));
        let zones = self.parts.iso_group.and_then(IsoGroup::velocity_zones);
        let is_displacement = matches!(kind, Kind::DisplacementRms | Kind::ShaftDisplacement);
        let from_zones = if is_displacement {
            self.of_displacements(kind)
        } else {
            self.of_zones(kind, zones, baseline)
        };
        let thresholds = Thresholds {
            warning_above: stated.warning_above.or(from_zones.warning_above),
            damaged_above: stated.damaged_above.or(from_zones.damaged_above),
            ..stated
        };
        self.check_order(&thresholds);
        if self.section.has("by_speed") {
            if !stated.is_empty() {
                self.section.refuse("by_speed", "either it or limits for every speed, not both");
            }
            return (Thresholds::default(), by_speed);
        }
        if thresholds.is_empty() {
            let keys = if kind == Kind::ShaftDisplacement {
                "warning_above or damaged_above, by_speed, or max_speed_hz between 16.67 and 500"
            } else {
                "warning_above or damaged_above, by_speed, or iso_group where it applies"
            };
            self.section.missing("warning_above", keys);
        }
        (thresholds, by_speed)
    }

    /// Limits that follow from the machine's ISO group, for those that are not stated.
    fn of_zones(
        &self,
        kind: Kind,
        zones: Option<VelocityZones>,
        baseline: Option<f64>,
    ) -> Thresholds {
        let none = Thresholds::default();
        match (kind, zones) {
            (Kind::VelocityRms, Some(zones)) => baseline.map_or(Thresholds::of_zones(zones), |b| {
                Thresholds::of_zones_and_baseline(zones, b)
            }),
            (Kind::VelocityRms, None) if baseline.is_some() => {
                self.section.refuse("baseline_mm_per_s", "with machine.iso_group only");
                none
            }
            (Kind::VelocityChange, Some(zones)) => {
                let warning = CRITERION_II_PART * zones.b_c_mm_per_s;
                Thresholds { warning_above: Some(warning), ..none }
            }
            _ => none,
        }
    }

    /// Limits of a displacement that follow from the machine's ISO group, or from the speed of its shaft.
    fn of_displacements(&mut self, kind: Kind) -> Thresholds {
        let zones = if kind == Kind::ShaftDisplacement {
            let range = NumberRange::positive_up_to(1e6);
            let stated = self.section.number("max_speed_hz", Need::Optional, range).map(Hz);
            stated.or(self.parts.speed).and_then(shaft_zones)
        } else {
            self.parts.iso_group.and_then(IsoGroup::displacement_zones)
        };
        zones.map_or(Thresholds::default(), Thresholds::of_displacement_zones)
    }

    fn check_order(&self, thresholds: &Thresholds) {
        let above = thresholds.warning_above.zip(thresholds.damaged_above);
        if above.is_some_and(|(warning, damaged)| warning >= damaged) {
            self.section.refuse("damaged_above", "a number above the limit of the warning");
        }
        let below = thresholds.warning_below.zip(thresholds.damaged_below);
        if below.is_some_and(|(warning, damaged)| warning <= damaged) {
            self.section.refuse("damaged_below", "a number below the limit of the warning");
        }
        let zones = self.parts.iso_group.and_then(IsoGroup::velocity_zones);
        let most = zones.map(|zones| MOST_ABOVE_BOUNDARY * zones.c_d_mm_per_s);
        let is_velocity = !self.section.has("unit") && self.section.has("baseline_mm_per_s");
        if let (true, Some(most), Some(damaged)) = (is_velocity, most, thresholds.damaged_above)
            && damaged > most
        {
            self.section.refuse("damaged_above", format!("at most 1.25 C/D = {most} mm/s"));
        }
    }

    fn by_speed(&self, rows: &[Vec<f64>], factor: f64) -> Vec<SpeedRange> {
        let mut ranges: Vec<SpeedRange> = Vec::new();
        for row in rows {
            let [low, high, warning, damaged] = row[..] else { continue };
            let is_behind = ranges.last().is_none_or(|last| low >= last.high.0);
            if !(low >= 0.0 && low < high && warning < damaged && is_behind) {
                let allowed = "rows of [from Hz, to Hz, warning_above, damaged_above], each rising, none \
                               overlapping";
                self.section.refuse("by_speed", allowed);
                return ranges;
            }
            let thresholds = Thresholds {
                warning_above: Some(warning * factor),
                damaged_above: Some(damaged * factor),
                ..Thresholds::default()
            };
            ranges.push(SpeedRange { low: Hz(low), high: Hz(high), thresholds });
        }
        ranges
    }

    fn votes(&mut self, n: usize, is_vote: bool) -> usize {
        let most = u32::try_from(n).unwrap_or(u32::MAX).max(1);
        let need = if is_vote { Need::Required } else { Need::Optional };
        let votes = self.section.whole("votes", need, 1..=most);
        votes.and_then(|votes| usize::try_from(votes).ok()).unwrap_or(1)
    }

    fn judged_in(&mut self, kind: Kind) -> JudgedIn {
        let default = match kind {
            Kind::Gap | Kind::Vote => JudgedIn::ALWAYS,
            Kind::VelocityRms
            | Kind::DisplacementRms
            | Kind::ShaftDisplacement
            | Kind::Band
            | Kind::Order
            | Kind::NotOnce
            | Kind::Feature
            | Kind::VelocityChange
            | Kind::VectorChange => JudgedIn::STEADY,
        };
        let Some(states) = self.section.words("states", &STATES) else { return default };
        let has = |state: &str| states.contains(&state);
        JudgedIn {
            running: has("running"),
            transient: has("transient"),
            stopped: has("stopped"),
            unknown: has("unknown"),
        }
    }

    fn startup_multiply(&mut self) -> Option<f64> {
        let range = NumberRange::closed(1.0, 10.0);
        let multiply = self.section.number("startup_multiply", Need::Optional, range);
        if multiply.is_some() && !self.has_startup {
            let allowed = "with [limits.startup], which declares the transient it holds in";
            self.section.refuse("startup_multiply", allowed);
        }
        multiply
    }
}
