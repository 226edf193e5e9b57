//! Trials that were judged wrongly, kept so that anybody can look into them: the capture with its machine file, and the page of the
//! verdict.

use super::EvaluateError;
use super::files;
use super::grid::Wrong;
use crate::capture::error::CaptureError;
use crate::capture::writer::CaptureHeader;
use crate::capture::writer::CaptureWriter;
use crate::capture::writer::ChannelHeader;
use crate::capture::writer::ChannelSamples;
use crate::capture::writer::ChannelStorage;
use crate::cli::output::Output;
use crate::cli::output::Spared;
use crate::cli::page;
use crate::evaluation::summary::Record;
use crate::offline::Reference;
use crate::plot::escaped;
use crate::trials::Measured;
use crate::units::Unit;
use std::collections::BTreeSet;
use std::path::Path;
use std::path::PathBuf;
use std::sync::Arc;

/// Trials that are kept, at most: some megabytes each.
const MOST: usize = 50;

/// What is kept in a folder.
#[derive(Debug)]
pub(super) struct Kept {
    folder: PathBuf,
    names: BTreeSet<String>,
}

impl Kept {
    /// Nothing so far.
    pub(super) fn new(folder: &Path) -> Self {
        Self { folder: folder.to_owned(), names: BTreeSet::new() }
    }

    /// Writes a trial's capture and the page of its verdict, while there is room; gives the page's name.
    pub(super) fn take(
        &mut self,
        record: &Record,
        wrong: &Wrong,
    ) -> Result<Option<String>, EvaluateError> {
        if self.names.len() == MOST {
            return Ok(None);
        }
        let stem = format!("{}/wrong-{}", files::PAGES, files::slug(&record.file));
        let names = (1..).map(|n| if n == 1 { stem.clone() } else { format!("{stem}-{n}") });
        let Some(name) = names.into_iter().find(|name| !self.names.contains(name)) else {
            return Ok(None);
        };
        let capture = self.folder.join(format!("{name}.h5"));
        write(&wrong.measured, &capture)?;
        let reference = Reference {
            machine: Some(Arc::clone(&wrong.measured.machine)),
            ..Reference::default()
        };
        let text = page::of(
            &capture,
            &record.file,
            &wrong.diagnosis,
            &reference,
            &above(record, &capture),
        );
        let page = format!("{name}.html");
        let mut output = Output::open(Some(&self.folder.join(&page)), &Spared::nothing())?;
        output.write(&text.map_err(Box::new)?)?;
        output.finish()?;
        self.names.insert(name);
        Ok(Some(page))
    }
}

/// What is known of a trial, over the page of its verdict.
fn above(record: &Record, capture: &Path) -> String {
    let file = capture.file_name().unwrap_or_default().to_string_lossy();
    let outcome = record.score.as_ref().map_or("not scored", |score| score.outcome.name());
    format!(
        "<p class=\"soft\"><a href=\"../index.html\">All records</a>. Made as {}; outcome: {}. The record is \
         <a href=\"{file}\">{file}</a>, with its machine file and without baselines.</p>\n",
        escaped(&record.label),
        escaped(&outcome.replace('_', " ")),
    )
}

/// Writes a trial's record as a capture that holds its machine file.
fn write(measured: &Measured, to: &Path) -> Result<(), CaptureError> {
    let header = CaptureHeader {
        start_time: None,
        machine: Some(measured.machine_text.to_string()),
        shaft_speed: measured.hints.capture,
    };
    let mut writer = CaptureWriter::create(to, &header)?;
    for (info, samples) in measured.channels.iter().zip(&measured.samples) {
        let unit = (info.unit != Unit::Unknown).then(|| info.unit.symbol().to_owned());
        let header = ChannelHeader {
            name: info.name.clone(),
            sample_rate: info.sample_rate,
            unit,
            sensor: None,
            storage: ChannelStorage::Contiguous,
        };
        writer.channel(&header, ChannelSamples::F32(samples))?;
    }
    writer.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::score;
    use crate::offline;
    use crate::trials::Trial;
    use crate::trials::defect::Defect;
    use crate::trials::drawn;
    use crate::trials::drawn::plant::Kind;

    fn drawn(number: u64) -> Trial {
        let defect = Some((Defect::OuterRace, (5.0, 10.0)));
        let setting = drawn::Setting { kind: Kind::Usual, defect, number, seed: 7 };
        drawn::trial("drawn", &setting).unwrap()
    }

    fn wrong(trial: &Trial) -> (Record, Wrong) {
        let diagnosis = trial.diagnose().unwrap().unwrap();
        let record = Record {
            file: trial.name.clone(),
            dataset: trial.group.clone(),
            label: trial.label.clone(),
            known: trial.known.clone(),
            is_visible: None,
            over_sound: None,
            score: Ok(score::score(&trial.known, &[], &diagnosis).unwrap()),
            processor_s: None,
        };
        (record, Wrong { measured: trial.measured.clone(), diagnosis })
    }

    #[test]
    fn what_is_kept_is_judged_as_the_trial_was() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join(files::PAGES)).unwrap();
        let mut kept = Kept::new(dir.path());
        for number in 0..2 {
            let (record, wrong) = wrong(&drawn(number));
            let page = kept.take(&record, &wrong).unwrap().unwrap();
            let text = std::fs::read_to_string(dir.path().join(&page)).unwrap();
            let capture = dir.path().join(page.replace(".html", ".h5"));
            let again = offline::diagnose(&capture, &Reference::default(), &mut |_| ()).unwrap();
            assert_eq!(again.components, wrong.diagnosis.components, "{}", record.file);
            let name = capture.file_name().unwrap().to_str().unwrap();
            assert!(text.contains(name) && text.contains("outer_race"), "{text}");
        }
    }

    #[test]
    fn equal_names_are_kept_apart_and_no_more_than_there_is_room_for() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join(files::PAGES)).unwrap();
        let mut kept = Kept::new(dir.path());
        let (record, wrong) = wrong(&drawn(0));
        let (one, other) =
            (kept.take(&record, &wrong).unwrap(), kept.take(&record, &wrong).unwrap());
        assert!(one.is_some() && other.is_some() && one != other);
        kept.names.extend((2..MOST).map(|n| n.to_string()));
        assert_eq!(kept.take(&record, &wrong).unwrap(), None);
    }
}
