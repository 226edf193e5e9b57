//! A diagnosis of a capture as a page: reads again the samples it rests on.

use crate::diagnosis::verdict::Diagnosis;
use crate::html;
use crate::html::Subject;
use crate::html::recording::Track;
use crate::offline;
use crate::offline::OfflineError;
use crate::offline::Reference;
use std::path::Path;

/// Sets the page of a diagnosis; `above` is HTML that stands over the verdict.
///
/// # Errors
/// When the capture cannot be read a second time.
pub fn of(
    file: &Path,
    name: &str,
    diagnosis: &Diagnosis,
    reference: &Reference,
    above: &str,
) -> Result<String, OfflineError> {
    let machine = offline::machine_of(file, reference)?;
    let stretches = offline::stretches(file, reference, &diagnosis.sample_ranges)?;
    let mut evened = offline::evened(file, reference, &stretches)?;
    let mut track = |s: offline::Stretch| {
        let at = evened.iter().position(|(name, ..)| *name == s.info.name);
        let even = at.map(|at| evened.swap_remove(at)).map(|(_, samples, rate)| (samples, rate));
        Track { info: s.info, start: s.start, start_s: s.start_s, samples: s.samples, even }
    };
    let tracks: Vec<Track> = stretches.into_iter().map(&mut track).collect();
    Ok(html::page(&Subject { name, diagnosis, machine: &machine, tracks: &tracks, above }))
}
