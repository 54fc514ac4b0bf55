//! The pattern of layout "pattern": which parts of a cloud's path are its labels.

use std::fmt;
use std::str::FromStr;

use descriptor::cloud_file;

/// Placeholders of a pattern: more than a path has labels, and few enough to be read.
const MOST_PLACEHOLDERS: usize = 16;

/// A path with placeholders, such as `{category}_{instance}_{sequence}_{any}.pcd`.
///
/// A placeholder stands for one or more characters of a file or folder name. Names are read from their ends: each
/// placeholder takes as few characters as it can, and the first of a name takes what is left. So
/// `{category}_{instance}_{any}.pcd` reads `coffee_mug_1_25.pcd` as category `coffee_mug`, number `1` of which is the
/// instance `coffee_mug_1`, and a path has one reading at most.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pattern {
    /// As written.
    text: String,
    /// A folder's name for each but the last, which is the file's.
    names: Vec<Name>,
}

/// A name with placeholders: what stands before the first, and what follows each.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Name {
    start: String,
    parts: Vec<(Placeholder, String)>,
}

/// What a placeholder stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Placeholder {
    Category,
    Instance,
    Sequence,
    /// Something that is no label.
    Any,
}

/// What a path says of its cloud.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct PathLabels {
    pub category: String,
    pub instance: String,
    /// `None` if the pattern has no `{sequence}`.
    pub sequence: Option<String>,
}

/// Why a text is no pattern, in the words of a message.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "{expected} expected, got {got}\nwrite a pattern such as {{category}}_{{instance}}_{{sequence}}_{{any}}.pcd"
)]
pub struct PatternError {
    expected: &'static str,
    got: String,
}

impl FromStr for Pattern {
    type Err = PatternError;

    fn from_str(text: &str) -> Result<Self, PatternError> {
        let error = |expected| PatternError { expected, got: text.escape_debug().to_string() };
        if text.chars().any(char::is_control) {
            return Err(error("a pattern without control characters"));
        }
        if text.split('/').any(|name| ["", ".", ".."].contains(&name)) {
            return Err(error("a path below the data root, with / between names"));
        }
        if !cloud_file::has_ending(text) {
            return Err(error("a pattern that ends in .pcd, .ply or _crop.png"));
        }
        let names =
            text.split('/').map(|name| Name::parse(name).map_err(error)).collect::<Result<Vec<_>, _>>()?;
        let placeholders: Vec<Placeholder> =
            names.iter().flat_map(|name| name.parts.iter().map(|(placeholder, _)| *placeholder)).collect();
        if placeholders.len() > MOST_PLACEHOLDERS {
            return Err(error("16 placeholders at most"));
        }
        let count = |wanted| placeholders.iter().filter(|&&placeholder| placeholder == wanted).count();
        if count(Placeholder::Instance) != 1 {
            return Err(error("{instance} once"));
        }
        if count(Placeholder::Category) > 1 || count(Placeholder::Sequence) > 1 {
            return Err(error("{category} and {sequence} once at most"));
        }
        Ok(Self { text: text.to_owned(), names })
    }
}

impl fmt::Display for Pattern {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(&self.text)
    }
}

impl Pattern {
    /// Whether a folder, by its path relative to the root, may hold clouds.
    pub(super) fn enters(&self, folder: &str) -> bool {
        let folders = &self.names[..self.names.len() - 1];
        let mut parts = folder.split('/').zip(folders);
        folder.split('/').count() <= folders.len() && parts.all(|(text, name)| name.read(text).is_some())
    }

    /// Whether clouds have sequences.
    pub fn has_sequences(&self) -> bool {
        let mut parts = self.names.iter().flat_map(|name| &name.parts);
        parts.any(|(placeholder, _)| *placeholder == Placeholder::Sequence)
    }

    /// The labels of a cloud, from its path relative to the root; `None` if the path does not fit. An instance has its
    /// category's name before its own, since many categories have a first one; without `{category}` each instance is a
    /// category of its own.
    pub(super) fn labels(&self, path: &str) -> Option<PathLabels> {
        if path.split('/').count() != self.names.len() {
            return None;
        }
        let mut labels = PathLabels::default();
        let mut category = None;
        for (name, text) in self.names.iter().zip(path.split('/')) {
            for (placeholder, value) in name.read(text)? {
                match placeholder {
                    Placeholder::Category => category = Some(value),
                    Placeholder::Instance => labels.instance = value.to_owned(),
                    Placeholder::Sequence => labels.sequence = Some(value.to_owned()),
                    Placeholder::Any => {}
                }
            }
        }
        if let Some(category) = category {
            labels.instance = format!("{category}_{}", labels.instance);
        }
        labels.category = category.unwrap_or(&labels.instance).to_owned();
        Some(labels)
    }
}

