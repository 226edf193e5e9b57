//! The page texts are set on: its width, whether it shows colour, and the wrapping of words.

use crate::diagnosis::fault::State;
use console::Style;
use console::Term;
use std::io;
use std::io::IsTerminal;

/// Width of a page that is no terminal, columns.
const PLAIN_WIDTH: usize = 100;

/// Width of a terminal that does not tell its own.
const UNKNOWN_WIDTH: usize = 80;

/// Widths a page may have: narrower ones cannot hold a line, wider ones are hard to read.
const WIDTHS: (usize, usize) = (40, 160);

/// Where a text will stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Page {
    /// Columns.
    pub width: usize,
    /// Whether escape sequences for colour are understood and wanted.
    pub colour: bool,
}

impl Page {
    /// A file or pipe: fixed width, no colour.
    pub const PLAIN: Self = Self { width: PLAIN_WIDTH, colour: false };

    /// What stdout is connected to. No colour unless it is a terminal, `NO_COLOR` is empty and
    /// `TERM` is not `dumb`.
    #[must_use]
    pub fn of_stdout() -> Self {
        if !io::stdout().is_terminal() {
            return Self::PLAIN;
        }
        let columns = Term::stdout().size_checked().map(|(_, columns)| usize::from(columns));
        let no_colour = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
        let dumb = std::env::var_os("TERM").is_none_or(|value| value == "dumb");
        Self {
            width: columns.unwrap_or(UNKNOWN_WIDTH).clamp(WIDTHS.0, WIDTHS.1),
            colour: !no_colour && !dumb,
        }
    }

    /// `text` in the colour of a state.
    #[must_use]
    pub fn paint(&self, state: State, text: &str) -> String {
        let style = match state {
            State::Damaged => Style::new().red().bold(),
            State::Warning => Style::new().yellow().bold(),
            State::Healthy => Style::new().green(),
            State::Undetermined => Style::new().dim(),
        };
        style.force_styling(self.colour).apply_to(text).to_string()
    }

    /// Appends `text` in lines of the page's width, each `indent` columns in; a longer word has a
    /// line of its own. Control characters are shown, not sent.
    pub fn paragraph(&self, out: &mut String, indent: usize, text: &str) {
        self.hanging(out, indent, indent, text);
    }

    /// As [`Page::paragraph`], the lines after the first `rest` columns in.
    pub fn hanging(&self, out: &mut String, first: usize, rest: usize, text: &str) {
        let mut line = " ".repeat(first);
        let mut n_words = 0;
        for word in text.split_whitespace() {
            let word = clean(word);
            let gap = usize::from(n_words > 0);
            let width = columns(&line) + gap + columns(&word);
            if n_words > 0 && width > self.width {
                out.push_str(&line);
                out.push('\n');
                line = " ".repeat(rest);
                n_words = 0;
            } else if gap > 0 {
                line.push(' ');
            }
            line.push_str(&word);
            n_words += 1;
        }
        if n_words > 0 {
            out.push_str(&line);
            out.push('\n');
        }
    }
}

/// Columns a text takes.
#[must_use]
pub fn columns(text: &str) -> usize {
    console::measure_text_width(text)
}

/// Text from a file, its control characters escaped: a name cannot steer the terminal.
#[must_use]
pub fn clean(text: &str) -> String {
    let mut cleaned = String::with_capacity(text.len());
    for char in text.chars() {
        if char.is_control() {
            cleaned.extend(char.escape_default());
        } else {
            cleaned.push(char);
        }
    }
    cleaned
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_wrapped_at_the_width() {
        let page = Page { width: 20, colour: false };
        let mut out = String::new();
        page.hanging(&mut out, 2, 4, "BPFI 68 Hz and 3 harmonics stand 31 dB over");
        assert_eq!(out, "  BPFI 68 Hz and 3\n    harmonics stand\n    31 dB over\n");
        assert!(out.lines().all(|line| columns(line) <= 20));
    }

    #[test]
    fn a_word_wider_than_the_page_is_kept_whole() {
        let page = Page { width: 10, colour: false };
        let mut out = String::new();
        page.paragraph(&mut out, 2, "a rolling_element_line b");
        assert_eq!(out, "  a\n  rolling_element_line\n  b\n");
        let mut nothing = String::new();
        page.paragraph(&mut nothing, 2, " \n ");
        assert_eq!(nothing, "");
    }

    #[test]
    fn columns_are_counted_not_bytes() {
        let page = Page { width: 10, colour: false };
        let mut out = String::new();
        page.paragraph(&mut out, 0, "2·BSF 1× σσ µm");
        assert_eq!(out, "2·BSF 1×\nσσ µm\n");
    }

    #[test]
    fn colour_is_there_only_when_wanted() {
        let text = "damaged";
        assert_eq!(Page::PLAIN.paint(State::Damaged, text), text);
        let painted = Page { width: 80, colour: true }.paint(State::Damaged, text);
        assert!(painted.starts_with('\u{1b}') && painted.contains(text));
        assert_eq!(columns(&painted), 7);
    }

    #[test]
    fn names_cannot_steer_the_terminal() {
        let mut out = String::new();
        Page::PLAIN.paragraph(&mut out, 0, "ch\u{1b}[2J \u{7}x");
        assert_eq!(out, "ch\\u{1b}[2J \\u{7}x\n");
    }
}
