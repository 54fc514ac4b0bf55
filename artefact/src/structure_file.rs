//! Files that describe one structure, channel by channel.

use std::path::{Path, PathBuf};

use descriptor::structure::{Structure, StructureError, StructureFile};
use serde::Deserialize;
use toml::de::{DeTable, Deserializer};

use crate::sections::{ConfigError, key_fault, syntax_fault};
use crate::text::read_bounded;

/// Why a file describes no structure.
#[derive(Debug, thiserror::Error)]
pub enum StructureFileError {
    /// It cannot be read.
    #[error(
        "{path}: cannot be read, got {source}\nname a structure file, such as experiments/descriptors/paper.toml"
    )]
    Read {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It is no TOML of this form.
    #[error(transparent)]
    Form(#[from] ConfigError),
    /// No structure can be so.
    #[error("{path}: {source}")]
    Structure {
        /// Which file.
        path: PathBuf,
        /// Which channel and key, and what is wrong.
        source: StructureError,
    },
}

/// Reads a structure.
///
/// # Errors
/// What is wrong with the file.
pub fn read(path: &Path) -> Result<Structure, StructureFileError> {
    let text =
        read_bounded(path).map_err(|source| StructureFileError::Read { path: path.to_owned(), source })?;
    parse(&text, path)
}

/// Reads the text of the file at `path`, which need not be there.
///
/// # Errors
/// What is wrong with the text.
pub fn parse(text: &str, path: &Path) -> Result<Structure, StructureFileError> {
    let root = DeTable::parse(text).map_err(|error| syntax_fault(text, &error).in_file(path))?;
    let file = StructureFile::deserialize(Deserializer::from(root.clone()))
        .map_err(|error| key_fault(text, root.get_ref(), &error).in_file(path))?;
    file.structure().map_err(|source| StructureFileError::Structure { path: path.to_owned(), source })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(text: &str) -> String {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("one.toml");
        std::fs::write(&path, text).unwrap();
        let error = read(&path).unwrap_err().to_string();
        error.replace(&path.display().to_string(), "one.toml")
    }

    #[test]
    fn shipped_files_are_structures() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../experiments/descriptors");
        let mut files = 0;
        for entry in std::fs::read_dir(folder).unwrap() {
            read(&entry.unwrap().path()).unwrap();
            files += 1;
        }
        assert!(files >= 5, "{files} files");
    }

    #[test]
    fn what_is_wrong_names_the_file_and_the_place() {
        let channel = "version = 1\n[[channel]]\npairs = \"cloud\"\nradius_cm = 12.0\nsamples = 1024\n";
        let unknown = message(&format!("{channel}features = [\"d 5\", \"hew 4\"]\n"));
        assert!(unknown.starts_with("one.toml: channel 1: features: "), "{unknown}");
        assert!(unknown.contains("hew"), "{unknown}");
        let key = message(&format!("{channel}features = [\"d 5\"]\nbins = 4\n"));
        assert!(
            key.starts_with("one.toml: channel 1: unknown key, got `bins`\nknown keys here: pairs, "),
            "{key}"
        );
        assert!(key.ends_with(", weight, scale"), "{key}");
        let slip = message(&format!("{channel}features = [\"d 5\"]\n[[channel]]\nradius = 4\n"));
        assert!(
            slip.starts_with("one.toml: channel 2: unknown key, got `radius`\ndid you mean `radius_cm`? "),
            "{slip}"
        );
        let kind = message(&format!("{channel}features = [\"d 5\"]\nweight = \"1\"\n"));
        assert_eq!(
            kind,
            "one.toml: channel 1: weight: expected a number, got \"1\"\nwrite a number without quotes"
        );
        let absent = message("version = 1\n[[channel]]\npairs = \"cloud\"\nradius_cm = 12\n");
        assert_eq!(
            absent,
            "one.toml: channel 1: required key missing, got no `features`\nadd `features = …`"
        );
        let scalar = message("version = 1\nchannel = 3\n");
        assert_eq!(scalar, "one.toml: channel: expected a list, got 3\nwrite a section [[channel]] for each");
        let syntax = message("version = 1\n[[channel]\n");
        assert!(syntax.starts_with("one.toml: line 2, column "), "{syntax}");
        let missing = read(Path::new("/nowhere/one.toml")).unwrap_err().to_string();
        assert!(missing.starts_with("/nowhere/one.toml: cannot be read, got "), "{missing}");
    }
}
