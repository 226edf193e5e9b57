//! What a part of the core carries from window to window, as a row of numbers and a row of words, so that it can
//! be kept and taken up again bit by bit. Must not know what they mean or where they are kept.

/// Most elements of a list that is read back: far beyond what any part carries.
const MAX_LIST: usize = 1 << 20;

/// Numbers and words in the order in which they were written.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Tape {
    /// The numbers, also those of [`Tape::write_count`] and [`Tape::write_flag`].
    pub numbers: Vec<f64>,
    /// The words.
    pub words: Vec<String>,
}

impl Tape {
    /// Writes numbers.
    pub fn write(&mut self, numbers: &[f64]) {
        self.numbers.extend_from_slice(numbers);
    }

    /// Writes a number that may be absent.
    pub fn write_option(&mut self, number: Option<f64>) {
        self.write_flag(number.is_some());
        self.numbers.extend(number);
    }

    /// Writes a yes or no.
    pub fn write_flag(&mut self, flag: bool) {
        self.numbers.push(f64::from(u8::from(flag)));
    }

    /// Writes a whole number, exact up to 2⁵³.
    pub fn write_count(&mut self, count: usize) {
        self.numbers.push(count as f64);
    }

    /// Writes a word.
    pub fn write_word(&mut self, word: &str) {
        self.words.push(word.to_owned());
    }

    /// Begins to read.
    #[must_use]
    pub fn reader(&self) -> Reader<'_> {
        Reader { numbers: &self.numbers, words: &self.words }
    }
}

/// Reads a tape in the order in which it was written; `None` everywhere: it holds something else.
#[derive(Debug, Clone)]
pub struct Reader<'a> {
    numbers: &'a [f64],
    words: &'a [String],
}

impl<'a> Reader<'a> {
    /// The next number.
    pub fn number(&mut self) -> Option<f64> {
        let (first, rest) = self.numbers.split_first()?;
        self.numbers = rest;
        Some(*first)
    }

    /// The next numbers.
    pub fn array<const N: usize>(&mut self) -> Option<[f64; N]> {
        let (first, rest) = self.numbers.split_first_chunk::<N>()?;
        self.numbers = rest;
        Some(*first)
    }

    /// The next number that may be absent.
    pub fn option(&mut self) -> Option<Option<f64>> {
        if self.flag()? { self.number().map(Some) } else { Some(None) }
    }

    /// The next yes or no.
    pub fn flag(&mut self) -> Option<bool> {
        match self.count()? {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        }
    }

    /// The next whole number.
    pub fn count(&mut self) -> Option<usize> {
        let number = self.number()?;
        #[expect(clippy::float_cmp, reason = "whole numbers are exact")]
        let is_whole = (0.0..=9e15).contains(&number) && number.trunc() == number;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "checked above"
        )]
        is_whole.then_some(number as usize)
    }

    /// A list that begins with its length.
    pub fn list<T>(&mut self, mut read: impl FnMut(&mut Self) -> Option<T>) -> Option<Vec<T>> {
        let n = self.count().filter(|n| *n <= MAX_LIST)?;
        // Nothing is allocated from the length: a list that ends early is none.
        let mut list = Vec::new();
        for _ in 0..n {
            list.push(read(self)?);
        }
        Some(list)
    }

    /// The next word.
    pub fn word(&mut self) -> Option<&'a str> {
        let (first, rest) = self.words.split_first()?;
        self.words = rest;
        Some(first)
    }

    /// Whether everything was read.
    #[must_use]
    pub fn is_at_end(&self) -> bool {
        self.numbers.is_empty() && self.words.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_written_is_read_in_order_and_nothing_else() {
        let mut tape = Tape::default();
        tape.write(&[0.1, f64::NAN]);
        tape.write_option(None);
        tape.write_option(Some(-0.0));
        tape.write_flag(true);
        tape.write_count(2);
        tape.write(&[7.0, 8.0]);
        tape.write_word("right");
        let mut reader = tape.reader();
        let bits = reader.array::<2>().unwrap().map(f64::to_bits);
        assert_eq!(bits, [0.1_f64, f64::NAN].map(f64::to_bits));
        assert_eq!(reader.option(), Some(None));
        assert_eq!(reader.option().flatten().map(f64::to_bits), Some((-0.0_f64).to_bits()));
        assert_eq!(reader.flag(), Some(true));
        assert_eq!(reader.list(Reader::number), Some(vec![7.0, 8.0]));
        assert_eq!((reader.word(), reader.word()), (Some("right"), None));
        assert!(reader.is_at_end() && reader.number().is_none());
    }

    #[test]
    fn a_length_that_is_not_there_is_nothing() {
        for numbers in [vec![1e18], vec![-1.0], vec![0.5], vec![3.0, 1.0], vec![f64::NAN]] {
            let tape = Tape { numbers, words: Vec::new() };
            assert_eq!(tape.reader().list(Reader::number), None);
        }
    }
}
