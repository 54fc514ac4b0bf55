//! Verification of a finished run: checksums, digests, and the values that follow from others.

use std::fmt;
use std::path::{Path, PathBuf};

use blake3::Hash;

use crate::cells::Cells;
use crate::derived;
use crate::digest;
use crate::error::Error;
use crate::parquet::TableFile;
use crate::read::{FinishedRun, finished, generation_file, read_file, run_file, table_files};
use crate::tables::TableName;

/// What verification found.
#[derive(Debug)]
pub struct Verification {
    /// Number of generations that the run's row speaks of.
    pub generations: u32,
    /// The digest in the run's row, hexadecimal.
    pub recorded_run_digest: String,
    /// The digest of what the files hold; `None` if a file that it needs cannot be read.
    pub computed_run_digest: Option<Hash>,
    /// Everything that is not as it should be, in table and generation order.
    pub problems: Vec<Problem>,
}

impl Verification {
    /// Whether the files hold exactly what the run wrote.
    pub fn is_intact(&self) -> bool {
        self.problems.is_empty()
    }
}

/// One thing that is not as it should be.
#[derive(Debug)]
pub enum Problem {
    /// A file is missing, damaged or foreign. The error names it.
    File(Error),
    /// A file that the run's row does not speak of.
    Surplus(PathBuf),
    /// The rows of a generation are not those that were written.
    Generation { generation: u32, recorded: String, computed: Hash },
    /// The predictions are not those that were written.
    Predictions { recorded: String, computed: Hash },
    /// The run as a whole is not what was written.
    Run { recorded: String, computed: Hash },
    /// A value that does not follow from the values that it is derived from.
    Derived {
        table: TableName,
        generation: Option<u32>,
        row: usize,
        column: String,
        expected: String,
        got: String,
    },
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(error) => write!(f, "{error}"),
            Self::Surplus(file) => {
                write!(f, "{}: the run has no such part\nremove the file", file.display())
            }
            Self::Generation { generation, recorded, computed } => {
                write!(f, "generation {generation}: digest of its rows: expected {recorded}, got {computed}")
            }
            Self::Predictions { recorded, computed } => {
                write!(f, "predictions: digest: expected {recorded}, got {computed}")
            }
            Self::Run { recorded, computed } => {
                write!(f, "run: run digest: expected {recorded}, got {computed}")
            }
            Self::Derived { table, generation, row, column, expected, got } => {
                write!(f, "{table}")?;
                if let Some(generation) = generation {
                    write!(f, ", generation {generation}")?;
                }
                write!(f, ", row {row}: {column}: expected {expected}, got {got}")
            }
        }
    }
}

/// Computes the run digest of a finished run from its files. Fails at the first file that is not sound.
pub fn run_digest(run: impl AsRef<Path>) -> Result<Hash, Error> {
    let run = run.as_ref();
    let (content, finished) = read_run_file(run)?;
    let parts = Parts::read(run, finished.row.generations)?;
    digest::run(content.rows(), &parts.generations, parts.predictions)
}

/// Verifies a finished run against itself: every file's checksum, the digest of every generation, of the
/// predictions and of the run, and every value that is derived from others. All problems are reported, not only the
/// first. Fails only if there is no run row to verify against.
///
/// Who replaces a cell and every digest above it goes unnoticed here: compare the run digest with a published one,
/// or compute fitness values anew.
pub fn verify(run: impl AsRef<Path>) -> Result<Verification, Error> {
    let run = run.as_ref();
    let (content, finished) = read_run_file(run)?;
    let mut problems = Vec::new();
    let row = &finished.row;

    let present = surplus(run, row.generations, &mut problems)?;
    let mut totals = derived::Totals::default();
    let mut digests = Some(Vec::new());
    // A changed number of generations must not make this loop over files that never were.
    for generation in 1..=row.generations.min(present.saturating_add(1)) {
        match read_generation(run, generation) {
            Ok((evaluations, generations)) => {
                let computed = digest::generation_rows(evaluations.rows(), generations.rows())?;
                let cells = Cells { frame: &generations.frame, row: 0 };
                let recorded = cells.need("rows_digest", Cells::text)?;
                if recorded != computed.to_hex().as_str() {
                    problems.push(Problem::Generation { generation, recorded, computed });
                }
                derived::generation(generation, &evaluations, cells, &mut totals, &mut problems)?;
                if generation == row.winner_generation {
                    derived::winner(&content, &finished, &evaluations, cells, &mut problems)?;
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
    let run_cells = Cells { frame: &content.frame, row: 0 };
    let mut predictions_digest = None;
    if let Some(files) = &predictions {
        let rows: Vec<digest::Rows> = files.iter().map(TableFile::rows).collect();
        let computed = digest::predictions(&rows)?;
        let recorded = run_cells.need("predictions_digest", Cells::text)?;
        if recorded != computed.to_hex().as_str() {
            problems.push(Problem::Predictions { recorded, computed });
        }
        derived::predictions(row, files, &mut problems)?;
        predictions_digest = Some(computed);
    }
    for file in table_files(run, TableName::Skipped)? {
        if let Err(error) = read_file(&file, TableName::Skipped) {
            problems.push(Problem::File(error));
        }
    }
    derived::run(row, run_cells, digests.is_some().then_some(totals), &mut problems)?;

    let mut computed_run_digest = None;
    if let (Some(generations), Some(predictions)) = (digests, predictions_digest) {
        let computed = digest::run(content.rows(), &generations, predictions)?;
        if finished.run_digest != computed.to_hex().as_str() {
            let recorded = finished.run_digest.clone();
            problems.push(Problem::Run { recorded, computed });
        }
        computed_run_digest = Some(computed);
    }
    Ok(Verification {
        generations: row.generations,
        recorded_run_digest: finished.run_digest,
        computed_run_digest,
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
    if generations.frame.height() != 1 {
        let what = format!("a generation has one row, got {}", generations.frame.height());
        let file = run.join(TableName::Generations.as_str()).join(name);
        return Err(Error::Damaged { file, what });
    }
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

/// The digests of which a run digest is made, beside the run's row.
pub(crate) struct Parts {
    pub generations: Vec<Hash>,
    pub predictions: Hash,
}

impl Parts {
    /// The digest of one generation's rows, from its files.
    pub(crate) fn generation(run: &Path, generation: u32) -> Result<Hash, Error> {
        let (evaluations, row) = read_generation(run, generation)?;
        digest::generation_rows(evaluations.rows(), row.rows())
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
        let rows: Vec<digest::Rows> = files.iter().map(TableFile::rows).collect();
        Ok(Self { generations: digests, predictions: digest::predictions(&rows)? })
    }
}
