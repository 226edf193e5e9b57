//! Verdict on a shaft by its run: by the parts of bow and unbalance against those of healthy runs, where the speed changes or no
//! healthy record at this speed is there.

use super::NAMED_CONFIDENCE;
use super::accuse;
use super::accuse_at;
use super::acquit;
use super::cause;
use super::cause::Cause;
use super::cause::Growth;
use crate::diagnosis::Context;
use crate::diagnosis::fault::FaultMode;
use crate::diagnosis::verdict::ComponentDiagnosis;
use crate::features::WindowFeatures;
use crate::machine::ShaftIndex;

/// Judges a shaft in a window in which the speed changes; levels and lines of such a window compare with nothing.
pub(super) fn judge_run(
    verdict: &mut ComponentDiagnosis,
    shaft: ShaftIndex,
    features: &WindowFeatures,
    context: &Context<'_>,
) {
    verdict.why = features.speed.change();
    if judge_by_run(verdict, shaft, features, context) {
        return;
    }
    if let Some(top) = cause::top(shaft, features, context) {
        verdict.evidence = cause::evidence(shaft, top, features, context);
        verdict.why.push_str(", and no baseline of a run is there");
    }
}

/// Judges a shaft by its run alone, whatever the speed now; whether there are a run and healthy ones to hold it against.
pub(super) fn judge_by_run(
    verdict: &mut ComponentDiagnosis,
    shaft: ShaftIndex,
    features: &WindowFeatures,
    context: &Context<'_>,
) -> bool {
    let growth = cause::growth(shaft, features, context);
    if let Some(growth) = &growth {
        judge_growth(verdict, shaft, growth, features, context);
    }
    growth.is_some()
}

fn judge_growth(
    verdict: &mut ComponentDiagnosis,
    shaft: ShaftIndex,
    growth: &Growth,
    features: &WindowFeatures,
    context: &Context<'_>,
) {
    verdict.evidence = [&growth.bow, &growth.unbalance].map(|g| g.least.evidence.clone()).into();
    verdict.evidence.extend(cause::evidence(shaft, growth.top, features, context));
    let by = growth.larger();
    let text = format!(
        "at {:.1} Hz of the run the part of 1× that stays what it is at standstill is {:.1} times the baseline's whole, the part \
         that grows with the square of the speed {:.1} times, in {}{}",
        growth.top.0,
        growth.bow.least.ratio,
        growth.unbalance.least.ratio,
        by.evidence.channel,
        cause::by_what(shaft, features, context)
    );
    if by.is_up() {
        let told = cause::cause(shaft, growth.top, features, context);
        let fault = match told {
            Cause::Bow if growth.bow.least.is_up() => Some(FaultMode::Bow),
            Cause::Unbalance if growth.unbalance.least.is_up() => Some(FaultMode::Unbalance),
            Cause::Bow | Cause::Unbalance | Cause::Both | Cause::Open => None,
        };
        let said = match fault {
            Some(_) => {
                accuse_at(verdict, by, (fault, NAMED_CONFIDENCE), features);
                told.sentence()
            }
            None => {
                accuse(verdict, by, None, features);
                "; cause not proven"
            }
        };
        verdict.why = format!("{text}{said}");
    } else if growth.is_calm() {
        let most = growth.bow.most.max(growth.unbalance.most);
        let why = format!(
            "over the run no part of the 1× vector is more than {most:.1} times its baseline"
        );
        acquit(verdict, most, why, features);
    } else {
        verdict.why = format!("{text}: too uncertain to tell whether it is up");
    }
}
