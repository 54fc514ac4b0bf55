//! From text to keys: TOML syntax, version and types, with every mistake located by its key.

use serde::Deserialize;
use toml::Spanned;
use toml::de::{DeString, DeTable, DeValue, Deserializer};

use super::raw::RawExperiment;
use artefact::sections::{self, EXCERPT, Fault, TABLE_ADVICE, excerpt, key_fault, syntax_fault};
use artefact::text::shortened;

/// The format's version that this program writes and reads.
const VERSION: i64 = 1;

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
