//! Reading a run folder: whole tables as polars frames, and the tables that others compute with as rows.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use polars::prelude::{Column, DataFrame, PolarsResult, Schema};

use crate::columns::GeneColumn;
use crate::error::Error;
use crate::file::names;
use crate::parquet;
use crate::record::Value;
use crate::table_name::TableName;
use crate::tables::TableFile;
use crate::tables::comparison::{ComparedRow, PairRow, PerturbedRow, SetRow};
use crate::tables::grid::LandscapeRow;
use crate::tables::log::{LookRow, RunLog, WorkerRow};
use crate::tables::run::{EvaluationRow, FrontRow, GenerationRow, PredictionRow, PredictionSplit, RunRow};

/// Name of a generation's file in its table's folder.
pub(crate) fn generation_file(generation: u32) -> String {
    format!("generation-{generation:05}.parquet")
}

/// The file of the front.
pub(crate) fn front_file(run: &Path) -> PathBuf {
    run.join(TableName::Front.as_str()).join(TableName::Front.file())
}

/// The table's files, generations in order. Files that are being written are not among them.
pub(crate) fn table_files(run: &Path, table: TableName) -> Result<Vec<PathBuf>, Error> {
    let folder = run.join(table.as_str());
    let names = names(&folder)?;
    let files = names.iter().filter(|name| name.ends_with(".parquet") && !name.starts_with('.'));
    Ok(files.map(|name| folder.join(name)).collect())
}

/// Reads one file of the table.
pub(crate) fn read_file(file: &Path, table: TableName) -> Result<TableFile, Error> {
    parquet::decode(read_bytes(file)?, table, file)
}

/// As [`read_file`]; `None` if there is no such file.
pub(crate) fn read_file_if_any(file: &Path, table: TableName) -> Result<Option<TableFile>, Error> {
    match read_file(file, table) {
        Err(Error::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => Ok(None),
        content => content.map(Some),
    }
}

/// All bytes of a regular file.
pub(crate) fn read_bytes(file: &Path) -> Result<Vec<u8>, Error> {
    let failed = |source| Error::io(file, "read this file", source);
    if !fs::metadata(file).map_err(failed)?.is_file() {
        // Reading a pipe would block.
        return Err(Error::Damaged { file: file.to_owned(), what: "it is no file".to_owned() });
    }
    fs::read(file).map_err(failed)
}

/// A table of a run folder, all its files as one frame, generations in order.
///
/// Columns come in the order of the column table. Those that an older file lacks are null; unknown ones follow, null
/// where a file does not have them. Every file's checksum is verified. Works on runs that are not finished.
pub fn read_table(run: impl AsRef<Path>, table: TableName) -> Result<DataFrame, Error> {
    let run = run.as_ref();
    let whole = read_whole(run, table)?;
    whole.map(|whole| whole.frame).ok_or(Error::NoFiles { folder: run.join(table.as_str()), table })
}

/// As [`read_table`], with the columns as the first file lists them; `None` if there is no file.
pub(crate) fn read_whole(run: &Path, table: TableName) -> Result<Option<TableFile>, Error> {
    let mut frames = Vec::new();
    let mut files = Vec::new();
    let mut columns = None;
    for file in table_files(run, table)? {
        let content = read_file(&file, table)?;
        columns.get_or_insert(content.table);
        frames.push(content.frame);
        files.push(file);
    }
    let schemas = frames.iter().map(|frame| &**frame.schema());
    let schema = union(schemas.zip(files.iter().map(PathBuf::as_path)))?;
    let Some(table) = columns else { return Ok(None) };
    Ok(Some(TableFile { table, frame: stack(frames, &schema)? }))
}

/// The columns of all files, as they first occur. Fails where two have another type.
pub(crate) fn union<'a>(files: impl Iterator<Item = (&'a Schema, &'a Path)>) -> Result<Schema, Error> {
    let mut union = Schema::default();
    for (schema, file) in files {
        for (name, data_type) in schema.iter() {
            match union.get(name) {
                None => {
                    union.insert(name.clone(), data_type.clone());
                }
                Some(expected) if expected == data_type => {}
                Some(expected) => {
                    return Err(Error::Column {
                        file: file.to_owned(),
                        column: name.to_string(),
                        expected: format!("{expected} as in the files before it"),
                        got: data_type.to_string(),
                    });
                }
            }
        }
    }
    Ok(union)
}

