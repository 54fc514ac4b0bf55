//! Verification of a finished run: checksums, digests, and the values that follow from others.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use blake3::Hash;

use crate::checksums;
use crate::consistency::{self, Totals};
use crate::digest;
use crate::error::Error;
use crate::file_digests;
use crate::problem::Problem;
use crate::read::{
    FinishedRun, expect_one_row, finished, front_file, generation_file, read_file, read_file_if_any,
    run_file, table_files,
};
use crate::table_name::TableName;
use crate::tables::TableFile;

/// What verification found.
#[derive(Debug)]
pub struct Verification {
    /// Number of generations according to the run's row.
    pub generations: u32,
    /// The digest in the run's row, hexadecimal.
    pub recorded_run_digest: String,
    /// The digest of what the files hold; `None` if a file that it needs cannot be read.
    pub computed_run_digest: Option<Hash>,
    /// Whether the run's row has digests of what tells how the run went; earlier builds have not recorded them.
    pub covers_log: bool,
    /// Everything that is wrong, in table and generation order.
    pub problems: Vec<Problem>,
}

impl Verification {
    /// Whether the files hold exactly what the run wrote.
    pub fn is_intact(&self) -> bool {
        self.problems.is_empty()
    }
}

/// Folders of the comparisons on the clouds of one set, `sets/NAME` in the run folder.
fn comparisons_of_sets(run: &Path) -> Result<Vec<PathBuf>, Error> {
    let sets = run.join(TableName::Sets.as_str());
    let failed = |error| Error::io(&sets, "list this folder", error);
    if !sets.is_dir() {
        return Ok(Vec::new());
    }
    let entries = fs::read_dir(&sets).and_then(Iterator::collect::<io::Result<Vec<_>>>).map_err(failed)?;
    let mut folders: Vec<PathBuf> =
        entries.iter().map(fs::DirEntry::path).filter(|path| path.is_dir()).collect();
    folders.sort();
    Ok(folders)
}

/// Computes the run digest of a finished run from its files. Fails at the first file that is not sound.
pub fn run_digest(run: impl AsRef<Path>) -> Result<Hash, Error> {
    let run = run.as_ref();
    let (content, finished) = read_run_file(run)?;
    let parts = Parts::read(run, finished.row.generations)?;
    digest::run(&content, &parts.generations, parts.predictions, parts.front)
}

/// Verifies a finished run against itself: every file's checksum, the digest of every generation, of the
/// predictions and of the run, every value that is derived from others, and the digests of whole files and of looks, if
/// the run has them. All problems are reported, not only the first. Fails only if there is no run row to verify against.
///
/// A change of a cell and of every digest above it goes unnoticed here: compare the run digest with a published one,
/// or compute fitness values again.
pub fn verify(run: impl AsRef<Path>) -> Result<Verification, Error> {
    let run = run.as_ref();
    let (content, finished) = read_run_file(run)?;
    let mut problems = Vec::new();
    let row = &finished.row;

    let present = surplus(run, row.generations, &mut problems)?;
    let mut totals = Totals::default();
    let mut digests = Some(Vec::new());
    // A changed number of generations must not make this loop over files that never existed.
    for generation in 1..=row.generations.min(present.saturating_add(1)) {
        match read_generation(run, generation) {
            Ok((evaluations, generations)) => {
                let computed = digest::generation_rows(&evaluations, &generations)?;
                let recorded = generations.text("rows_digest")?.to_owned();
                if recorded != computed.to_hex().as_str() {
                    problems.push(Problem::Generation { generation, recorded, computed });
                }
                let files = [&evaluations, &generations];
                let rows = consistency::generation(generation, files, &mut totals, &mut problems)?;
                if generation == row.winner_generation {
                    consistency::winner(&finished, &evaluations, &rows, &mut problems);
                }
                if let Some(digests) = &mut digests {
                    digests.push(computed);
                }
            }
            Err(error) => {
                problems.push(Problem::File(error));
                digests = None;
            }
        }
    }

    let mut predictions = Some(Vec::new());
    for file in table_files(run, TableName::Predictions)? {
        match read_file(&file, TableName::Predictions) {
            Ok(content) => predictions.iter_mut().for_each(|files| files.push(content.clone())),
            Err(error) => {
                problems.push(Problem::File(error));
                predictions = None;
            }
        }
    }
    let mut predictions_digest = None;
    if let Some(files) = &predictions {
        let computed = digest::predictions(files)?;
        let recorded = content.text("predictions_digest")?.to_owned();
        if recorded != computed.to_hex().as_str() {
            problems.push(Problem::Predictions { recorded, computed });
        }
        consistency::predictions(row, files, &mut problems)?;
        predictions_digest = Some(computed);
    }
    let front = match read_file_if_any(&front_file(run), TableName::Front) {
        Ok(file) => {
            let computed = file.as_ref().map(digest::front).transpose()?;
            let recorded = content.text("front_digest")?.to_owned();
            if recorded != computed.map_or_else(String::new, |computed| computed.to_hex().to_string()) {
                problems.push(Problem::Front { recorded, computed });
            }
            if let Some(file) = file {
                consistency::front(row, &file, &mut problems)?;
            }
            Some(computed)
        }
        Err(error) => {
            problems.push(Problem::File(error));
            None
        }
    };
    for file in table_files(run, TableName::Skipped)? {
        if let Err(error) = read_file(&file, TableName::Skipped) {
            problems.push(Problem::File(error));
        }
    }
    consistency::run(&content, row, digests.is_some().then_some(totals), &mut problems)?;

    let mut computed_run_digest = None;
    if let (Some(generations), Some(predictions), Some(front)) = (digests, predictions_digest, front) {
        let computed = digest::run(&content, &generations, predictions, front)?;
        if finished.run_digest != computed.to_hex().as_str() {
            let recorded = finished.run_digest.clone();
            problems.push(Problem::Run { recorded, computed });
        }
        computed_run_digest = Some(computed);
    }
    let covers_log = file_digests::verify(run, &content, &mut problems)?;
    checksums::verify(run, covers_log, &mut problems);
    for set in comparisons_of_sets(run)? {
        checksums::verify(&set, covers_log, &mut problems);
    }
    Ok(Verification {
        generations: row.generations,
        recorded_run_digest: finished.run_digest,
        computed_run_digest,
        covers_log,
        problems,
    })
}

