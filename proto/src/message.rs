//! A message for people: what went wrong, and what to do about it.

use std::error::Error;
use std::fmt;

/// What went wrong and what to do, apart. An error's text is the first on its first line and the second on all others;
/// whoever repeats an error inside another one, or for many machines, repeats only what went wrong.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Message {
    /// `where: what, got value`: one line.
    pub what: String,
    /// What to do: any number of lines, none if there is nothing to do.
    pub advice: String,
}

impl Message {
    /// The message of an error.
    pub fn of(error: &(impl fmt::Display + ?Sized)) -> Self {
        let text = error.to_string();
        let (what, advice) = text.split_once('\n').unwrap_or((&text, ""));
        Self { what: what.to_owned(), advice: advice.to_owned() }
    }
}

impl fmt::Display for Message {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.what)?;
        if self.advice.is_empty() { Ok(()) } else { write!(f, "\n{}", self.advice) }
    }
}

/// The innermost cause of an error, which says most: "connection refused" rather than "transport error".
pub fn root_cause<'a>(error: &'a (dyn Error + 'static)) -> &'a (dyn Error + 'static) {
    let mut cause = error;
    while let Some(source) = cause.source() {
        cause = source;
    }
    cause
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_root_cause_is_what_all_others_follow_from() {
        #[derive(Debug, thiserror::Error)]
        #[error("outer")]
        struct Outer(#[source] std::num::ParseIntError);
        let cause = "x".parse::<u8>().unwrap_err();
        assert_eq!(root_cause(&Outer(cause.clone())).to_string(), cause.to_string());
        assert_eq!(root_cause(&cause).to_string(), cause.to_string());
    }

    #[test]
    fn advice_is_everything_after_the_first_line() {
        let check = |text: &str, what: &str, advice: &str| {
            let message = Message::of(text);
            assert_eq!((message.what.as_str(), message.advice.as_str()), (what, advice));
            assert_eq!(message.to_string(), text);
        };
        check("a: must be 1, got 2", "a: must be 1, got 2", "");
        check("a: must be 1, got 2\nset it\nor leave it", "a: must be 1, got 2", "set it\nor leave it");
        check("", "", "");
    }
}