/// One frame below the other with these columns, null where a frame does not have them.
pub(crate) fn stack(frames: impl IntoIterator<Item = DataFrame>, schema: &Schema) -> PolarsResult<DataFrame> {
    let mut whole: Option<DataFrame> = None;
    for frame in frames {
        let columns = schema.iter().map(|(name, data_type)| match frame.column(name) {
            Ok(cell) => cell.clone(),
            Err(_) => Column::full_null(name.clone(), frame.height(), data_type),
        });
        let frame = DataFrame::new(frame.height(), columns.collect())?;
        match &mut whole {
            None => whole = Some(frame),
            Some(whole) => {
                whole.vstack_mut_owned(frame)?;
            }
        }
    }
    Ok(whole.unwrap_or_else(|| DataFrame::empty_with_schema(schema)))
}

/// A finished run's row.
#[derive(Clone, Debug, PartialEq)]
pub struct FinishedRun {
    /// What was written at its end.
    pub row: RunRow,
    /// The genes, in the order of [`RunRow::best_genes`].
    pub genes: Vec<GeneColumn>,
    /// The run digest as recorded, hexadecimal.
    pub run_digest: String,
}

/// Reads a finished run's row. Fails with [`Error::Unfinished`] if the run has not ended.
pub fn read_run(run: impl AsRef<Path>) -> Result<FinishedRun, Error> {
    let file = run_file(run.as_ref())?;
    finished(&read_file(&file, TableName::Run)?, &file)
}

/// The file of the run's row.
pub(crate) fn run_file(run: &Path) -> Result<PathBuf, Error> {
    let mut files = table_files(run, TableName::Run)?;
    let first = files.pop().ok_or_else(|| Error::Unfinished(run.to_owned()))?;
    match files.pop() {
        None => Ok(first),
        Some(_) => Err(Error::Damaged { file: first, what: "a run has one file of table run".to_owned() }),
    }
}

pub(crate) fn finished(content: &TableFile, file: &Path) -> Result<FinishedRun, Error> {
    expect_one_row(content, file, "a run")?;
    let run_digest = content.text("run_digest")?.to_owned();
    Ok(FinishedRun { row: content.row()?, genes: content.table.genes.clone(), run_digest })
}

/// Refuses a file of none or several rows; `of` is what a row describes.
pub(crate) fn expect_one_row(content: &TableFile, file: &Path, of: &str) -> Result<(), Error> {
    match content.frame.height() {
        1 => Ok(()),
        rows => Err(Error::Damaged { file: file.to_owned(), what: format!("{of} has one row, got {rows}") }),
    }
}

/// Every row of table `evaluations`, generations in order.
///
/// # Errors
/// If a file cannot be read, or is damaged.
pub fn read_evaluations(run: impl AsRef<Path>) -> Result<Vec<EvaluationRow>, Error> {
    rows_of_all(run.as_ref(), TableName::Evaluations)
}

/// Every row of table `generations`, in order.
///
/// # Errors
/// If a file cannot be read, or is damaged.
pub fn read_generations(run: impl AsRef<Path>) -> Result<Vec<GenerationRow>, Error> {
    rows_of_all(run.as_ref(), TableName::Generations)
}

/// The rows of all files of a table, in order.
fn rows_of_all<R: Value>(run: &Path, table: TableName) -> Result<Vec<R>, Error> {
    let mut rows = Vec::new();
    for file in table_files(run, table)? {
        rows.extend(read_file(&file, table)?.rows::<R>()?);
    }
    Ok(rows)
}

/// The workers of a finished run.
///
/// # Errors
/// If the file cannot be read, or is damaged.
pub fn read_workers(run: impl AsRef<Path>) -> Result<Vec<WorkerRow>, Error> {
    let file = run.as_ref().join(TableName::Workers.as_str()).join(TableName::Workers.file());
    read_file(&file, TableName::Workers)?.rows()
}

/// One individual by its generation and its index in it; `None` if it is not there.
///
/// # Errors
/// If the file cannot be read, or is damaged.
pub fn read_individual(
    run: impl AsRef<Path>,
    generation: u32,
    individual: u32,
) -> Result<Option<EvaluationRow>, Error> {
    let file = run.as_ref().join(TableName::Evaluations.as_str()).join(generation_file(generation));
    let Some(content) = read_file_if_any(&file, TableName::Evaluations)? else { return Ok(None) };
    let rows = content.rows::<EvaluationRow>()?;
    Ok(rows.into_iter().find(|row| row.individual == individual))
}

