//! The grid folder: created, locked, filled cell by cell in any order, finished with the grid's row.

mod rows;

pub(crate) mod frame;

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use polars::prelude::DataFrame;

use crate::cells::Cells;
use crate::columns::GeneColumn;
use crate::error::Error;
use crate::file::write_whole;
use crate::folder::open_tables;
use crate::parquet;
use crate::read::read_file;
use crate::tables::{Table, TableName};
pub use rows::{BestRow, CellPoints, CountRow, GridRow, GridTables, LandscapeRow, MarginalRow};

/// A grid folder that this process writes to. No other process can open it while this value lives.
///
/// A cell's file becomes visible only whole; `grid/grid.parquet` is written last and says that the grid is finished.
/// A folder whose process was killed at any point can be opened again and goes on with the cells that it lacks.
#[derive(Debug)]
pub struct GridFolder {
    folder: PathBuf,
    genes: Vec<GeneColumn>,
    /// Held, not read: the operating system drops the lock with the file, also if the process is killed.
    _lock: File,
}

impl GridFolder {
    /// Opens a grid folder for writing, making it if it is not there, and locks it.
    ///
    /// Fails if the folder is a file, is not writable, is in use by another process, or if the genes cannot be
    /// columns.
    pub fn create(folder: impl AsRef<Path>, genes: &[GeneColumn]) -> Result<Self, Error> {
        let folder = folder.as_ref();
        let lock = open_tables(folder, &TableName::GRID, genes)?;
        Ok(Self { folder: folder.to_owned(), genes: genes.to_vec(), _lock: lock })
    }

    /// Where the folder is.
    pub fn path(&self) -> &Path {
        &self.folder
    }

    /// Writes the cell of that name, `cell-<name>.parquet`, over a former one if there is one.
    pub fn write_cell(&self, name: &str, points: &CellPoints) -> Result<(), Error> {
        self.write(TableName::Cells, &cell_file(name), frame::cell(&self.genes, points)?)
    }

    /// Removes the cell of that name, if there is one.
    pub fn remove_cell(&self, name: &str) -> Result<(), Error> {
        let file = self.folder.join(TableName::Cells.as_str()).join(cell_file(name));
        match std::fs::remove_file(&file) {
            Err(source) if source.kind() != std::io::ErrorKind::NotFound => {
                Err(Error::io(&file, "remove this file", source))
            }
            _ => Ok(()),
        }
    }

    /// Whether the grid folder `folder` has a file for the cell of that name.
    pub fn has_cell(folder: impl AsRef<Path>, name: &str) -> bool {
        folder.as_ref().join(TableName::Cells.as_str()).join(cell_file(name)).is_file()
    }

