//! The sentences of what neither accuses nor acquits a bearing (docs/theory.md, C9). Must not decide anything.

use super::alone::Alone;
use super::candidate;
use super::candidate::Candidate;
use super::doubt::Seen;
use super::grown::Grown;
use super::risen;
use super::sentence;
use crate::diagnosis::Context;
use crate::diagnosis::severity;
use crate::features::absolute::AbsoluteLine;
use crate::features::bearing::DefectLine;
use crate::features::bearing::LineSearch;
use crate::machine::BearingIndex;
use crate::units::Hz;

/// Why a line of the lowest band alone does not accuse.
pub(super) fn smooth(line: &Candidate<'_>, context: &Context<'_>) -> String {
    format!(
        "{}; above {:.1} kHz less of it is left than a fall of 6 dB an octave leaves, and the motion that passing elements impose falls by 12; impacts \
         ring there, too: not accused",
        sentence(line, context),
        line.power.lowest_top.0 / 1e3
    )
}

/// Why a line beside a tone that is modulated at its rate does not accuse.
pub(super) fn of_tone(line: &Candidate<'_>, seen: &Seen<'_>) -> String {
    format!(
        "{}; a tone of the machine is modulated at this rate with ten times the power, as sound elements that pass under its force do: {}",
        sentence(line, seen.context),
        what_would_tell(line, seen)
    )
}

/// Why a line that was there before does not accuse.
pub(super) fn not_grown(line: &Candidate<'_>, context: &Context<'_>) -> String {
    format!(
        "{}; the absolute vibration of the healthy machine shows it as strongly: not accused",
        sentence(line, context)
    )
}

/// Why a line neither accuses nor acquits (C9).
pub(super) fn too_near(line: &Candidate<'_>, context: &Context<'_>) -> String {
    let limit = severity::WARNING_DEPTH;
    format!("{}; that is too near the limit of {limit:.2} to accuse", sentence(line, context))
}

/// Why a rolling element's line alone does not accuse.
pub(super) fn without_cage(line: &Candidate<'_>, context: &Context<'_>) -> String {
    format!(
        "{}; without side bands at FTF it may as well come from elsewhere: not accused",
        sentence(line, context)
    )
}

/// Why a turning race's line without side bands at the shaft's speed does not accuse.
pub(super) fn unturned(line: &Candidate<'_>, context: &Context<'_>) -> String {
    format!(
        "{}; a defect there passes the load once a turn and has side bands at the shaft's speed, which would be seen here: what the machine \
         file does not list may make such a line, not accused",
        sentence(line, context)
    )
}

/// Why a cage's line does not accuse.
pub(super) fn carried(line: &Candidate<'_>, context: &Context<'_>) -> String {
    format!(
        "{}; unequal elements that the cage carries through the load modulate as much: not accused",
        sentence(line, context)
    )
}

/// Why a cage's line that no race shows does not accuse.
pub(super) fn lone(line: &Candidate<'_>, seen: &Seen<'_>) -> String {
    format!(
        "{}; no race of this bearing shows side bands at the cage's rate, and a belt or a shaft that the machine file does not list \
         strikes so, too: not accused; {}",
        sentence(line, seen.context),
        what_would_tell(line, seen)
    )
}

/// Why a line that is another's side band does not accuse.
pub(super) fn side_line(line: &Candidate<'_>, context: &Context<'_>) -> String {
    format!(
        "{}; the line at {:.1} Hz is higher, and no side band of strikes is: it may be one itself, of something that strikes there, \
         not accused",
        sentence(line, context),
        line.side_band_of.map_or(0.0, |carrier| carrier.0)
    )
}

/// Why a race's line that another bearing may make does not accuse.
pub(super) fn contested(
    line: &Candidate<'_>,
    others: &[&LineSearch],
    context: &Context<'_>,
) -> String {
    let mut names: Vec<String> = others.iter().map(|s| named(s, context)).collect();
    names.dedup();
    format!(
        "{}; side bands tell rather of another bearing's damage that is heard here: it may be {}, cause not proven",
        sentence(line, context),
        names.join(" or ")
    )
}