/// Workers, attempts and events of a run that has ended in any way; nothing of tables that are not there.
///
/// # Errors
/// If a file cannot be read, or is damaged.
pub fn read_log(run: impl AsRef<Path>) -> Result<RunLog, Error> {
    let run = run.as_ref();
    let read = |table: TableName| read_file_if_any(&run.join(table.as_str()).join(table.file()), table);
    Ok(RunLog {
        workers: read(TableName::Workers)?.map_or(Ok(Vec::new()), |content| content.rows())?,
        attempts: read(TableName::Attempts)?.map_or(Ok(Vec::new()), |content| content.rows())?,
        events: read(TableName::Events)?.map_or(Ok(Vec::new()), |content| content.rows())?,
    })
}

/// What descriptors have with each pair of values of two genes, of the grid in a folder; none if there is none.
///
/// # Errors
/// If the file cannot be read, or is damaged.
pub fn read_landscapes(grid: impl AsRef<Path>) -> Result<Vec<LandscapeRow>, Error> {
    let file = grid.as_ref().join(TableName::Landscapes.as_str()).join(TableName::Landscapes.file());
    read_file_if_any(&file, TableName::Landscapes)?.map_or(Ok(Vec::new()), |content| content.rows())
}

/// The looks at the test clouds of a run, in their order.
///
/// # Errors
/// If a file cannot be read, or is damaged.
pub fn read_looks(run: impl AsRef<Path>) -> Result<Vec<LookRow>, Error> {
    rows_of_all(run.as_ref(), TableName::Looks)
}

/// The descriptors of the comparison in a run folder, in its order; none if there is none, or none that is whole.
///
/// # Errors
/// If the file cannot be read, or is damaged.
pub fn read_comparison(run: impl AsRef<Path>) -> Result<Vec<ComparedRow>, Error> {
    let file = run.as_ref().join(TableName::Comparison.as_str()).join(TableName::Comparison.file());
    read_file_if_any(&file, TableName::Comparison)?.map_or(Ok(Vec::new()), |content| content.rows())
}

/// All pairs of descriptors of a run's comparison; none where there is no comparison.
///
/// # Errors
/// If the file cannot be read, or is damaged.
pub fn read_pairs(run: impl AsRef<Path>) -> Result<Vec<PairRow>, Error> {
    let file = run.as_ref().join(TableName::Pairs.as_str()).join(TableName::Pairs.file());
    read_file_if_any(&file, TableName::Pairs)?.map_or(Ok(Vec::new()), |content| content.rows())
}

/// What descriptors have on the test clouds of each set, in a run folder; none if the clouds are of one set.
///
/// # Errors
/// As [`read_run`].
pub fn read_sets(run: impl AsRef<Path>) -> Result<Vec<SetRow>, Error> {
    let file = run.as_ref().join(TableName::Sets.as_str()).join(TableName::Sets.file());
    read_file_if_any(&file, TableName::Sets)?.map_or(Ok(Vec::new()), |content| content.rows())
}

/// The errors on perturbed test clouds in a run folder; none if there are none.
///
/// # Errors
/// If the file cannot be read, or is damaged.
pub fn read_perturbed(run: impl AsRef<Path>) -> Result<Vec<PerturbedRow>, Error> {
    let file = run.as_ref().join(TableName::Perturbed.as_str()).join(TableName::Perturbed.file());
    read_file_if_any(&file, TableName::Perturbed)?.map_or(Ok(Vec::new()), |content| content.rows())
}

/// The answers of one descriptor of the comparison in a run folder, by its label, in query order; none if there are none.
///
/// # Errors
/// If the file cannot be read, or is damaged.
pub fn read_answers(run: impl AsRef<Path>, descriptor: &str) -> Result<Vec<PredictionRow>, Error> {
    let file = run.as_ref().join(TableName::Answers.as_str()).join(format!("{descriptor}.parquet"));
    read_file_if_any(&file, TableName::Answers)?.map_or(Ok(Vec::new()), |content| content.rows())
}

/// The front of a run of several objectives, in the order of its points; none of other runs.
///
/// # Errors
/// If the file cannot be read, or is damaged.
pub fn read_front(run: impl AsRef<Path>) -> Result<Vec<FrontRow>, Error> {
    let content = read_file_if_any(&front_file(run.as_ref()), TableName::Front)?;
    content.map_or(Ok(Vec::new()), |content| content.rows())
}

/// The winner's answers to the queries of one split, in query order; none where the run has not measured it.
///
/// # Errors
/// If the file cannot be read, or is damaged.
pub fn read_predictions(run: impl AsRef<Path>, split: PredictionSplit) -> Result<Vec<PredictionRow>, Error> {
    let file = run.as_ref().join(TableName::Predictions.as_str()).join(split.file());
    read_file_if_any(&file, TableName::Predictions)?.map_or(Ok(Vec::new()), |content| content.rows())
}
