//! One error for everything a user types: it marks the place.

use std::fmt;
use std::ops::Range;

/// A text that could not be read, with the place that is wrong and what would be right.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ParseError {
    text: String,
    span: Range<usize>,
    what: String,
    hint: String,
}

impl ParseError {
    /// `span` is in bytes of `text`.
    pub fn new(
        text: &str,
        span: Range<usize>,
        what: impl Into<String>,
        hint: impl Into<String>,
    ) -> Self {
        ParseError {
            text: text.to_owned(),
            span,
            what: what.into(),
            hint: hint.into(),
        }
    }

    /// A complaint about all of `text`.
    pub fn usage(text: &str, what: &str, hint: &str) -> Self {
        ParseError::new(text, 0..text.len(), what, hint)
    }

    /// The same complaint, seen inside a longer text in which `self`'s text starts at byte `at`.
    pub(crate) fn within(self, outer: &str, at: usize) -> Self {
        ParseError {
            text: outer.to_owned(),
            span: at + self.span.start..at + self.span.end,
            ..self
        }
    }

    /// The same complaint about bytes `span` of another text.
    pub(crate) fn about(self, text: &str, span: Range<usize>) -> Self {
        ParseError {
            text: text.to_owned(),
            span,
            ..self
        }
    }

    /// With other words for what is wrong, about all of the text.
    pub(crate) fn instead(self, what: &str) -> Self {
        ParseError {
            span: 0..self.text.len(),
            what: what.to_owned(),
            ..self
        }
    }

    /// With more to its hint.
    pub(crate) fn also(mut self, hint: &str) -> Self {
        self.hint.push_str(hint);
        self
    }

    /// What is wrong, without the text and the hint.
    pub fn what(&self) -> &str {
        &self.what
    }

    /// What would be right.
    pub fn hint(&self) -> &str {
        &self.hint
    }

    /// The bytes of the text that are wrong.
    pub fn span(&self) -> Range<usize> {
        self.span.clone()
    }
}

impl fmt::Display for ParseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let column = |byte: usize| self.text.get(..byte).map_or(0, |s| s.chars().count());
        let (from, to) = (column(self.span.start), column(self.span.end));
        writeln!(f, "{}", self.what)?;
        writeln!(f, "    {}", self.text)?;
        write!(f, "    {:from$}{}", "", "^".repeat((to - from).max(1)))?;
        if !self.hint.is_empty() {
            write!(f, "\n  {}", self.hint)?;
        }
        Ok(())
    }
}

impl std::error::Error for ParseError {}

/// The parts of `text` between `separator`s with the byte each starts at.
pub(crate) fn split_at(text: &str, separator: char) -> impl Iterator<Item = (usize, &str)> {
    text.split(separator)
        .map(move |part| (part.as_ptr() as usize - text.as_ptr() as usize, part))
}

/// The one of `known` that is meant by a word that is none of them, if it is near to any.
pub fn nearest<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
    const LONGEST: usize = 32;
    let word: Vec<char> = word.chars().take(LONGEST + 1).collect();
    if word.len() > LONGEST {
        return None;
    }
    let near = known.iter().map(|known| (distance(&word, known), *known));
    let (distance, known) = near.min()?;
    (distance <= 1 + known.len() / 4).then_some(known)
}

/// How many letters are to be put in, left out or changed.
fn distance(word: &[char], known: &str) -> usize {
    let mut row: Vec<usize> = (0..=word.len()).collect();
    for (index, letter) in known.chars().enumerate() {
        let mut before = std::mem::replace(&mut row[0], index + 1);
        for (at, other) in word.iter().enumerate() {
            let changed = before + usize::from(!letter.eq_ignore_ascii_case(other));
            before = row[at + 1];
            row[at + 1] = changed.min(before + 1).min(row[at] + 1);
        }
    }
    row[word.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_meant_is_near() {
        let known = ["link", "clock", "zero", "resolution", "unit"];
        for (word, meant) in [
            ("clok", Some("clock")),
            ("Clock", Some("clock")),
            ("resolutoin", Some("resolution")),
            ("units", Some("unit")),
            ("x", None),
            ("colour", None),
            ("", None),
            ("éé", None),
        ] {
            assert_eq!(nearest(word, &known), meant, "{word}");
        }
        assert_eq!(nearest(&"k".repeat(100_000), &known), None);
    }
}
