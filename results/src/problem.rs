//! What verification of a run may find.

use std::fmt;
use std::path::PathBuf;

use blake3::Hash;

use crate::error::Error;
use crate::table_name::TableName;

/// One thing that is not as the run wrote it.
#[derive(Debug)]
pub enum Problem {
    /// A file is missing, damaged or foreign. The error names it.
    File(Error),
    /// A file of a generation that the run does not have.
    Surplus(PathBuf),
    /// The rows of a generation are not those that were written.
    Generation { generation: u32, recorded: String, computed: Hash },
    /// The predictions are not those that were written.
    Predictions { recorded: String, computed: Hash },
    /// The front is not the one that was written.
    Front { recorded: String, computed: Option<Hash> },
    /// The run as a whole is not what was written.
    Run { recorded: String, computed: Hash },
    /// A table's files are not those that were written.
    Files { table: TableName, recorded: String, computed: Option<Hash> },
    /// The run's row is not what was written.
    Row { recorded: String, computed: Hash },
    /// A look does not follow on those before it: one of them was changed, or is missing.
    Look(PathBuf),
    /// The looks are not those that their head tells of: the last were changed, or are missing, or the head is.
    Looks { head: Hash, computed: Hash },
    /// A file of a comparison is not what was written, or the list of checksums is not; why.
    Checksums(PathBuf, String),
    /// A value that does not follow from the values it is computed from.
    Inconsistent {
        table: TableName,
        generation: Option<u32>,
        row: usize,
        column: String,
        expected: String,
        got: String,
    },
}

fn text(digest: &Option<Hash>) -> String {
    digest.map_or_else(String::new, |digest| digest.to_string())
}

fn or_none(digest: &str) -> &str {
    if digest.is_empty() { "none" } else { digest }
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
            Self::Front { recorded, computed } => {
                write!(f, "front: digest: expected {}, got {}", or_none(recorded), or_none(&text(computed)))
            }
            Self::Files { table, recorded, computed } => {
                let (expected, got) = (or_none(recorded), text(computed));
                write!(f, "{table}: digest of its files: expected {expected}, got {}", or_none(&got))
            }
            Self::Row { recorded, computed } => {
                write!(f, "run: digest of its row: expected {}, got {computed}", or_none(recorded))
            }
            Self::Checksums(file, what) => {
                write!(f, "{}: not as it was written: {what}\ncompare again", file.display())
            }
            Self::Look(file) => {
                let file = file.display();
                write!(f, "{file}: does not follow on the looks before it: one was changed or is missing")
            }
            Self::Looks { head, computed } => {
                write!(
                    f,
                    "looks: head of their chain: expected {head}, got {computed}: one was changed or is missing, or looks/head"
                )
            }
            Self::Run { recorded, computed } => {
                write!(f, "run: run digest: expected {recorded}, got {computed}")
            }
            Self::Inconsistent { table, generation, row, column, expected, got } => {
                write!(f, "{table}")?;
                if let Some(generation) = generation {
                    write!(f, ", generation {generation}")?;
                }
                write!(f, ", row {row}: {column}: expected {expected}, got {got}")
            }
        }
    }
}