impl Name {
    fn parse(text: &str) -> Result<Self, &'static str> {
        const BRACES: &str = "{category}, {instance}, {sequence} and {any}, and no other braces,";
        let (start, mut rest) = text.split_at(text.find('{').unwrap_or(text.len()));
        let mut parts: Vec<(Placeholder, String)> = Vec::new();
        while let Some(inner) = rest.strip_prefix('{') {
            let (name, after) = inner.split_once('}').ok_or(BRACES)?;
            let placeholder = match name {
                "category" => Placeholder::Category,
                "instance" => Placeholder::Instance,
                "sequence" => Placeholder::Sequence,
                "any" => Placeholder::Any,
                _ => return Err(BRACES),
            };
            if parts.last().is_some_and(|(_, literal)| literal.is_empty()) {
                return Err("something between two placeholders");
            }
            let (literal, next) = after.split_at(after.find('{').unwrap_or(after.len()));
            parts.push((placeholder, literal.to_owned()));
            rest = next;
        }
        let literals = parts.iter().map(|(_, literal)| &**literal).chain([start]);
        if literals.into_iter().any(|literal| literal.contains('}')) {
            return Err(BRACES);
        }
        Ok(Self { start: start.to_owned(), parts })
    }

    /// What each placeholder stands for, from the last to the first.
    fn read<'a>(&self, text: &'a str) -> Option<Vec<(Placeholder, &'a str)>> {
        let mut rest = text.strip_prefix(&*self.start)?;
        let mut values = Vec::with_capacity(self.parts.len());
        for (index, (placeholder, literal)) in self.parts.iter().enumerate().rev() {
            rest = rest.strip_suffix(&**literal)?;
            let value_start = match index.checked_sub(1) {
                None => 0,
                Some(before) => {
                    let before = &*self.parts[before].1;
                    // Its last character belongs to the placeholder, which is never empty.
                    let last = rest.char_indices().next_back()?.0;
                    rest[..last].rfind(before)? + before.len()
                }
            };
            let (before, value) = rest.split_at(value_start);
            if value.is_empty() {
                return None;
            }
            values.push((*placeholder, value));
            rest = before;
        }
        rest.is_empty().then_some(values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn labels(pattern: &str, path: &str) -> Option<(String, String, Option<String>)> {
        let labels = pattern.parse::<Pattern>().unwrap().labels(path)?;
        Some((labels.category, labels.instance, labels.sequence))
    }

    fn some(
        category: &str,
        instance: &str,
        sequence: Option<&str>,
    ) -> Option<(String, String, Option<String>)> {
        Some((category.to_owned(), instance.to_owned(), sequence.map(str::to_owned)))
    }

    #[test]
    fn labels_are_read_from_the_ends_of_names() {
        let flat = "{category}_{instance}_{sequence}_{any}.pcd";
        assert_eq!(labels(flat, "cup_1_2_33.pcd"), some("cup", "cup_1", Some("2")));
        assert_eq!(labels(flat, "coffee_mug_1_2_33.pcd"), some("coffee_mug", "coffee_mug_1", Some("2")));
        for path in
            ["cup_1_2.pcd", "cup_1_2_33.ply", "cup_1_2_.pcd", "a/cup_1_2_33.pcd", "_1_2_33.pcd", ".pcd", ""]
        {
            assert_eq!(labels(flat, path), None, "{path}");
        }
        let folders = "scans/{instance}/{sequence}-{any}/cloud.ply";
        assert_eq!(labels(folders, "scans/tasse-ä/7-b/cloud.ply"), some("tasse-ä", "tasse-ä", Some("7")));
        assert_eq!(labels(folders, "scans/x/7/cloud.ply"), None);
        assert_eq!(labels("{instance}.pcd", "x_1.pcd"), some("x_1", "x_1", None));
        assert!(!"{instance}.pcd".parse::<Pattern>().unwrap().has_sequences());
        // Neighbours of one another may be equal to what separates them.
        assert_eq!(labels("{category}__{instance}.pcd", "a____b.pcd"), some("a__", "a___b", None));
        assert_eq!(labels("{category}__{instance}.pcd", "a___.pcd"), some("a", "a__", None));
    }

    #[test]
    fn what_is_no_pattern() {
        for (text, expected) in [
            ("{instance}", "a pattern that ends in .pcd, .ply or _crop.png"),
            ("{category}_{any}.pcd", "{instance} once"),
            ("{instance}/{instance}_{any}.pcd", "{instance} once"),
            ("{category}/{category}_{instance}.pcd", "{category} and {sequence} once at most"),
            ("{category}{instance}.pcd", "something between two placeholders"),
            ("{object}_{any}.pcd", "{category}, {instance}, {sequence} and {any}, and no other braces,"),
            ("{instance_{any}.pcd", "{category}, {instance}, {sequence} and {any}, and no other braces,"),
            ("{instance}}_1.pcd", "{category}, {instance}, {sequence} and {any}, and no other braces,"),
            ("/{instance}.pcd", "a path below the data root, with / between names"),
            ("../{instance}.pcd", "a path below the data root, with / between names"),
            ("{instance}\u{1b}.pcd", "a pattern without control characters"),
        ] {
            assert_eq!(text.parse::<Pattern>().unwrap_err().expected, expected, "{text}");
        }
        let many = format!("{{instance}}{}.pcd", "_{any}".repeat(16));
        assert_eq!(many.parse::<Pattern>().unwrap_err().expected, "16 placeholders at most");
    }

    proptest! {
        /// A name that is made of its parts is read as these, if none holds what separates them.
        #[test]
        fn names_without_separators_are_read_back(category in "[a-z0-9.ä-]{1,8}", instance in "[a-z0-9.-]{1,8}", sequence in "[0-9]{1,3}") {
            let path = format!("{category}_{instance}_{sequence}.pcd");
            prop_assert_eq!(labels("{category}_{instance}_{sequence}.pcd", &path), some(&category, &format!("{category}_{instance}"), Some(&sequence)));
        }

        /// What is read, put into the pattern, is the path again; and no input panics.
        #[test]
        fn what_is_read_makes_the_path_again(path in "[a_/ä.]{0,12}\\.pcd") {
            let pattern: Pattern = "{category}_{instance}a{sequence}.pcd".parse().unwrap();
            if let Some(PathLabels { instance, sequence, .. }) = pattern.labels(&path) {
                prop_assert_eq!(format!("{instance}a{}.pcd", sequence.unwrap()), path);
            }
        }
    }
}