fn read_run_file(run: &Path) -> Result<(TableFile, FinishedRun), Error> {
    let file = run_file(run)?;
    let content = read_file(&file, TableName::Run)?;
    let finished = finished(&content, &file)?;
    Ok((content, finished))
}

/// Both files of a generation; the second has one row.
fn read_generation(run: &Path, generation: u32) -> Result<(TableFile, TableFile), Error> {
    let name = generation_file(generation);
    let read = |table: TableName| read_file(&run.join(table.as_str()).join(&name), table);
    let (evaluations, generations) = (read(TableName::Evaluations)?, read(TableName::Generations)?);
    expect_one_row(&generations, &run.join(TableName::Generations.as_str()).join(name), "a generation")?;
    Ok((evaluations, generations))
}

/// Reports files that no generation of the run has. Returns the number of `evaluations` files.
fn surplus(run: &Path, generations: u32, problems: &mut Vec<Problem>) -> Result<u32, Error> {
    let mut present = 0;
    for table in [TableName::Generations, TableName::Evaluations] {
        let files = table_files(run, table)?;
        present = files.len() as u32;
        for file in files {
            let name = file.file_name().unwrap_or_default().to_string_lossy();
            let number = name.strip_prefix("generation-").and_then(|name| name.strip_suffix(".parquet"));
            let number = number.and_then(|number| number.parse().ok());
            let ours = number
                .is_some_and(|number| (1..=generations).contains(&number) && generation_file(number) == name);
            if !ours {
                problems.push(Problem::Surplus(file));
            }
        }
    }
    Ok(present)
}

/// The digests that a run digest is computed from, beside the run's row.
pub(crate) struct Parts {
    pub generations: Vec<Hash>,
    pub predictions: Hash,
    /// `None`: there is none.
    pub front: Option<Hash>,
}

impl Parts {
    /// The digest of one generation's rows, from its files.
    pub(crate) fn generation(run: &Path, generation: u32) -> Result<Hash, Error> {
        let (evaluations, row) = read_generation(run, generation)?;
        digest::generation_rows(&evaluations, &row)
    }

    /// Computes them from the files of a folder, one generation in memory at a time.
    pub(crate) fn read(run: &Path, generations: u32) -> Result<Self, Error> {
        let mut digests = Vec::new();
        for generation in 1..=generations {
            digests.push(Self::generation(run, generation)?);
        }
        let mut files = Vec::new();
        for file in table_files(run, TableName::Predictions)? {
            files.push(read_file(&file, TableName::Predictions)?);
        }
        let front = read_file_if_any(&front_file(run), TableName::Front)?;
        let front = front.as_ref().map(digest::front).transpose()?;
        Ok(Self { generations: digests, predictions: digest::predictions(&files)?, front })
    }
}
