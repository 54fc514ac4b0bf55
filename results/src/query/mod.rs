//! SQL over the tables of runs and grids: which folders, which tables of them, what polars makes of the statement.
//!
//! A table is opened when the statement names it, and of its files only the columns that the statement needs are
//! decoded: a grid has millions of cells. polars' functions that read other files are not built in, and a statement
//! that does not only read is refused.

mod answer;
mod cell;
mod error;
mod folders;
mod scan;
mod statement;
mod text;

use std::path::Path;
use std::thread;

use polars::prelude::{DataFrame, NamedFrom, PolarsError, Series};
use polars_sql::SQLContext;

pub use answer::{Answer, AnswerFormat};
pub use error::QueryError;
use folders::{Member, RUN_FOLDER, all_tables, members};
use scan::OpenTable;
use statement::{Statement, Tokens};

use crate::columns::Column;
use crate::error::Error;
use crate::read::table_files;
use crate::table_name::TableName;
use crate::tables::Table;

/// Longest statement in bytes: a parsed statement is as deep as it is long.
pub const LONGEST_QUERY: usize = 1 << 14;

/// A parsed statement of [`LONGEST_QUERY`] bytes is walked by recursion: this is many times what that takes.
const STACK: usize = 1 << 27;

/// Most operators of the kind that polars evaluates one inside the other, on the stacks of its own threads: with
/// 500 they overflow.
const DEEPEST: usize = 200;

/// Answers one statement over the tables of these folders: `SELECT` in polars' dialect, `SHOW TABLES`, or
/// `DESCRIBE table` for the meaning of its columns.
///
/// A folder is that of a run, finished or not, of a grid, or one that holds such folders, as that of a sweep does.
/// Where there are several, each table has the rows of all that have it, and a column `run_folder` in front: the end
/// of the folder's path, as long as it takes to tell them apart. A single folder has that column if the statement
/// names it. Files are checked as by [`read_table`](crate::read_table).
pub fn query(folders: &[impl AsRef<Path>], sql: &str) -> Result<Answer, QueryError> {
    if sql.len() > LONGEST_QUERY {
        return Err(QueryError::TooLong { length: sql.len(), longest: LONGEST_QUERY });
    }
    let tokens = Tokens::of(sql);
    let statement = tokens.statement()?;
    if tokens.nesting() > DEEPEST {
        return Err(QueryError::TooDeep { count: tokens.nesting(), most: DEEPEST });
    }
    let members = members(folders)?;
    let tables = Tables { several: members.len() > 1 || tokens.has(RUN_FOLDER), members };
    let frame = match statement {
        Statement::ShowTables => tables.show()?,
        Statement::Describe(table) => tables.describe(&table)?,
        Statement::Select => tables.select(sql, &tokens)?,
    };
    Ok(Answer::new(frame))
}

/// The tables that a statement may read.
struct Tables {
    members: Vec<Member>,
    /// Whether rows have the column `run_folder`.
    several: bool,
}

impl Tables {
    /// The tables that at least one member has.
    fn present(&self) -> Result<Vec<TableName>, Error> {
        let mut there = Vec::new();
        for table in all_tables() {
            for member in &self.members {
                if !table_files(&member.folder, table)?.is_empty() {
                    there.push(table);
                    break;
                }
            }
        }
        Ok(there)
    }

    fn open(&self, name: &str) -> Result<OpenTable, QueryError> {
        let there = self.present()?;
        match there.iter().find(|table| table.as_str() == name) {
            Some(&table) => Ok(OpenTable::open(&self.members, table, self.several)?),
            None => Err(QueryError::Table {
                got: name.to_owned(),
                known: all_tables().any(|table| table.as_str() == name),
                there: there.into_iter().map(|table| table.as_str().to_owned()).collect(),
            }),
        }
    }

    fn show(&self) -> Result<DataFrame, QueryError> {
        let there = self.present()?;
        let mut meanings = Vec::new();
        for &table in &there {
            meanings.push(format!("a row is {}", Table::new(table, &[])?.meaning));
        }
        let names: Vec<&str> = there.iter().map(|table| table.as_str()).collect();
        let columns = vec![Series::new("name".into(), names), Series::new("meaning".into(), meanings)];
        Ok(frame(columns)?)
    }

