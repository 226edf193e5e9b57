//! A designation as people write it: maker, basic designation, suffixes. Must not know the rows.

use super::Series;
use super::suffix;
use super::suffix::Meaning;

/// Longest designation that is read, characters.
pub(super) const MAX_CHARS: usize = 100;

/// Makers whose names are taken off.
const MAKERS: &[&str] = &[
    "SKF",
    "FAG",
    "INA",
    "NSK",
    "NTN",
    "SNR",
    "KOYO",
    "JTEKT",
    "NACHI",
    "TIMKEN",
    "FAFNIR",
    "KYK",
    "ZKL",
    "ZVL",
    "URB",
    "RHP",
    "KBC",
    "HRB",
    "ZWZ",
    "LYC",
    "ISB",
    "NKE",
    "SLF",
    "MRC",
    "TPI",
    "FBJ",
    "RKB",
    "NMB",
    "EZO",
    "GMN",
    "GPZ",
    "CRAFT",
    "SCHAEFFLER",
    "FERSA",
    "KINEX",
    "IBC",
    "CX",
    "FLT",
    "PBC",
    "NBC",
    "TORRINGTON",
];

/// Letters before the basic designation that change nothing inside.
const PREFIXES: &[(&str, &str)] = &[
    ("W", "stainless steel"),
    ("SS", "stainless steel"),
    ("S", "stainless steel"),
    ("EC", "creep or expansion compensating"),
    ("TMB", "heat treatment"),
    ("AC", "creep or expansion compensating"),
];

/// Forms of one cylindrical roller bearing: the flanges differ, the rollers do not.
const ROLLER_FORMS: &[&str] = &["NUP", "NU", "NJ", "N"];

/// A part of a designation besides the basic one.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// As written, in capitals.
    pub text: String,
    /// What it means.
    pub meaning: Meaning,
}

/// A designation taken apart.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Written {
    pub(super) maker: Option<&'static str>,
    pub(super) series: Series,
    /// `6205`, `7205`, `NU205`: no suffix, forms of roller bearings as NU.
    pub(super) base: String,
    /// Another basic designation behind the first.
    pub(super) second: Option<String>,
    pub(super) parts: Vec<Part>,
}

/// Takes a designation apart; `None` if it does not begin like one of the series.
pub(super) fn read(text: &str) -> Option<Written> {
    if text.chars().count() > MAX_CHARS {
        return None;
    }
    let upper = text.to_uppercase();
    let mut tokens: Vec<&str> =
        upper.split(|c: char| !c.is_ascii_alphanumeric()).filter(|t| !t.is_empty()).collect();
    let maker = MAKERS.iter().copied().find(|maker| tokens.contains(maker));
    tokens.retain(|token| !MAKERS.contains(token));
    let glued = MAKERS.iter().copied().find(|maker| {
        let rest = tokens.first().and_then(|token| token.strip_prefix(maker));
        rest.is_some_and(|rest| core_of(rest).is_some())
    });
    if let (None, Some(glued), Some(first)) = (maker, glued, tokens.first_mut()) {
        *first = first.strip_prefix(glued).unwrap_or(first);
    }
    let (prefix, tokens) = without_prefix(&tokens);
    // The letters of a roller bearing may stand apart: `NU 205`.
    let joined = match tokens.as_slice() {
        [form, number, ..] if ROLLER_FORMS.contains(form) => [*form, *number].concat(),
        [first, ..] => (*first).to_owned(),
        [] => return None,
    };
    let n_used = if tokens.first().is_some_and(|t| ROLLER_FORMS.contains(t)) { 2 } else { 1 };
    let (series, base, form, rest) = core_of(&joined)?;
    let mut parts: Vec<Part> = prefix.into_iter().collect();
    if let Some(form) = form.filter(|form| *form != "NU") {
        let meaning = Meaning::Outside("flanges; the rollers are those of NU");
        parts.push(Part { text: form.to_owned(), meaning });
    }
    let second = second_designation(tokens.get(n_used..).unwrap_or_default());
    let chunks =
        std::iter::once(rest).chain(tokens.get(n_used..).unwrap_or_default().iter().copied());
    for chunk in chunks {
        let known =
            suffix::take_apart(chunk, series).unwrap_or_else(|| suffix::peel(chunk, series));
        parts.extend(known.into_iter().map(|(text, meaning)| Part { text, meaning }));
    }
    Some(Written { maker: maker.or(glued), series, base, second, parts })
}

/// The first of `tokens` that is a basic designation rather than a suffix: one of the series here, or
/// digits alone as of another series (`2205`).
fn second_designation(tokens: &[&str]) -> Option<String> {
    let is_number = |t: &str| (4..=5).contains(&t.len()) && t.bytes().all(|b| b.is_ascii_digit());
    let apart = tokens.windows(2).filter(|pair| ROLLER_FORMS.contains(&pair[0]));
    let whole = tokens.iter().filter(|t| core_of(t).is_some() || is_number(t));
    let whole = whole.map(|t| (*t).to_owned());
    whole.chain(apart.map(<[&str]>::concat).filter(|t| core_of(t).is_some())).next()
}

/// Takes a known prefix off, standing apart (`W 6205`) or not (`W6205`).
fn without_prefix<'t>(tokens: &[&'t str]) -> (Option<Part>, Vec<&'t str>) {
    let part = |text: &str, what| Part { text: text.to_owned(), meaning: Meaning::Outside(what) };
    for (prefix, what) in PREFIXES {
        if let [first, second, ..] = tokens
            && first == prefix
            && core_of(second).is_some()
        {
            return (Some(part(prefix, what)), tokens[1..].to_vec());
        }
        let rest = tokens.first().and_then(|first| first.strip_prefix(prefix));
        if let Some(rest) = rest.filter(|rest| rest.starts_with(|c: char| c.is_ascii_digit())) {
            let mut tokens = tokens.to_vec();
            tokens[0] = rest;
            return (Some(part(prefix, what)), tokens);
        }
    }
    (None, tokens.to_vec())
}

/// Series, basic designation, form of a roller bearing and what follows in the same chunk.
fn core_of(text: &str) -> Option<(Series, String, Option<&'static str>, &str)> {
    let form = ROLLER_FORMS.iter().copied().find(|form| {
        text.strip_prefix(form).is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit()))
    });
    let number = text.strip_prefix(form.unwrap_or_default())?;
    let n_digits = number.bytes().take_while(u8::is_ascii_digit).count();
    let (series, length) = match (form, number) {
        (Some(_), n) if n.starts_with(['2', '3']) => (Series::CylindricalRoller, 3),
        (None, n) if n.starts_with("160") => (Series::DeepGroove, 5),
        (None, n) if ["60", "62", "63"].iter().any(|s| n.starts_with(s)) => (Series::DeepGroove, 4),
        (None, n) if ["72", "73"].iter().any(|s| n.starts_with(s)) => (Series::AngularContact, 4),
        _ => return None,
    };
    let rest = number.get(length..).filter(|_| n_digits >= length)?;
    // Digits may only follow as the head of a seal or shield: `62052RS`.
    let glued = n_digits > length;
    if glued && !(n_digits == length + 1 && rest.starts_with('2') && rest.len() > 1) {
        return None;
    }
    let prefix = if form.is_some() { "NU" } else { "" };
    Some((series, format!("{prefix}{}", &number[..length]), form, rest))
}