/// What tells a line from another bearing's that may have its rate; empty where no other may (C45).
pub(super) fn told_by_loudness(line: &Candidate<'_>, context: &Context<'_>) -> String {
    line.rival.map_or_else(String::new, |rival| {
        format!(
            "; told by {:.0} dB of loudness from {}, which may have this rate, too",
            -10.0 * rival.power_ratio.max(f64::MIN_POSITIVE).log10(),
            context.machine.bearing(rival.bearing).id
        )
    })
}

/// Why a line that several bearings may make accuses none of them (C45).
pub(super) fn unplaced(
    line: &Candidate<'_>,
    others: &[BearingIndex],
    context: &Context<'_>,
) -> String {
    let all = std::iter::once(&line.search.bearing).chain(others);
    let names: Vec<&str> =
        all.map(|bearing| context.machine.bearing(*bearing).id.as_str()).collect();
    format!(
        "{}; the bearings {} may have this rate, and no sensors of theirs tell by 3 dB at which of them it is loudest: which is damaged is not told",
        sentence(line, context),
        names.join(" and ")
    )
}

/// Why a bearing is not acquitted of what is heard as loud elsewhere, or may be (C45).
pub(super) fn as_loud(at: Hz, heard: &LineSearch, context: &Context<'_>) -> String {
    format!(
        "{:.1} Hz in the envelope of {} may be {} or a line of this bearing: nothing is louder by 3 dB than at the other",
        at.0,
        context.channel_name(heard.channel),
        named(heard, context)
    )
}

/// Why a bearing is not acquitted of what is heard as another's.
pub(super) fn lent(at: Hz, heard: &LineSearch, own: &LineSearch, context: &Context<'_>) -> String {
    format!(
        "{:.1} Hz in the envelope of {} would be {}, but side bands tell otherwise: it may be {}",
        at.0,
        context.channel_name(heard.channel),
        named(heard, context),
        named(own, context)
    )
}

/// A bearing's line by name.
fn named(search: &LineSearch, context: &Context<'_>) -> String {
    format!("{} of {}", search.line.name(), context.machine.bearing(search.bearing).id)
}

/// Why a line that a shaft may have at another speed than its name plate's does not accuse.
pub(super) fn near_multiple(line: &Candidate<'_>, context: &Context<'_>) -> String {
    let best_hz = line.best.as_ref().map_or(0.0, |best| best.frequency.0);
    let speed_hz = line.search.shaft_speed.0;
    let multiple = (best_hz / speed_hz).round();
    format!(
        "{}; nothing confirms the {speed_hz:.2} Hz of the machine file, and at {:.2} Hz this is {multiple:.0}×, of vanes or a coupling \
         for example: not accused; measure the speed",
        sentence(line, context),
        best_hz / multiple
    )
}

/// Why a line at a multiple of a mains frequency does not accuse.
pub(super) fn of_mains(
    line: &Candidate<'_>,
    mains: Option<(Hz, f64)>,
    context: &Context<'_>,
) -> String {
    let (mains, multiple) = mains.unwrap_or((Hz(0.0), 0.0));
    format!(
        "{}; it stands at {multiple:.0}× a mains frequency of {:.0} Hz, and no [[motor]] of the machine file states a line_frequency_hz: motors and converters \
         hum at that rate, not accused; state it, of an inverter its output's",
        sentence(line, context),
        mains.0
    )
}

/// Why a line of a turning race that is no higher than the shaft's harmonics does not accuse.
pub(super) fn of_events(line: &Candidate<'_>, context: &Context<'_>) -> String {
    format!(
        "{}; a defect there passes the load once a turn and has side bands at the shaft's speed, and harmonics of the shaft beside it are as \
         high: events of the shaft that elements modulate as they pass make such, cause not proven",
        sentence(line, context)
    )
}

/// Why a line beside which next to nothing else is heard does not accuse.
pub(super) fn in_quiet(line: &Candidate<'_>, context: &Context<'_>) -> String {
    format!(
        "{}; next to nothing else is heard there, and where it is so quiet sound elements make as deep a line as they pass, however softly: accused \
         from {:.2}, or by growth over a baseline",
        sentence(line, context),
        candidate::NARROW_DEPTH
    )
}

/// Why a cage's line beside that of its elements does not accuse.
pub(super) fn of_elements(line: &Candidate<'_>, context: &Context<'_>) -> String {
    format!(
        "{}; the line of its rolling elements stands, too, with side bands at FTF: a damaged element that the cage carries through the \
         load makes both, cause not proven",
        sentence(line, context)
    )
}

