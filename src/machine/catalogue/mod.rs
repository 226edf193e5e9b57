//! The bearing catalogue: a maker's designation in, internal geometry and its limits out.
//!
//! Published inner dimensions differ between makers, so an answer names what it rests on, how far
//! each fault order may be off, and what of the designation it ignored. Where the data are from and
//! how they were verified: `docs/adr/0006-bearing-catalogue.md`. Must not know machine files.
//!
//! `row` holds the data, `written` and `suffix` take a designation apart, this file joins them.

mod row;
mod suffix;
mod written;

pub use row::Row;
pub use row::Status;
pub use row::rows;
pub use suffix::Meaning;
pub use written::Part;

use super::bearing::BearingGeometry;
use super::bearing::RotatingRing;
use super::nearest::edit_distance;
use super::uncertainty::Design;
use super::uncertainty::OrderBands;
use std::collections::BTreeSet;
use written::Written;

/// Relative uncertainty of d/D when no source speaks of the maker: the designs of different makers
/// with equal numbers of balls differ by up to 8.0 % (`spread_between_makers_is_what_is_stated`). Rollers
/// run on raceways of standard diameters.
pub const OTHER_MAKER_GAMMA: f64 = 0.081;

/// Elements more or less when no source speaks of the maker.
pub const OTHER_MAKER_ELEMENTS: u32 = 1;

/// Most designations proposed for an unknown one.
const MAX_NEAREST: usize = 3;

/// Makers whose angular contact bearings without a suffix have 30°.
const AT_30_DEG: &[&str] = &["NTN", "NSK", "KYK", "KOYO", "NACHI", "SNR"];

/// Kinds of bearings in the catalogue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Series {
    /// 60, 62, 63, 160.
    DeepGroove,
    /// 72, 73.
    AngularContact,
    /// NU2, NU3 and their forms NJ, NUP, N.
    CylindricalRoller,
}

/// What a designation resolves to.
#[derive(Debug, Clone, PartialEq)]
pub struct Resolved {
    /// Basic designation with what decides the inside: `6205`, `7205B`, `NU205E`.
    pub designation: String,
    /// Maker named in the designation.
    pub maker: Option<&'static str>,
    /// Geometry to use.
    pub geometry: BearingGeometry,
    /// Every way the inside may be; the first is the one used.
    pub designs: Vec<Design>,
    /// Rows it rests on, the one used first.
    pub rows: Vec<&'static Row>,
    /// Parts of the designation that did not matter, or whose meaning is unknown.
    pub ignored: Vec<Part>,
    /// What a reader should know: choices made, and why the band is as wide as it is.
    pub remarks: Vec<String>,
}

/// Why a designation does not resolve.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Unresolved {
    /// No row.
    #[error("not in the catalogue (nearest: {})", nearest.join(", "))]
    Unknown {
        /// Nearest designations.
        nearest: Vec<&'static str>,
    },
    /// Two basic designations.
    #[error("names two bearings, {first} and {second}: write one")]
    TwoDesignations {
        /// The first.
        first: String,
        /// The other.
        second: String,
    },
    /// A cylindrical roller bearing without the letter of its design.
    #[error(
        "{base} is the older design with other rollers, which is not in the catalogue; if it is the reinforced one, write {base}E"
    )]
    DesignNotStated {
        /// Basic designation.
        base: String,
    },
}

