//! From text to keys: TOML syntax, version and types, with every mistake located by its key.

use std::ops::Range;

use serde::Deserialize;
use toml::Spanned;
use toml::de::{DeString, DeTable, DeValue, Deserializer, Error};

use super::raw::RawExperiment;
use artefact::sections::{self, Fault};
use artefact::text::shortened;

/// The format's version that this program writes and reads.
const VERSION: i64 = 1;

const TABLE_ADVICE: &str = "write a section [name] or { key = value, … }";

/// Characters of the file that a message repeats at most.
const EXCERPT: usize = 60;

/// Every section. Serde would also read one from a list, by position.
pub(super) const SECTIONS: [&str; 16] = [
    "dataset",
    "dataset.splits",
    "dataset.splits.seeded",
    "dataset.synthetic",
    "preprocess",
    "descriptor",
    "descriptor.genes",
    "search",
    "search.fitness",
    "search.sets",
    "ga",
    "stop",
    "coordinator",
    "recognition",
    "results",
    "sweep",
];

/// Reads the text of an experiment file.
pub(super) fn parse(text: &str) -> Result<RawExperiment, Fault> {
    let root = DeTable::parse(text).map_err(|error| syntax_fault(text, &error))?;
    // Before all other keys: a newer file will have keys that are unknown here.
    check_version(text, root.get_ref())?;
    check_sections(text, root.get_ref())?;
    check_names(root.get_ref(), "")?;
    RawExperiment::deserialize(Deserializer::from(root.clone()))
        .map_err(|error| key_fault(text, root.get_ref(), &error))
}

/// The experiment as each variant of its sweep has it, by name, of a text that [`parse`] can read.
pub(super) fn parse_variants(text: &str) -> Result<Vec<(String, RawExperiment)>, Fault> {
    let mut root = DeTable::parse(text).map_err(|error| syntax_fault(text, &error))?;
    let sweep = root.get_mut().remove("sweep").map(Spanned::into_inner);
    let Some(DeValue::Table(mut sweep)) = sweep else { return Ok(Vec::new()) };
    let variants = sweep.remove("variants").map(Spanned::into_inner);
    let Some(DeValue::Table(variants)) = variants else { return Ok(Vec::new()) };
    let experiment = |(name, variant): (Spanned<DeString<'_>>, Spanned<DeValue<'_>>)| {
        let mut merged = root.clone();
        if let DeValue::Table(sections) = variant.into_inner() {
            for (section, settings) in sections {
                merge(merged.get_mut(), section, settings);
            }
        }
        let raw = RawExperiment::deserialize(Deserializer::from(merged.clone()))
            .map_err(|error| key_fault(text, merged.get_ref(), &error))?;
        Ok((name.into_inner().into_owned(), raw))
    };
    variants.into_iter().map(experiment).collect()
}

/// Replaces the keys of a section by those that `settings` has.
fn merge<'t>(root: &mut DeTable<'t>, section: Spanned<DeString<'t>>, settings: Spanned<DeValue<'t>>) {
    match (root.get_mut(section.get_ref().as_ref()).map(Spanned::get_mut), settings.get_ref()) {
        (Some(DeValue::Table(there)), DeValue::Table(settings)) => {
            for (key, value) in settings {
                there.remove(key.get_ref().as_ref());
                there.insert(key.clone(), value.clone());
            }
        }
        _ => drop(root.insert(section, settings)),
    }
}

fn check_version(text: &str, root: &DeTable<'_>) -> Result<(), Fault> {
    let Some(version) = root.get("version") else {
        return Err(Fault::new(
            "version",
            "required key missing, got none",
            "add a first line `version = 1`",
        ));
    };
    let number = match version.get_ref() {
        DeValue::Integer(number) => i64::from_str_radix(number.as_str(), number.radix()).ok(),
        _ => None,
    };
    match number {
        Some(VERSION) => Ok(()),
        Some(newer) if newer > VERSION => Err(Fault::new(
            "version",
            format!("newer than this program, which reads version {VERSION}, got {newer}"),
            "update the program on this machine",
        )),
        _ => Err(Fault::new(
            "version",
            format!("unknown version, got {}", excerpt(text, version.span())),
            "write `version = 1`",
        )),
    }
}

fn check_sections(text: &str, root: &DeTable<'_>) -> Result<(), Fault> {
    for section in SECTIONS {
        let mut keys = section.split('.');
        let first = keys.next().and_then(|key| root.get(key));
        let value = keys.fold(first, |value, key| match value?.get_ref() {
            DeValue::Table(table) => table.get(key),
            _ => None,
        });
        if let Some(list) = value.filter(|value| matches!(value.get_ref(), DeValue::Array(_))) {
            let got = excerpt(text, list.span());
            return Err(Fault::new(section, format!("expected a table, got {got}"), TABLE_ADVICE));
        }
    }
    Ok(())
}

