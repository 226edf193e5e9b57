//! A capture judged again for HTTP, as `rotorwatch diagnose` and `diagnose --evidence` do.

use crate::api::handles::JudgedAgain;
use crate::causes::with_causes;
use crate::evidence;
use crate::evidence::again::Compared;
use crate::offline;
use crate::offline::Reference;
use std::path::Path;

/// Judges the whole by its own machine and baseline, and the windows that it keeps bit by bit.
pub(super) fn judge(file: &Path) -> Result<JudgedAgain, String> {
    let told = |error: &dyn std::error::Error| with_causes(error);
    let baseline = evidence::again::baseline(file).map_err(|error| told(&error))?;
    let reference = Reference { baseline: baseline.unwrap_or_default(), ..Reference::default() };
    let diagnosis =
        offline::diagnose(file, &reference, &mut |_| {}).map_err(|error| told(&error))?;
    let again = evidence::again::judge(file).map_err(|error| told(&error))?;
    let windows = again.as_ref().map_or(&[][..], |again| &again.windows);
    let n_equal = windows.iter().filter(|window: &&Compared| window.is_equal()).count();
    Ok(JudgedAgain {
        diagnosis,
        windows: (windows.len(), n_equal),
        made_elsewhere: again.as_ref().and_then(evidence::again::Again::made_elsewhere),
        then: again.and_then(|again| again.then),
    })
}
