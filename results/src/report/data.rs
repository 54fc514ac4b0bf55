//! A run's tables, column by column, as figures need them.

use std::ops::Range;
use std::path::Path;

use polars::prelude::DataType;

use crate::columns::GeneColumn;
use crate::error::Error;
use crate::read::{FinishedRun, finished, read_file, read_whole, run_file};
use crate::table_name::TableName;
use crate::tables::TableFile;

/// A table.
#[derive(Clone, Debug)]
pub(crate) struct Rows(TableFile);

impl Rows {
    /// A table of a run folder; `None` if it has no file.
    pub fn read(run: &Path, table: TableName) -> Result<Option<Self>, Error> {
        Ok(read_whole(run, table)?.map(Self).filter(|rows| rows.len() > 0))
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.0.frame.height()
    }

    /// The table's genes.
    pub fn genes(&self) -> Vec<GeneColumn> {
        let columns = self.0.table.columns.iter();
        columns.filter_map(|column| GeneColumn::of(column, "")).collect()
    }

    /// A column of numbers, or of flags as 0 and 1.
    pub fn optional(&self, name: &str) -> Result<Vec<Option<f64>>, Error> {
        let column = self.0.frame.column(name)?.cast(&DataType::Float64)?;
        Ok(column.f64()?.iter().collect())
    }

    /// A column of numbers that is never null; NaN where an older file lacks it.
    pub fn numbers(&self, name: &str) -> Result<Vec<f64>, Error> {
        Ok(self.optional(name)?.into_iter().map(|value| value.unwrap_or(f64::NAN)).collect())
    }

    /// What a search has counted, by the first word of its columns of errors: `object`, or `category` where a column
    /// `objective_correct` says so.
    pub fn counted(&self) -> Result<&'static str, Error> {
        let objective = self.optional("objective_correct")?;
        Ok(if objective.iter().any(Option::is_some) { "category" } else { "object" })
    }

    /// A column as text; null is empty.
    pub fn texts(&self, name: &str) -> Result<Vec<String>, Error> {
        let column = self.0.frame.column(name)?.cast(&DataType::String)?;
        let text = |text: Option<&str>| text.unwrap_or_default().to_owned();
        Ok(column.str()?.iter().map(text).collect())
    }

    /// Groups rows by the texts of some columns, in the order of each group's first row. A group is a list of ranges: a
    /// table may have millions of rows, and those of a group mostly follow each other.
    pub fn parts<const N: usize>(&self, columns: [&str; N]) -> Result<Vec<Part<N>>, Error> {
        let columns = columns.map(|name| self.0.frame.column(name)?.str());
        let columns = columns.into_iter().collect::<Result<Vec<_>, _>>()?;
        let mut parts: Vec<Part<N>> = Vec::new();
        let mut current = 0;
        for row in 0..self.len() {
            let texts: [&str; N] = std::array::from_fn(|column| columns[column].get(row).unwrap_or_default());
            if parts.get(current).is_none_or(|(of, _)| *of != texts) {
                current = parts.iter().position(|(of, _)| *of == texts).unwrap_or_else(|| {
                    parts.push((texts.map(str::to_owned), Vec::new()));
                    parts.len() - 1
                });
                parts[current].1.push(row..row);
            }
            if let Some(range) = parts[current].1.last_mut() {
                range.end = row + 1;
            }
        }
        Ok(parts)
    }

    /// A column of times, as seconds since 1970.
    pub fn seconds(&self, name: &str) -> Result<Vec<Option<f64>>, Error> {
        let column = self.0.frame.column(name)?.cast(&DataType::Int64)?;
        Ok(column.i64()?.iter().map(|at| at.map(|milliseconds| milliseconds as f64 / 1e3)).collect())
    }
}

/// The texts of a group, and its rows.
pub(crate) type Part<const N: usize> = ([String; N], Vec<Range<usize>>);

/// A run, finished or not.
#[derive(Clone, Debug)]
pub(crate) struct RunData {
    /// Its label in the report.
    pub label: String,
    /// Its row, if it is finished.
    pub finished: Option<FinishedRun>,
    /// The same as a table.
    pub run: Option<Rows>,
    /// Its tables; `None`: no file.
    pub evaluations: Option<Rows>,
    pub generations: Option<Rows>,
    pub front: Option<Rows>,
    pub predictions: Option<Rows>,
    pub skipped: Option<Rows>,
    pub workers: Option<Rows>,
    pub attempts: Option<Rows>,
    pub events: Option<Rows>,
    pub looks: Option<Rows>,
    pub sets: Option<Rows>,
    /// The comparison of descriptors, if it is complete.
    pub comparison: Option<Comparison>,
}

impl RunData {
    /// Reads a run folder.
    ///
    /// # Errors
    /// If it is not a run folder, or if a file in it cannot be read or is damaged; the message names the file.
    pub fn read(folder: &Path, label: &str) -> Result<Self, Error> {
        if !folder.join(TableName::Evaluations.as_str()).is_dir() {
            let table = TableName::Evaluations;
            return Err(Error::NoFiles { folder: folder.join(table.as_str()), table });
        }
        let (finished, run) = match run_file(folder) {
            Ok(file) => {
                let content = read_file(&file, TableName::Run)?;
                (Some(finished(&content, &file)?), Some(Rows(content)))
            }
            Err(Error::Unfinished(_)) => (None, None),
            Err(error) => return Err(error),
        };
        let read = |table| Rows::read(folder, table);
        Ok(Self {
            label: label.to_owned(),
            finished,
            run,
            evaluations: read(TableName::Evaluations)?,
            generations: read(TableName::Generations)?,
            front: read(TableName::Front)?,
            predictions: read(TableName::Predictions)?,
            skipped: read(TableName::Skipped)?,
            workers: read(TableName::Workers)?,
            attempts: read(TableName::Attempts)?,
            events: read(TableName::Events)?,
            looks: read(TableName::Looks)?,
            sets: read(TableName::Sets)?,
            comparison: Comparison::read(folder)?,
        })
    }
}

/// The tables of a comparison of descriptors.
#[derive(Clone, Debug)]
pub(crate) struct Comparison {
    /// One row per descriptor.
    pub descriptors: Rows,
    pub pairs: Option<Rows>,
    pub recall_precision: Option<Rows>,
    pub answers: Option<Rows>,
    pub perturbed: Option<Rows>,
}

impl Comparison {
    /// Reads a run's comparison; `None` if there is none or it is not complete.
    fn read(folder: &Path) -> Result<Option<Self>, Error> {
        let read = |table| Rows::read(folder, table);
        // Written last: without it the comparison was not finished.
        let Some(descriptors) = read(TableName::Comparison)? else { return Ok(None) };
        Ok(Some(Self {
            descriptors,
            pairs: read(TableName::Pairs)?,
            recall_precision: read(TableName::RecallPrecision)?,
            answers: read(TableName::Answers)?,
            perturbed: read(TableName::Perturbed)?,
        }))
    }
}

/// A share as percent.
pub(crate) fn percent(share: f64) -> f64 {
    100.0 * share
}
