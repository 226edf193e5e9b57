//! What neither accuses nor acquits, and why: lines that something else may cause, or that stand too
//! near a limit (docs/theory.md, C9).

use super::accept;
use super::accept::Accepted;
use super::alone::Alone;
use super::candidate;
use super::candidate::Candidate;
use super::grown;
use super::mains;
use super::owner;
use super::place;
use super::risen;
use super::said;
use super::something_else;
use crate::diagnosis::Context;
use crate::features::WindowFeatures;
use crate::features::bands;
use crate::features::bearing::DefectLine;
use crate::features::bearing::LineSearch;
use crate::features::speed::REFINE_RANGE;
use crate::features::speed::SpeedSource;
use crate::features::speed::TOLD_TO;
use crate::machine::BearingIndex;
use crate::units::Hz;

/// The proven lines of one bearing, sorted by what they may say.
#[derive(Debug, Default)]
pub(super) struct Sorted<'c> {
    /// Those that accuse, strongest first.
    pub(super) proven: Vec<&'c Candidate<'c>>,
    /// Those that may as well be others', and whose.
    pub(super) shared: Vec<(&'c Candidate<'c>, Vec<&'c LineSearch>)>,
    /// Those that only leave doubt.
    pub(super) doubts: Vec<(Doubt, &'c Candidate<'c>)>,
}

/// Why a proven line does not accuse.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Doubt {
    /// Another bearing may have its rate, and nothing tells which of them it comes from (C45).
    Unplaced,
    /// A rolling element's line without the side bands of the cage.
    Bare,
    /// A turning race's line without side bands at the shaft's speed (C50).
    Unturned,
    /// A cage's line that unequal elements make as well.
    Carried,
    /// A cage's line beside which no race of the bearing shows it.
    Lone,
    /// A cage's line beside that of the elements the cage carries.
    OfElements,
    /// A side band of it is higher than itself.
    SideLine,
    /// A race's line at a rate that another bearing's may have, and side bands tell rather of that.
    Contested,
    /// Nothing confirms a name plate's speed, and at a speed near by it is a multiple of the shaft's.
    NearMultiple,
    /// It stands at a multiple of a mains frequency, and no motor states its own (C48).
    OfMains,
    /// Events of the shaft may make it, which elements modulate sharply (C49).
    OfEvents,
    /// Next to nothing else is heard where it stands, and it is no deeper than sound elements make it there (C52).
    InQuiet,
    /// A bearing beside it strikes ten times as hard.
    Overheard,
    /// It lives in the lowest band alone, as the motion does that passing elements impose.
    Smooth,
    /// A tone is modulated at its rate with ten times its power, as passing elements do.
    OfTone,
    /// The healthy machine's absolute vibration shows it as strongly.
    NotGrown,
    /// The noise beside it leaves less depth than accuses.
    NearLimit,
}

/// A bearing in its window.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen<'a> {
    pub(super) bearing: BearingIndex,
    pub(super) features: &'a WindowFeatures,
    pub(super) context: &'a Context<'a>,
    pub(super) accepted: &'a [Accepted<'a>],
}

/// What a proven line may say.
#[derive(Debug)]
enum Says<'c> {
    Proven,
    Shared(Vec<&'c LineSearch>),
    Doubt(Doubt),
    /// It is deep in few bands only: [`why_open`] tells.
    Few,
}

