//! Values that follow from others, computed again: finds changed cells that no digest covers.

use std::fmt::Debug;

use polars::prelude::AnyValue;

use crate::error::Error;
use crate::file_digests;
use crate::population::PopulationSummary;
use crate::problem::Problem;
use crate::read::FinishedRun;
use crate::record::Context;
use crate::table_name::TableName;
use crate::tables::TableFile;
use crate::tables::run::{
    Counts, EvaluationRow, FrontRow, GenerationRow, PredictionRow, PredictionSplit, RunRow,
};

/// Sums and bests over the generations seen so far.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Totals {
    best_fitness: Option<f64>,
    computed: u64,
    remembered: u64,
}

/// Compares all cells of a table with what they should be.
fn compare(
    expected: &TableFile,
    got: &TableFile,
    generation: Option<u32>,
    problems: &mut Vec<Problem>,
) -> Result<(), Error> {
    let shown = |value: AnyValue| match value {
        AnyValue::Null => "null".to_owned(),
        AnyValue::Float64(value) => format!("{value:?}"),
        other => other.to_string(),
    };
    let table = got.table.name;
    let mut columns = Vec::new();
    for column in &got.table.columns {
        columns.push((&column.name, expected.frame.column(&column.name)?, got.frame.column(&column.name)?));
    }
    for row in 0..got.frame.height() {
        for (column, expected, got) in &columns {
            let (expected, got) = (expected.get(row)?, got.get(row)?);
            if expected != got {
                problems.push(Problem::Inconsistent {
                    table,
                    generation,
                    row,
                    column: column.to_string(),
                    expected: shown(expected),
                    got: shown(got),
                });
            }
        }
    }
    Ok(())
}

/// Compares one value of the run's row.
fn check<T: PartialEq + Debug>(
    column: &str,
    expected: Option<T>,
    got: Option<T>,
    problems: &mut Vec<Problem>,
) {
    if expected != got {
        let shown = |value: Option<T>| value.map_or("null".to_owned(), |value| format!("{value:?}"));
        problems.push(Problem::Inconsistent {
            table: TableName::Run,
            generation: None,
            row: 0,
            column: column.to_owned(),
            expected: shown(expected),
            got: shown(got),
        });
    }
}

fn check_counts(prefix: &str, expected: Counts, got: Option<Counts>, problems: &mut Vec<Problem>) {
    for (name, of) in [
        ("object_correct", (|counts| counts.object_correct) as fn(Counts) -> u32),
        ("category_correct", |counts| counts.category_correct),
        ("queries", |counts| counts.queries),
    ] {
        check(&format!("{prefix}{name}"), Some(of(expected)), got.map(of), problems);
    }
}

/// A generation's individuals and row. Returns both as structs.
pub(crate) fn generation(
    generation: u32,
    [evaluations, generations]: [&TableFile; 2],
    totals: &mut Totals,
    problems: &mut Vec<Problem>,
) -> Result<(Vec<EvaluationRow>, GenerationRow), Error> {
    let rows: Vec<EvaluationRow> = evaluations.rows()?;
    let numbered = (0..).zip(&rows);
    let expected: Vec<_> =
        numbered.map(|(individual, row)| EvaluationRow { generation, individual, ..row.clone() }).collect();
    let expected = evaluations.table.clone().filled(&expected, Context::default())?;
    compare(&expected, evaluations, Some(generation), problems)?;

    let population = PopulationSummary::of(&rows).unwrap_or_default();
    let best_so_far =
        totals.best_fitness.map_or(population.best_fitness, |best| best.max(population.best_fitness));
    totals.best_fitness = Some(best_so_far);
    totals.computed += u64::from(population.evaluations_computed);
    totals.remembered += u64::from(population.evaluations_remembered);
    let row: GenerationRow = generations.row()?;
    let expected = GenerationRow { generation, best_so_far_fitness: best_so_far, ..row.clone() };
    let context = Context { population, ..Context::default() };
    let mut expected = generations.table.clone().filled(&[expected], context)?;
    expected.set_text("rows_digest", generations.text("rows_digest")?)?;
    compare(&expected, generations, Some(generation), problems)?;
    Ok((rows, row))
}

