//! Values that follow from others: recomputed, so that a changed cell outside the digest is noticed too.

use std::fmt::Debug;

use crate::cells::Cells;
use crate::error::Error;
use crate::parquet::TableFile;
use crate::population::{Member, PopulationSummary};
use crate::read::FinishedRun;
use crate::rows::{Counts, PredictionSplit, RunRow};
use crate::tables::TableName;
use crate::verify::Problem;

/// Sums and bests over the generations seen so far.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Totals {
    best_fitness: Option<f64>,
    computed: u64,
    remembered: u64,
}

/// Compares cells of one row with what they should be.
struct Check<'a> {
    table: TableName,
    generation: Option<u32>,
    row: usize,
    problems: &'a mut Vec<Problem>,
}

impl Check<'_> {
    fn equal<T: PartialEq + Debug>(&mut self, column: &str, expected: Option<T>, got: Option<T>) {
        if expected != got {
            let show = |value: Option<T>| value.map_or("null".to_owned(), |value| format!("{value:?}"));
            self.problems.push(Problem::Derived {
                table: self.table,
                generation: self.generation,
                row: self.row,
                column: column.to_owned(),
                expected: show(expected),
                got: show(got),
            });
        }
    }

    fn numbers(&mut self, cells: Cells, expected: &[(&str, f64)]) -> Result<(), Error> {
        for &(column, expected) in expected {
            self.equal(column, Some(expected), cells.number(column)?);
        }
        Ok(())
    }

    /// The errors beside counts.
    fn errors(&mut self, cells: Cells, prefix: &str) -> Result<Option<Counts>, Error> {
        let counts = cells.counts(prefix)?;
        for (name, error) in [
            ("object_error", counts.as_ref().map(Counts::object_error)),
            ("category_error", counts.as_ref().map(Counts::category_error)),
        ] {
            let column = format!("{prefix}{name}");
            self.equal(&column, error, cells.number(&column)?);
        }
        Ok(counts)
    }

    fn counts(&mut self, prefix: &str, expected: Counts, got: Option<Counts>) {
        let mut column = |name: &str, of: fn(&Counts) -> u32| {
            self.equal(&format!("{prefix}{name}"), Some(of(&expected)), got.as_ref().map(of));
        };
        column("object_correct", |counts| counts.object_correct);
        column("category_correct", |counts| counts.category_correct);
        column("queries", |counts| counts.queries);
    }
}

/// A generation's individuals and row.
pub(crate) fn generation(
    generation: u32,
    evaluations: &TableFile,
    row: Cells,
    totals: &mut Totals,
    problems: &mut Vec<Problem>,
) -> Result<(), Error> {
    let frame = &evaluations.frame;
    let mut chromosomes = Vec::new();
    for index in 0..frame.height() {
        let cells = Cells { frame, row: index };
        let mut check =
            Check { table: TableName::Evaluations, generation: Some(generation), row: index, problems };
        check.equal("generation", Some(generation), cells.u32("generation")?);
        check.equal("individual", Some(index as u32), cells.u32("individual")?);
        let fitness = check.errors(cells, "")?.as_ref().map(Counts::fitness);
        check.equal("fitness", fitness, cells.number("fitness")?);
        chromosomes.push(cells.need("chromosome", Cells::text)?);
    }
    let mut members = Vec::new();
    for (index, chromosome) in chromosomes.iter().enumerate() {
        let cells = Cells { frame, row: index };
        members.push(Member {
            chromosome,
            object_correct: cells.need("object_correct", Cells::u32)?,
            queries: cells.need("queries", Cells::u32)?,
            remembered: cells.need("remembered", Cells::bool)?,
        });
    }

    let mut check = Check { table: TableName::Generations, generation: Some(generation), row: 0, problems };
    check.equal("generation", Some(generation), row.u32("generation")?);
    check.errors(row, "validation_")?;
    let Some(of) = PopulationSummary::of_members(&members) else {
        check.equal("queries", None, row.u32("queries")?);
        return Ok(());
    };
    let best_so_far = totals.best_fitness.map_or(of.best_fitness, |best| best.max(of.best_fitness));
    totals.best_fitness = Some(best_so_far);
    totals.computed += u64::from(of.evaluations_computed);
    totals.remembered += u64::from(of.evaluations_remembered);
    check.numbers(
        row,
        &[
            ("best_individual", of.best_individual.into()),
            ("best_object_correct", of.best_object_correct.into()),
            ("queries", of.queries.into()),
            ("best_fitness", of.best_fitness),
            ("mean_fitness", of.mean_fitness),
            ("worst_fitness", of.worst_fitness),
            ("best_so_far_fitness", best_so_far),
            ("diversity", of.diversity),
            ("evaluations_computed", of.evaluations_computed.into()),
            ("evaluations_remembered", of.evaluations_remembered.into()),
        ],
    )
}