    fn describe(&self, name: &str) -> Result<DataFrame, QueryError> {
        let table = self.open(name)?;
        let (schema, columns) = (table.schema(), table.columns());
        let known = |name: &str| columns.iter().find(|column| column.name == name);
        let each = |text: fn(&Column) -> &str| -> Vec<String> {
            schema.iter_names().map(|name| known(name).map_or("", text).to_owned()).collect()
        };
        let flag = |flag: fn(&Column) -> bool| -> Vec<Option<bool>> {
            schema.iter_names().map(|name| known(name).map(flag)).collect()
        };
        let names: Vec<&str> = schema.iter_names().map(|name| name.as_str()).collect();
        let columns = vec![
            Series::new("column".into(), names),
            Series::new("kind".into(), each(|column| column.kind.name())),
            Series::new("unit".into(), each(|column| &column.unit)),
            Series::new("nullable".into(), flag(|column| column.nullable)),
            Series::new("in_digest".into(), flag(|column| column.in_digest)),
            Series::new("meaning".into(), each(|column| &column.meaning)),
        ];
        Ok(frame(columns)?)
    }

    /// Lets polars answer a SELECT. It looks a name up among the tables before it does among the statement's own
    /// (`WITH name AS …`), so that it is given only those that it misses.
    fn select(&self, sql: &str, tokens: &Tokens) -> Result<DataFrame, QueryError> {
        let mut open: Vec<(String, OpenTable)> = Vec::new();
        loop {
            let error = match self.attempt(sql, &open)? {
                Ok(frame) => return Ok(frame),
                Err(error) => error,
            };
            let Some(missing) =
                error::missing_table(&error).filter(|name| open.iter().all(|(open, _)| open != name))
            else {
                let columns = open.iter().flat_map(|(_, table)| table.schema().iter_names());
                let columns = columns.map(|name| name.as_str()).chain([RUN_FOLDER]);
                return Err(self.with_tables(error::of_polars(&error, columns), &open)?);
            };
            let table = self.open(missing)?;
            if tokens.define(missing) {
                return Err(QueryError::Defined(missing.to_owned()));
            }
            open.push((missing.to_owned(), table));
        }
    }

    /// An unknown column with the tables that have it and are not open.
    fn with_tables(&self, error: QueryError, open: &[(String, OpenTable)]) -> Result<QueryError, Error> {
        let QueryError::Column { got, there, .. } = error else { return Ok(error) };
        let mut elsewhere = Vec::new();
        for table in self.present()? {
            let has = Table::new(table, &[])?.columns.iter().any(|column| column.name == got);
            if has && open.iter().all(|(name, _)| name != table.as_str()) {
                elsewhere.push(table.as_str().to_owned());
            }
        }
        Ok(QueryError::Column { got, there, elsewhere })
    }

    /// Runs the statement over the tables that are open, in a thread with a stack that is large enough, and whose
    /// panic is an error: polars panics where it was built without what a statement needs.
    fn attempt(
        &self,
        sql: &str,
        open: &[(String, OpenTable)],
    ) -> Result<Result<DataFrame, PolarsError>, QueryError> {
        let run = || {
            let mut context = SQLContext::new();
            for (name, table) in open {
                context.register(name, table.lazy()?);
            }
            context.execute(sql)?.collect()
        };
        let outcome = thread::scope(|scope| {
            let thread =
                thread::Builder::new().name("query".to_owned()).stack_size(STACK).spawn_scoped(scope, run);
            thread.map(|thread| thread.join())
        });
        match outcome {
            Ok(Ok(answer)) => Ok(answer),
            Ok(Err(panic)) => Err(QueryError::Polars { what: error::panic_message(&*panic) }),
            Err(source) => Err(QueryError::Thread(source)),
        }
    }
}

fn frame(columns: Vec<Series>) -> Result<DataFrame, Error> {
    let height = columns.first().map_or(0, |column| column.len());
    Ok(DataFrame::new(height, columns.into_iter().map(Into::into).collect())?)
}
