//! Digests of whole files, which the run's row has beside the run digest: of the tables that tell how a run went, and of
//! the row itself. They depend on time and machines, so that they are of this one run.
//!
//! A table's digest is BLAKE3 over names and content of its files, that of the row over all its other cells.

use std::path::Path;

use blake3::{Hash, Hasher};

use crate::digest;
use crate::error::Error;
use crate::look_chain;
use crate::problem::Problem;
use crate::read::{read_bytes, read_file, table_files};
use crate::table_name::TableName;
use crate::tables::TableFile;

/// Tables and the columns of their digests in the run's row. Further looks follow after the end of a run: their digest is
/// that of a chain.
const TABLES: [(TableName, &str); 7] = [
    (TableName::Evaluations, "evaluations_digest"),
    (TableName::Generations, "generations_digest"),
    (TableName::Skipped, "skipped_digest"),
    (TableName::Workers, "workers_digest"),
    (TableName::Attempts, "attempts_digest"),
    (TableName::Events, "events_digest"),
    (TableName::Sets, "sets_digest"),
];
const LOOKS: &str = "looks_digest";
const ROW: &str = "row_digest";

/// The columns of all these digests.
pub(crate) fn columns() -> impl Iterator<Item = &'static str> {
    TABLES.into_iter().map(|(_, column)| column).chain([LOOKS, ROW])
}

/// Digest of a table's files; `None` if it has none.
fn of_table(run: &Path, table: TableName) -> Result<Option<Hash>, Error> {
    let mut hasher = Hasher::new_derive_key("descry files of a table v1");
    let files = table_files(run, table)?;
    for file in &files {
        let name = file.file_name().unwrap_or_default().as_encoded_bytes();
        hasher.update(&(name.len() as u64).to_le_bytes());
        hasher.update(name);
        hasher.update(blake3::hash(&read_bytes(file)?).as_bytes());
    }
    Ok((!files.is_empty()).then(|| hasher.finalize()))
}

/// Fills the run's row, which has all else, with the digests of what is in the folder.
pub(crate) fn record(run: &Path, row: &mut TableFile) -> Result<(), Error> {
    for (table, column) in TABLES {
        if let Some(digest) = of_table(run, table)? {
            row.set_text(column, &digest.to_hex())?;
        }
    }
    row.set_text(LOOKS, &look_chain::end(run)?.to_hex())?;
    let digest = digest::cells(row, ROW)?;
    row.set_text(ROW, &digest.to_hex())
}

/// Compares a folder with its row, after everything that follows from the run digest was; `false`: the row has no such
/// digests, because an earlier build has written it.
pub(crate) fn verify(run: &Path, row: &TableFile, problems: &mut Vec<Problem>) -> Result<bool, Error> {
    if row.text(ROW)?.is_empty() {
        look_chain::verify(run, "", problems)?; // a later build may have added looks
        if columns().any(|column| row.text(column).is_ok_and(|text| !text.is_empty())) {
            problems.push(Problem::Row { recorded: String::new(), computed: digest::cells(row, ROW)? });
        }
        return Ok(false);
    }
    // More is said of these where their cells do not fit together.
    let is_said = !problems.is_empty();
    for (table, column) in TABLES {
        let is_of_generations = matches!(table, TableName::Evaluations | TableName::Generations);
        if is_of_generations && is_said {
            continue;
        }
        let recorded = row.text(column)?.to_owned();
        let computed = match of_table(run, table) {
            Ok(computed) => computed,
            Err(error) => {
                problems.push(Problem::File(error));
                continue;
            }
        };
        if recorded != computed.map_or_else(String::new, |computed| computed.to_string()) {
            let files = table_files(run, table)?;
            match files.iter().find_map(|file| read_file(file, table).err()) {
                Some(error) if is_told(&error, problems) => {}
                Some(error) => problems.push(Problem::File(error)),
                None => problems.push(Problem::Files { table, recorded, computed }),
            }
        }
    }
    look_chain::verify(run, row.text(LOOKS)?, problems)?;
    let is_of_run = problems.iter().any(|problem| {
        matches!(problem, Problem::Run { .. } | Problem::Inconsistent { table: TableName::Run, .. })
    });
    let (recorded, computed) = (row.text(ROW)?.to_owned(), digest::cells(row, ROW)?);
    if recorded != computed.to_hex().as_str() && !is_of_run {
        problems.push(Problem::Row { recorded, computed });
    }
    Ok(true)
}

/// Whether a file was found to be damaged before.
fn is_told(error: &Error, problems: &[Problem]) -> bool {
    let text = error.to_string();
    problems.iter().any(|problem| matches!(problem, Problem::File(told) if told.to_string() == text))
}