/// Sorts the lines accepted for one bearing: by the channel each is heard best in, or, of all but the race at rest, by another of this
/// bearing's that is more telling. What is loudest need not be deepest: noise and other lines may fill the bands of that channel.
pub(super) fn sort<'c>(candidates: &'c [Candidate<'c>], seen: &Seen<'c>) -> Sorted<'c> {
    let mut sorted = Sorted::default();
    for found in seen.accepted {
        let Some(own) = candidates.iter().find(|c| c.is_proven() && found.is_by(c.search)) else {
            continue;
        };
        // Sound elements pass the race at rest, and are deep in one channel or the other.
        let others = candidates.iter().filter(|c| {
            let at = c.best.as_ref().map(|best| best.frequency);
            !own.search.is_at_rest
                && c.is_proven()
                && c.search.line == own.search.line
                && c.search.channel != own.search.channel
                && at.is_some_and(|at| found.is_at(at, c.search.resolution))
        });
        let says = says(own, found.others(own.search), seen);
        let is_told = matches!(says, Says::Proven | Says::Shared(_));
        let told = others
            .filter(|_| !is_told)
            .map(|c| (c, self::says(c, found.others(own.search), seen)))
            .find(|(_, says)| matches!(says, Says::Proven | Says::Shared(_)));
        match told.unwrap_or((own, says)) {
            (line, Says::Proven) => sorted.proven.push(line),
            (line, Says::Shared(others)) => sorted.shared.push((line, others)),
            (line, Says::Doubt(doubt)) => sorted.doubts.push((doubt, line)),
            (_, Says::Few) => {}
        }
    }
    sorted
}

/// What a proven line may say, which may belong to `others` as well.
fn says<'c>(line: &Candidate<'c>, others: Vec<&'c LineSearch>, seen: &Seen<'c>) -> Says<'c> {
    if !line.is_surely_deep() {
        Says::Doubt(Doubt::NearLimit)
    } else if line.is_bare() {
        Says::Doubt(Doubt::Bare)
    } else if line.is_carried() {
        Says::Doubt(Doubt::Carried)
    } else if is_of_elements(line, seen) {
        Says::Doubt(Doubt::OfElements)
    } else if is_lone(line, seen) {
        Says::Doubt(Doubt::Lone)
    } else if line.side_band_of.is_some() {
        Says::Doubt(Doubt::SideLine)
    } else if !contenders(line, seen).is_empty() {
        Says::Doubt(Doubt::Contested)
    } else if is_near_multiple(line, seen) {
        Says::Doubt(Doubt::NearMultiple)
    } else if mains::of_mains(line, seen).is_some() {
        Says::Doubt(Doubt::OfMains)
    } else if line.is_unturned() && is_spacing_told(line, seen) {
        Says::Doubt(Doubt::Unturned)
    } else if line.is_of_events() {
        Says::Doubt(Doubt::OfEvents)
    } else if line.is_in_quiet() {
        Says::Doubt(Doubt::InQuiet)
    } else if line.is_overheard(seen.accepted) {
        Says::Doubt(Doubt::Overheard)
    } else if is_smooth(line, seen) {
        Says::Doubt(Doubt::Smooth)
    } else if is_of_tone(line, seen) {
        Says::Doubt(Doubt::OfTone)
    } else if has_not_grown(line, seen) {
        Says::Doubt(Doubt::NotGrown)
    } else if !line.is_agreed() {
        Says::Few
    } else if !elsewhere(line, seen).is_empty() {
        Says::Doubt(Doubt::Unplaced)
    } else if others.is_empty() {
        Says::Proven
    } else {
        Says::Shared(others)
    }
}

