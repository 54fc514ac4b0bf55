//! The run folder: created, locked, filled generation by generation, finished with the run's row.

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use atomic::is_temporary;
use blake3::Hash;
use polars::prelude::DataFrame;

use crate::columns::GeneColumn;
use crate::comparison::{self, ComparedRow, Curve, LookRow, PairRow};
use crate::digest;
use crate::error::Error;
use crate::file::{names, sync_folder, write_whole};
use crate::frame;
use crate::parquet;
use crate::population::PopulationSummary;
use crate::proceedings::{self, Proceedings};
use crate::read::generation_file;
use crate::rows::{EvaluationRow, GenerationRow, PredictionRow, PredictionSplit, RunRow, SkippedRow};
use crate::tables::{Table, TableName};
use crate::verify::Parts;

const LOCK: &str = ".lock";
const RUN_FILE: &str = "run.parquet";
const SKIPPED_FILE: &str = "skipped.parquet";

/// Order in which tables vanish when a run is discarded: what says "whole" first, what it speaks of after it.
const DISCARD_ORDER: [TableName; 8] = [
    TableName::Run,
    TableName::Generations,
    TableName::Evaluations,
    TableName::Predictions,
    TableName::Skipped,
    TableName::Workers,
    TableName::Attempts,
    TableName::Events,
];

/// A run folder that this process writes to. No other process can open it while this value lives.
///
/// Files become visible only whole, in this order: a generation's `evaluations`, its row of `generations`; at the
/// end `predictions`, `skipped`, `workers`, `attempts`, `events`, and last `run/run.parquet`, which marks the run as finished. A folder whose
/// process was killed at any point can be opened again; what is visible in it is sound.
#[derive(Debug)]
pub struct RunFolder {
    folder: PathBuf,
    genes: Vec<GeneColumn>,
    generations: u32,
    /// Held, not read: the operating system drops the lock with the file, also if the process is killed.
    _lock: File,
}

impl RunFolder {
    /// Opens a run folder for writing, making it if it is not there, and locks it.
    ///
    /// Fails if the folder is a file, is not writable, is in use by another process, or if the genes cannot be
    /// columns. A finished run can be opened: see [`RunFolder::is_finished`] and [`RunFolder::discard`].
    pub fn create(folder: impl AsRef<Path>, genes: &[GeneColumn]) -> Result<Self, Error> {
        let folder = folder.as_ref();
        let lock = open_tables(folder, &TableName::RUN, genes)?;
        let mut this = Self { folder: folder.to_owned(), genes: genes.to_vec(), generations: 0, _lock: lock };
        while this.file(TableName::Generations, &generation_file(this.generations + 1)).exists() {
            this.generations += 1;
        }
        Ok(this)
    }

    /// Where the folder is.
    pub fn path(&self) -> &Path {
        &self.folder
    }

    /// Whether the run has ended: its row is written.
    pub fn is_finished(&self) -> bool {
        self.file(TableName::Run, RUN_FILE).exists()
    }

    /// Number of generations that are written whole, from generation 1 without a gap.
    pub fn generations(&self) -> u32 {
        self.generations
    }

    /// Writes the next generation: its individuals in order, then its row. Returns the digest of its rows.
    ///
    /// Refuses a generation that is not the next one, individuals that cannot be one generation (indices not
    /// 0, 1, …, unequal chromosome lengths or queries, more correct than queries) and floats that are not finite.
    pub fn write_generation(
        &mut self,
        individuals: &[EvaluationRow],
        row: &GenerationRow,
    ) -> Result<Hash, Error> {
        self.refuse_if_finished()?;
        let expected = self.generations + 1;
        let other = individuals.iter().map(|individual| individual.generation).find(|&got| got != expected);
        if let Some(got) = other.or(Some(row.generation).filter(|&got| got != expected)) {
            return Err(Error::Order { expected, got });
        }
        let evaluations = self.table(TableName::Evaluations)?;
        let generations = self.table(TableName::Generations)?;
        let frame = frame::evaluations(&self.genes, individuals)?;
        let Some(summary) = PopulationSummary::of(individuals) else {
            return Err(Error::Order { expected, got: 0 });
        };
        let mut row = frame::generation(row, &summary)?;
        let rows_digest = digest::generation_rows((&evaluations, &frame), (&generations, &row))?;
        row.with_column(frame::text("rows_digest", &rows_digest.to_hex()))?;
        let name = generation_file(expected);
        // Both are encoded, and with it checked, before the first becomes visible.
        let evaluations = self.encode(&evaluations, frame, &name)?;
        let generations = self.encode(&generations, row, &name)?;
        write_whole(&evaluations.0, &evaluations.1)?;
        write_whole(&generations.0, &generations.1)?;
        self.generations = expected;
        Ok(rows_digest)
    }

