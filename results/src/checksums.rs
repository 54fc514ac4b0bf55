//! Checksums of a comparison's files, in a file of their own, because a comparison is made again or extended at will: what
//! the run's row cannot have. Lines are those of b3sum: `b3sum --check comparison/b3sums` in the run folder.

use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use crate::error::Error;
use crate::file::write_whole;
use crate::problem::Problem;
use crate::read::read_bytes;
use crate::table_name::TableName;

/// File beside the table that marks a comparison as whole.
const SUMS: &str = "b3sums";
/// Longest list that is read, bytes.
const MAX_BYTES: u64 = 1 << 24;

fn sums_file(run: &Path) -> PathBuf {
    run.join(TableName::Comparison.as_str()).join(SUMS)
}

fn tables() -> impl Iterator<Item = TableName> {
    TableName::COMPARISON.into_iter().chain(TableName::PERTURBED)
}

/// Removes all checksums: the comparison is about to be removed.
pub(crate) fn clear(run: &Path) -> Result<(), Error> {
    let path = sums_file(run);
    match atomic::remove(&path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(Error::io(&path, "remove this file", error))
        }
        _ => Ok(()),
    }
}

/// Removes the lines of some files, `TABLE/NAME`, which are about to be written or removed.
pub(crate) fn forget(run: &Path, which: impl Fn(&str) -> bool) -> Result<(), Error> {
    let Some(sums) = read(run)? else { return Ok(()) };
    let is_of_it = |line: &&str| line.split_once("  ").is_some_and(|(_, file)| which(file));
    if !sums.lines().any(|line| is_of_it(&line)) {
        return Ok(());
    }
    let kept = sums.lines().filter(|line| !is_of_it(line)).map(|line| format!("{line}\n"));
    write_whole(&sums_file(run), kept.collect::<String>().as_bytes())
}

/// Adds the lines of files that were just written. Those of others stay as they are: what became of them meanwhile shows.
pub(crate) fn add(run: &Path, files: &[(PathBuf, Vec<u8>)]) -> Result<(), Error> {
    let mut sums = read(run)?.unwrap_or_default();
    for (file, bytes) in files {
        sums += &format!("{}  {}\n", blake3::hash(bytes), name_in(run, file));
    }
    write_whole(&sums_file(run), sums.as_bytes())
}

/// `TABLE/NAME` of a file of the run.
pub(crate) fn name_in(run: &Path, file: &Path) -> String {
    file.strip_prefix(run).unwrap_or(file).display().to_string()
}

fn read(run: &Path) -> Result<Option<String>, Error> {
    let path = sums_file(run);
    if !path.exists() {
        return Ok(None);
    }
    if !path.is_file() {
        return Err(Error::Damaged { file: path, what: "it is no file".to_owned() });
    }
    let mut bytes = Vec::new();
    let read = File::open(&path).and_then(|file| file.take(MAX_BYTES).read_to_end(&mut bytes));
    read.map_err(|error| Error::io(&path, "read this file", error))?;
    Ok(Some(String::from_utf8_lossy(&bytes).into_owned()))
}

/// Compares the comparison of a run with its checksums. `must_be`: builds that write no checksums have not made it.
pub(crate) fn verify(run: &Path, must_be: bool, problems: &mut Vec<Problem>) {
    let sums = match read(run) {
        Ok(Some(sums)) => sums,
        Ok(None) => {
            let comparison = run.join(TableName::Comparison.as_str()).join(TableName::Comparison.file());
            if must_be && comparison.exists() {
                problems.push(Problem::Checksums(sums_file(run), "it is missing".to_owned()));
            }
            return;
        }
        Err(error) => {
            problems.push(Problem::File(error));
            return;
        }
    };
    let mut listed = Vec::new();
    for line in sums.lines() {
        let Some((sum, file)) = line.split_once("  ").and_then(|(sum, name)| Some((sum, place(run, name)?)))
        else {
            problems.push(Problem::Checksums(sums_file(run), "it has a line that is no checksum".to_owned()));
            return;
        };
        match read_bytes(&file) {
            Ok(bytes) if blake3::hash(&bytes).to_hex().as_str() == sum => {}
            Ok(_) => problems.push(Problem::Checksums(file.clone(), "its checksum is another".to_owned())),
            Err(error) => problems.push(Problem::File(error)),
        }
        listed.push(file);
    }
    // Further descriptors may be there of a comparison that was being extended when its process ended.
    for table in [TableName::Pairs, TableName::Comparison, TableName::Perturbed] {
        let file = run.join(table.as_str()).join(table.file());
        if file.exists() && !listed.contains(&file) {
            problems.push(Problem::Checksums(file, "it is not in comparison/b3sums".to_owned()));
        }
    }
}

/// The file of a line, which is one of a comparison.
fn place(run: &Path, name: &str) -> Option<PathBuf> {
    let (table, file) = name.split_once('/')?;
    let is_ours =
        tables().any(|name| name.as_str() == table) && !file.contains('/') && file.ends_with(".parquet");
    is_ours.then(|| run.join(table).join(file))
}
