//! What can go wrong with a query, and what polars' own errors mean.

use std::any::Any;
use std::io;
use std::path::PathBuf;

use polars::prelude::PolarsError;

use crate::error::Error;

/// Why a query has no answer. Messages name the place first and say what to do on a second line.
#[derive(Debug, thiserror::Error)]
pub enum QueryError {
    /// The folder is not there, or is a file.
    #[error("{}: no such folder\nname the folder of a run, a sweep or a grid, then the query", .0.display())]
    NoFolder(PathBuf),
    /// Neither the folder nor those in it have a table.
    #[error("{}: no table of a run or grid\ncheck that this is such a folder, and that the run got that far", .0.display())]
    NoTables(PathBuf),
    /// The statement does not only read.
    #[error(
        "query: must be one SELECT, SHOW TABLES or DESCRIBE table, got {0:?}\nresults are only read; write the answer to a file with --format csv or json"
    )]
    Statement(String),
    /// The statement is too long.
    #[error("query: must have at most {longest} bytes, got {length}\nask in several steps")]
    TooLong {
        /// Bytes of the statement.
        length: usize,
        /// How many there may be.
        longest: usize,
    },
    /// The statement nests too deeply for polars.
    #[error(
        "query: must have at most {most} of the operators ||, IS, IN and LIKE, got {count}\nask in several steps"
    )]
    TooDeep {
        /// How many there are.
        count: usize,
        /// How many there may be.
        most: usize,
    },
    /// The folders have no such table.
    #[error("query: {}, got {got:?}\ntables are: {}", if *.known { "the folder does not have this table" } else { "unknown table" }, .there.join(", "))]
    Table {
        /// The name in the statement.
        got: String,
        /// Whether other folders have such a table.
        known: bool,
        /// The tables that there are.
        there: Vec<String>,
    },
    /// The tables of the statement have no such column.
    #[error(
        "query: {}, got {got:?}\ncolumns are: {}",
        if .elsewhere.is_empty() {
            "unknown column".to_owned()
        } else {
            format!("column of another table ({})", .elsewhere.join(", "))
        },
        .there.join(", ")
    )]
    Column {
        /// The name in the statement.
        got: String,
        /// The columns of all tables that the statement names, or of the one in it that is asked for this.
        there: Vec<String>,
        /// Tables that have such a column, which the statement does not name.
        elsewhere: Vec<String>,
    },
    /// A column is asked of a table that the statement does not read.
    #[error(
        "query: unknown table in front of a column, got {0:?}\nname it after FROM or JOIN, for example FROM evaluations AS {0}"
    )]
    Alias(String),
    /// A SELECT in a place in which polars cannot answer one.
    #[error(
        "query: a SELECT inside stands only after FROM, JOIN and WITH, and after IN with one column, got one elsewhere\n\
         join it instead, for example SELECT e.* FROM evaluations AS e CROSS JOIN (SELECT MAX(fitness) AS best FROM evaluations) AS b \
         WHERE e.fitness = b.best"
    )]
    Subquery,
    /// The statement gives the name of a table that it reads to one of its own.
    #[error(
        "query: a table of this name is in the folder and read, got WITH {0:?} AS (…)\nchoose another name"
    )]
    Defined(String),
    /// Any other error of polars.
    #[error(
        "query: polars does not understand or cannot do this, got: {what}\nSHOW TABLES and DESCRIBE table tell what there is"
    )]
    Polars {
        /// Its message.
        what: String,
    },
    /// No thread could be started.
    #[error("query: cannot start a thread, got: {0}\nend other programs and try again")]
    Thread(io::Error),
    /// The files cannot be read.
    #[error(transparent)]
    Results(#[from] Error),
}

/// The text between two others.
fn between<'a>(text: &'a str, before: &str, after: &str) -> Option<&'a str> {
    let (_, rest) = text.split_once(before)?;
    rest.split_once(after).map(|(text, _)| text)
}

/// The table that polars did not find. Its errors have no such field, only a text.
pub(super) fn missing_table(error: &PolarsError) -> Option<&str> {
    let PolarsError::SQLInterface(message) = root(error) else { return None };
    between(message, "relation '", "' was not found")
}

fn root(error: &PolarsError) -> &PolarsError {
    match error {
        PolarsError::Context { error, .. } | PolarsError::ExprContext { error, .. } => root(error),
        error => error,
    }
}

/// Whether polars refuses a SELECT for the place in which it stands.
fn is_subquery(message: &str) -> bool {
    [
        "unexpected subquery",
        "subquery comparisons with",
        "expression Exists {",
        "SQL subquery returns more than one",
    ]
    .iter()
    .any(|refusal| message.contains(refusal))
}

/// The columns that an error of polars lists: `valid columns: ["a", "b"]`.
fn valid_columns(message: &str) -> Option<Vec<String>> {
    let list = between(message, "valid columns: [", "]")?;
    Some(list.split(", ").map(|name| name.trim_matches('"').to_owned()).collect())
}

/// Characters of a message of polars that are passed on: the rest is the parsed statement.
const LONGEST: usize = 200;

/// What an error of polars means to whoever asked, with tables of these columns open.
pub(super) fn of_polars<'a>(error: &PolarsError, columns: impl Iterator<Item = &'a str>) -> QueryError {
    let message = root(error).to_string();
    if is_subquery(&message) {
        return QueryError::Subquery;
    }
    if let Some(alias) = between(&message, "no table or struct column named '", "' found") {
        return QueryError::Alias(alias.to_owned());
    }
    let column =
        match root(error) {
            PolarsError::ColumnNotFound(_)
            | PolarsError::SchemaFieldNotFound(_)
            | PolarsError::SQLInterface(_) => between(&message, "unable to find column \"", "\"")
                .or(between(&message, "no column named '", "'")),
            _ => None,
        };
    // What follows an empty line is the plan, which says nothing to whoever wrote SQL.
    let polars = || {
        let what = message.split('\n').next().unwrap_or_default();
        let end = what.char_indices().nth(LONGEST).map_or(what.len(), |(end, _)| end);
        let more = if end < what.len() { "…" } else { "" };
        QueryError::Polars { what: format!("{}{more}", &what[..end]) }
    };
    match column {
        Some(got) => {
            let mut there: Vec<String> = Vec::new();
            for name in columns {
                if there.iter().all(|known| known != name) {
                    there.push(name.to_owned());
                }
            }
            // There is such a column, but not in that place: of a table of the statement's own, or behind a UNION.
            if there.iter().any(|known| known == got) {
                match valid_columns(&message).filter(|valid| valid.iter().all(|name| name != got)) {
                    Some(valid) => there = valid,
                    None => return polars(),
                }
            }
            QueryError::Column { got: got.to_owned(), there, elsewhere: Vec::new() }
        }
        None => polars(),
    }
}

/// The message of a panic.
pub(super) fn panic_message(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or(panic.downcast_ref::<&str>().copied()).unwrap_or("a panic without a message").to_owned()
}
