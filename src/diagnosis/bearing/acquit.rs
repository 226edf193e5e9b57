//! What is said of a bearing's health where nothing accuses it and nothing leaves it open.
//!
//! Must not know why lines do not accuse.

use super::accept::Accepted;
use super::candidate::Candidate;
use super::doubt::Seen;
use super::heard_in;
use super::looked;
use crate::diagnosis::fault::State;
use crate::diagnosis::sensor;
use crate::diagnosis::severity;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::features::WindowFeatures;
use crate::features::bearing::DefectLine;
use crate::features::bearing::LineSearch;

/// Healthy, unless the range of a sensor cuts all that could be heard.
pub(super) fn acquit_what_is_heard(
    verdict: &mut ComponentDiagnosis,
    candidates: &[Candidate<'_>],
    searches: &[&LineSearch],
    seen: &Seen<'_>,
) {
    match sensor::all_cut(seen.features, heard_in(searches), seen.context) {
        Some(cut) => verdict.why = cut,
        None => acquit(verdict, candidates, searches, seen.accepted, seen.features),
    }
}

/// Healthy: no line of effect, and none that leaves doubt (`looked`, `doubt`).
fn acquit(
    verdict: &mut ComponentDiagnosis,
    candidates: &[Candidate<'_>],
    searches: &[&LineSearch],
    accepted: &[Accepted<'_>],
    features: &WindowFeatures,
) {
    // A line in few bands tells of structure: it weighs by its part of the half that would accuse.
    let weighed = |c: &Candidate<'_>| c.depth() * (2.0 * c.part()).min(1.0);
    let strongest = candidates.iter().map(weighed).fold(0.0, f64::max);
    verdict.state = State::Healthy;
    verdict.severity = Some(severity::not_accused(severity::of_depth(strongest)));
    // A line of some depth in some bands leaves doubt, the more of both.
    let doubt = |c: &Candidate<'_>| c.part() * (c.depth() / severity::WARNING_DEPTH).min(1.0);
    let doubt = candidates.iter().map(doubt).fold(0.0, f64::max);
    let speed = 0.5 + 0.5 * features.speed.confidence;
    verdict.confidence = Some(0.9 * speed * (1.0 - 0.5 * doubt));
    verdict.why = match candidates
        .iter()
        .filter(|c| c.n_showing > 0)
        .max_by(|a, b| a.depth().total_cmp(&b.depth()))
    {
        Some(c) if c.depth() > 0.0 => format!(
            "no defect line of effect: the deepest is {} with modulation depth {:.2} in {} of {} bands (accused from {:.2} in most)",
            c.search.line.name(),
            c.depth(),
            c.n_showing,
            c.n_bands,
            severity::WARNING_DEPTH
        ),
        Some(_) | None => "no defect line stands over the noise floor".to_owned(),
    };
    if !accepted.is_empty() {
        verdict.why.push_str("; what a stronger line explains was set aside");
    }
    for line in DefectLine::ALL {
        if let Some(why) = looked::not_read(line, searches) {
            verdict.why.push_str("; not looked for: ");
            verdict.why.push_str(&why);
        }
    }
}
