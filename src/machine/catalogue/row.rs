//! The rows of the data file. Must not know how a designation is written.

use crate::machine::bearing::BearingGeometry;
use std::sync::OnceLock;

/// The data, embedded: `docs/adr/0006-bearing-catalogue.md` says where it is from.
pub(super) const DATA: &str = include_str!("bearings.csv");

/// How well a row is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Status {
    /// Two independent sources agree on the number of elements and on d/D.
    Confirmed,
    /// Solved from one maker's pair of load ratings.
    Derived,
    /// The number of elements follows a rule; the band covers the rule's spread.
    Estimated,
}

impl Status {
    /// Its name in the data file and in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Confirmed => "confirmed",
            Self::Derived => "derived",
            Self::Estimated => "estimated",
        }
    }
}

/// One design of one designation.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Basic designation, e.g. `6205` or `NU205E`.
    pub designation: &'static str,
    /// Bore, mm.
    pub bore_mm: f64,
    /// Outer diameter, mm.
    pub outer_mm: f64,
    /// Nominal geometry, at the contact angle of the designation without a suffix.
    pub geometry: BearingGeometry,
    /// How far the number of elements may be off.
    pub elements_pm: u32,
    /// Relative uncertainty of d/D.
    pub gamma_relative: f64,
    /// Makers whose data the row rests on.
    pub makers: Vec<&'static str>,
    /// How well it is known.
    pub status: Status,
    /// Keys of `docs/references.bib`.
    pub sources: Vec<&'static str>,
    /// Published dynamic and static ratings, kN, of the row's first source that has them.
    pub ratings_kn: (f64, f64),
}

/// All rows, in the order of the file: series, bore, then the commonest design first.
#[must_use]
pub fn rows() -> &'static [Row] {
    static ROWS: OnceLock<Vec<Row>> = OnceLock::new();
    ROWS.get_or_init(|| lines().filter_map(read).collect())
}

/// Lines of data, without comments and heading.
pub(super) fn lines() -> impl Iterator<Item = &'static str> {
    DATA.lines().filter(|line| !line.starts_with('#')).skip(1)
}

/// Reads a line; `None` if it is none. A test holds that every line is one.
fn read(line: &'static str) -> Option<Row> {
    let cells: Vec<&'static str> = line.split(',').collect();
    let [
        designation,
        bore,
        outer,
        elements,
        elements_pm,
        element,
        pitch,
        angle,
        gamma,
        makers,
        status,
        sources,
        c,
        c0,
    ] = cells[..]
    else {
        return None;
    };
    let number = |cell: &str| cell.parse::<f64>().ok().filter(|n| n.is_finite());
    let geometry = BearingGeometry::new(
        elements.parse().ok()?,
        number(element)? * 1e-3,
        number(pitch)? * 1e-3,
        number(angle)?.to_radians(),
    );
    let statuses = [Status::Confirmed, Status::Derived, Status::Estimated];
    Some(Row {
        designation,
        bore_mm: number(bore)?,
        outer_mm: number(outer)?,
        geometry: geometry.ok()?,
        elements_pm: elements_pm.parse().ok()?,
        gamma_relative: number(gamma)? / 100.0,
        makers: makers.split('+').collect(),
        status: statuses.into_iter().find(|s| s.name() == status)?,
        sources: sources.split('+').collect(),
        ratings_kn: (number(c)?, number(c0)?),
    })
}
