//! Values against stated limits: which are exceeded in a window, with hysteresis and votes.
//!
//! The levels of the diagnosis (`velocity_rms_*_mm_per_s`, zones of the ISO group, ratios to the baseline)
//! are judged in `diagnosis::level` and raise the machine's alarm there; what stands here are the limits
//! of `[[limits.alarm]]`, each with an alarm of its own. Delays, latching and lives belong to the engine.

use super::policy::Level;
use super::policy::Observation;
use crate::diagnosis::baseline::Baseline;
use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::verdict::OperatingState;
use crate::features::ChannelFeatures;
use crate::features::limit;
use crate::features::overall;
use crate::features::vector;
use crate::machine::Component;
use crate::machine::Machine;
use crate::machine::alarm_limit::AlarmLimit;
use crate::machine::alarm_limit::Quantity;
use crate::machine::alarm_limit::Reference;
use crate::machine::alarm_limit::SpeedRange;
use crate::machine::alarm_limit::Startup;
use crate::machine::alarm_limit::Thresholds;
use crate::signal::ChannelIndex;
use crate::signal::ChannelInfo;
use crate::units::Hz;
use crate::units::Unit;

/// What was measured in a window.
#[derive(Debug, Clone, Copy)]
pub struct Measured<'a> {
    /// Whether the machine ran.
    pub operating: OperatingState,
    /// Speed of the first shaft.
    pub speed: Option<Hz>,
    /// Features by channel, channels rising.
    pub channels: &'a [ChannelFeatures],
    /// Baseline at this speed.
    pub baseline: &'a Baseline,
}

/// Which features make a limit's value, and how.
#[derive(Debug, Clone, PartialEq)]
enum Recipe {
    /// The feature itself.
    One(String),
    /// √(RMS² − A²/2), A the line's amplitude.
    Without { rms: String, line: String },
    /// |value − reference|.
    Distance { from: String, reference: f64 },
    /// |(cos, sin) − reference|.
    VectorDistance { reference: (f64, f64) },
    /// Other limits, by their places.
    Vote(Vec<usize>),
}

/// One channel of a limit.
#[derive(Debug, Clone)]
struct Member {
    /// Its place among the limit's sensors.
    place: usize,
    channel: ChannelIndex,
    name: String,
    /// Where its features stood in the window before: they stand there again.
    hints: [usize; 2],
    level: Option<Level>,
    value: Option<f64>,
}

/// One limit of a stream.
#[derive(Debug, Clone)]
pub struct LimitJudge {
    limit: AlarmLimit,
    recipe: Recipe,
    members: Vec<Member>,
    /// Levels of all its sensors, with those that have no channel in this stream: they had one in another.
    levels: Vec<Option<Level>>,
    place: (ComponentKind, String),
}

/// Value and thresholds of the worst channel, for the sentence of an alarm.
#[derive(Debug, Clone, PartialEq)]
pub struct Exceeded {
    /// Channel.
    pub channel: String,
    /// Its value.
    pub value: f64,
}

impl LimitJudge {
    /// Prepares a limit of `machine` for a stream of `channels`; a sensor without a channel takes no part.
    #[must_use]
    pub fn new(machine: &Machine, limit: &AlarmLimit, channels: &[ChannelInfo]) -> Self {
        let members = limit.sensors.iter().enumerate().filter_map(|(place, sensor)| {
            let name = &machine.sensors.get(*sensor)?.channel;
            let channel = channels.iter().position(|channel| channel.name == *name)?;
            Some(Member {
                place,
                channel: ChannelIndex(channel),
                name: name.clone(),
                hints: [0; 2],
                level: None,
                value: None,
            })
        });
        Self {
            recipe: recipe(machine, &limit.quantity),
            members: members.collect(),
            levels: vec![None; limit.sensors.len()],
            place: place(machine, limit),
            limit: limit.clone(),
        }
    }

    /// The levels of its sensors, which hysteresis holds, in the order of the machine file: whatever channels a stream has.
    #[must_use]
    pub fn levels(&self) -> Vec<Option<Level>> {
        let mut levels = self.levels.clone();
        for member in &self.members {
            levels[member.place] = member.level;
        }
        levels
    }

    /// Goes on with levels that [`Self::levels`] gave; false: they are of another limit.
    pub fn resume(&mut self, levels: &[Option<Level>]) -> bool {
        if levels.len() != self.levels.len() {
            return false;
        }
        self.levels = levels.to_vec();
        for member in &mut self.members {
            member.level = levels[member.place];
        }
        true
    }

