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
                let none = |digest: String| if digest.is_empty() { "none".to_owned() } else { digest };
                let got = computed.map_or_else(String::new, |computed| computed.to_string());
                write!(f, "front: digest: expected {}, got {}", none(recorded.clone()), none(got))
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