/// Why a bearing that nothing accuses is not acquitted, if so.
pub(super) fn why_open(
    doubts: &[(Doubt, &Candidate<'_>)],
    candidates: &[Candidate<'_>],
    searches: &[&LineSearch],
    seen: &Seen<'_>,
) -> Option<String> {
    let doubts = doubts.iter().filter(|(doubt, line)| match doubt {
        Doubt::Unplaced
        | Doubt::Bare
        | Doubt::Unturned
        | Doubt::Carried
        | Doubt::Lone
        | Doubt::OfElements
        | Doubt::SideLine
        | Doubt::Contested
        | Doubt::NearMultiple
        | Doubt::OfMains
        | Doubt::OfEvents
        | Doubt::InQuiet
        | Doubt::Overheard
        | Doubt::Smooth
        | Doubt::OfTone
        | Doubt::NotGrown => true,
        Doubt::NearLimit => !has_not_grown(line, seen),
    });
    let first = doubts.min_by_key(|(doubt, _)| *doubt).map(|(doubt, line)| match doubt {
        Doubt::Unplaced => said::unplaced(line, &elsewhere(line, seen), seen.context),
        Doubt::Bare => said::without_cage(line, seen.context),
        Doubt::Unturned => said::unturned(line, seen.context),
        Doubt::Carried => said::carried(line, seen.context),
        Doubt::Lone => said::lone(line, seen),
        Doubt::OfElements => said::of_elements(line, seen.context),
        Doubt::SideLine => said::side_line(line, seen.context),
        Doubt::Contested => said::contested(line, &contenders(line, seen), seen.context),
        Doubt::NearMultiple => said::near_multiple(line, seen.context),
        Doubt::OfMains => said::of_mains(line, mains::of_mains(line, seen), seen.context),
        Doubt::OfEvents => said::of_events(line, seen.context),
        Doubt::InQuiet => said::in_quiet(line, seen.context),
        Doubt::Overheard => said::overheard(line, seen.context),
        Doubt::Smooth => said::smooth(line, seen.context),
        Doubt::OfTone => said::of_tone(line, seen),
        Doubt::NotGrown => said::not_grown(line, seen.context),
        Doubt::NearLimit => said::too_near(line, seen.context),
    });
    let in_few = || {
        let mut of_elements = candidates.iter().filter(|c| c.search.line != DefectLine::Ftf);
        // A smooth motion in few bands is what a sound bearing shows, but not one that owes half of its energy to a line.
        let is_sound = |c: &Candidate<'_>| {
            c.depth() < candidate::NARROW_DEPTH
                && is_below_ringing(c)
                && is_seen_to_be_smooth(c, seen)
        };
        let is_odd =
            |c: &&Candidate<'_>| c.is_deep_in_few() && !is_sound(c) && !has_not_grown(c, seen);
        let deep = of_elements.find(is_odd)?;
        Some(said::in_few_bands(deep, seen))
    };
    first
        .or_else(in_few)
        .or_else(|| something_else::of_something_else(candidates, searches, seen))
        .or_else(|| Some(said::half_deep(half_deep(candidates, seen)?, seen)))
        .or_else(|| Some(said::alone(alone(candidates, seen)?, seen)))
}

impl<'c> Sorted<'c> {
    /// The deepest of the lines that would accuse if it were told which bearing they come from.
    pub(super) fn unplaced(&self) -> Option<&'c Candidate<'c>> {
        let unplaced = self.doubts.iter().filter(|(doubt, _)| *doubt == Doubt::Unplaced);
        let lines = unplaced.map(|(_, line)| *line);
        lines.max_by(|a, b| a.depth().total_cmp(&b.depth()))
    }
}

/// The other bearings that a line may come from as well: those it is as loud at, and those that share its sensor or have none (C45).
pub(super) fn elsewhere(line: &Candidate<'_>, seen: &Seen<'_>) -> Vec<BearingIndex> {
    let own = line.search.bearing;
    let found = seen.accepted.iter().filter(|a| a.is_of(own, line.search.line));
    let mut others: Vec<BearingIndex> = found
        .flat_map(|a| {
            let as_loud = a.rivals.iter().filter(|r| r.is_as_loud()).map(|r| r.bearing);
            as_loud.chain(a.owners.iter().map(|s| s.bearing)).filter(|bearing| *bearing != own)
        })
        .chain(place::unheard(line, seen.features, seen.context))
        .collect();
    others.sort();
    others.dedup();
    others
}

/// The lines of other bearings one of which it may be instead (C44).
fn contenders<'a>(line: &Candidate<'_>, seen: &Seen<'a>) -> Vec<&'a LineSearch> {
    let at = line.best.as_ref().map(|best| best.frequency);
    at.map_or_else(Vec::new, |at| owner::contenders(line.search, at, seen.features))
}

/// A line that is there, too small to accuse and too deep to acquit (C42), unless sound elements that pass may make it.
pub(super) fn half_deep<'c>(
    candidates: &'c [Candidate<'c>],
    seen: &Seen<'_>,
) -> Option<&'c Candidate<'c>> {
    let lines = candidates.iter().filter(|line| line.is_half_deep());
    let open = lines.filter(|line| may_be_own(line, seen) && !is_sound_passing(line, seen));
    open.max_by(|a, b| a.depth().total_cmp(&b.depth()))
}