/// Why a line that a much stronger neighbour may cause does not accuse.
pub(super) fn overheard(line: &Candidate<'_>, context: &Context<'_>) -> String {
    format!(
        "{}; another bearing strikes ten times as hard, and passing elements modulate its blows: not accused",
        sentence(line, context)
    )
}

/// Why a deep line in few bands neither accuses nor acquits.
pub(super) fn in_few_bands(line: &Candidate<'_>, seen: &Seen<'_>) -> String {
    format!(
        "{}; too few bands have {:.2} to accuse, too deep to acquit: {}",
        sentence(line, seen.context),
        severity::WARNING_DEPTH,
        what_would_tell(line, seen)
    )
}

/// Why a line of some effect neither accuses nor acquits (C42).
pub(super) fn half_deep(line: &Candidate<'_>, seen: &Seen<'_>) -> String {
    format!(
        "{}; a quarter of the bands find it half as deep as accuses ({:.2}) or deeper: too little to accuse, too much to acquit; {}",
        sentence(line, seen.context),
        severity::WARNING_DEPTH,
        what_would_tell(line, seen)
    )
}

/// Why a fundamental without its harmonics neither accuses nor acquits (C55).
pub(super) fn alone((line, alone): (&Candidate<'_>, Alone), seen: &Seen<'_>) -> String {
    format!(
        "{} {:.1} Hz stands {:.0} dB over the noise floor in the envelope of {} in {} of {} bands, without its harmonics, and a quarter of the bands find \
         it as deep as {:.2}: what swings at this rate has none, and blows that slip lose them: neither accused nor acquitted; {}",
        line.search.line.name(),
        alone.frequency.0,
        10.0 * alone.power_ratio.max(1.0).log10(),
        seen.context.channel_name(line.search.channel),
        alone.n_showing,
        line.n_bands,
        alone.depth,
        what_would_tell(line, seen)
    )
}

/// What is missing to tell a line: a baseline, or growth over the one there is (C38).
fn what_would_tell(line: &Candidate<'_>, seen: &Seen<'_>) -> String {
    match risen::ratio(line, seen) {
        None => "a baseline of the healthy machine would tell".to_owned(),
        Some(ratio) if ratio < risen::GROWN => format!(
            "a quarter of the bands show it {ratio:.1} times as deep as the baseline, and {:.0} times would be news",
            risen::GROWN
        ),
        Some(ratio) => format!(
            "a quarter of the bands show it {ratio:.1} times as deep as the baseline, but chance, the shaft's motion or other parts may be why"
        ),
    }
}

/// Why a line that has grown beside another that has does not accuse.
pub(super) fn beside(grown: &Grown<'_>, other: &AbsoluteLine, context: &Context<'_>) -> String {
    let is_stronger = other.amplitude > grown.line.amplitude;
    format!(
        "{}; {} at {} has grown too and is {}: cause not proven",
        grown.sentence(context),
        other.line.name(),
        context.machine.bearing(other.bearing).id,
        if is_stronger { "stronger" } else { "less than 3 dB weaker" },
    )
}

/// Why a line that has grown at a rate of a bearing without a pair of sensors does not accuse.
pub(super) fn without_pair(
    grown: &Grown<'_>,
    other: BearingIndex,
    context: &Context<'_>,
) -> String {
    format!(
        "{}; {} may have this rate too, and no pair of sensors listens to it: which is damaged is not told",
        grown.sentence(context),
        context.machine.bearing(other).id,
    )
}

/// Why a line that has grown under a shaft that moves does not accuse.
pub(super) fn loaded(grown: &Grown<'_>, context: &Context<'_>) -> String {
    format!(
        "{}; 1× displacement of the shaft is up, and what turns with it loads the elements more, which pass sound races at \
         this rate: cause not proven",
        grown.sentence(context)
    )
}

/// Tells of a geometry known less well than the slip that is allowed for; empty if it is better known.
pub(super) fn wide_band(bearing: BearingIndex, context: &Context<'_>) -> String {
    let described = context.machine.bearing(bearing);
    let widest = described.bands.widest();
    if widest <= DefectLine::Bpfo.tolerance().widest() {
        return String::new();
    }
    format!(
        "; the geometry of `{}` is known to {:.1} %, which widens the search",
        described.catalogue.as_deref().unwrap_or("unnamed"),
        100.0 * widest
    )
}