    /// Whether another judges the same limit in the same channels.
    #[must_use]
    pub fn is_same(&self, other: &Self) -> bool {
        let names = |judge: &Self| -> Vec<String> {
            judge.members.iter().map(|member| member.name.clone()).collect()
        };
        self.limit == other.limit && names(self) == names(other)
    }

    /// The limit.
    #[must_use]
    pub fn limit(&self) -> &AlarmLimit {
        &self.limit
    }

    /// The features it is made of, each with its channel; none of a vote.
    #[must_use]
    pub fn needs(&self) -> Vec<(&str, &str)> {
        let features: Vec<&str> = match &self.recipe {
            Recipe::One(name) => vec![name],
            Recipe::Without { rms, line } => vec![rms, line],
            Recipe::Distance { from, .. } => vec![from],
            Recipe::VectorDistance { .. } => vec![vector::COS, vector::SIN],
            Recipe::Vote(_) => Vec::new(),
        };
        let members = self.members.iter();
        members.flat_map(|m| features.iter().map(|feature| (m.name.as_str(), *feature))).collect()
    }

    /// The component it watches: that of its sensors if they sit at one, else the machine.
    #[must_use]
    pub fn place(&self) -> (ComponentKind, &str) {
        (self.place.0, &self.place.1)
    }

    /// Judges a window. `others`: what the limits before this one gave; `is_startup`: a declared
    /// transient.
    pub fn observe(
        &mut self,
        measured: &Measured<'_>,
        is_startup: bool,
        others: &[Observation],
    ) -> Observation {
        let startup = self.limit.startup_multiply.filter(|_| is_startup);
        let is_judged = match measured.operating {
            OperatingState::Running => self.limit.judged_in.running,
            OperatingState::Transient => self.limit.judged_in.transient || startup.is_some(),
            OperatingState::Stopped => self.limit.judged_in.stopped,
            OperatingState::Unknown => self.limit.judged_in.unknown,
        };
        if !is_judged {
            return Observation::NotJudged;
        }
        if let Recipe::Vote(of) = &self.recipe {
            let of = of.iter().map(|place| others.get(*place).copied());
            return vote(of.map(|o| o.unwrap_or(Observation::NotJudged)), self.limit.votes);
        }
        let Some(thresholds) = at_speed(&self.limit, measured.speed) else {
            return Observation::NotJudged;
        };
        let multiply = startup.unwrap_or(1.0);
        for member in &mut self.members {
            member.value = value(&self.recipe, &self.limit, member, measured);
            // A channel without a value keeps its level and has no vote.
            if let Some(value) = member.value {
                let was = member.level;
                member.level = level(value, &thresholds, multiply, self.limit.hysteresis, was);
            }
        }
        let observed = self.members.iter().map(|member| match (member.value, member.level) {
            (None, _) => Observation::NotJudged,
            (Some(_), None) => Observation::Healthy,
            (Some(_), Some(level)) => Observation::Accused(level),
        });
        vote(observed, self.limit.votes)
    }

    /// The channel that is furthest beyond, of those that exceed.
    #[must_use]
    pub fn worst(&self) -> Option<Exceeded> {
        let over = self.members.iter().filter(|member| member.level.is_some());
        let valued = over.filter_map(|member| Some((member, member.value?)));
        let worst =
            valued.max_by(|(a, x), (b, y)| a.level.cmp(&b.level).then(x.abs().total_cmp(&y.abs())));
        worst.map(|(member, value)| Exceeded { channel: member.name.clone(), value })
    }

