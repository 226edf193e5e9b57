//! What a person is told of an error: its message and why. Must not know any error of this program.

use std::error::Error;

/// An error's message followed by those of its causes, each once: one that ends with its cause's message has
/// told it already.
#[must_use]
pub fn with_causes(error: &dyn Error) -> String {
    let causes = std::iter::successors(error.source(), |&cause| cause.source());
    causes.fold(error.to_string(), |text, cause| {
        let why = cause.to_string();
        if text.ends_with(&why) { text } else { format!("{text}: {why}") }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, thiserror::Error)]
    #[error("{text}")]
    struct Told {
        text: &'static str,
        source: Option<Box<Self>>,
    }

    fn told(texts: &[&'static str]) -> Option<Box<Told>> {
        let (text, causes) = texts.split_first()?;
        Some(Box::new(Told { text, source: told(causes) }))
    }

    #[test]
    fn every_cause_is_told_once() {
        let text = |texts: &[&'static str]| with_causes(&*told(texts).unwrap());
        assert_eq!(text(&["a"]), "a");
        assert_eq!(text(&["a", "b", "c"]), "a: b: c");
        assert_eq!(text(&["writing failed: disk full", "disk full"]), "writing failed: disk full");
        assert_eq!(text(&["a: b", "b", "c"]), "a: b: c");
    }
}