/// What the run's row says of the winner, against the winner's own rows.
pub(crate) fn winner(
    run: &TableFile,
    finished: &FinishedRun,
    evaluations: &TableFile,
    generation: Cells,
    problems: &mut Vec<Problem>,
) -> Result<(), Error> {
    let row = &finished.row;
    let mut check = Check { table: TableName::Run, generation: None, row: 0, problems };
    let index = row.winner_individual as usize;
    if index >= evaluations.frame.height() {
        check.equal("winner_individual", None, Some(row.winner_individual));
        return Ok(());
    }
    let cells = Cells { frame: &evaluations.frame, row: index };
    check.equal("best_chromosome", cells.text("chromosome")?, Some(row.best_chromosome.clone()));
    let recorded = Cells { frame: &run.frame, row: 0 };
    for gene in &finished.genes {
        let column = format!("best_{}", gene.name);
        let value = match evaluations.table.column(&gene.name) {
            Some(_) => cells.number(&gene.name)?,
            None => None,
        };
        check.equal(&column, value, recorded.number(&column)?);
    }
    check.counts("train_", cells.need("", Cells::counts)?, Some(row.train));
    // Validation may be measured for the winner only, after evolution.
    if let Some(validation) = generation.counts("validation_")? {
        check.counts("validation_", validation, row.validation);
    }
    Ok(())
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
        let mut counts = Counts { object_correct: 0, category_correct: 0, queries: 0 };
        for file in files {
            for index in 0..file.frame.height() {
                let cells = Cells { frame: &file.frame, row: index };
                if cells.text("split")?.as_deref() == Some(split.as_str()) {
                    counts.queries += 1;
                    counts.object_correct += u32::from(cells.need("correct_object", Cells::bool)?);
                    counts.category_correct += u32::from(cells.need("correct_category", Cells::bool)?);
                }
            }
        }
        // A split may be counted without its predictions being kept.
        if counts.queries > 0 {
            let mut check = Check { table: TableName::Run, generation: None, row: 0, problems };
            check.counts(&format!("{}_", split.as_str()), counts, recorded);
        }
    }
    Ok(())
}

/// The run's row against itself and, if every generation could be read, their sums.
pub(crate) fn run(
    row: &RunRow,
    cells: Cells,
    totals: Option<Totals>,
    problems: &mut Vec<Problem>,
) -> Result<(), Error> {
    let mut check = Check { table: TableName::Run, generation: None, row: 0, problems };
    for prefix in ["train_", "validation_", "test_"] {
        check.errors(cells, prefix)?;
    }
    check.equal("regret", row.regret(), cells.number("regret")?);
    if !(1..=row.generations).contains(&row.winner_generation) {
        check.equal("winner_generation", None, Some(row.winner_generation));
    }
    if let Some(totals) = totals {
        check.equal("evaluations_computed", Some(totals.computed), Some(row.evaluations_computed));
        check.equal("evaluations_remembered", Some(totals.remembered), Some(row.evaluations_remembered));
    }
    Ok(())
}
