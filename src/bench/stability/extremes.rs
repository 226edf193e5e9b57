//! Both ends of what every number of a scene's file and of a machine's file may be.
//!
//! The reader itself says what it allows: a number far out of range is put in the place of each number in turn, and
//! the range is read out of the mistake it reports. Both ends must then be accepted and work, or be refused with a
//! reason; what lies beyond must be refused.

use super::rows::Row;
use crate::bench::BenchError;
use crate::bench::records::steps;
use crate::machine;
use crate::machine::file::Mistake;
use crate::simulator::scene::{Scene, builtin};
use crate::simulator::simulation::{AdvanceError, Simulation};
use std::convert::Infallible;
use std::panic::{AssertUnwindSafe, catch_unwind};
use toml::{Table, Value};

/// Scenes whose numbers are varied, fewest parts first.
const SCENES: [&str; 5] =
    ["seed-bow-2hz", "seed-bearing-40hz-3", "run-up", "seed-gear-10hz", "reducer-10hz"];

/// Length of a run, s.
const RUN_S: f64 = 0.005;

/// A machine with limits.
const MACHINE: &str = include_str!("../../../config/machines/pump.toml");

/// What a reader makes of a text, and what runs of it: mistakes, or a failure in words.
type Try<'a> = dyn Fn(&str) -> Answer + 'a;

enum Answer {
    /// It was read and works.
    Works,
    /// It was refused with reasons.
    Refused(Vec<Mistake>),
    /// It was accepted and does not work.
    Fails(String),
}

/// Keys of scenes and machines: how many ends work, how many are refused; a row for each that fails.
///
/// # Errors
///
/// [`BenchError`] when a built-in scene is not there.
pub fn values() -> Result<Vec<Row>, BenchError> {
    let mut rows = Vec::new();
    for name in SCENES {
        let absent = BenchError::Absent { case: name, what: "such built-in scene" };
        let text = builtin::text(name).ok_or(absent)?;
        rows.extend(of_document(name, text, &run_scene));
    }
    rows.extend(of_document("a machine", MACHINE, &read_machine));
    Ok(rows)
}

/// The scenes read, but not run: what a test may take.
///
/// # Errors
///
/// See [`values`].
pub fn values_read() -> Result<Vec<Row>, BenchError> {
    let text = builtin::text(SCENES[0]);
    let text = text.ok_or(BenchError::Absent { case: SCENES[0], what: "such built-in scene" })?;
    let mut rows = of_document(SCENES[0], text, &|text| match Scene::parse(text, "scene") {
        Ok(_) => Answer::Works,
        Err(errors) => Answer::Refused(errors.mistakes().to_vec()),
    });
    rows.extend(of_document("a machine", MACHINE, &read_machine));
    Ok(rows)
}

fn run_scene(text: &str) -> Answer {
    let scene = match Scene::parse(text, "scene") {
        Ok(scene) => scene,
        Err(errors) => return Answer::Refused(errors.mistakes().to_vec()),
    };
    let run = || {
        let mut simulation = match Simulation::new(&scene, 1) {
            Ok(simulation) => simulation,
            Err(errors) => return Answer::Refused(errors.mistakes().to_vec()),
        };
        let n = steps(RUN_S * simulation.rate_hz(), 1.0).clamp(10, 5000);
        match simulation.advance(n as u64, &mut |_, _| Ok::<(), Infallible>(())) {
            Ok(()) => Answer::Works,
            // Said in words that name a remedy: as good as refused.
            Err(AdvanceError::Diverged { .. }) => Answer::Refused(Vec::new()),
            Err(AdvanceError::Sink(never)) => match never {},
        }
    };
    catch_unwind(AssertUnwindSafe(run)).unwrap_or_else(|_| Answer::Fails("panics".to_owned()))
}

fn read_machine(text: &str) -> Answer {
    match machine::file::parse(text, "machine") {
        Ok(_) => Answer::Works,
        Err(errors) => Answer::Refused(errors.mistakes),
    }
}

