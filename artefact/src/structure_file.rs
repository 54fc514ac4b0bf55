//! Files that describe one structure, channel by channel.

use std::path::{Path, PathBuf};

use descriptor::structure::{Structure, StructureError, StructureFile};

use crate::text::{read_bounded, shortened};

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
    #[error("{path}: not a structure file, got {what}\ncompare it with experiments/descriptors/paper.toml")]
    Form {
        /// Which file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
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
    let file: StructureFile = toml::from_str(text).map_err(|error| {
        let line = error.span().map(|span| 1 + text[..span.start].matches('\n').count());
        let place = line.map(|line| format!("line {line}: ")).unwrap_or_default();
        let what = format!("{place}{}", shortened(error.message(), 200));
        StructureFileError::Form { path: path.to_owned(), what }
    })?;
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
        assert!(key.starts_with("one.toml: not a structure file, got line 7: unknown field `bins`"), "{key}");
        let missing = read(Path::new("/nowhere/one.toml")).unwrap_err().to_string();
        assert!(missing.starts_with("/nowhere/one.toml: cannot be read, got "), "{missing}");
    }
}