/// Refuses a section that is none of [`SECTIONS`], before a key is missed that stands in it. `place` is the path of the
/// table, empty at the top.
fn check_names(table: &DeTable<'_>, place: &str) -> Result<(), Fault> {
    let here = |section: &&str| section.rsplit_once('.').map_or("", |(parent, _)| parent) == place;
    if !SECTIONS.iter().any(here) {
        return Ok(());
    }
    for (key, value) in table {
        let DeValue::Table(inner) = value.get_ref() else { continue };
        let name = key.get_ref().as_ref();
        let section = if place.is_empty() { name.to_owned() } else { format!("{place}.{name}") };
        if !SECTIONS.contains(&section.as_str()) {
            let place = if place.is_empty() { "top level" } else { place };
            let got = format!("unknown section, got [{}]", shortened(&section, EXCERPT));
            return Err(Fault::new(place, got, section_advice(name)));
        }
        check_names(inner, &section)?;
    }
    Ok(())
}

/// The section whose last word was probably meant, and all of them.
fn section_advice(name: &str) -> String {
    let last = |section: &'static str| section.rsplit_once('.').map_or(section, |(_, last)| last);
    let meant = sections::nearest_name(name, &SECTIONS.map(last));
    let meant = meant.and_then(|meant| SECTIONS.into_iter().find(|section| last(section) == meant));
    let list = SECTIONS.map(|section| format!("[{section}]")).join(", ");
    match meant {
        Some(meant) => format!("did you mean [{meant}]? sections are: {list}"),
        None => format!("sections are: {list}"),
    }
}

/// A mistake in the TOML itself.
fn syntax_fault(text: &str, error: &Error) -> Fault {
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
fn key_fault(text: &str, root: &DeTable<'_>, error: &Error) -> Fault {
    let message = error.message();
    let span = error.span().unwrap_or(0..0);
    let found = locate(root, &span).unwrap_or_default();
    let place = found.path();
    let got = excerpt(text, span);

    if message.starts_with("unknown field ") {
        let key = found.keys.last().map_or("", String::as_str);
        return Fault::new(
            found.parent(),
            format!("unknown key, got `{}`", shortened(key, EXCERPT)),
            sections::advice(key, &known_words(message), "known keys here"),
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
            sections::advice(word, &known_words(message), "known words here"),
        );
    }
    if message.starts_with("wanted string or table") {
        return Fault::new(place, format!("expected a word, got {got}"), "write a word in quotes");
    }
    let expected = match message.rsplit_once(", expected ") {
        Some((kind, expected)) if kind.starts_with("invalid ") => expected,
        _ => return Fault::new(place, format!("{message}, got {got}"), "correct the value"),
    };
    let (expected, advice) = match expected {
        "u32" => ("a whole number from 0 to 4294967295", "write a number without quotes and decimal point"),
        "u64" => (
            "a whole number from 0 to 9223372036854775807",
            "write a number without quotes and decimal point",
        ),
        "f64" => ("a number", "write a number without quotes"),
        "a string" => ("text", "put the text in quotes"),
        "a boolean" => ("true or false", "write true or false without quotes"),
        "a sequence" => ("a list", "write a list such as [\"1\", \"2\"]"),
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
    keys: Vec<String>,
}

impl Found {
    fn path(&self) -> String {
        Self::join(&self.keys)
    }

    fn parent(&self) -> String {
        Self::join(&self.keys[..self.keys.len().saturating_sub(1)])
    }

    fn join(keys: &[String]) -> String {
        if keys.is_empty() { "top level".into() } else { keys.join(".") }
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
            found.keys.insert(0, key.get_ref().to_string());
            return Some(found);
        }
    }
    None
}

fn locate_in_array(values: &[Spanned<DeValue<'_>>], span: &Range<usize>) -> Option<Found> {
    values.iter().find_map(|value| match value.get_ref() {
        DeValue::Table(table) => locate(table, span),
        DeValue::Array(values) => locate_in_array(values, span),
        _ => (value.span() == *span).then(Found::default),
    })
}

/// The text of a span on one short line.
fn excerpt(text: &str, span: Range<usize>) -> String {
    let words: Vec<&str> = text.get(span).unwrap_or("").split_whitespace().collect();
    shortened(&words.join(" "), EXCERPT)
}
