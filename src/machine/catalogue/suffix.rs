//! What the letters after a basic designation mean for the inside of a bearing.
//!
//! Most change nothing inside: seals, clearance, cage, tolerance, grease. Some change the contact
//! angle or the rolling elements; those are never ignored. What is not in these tables may do
//! either and is treated so. Must not know the rows.

use super::Series;

/// What a part of a designation means.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Meaning {
    /// Changes no rolling element: what it is, in a word.
    Outside(&'static str),
    /// Contact angle, degrees.
    ContactAngle(f64),
    /// The reinforced design of cylindrical roller bearings: other rollers than the plain one.
    Reinforced,
    /// Changes the rolling elements in a way that the catalogue does not hold.
    OtherElements(&'static str),
    /// In no table.
    Unknown,
}

type Table = &'static [(&'static [&'static str], Meaning)];

const SEAL: Meaning = Meaning::Outside("seal");
const CAGE: Meaning = Meaning::Outside("cage");
const FIT: Meaning = Meaning::Outside("paired or universal mounting");

/// Of every series.
const COMMON: Table = &[
    (
        &[
            "2RSH2", "2RSH", "2RSL", "2RS1", "2RS2", "2RSR", "2RST", "2RSC", "2RSJEM", "2RS",
            "RSH2", "RSH", "RSL", "RS1", "RS2", "RSR", "RS", "2HRS", "HRS", "2BRS", "BRS", "LLUA",
            "LLU", "LLB", "LLH", "LLF", "LLC", "LU", "LB", "LH", "DDU", "DDW", "DD", "DU", "VV",
            "V", "2NSE9", "2NSE", "2NSL", "NSE9", "NSE", "NSL", "2RU", "RU", "2RK", "RK", "2RD",
            "RD", "2NK", "NK",
        ],
        SEAL,
    ),
    (&["2RZ", "RZ", "2ZR", "2Z", "ZZE", "ZZS", "ZZ", "ZE", "ZR", "Z"], Meaning::Outside("shield")),
    (
        &[
            "C1", "C2", "CN", "C3", "C4", "C5", "CM", "CT", "CX", "C2H", "C2L", "C3H", "C3L",
            "CNH", "CNL",
        ],
        Meaning::Outside("clearance"),
    ),
    (
        &[
            "P0", "P6X", "P6", "P5", "P4", "P2", "P52", "P53", "P62", "P63", "P64", "P43", "SP",
            "UP",
        ],
        Meaning::Outside("tolerance"),
    ),
    (
        &[
            "TVPB", "TVP2", "TVP3", "TVP", "TVH", "TN9", "TNG", "TNH", "TN", "T2X", "T2", "T1",
            "TB", "T85", "T", "PH", "P", "JEM", "JA", "JP", "JH", "J", "MPB", "MP1A", "MP1B",
            "MP1", "MP", "MPA", "M1A", "M1B", "M1", "MA", "MB", "ML", "MT", "M", "FP", "FA", "F",
            "Y", "W", "G1", "G2", "L1", "X",
        ],
        CAGE,
    ),
    (&["NR", "N"], Meaning::Outside("snap ring groove")),
    (&["K30", "K"], Meaning::Outside("tapered bore")),
    (&["W33", "W20", "W64"], Meaning::Outside("lubrication")),
    (
        &[
            "MT33", "MT47", "GJN", "LHT23", "LHT", "WT", "GE2", "GE", "NS7S", "NS7", "AV2S",
            "AS2S", "5K", "2AS", "1K", "L014", "L627", "SRI2", "VT378", "GXN", "L038", "L055",
            "L069", "L207",
        ],
        Meaning::Outside("grease"),
    ),
    (&["S0", "S1", "S2", "S3", "HT", "HT1"], Meaning::Outside("heat treatment")),
    (&["VA301", "VA305", "VL0241", "VL2071", "VL0271"], Meaning::Outside("coating or insulation")),
    (&["HC5", "HC"], Meaning::Outside("ceramic balls")),
    (&["XL"], Meaning::Outside("quality class")),
    (&["QE6", "Q6", "Q5", "Q66", "V1", "V2", "V3"], Meaning::Outside("noise class")),
];

const ANGULAR: Table = &[
    (&["ACD", "ACE", "AC", "A5"], Meaning::ContactAngle(25.0)),
    // CT is C with a cage of polyamide (7205 CTYNSULP4), not a clearance of motors.
    (&["CD", "CE", "CT", "C"], Meaning::ContactAngle(15.0)),
    (&["BEA", "BE", "BG", "B"], Meaning::ContactAngle(40.0)),
    (&["A"], Meaning::ContactAngle(30.0)),
    (&["E"], Meaning::ContactAngle(25.0)),
    (&["CA", "CB", "CC", "GA", "GB", "GC", "GL", "GM", "UA", "UO", "UL", "SU", "SUL"], FIT),
    (&["DB", "DF", "DT", "DBA", "DBB", "DFA", "U", "G", "L"], FIT),
];

const ROLLER: Table = &[
    (&["EC", "EA", "ED", "EG", "E1", "E"], Meaning::Reinforced),
    (&["VH", "V"], Meaning::OtherElements("full complement of rollers")),
];

const DEEP_GROOVE: Table =
    &[(&["E"], Meaning::OtherElements("reinforced design with more or larger balls"))];

/// Tables of a series, those of its own first.
fn tables(series: Series) -> [Table; 2] {
    match series {
        Series::DeepGroove => [DEEP_GROOVE, COMMON],
        Series::AngularContact => [ANGULAR, COMMON],
        Series::CylindricalRoller => [ROLLER, COMMON],
    }
}

/// Longest chunk of letters and digits that is taken apart.
const MAX_CHUNK: usize = 20;

/// Takes a chunk of letters and digits apart into known suffixes, the longest first; `None` if it
/// is not made of them.
pub(super) fn take_apart(chunk: &str, series: Series) -> Option<Vec<(String, Meaning)>> {
    if chunk.is_empty() {
        return Some(Vec::new());
    }
    if chunk.len() > MAX_CHUNK {
        return None;
    }
    let mut heads: Vec<(&str, Meaning)> = Vec::new();
    for (names, meaning) in tables(series).into_iter().flatten() {
        for name in names.iter().filter(|name| chunk.starts_with(**name)) {
            if !heads.iter().any(|(known, _)| known == name) {
                heads.push((name, *meaning));
            }
        }
    }
    heads.sort_by_key(|(name, _)| std::cmp::Reverse(name.len()));
    heads.into_iter().find_map(|(name, meaning)| {
        let mut parts = vec![(name.to_owned(), meaning)];
        parts.extend(take_apart(&chunk[name.len()..], series)?);
        Some(parts)
    })
}

/// Takes the longest head of known suffixes off a chunk that ends in something else, if it tells of
/// the inside: an unknown tail must not hide the letter of the contact angle. The rest is unknown.
pub(super) fn peel(chunk: &str, series: Series) -> Vec<(String, Meaning)> {
    let decides = |meaning: &Meaning| {
        matches!(
            meaning,
            Meaning::ContactAngle(_) | Meaning::Reinforced | Meaning::OtherElements(_)
        )
    };
    let heads = (1..chunk.len()).rev().filter(|at| chunk.is_char_boundary(*at));
    let mut known = heads.filter_map(|at| {
        let parts = take_apart(&chunk[..at], series)?;
        parts.iter().any(|(_, meaning)| decides(meaning)).then_some((at, parts))
    });
    let mut parts = Vec::new();
    let mut rest = chunk;
    if let Some((at, found)) = known.next() {
        parts = found;
        rest = &chunk[at..];
    }
    parts.push((rest.to_owned(), Meaning::Unknown));
    parts
}
