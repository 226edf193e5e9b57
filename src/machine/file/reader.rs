//! Takes typed values out of TOML tables and reports what does not fit.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::ops::RangeInclusive;

use toml::Spanned;
use toml::de::{DeArray, DeTable, DeValue};

use super::MAX_TABLES;
use super::errors::{Log, one_line};
use super::range::NumberRange;
use crate::machine::nearest::suggestion;

/// Most identifiers listed in a message.
const MAX_LISTED: usize = 10;

/// Whether a key must be there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Need {
    /// Its absence is a mistake.
    Required,
    /// It may be absent.
    Optional,
}

/// A rule for text values.
pub(crate) struct TextRule {
    /// Whether a text keeps the rule.
    pub(crate) keeps: fn(&str) -> bool,
    /// The rule in words.
    pub(crate) allowed: &'static str,
}

/// One table of the document, with the keys that were asked of it.
pub(crate) struct Section<'s> {
    table: &'s DeTable<'s>,
    /// Byte offset at which it begins.
    at: usize,
    path: String,
    log: &'s Log<'s>,
    known: Vec<&'static str>,
}

/// Identifiers of the tables of one kind, by place; `None` where a table has no valid one.
pub(crate) struct Ids<'s> {
    /// As in a reference: `shaft`.
    name: &'static str,
    ids: Vec<Option<&'s str>>,
    by_id: BTreeMap<&'s str, usize>,
}

impl<'s> Section<'s> {
    /// The document itself.
    pub(crate) fn root(table: &'s DeTable<'s>, log: &'s Log<'s>) -> Self {
        Self { table, at: 0, path: String::new(), log, known: Vec::new() }
    }

    pub(crate) fn log(&self) -> &'s Log<'s> {
        self.log
    }

    pub(crate) fn path(&self) -> &str {
        &self.path
    }

    /// Byte offset of a key's value; of the table itself when the key is absent.
    pub(crate) fn at(&self, key: &str) -> usize {
        self.table.get(key).map_or(self.at, |value| value.span().start)
    }

    pub(crate) fn has(&self, key: &str) -> bool {
        self.table.contains_key(key)
    }

    /// Byte offset at which the table begins.
    pub(crate) fn start(&self) -> usize {
        self.at
    }

    /// Path of a key of this table.
    pub(crate) fn path_of(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }

    /// Reports the value of a key, as written, as not allowed.
    pub(crate) fn refuse(&self, key: &str, allowed: impl Into<String>) {
        let found = self.table.get(key).map_or("nothing".to_owned(), |value| self.found(value));
        self.log.report(self.at(key), self.path_of(key), found, allowed);
    }

    /// Reports a key as missing.
    pub(crate) fn missing(&self, key: &str, allowed: impl Into<String>) {
        self.log.report_derived(self.at, self.path_of(key), "nothing", allowed);
    }

    /// A finite number within `range`.
    pub(crate) fn number(
        &mut self,
        key: &'static str,
        need: Need,
        range: NumberRange,
    ) -> Option<f64> {
        let value = self.value(key, need, &range)?;
        let number = number_of(value.get_ref()).filter(|&number| range.contains(number));
        self.or_refuse(key, number, &range)
    }

    /// A whole number within `range`.
    pub(crate) fn whole(
        &mut self,
        key: &'static str,
        need: Need,
        range: RangeInclusive<u32>,
    ) -> Option<u32> {
        let allowed = format!("a whole number from {} to {}", range.start(), range.end());
        let value = self.value(key, need, &allowed)?;
        let whole = value
            .get_ref()
            .as_integer()
            .and_then(|integer| u32::from_str_radix(integer.as_str(), integer.radix()).ok())
            .filter(|whole| range.contains(whole));
        self.or_refuse(key, whole, &allowed)
    }

    /// `true` or `false`.
    pub(crate) fn flag(&mut self, key: &'static str) -> Option<bool> {
        let value = self.value(key, Need::Optional, &"true or false")?;
        self.or_refuse(key, value.get_ref().as_bool(), &"true or false")
    }