    /// Whether the generation that is there in this place is this one, in everything that the run digest covers.
    ///
    /// # Errors
    /// As [`RunFolder::write_generation`]; one that is there and cannot be read is not this one.
    pub fn has(&self, individuals: &[EvaluationRow], row: &GenerationRow) -> Result<bool, Error> {
        let evaluations = self.table(TableName::Evaluations)?;
        let generations = self.table(TableName::Generations)?;
        let frame = frame::evaluations(&self.genes, individuals)?;
        let Some(summary) = PopulationSummary::of(individuals) else { return Ok(false) };
        let expected = digest::generation_rows(
            (&evaluations, &frame),
            (&generations, &frame::generation(row, &summary)?),
        )?;
        Ok(Parts::generation(&self.folder, row.generation).is_ok_and(|found| found == expected))
    }

    /// Removes every generation after the first `kept`, the last one first.
    pub fn truncate(&mut self, kept: u32) -> Result<(), Error> {
        self.refuse_if_finished()?;
        while self.generations > kept {
            let name = generation_file(self.generations);
            for table in [TableName::Generations, TableName::Evaluations] {
                let folder = self.folder.join(table.as_str());
                remove(&folder, |other| other == name)?;
                sync_folder(&folder)?;
            }
            self.generations -= 1;
        }
        Ok(())
    }

    /// Writes the winner's predictions of one split, in query order.
    pub fn write_predictions(&self, split: PredictionSplit, rows: &[PredictionRow]) -> Result<(), Error> {
        self.refuse_if_finished()?;
        let name = format!("{}.parquet", split.as_str());
        self.write(&self.table(TableName::Predictions)?, frame::predictions(split, rows)?, &name)
    }

    /// Writes the clouds that took no part; also if there are none, so that readers find the table.
    pub fn write_skipped(&self, rows: &[SkippedRow]) -> Result<(), Error> {
        self.refuse_if_finished()?;
        self.write(&self.table(TableName::Skipped)?, frame::skipped(rows)?, SKIPPED_FILE)
    }

    /// Writes what happened beside the results; also if nothing did, so that readers find the tables.
    pub fn write_proceedings(&self, proceedings: &Proceedings) -> Result<(), Error> {
        self.refuse_if_finished()?;
        let Proceedings { workers, attempts, events } = proceedings;
        for (name, frame) in [
            (TableName::Workers, proceedings::workers(workers)?),
            (TableName::Attempts, proceedings::attempts(attempts)?),
            (TableName::Events, proceedings::events(events)?),
        ] {
            self.write(&self.table(name)?, frame, &format!("{name}.parquet"))?;
        }
        Ok(())
    }

    /// Notes that test clouds are about to be released; also in a run that is finished. What is noted stays, whatever
    /// becomes of the run.
    pub fn note_look(&self, look: &LookRow) -> Result<(), Error> {
        let table = self.table(TableName::Looks)?;
        let folder = self.folder.join(TableName::Looks.as_str());
        let number = names(&folder)?.iter().filter_map(|name| look_number(name)).max().unwrap_or(0) + 1;
        self.write(&table, comparison::look(look)?, &format!("look-{number:05}.parquet"))
    }

    /// Removes the comparison that is there, the table that says it is whole first, and makes room for another.
    pub fn begin_comparison(&self) -> Result<(), Error> {
        for table in TableName::COMPARISON.into_iter().rev() {
            let folder = self.folder.join(table.as_str());
            fs::create_dir_all(&folder).map_err(|source| opening(&folder, source))?;
            remove(&folder, |name| is_temporary(name) || name.ends_with(".parquet"))?;
            sync_folder(&folder)?;
        }
        sync_folder(&self.folder)
    }

    /// Writes what one descriptor, named by a label that can be a file's name, makes of the test clouds: its answers in
    /// query order, its curves, and the distances of queries to clouds of the database.
    pub fn write_compared(
        &self,
        descriptor: &str,
        answers: &[PredictionRow],
        curves: &[Curve],
        distances: &[(u32, u32, f32)],
    ) -> Result<(), Error> {
        let name = format!("{descriptor}.parquet");
        for (table, frame) in [
            (TableName::Distances, comparison::distances(descriptor, distances)?),
            (TableName::Answers, comparison::answers(descriptor, answers)?),
            (TableName::RecallPrecision, comparison::recall_precision(descriptor, curves)?),
        ] {
            self.write(&self.table(table)?, frame, &name)?;
        }
        Ok(())
    }

    /// Writes all descriptors and all pairs of them, and with it finishes the comparison.
    pub fn write_comparison(&self, rows: &[ComparedRow], pairs: &[PairRow]) -> Result<(), Error> {
        self.write(&self.table(TableName::Pairs)?, comparison::pairs(pairs)?, "pairs.parquet")?;
        let table = self.table(TableName::Comparison)?;
        self.write(&table, comparison::comparison(rows)?, "comparison.parquet")
    }

    /// Computes the run digest from the files as written, writes the run's row and with it finishes the run.
    /// Returns the run digest.
    pub fn write_run(&self, row: &RunRow) -> Result<Hash, Error> {
        self.refuse_if_finished()?;
        if row.generations != self.generations {
            return Err(Error::Order { expected: self.generations, got: row.generations });
        }
        let table = self.table(TableName::Run)?;
        let mut frame = frame::run(&self.genes, row)?;
        let parts = Parts::read(&self.folder, self.generations)?;
        let run_digest = digest::run((&table, &frame), &parts.generations, parts.predictions)?;
        frame.with_column(frame::text("predictions_digest", &parts.predictions.to_hex()))?;
        frame.with_column(frame::text("run_digest", &run_digest.to_hex()))?;
        self.write(&table, frame, RUN_FILE)?;
        Ok(run_digest)
    }

