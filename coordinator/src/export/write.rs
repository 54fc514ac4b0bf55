//! An artefact written: whole, read back, and answering as it did before it was written.

use std::ffi::OsString;
use std::fs;
use std::path::Path;

use artefact::{
    DATABASE, Database, EXAMPLE, Example, FILES, README, Recogniser, SETTINGS, Settings, TEST_VECTOR,
    Verdict, test_vector,
};
use atomic::{Access, NewFolder};
use descriptor::Family;
use worker::names::Names;

use super::error::WriteError;
use crate::signing::SIGNATURE_FILE;

/// What an artefact is made of.
pub(super) struct Draft<'a> {
    /// But for digests and the number of clouds, which are filled in.
    pub settings: Settings,
    pub family: Family,
    pub database: &'a Database,
    /// What answers from all of it.
    pub recogniser: &'a Recogniser,
    pub example: &'a Example,
    pub readme: String,
}

/// What was written.
pub(super) struct Written {
    /// What the example is recognised as.
    pub verdict: Verdict,
    /// All files together.
    pub bytes: u64,
}

impl Draft<'_> {
    /// Writes the folder `out`, whole or not at all; an artefact that is there is replaced. `expected` is what the example
    /// must be recognised as, if that is known.
    pub(super) fn write(mut self, out: &Path, expected: Option<Verdict>) -> Result<Written, WriteError> {
        let failed = |source| WriteError::Write { folder: out.to_owned(), source };
        let example = self.example;
        let vector = |recogniser: &Recogniser, example: &Example| {
            test_vector(recogniser, self.family, example)
                .map_err(|source| WriteError::Example { example: example.cloud.clone(), source })
        };
        let (vector_text, verdict) = vector(self.recogniser, example)?;
        if let Some(expected) = expected {
            compare(example, expected, &verdict)?;
        }
        let new = NewFolder::beside(out, Access::Umask).map_err(failed)?;
        let digest = results::write_database(new.path().join(DATABASE), self.database)?;
        self.settings.database.clouds = self.database.clouds.len() as u32;
        self.settings.database.digest = digest.to_hex().to_string();
        self.settings.test_vector.digest = blake3::hash(vector_text.as_bytes()).to_hex().to_string();
        let settings = self
            .settings
            .seal()
            .map_err(|error| WriteError::Settings { folder: out.to_owned(), what: error.to_string() })?;
        let readme = Names::of_this_process().in_text(&self.readme);
        for (name, bytes) in [
            (SETTINGS, settings.as_bytes()),
            (TEST_VECTOR, vector_text.as_bytes()),
            (EXAMPLE, &example.bytes),
            (README, readme.as_bytes()),
        ] {
            new.write(name, bytes).map_err(failed)?;
        }

        // Read back what is on the disk: it must say of its example what was said before.
        let written = Recogniser::open(new.path())?;
        let bytes = fs::read(new.path().join(EXAMPLE)).map_err(failed)?;
        let (again, got) = vector(&written, &Example { bytes, ..example.clone() })?;
        let on_disk = fs::read(new.path().join(TEST_VECTOR)).map_err(failed)?;
        if again.as_bytes() != on_disk {
            compare(example, verdict.clone(), &got)?;
            let (expected, got) = ("that of its test vector".to_owned(), "another summary".to_owned());
            return Err(WriteError::Answer { example: example.cloud.clone(), expected, got });
        }
        let mut bytes = 0;
        for name in FILES {
            bytes += fs::metadata(new.path().join(name)).map_err(failed)?.len();
        }
        refuse_occupied(out)?;
        new.replace(out).map_err(failed)?;
        Ok(Written { verdict, bytes })
    }
}

/// Refuses a place that holds something else than an artefact, so that nobody's files are lost.
pub(super) fn refuse_occupied(out: &Path) -> Result<(), WriteError> {
    let occupied = |got: String| Err(WriteError::Occupied { folder: out.to_owned(), got });
    let entries = match fs::read_dir(out) {
        Ok(entries) => entries,
        Err(_) if !out.exists() => return Ok(()),
        Err(_) if !out.is_dir() => return occupied("a file".to_owned()),
        Err(source) => return Err(WriteError::Write { folder: out.to_owned(), source }),
    };
    let names: Vec<OsString> = entries.flatten().map(|entry| entry.file_name()).collect();
    match names.iter().find(|&name| FILES.iter().chain([&SIGNATURE_FILE]).all(|file| name != file)) {
        Some(other) => occupied(format!("a folder with {}", Path::new(other).display())),
        None if names.is_empty() || names.iter().any(|name| name == SETTINGS) => Ok(()),
        None => occupied(format!("a folder without {SETTINGS}")),
    }
}

/// Refuses an answer to the example that is not the expected one, bit for bit.
fn compare(example: &Example, expected: Verdict, got: &Verdict) -> Result<(), WriteError> {
    if expected == *got {
        return Ok(());
    }
    let (expected, got) = (expected.to_string(), got.to_string());
    Err(WriteError::Answer { example: example.cloud.clone(), expected, got })
}
