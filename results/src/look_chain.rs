//! Looks at the test clouds, which follow one another also after the end of a run, as a chain of hashes.
//!
//! The value of the chain after a look is H(the value before it, the file's name, the file). A look tells the value before
//! it, and `looks/head` the value after the last, so that no look can be changed, cut off or left out without that being
//! seen. It is written after the look: where a process ends in between, the head is one look behind.

use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use blake3::{Hash, Hasher};

use crate::error::Error;
use crate::file::write_whole;
use crate::parquet;
use crate::problem::Problem;
use crate::read::{expect_one_row, read_bytes, table_files};
use crate::table_name::TableName;

/// File beside the looks that has the value after the last.
const HEAD: &str = "head";

/// The value before the first look.
fn start() -> Hash {
    Hasher::new_derive_key("descry looks v1").finalize()
}

fn link(before: Hash, name: &str, file: Hash) -> Hash {
    let mut hasher = Hasher::new_derive_key("descry look v1");
    hasher.update(before.as_bytes());
    hasher.update(&(name.len() as u64).to_le_bytes());
    hasher.update(name.as_bytes());
    hasher.update(file.as_bytes());
    hasher.finalize()
}

/// A look as it is in the folder.
struct Link {
    file: PathBuf,
    /// The value before it, as it tells; `None` of those of earlier builds.
    told: Option<Result<Hash, Error>>,
    /// The value before it, as the files before it make it.
    before: Hash,
}

/// All looks of a folder, and what follows from them.
struct Chain {
    links: Vec<Link>,
    /// The value after the last, as the files make it.
    end: Hash,
    /// The value in the head; `None` if there is none.
    head: Option<Hash>,
}

impl Chain {
    fn read(run: &Path) -> Result<Self, Error> {
        let (mut links, mut end) = (Vec::new(), start());
        for file in table_files(run, TableName::Looks)? {
            let bytes = read_bytes(&file)?;
            let content = blake3::hash(&bytes);
            let told = parquet::decode(bytes, TableName::Looks, &file).and_then(|look| {
                expect_one_row(&look, &file, "a look")?;
                let text = look.text("chain")?;
                let no_digest =
                    |_| Error::Damaged { file: file.clone(), what: "its chain is no digest".to_owned() };
                (!text.is_empty()).then(|| Hash::from_hex(text).map_err(no_digest)).transpose()
            });
            let (told, before) = (told.transpose(), end);
            let name = file.file_name().unwrap_or_default().to_string_lossy();
            // Only the look after one that was changed or is missing does not follow, not each after that.
            let follows = told.as_ref().and_then(|told| told.as_ref().ok()).unwrap_or(&before);
            end = link(*follows, &name, content);
            links.push(Link { file, told, before });
        }
        Ok(Self { links, end, head: read_head(run)? })
    }

    /// Whether a look tells what was before it: then there has been a head.
    fn is_chained(&self) -> bool {
        self.links.iter().any(|link| link.told.is_some())
    }

    /// The value of the head. Before the first of all looks is written there is none, and none where all looks are of
    /// earlier builds.
    fn head(&self) -> Hash {
        self.head.unwrap_or_else(|| if self.is_chained() { start() } else { self.end })
    }

    /// Whether the head is that of the files, or one look behind because a process has ended.
    fn has_its_head(&self) -> bool {
        let behind =
            self.links.last().filter(|last| matches!(&last.told, Some(Ok(told)) if *told == last.before));
        self.head() == self.end || behind.is_some_and(|last| last.before == self.head())
    }
}

fn head_file(run: &Path) -> PathBuf {
    run.join(TableName::Looks.as_str()).join(HEAD)
}

fn read_head(run: &Path) -> Result<Option<Hash>, Error> {
    let path = head_file(run);
    if !path.exists() {
        return Ok(None);
    }
    if !path.is_file() {
        return Err(Error::Damaged { file: path, what: "it is no file".to_owned() });
    }
    let mut bytes = Vec::new();
    let read = File::open(&path).and_then(|file| file.take(256).read_to_end(&mut bytes));
    match read {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(Error::io(&path, "read this file", error)),
        // What is no value is the value of no chain.
        Ok(_) => Ok(Some(Hash::from_hex(bytes.trim_ascii()).unwrap_or_else(|_| blake3::hash(&bytes)))),
    }
}

fn write_head(run: &Path, value: Hash) -> Result<(), Error> {
    write_whole(&head_file(run), format!("{}\n", value.to_hex()).as_bytes())
}

/// The value after the last look, which the next one has to tell. Where the files are not those that the head tells of, it
/// is the head's: what was done to them stays seen.
pub(crate) fn end(run: &Path) -> Result<Hash, Error> {
    let chain = Chain::read(run)?;
    Ok(if chain.has_its_head() { chain.end } else { chain.head() })
}

/// Prepares the folder for a look that tells this value: the head has it.
pub(crate) fn begin(run: &Path, value: Hash) -> Result<(), Error> {
    write_head(run, value)
}

/// Moves the head behind a look that was written; `before`: what it tells.
pub(crate) fn advance(run: &Path, before: Hash, name: &str, file: &[u8]) -> Result<(), Error> {
    write_head(run, link(before, name, blake3::hash(file)))
}

/// Compares the looks of a finished run with their head. `at_end`: the value at the end of the run, if it is
/// known.
pub(crate) fn verify(run: &Path, at_end: &str, problems: &mut Vec<Problem>) -> Result<(), Error> {
    let chain = match Chain::read(run) {
        Ok(chain) => chain,
        Err(error) => {
            problems.push(Problem::File(error));
            return Ok(());
        }
    };
    let (has_its_head, head, end) = (chain.has_its_head(), chain.head(), chain.end);
    let mut values: Vec<Hash> = chain.links.iter().map(|link| link.before).collect();
    values.push(end);
    let found = problems.len();
    for Link { file, told, before } in chain.links {
        match told {
            Some(Err(error)) => problems.push(Problem::File(error)),
            Some(Ok(told)) if told != before => problems.push(Problem::Look(file)),
            _ => {}
        }
    }
    // A look that tells something else than what was before it has been told of.
    let has_those_of_the_run =
        at_end.is_empty() || values.iter().any(|value| value.to_hex().as_str() == at_end);
    if problems.len() == found && !(has_its_head && has_those_of_the_run) {
        problems.push(Problem::Looks { head, computed: end });
    }
    Ok(())
}
