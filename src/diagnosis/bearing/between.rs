//! What stands between the shaft's events where these hide the lines of races that turn, and nothing else accuses (docs/theory.md, C53).
//!
//! Must not know how events are left out, nor what a baseline holds of depths: that is of all of the turn.

use super::accept;
use super::accept::Accepted;
use super::candidate::Candidate;
use super::doubt;
use super::doubt::Doubt;
use super::doubt::Seen;
use super::evidence;
use super::grown;
use super::looked;
use super::lower;
use super::something_else;
use crate::diagnosis::Context;
use crate::diagnosis::fault::ComponentKind;
use crate::diagnosis::sensor;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::features::WindowFeatures;
use crate::features::bearing::LineSearch;
use crate::machine::BearingIndex;

/// Indicators of lines that are read between the shaft's events end with this.
pub const BETWEEN_EVENTS: &str = "_between_events";

/// Accuses bearings of damage to the race that turns by what stands between the shaft's events.
pub(super) fn look(
    verdicts: &mut [ComponentDiagnosis],
    features: &WindowFeatures,
    context: &Context<'_>,
    accepted: &[Accepted<'_>],
) {
    if features.between_lines.is_empty() {
        return;
    }
    let bearing_lines = features.between_lines.to_vec();
    let there = WindowFeatures { bearing_lines, ..features.clone() };
    let heard = accept::accept(&there);
    for (bearing, verdict) in verdicts.iter_mut().enumerate() {
        let bearing = BearingIndex(bearing);
        let whole = Seen { bearing, features, context, accepted };
        let seen = Seen { bearing, features: &there, context, accepted: &heard };
        if let Some(accused) = shown(&verdict.id, &seen, &whole) {
            *verdict = accused;
        }
    }
}

/// The verdict that the lines of `seen` accuse a bearing by, unless `whole`, all of the turn, leaves it open for what the shaft's events do not explain.
fn shown(id: &str, seen: &Seen<'_>, whole: &Seen<'_>) -> Option<ComponentDiagnosis> {
    let Seen { bearing, features, context, accepted } = *seen;
    let searches: Vec<&LineSearch> =
        features.bearing_lines.iter().filter(|s| s.bearing == bearing).collect();
    if looked::cannot_look(bearing, &searches, features, context).is_some() {
        return None;
    }
    let candidates = lower::candidates(bearing, features, accepted);
    let mut sorted = doubt::sort(&candidates, seen);
    super::leave_unsure(&mut sorted, context);
    sorted.proven.retain(|line| line.search.is_of_turning_race() && !is_foreign(line, whole));
    let (first, others) = sorted.proven.split_first()?;
    let mut verdict = ComponentDiagnosis::undetermined(id, ComponentKind::Bearing, String::new());
    verdict.evidence = evidence::evidence(bearing, &candidates, accepted, features, context);
    let indicator = evidence::envelope_evidence(first, context).indicator;
    let told = verdict.evidence.iter_mut().filter(|e| e.indicator == indicator);
    told.for_each(|e| e.indicator.push_str(BETWEEN_EVENTS));
    super::accuse(&mut verdict, first, others, &candidates, features, context);
    verdict
        .why
        .push_str("; read between the shaft's events, the loudest eighth of its turn left out");
    verdict.why.push_str(&sensor::cut_note(features, super::heard_in(&searches), context));
    Some(verdict)
}

/// Whether all of the turn leaves this line open, or its bearing, for something else than the shaft's events.
fn is_foreign(line: &Candidate<'_>, whole: &Seen<'_>) -> bool {
    let candidates = lower::candidates(whole.bearing, whole.features, whole.accepted);
    let own = whole.features.bearing_lines.iter().filter(|s| s.bearing == whole.bearing);
    let searches: Vec<&LineSearch> = own.collect();
    if something_else::of_another(&candidates, &searches, whole).is_some() {
        return true;
    }
    let sorted = doubt::sort(&candidates, whole);
    sorted.doubts.iter().any(|(doubt, found)| {
        found.search.line == line.search.line
            && *doubt != Doubt::OfEvents
            && !grown::is_of_effect_or_place(*doubt)
    })
}

#[cfg(test)]
mod tests {
    use super::super::doubt::tests::search;
    use super::super::lower::tests::MACHINE;
    use super::super::lower::tests::at;
    use super::super::lower::tests::races;
    use super::super::owner::tests::judged_besides;
    use crate::diagnosis::fault::FaultMode;
    use crate::diagnosis::fault::State;
    use crate::diagnosis::verdict::ComponentDiagnosis;
    use crate::features::bearing::DefectLine;
    use crate::features::bearing::LineSearch;
    use crate::units::Hz;

    fn judged(
        bearing_lines: Vec<LineSearch>,
        between_lines: Vec<LineSearch>,
    ) -> Vec<ComponentDiagnosis> {
        judged_besides(MACHINE, bearing_lines, (Vec::new(), between_lines))
    }

    #[test]
    fn a_race_that_turns_is_accused_by_what_stands_between_the_shafts_events() {
        let verdicts = judged(races(0.1, 0.01), races(0.6, 0.01));
        assert_eq!(verdicts[0].fault, Some(FaultMode::InnerRace), "{}", verdicts[0].why);
        let said = "; read between the shaft's events, the loudest eighth of its turn left out";
        assert!(verdicts[0].why.ends_with(said), "{}", verdicts[0].why);
        let told = |name: &str| verdicts[0].evidence.iter().any(|e| e.indicator == name);
        assert!(told("envelope_line_bpfi_between_events") && told("envelope_line_bpfo"));
        assert_eq!(verdicts[1].state, State::Healthy, "{}", verdicts[1].why);
        let small = judged(races(0.1, 0.01), races(0.25, 0.01));
        assert_eq!(small[0].state, State::Healthy, "{}", small[0].why);
    }

    #[test]
    fn no_other_line_accuses_there() {
        // All elements pass the race at rest, and between events their passing is what is left.
        let mut between = races(0.1, 0.01);
        between[1] = at(107.0, search(0, DefectLine::Bpfo, 0.6));
        let verdicts = judged(races(0.1, 0.01), between);
        assert_eq!(verdicts[0].state, State::Healthy, "{}", verdicts[0].why);
    }

    #[test]
    fn nothing_is_asked_there_where_something_is_accused() {
        let verdicts = judged(races(0.1, 0.6), races(0.6, 0.6));
        assert_eq!(verdicts[1].fault, Some(FaultMode::InnerRace), "{}", verdicts[1].why);
        assert_ne!(verdicts[0].fault, Some(FaultMode::InnerRace), "{}", verdicts[0].why);
    }

    #[test]
    fn a_line_that_may_be_something_elses_in_all_of_the_turn_is_so_between() {
        let mut whole = races(0.6, 0.01);
        for reading in whole[0].outcome.iter_mut().flatten() {
            reading.outdone_by = Some(Hz(180.0));
        }
        let verdicts = judged(whole, races(0.6, 0.01));
        assert_eq!(verdicts[0].state, State::Undetermined, "{}", verdicts[0].why);
        assert!(verdicts[0].why.contains("the line at 180.0 Hz is higher"), "{}", verdicts[0].why);
    }

    #[test]
    fn it_is_paid_for() {
        let probability = |whole: Vec<LineSearch>, between: Vec<LineSearch>| {
            let verdict = judged(whole, between).remove(0);
            let line =
                verdict.evidence.iter().find(|e| e.indicator.starts_with("envelope_line_bpfi"));
            line.and_then(|line| line.false_alarm_probability).unwrap()
        };
        let alone = probability(races(0.6, 0.01), Vec::new());
        let between = probability(races(0.1, 0.01), races(0.6, 0.01));
        assert!((between / alone - 2.0).abs() < 1e-9, "{between}, {alone}");
    }
}
