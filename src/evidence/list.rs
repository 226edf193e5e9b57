//! Lists of a capture's evidence group by name: what is written, and how it is read back.

use crate::capture::attachment::Attachment;
use crate::capture::attachment::Content;
use crate::capture::attachment::Kind;
use crate::tape::Tape;

/// Ends a word in a list of words.
const END: char = '\0';

/// All lists, in the order in which their checksum is taken.
pub(super) const NAMES: [(&str, Kind); 18] = [
    ("about", Kind::Text),
    ("settings", Kind::Text),
    ("channel_numbers", Kind::Numbers),
    ("channel_words", Kind::Text),
    ("window_time_s", Kind::Numbers),
    ("window_place", Kind::Counts),
    ("window_origin_s", Kind::Numbers),
    ("run_place", Kind::Counts),
    ("run_time_s", Kind::Numbers),
    ("feature_words", Kind::Text),
    ("feature_place", Kind::Counts),
    ("feature_value", Kind::Numbers),
    ("verdicts", Kind::Text),
    ("raised", Kind::Text),
    ("state_numbers", Kind::Numbers),
    ("state_words", Kind::Text),
    ("baseline_numbers", Kind::Numbers),
    ("baseline_words", Kind::Text),
];

/// Lists being made.
#[derive(Debug, Default)]
pub(super) struct Lists(Vec<Attachment>);

impl Lists {
    pub(super) fn text(&mut self, name: &str, text: String) {
        self.push(name, Content::Text(text));
    }

    pub(super) fn numbers(&mut self, name: &str, numbers: Vec<f64>) {
        self.push(name, Content::Numbers(numbers));
    }

    pub(super) fn counts(&mut self, name: &str, counts: Vec<i64>) {
        self.push(name, Content::Counts(counts));
    }

    pub(super) fn tape(&mut self, (numbers, words): (&str, &str), tape: Tape) {
        self.numbers(numbers, tape.numbers);
        self.text(words, joined(tape.words.iter().map(String::as_str)));
    }

    fn push(&mut self, name: &str, content: Content) {
        self.0.push(Attachment { name: name.to_owned(), content });
    }

    pub(super) fn into_attachments(self) -> Vec<Attachment> {
        self.0
    }
}

/// Lists that were read.
#[derive(Debug)]
pub(super) struct Found(pub(super) Vec<Attachment>);

impl Found {
    pub(super) fn text(&self, name: &str) -> Option<&str> {
        match self.of(name)? {
            Content::Text(text) => Some(text),
            Content::Numbers(_) | Content::Counts(_) => None,
        }
    }

    pub(super) fn numbers(&self, name: &str) -> Option<&[f64]> {
        match self.of(name)? {
            Content::Numbers(numbers) => Some(numbers),
            Content::Text(_) | Content::Counts(_) => None,
        }
    }

    pub(super) fn counts(&self, name: &str) -> Option<&[i64]> {
        match self.of(name)? {
            Content::Counts(counts) => Some(counts),
            Content::Text(_) | Content::Numbers(_) => None,
        }
    }

    pub(super) fn tape(&self, (numbers, words): (&str, &str)) -> Option<Tape> {
        let (numbers, words) = (self.numbers(numbers)?.to_vec(), split(self.text(words)?));
        Some(Tape { numbers, words })
    }

    fn of(&self, name: &str) -> Option<&Content> {
        self.0.iter().find(|list| list.name == name).map(|list| &list.content)
    }
}

/// Words one behind the other, each ended; one that contains the end is spelled without it.
pub(super) fn joined<'a>(words: impl Iterator<Item = &'a str>) -> String {
    words.fold(String::new(), |mut all, word| {
        all.extend(word.chars().map(|c| if c == END { '\u{fffd}' } else { c }));
        all.push(END);
        all
    })
}

pub(super) fn split(text: &str) -> Vec<String> {
    text.split_terminator(END).map(str::to_owned).collect()
}