/// One number in a document.
struct Place {
    path: Vec<Step>,
    is_whole: bool,
}

#[derive(Clone)]
enum Step {
    Key(String),
    Index(usize),
}

fn of_document(name: &'static str, text: &str, answer: &Try<'_>) -> Vec<Row> {
    let Ok(document) = text.parse::<Table>() else { return vec![failed(name, "is no TOML")] };
    if !matches!(answer(text), Answer::Works) {
        return vec![failed(name, "does not work as it stands")];
    }
    let mut places = Vec::new();
    numbers(&Value::Table(document.clone()), &mut Vec::new(), &mut places);
    let (mut n_ranges, mut n_work, mut n_refused, mut rows) = (0, 0, 0, Vec::new());
    for place in &places {
        let Some(ends) = range_of(place, &document, answer) else { continue };
        n_ranges += 1;
        for (value, is_inside) in ends {
            let text = with(&document, place, value);
            match (answer(&text), is_inside) {
                (Answer::Works, true) => n_work += 1,
                (Answer::Refused(_), _) => n_refused += 1,
                (Answer::Works, false) => {
                    rows.push(failed(name, &format!("{} = {value:e} is accepted", words(place))));
                }
                (Answer::Fails(why), _) => {
                    rows.push(failed(name, &format!("{} = {value:e} {why}", words(place))));
                }
            }
        }
    }
    let parameters = format!("{name}: {n_ranges} ranges, {n_work} ends work, {n_refused} refused");
    let n_failed = rows.len() as f64;
    let summary = Row::below("ends of ranges that fail", parameters, n_failed, 0.0)
        .in_terms_of("values")
        .because("an end works or is refused with a reason, beyond it nothing is accepted");
    // A document without ranges would prove nothing.
    let found = Row::new(
        "ranges found",
        name,
        places.len() as f64,
        n_ranges as f64,
        0.5 * places.len() as f64,
    )
    .in_terms_of("numbers with a range")
    .because("places of points and angles have none of their own");
    [vec![summary, found], rows].concat()
}

fn failed(name: &'static str, what: &str) -> Row {
    Row::below("end of a range that fails", format!("{name}: {what}"), 1.0, 0.0)
        .in_terms_of("values")
        .because("none may")
}

/// Every number below a value.
fn numbers(value: &Value, path: &mut Vec<Step>, places: &mut Vec<Place>) {
    match value {
        Value::Integer(_) | Value::Float(_) => {
            places.push(Place { path: path.clone(), is_whole: value.is_integer() });
        }
        Value::Array(list) => {
            for (i, value) in list.iter().enumerate() {
                path.push(Step::Index(i));
                numbers(value, path, places);
                path.pop();
            }
        }
        Value::Table(table) => {
            for (key, value) in table {
                path.push(Step::Key(key.clone()));
                numbers(value, path, places);
                path.pop();
            }
        }
        Value::String(_) | Value::Boolean(_) | Value::Datetime(_) => {}
    }
}

/// As a mistake names it: `bearing[0].elements`.
fn words(place: &Place) -> String {
    let mut text = String::new();
    for step in &place.path {
        match step {
            Step::Key(key) if text.is_empty() => text.push_str(key),
            Step::Key(key) => text.push_str(&format!(".{key}")),
            Step::Index(i) => text.push_str(&format!("[{i}]")),
        }
    }
    text
}

/// The document with another number at a place.
fn with(document: &Table, place: &Place, number: f64) -> String {
    let mut root = Value::Table(document.clone());
    let mut at = Some(&mut root);
    for step in &place.path {
        at = match step {
            Step::Key(key) => at.and_then(|value| value.get_mut(key.as_str())),
            Step::Index(i) => at.and_then(|value| value.get_mut(*i)),
        };
    }
    if let Some(value) = at {
        *value = if place.is_whole && number.abs() < 9e15 {
            #[expect(clippy::cast_possible_truncation, reason = "checked to fit")]
            let whole = number.round() as i64;
            Value::Integer(whole)
        } else {
            Value::Float(number)
        };
    }
    root.as_table().map(ToString::to_string).unwrap_or_default()
}