    /// One plain sentence on what exceeds.
    #[must_use]
    pub fn why(&self, speed: Option<Hz>) -> String {
        let id = &self.limit.id;
        let Some(worst) = self.worst() else {
            let n = self.limit.votes;
            return format!("at least {n} of the limits that `{id}` counts are exceeded");
        };
        let n = self.members.iter().filter(|member| member.level.is_some()).count();
        let of = match self.members.len() {
            1 => String::new(),
            all => format!(", {n} of {all} channels exceed"),
        };
        let stated = at_speed(&self.limit, speed).map_or(String::new(), |thresholds| {
            let Thresholds { warning_above, damaged_above, warning_below, damaged_below } =
                thresholds;
            let above = [warning_above, damaged_above];
            let below = [damaged_below, warning_below];
            let list = |words: &str, limits: [Option<f64>; 2]| {
                let limits: Vec<String> =
                    limits.iter().flatten().map(|limit| format!("{limit:.4}")).collect();
                (!limits.is_empty()).then(|| format!("{words} {}", limits.join(", ")))
            };
            let parts = [list("above", above), list("below", below)];
            parts.into_iter().flatten().collect::<Vec<_>>().join("; ")
        });
        let unit = if self.limit.unit == Unit::One { "" } else { self.limit.unit.symbol() };
        format!(
            "limit `{id}`: {:.4} {unit} in {} (limits: {stated}){of}",
            worst.value, worst.channel
        )
        .replace("  ", " ")
    }
}

fn recipe(machine: &Machine, quantity: &Quantity) -> Recipe {
    match quantity {
        Quantity::VelocityRms => Recipe::One(overall::VELOCITY_RMS.to_owned()),
        Quantity::DisplacementRms => Recipe::One(limit::DISPLACEMENT_RMS.to_owned()),
        Quantity::PeakToPeak => Recipe::One(limit::PEAK_TO_PEAK.to_owned()),
        Quantity::Gap => Recipe::One("mean".to_owned()),
        Quantity::Band { low, high } => Recipe::One(limit::band_name(*low, *high)),
        Quantity::Order { shaft, order } => {
            Recipe::One(limit::order_name(*order, &machine.shaft(*shaft).id))
        }
        Quantity::NotOnce { shaft } => Recipe::Without {
            rms: overall::RMS.to_owned(),
            line: limit::once_name(machine, *shaft),
        },
        Quantity::Feature(name) => Recipe::One(name.clone()),
        Quantity::Change(Reference::VelocityRms { mm_per_s }) => {
            Recipe::Distance { from: overall::VELOCITY_RMS.to_owned(), reference: *mm_per_s }
        }
        Quantity::Change(Reference::Vector { amplitude, phase_deg }) => {
            let (sin, cos) = phase_deg.to_radians().sin_cos();
            Recipe::VectorDistance { reference: (amplitude * cos, amplitude * sin) }
        }
        Quantity::Vote(of) => Recipe::Vote(of.clone()),
    }
}

fn place(machine: &Machine, limit: &AlarmLimit) -> (ComponentKind, String) {
    let at = |place: &usize| {
        let component = machine.component_at(machine.sensors.get(*place)?)?;
        let kind = match component {
            Component::Shaft(_) => ComponentKind::Shaft,
            Component::Bearing(_) => ComponentKind::Bearing,
            Component::Gear(_) => ComponentKind::Gear,
        };
        Some((kind, component.id().to_owned()))
    };
    let mut places = limit.sensors.iter().map(at);
    let first = places.next().flatten();
    first
        .filter(|first| places.all(|place| place.as_ref() == Some(first)))
        .unwrap_or_else(|| (ComponentKind::Machine, machine.id.clone()))
}

/// What applies at a speed; `None`: nothing is stated for it.
fn at_speed(limit: &AlarmLimit, speed: Option<Hz>) -> Option<Thresholds> {
    if limit.by_speed.is_empty() {
        return Some(limit.thresholds);
    }
    let speed = speed?;
    let holds = |range: &&SpeedRange| speed.0 >= range.low.0 && speed.0 < range.high.0;
    limit.by_speed.iter().find(holds).map(|range| range.thresholds)
}

/// The value of a limit in a channel; `None` if it was not measured, or in another unit.
fn value(
    recipe: &Recipe,
    limit: &AlarmLimit,
    member: &mut Member,
    measured: &Measured<'_>,
) -> Option<f64> {
    let channel = measured.channels;
    let at = channel.binary_search_by_key(&member.channel, |channel| channel.channel).ok()?;
    let channel = &channel[at];
    let [one, two] = &mut member.hints;
    let value = match recipe {
        Recipe::One(name) => {
            let (value, unit) = look(channel, name, one)?;
            if limit.relative_to_baseline {
                measured.baseline.compare(&member.name, name, value)?.ratio
            } else {
                in_unit(value, unit, limit)?
            }
        }
        Recipe::Without { rms, line } => {
            let (rms, unit) = look(channel, rms, one)?;
            let (line, _) = look(channel, line, two)?;
            let rest = (rms * rms - 0.5 * line * line).max(0.0).sqrt();
            in_unit(rest, unit, limit)?
        }
        Recipe::Distance { from, reference } => {
            let (value, unit) = look(channel, from, one)?;
            (in_unit(value, unit, limit)? - reference).abs()
        }
        Recipe::VectorDistance { reference } => {
            let (cos, unit) = look(channel, vector::COS, one)?;
            let (sin, _) = look(channel, vector::SIN, two)?;
            in_unit((cos - reference.0).hypot(sin - reference.1), unit, limit)?
        }
        Recipe::Vote(_) => return None,
    };
    value.is_finite().then_some(value)
}