    /// A text that keeps `rule`.
    pub(crate) fn text(
        &mut self,
        key: &'static str,
        need: Need,
        rule: &TextRule,
    ) -> Option<&'s str> {
        let value = self.value(key, need, &rule.allowed)?;
        let text = value.get_ref().as_str().filter(|text| (rule.keeps)(text));
        self.or_refuse(key, text, &rule.allowed)
    }

    /// One of the spellings of `choices`.
    pub(crate) fn choice<T: Copy>(
        &mut self,
        key: &'static str,
        need: Need,
        choices: &[(&str, T)],
    ) -> Option<T> {
        let names = || choices.iter().map(|(name, _)| *name);
        let allowed = names().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ");
        let value = self.value(key, need, &allowed)?;
        let written = value.get_ref().as_str();
        let choice = choices.iter().find(|(name, _)| Some(*name) == written);
        let hint = suggestion(written.unwrap_or_default(), names());
        self.or_refuse(key, choice.map(|&(_, choice)| choice), &format!("{allowed}{hint}"))
    }

    /// The place of the table whose identifier stands here.
    pub(crate) fn reference(
        &mut self,
        key: &'static str,
        need: Need,
        ids: &Ids<'s>,
    ) -> Option<usize> {
        let what = format!("the id of a [[{}]]", ids.name);
        let value = self.value(key, need, &what)?;
        let Some(written) = value.get_ref().as_str() else {
            self.refuse(key, what);
            return None;
        };
        let index = ids.by_id.get(written).copied();
        if index.is_none() {
            let listed = ids.listed();
            let hint = suggestion(written, ids.by_id.keys().copied());
            let found = self.found(value);
            self.log.report_derived(
                self.at(key),
                self.path_of(key),
                found,
                format!("{what}{listed}{hint}"),
            );
        }
        index
    }

    /// The places of the tables whose identifiers are listed here, each once.
    pub(crate) fn references(
        &mut self,
        key: &'static str,
        need: Need,
        ids: &Ids<'s>,
    ) -> Option<Vec<usize>> {
        let what = format!("a list of ids of [[{}]], each once{}", ids.name, ids.listed());
        let value = self.value(key, need, &what)?;
        let place =
            |entry: &Spanned<DeValue<'_>>| ids.by_id.get(entry.get_ref().as_str()?).copied();
        let places = value
            .get_ref()
            .as_array()
            .and_then(|list| list.iter().map(place).collect::<Option<Vec<usize>>>())
            .filter(|places| {
                places.iter().enumerate().all(|(n, place)| !places[..n].contains(place))
            });
        self.or_refuse(key, places, &what)
    }

    /// A list of one or more of some words.
    pub(crate) fn words(
        &mut self,
        key: &'static str,
        words: &[&'static str],
    ) -> Option<Vec<&'static str>> {
        let what = format!("a list of one or more of {}", words.join(", "));
        let value = self.value(key, Need::Optional, &what)?;
        let word = |entry: &Spanned<DeValue<'_>>| {
            let text = entry.get_ref().as_str()?;
            words.iter().copied().find(|word| *word == text)
        };
        let found = value
            .get_ref()
            .as_array()
            .and_then(|list| list.iter().map(word).collect::<Option<Vec<_>>>())
            .filter(|found| !found.is_empty());
        self.or_refuse(key, found, &what)
    }

    /// `[low, high]`, two numbers of `range`, low < high.
    pub(crate) fn interval(&mut self, key: &'static str, range: NumberRange) -> Option<(f64, f64)> {
        let allowed = format!("[low, high], each {range}, low below high");
        let value = self.value(key, Need::Optional, &allowed)?;
        let ends = value.get_ref().as_array().and_then(|array| match array.as_ref() {
            [low, high] => Some((number_of(low.get_ref())?, number_of(high.get_ref())?)),
            _ => None,
        });
        let fits =
            ends.filter(|&(low, high)| range.contains(low) && range.contains(high) && low < high);
        self.or_refuse(key, fits, &allowed)
    }

    /// `[a, b, …]`: one to `max` numbers of `range`, each above the one before.
    pub(crate) fn rising(
        &mut self,
        key: &'static str,
        range: NumberRange,
        max: usize,
    ) -> Option<Vec<f64>> {
        let allowed =
            format!("a list of 1 to {max} numbers, each {range}, each above the one before");
        let value = self.value(key, Need::Optional, &allowed)?;
        let entries = value.get_ref().as_array().filter(|list| (1..=max).contains(&list.len()));
        let numbers = entries.and_then(|list| {
            list.iter().map(|entry| number_of(entry.get_ref())).collect::<Option<Vec<f64>>>()
        });
        let fits = numbers.filter(|numbers| {
            numbers.iter().all(|number| range.contains(*number))
                && numbers.is_sorted_by(|a, b| a < b)
        });
        self.or_refuse(key, fits, &allowed)
    }

    /// `[[a, b, …], …]`: rows of `width` finite numbers, at least one and at most [`MAX_TABLES`].
    pub(crate) fn rows(
        &mut self,
        key: &'static str,
        need: Need,
        width: usize,
        allowed: &str,
    ) -> Option<Vec<Vec<f64>>> {
        let value = self.value(key, need, &allowed)?;
        let row = |value: &Spanned<DeValue<'_>>| {
            let entries = value.get_ref().as_array().filter(|row| row.len() == width)?;
            let numbers = entries.iter().map(|entry| number_of(entry.get_ref()));
            numbers.map(|number| number.filter(|number| number.is_finite())).collect()
        };
        let array =
            value.get_ref().as_array().filter(|rows| (1..=MAX_TABLES).contains(&rows.len()));
        let rows = array.and_then(|array| array.iter().map(row).collect::<Option<Vec<_>>>());
        self.or_refuse(key, rows, &allowed)
    }

    /// Whether the value of a key is an array.
    pub(crate) fn is_array(&self, key: &str) -> bool {
        self.table.get(key).is_some_and(|value| value.get_ref().is_array())
    }

    /// A table: `[key]` or `key = { … }`.
    pub(crate) fn table(&mut self, key: &'static str, need: Need) -> Option<Self> {
        let value = self.value(key, need, &"a table")?;
        let table = self.or_refuse(key, value.get_ref().as_table(), &"a table")?;
        let (at, path) = (value.span().start, self.path_of(key));
        Some(Self { table, at, path, log: self.log, known: Vec::new() })
    }

    /// The tables of `[[key]]`, up to [`MAX_TABLES`].
    pub(crate) fn tables(&mut self, key: &'static str, need: Need) -> Vec<Self> {
        let allowed = format!("1 to {MAX_TABLES} tables [[{key}]]");
        let value = self.value(key, need, &allowed);
        let Some(array) = value.and_then(|value| self.array(key, value, &allowed)) else {
            return Vec::new();
        };
        if array.len() > MAX_TABLES || (array.is_empty() && need == Need::Required) {
            let found = format!("{} of them", array.len());
            self.log.report(self.at(key), key.to_owned(), found, allowed);
        }
        let mut sections = Vec::new();
        for (index, value) in array.iter().take(MAX_TABLES).enumerate() {
            let path = format!("{}[{index}]", self.path_of(key));
            let at = value.span().start;
            match value.get_ref().as_table() {
                Some(table) => {
                    sections.push(Self { table, at, path, log: self.log, known: Vec::new() });
                }
                None => self.log.report(at, path, self.found(value), "a table"),
            }
        }
        sections
    }

    /// Every key of a table of free keys, with its text; keys and texts must keep their rules.
    pub(crate) fn texts(
        self,
        key_rule: &TextRule,
        text_rule: &TextRule,
    ) -> BTreeMap<String, String> {
        let mut texts = BTreeMap::new();
        for (key, value) in self.table {
            let name: &str = key.get_ref();
            let path = format!("{}.{}", self.path, one_line(name));
            if !(key_rule.keeps)(name) {
                let found = format!("the key `{}`", one_line(name));
                self.log.report(key.span().start, path, found, key_rule.allowed);
                continue;
            }
            match value.get_ref().as_str().filter(|text| (text_rule.keeps)(text)) {
                Some(text) => drop(texts.insert(name.to_owned(), text.to_owned())),
                None => {
                    let found = self.found(value);
                    self.log.report(value.span().start, path, found, text_rule.allowed);
                }
            }
        }
        texts
    }

    /// Reports every key that was never asked for.
    pub(crate) fn finish(&self) {
        for (key, _) in self.table {
            let name: &str = key.get_ref();
            if self.known.contains(&name) {
                continue;
            }
            let hint = suggestion(name, self.known.iter().copied());
            let place = if self.path.is_empty() { self.log.kind() } else { self.path.as_str() };
            self.log.report(
                key.span().start,
                self.path_of(&one_line(name)),
                "an unknown key",
                format!("in {place}: {}{hint}", self.known.join(", ")),
            );
        }
    }

    /// The value of a key; reports its absence if it is needed.
    fn value(
        &mut self,
        key: &'static str,
        need: Need,
        allowed: &dyn Display,
    ) -> Option<&'s Spanned<DeValue<'s>>> {
        if !self.known.contains(&key) {
            self.known.push(key);
        }
        let value = self.table.get(key);
        if value.is_none() && need == Need::Required {
            self.missing(key, allowed.to_string());
        }
        value
    }

    fn or_refuse<T>(&self, key: &str, value: Option<T>, allowed: &dyn Display) -> Option<T> {
        if value.is_none() {
            self.refuse(key, allowed.to_string());
        }
        value
    }

    fn array(
        &self,
        key: &str,
        value: &'s Spanned<DeValue<'s>>,
        allowed: &dyn Display,
    ) -> Option<&'s DeArray<'s>> {
        self.or_refuse(key, value.get_ref().as_array(), allowed)
    }

    /// Words a value: scalars as written, the rest by type.
    fn found(&self, value: &Spanned<DeValue<'_>>) -> String {
        if let Some(array) = value.get_ref().as_array() {
            let excerpt = self.log.excerpt(value.span());
            return format!("an array of {} ({excerpt})", array.len());
        }
        if value.get_ref().is_table() {
            return "a table".to_owned();
        }
        self.log.excerpt(value.span())
    }
}