/// The same of a fundamental without its harmonics (C55).
fn alone<'c>(
    candidates: &'c [Candidate<'c>],
    seen: &Seen<'_>,
) -> Option<(&'c Candidate<'c>, Alone)> {
    let lines = candidates.iter().filter(|line| may_be_own(line, seen));
    let alone = lines.filter_map(|line| Some((line, line.alone?)));
    alone
        .filter(|(_, alone)| alone.is_deep() && !alone.is_passing())
        .filter(|(line, _)| !has_not_grown(line, seen))
        .max_by(|(_, a), (_, b)| a.depth.total_cmp(&b.depth))
}

/// Whether a line of an element may be this bearing's and news: no baseline has it, and neither what strikes elsewhere nor what nobody owns may be
/// what is heard.
fn may_be_own(line: &Candidate<'_>, seen: &Seen<'_>) -> bool {
    let is_own = |a: &Accepted<'_>| {
        !a.owners.is_empty() && a.owners.iter().all(|s| s.bearing == seen.bearing)
    };
    line.search.line != DefectLine::Ftf
        && seen.accepted.iter().all(is_own)
        && !risen::is_known(line, seen)
}

/// Whether it is a cage's line beside which no line of this bearing's races stands in the channel with side bands at the cage's rate, and which no
/// baseline shows to be news: a cage that is damaged disturbs what passes them, belts and shafts that nobody listed strike at such rates, too (C9).
fn is_lone(line: &Candidate<'_>, seen: &Seen<'_>) -> bool {
    line.search.line == DefectLine::Ftf
        && !risen::is_news(line, seen)
        && !shows_beside(line, seen, owner::has_cage_bands)
}

/// Whether a race or the elements of this bearing show a line in the channel of a cage's, with side bands such as `has_bands` asks for.
fn shows_beside(
    line: &Candidate<'_>,
    seen: &Seen<'_>,
    has_bands: impl Fn(&LineSearch, Hz) -> bool,
) -> bool {
    let looks = accept::n_looks(seen.features, seen.bearing);
    let place = (line.search.bearing, line.search.channel);
    let lines = seen.features.bearing_lines.iter();
    lines
        .filter(|s| (s.bearing, s.channel) == place && s.line != DefectLine::Ftf)
        .filter(|s| s.outcome.is_ok())
        .any(|s| {
            let other = Candidate::weigh(s, &[], looks);
            let at = other.best.as_ref().map(|best| best.frequency);
            at.is_some_and(|at| has_bands(s, at)) && something_else::is_notable(&other)
        })
}

/// Whether it is a cage's line beside which that of the elements stands in the channel, with side bands at FTF (C9): elements that the cage
/// carries through the load make both.
fn is_of_elements(line: &Candidate<'_>, seen: &Seen<'_>) -> bool {
    line.search.line == DefectLine::Ftf
        && shows_beside(line, seen, |s, at| {
            s.line == DefectLine::TwoBsf && owner::has_side_bands(s, at)
        })
}

/// Whether it may be a multiple of the shaft's speed where only the machine file states that, a name plate's, and nothing confirms it
/// (C41): the shaft may turn up to 3 % faster or slower. Side bands at the spacing of that speed confirm it as well as they are told.
fn is_near_multiple(line: &Candidate<'_>, seen: &Seen<'_>) -> bool {
    let Some(best) = &line.best else { return false };
    let speed = &seen.features.speed;
    let (frequency_hz, shaft_hz) = (best.frequency.0, line.search.shaft_speed.0);
    let multiple = (frequency_hz / shaft_hz).round();
    let unsure_hz = if line.search.line != DefectLine::TwoBsf && line.has_side_band() {
        (multiple + 1.0) * line.search.resolution.0
    } else {
        REFINE_RANGE * multiple * shaft_hz
    };
    speed.source == Some(SpeedSource::Machine)
        && speed.is_unconfirmed()
        && (frequency_hz - multiple * shaft_hz).abs() <= unsure_hz
}