/// A feature by its name, looked for first where it stood before.
fn look(channel: &ChannelFeatures, name: &str, hint: &mut usize) -> Option<(f64, Unit)> {
    let is_it = |place: usize| channel.values.get(place).is_some_and(|f| *f.name == *name);
    if !is_it(*hint) {
        *hint = channel.values.iter().position(|feature| *feature.name == *name)?;
    }
    let feature = &channel.values[*hint];
    Some((feature.value, feature.unit))
}

/// A value, if it is in the limit's unit; a limit of a bare number takes any.
fn in_unit(value: f64, unit: Unit, limit: &AlarmLimit) -> Option<f64> {
    (unit == limit.unit || limit.unit == Unit::One).then_some(value)
}

/// The level of a value. On a limit belongs to the better side; a level that was reached is left only
/// when the value is `hysteresis` of the limit's size behind it.
#[must_use]
pub fn level(
    value: f64,
    thresholds: &Thresholds,
    multiply: f64,
    hysteresis: f64,
    was: Option<Level>,
) -> Option<Level> {
    let over = |limit: Option<f64>, held: bool| {
        limit.is_some_and(|limit| {
            let limit = limit * multiply;
            value > if held { limit - hysteresis * limit.abs() } else { limit }
        })
    };
    let under = |limit: Option<f64>, held: bool| {
        limit.is_some_and(|limit| {
            value < if held { limit + hysteresis * limit.abs() } else { limit }
        })
    };
    let damaged = was == Some(Level::Damaged);
    let warning = was.is_some();
    if over(thresholds.damaged_above, damaged) || under(thresholds.damaged_below, damaged) {
        Some(Level::Damaged)
    } else if over(thresholds.warning_above, warning) || under(thresholds.warning_below, warning) {
        Some(Level::Warning)
    } else {
        None
    }
}

/// What `votes` of the observations agree on. Who was not judged has no vote; if those could still decide,
/// nothing is judged.
#[must_use]
pub fn vote(observed: impl Iterator<Item = Observation>, votes: usize) -> Observation {
    let (mut warning, mut damaged, mut absent, mut n) = (0, 0, 0, 0);
    for observation in observed {
        n += 1;
        match observation {
            Observation::NotJudged => absent += 1,
            Observation::Healthy => {}
            Observation::Accused(level) => {
                warning += 1;
                damaged += usize::from(level == Level::Damaged);
            }
        }
    }
    if damaged >= votes {
        Observation::Accused(Level::Damaged)
    } else if warning >= votes {
        Observation::Accused(Level::Warning)
    } else if n == 0 || warning + absent >= votes {
        Observation::NotJudged
    } else {
        Observation::Healthy
    }
}

/// Follows a declared transient.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StartupClock {
    since_s: Option<f64>,
}

impl StartupClock {
    /// Since when it runs, s of stream time.
    #[must_use]
    pub fn since_s(&self) -> Option<f64> {
        self.since_s
    }

    /// Running since then.
    #[must_use]
    pub fn running_since(since_s: Option<f64>) -> Self {
        Self { since_s }
    }

    /// Whether the window that ends at `time_s` lies in the transient that is declared: the speed changes,
    /// is within its range, and it has not lasted longer than it may.
    pub fn observe(
        &mut self,
        startup: Option<&Startup>,
        measured: &Measured<'_>,
        time_s: f64,
    ) -> bool {
        let within = startup.filter(|startup| {
            let (low, high) = startup.speed;
            measured.operating == OperatingState::Transient
                && measured.speed.is_some_and(|speed| speed.0 >= low.0 && speed.0 <= high.0)
        });
        let Some(startup) = within else {
            self.since_s = None;
            return false;
        };
        let since_s = *self.since_s.get_or_insert(time_s);
        time_s - since_s <= startup.max_s
    }
}