impl<'s> Ids<'s> {
    /// Reads `key` of every section as its identifier and reports those used twice.
    pub(crate) fn read(
        name: &'static str,
        key: &'static str,
        sections: &mut [Section<'s>],
        rule: &TextRule,
    ) -> Self {
        let mut ids = Vec::with_capacity(sections.len());
        let mut by_id: BTreeMap<&str, usize> = BTreeMap::new();
        for index in 0..sections.len() {
            let id = sections[index].text(key, Need::Required, rule);
            ids.push(id);
            let Some(id) = id else { continue };
            if let Some(&first) = by_id.get(id) {
                let (section, log) = (&sections[index], sections[index].log);
                let line = log.line(sections[first].at(key));
                section.refuse(key, format!("a {key} used once; line {line} has it already"));
            } else {
                by_id.insert(id, index);
            }
        }
        Self { name, ids, by_id }
    }

    /// The identifier of the table at a place.
    pub(crate) fn get(&self, index: usize) -> Option<&'s str> {
        self.ids.get(index).copied().flatten()
    }

    /// The first few identifiers, to choose from.
    fn listed(&self) -> String {
        let mut ids: Vec<&str> = self.ids.iter().flatten().copied().take(MAX_LISTED + 1).collect();
        if ids.is_empty() {
            return format!(", of which there is none (no [[{}]])", self.name);
        }
        if ids.len() > MAX_LISTED {
            ids[MAX_LISTED] = "…";
        }
        format!(": {}", ids.join(", "))
    }
}

/// A TOML integer or float as number.
fn number_of(value: &DeValue<'_>) -> Option<f64> {
    if let Some(float) = value.as_float() {
        return float.as_str().parse().ok();
    }
    let integer = value.as_integer()?;
    let whole = i64::from_str_radix(integer.as_str(), integer.radix()).ok()?;
    // Above 2⁵³ this rounds; every range ends far below.
    #[expect(clippy::cast_precision_loss, reason = "every allowed range ends far below 2^53")]
    Some(whole as f64)
}
