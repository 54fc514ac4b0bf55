//! The run folder: created, locked, filled generation by generation, finished with the run's row.

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use atomic::is_temporary;
use blake3::Hash;

use crate::checks::{check_evaluations, check_front, check_generation, check_predictions, check_run};
use crate::checksums;
use crate::columns::GeneColumn;
use crate::digest;
use crate::error::Error;
use crate::file::{names, sync_folder, write_whole};
use crate::file_digests;
use crate::look_chain;
use crate::parquet;
use crate::population::PopulationSummary;
use crate::read::generation_file;
use crate::record::{Context, Value};
use crate::table_name::TableName;
use crate::tables::comparison::{ComparedRow, Curve, CurvePoint, DistanceRow, PairRow, PerturbedRow, SetRow};
use crate::tables::log::{LookRow, RunLog};
use crate::tables::run::{
    EvaluationRow, FrontRow, GenerationRow, PredictionRow, PredictionSplit, RunRow, SkippedRow,
};
use crate::tables::{Table, TableFile};
use crate::verify::Parts;

/// File in a run or grid folder that its process holds locked.
pub const LOCK: &str = ".lock";

/// Order in which tables are removed when a run is discarded: the one that marks a run or generation as whole before
/// what it marks.
const DISCARD_ORDER: [TableName; 10] = [
    TableName::Run,
    TableName::Front,
    TableName::Sets,
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
/// end `front`, `predictions`, `skipped`, `workers`, `attempts`, `events`, and last `run/run.parquet`, which marks the run as
/// finished. A folder whose process was killed at any point can be opened again; what is visible in it is sound.
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
        self.file(TableName::Run, &TableName::Run.file()).exists()
    }

    /// Whether a folder has a file that a run has written and [`RunFolder::discard`] would remove.
    pub fn has_tables(folder: &Path) -> bool {
        let written = |table: TableName| names(&folder.join(table.as_str())).map(|names| (table, names));
        DISCARD_ORDER
            .into_iter()
            .filter_map(|table| written(table).ok())
            .any(|(table, names)| names.iter().any(|name| is_ours(table, name)))
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
        let (evaluations, mut generation) = self.generation(individuals, row)?;
        let rows_digest = digest::generation_rows(&evaluations, &generation)?;
        generation.set_text("rows_digest", &rows_digest.to_hex())?;
        let name = generation_file(expected);
        // Both are encoded, and with it checked, before the first becomes visible.
        let evaluations = self.encode(evaluations, &name)?;
        let generation = self.encode(generation, &name)?;
        write_whole(&evaluations.0, &evaluations.1)?;
        write_whole(&generation.0, &generation.1)?;
        self.generations = expected;
        Ok(rows_digest)
    }

    /// Both tables of a generation, without its digest.
    fn generation(
        &self,
        individuals: &[EvaluationRow],
        row: &GenerationRow,
    ) -> Result<(TableFile, TableFile), Error> {
        check_evaluations(&self.genes, individuals)?;
        check_generation(row)?;
        let population = PopulationSummary::of(individuals).unwrap_or_default();
        let evaluations = self.table(TableName::Evaluations, individuals, Context::default())?;
        let context = Context { population, ..Context::default() };
        Ok((evaluations, self.table(TableName::Generations, std::slice::from_ref(row), context)?))
    }

    /// Whether the folder has this very generation, in everything that the run digest covers.
    ///
    /// # Errors
    /// As [`RunFolder::write_generation`]. A generation that cannot be read is another one.
    pub fn has(&self, individuals: &[EvaluationRow], row: &GenerationRow) -> Result<bool, Error> {
        let (evaluations, generation) = self.generation(individuals, row)?;
        let expected = digest::generation_rows(&evaluations, &generation)?;
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

    /// Writes the front of a search of several objectives, in the order of its points.
    ///
    /// Refuses points that are not numbered from 1, counts that are not possible, and any number of winners but one.
    pub fn write_front(&self, rows: &[FrontRow]) -> Result<(), Error> {
        self.refuse_if_finished()?;
        check_front(&self.genes, rows)?;
        self.make_table_folder(TableName::Front)?;
        self.write_one(TableName::Front, rows)
    }

    /// Writes what each descriptor has on the test clouds of each set.
    pub fn write_sets(&self, rows: &[SetRow]) -> Result<(), Error> {
        self.refuse_if_finished()?;
        self.make_table_folder(TableName::Sets)?;
        self.write_one(TableName::Sets, rows)
    }

    /// Makes the folder of a table that few runs have.
    fn make_table_folder(&self, table: TableName) -> Result<(), Error> {
        let folder = self.folder.join(table.as_str());
        fs::create_dir_all(&folder).map_err(|source| opening(&folder, source))?;
        remove(&folder, is_temporary)?;
        sync_folder(&self.folder)
    }

    /// Writes the winner's predictions of one split, in query order.
    pub fn write_predictions(&self, split: PredictionSplit, rows: &[PredictionRow]) -> Result<(), Error> {
        self.refuse_if_finished()?;
        check_predictions(rows)?;
        let context = Context { labels: &[split.as_str()], ..Context::default() };
        self.write(TableName::Predictions, rows, context, &split.file())
    }

    /// Writes the clouds that took no part; also if there are none, so that readers find the table.
    pub fn write_skipped(&self, rows: &[SkippedRow]) -> Result<(), Error> {
        self.refuse_if_finished()?;
        self.write_one(TableName::Skipped, rows)
    }

    /// Writes the log of the run; also if it is empty, so that readers find the tables.
    pub fn write_log(&self, log: &RunLog) -> Result<(), Error> {
        self.refuse_if_finished()?;
        self.write_one(TableName::Workers, &log.workers)?;
        self.write_one(TableName::Attempts, &log.attempts)?;
        self.write_one(TableName::Events, &log.events)
    }

    /// Records that test clouds are about to be released; also in a run that is finished. The record stays when the
    /// run is discarded.
    pub fn record_look(&self, look: &LookRow) -> Result<(), Error> {
        let folder = self.folder.join(TableName::Looks.as_str());
        let number = names(&folder)?.iter().filter_map(|name| look_number(name)).max().unwrap_or(0) + 1;
        let name = format!("look-{number:05}.parquet");
        let mut row = self.table(TableName::Looks, std::slice::from_ref(look), Context::default())?;
        let before = look_chain::end(&self.folder)?;
        row.set_text("chain", &before.to_hex())?;
        let (file, bytes) = self.encode(row, &name)?;
        look_chain::begin(&self.folder, before)?;
        write_whole(&file, &bytes)?;
        look_chain::advance(&self.folder, before, &name, &bytes)
    }

    /// Removes the comparison in the folder, the table that marks it as whole first, and prepares the next one.
    pub fn begin_comparison(&self) -> Result<(), Error> {
        checksums::clear(&self.folder)?;
        for table in TableName::PERTURBED.into_iter().chain(TableName::COMPARISON).rev() {
            let folder = self.folder.join(table.as_str());
            fs::create_dir_all(&folder).map_err(|source| opening(&folder, source))?;
            remove(&folder, |name| is_temporary(name) || name.ends_with(".parquet"))?;
            sync_folder(&folder)?;
        }
        sync_folder(&self.folder)
    }

    /// Prepares the comparison in the folder for further descriptors: it stays until [`RunFolder::write_comparison`]
    /// replaces it. Removes what an unfinished one has left of descriptors other than these, which are its own.
    pub fn extend_comparison(&self, descriptors: &[&str]) -> Result<(), Error> {
        for table in [TableName::Distances, TableName::Answers, TableName::RecallPrecision] {
            let folder = self.folder.join(table.as_str());
            fs::create_dir_all(&folder).map_err(|source| opening(&folder, source))?;
            let is_own = |name: &str| {
                name.strip_suffix(".parquet").is_none_or(|descriptor| descriptors.contains(&descriptor))
            };
            let is_listed =
                |file: &str| file.strip_prefix(&format!("{table}/")).is_some_and(|name| !is_own(name));
            checksums::forget(&self.folder, is_listed)?;
            remove(&folder, |name| is_temporary(name) || !is_own(name))?;
            sync_folder(&folder)?;
        }
        sync_folder(&self.folder)
    }

    /// Writes what one descriptor makes of the test clouds: its answers in query order, its curves, and the distances
    /// of queries to database clouds. The label becomes the file's name.
    pub fn write_compared(
        &self,
        descriptor: &str,
        answers: &[PredictionRow],
        curves: &[Curve],
        distances: &[DistanceRow],
    ) -> Result<(), Error> {
        let name = format!("{descriptor}.parquet");
        let context = Context { labels: &[descriptor], ..Context::default() };
        let distances = self.table(TableName::Distances, distances, context)?;
        let answers = self.table(TableName::Answers, answers, context)?;
        let context = Context { labels: &[descriptor, ""], ..context };
        let mut points = self.table::<CurvePoint>(TableName::RecallPrecision, &[], context)?;
        for Curve { name, relevant, points: of_curve } in curves {
            let context = Context { labels: &[descriptor, name], relevant: *relevant, ..context };
            points.append(self.table(TableName::RecallPrecision, of_curve, context)?)?;
        }
        self.write_listed([distances, answers, points].map(|table| self.encode(table, &name)))
    }

    /// Writes all descriptors and all pairs of them, and with it finishes the comparison.
    pub fn write_comparison(&self, rows: &[ComparedRow], pairs: &[PairRow]) -> Result<(), Error> {
        let pairs = self.table(TableName::Pairs, pairs, Context::default())?;
        let rows = self.table(TableName::Comparison, rows, Context::default())?;
        self.write_listed([pairs, rows].map(|table| {
            let name = table.table.name.file();
            self.encode(table, &name)
        }))
    }

    /// Writes the errors of all descriptors on perturbed test clouds.
    pub fn write_perturbed(&self, rows: &[PerturbedRow]) -> Result<(), Error> {
        let folder = self.folder.join(TableName::Perturbed.as_str());
        fs::create_dir_all(&folder).map_err(|source| opening(&folder, source))?;
        let rows = self.table(TableName::Perturbed, rows, Context::default())?;
        self.write_listed([self.encode(rows, &TableName::Perturbed.file())])
    }

    /// Writes files of a comparison, one after the other, and their checksums.
    fn write_listed<const N: usize>(
        &self,
        files: [Result<(PathBuf, Vec<u8>), Error>; N],
    ) -> Result<(), Error> {
        let files = files.into_iter().collect::<Result<Vec<_>, Error>>()?;
        let is_one =
            |name: &str| files.iter().any(|(file, _)| checksums::name_in(&self.folder, file) == name);
        checksums::forget(&self.folder, is_one)?;
        files.iter().try_for_each(|(file, bytes)| write_whole(file, bytes))?;
        checksums::add(&self.folder, &files)
    }

    /// Computes the run digest from the files as written, writes the run's row and with it finishes the run.
    /// Returns the run digest.
    pub fn write_run(&self, row: &RunRow) -> Result<Hash, Error> {
        self.refuse_if_finished()?;
        if row.generations != self.generations {
            return Err(Error::Order { expected: self.generations, got: row.generations });
        }
        check_run(&self.genes, row)?;
        let mut run = self.table(TableName::Run, std::slice::from_ref(row), Context::default())?;
        let parts = Parts::read(&self.folder, self.generations)?;
        let run_digest = digest::run(&run, &parts.generations, parts.predictions, parts.front)?;
        run.set_text("predictions_digest", &parts.predictions.to_hex())?;
        if let Some(front) = parts.front {
            run.set_text("front_digest", &front.to_hex())?;
        }
        run.set_text("run_digest", &run_digest.to_hex())?;
        file_digests::record(&self.folder, &mut run)?;
        let (file, bytes) = self.encode(run, &TableName::Run.file())?;
        write_whole(&file, &bytes)?;
        Ok(run_digest)
    }

    /// Removes every file that this type writes, finished or not, and nothing else. The folder stays locked and can
    /// be filled anew.
    pub fn discard(&mut self) -> Result<(), Error> {
        for table in DISCARD_ORDER {
            let folder = self.folder.join(table.as_str());
            if folder.is_dir() {
                remove(&folder, |name| is_temporary(name) || is_ours(table, name))?;
                sync_folder(&folder)?;
            }
        }
        self.generations = 0;
        Ok(())
    }

    fn refuse_if_finished(&self) -> Result<(), Error> {
        if self.is_finished() { Err(Error::Finished(self.folder.clone())) } else { Ok(()) }
    }

    fn file(&self, table: TableName, name: &str) -> PathBuf {
        self.folder.join(table.as_str()).join(name)
    }

    fn table<R: Value>(&self, table: TableName, rows: &[R], context: Context) -> Result<TableFile, Error> {
        Table::new(table, &self.genes)?.filled(rows, context)
    }

    fn encode(&self, TableFile { table, frame }: TableFile, name: &str) -> Result<(PathBuf, Vec<u8>), Error> {
        let file = self.file(table.name, name);
        let bytes = parquet::encode(&table, frame, &file)?;
        Ok((file, bytes))
    }

    fn write<R: Value>(
        &self,
        table: TableName,
        rows: &[R],
        context: Context,
        name: &str,
    ) -> Result<(), Error> {
        let (file, bytes) = self.encode(self.table(table, rows, context)?, name)?;
        write_whole(&file, &bytes)
    }

    /// Writes a table of one file.
    fn write_one<R: Value>(&self, table: TableName, rows: &[R]) -> Result<(), Error> {
        self.write(table, rows, Context::default(), &table.file())
    }
}

/// Whether a process holds a run or grid folder locked.
pub fn is_in_use(folder: &Path) -> bool {
    let held = File::open(folder.join(LOCK)).and_then(|lock| atomic::is_locked(&lock));
    matches!(held, Ok(Some(true)))
}

/// Makes a folder with these tables, locks it, and removes files left half written. The lock lasts as long as the
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
    match atomic::try_lock(&lock) {
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
        TableName::Predictions => PredictionSplit::ALL.iter().any(|split| name == split.file()),
        TableName::Skipped
        | TableName::Workers
        | TableName::Attempts
        | TableName::Events
        | TableName::Front
        | TableName::Sets
        | TableName::Run => name == table.file(),
        // Test clouds were looked at, even if the run is discarded.
        TableName::Looks
        | TableName::Distances
        | TableName::Answers
        | TableName::RecallPrecision
        | TableName::Pairs
        | TableName::Comparison
        | TableName::Perturbed
        | TableName::Cells
        | TableName::Best
        | TableName::Marginals
        | TableName::Landscapes
        | TableName::Counts
        | TableName::Grid
        | TableName::Database
        | TableName::Channels => false,
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