/// Finds the inside of a bearing by its designation: maker, spaces, hyphens, case and suffixes as
/// people write them.
///
/// # Errors
///
/// [`Unresolved`] when no row answers; its text says what is near or missing.
///
/// # Examples
///
/// ```
/// use rotorwatch::machine::catalogue;
///
/// let found = catalogue::resolve("SKF 6205-2RSH/C3")?;
/// assert_eq!((found.designation.as_str(), found.geometry.elements()), ("6205", 9));
/// assert_eq!(found.ignored.len(), 2);
/// # Ok::<(), catalogue::Unresolved>(())
/// ```
pub fn resolve(text: &str) -> Result<Resolved, Unresolved> {
    let Some(written) = written::read(text) else {
        return Err(Unresolved::Unknown { nearest: nearest(text) });
    };
    if let Some(second) = &written.second {
        let (first, second) = (written.base.clone(), second.clone());
        return Err(Unresolved::TwoDesignations { first, second });
    }
    let mut remarks = Vec::new();
    let (designation, known) = known_rows(&written, &mut remarks)?;
    let makers: BTreeSet<&str> = known.iter().flat_map(|row| row.makers.clone()).collect();
    let of_maker = |row: &&&'static Row| written.maker.is_some_and(|m| row.makers.contains(&m));
    let own: Vec<&'static Row> = known.iter().filter(of_maker).copied().collect();
    let is_own = !own.is_empty();
    let rows = if is_own { own } else { known };
    let mut widened = false;
    if !is_own {
        widened = makers.len() < 2;
        remarks.push(about_makers(written.maker, &rows, widened));
    }
    for part in &written.parts {
        if let Some(why) = changes_inside(part) {
            remarks.push(format!("{why}: band widened"));
            widened = true;
        }
    }
    let angles_deg = angles(&written, &rows, &mut widened, &mut remarks);
    let designs = designs(&rows, &angles_deg, widened);
    let ignored = |part: &&Part| {
        matches!(part.meaning, Meaning::Outside(_) | Meaning::OtherElements(_) | Meaning::Unknown)
    };
    let Some(first) = designs.first() else {
        return Err(Unresolved::Unknown { nearest: nearest(text) });
    };
    Ok(Resolved {
        designation: designation + angle_letter(&written),
        maker: written.maker,
        geometry: first.geometry,
        ignored: written.parts.iter().filter(ignored).cloned().collect(),
        designs,
        rows,
        remarks,
    })
}

/// Rows whose designation begins with `start`, letters and digits compared without case.
#[must_use]
pub fn beginning_with(start: &str) -> Vec<&'static Row> {
    let plain: String = start.chars().filter(char::is_ascii_alphanumeric).collect();
    let start = plain.to_ascii_uppercase();
    rows().iter().filter(|row| !start.is_empty() && row.designation.starts_with(&start)).collect()
}

impl Resolved {
    /// Limits of the fault orders around those of [`Self::geometry`] (K15).
    #[must_use]
    pub fn bands(&self, ring: RotatingRing) -> OrderBands {
        OrderBands::around(&self.geometry, ring, &self.designs)
    }

    /// How well the least known of its rows is known.
    #[must_use]
    pub fn status(&self) -> Status {
        self.rows.iter().map(|row| row.status).max().unwrap_or(Status::Estimated)
    }