    /// Removes every file that this type writes, finished or not, and nothing else. The folder stays locked and can
    /// be filled anew.
    pub fn discard(&mut self) -> Result<(), Error> {
        for table in DISCARD_ORDER {
            let folder = self.folder.join(table.as_str());
            remove(&folder, |name| is_temporary(name) || is_ours(table, name))?;
            sync_folder(&folder)?;
        }
        self.generations = 0;
        Ok(())
    }

    fn refuse_if_finished(&self) -> Result<(), Error> {
        if self.is_finished() { Err(Error::Finished(self.folder.clone())) } else { Ok(()) }
    }

    fn table(&self, name: TableName) -> Result<Table, Error> {
        Table::new(name, &self.genes)
    }

    fn file(&self, table: TableName, name: &str) -> PathBuf {
        self.folder.join(table.as_str()).join(name)
    }

    fn encode(&self, table: &Table, frame: DataFrame, name: &str) -> Result<(PathBuf, Vec<u8>), Error> {
        let file = self.file(table.name, name);
        let bytes = parquet::encode(table, frame, &file)?;
        Ok((file, bytes))
    }

    fn write(&self, table: &Table, frame: DataFrame, name: &str) -> Result<(), Error> {
        let (file, bytes) = self.encode(table, frame, name)?;
        write_whole(&file, &bytes)
    }
}

/// Makes a folder with these tables, locks it, and removes what was left half written. The lock lasts as long as the
/// file that is returned.
pub(crate) fn open_tables(folder: &Path, tables: &[TableName], genes: &[GeneColumn]) -> Result<File, Error> {
    for &table in tables {
        Table::new(table, genes)?;
    }
    fs::create_dir_all(folder).map_err(|source| opening(folder, source))?;
    let lock = File::options()
        .create(true)
        .truncate(false)
        .write(true)
        .open(folder.join(LOCK))
        .map_err(|source| opening(folder, source))?;
    match lock.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => return Err(Error::InUse(folder.to_owned())),
        Err(TryLockError::Error(source)) => return Err(Error::io(folder, "lock this folder", source)),
    }
    atomic::remove_abandoned(folder);
    for table in tables {
        let table = folder.join(table.as_str());
        fs::create_dir_all(&table).map_err(|source| opening(&table, source))?;
        remove(&table, is_temporary)?;
    }
    sync_folder(folder)?;
    Ok(lock)
}

/// Whether this type writes a file of that name into the table's folder.
fn is_ours(table: TableName, name: &str) -> bool {
    match table {
        TableName::Evaluations | TableName::Generations => {
            let digits = name.strip_prefix("generation-").and_then(|name| name.strip_suffix(".parquet"));
            digits.is_some_and(|digits| digits.len() >= 5 && digits.bytes().all(|b| b.is_ascii_digit()))
        }
        TableName::Predictions => {
            PredictionSplit::ALL.iter().any(|split| name.strip_suffix(".parquet") == Some(split.as_str()))
        }
        TableName::Skipped => name == SKIPPED_FILE,
        TableName::Workers | TableName::Attempts | TableName::Events => {
            name.strip_suffix(".parquet") == Some(table.as_str())
        }
        TableName::Run => name == RUN_FILE,
        // Looks were had, even if the run is not.
        TableName::Looks
        | TableName::Distances
        | TableName::Answers
        | TableName::RecallPrecision
        | TableName::Pairs
        | TableName::Comparison
        | TableName::Cells
        | TableName::Best
        | TableName::Marginals
        | TableName::Landscapes
        | TableName::Counts
        | TableName::Grid
        | TableName::Database => false,
    }
}

/// Number of a look's file.
fn look_number(name: &str) -> Option<u32> {
    name.strip_prefix("look-")?.strip_suffix(".parquet")?.parse().ok()
}

/// Removes files, the latest generation first: what is left after a crash is still a run's beginning, never
/// generations that would later pass for those of another run.
fn remove(folder: &Path, which: impl Fn(&str) -> bool) -> Result<(), Error> {
    for name in names(folder)?.iter().rev().filter(|name| which(name)) {
        let file = folder.join(name);
        fs::remove_file(&file).map_err(|source| Error::io(&file, "remove this file", source))?;
    }
    Ok(())
}

/// Says why a folder cannot be opened for writing.
pub(crate) fn opening(folder: &Path, source: io::Error) -> Error {
    let folder = folder.to_owned();
    match source.kind() {
        // Making a folder where a file stands says "exists"; below a file, "not a directory".
        io::ErrorKind::AlreadyExists | io::ErrorKind::NotADirectory => Error::NotAFolder(folder),
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => {
            Error::NotWritable { folder, source }
        }
        _ => Error::io(&folder, "open this folder for writing", source),
    }
}
