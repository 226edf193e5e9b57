//! The windows of a minute as one row: verdicts bit by bit, texts once each.

use super::codec::Deflater;
use super::codec::Reader;
use super::codec::Writer;
use crate::alarms::past::PastVerdict;
use crate::alarms::past::PastWindow;
use crate::signal::Timestamp;
use crate::store::names;
use crate::units::Hz;

/// A text that is not there.
const NONE: u16 = u16::MAX;

/// The texts of a row, each once.
#[derive(Debug, Default)]
struct Texts(Vec<String>);

impl Texts {
    fn place(&mut self, text: &str) -> u16 {
        let known = self.0.iter().position(|held| held == text);
        let place = known.unwrap_or_else(|| {
            self.0.push(text.to_owned());
            self.0.len() - 1
        });
        // A minute has hundreds of texts at most; what is beyond is left out.
        u16::try_from(place).unwrap_or(NONE)
    }

    fn of(&self, place: u16) -> Option<&str> {
        self.0.get(usize::from(place)).map(String::as_str)
    }
}

/// Writes the windows of a minute; `None`: memory is short.
pub(super) fn write(windows: &[PastWindow], deflater: &mut Deflater) -> Option<Vec<u8>> {
    let mut texts = Texts::default();
    let mut words = Vec::new();
    let (mut severities, mut confidences) = (Vec::new(), Vec::new());
    for window in windows {
        words.push(texts.place(window.operating.name()));
        words.push(short(window.baselines.len()));
        for (id, name) in &window.baselines {
            words.push(id.as_deref().map_or(NONE, |id| texts.place(id)));
            words.push(texts.place(name));
        }
        words.push(short(window.absent.len()));
        words.extend(window.absent.iter().map(|channel| short(*channel)));
        words.push(short(window.verdicts.len()));
        for verdict in &window.verdicts {
            words.push(texts.place(verdict.kind.name()));
            words.push(texts.place(&verdict.id));
            words.push(texts.place(verdict.state.name()));
            words.push(verdict.fault.map_or(NONE, |fault| texts.place(fault.name())));
            words.push(texts.place(&verdict.why));
            severities.push(verdict.severity.unwrap_or(f64::NAN));
            confidences.push(verdict.confidence.unwrap_or(f64::NAN));
        }
    }
    let column = |of: fn(&PastWindow) -> f64| windows.iter().map(of).collect::<Vec<f64>>();
    let mut row = Writer::default();
    row.f64s(&column(|window| window.time_s));
    row.f64s(&column(|window| window.duration_s));
    row.f64s(&column(|window| window.speed.map_or(f64::NAN, |speed| speed.0)));
    row.i64s(&windows.iter().map(|window| window.run.0).collect::<Vec<_>>());
    row.f64s(&severities);
    row.f64s(&confidences);
    row.u16s(&words);
    row.u32(texts.0.len());
    texts.0.iter().for_each(|text| row.text(text));
    row.finish(deflater)
}

fn short(count: usize) -> u16 {
    u16::try_from(count).unwrap_or(NONE)
}

/// Reads the windows of a row; `None`: it is damaged, or says what this program does not know.
pub(super) fn read(row: &[u8]) -> Option<Vec<PastWindow>> {
    let mut row = Reader::new(row)?;
    let (times, durations, speeds) = (row.f64s()?, row.f64s()?, row.f64s()?);
    let runs = row.i64s()?;
    let (severities, confidences) = (row.f64s()?, row.f64s()?);
    let words = row.u16s()?;
    let n_texts = row.u32()?;
    let texts: Vec<String> =
        (0..n_texts.min(usize::from(NONE))).map(|_| row.text()).collect::<Option<_>>()?;
    let n = times.len();
    if !row.is_at_end() || [durations.len(), speeds.len(), runs.len()] != [n; 3] {
        return None;
    }
    let texts = Texts(texts);
    let mut words = words.into_iter();
    let mut numbers = severities.into_iter().zip(confidences);
    let mut windows = Vec::with_capacity(n);
    for place in 0..n {
        windows.push(PastWindow {
            time_s: times[place],
            duration_s: durations[place],
            run: Timestamp(runs[place]),
            operating: names::operating(texts.of(words.next()?)?)?,
            speed: known(speeds[place]).map(Hz),
            baselines: baselines(&mut words, &texts)?,
            absent: (0..words.next()?)
                .map(|_| words.next().map(usize::from))
                .collect::<Option<_>>()?,
            verdicts: verdicts(&mut words, &mut numbers, &texts)?,
        });
    }
    Some(windows)
}

fn known(value: f64) -> Option<f64> {
    (!value.is_nan()).then_some(value)
}

fn baselines(
    words: &mut impl Iterator<Item = u16>,
    texts: &Texts,
) -> Option<Vec<(Option<String>, String)>> {
    let n = words.next()?;
    (0..n)
        .map(|_| {
            let id = words.next()?;
            let id = if id == NONE { None } else { Some(texts.of(id)?.to_owned()) };
            Some((id, texts.of(words.next()?)?.to_owned()))
        })
        .collect()
}

fn verdicts(
    words: &mut impl Iterator<Item = u16>,
    numbers: &mut impl Iterator<Item = (f64, f64)>,
    texts: &Texts,
) -> Option<Vec<PastVerdict>> {
    let n = words.next()?;
    (0..n)
        .map(|_| {
            let (severity, confidence) = numbers.next()?;
            Some(PastVerdict {
                kind: names::component_kind(texts.of(words.next()?)?)?,
                id: texts.of(words.next()?)?.to_owned(),
                state: names::health(texts.of(words.next()?)?)?,
                fault: match words.next()? {
                    NONE => None,
                    fault => Some(names::fault(texts.of(fault)?)?),
                },
                severity: known(severity),
                confidence: known(confidence),
                why: texts.of(words.next()?)?.to_owned(),
            })
        })
        .collect()
}