/// Four values, and whether each is inside: both ends, and what lies beyond them. `None` where the reader states no
/// range of its own.
fn range_of(place: &Place, document: &Table, answer: &Try<'_>) -> Option<[(f64, bool); 4]> {
    let path = words(place);
    [1e300, -1e300].into_iter().find_map(|far| {
        let Answer::Refused(mistakes) = answer(&with(document, place, far)) else { return None };
        let allowed = mistakes.iter().find(|mistake| mistake.path == path)?.allowed.clone();
        range_in(&allowed)
    })
}

/// `a number from 0 to 5`, `a number above 0 and up to 5`, `a whole number from 3 to 200`, `… to below 1`.
fn range_in(allowed: &str) -> Option<[(f64, bool); 4]> {
    let (is_whole, rest) = match allowed.strip_prefix("a whole number") {
        Some(rest) => (true, rest),
        None => (false, allowed.strip_prefix("a number")?),
    };
    let words: Vec<&str> = rest.split_whitespace().collect();
    let number = |word: Option<&&str>| word?.trim_end_matches([',', ';']).parse::<f64>().ok();
    let (low, has_low) = match *words.first()? {
        "from" => (number(words.get(1))?, true),
        "above" => (number(words.get(1))?, false),
        _ => return None,
    };
    let behind = words.iter().position(|word| *word == "to")?;
    let (high, has_high) = match *words.get(behind + 1)? {
        "below" => (number(words.get(behind + 2))?, false),
        word => (number(Some(&word))?, true),
    };
    let step =
        |end: f64| if is_whole { 1.0 } else { 1e-3 * end.abs().max(f64::MIN_POSITIVE * 1e6) };
    // Just inside an end that does not belong: the next number, or for 0 the smallest there is.
    let lowest = if has_low { low } else { low.next_up().max(low + f64::MIN_POSITIVE) };
    let highest = if has_high { high } else { high.next_down() };
    let below = if has_low { low - step(low) } else { low };
    let above = if has_high { high + step(high) } else { high };
    Some([(lowest, true), (highest, true), (below, false), (above, false)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_read_out_of_what_is_allowed() {
        let ends = |allowed| range_in(allowed).map(|ends| ends.map(|(value, _)| value));
        assert_eq!(ends("a whole number from 3 to 200"), Some([3.0, 200.0, 2.0, 201.0]));
        let [low, high, below, above] = ends("a number above 0 and up to 100").unwrap();
        assert!(low > 0.0 && low < 1e-300 && below == 0.0 && above > 100.0);
        assert_eq!(Some(high), Some(100.0));
        let [low, high, _, above] = ends("a number from 0 to below 0.5").unwrap();
        assert!(low == 0.0 && high < 0.5);
        assert_eq!(Some(above), Some(0.5));
        assert_eq!(ends("true or false"), None);
        assert_eq!(ends("a number"), None);
    }

    #[test]
    fn a_value_that_fails_is_a_row_that_does_not_hold() {
        let answer = |text: &str| {
            let value = text.parse::<Table>().unwrap()["a"].as_float().unwrap();
            if value > 5.0 {
                let (path, found) = ("a".to_owned(), "too much".to_owned());
                let allowed = "a number from 0 to 5".to_owned();
                Answer::Refused(vec![Mistake { line: 1, column: 1, path, found, allowed }])
            } else if value == 0.0 {
                Answer::Fails("panics".to_owned())
            } else {
                Answer::Works
            }
        };
        let rows = of_document("x", "a = 1.0", &answer);
        let missed: Vec<&Row> = rows.iter().filter(|row| !row.holds()).collect();
        // The summary, 0 which fails, and what is below 0 and accepted.
        assert_eq!(missed.len(), 3, "{missed:?}");
    }
}
