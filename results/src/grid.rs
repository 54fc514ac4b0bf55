//! The grid folder: created, locked, filled cell by cell in any order, finished with the grid's row.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use polars::prelude::{DataFrame, IntoColumn, NamedFrom, Series};

use crate::checks::{check_best, check_cell, check_grid};
use crate::columns::GeneColumn;
use crate::error::Error;
use crate::file::{names, sync_folder, write_whole};
use crate::folder::{open_tables, opening};
use crate::parquet;
use crate::read::{expect_one_row, read_file, read_file_if_any};
use crate::record::{Context, Value, gene_cells};
use crate::table_name::TableName;
use crate::tables::grid::{BestRow, CellPoints, CellRow, CountRow, GridRow, GridTables};
use crate::tables::log::EventRow;
use crate::tables::{Table, TableFile};

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
        check_cell(&self.genes, points)?;
        // A grid has millions of descriptors, too many for a row struct each: one row gives the columns in which all agree,
        // and the others are put in whole.
        let shared = CellRow {
            genes: vec![None; self.genes.len()],
            object_correct: 0,
            worker_id: points.worker_id.clone(),
            principal: points.principal.clone(),
            seconded: points.seconded.clone(),
            basis: points.basis.clone(),
        };
        let mut cell = Table::new(TableName::Cells, &self.genes)?.filled(&[shared], Context::default())?;
        let height = points.object_correct.len();
        let repeated = cell.frame.columns().iter().map(|column| column.new_from_index(0, height));
        cell.frame = DataFrame::new(height, repeated.collect())?;
        for (gene, values) in self.genes.iter().zip(&points.genes) {
            cell.frame.replace(&gene.name, gene_cells("", gene, values)?)?;
        }
        let counts = Series::new("object_correct".into(), &points.object_correct);
        cell.frame.replace("object_correct", counts.into_column())?;
        self.write_file(cell, &cell_file(name))
    }

    /// Removes the cell of that name, if there is one.
    pub fn remove_cell(&self, name: &str) -> Result<(), Error> {
        let file = self.folder.join(TableName::Cells.as_str()).join(cell_file(name));
        match fs::remove_file(&file) {
            Err(source) if source.kind() != io::ErrorKind::NotFound => {
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
        let Some(mut content) = read_file_if_any(&file, TableName::Cells)? else { return Ok(None) };
        if let Some(gene) = self.genes.iter().find(|gene| content.frame.column(&gene.name).is_err()) {
            return Err(Error::Damaged { file, what: format!("it has no gene {}", gene.name) });
        }
        content.table.genes.clone_from(&self.genes);
        let mut points = CellPoints {
            genes: vec![Vec::new(); self.genes.len()],
            object_correct: Vec::new(),
            worker_id: None,
            principal: None,
            seconded: None,
            basis: None,
        };
        for row in content.rows::<CellRow>()? {
            for (values, value) in points.genes.iter_mut().zip(row.genes) {
                values.push(value);
            }
            points.object_correct.push(row.object_correct);
            points.worker_id = row.worker_id;
            points.principal = row.principal;
            points.seconded = row.seconded;
            points.basis = row.basis;
        }
        Ok(Some(points))
    }

    /// Records an event of the search; it is on the disk when this returns, and stays when the grid is finished.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn record_event(&self, event: &EventRow) -> Result<(), Error> {
        let folder = self.folder.join(TableName::Events.as_str());
        fs::create_dir_all(&folder).map_err(|source| opening(&folder, source))?;
        sync_folder(&self.folder)?;
        let number = names(&folder)?.iter().filter_map(|name| event_number(name)).max().unwrap_or(0) + 1;
        let rows = std::slice::from_ref(event);
        self.write(TableName::Events, rows, 0, &format!("event-{number:05}.parquet"))
    }

    /// Writes the tables over all cells, the grid's row last, and with it finishes the grid.
    pub fn write_tables(&self, tables: &GridTables) -> Result<(), Error> {
        let GridTables { grid, best, marginals, landscapes, counts } = tables;
        check_best(&self.genes, grid.queries, best)?;
        check_grid(&self.genes, grid)?;
        self.write(TableName::Best, best, grid.queries, &TableName::Best.file())?;
        self.write(TableName::Marginals, marginals, grid.queries, &TableName::Marginals.file())?;
        self.write(TableName::Landscapes, landscapes, grid.queries, &TableName::Landscapes.file())?;
        self.write(TableName::Counts, counts, grid.queries, &TableName::Counts.file())?;
        self.write(TableName::Grid, std::slice::from_ref(grid), grid.queries, &TableName::Grid.file())
    }

    fn write<R: Value>(&self, table: TableName, rows: &[R], queries: u32, name: &str) -> Result<(), Error> {
        let context = Context { queries, ..Context::default() };
        self.write_file(Table::new(table, &self.genes)?.filled(rows, context)?, name)
    }

    fn write_file(&self, rows: TableFile, name: &str) -> Result<(), Error> {
        let file = self.folder.join(rows.table.name.as_str()).join(name);
        let bytes = parquet::encode(&rows.table, rows.frame, &file)?;
        write_whole(&file, &bytes)
    }
}

/// Number of an event's file.
fn event_number(name: &str) -> Option<u32> {
    name.strip_prefix("event-")?.strip_suffix(".parquet")?.parse().ok()
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
    let file = |table: TableName| folder.join(table.as_str()).join(table.file());
    let grid = file(TableName::Grid);
    if !fs::exists(&grid).map_err(|source| Error::io(&grid, "look for this file", source))? {
        return Err(Error::UnfinishedGrid(folder.to_owned()));
    }
    let content = read_file(&grid, TableName::Grid)?;
    expect_one_row(&content, &grid, "a grid")?;
    let row = content.row()?;
    let best = read_file(&file(TableName::Best), TableName::Best)?.rows()?;
    let counts_file = file(TableName::Counts);
    let counts: Vec<CountRow> = read_file(&counts_file, TableName::Counts)?.rows()?;
    if !counts.is_sorted_by(|a, b| a.object_correct < b.object_correct) {
        return Err(Error::Damaged { file: counts_file, what: "its counts do not ascend".to_owned() });
    }
    Ok(FinishedGrid { row, best, counts })
}
