//! What can go wrong when results are written or read.

use std::io;
use std::path::{Path, PathBuf};

use crate::table_name::TableName;

/// Why results could not be written or read. Messages name the place first and say what to do on a second line.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The run folder, or a folder above it, is a file.
    #[error("{}: run folder is not a folder, got a file\nchoose another folder", .0.display())]
    NotAFolder(PathBuf),
    /// A file of a report would replace a file of somebody else.
    #[error("{}: must be a new file or one of an earlier report, got another file\nchoose another --out, --svg or --figures: nothing was written", .0.display())]
    Occupied(PathBuf),
    /// The run folder cannot be made or written to.
    #[error("{}: run folder is not writable, got: {source}\nchange its permissions or choose another folder", .folder.display())]
    NotWritable { folder: PathBuf, source: io::Error },
    /// Another process holds the run folder.
    #[error("{}: run folder is in use by another process\nwait for it to end or choose another folder", .0.display())]
    InUse(PathBuf),
    /// No space is left for a file.
    #[error("{}: disk is full, got: {source}\nfree some space and start the run again: it lost nothing that was acknowledged", .file.display())]
    DiskFull { file: PathBuf, source: io::Error },
    /// Any other failure of the file system.
    #[error("{}: cannot {doing}, got: {source}\ncheck that it is there and that the disk works", .path.display())]
    Io { path: PathBuf, doing: &'static str, source: io::Error },
    /// Writing into a run that has ended.
    #[error("{}: run is finished and its results do not change\nchoose another folder or discard the run first", .0.display())]
    Finished(PathBuf),
    /// Reading the end of a run that has not ended.
    #[error("{}: run is not finished, got no run/run.parquet\nstart the run again to finish it", .0.display())]
    Unfinished(PathBuf),
    /// Generations are written in order, once.
    #[error("generation: expected {expected} next, got {got}\nwrite generations in order, each once")]
    Order { expected: u32, got: u32 },
    /// A row that cannot be true.
    #[error(
        "{table} row {row}, {column}: expected {expected}, got {got}\nthis is a defect of the program that wrote the row: please report it"
    )]
    Row { table: TableName, row: usize, column: String, expected: String, got: String },
    /// A gene that cannot be a column.
    #[error(
        "gene: name must not be empty, occur twice or be that of another column, got {name:?}\nrename the gene"
    )]
    GeneName { name: String },
    /// Reading the end of a grid that is not whole.
    #[error("{}: grid is not whole, got no grid/grid.parquet\nstart the exhaustive search again to finish it", .0.display())]
    UnfinishedGrid(PathBuf),
    /// A table without any file.
    #[error("{}: no Parquet file of table {table}\ncheck that this is a run folder, and that the run got that far", .folder.display())]
    NoFiles { folder: PathBuf, table: TableName },
    /// Bytes that are not what was written.
    #[error("{}: file is damaged or was changed: {what}\nrestore it from a copy, or run the experiment again", .file.display())]
    Damaged { file: PathBuf, what: String },
    /// A sound Parquet file of another program.
    #[error("{}: not a results file of descry: no {key} in its metadata\nremove it from the run folder", .file.display())]
    Foreign { file: PathBuf, key: &'static str },
    /// A file of a later version of this program.
    #[error("{}: schema version {got} is newer than this program's {supported}\nupdate this program", .file.display())]
    Newer { file: PathBuf, got: u32, supported: u32 },
    /// A file of one table in the folder of another.
    #[error("{}: expected table {expected}, got {got:?}\nmove the file back to its folder", .file.display())]
    WrongTable { file: PathBuf, expected: String, got: String },
    /// A column that breaks the promise that columns are only added.
    #[error("{}: column {column}: expected {expected}, got {got}\nread it with the program that wrote it", .file.display())]
    Column { file: PathBuf, column: String, expected: String, got: String },
    /// The drawing library refused a figure.
    #[error(
        "report: cannot draw figure {figure}, got: {message}\nthis is a defect of this program: please report it"
    )]
    Drawing { figure: String, message: String },
    /// polars refused an operation on a frame that is sound by construction.
    #[error("results: cannot assemble a table, got: {0}\nthis is a defect of this program: please report it")]
    Frame(#[from] polars::error::PolarsError),
}

impl Error {
    /// Whether the file's content is at fault, so that writing it anew would help.
    pub fn is_damage(&self) -> bool {
        matches!(
            self,
            Self::Damaged { .. }
                | Self::Foreign { .. }
                | Self::WrongTable { .. }
                | Self::Column { .. }
                | Self::GeneName { .. }
        )
    }

    /// Names a failed operation on `path`, keeping a full disk apart.
    pub(crate) fn io(path: &Path, doing: &'static str, source: io::Error) -> Self {
        match source.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
                Self::DiskFull { file: path.to_owned(), source }
            }
            _ => Self::Io { path: path.to_owned(), doing, source },
        }
    }
}