    /// Keys of `docs/references.bib`, each once.
    #[must_use]
    pub fn sources(&self) -> Vec<&'static str> {
        let all: BTreeSet<&str> = self.rows.iter().flat_map(|row| row.sources.clone()).collect();
        all.into_iter().collect()
    }

    /// One line on what was found, how well, and what was ignored.
    #[must_use]
    pub fn note(&self, ring: RotatingRing) -> String {
        let g = &self.geometry;
        let bands = self.bands(ring);
        let mut text = format!(
            "{} of the catalogue ({}): {} elements of {:.3} mm on {:.2} mm, {}°; \
             BPFO {}, BPFI {}, 2·BSF {}",
            self.designation,
            self.status().name(),
            g.elements(),
            g.element_diameter_m() * 1e3,
            g.pitch_diameter_m() * 1e3,
            g.contact_angle_rad().to_degrees().round(),
            percent(bands.bpfo),
            percent(bands.bpfi),
            percent(bands.two_bsf),
        );
        let ignored = self.ignored();
        if !ignored.is_empty() {
            text.push_str(&format!("; ignored: {ignored}"));
        }
        for remark in &self.remarks {
            text.push_str(&format!("; {remark}"));
        }
        text
    }

    /// What was ignored, in words; empty if nothing.
    #[must_use]
    pub fn ignored(&self) -> String {
        let word = |part: &Part| match part.meaning {
            Meaning::Outside(what) | Meaning::OtherElements(what) => {
                format!("{} ({what})", part.text)
            }
            Meaning::Unknown | Meaning::ContactAngle(_) | Meaning::Reinforced => {
                format!("{} (not known)", part.text)
            }
        };
        self.ignored.iter().map(word).collect::<Vec<_>>().join(", ")
    }

    /// Which orders of a geometry stated by hand lie outside the limits, in words; `None` if none.
    #[must_use]
    pub fn disagreement(&self, stated: &BearingGeometry, ring: RotatingRing) -> Option<String> {
        let bands = self.bands(ring);
        let (found, used) = (stated.fault_orders(ring), self.geometry.fault_orders(ring));
        let lines = [
            ("BPFO", found.bpfo, used.bpfo, bands.bpfo),
            ("BPFI", found.bpfi, used.bpfi, bands.bpfi),
            ("2·BSF", found.two_bsf(), used.two_bsf(), bands.two_bsf),
        ];
        // Half a unit of the fourth digit: what published figures are rounded to.
        let outside =
            |&(_, found, used, band): &(&str, f64, f64, super::uncertainty::RelativeBand)| {
                let relative = found / used - 1.0;
                relative < band.low - 5e-4 || relative > band.high + 5e-4
            };
        let told: Vec<String> = lines
            .iter()
            .filter(|line| outside(line))
            .map(|(name, found, used, band)| {
                format!("{name} {found:.3}, catalogue {used:.3} {}", percent(*band))
            })
            .collect();
        (!told.is_empty()).then(|| told.join(", "))
    }
}

/// A band in words: `±0.4 %`, or `-2.1…+0.3 %` when its limits differ.
#[must_use]
pub fn percent(band: super::uncertainty::RelativeBand) -> String {
    let (low, high) = (format!("{:.1}", -100.0 * band.low), format!("{:.1}", 100.0 * band.high));
    if low == high { format!("±{high} %") } else { format!("-{low}…+{high} %") }
}

/// Designation and rows of what was written, before makers are told apart.
fn known_rows(
    written: &Written,
    remarks: &mut Vec<String>,
) -> Result<(String, Vec<&'static Row>), Unresolved> {
    let of = |name: &str| -> Vec<&'static Row> {
        rows().iter().filter(|row| row.designation == name).collect()
    };
    let base = written.base.clone();
    let unknown = || Unresolved::Unknown { nearest: nearest(&base) };
    if written.series != Series::CylindricalRoller {
        let found = of(&base);
        return if found.is_empty() { Err(unknown()) } else { Ok((base, found)) };
    }
    let reinforced = format!("{base}E");
    let (mut plain, strong) = (of(&base), of(&reinforced));
    if written.parts.iter().any(|part| part.meaning == Meaning::Reinforced) {
        return if strong.is_empty() { Err(unknown()) } else { Ok((reinforced, strong)) };
    }
    match (plain.is_empty(), strong.is_empty()) {
        (true, true) => Err(unknown()),
        (true, false) => Err(Unresolved::DesignNotStated { base }),
        (false, true) => Ok((base, plain)),
        (false, false) => {
            remarks.push(format!(
                "no E or EC: the plain design is used, the band also holds {reinforced}"
            ));
            plain.extend(strong);
            Ok((base, plain))
        }
    }
}

