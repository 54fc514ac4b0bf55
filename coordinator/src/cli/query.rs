//! `coordinator query`: SQL over the tables of runs, sweeps and grids.

use proto::Message;
use std::io::{self, BufWriter, Read as _, Write as _};
use std::path::PathBuf;
use std::process::ExitCode;

use cache::{ByteSize, default_memory, parse_size};
use clap::Args;
use results::{AnswerFormat, QueryError};

use super::memory_limit;
use crate::experiment::name_advice;

/// Ask the tables of runs, sweeps and grids in SQL
///
/// Tables have the names of their folders; SHOW TABLES lists them, DESCRIBE TABLE the columns of one. Where there are
/// several folders, a column run_folder in front says whose row it is.
///
/// Example: coordinator query results/runs/demo-0123456789ab 'SELECT generation, best_fitness FROM generations'
#[derive(Debug, Args)]
pub struct Query {
    /// Folders of runs, sweeps or grids, for example results/runs/demo-0123456789ab; repeatable
    #[arg(value_name = "RUN", required = true, num_args = 1..)]
    folders: Vec<PathBuf>,
    /// One SELECT, SHOW TABLES or DESCRIBE in the SQL of polars, for example 'SELECT * FROM run'; - reads it from
    /// standard input
    #[arg(value_name = "SQL", required = true)]
    sql: String,
    /// A table for people (floats rounded to six digits), or every digit as csv or json, for example csv. In csv, a text
    /// that begins with =, +, -, @, a tab or an end of line has a single quote in front, so that no spreadsheet takes it
    /// for a formula
    #[arg(long, value_name = "FORMAT", default_value = "table", value_parser = ["table", "csv", "json"])]
    format: String,
    /// Most memory that the program may hold, for example 2GiB: a query that takes more ends in an error; by default half
    /// of what is available, but no more than 4GiB
    #[arg(long, value_name = "SIZE", value_parser = parse_size)]
    memory: Option<ByteSize>,
}

/// What to do about a query that takes too much memory.
const LESS: &str =
    "ask for fewer columns or rows (WHERE, GROUP BY, LIMIT), join by a column, or raise --memory";

impl Query {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        quiet_panics();
        memory_limit::bound(self.memory.unwrap_or_else(|| default_memory().min(ByteSize::gib(4))), LESS);
        let answer = results::query(&self.folders, &text(self.sql)?).map_err(explained)?;
        let format = match self.format.as_str() {
            "csv" => AnswerFormat::Csv,
            "json" => AnswerFormat::Json,
            _ => AnswerFormat::Table,
        };
        let mut out = BufWriter::new(io::stdout().lock());
        match answer.write(format, &mut out).and_then(|()| out.flush()) {
            // A reader that has seen enough is no error.
            Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(super::output_error(&error)),
            _ => Ok(ExitCode::SUCCESS),
        }
    }
}

/// The query itself, or what standard input has of it: a byte more than is allowed is enough to be refused.
fn text(sql: String) -> anyhow::Result<String> {
    if sql != "-" {
        return Ok(sql);
    }
    let mut text = Vec::new();
    io::stdin().take(results::LONGEST_QUERY as u64 + 1).read_to_end(&mut text)?;
    Ok(String::from_utf8_lossy(&text).into_owned())
}

/// polars panics in its own threads where it was built without what a query needs: the error tells.
fn quiet_panics() {
    let told = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| match std::thread::current().name() {
        Some("main") => told(panic),
        _ => tracing::debug!("{panic}"),
    }));
}

/// The error with the name that was probably meant.
fn explained(error: QueryError) -> anyhow::Error {
    let (got, there, meaning) = match &error {
        QueryError::Table { got, there, .. } => (got, there, "tables are"),
        QueryError::Column { got, there, elsewhere } if elsewhere.is_empty() => (got, there, "columns are"),
        _ => return error.into(),
    };
    let there: Vec<&str> = there.iter().map(String::as_str).collect();
    let what = Message::of(&error).what;
    anyhow::anyhow!("{what}\n{}", name_advice(got, &there, meaning))
}