    /// Reads the cell of that name; `None` if there is none. Its checksum is verified: see [`Error::is_damage`].
    pub fn read_cell(&self, name: &str) -> Result<Option<CellPoints>, Error> {
        let file = self.folder.join(TableName::Cells.as_str()).join(cell_file(name));
        let content = match read_file(&file, TableName::Cells) {
            Err(Error::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => return Ok(None),
            content => content?,
        };
        let frame = &content.frame;
        let mut genes = Vec::new();
        for gene in &self.genes {
            if content.table.column(&gene.name).is_none_or(|column| !column.gene) {
                return Err(Error::Damaged { file, what: format!("it has no gene {}", gene.name) });
            }
            let cell = |row| Cells { frame, row }.number(&gene.name);
            genes.push((0..frame.height()).map(cell).collect::<Result<_, _>>()?);
        }
        let object_correct = frame.column("object_correct")?.u32()?.iter().flatten().collect();
        let worker_id = if frame.height() > 0 { Cells { frame, row: 0 }.text("worker_id")? } else { None };
        Ok(Some(CellPoints { genes, object_correct, worker_id }))
    }

    /// Writes the tables over all cells, the grid's row last, and with it finishes the grid.
    pub fn write_tables(&self, tables: &GridTables) -> Result<(), Error> {
        let GridTables { grid, best, marginals, landscapes, counts } = tables;
        let queries = grid.queries;
        for (table, frame) in [
            (TableName::Best, frame::best(&self.genes, queries, best)?),
            (TableName::Marginals, frame::marginals(queries, marginals)?),
            (TableName::Landscapes, frame::landscapes(queries, landscapes)?),
            (TableName::Counts, frame::counts(queries, counts)?),
            (TableName::Grid, frame::grid(&self.genes, grid)?),
        ] {
            self.write(table, &format!("{table}.parquet"), frame)?;
        }
        Ok(())
    }

    fn write(&self, table: TableName, name: &str, frame: DataFrame) -> Result<(), Error> {
        let file = self.folder.join(table.as_str()).join(name);
        let bytes = parquet::encode(&Table::new(table, &self.genes)?, frame, &file)?;
        write_whole(&file, &bytes)
    }
}

fn cell_file(name: &str) -> String {
    format!("cell-{name}.parquet")
}

/// A finished grid: its row, its best descriptors and the histogram of its counts.
#[derive(Clone, Debug, PartialEq)]
pub struct FinishedGrid {
    /// What was written at its end.
    pub row: GridRow,
    /// The best descriptors, best first.
    pub best: Vec<BestRow>,
    /// Counts that occur, ascending.
    pub counts: Vec<CountRow>,
}

/// Reads a finished grid. Fails with [`Error::UnfinishedGrid`] if it is not finished.
pub fn read_grid(folder: impl AsRef<Path>) -> Result<FinishedGrid, Error> {
    let folder = folder.as_ref();
    let file = |table: TableName| folder.join(table.as_str()).join(format!("{table}.parquet"));
    let grid = file(TableName::Grid);
    if !fs::exists(&grid).map_err(|source| Error::io(&grid, "look for this file", source))? {
        return Err(Error::UnfinishedGrid(folder.to_owned()));
    }
    let content = read_file(&grid, TableName::Grid)?;
    if content.frame.height() != 1 {
        let what = format!("a grid has one row, got {}", content.frame.height());
        return Err(Error::Damaged { file: grid, what });
    }
    let cells = Cells { frame: &content.frame, row: 0 };
    let genes = content.table.columns.iter().filter(|column| column.gene);
    let best = BestRow {
        genes: genes.map(|column| cells.number(&column.name)).collect::<Result<_, _>>()?,
        object_correct: cells.need("best_object_correct", Cells::u32)?,
    };
    let row = GridRow {
        name: cells.need("name", Cells::text)?,
        grid_key: cells.need("grid_key", Cells::text)?,
        search_space: cells.need("search_space", Cells::text)?,
        train_digest: cells.need("train_digest", Cells::text)?,
        evaluation_version: cells.need("evaluation_version", Cells::u32)?,
        cells: cells.need("cells", Cells::u32)?,
        descriptors: cells.need("descriptors", Cells::u64)?,
        queries: cells.need("queries", Cells::u32)?,
        optimal_descriptors: cells.need("optimal_descriptors", Cells::u64)?,
        best,
        grid_digest: cells.need("grid_digest", Cells::text)?,
        cells_computed: cells.need("cells_computed", Cells::u32)?,
        cells_found: cells.need("cells_found", Cells::u32)?,
        seconds: cells.need("seconds", Cells::number)?,
        finished_at: cells.need("finished_at", Cells::time)?,
    };
    Ok(FinishedGrid {
        row,
        best: read_best(&file(TableName::Best))?,
        counts: read_counts(&file(TableName::Counts))?,
    })
}

fn read_best(file: &Path) -> Result<Vec<BestRow>, Error> {
    let content = read_file(file, TableName::Best)?;
    let genes: Vec<&str> = content
        .table
        .columns
        .iter()
        .filter(|column| column.gene)
        .map(|column| column.name.as_str())
        .collect();
    let row = |row| {
        let cells = Cells { frame: &content.frame, row };
        Ok(BestRow {
            genes: genes.iter().map(|gene| cells.number(gene)).collect::<Result<_, _>>()?,
            object_correct: cells.need("object_correct", Cells::u32)?,
        })
    };
    (0..content.frame.height()).map(row).collect()
}

fn read_counts(file: &Path) -> Result<Vec<CountRow>, Error> {
    let content = read_file(file, TableName::Counts)?;
    let row = |row| {
        let cells = Cells { frame: &content.frame, row };
        Ok(CountRow {
            object_correct: cells.need("object_correct", Cells::u32)?,
            descriptors: cells.need("descriptors", Cells::u64)?,
        })
    };
    let counts = (0..content.frame.height()).map(row).collect::<Result<Vec<_>, Error>>()?;
    if !counts.is_sorted_by(|a, b| a.object_correct < b.object_correct) {
        let what = "its counts do not ascend".to_owned();
        return Err(Error::Damaged { file: file.to_owned(), what });
    }
    Ok(counts)
}
