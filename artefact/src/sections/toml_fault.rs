//! What is wrong with TOML that people write: syntax, keys and types, each located by its key.

use std::ops::Range;

use toml::Spanned;
use toml::de::{DeTable, DeValue, Error};

use super::error::Fault;
use super::suggest::advice;
use crate::text::shortened;

/// What to write where a table is expected.
pub const TABLE_ADVICE: &str = "write a section [name] or { key = value, … }";

/// Characters of the file that a message repeats at most.
pub const EXCERPT: usize = 60;

/// A mistake in the TOML itself.
pub fn syntax_fault(text: &str, error: &Error) -> Fault {
    let message = error.message().trim_end();
    let offset = error.span().map_or(text.len(), |span| span.start.min(text.len()));
    let before = text.get(..offset).unwrap_or(text);
    let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
    let line = before.matches('\n').count() + 1;
    let column = before[line_start..].chars().count() + 1;
    let content = text[line_start..].lines().next().unwrap_or("");
    let advice = if message.contains("duplicate") {
        "keep one of the two and delete the other"
    } else {
        "a line is `key = value` or `[section]`; a value is a number, true, false, \"text\", [ list ] or { table }"
    };
    Fault::new(
        format!("line {line}, column {column}"),
        format!("{message}, got `{}`", shortened(content.trim(), EXCERPT)),
        advice,
    )
}

/// A key that is unknown or missing, or a value of the wrong type.
///
/// Serde says what is wrong in words of its own; they are turned into ours here, and unknown wording is passed on.
pub fn key_fault(text: &str, root: &DeTable<'_>, error: &Error) -> Fault {
    let message = error.message();
    let span = error.span().unwrap_or(0..0);
    let found = locate(root, &span).unwrap_or_default();
    let place = found.path();
    let got = excerpt(text, span);

    if message.starts_with("unknown field ") {
        let key = match found.keys.last() {
            Some(Key::Name(name)) => name.as_str(),
            _ => "",
        };
        return Fault::new(
            found.parent(),
            format!("unknown key, got `{}`", shortened(key, EXCERPT)),
            advice(key, &known_words(message), "known keys here"),
        );
    }
    if let Some(key) = message.strip_prefix("missing field ") {
        let key = key.trim_matches('`');
        let advice = match key {
            "dataset" => "add a section [dataset] with `root = \"…\"`, the folder of the clouds".to_owned(),
            _ => format!("add `{key} = …`"),
        };
        return Fault::new(place, format!("required key missing, got no `{key}`"), advice);
    }
    if message.starts_with("unknown variant ") {
        let word = got.trim_matches(['"', '\'']);
        return Fault::new(
            place,
            format!("unknown word, got {got}"),
            advice(word, &known_words(message), "known words here"),
        );
    }
    if message.starts_with("wanted string or table") {
        return Fault::new(place, format!("expected a word, got {got}"), "write a word in quotes");
    }
    let expected = match message.rsplit_once(", expected ") {
        Some((kind, expected)) if kind.starts_with("invalid ") => expected,
        _ => return Fault::new(place, format!("{message}, got {got}"), "correct the value"),
    };
    if expected == "a sequence" {
        let advice = if place.ends_with("channel") {
            format!("write a section [[{place}]] for each")
        } else {
            "write values in brackets, with commas between them".to_owned()
        };
        return Fault::new(place, format!("expected a list, got {got}"), advice);
    }
    let (expected, advice) = match expected {
        "u32" => ("a whole number from 0 to 4294967295", "write a number without quotes and decimal point"),
        "u64" => (
            "a whole number from 0 to 9223372036854775807",
            "write a number without quotes and decimal point",
        ),
        "f64" => ("a number", "write a number without quotes"),
        "a string" => ("text", "put the text in quotes"),
        "a boolean" => ("true or false", "write true or false without quotes"),
        table if table.starts_with("struct ") => ("a table", TABLE_ADVICE),
        other => (other, "write one of these"),
    };
    Fault::new(place, format!("expected {expected}, got {got}"), advice)
}

/// The words in backticks after "expected": a message of serde lists what it knows there.
fn known_words(message: &str) -> Vec<&str> {
    let list = message.rsplit_once("`, expected ").map_or("", |(_, list)| list);
    list.split('`').skip(1).step_by(2).collect()
}

/// The keys that lead to a place in the file.
#[derive(Default)]
struct Found {
    keys: Vec<Key>,
}

enum Key {
    Name(String),
    /// Of a table in a list, from 1.
    Number(u32),
}

impl Found {
    fn path(&self) -> String {
        Self::join(&self.keys)
    }

    fn parent(&self) -> String {
        Self::join(&self.keys[..self.keys.len().saturating_sub(1)])
    }

    /// `ga.population`, or `channel 2: radius_cm`, as messages about what a channel means name it.
    fn join(keys: &[Key]) -> String {
        let (mut path, mut between) = (String::new(), "");
        for key in keys {
            match key {
                Key::Name(name) => {
                    path += between;
                    path += name;
                    between = ".";
                }
                Key::Number(number) => {
                    path += &format!(" {number}");
                    between = ": ";
                }
            }
        }
        if path.is_empty() { "top level".into() } else { path }
    }
}

/// The key or value that has exactly this span. The deepest, as a dotted key spans what it leads to.
fn locate(table: &DeTable<'_>, span: &Range<usize>) -> Option<Found> {
    for (key, value) in table {
        let below = match value.get_ref() {
            DeValue::Table(table) => locate(table, span),
            DeValue::Array(values) => locate_in_array(values, span),
            _ => None,
        };
        let here = || (key.span() == *span || value.span() == *span).then(Found::default);
        if let Some(mut found) = below.or_else(here) {
            found.keys.insert(0, Key::Name(key.get_ref().to_string()));
            return Some(found);
        }
    }
    None
}

fn locate_in_array(values: &[Spanned<DeValue<'_>>], span: &Range<usize>) -> Option<Found> {
    (1u32..).zip(values).find_map(|(number, value)| match value.get_ref() {
        DeValue::Table(table) => {
            let mut found = locate(table, span).or_else(|| (value.span() == *span).then(Found::default))?;
            found.keys.insert(0, Key::Number(number));
            Some(found)
        }
        DeValue::Array(values) => locate_in_array(values, span),
        _ => (value.span() == *span).then(Found::default),
    })
}

/// The text of a span on one short line.
pub fn excerpt(text: &str, span: Range<usize>) -> String {
    let words: Vec<&str> = text.get(span).unwrap_or("").split_whitespace().collect();
    shortened(&words.join(" "), EXCERPT)
}
