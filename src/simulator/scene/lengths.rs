//! Lengths and angles: one value, several keys, the unit in the key's name.

use crate::machine::file::range::NumberRange;
use crate::machine::file::reader::{Need, Section};

/// The keys of one length, each with its unit in m.
pub(super) type LengthKeys = &'static [(&'static str, f64)];

/// The keys of a length: `at` gives `at_mm`, `at_m`, `at_um`, `at_in`, `at_mil`.
macro_rules! length_keys {
    ($name:literal) => {
        &[
            (concat!($name, "_mm"), 1e-3),
            (concat!($name, "_m"), 1.0),
            (concat!($name, "_um"), 1e-6),
            (concat!($name, "_in"), 0.025_4),
            (concat!($name, "_mil"), 25.4e-6),
        ]
    };
}

pub(super) use length_keys;

/// Which lengths are meant.
#[derive(Debug, Clone, Copy)]
pub(super) enum Span {
    /// 0 < x ≤ this, m.
    Positive(f64),
    /// 0 ≤ x ≤ this, m.
    FromZero(f64),
    /// −this ≤ x ≤ this, m.
    Signed(f64),
}

impl Span {
    fn range(self, unit_m: f64) -> NumberRange {
        match self {
            Self::Positive(high) => NumberRange::positive_up_to(rounded(high / unit_m)),
            Self::FromZero(high) => NumberRange::closed(0.0, rounded(high / unit_m)),
            Self::Signed(high) => {
                NumberRange::closed(-rounded(high / unit_m), rounded(high / unit_m))
            }
        }
    }
}

/// A limit in a shape fit for a message: four digits.
fn rounded(limit: f64) -> f64 {
    format!("{limit:.3e}").parse().unwrap_or(limit)
}

/// Reads a length by whichever of its keys is there, m; two of them are a mistake.
pub(super) fn length(
    section: &mut Section<'_>,
    keys: LengthKeys,
    need: Need,
    span: Span,
) -> Option<f64> {
    let mut found = None;
    let mut n_there = 0;
    for &(key, unit_m) in keys {
        let value = section.number(key, Need::Optional, span.range(unit_m));
        if section.has(key) {
            n_there += 1;
            if n_there > 1 {
                section.refuse(key, "one key for this length, not two in different units");
                return None;
            }
            found = value.map(|value| value * unit_m);
        }
    }
    if let (0, Need::Required, Some((first, unit_m))) = (n_there, need, keys.first()) {
        let names: Vec<&str> = keys.iter().map(|(name, _)| *name).collect();
        let range = span.range(*unit_m);
        section.missing(first, format!("{range} (as one of {})", names.join(", ")));
    }
    found
}

/// Whether any key of a length is there.
pub(super) fn has_length(section: &Section<'_>, keys: LengthKeys) -> bool {
    keys.iter().any(|(key, _)| section.has(key))
}

/// Angles, degrees.
const DEGREES: NumberRange = NumberRange::closed(-360.0, 360.0);

/// Reads an angle in degrees, rad; 0 when absent.
pub(super) fn angle(section: &mut Section<'_>, key: &'static str) -> Option<f64> {
    if !section.has(key) {
        let _known = section.number(key, Need::Optional, DEGREES);
        return Some(0.0);
    }
    section.number(key, Need::Optional, DEGREES).map(f64::to_radians)
}

/// Reads a number that has a default.
pub(super) fn number_or(
    section: &mut Section<'_>,
    key: &'static str,
    range: NumberRange,
    default: f64,
) -> Option<f64> {
    let value = section.number(key, Need::Optional, range);
    if section.has(key) { value } else { Some(default) }
}