/// Words what is known of which makers.
fn about_makers(maker: Option<&str>, rows: &[&'static Row], widened: bool) -> String {
    let of = |row: &&Row| {
        format!(
            "{} elements of {:.3} mm at {}",
            row.geometry.elements(),
            row.geometry.element_diameter_m() * 1e3,
            row.makers.join(" and ")
        )
    };
    let known: Vec<String> = rows.iter().map(of).collect();
    let who = maker.map_or("maker not named".to_owned(), |maker| format!("no data of {maker}"));
    let what = if widened {
        "the band holds one element more or less"
    } else if rows.len() > 1 {
        "the first is used, the band holds all"
    } else {
        "they agree"
    };
    format!("{who}: {}; {what}", known.join(", "))
}

/// Why a part means other rolling elements than the catalogue's, if it may.
fn changes_inside(part: &Part) -> Option<String> {
    match part.meaning {
        Meaning::OtherElements(what) => Some(format!("{}: {what}", part.text)),
        Meaning::Unknown => {
            Some(format!("{} is not known and may change the rolling elements", part.text))
        }
        Meaning::Outside(_) | Meaning::ContactAngle(_) | Meaning::Reinforced => None,
    }
}

/// The contact angle stated by a suffix, degrees.
fn stated_angle(written: &Written) -> Option<f64> {
    written.parts.iter().find_map(|part| match part.meaning {
        Meaning::ContactAngle(angle_deg) => Some(angle_deg),
        Meaning::Outside(_)
        | Meaning::Reinforced
        | Meaning::OtherElements(_)
        | Meaning::Unknown => None,
    })
}

/// Contact angles the bearing may have, the one used first.
fn angles(
    written: &Written,
    rows: &[&'static Row],
    widened: &mut bool,
    remarks: &mut Vec<String>,
) -> Vec<f64> {
    let of_rows = rows.first().map_or(0.0, |row| row.geometry.contact_angle_rad().to_degrees());
    if written.series != Series::AngularContact {
        return vec![of_rows];
    }
    match stated_angle(written) {
        Some(angle_deg) if angle_deg < of_rows - 0.5 => {
            remarks.push(format!(
                "{angle_deg}° is the precision design, whose balls may be others: band widened"
            ));
            *widened = true;
            vec![angle_deg]
        }
        Some(angle_deg) => vec![angle_deg],
        None if written.maker.is_some_and(|maker| AT_30_DEG.contains(&maker)) => {
            remarks.push("no suffix of the contact angle: 30° at this maker".to_owned());
            vec![of_rows]
        }
        None => {
            remarks.push(
                "no suffix of the contact angle: 30° used, the band also holds 40° (suffix B)"
                    .to_owned(),
            );
            vec![of_rows, 40.0]
        }
    }
}

/// Letter of the contact angle for the resolved designation.
fn angle_letter(written: &Written) -> &'static str {
    match stated_angle(written) {
        Some(angle_deg) if angle_deg > 35.0 => "B",
        Some(angle_deg) if angle_deg < 20.0 => "C",
        Some(angle_deg) if angle_deg < 28.0 => "AC",
        Some(_) | None => "",
    }
}

/// Every way the inside may be.
fn designs(rows: &[&'static Row], angles_deg: &[f64], widened: bool) -> Vec<Design> {
    let (elements, gamma) =
        if widened { (OTHER_MAKER_ELEMENTS, OTHER_MAKER_GAMMA) } else { (0, 0.0) };
    let mut found = Vec::new();
    for row in rows {
        let roller = row.designation.starts_with("NU");
        for angle_deg in angles_deg {
            let g = &row.geometry;
            let made = BearingGeometry::new(
                g.elements(),
                g.element_diameter_m(),
                g.pitch_diameter_m(),
                angle_deg.to_radians(),
            );
            found.extend(made.ok().map(|geometry| Design {
                geometry,
                elements_pm: row.elements_pm.max(elements),
                gamma_relative: row.gamma_relative.max(if roller { 0.0 } else { gamma }),
            }));
        }
    }
    found
}

/// Designations nearest to a text, nearest first.
fn nearest(text: &str) -> Vec<&'static str> {
    let limit = written::MAX_CHARS;
    let letters = text.to_uppercase();
    let written: Vec<char> =
        letters.chars().filter(char::is_ascii_alphanumeric).take(limit).collect();
    let names: BTreeSet<&'static str> = rows().iter().map(|row| row.designation).collect();
    let distance = |name: &str| edit_distance(&written, &name.chars().collect::<Vec<_>>());
    let mut ranked: Vec<(usize, &'static str)> =
        names.into_iter().map(|name| (distance(name), name)).collect();
    ranked.sort_unstable();
    ranked.into_iter().take(MAX_NEAREST).map(|(_, name)| name).collect()
}

#[cfg(test)]
mod tests;
