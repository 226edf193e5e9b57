//! Where a bearing line may stand: slip, and what the bearing's geometry leaves open.
//!
//! Must not know spectra (docs/theory.md, F5, K16).

use super::bearing::DefectLine;
use super::bearing::KnownLine;
use super::bearing::coinciding;
use crate::machine::uncertainty::RelativeBand;
use crate::units::Hz;

/// Lowest and highest rate at which a line is sought: slip (F5) and what the geometry leaves (K16).
#[must_use]
pub fn searched_range(line: DefectLine, expected: Hz, band: RelativeBand) -> (Hz, Hz) {
    let both = band.and(line.tolerance());
    (Hz(expected.0 * (1.0 + both.low)), Hz(expected.0 * (1.0 + both.high)))
}

/// A rate known less well than this is uncertain beside the whole range of slip, −2…+1 %.
const WIDE: f64 = 0.03;

/// Whether the geometry leaves a line's rate open by more than slip does: where the line was found
/// then says little of whose it is.
#[must_use]
pub fn is_wide(band: RelativeBand) -> bool {
    band.widest() > WIDE
}

/// Finds which known line, if any, blocks a line whose geometry leaves `band`: one of those that
/// together cover every place it may stand at without slip.
#[must_use]
pub fn covering(
    expected: Hz,
    band: RelativeBand,
    known: &[KnownLine],
    resolution: Hz,
) -> Option<&KnownLine> {
    if band.is_zero() {
        return coinciding(expected, known, resolution);
    }
    let last = expected.0 * (1.0 + band.high);
    let mut place = Hz(expected.0 * (1.0 + band.low));
    loop {
        let near = known.iter().filter(|line| (line.frequency.0 - place.0).abs() < resolution.0);
        let line = near.max_by(|a, b| a.frequency.0.total_cmp(&b.frequency.0))?;
        let next = line.frequency.0 + resolution.0;
        if next > last {
            return Some(line);
        }
        if next <= place.0 {
            return None;
        }
        place = Hz(next);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_is_lost_only_if_known_lines_cover_all_of_it() {
        let line =
            |hz: f64| KnownLine { frequency: Hz(hz), spacing: Hz(hz), label: format!("{hz}") };
        let known = [line(100.0), line(101.0)];
        let found = |high: f64, resolution: f64| {
            let band = RelativeBand { low: 0.0, high };
            covering(Hz(100.0), band, &known, Hz(resolution)).map(|line| line.label.clone())
        };
        assert_eq!(found(0.0, 0.2).as_deref(), Some("100"));
        assert_eq!(found(0.01, 0.2), None, "between the two lines there is room");
        assert_eq!(found(0.01, 0.6).as_deref(), Some("101"));
        assert_eq!(found(0.03, 0.6), None);
    }
}
