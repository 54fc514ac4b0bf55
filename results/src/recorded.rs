//! Evaluations and predictions of a run as they were recorded, for those who compute them again.

use std::io;
use std::path::Path;

use crate::cells::Cells;
use crate::error::Error;
use crate::read::{read_file, table_files};
use crate::rows::{Counts, PredictionRow, PredictionSplit, RunnerUp};
use crate::tables::TableName;

/// One individual's descriptor and what it reached.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedEvaluation {
    /// Generation, from 1.
    pub generation: u32,
    /// Index in the generation, from 0.
    pub individual: u32,
    /// Values in the genes' units, in the order of the gene columns; `None` for a gene that is not used.
    pub genes: Vec<Option<f64>>,
    /// Outcome on the first training set.
    pub counts: Counts,
}

/// The winner's answers to the queries of one split, in query order; none where the run has not measured it.
///
/// # Errors
/// If the file cannot be read, or is damaged.
pub fn read_predictions(run: impl AsRef<Path>, split: PredictionSplit) -> Result<Vec<PredictionRow>, Error> {
    let name = format!("{}.parquet", split.as_str());
    let file = run.as_ref().join(TableName::Predictions.as_str()).join(name);
    let content = match read_file(&file, TableName::Predictions) {
        Err(Error::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        content => content?,
    };
    let row = |row| {
        let cells = Cells { frame: &content.frame, row };
        let runner_up = cells.text("runner_up_cloud")?.zip(cells.number("runner_up_distance")?);
        Ok(PredictionRow {
            query: cells.need("query", Cells::u32)?,
            cloud: cells.need("cloud", Cells::text)?,
            instance: cells.need("instance", Cells::text)?,
            category: cells.need("category", Cells::text)?,
            nearest_cloud: cells.need("nearest_cloud", Cells::text)?,
            predicted_instance: cells.need("predicted_instance", Cells::text)?,
            predicted_category: cells.need("predicted_category", Cells::text)?,
            distance: cells.need("distance", Cells::number)?,
            runner_up: runner_up.map(|(cloud, distance)| RunnerUp { cloud, distance }),
        })
    };
    (0..content.frame.height()).map(row).collect()
}

/// Every row of table `evaluations`, generations in order.
pub fn read_evaluations(run: impl AsRef<Path>) -> Result<Vec<RecordedEvaluation>, Error> {
    let mut recorded = Vec::new();
    for file in table_files(run.as_ref(), TableName::Evaluations)? {
        let content = read_file(&file, TableName::Evaluations)?;
        let genes: Vec<&str> = content
            .table
            .columns
            .iter()
            .filter(|column| column.gene)
            .map(|column| column.name.as_str())
            .collect();
        for row in 0..content.frame.height() {
            let cells = Cells { frame: &content.frame, row };
            let counts = cells.counts("")?;
            recorded.push(RecordedEvaluation {
                generation: cells.need("generation", Cells::u32)?,
                individual: cells.need("individual", Cells::u32)?,
                genes: genes.iter().map(|gene| cells.number(gene)).collect::<Result<_, _>>()?,
                counts: counts.ok_or_else(|| Error::Damaged {
                    file: file.clone(),
                    what: "a row has no counts".to_owned(),
                })?,
            });
        }
    }
    Ok(recorded)
}