/// Whether the speed tells to 1/T where side bands at 1× lie (C50): they are read within half of that, and their lobes reach as far again.
fn is_spacing_told(line: &Candidate<'_>, seen: &Seen<'_>) -> bool {
    let speed = &seen.features.speed;
    let is_near = TOLD_TO * line.search.shaft_speed.0 <= 0.5 * line.search.resolution.0;
    let came_with_record = speed.source != Some(SpeedSource::Machine) && speed.confidence > 0.0;
    !speed.is_unconfirmed() || came_with_record && is_near
}

/// Whether sound elements that pass may make it: smooth, a tone's modulation, or in the healthy machine's absolute vibration as strongly.
pub(super) fn is_passing(line: &Candidate<'_>, seen: &Seen<'_>) -> bool {
    is_smooth(line, seen) || is_known_passing(line, seen)
}

/// Whether it is what sound elements make: as [`is_passing`], but smooth only below the frequencies at which structures ring (C43).
fn is_sound_passing(line: &Candidate<'_>, seen: &Seen<'_>) -> bool {
    is_smooth(line, seen) && is_below_ringing(line) || is_known_passing(line, seen)
}

/// Whether it is a tone's modulation, or in the healthy machine's absolute vibration as strongly.
fn is_known_passing(line: &Candidate<'_>, seen: &Seen<'_>) -> bool {
    is_of_tone(line, seen) || has_not_grown(line, seen)
}

/// Whether it lives in the lowest band alone in all channels, at whatever bearing, that listen for a line at this rate.
pub(super) fn is_smooth(line: &Candidate<'_>, seen: &Seen<'_>) -> bool {
    let weigh = |s| Candidate::weigh(s, seen.accepted, 1.0);
    !line.is_of_struck_element() && candidate::is_smooth(&everywhere(line, seen, weigh))
}

/// Whether it is a line of the race at rest, which all elements pass, and less than the modulation of a tone at the same rate.
fn is_of_tone(line: &Candidate<'_>, seen: &Seen<'_>) -> bool {
    line.search.is_at_rest
        && candidate::is_of_tone(&everywhere(line, seen, |s| {
            Candidate::weigh(s, seen.accepted, 1.0)
        }))
}

/// Whether the band a smooth motion lives in ends below what structures ring at (C43): an octave that is cut no further ends below twice
/// what it must hold. That of fast lines reaches further up, and blows that ring inside it look as smooth.
fn is_below_ringing(line: &Candidate<'_>) -> bool {
    line.power.lowest_top.0 <= 2.0 * bands::MOTION.0
}

/// Whether it is smooth and nothing hides what it may do above.
fn is_seen_to_be_smooth(line: &Candidate<'_>, seen: &Seen<'_>) -> bool {
    let weigh = |s| Candidate::weigh(s, seen.accepted, 1.0);
    !line.is_of_struck_element() && candidate::is_seen_to_be_smooth(&everywhere(line, seen, weigh))
}

/// What all channels, at whatever bearing, that listen for a line at this rate read of it.
pub(super) fn everywhere<'a>(
    line: &Candidate<'_>,
    seen: &Seen<'a>,
    weigh: impl Fn(&'a LineSearch) -> Candidate<'a>,
) -> Vec<Candidate<'a>> {
    let near = |s: &&LineSearch| {
        let (a, b) = (s.expected.0, line.search.expected.0);
        (a - b).abs() <= s.resolution.0 && s.outcome.is_ok()
    };
    let searches = seen.features.bearing_lines.iter().filter(near);
    searches.map(weigh).collect()
}

/// Whether a baseline has this line of the absolute vibration and it has not grown since.
pub(super) fn has_not_grown(line: &Candidate<'_>, seen: &Seen<'_>) -> bool {
    grown::is_as_when_healthy(seen.bearing, line.search.line, seen.features, seen.context)
}

#[cfg(test)]
#[path = "doubt_tests.rs"]
pub(super) mod tests;

#[cfg(test)]
#[path = "foreign_tests.rs"]
mod foreign_tests;

#[cfg(test)]
#[path = "grown_tests.rs"]
mod grown_tests;

#[cfg(test)]
#[path = "small_tests.rs"]
mod small_tests;