/// What the run's row says of the winner, against the rows of the winner's generation.
pub(crate) fn winner(
    finished: &FinishedRun,
    evaluations: &TableFile,
    (individuals, generation): &(Vec<EvaluationRow>, GenerationRow),
    problems: &mut Vec<Problem>,
) {
    let row = &finished.row;
    let Some(winner) = individuals.get(row.winner_individual as usize) else {
        check("winner_individual", None, Some(row.winner_individual), problems);
        return;
    };
    check("best_chromosome", Some(&winner.chromosome), Some(&row.best_chromosome), problems);
    for (gene, value) in finished.genes.iter().zip(&row.best_genes) {
        let genes = evaluations.table.genes.iter().zip(&winner.genes);
        let expected = genes.filter(|(other, _)| other.name == gene.name).find_map(|(_, value)| *value);
        check(&format!("best_{}", gene.name), expected, *value, problems);
    }
    check_counts("train_", winner.counts, Some(row.train), problems);
    check("train_margin", winner.margin, row.train_margin, problems);
    // Validation may be measured for the winner only, after evolution, and a winner of a front need not be the best of
    // its generation.
    let is_best = PopulationSummary::of(individuals)
        .is_some_and(|population| population.best_individual == row.winner_individual);
    if let Some(validation) = generation.validation.filter(|_| is_best) {
        check_counts("validation_", validation, row.validation, problems);
    }
}

/// The points of the front, and what the run's row says of the winner against them.
pub(crate) fn front(row: &RunRow, file: &TableFile, problems: &mut Vec<Problem>) -> Result<(), Error> {
    let points: Vec<FrontRow> = file.rows()?;
    let numbered = (1..).zip(&points);
    let expected: Vec<_> = numbered
        .map(|(point, got)| {
            let winner = (got.generation, got.individual) == (row.winner_generation, row.winner_individual);
            FrontRow { point, winner, ..got.clone() }
        })
        .collect();
    if let Some(winner) = expected.iter().find(|point| point.winner) {
        check("best_chromosome", Some(&winner.chromosome), Some(&row.best_chromosome), problems);
        check_counts("train_", winner.train, Some(row.train), problems);
        if let Some(validation) = winner.validation {
            check_counts("validation_", validation, row.validation, problems);
        }
    }
    compare(&file.table.clone().filled(&expected, Context::default())?, file, None, problems)
}

/// The counts of the run's row against its predictions.
pub(crate) fn predictions(
    row: &RunRow,
    files: &[TableFile],
    problems: &mut Vec<Problem>,
) -> Result<(), Error> {
    for (split, recorded) in
        [(PredictionSplit::Validation, row.validation), (PredictionSplit::Test, row.test)]
    {
        let mut counts = Counts::NONE;
        for file in files {
            let splits = file.frame.column("split")?.str()?.iter();
            for (row, _) in file
                .rows::<PredictionRow>()?
                .iter()
                .zip(splits)
                .filter(|(_, name)| *name == Some(split.as_str()))
            {
                counts.add(row.predicted_instance == row.instance, row.predicted_category == row.category);
            }
        }
        // A split may be counted without its predictions being kept.
        if counts.queries > 0 {
            check_counts(&format!("{}_", split.as_str()), counts, recorded, problems);
        }
    }
    Ok(())
}

/// The run's row against itself and, if every generation could be read, their sums.
pub(crate) fn run(
    run: &TableFile,
    row: &RunRow,
    totals: Option<Totals>,
    problems: &mut Vec<Problem>,
) -> Result<(), Error> {
    let mut expected = run.table.clone().filled(std::slice::from_ref(row), Context::default())?;
    for digest in ["predictions_digest", "run_digest"] {
        expected.set_text(digest, run.text(digest)?)?;
    }
    for digest in file_digests::columns().filter(|digest| run.text(digest).is_ok_and(|text| !text.is_empty()))
    {
        expected.set_text(digest, run.text(digest)?)?;
    }
    if !run.text("front_digest")?.is_empty() {
        expected.set_text("front_digest", run.text("front_digest")?)?;
    }
    compare(&expected, run, None, problems)?;
    if !(1..=row.generations).contains(&row.winner_generation) {
        check("winner_generation", None, Some(row.winner_generation), problems);
    }
    if let Some(totals) = totals {
        check("evaluations_computed", Some(totals.computed), Some(row.evaluations_computed), problems);
        check("evaluations_remembered", Some(totals.remembered), Some(row.evaluations_remembered), problems);
    }
    Ok(())
}
