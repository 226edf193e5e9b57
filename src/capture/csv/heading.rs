//! The cells above a table: names, units, and which of them means time.

use crate::units::SourceUnit;

/// Characters of a channel's name at most.
const NAME_CHARS_MAX: usize = 128;

/// Other spellings of accepted units.
const ALIASES: &[(&str, &str)] = &[
    ("m/s²", "m/s^2"),
    ("m/s2", "m/s^2"),
    ("m/s**2", "m/s^2"),
    ("m/s/s", "m/s^2"),
    ("µm", "um"),
    ("μm", "um"),
    ("RPM", "rpm"),
    ("r/min", "rpm"),
    ("1/min", "rpm"),
    ("U/min", "rpm"),
    ("mils", "mil"),
];

/// Units that are no vibration and no speed.
const OTHERS: &[&str] = &[
    "-", "1", "%", "°", "deg", "rad", "°C", "degC", "C", "K", "°F", "Pa", "kPa", "MPa", "bar",
    "mbar", "psi", "N", "kN", "Nm", "N·m", "W", "kW", "A", "mA", "mV", "kV", "dB", "kHz", "counts",
    "count",
];

/// Units of time, s.
const TIMES: &[(&str, f64)] = &[
    ("s", 1.0),
    ("sec", 1.0),
    ("seconds", 1.0),
    ("ms", 1e-3),
    ("us", 1e-6),
    ("µs", 1e-6),
    ("μs", 1e-6),
    ("ns", 1e-9),
    ("min", 60.0),
    ("h", 3600.0),
];

/// What a column of times may be called, lower case.
const TIME_NAMES: &[&str] = &[
    "t",
    "time",
    "zeit",
    "timestamp",
    "time stamp",
    "zeitstempel",
    "datetime",
    "date/time",
    "date time",
    "datum/zeit",
    "uhrzeit",
    "elapsed",
    "elapsed time",
    "elapsed_time",
    "seconds",
    "utc",
    "x_value",
];

/// A cell above a column.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Heading {
    /// As written, without outer blanks.
    pub(super) written: String,
    /// Without the unit.
    pub(super) name: String,
    /// The unit, in the spelling of [`SourceUnit::ACCEPTED`] if it is one of them.
    pub(super) unit: Option<String>,
}

impl Heading {
    /// Takes a bracketed unit off a heading; brackets that hold no unit belong to the name.
    pub(super) fn parse(written: &str) -> Self {
        let written = written.trim();
        let with =
            |name: &str, unit| Self { written: written.to_owned(), name: name_of(name), unit };
        for (open, close) in [('[', ']'), ('(', ')')] {
            let inside = written.strip_suffix(close).and_then(|rest| rest.rsplit_once(open));
            if let Some((name, unit)) = inside
                && !name.trim().is_empty()
                && let Some(unit) = unit_of(unit)
            {
                return with(name.trim(), Some(unit));
            }
        }
        with(written, None)
    }

    /// Seconds in the unit of a column of times; `None` if its name means something else.
    pub(super) fn time_unit_s(&self) -> Option<f64> {
        let name = self.name.to_lowercase();
        let of_unit = |unit: &str| TIMES.iter().find(|(text, _)| *text == unit).map(|(_, s)| *s);
        if TIME_NAMES.contains(&name.as_str()) || TIME_NAMES.contains(&self.written.as_str()) {
            return Some(self.unit.as_deref().and_then(of_unit).unwrap_or(1.0));
        }
        let (stem, unit) = name.rsplit_once(['_', ' '])?;
        of_unit(unit).filter(|_| TIME_NAMES.contains(&stem))
    }
}

/// Reads a text as a unit, with brackets around it or without.
pub(super) fn unit_of(text: &str) -> Option<String> {
    let text = text.trim();
    let inside = |open, close| text.strip_prefix(open)?.strip_suffix(close);
    let text = inside('[', ']').or_else(|| inside('(', ')')).unwrap_or(text).trim();
    if let Some((_, accepted)) = ALIASES.iter().find(|(alias, _)| *alias == text) {
        return Some((*accepted).to_owned());
    }
    let known = SourceUnit::parse(text).is_some()
        || OTHERS.contains(&text)
        || TIMES.iter().any(|(unit, _)| *unit == text);
    known.then(|| text.to_owned())
}

/// A name that channels may have: no `/`, no control characters, not too long.
fn name_of(text: &str) -> String {
    let plain = |c: char| if c == '/' || c.is_control() { '_' } else { c };
    let name: String = text.chars().take(NAME_CHARS_MAX).map(plain).collect();
    if name == "." || name == ".." { name.replace('.', "_") } else { name }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_in_brackets_are_taken_off() {
        for (written, name, unit) in [
            (" acc x [g] ", "acc x", Some("g")),
            ("DE (m/s²)", "DE", Some("m/s^2")),
            ("a/b[mm/s]", "a_b", Some("mm/s")),
            ("temperature (°C)", "temperature", Some("°C")),
            ("bearing (left)", "bearing (left)", None),
            ("acc_g", "acc_g", None),
            ("[g]", "[g]", None),
            ("..", "__", None),
        ] {
            let found = Heading::parse(written);
            assert_eq!((found.name.as_str(), found.unit.as_deref()), (name, unit), "{written}");
        }
    }

    #[test]
    fn times_are_known_by_name_and_unit() {
        for (written, unit_s) in [
            ("t", Some(1.0)),
            ("Time [ms]", Some(1e-3)),
            ("Zeit (s)", Some(1.0)),
            ("time_us", Some(1e-6)),
            ("Elapsed Time (min)", Some(60.0)),
            ("date/time", Some(1.0)),
            ("temperature", None),
            ("thrust_s", None),
            ("", None),
        ] {
            assert_eq!(Heading::parse(written).time_unit_s(), unit_s, "{written}");
        }
    }
}
