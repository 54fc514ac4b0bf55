//! From what a run knows to the rows of its tables.

use std::collections::BTreeMap;

use descriptor::{Column, Descriptor, SearchSpace};
use evolution::Individual;
use results::{Computed, Counts, EvaluationRow, GeneColumn, PredictionRow, RunnerUp, SkippedRow};

use crate::dataset::{CloudEntry, Dataset};
use crate::fitness::{Fitness, Measured};
use crate::run::matching::Matching;
use cluster::scheduler::Finished;
use proto::task::{EvaluationResult, Match};

/// The gene columns of every table that has them.
pub fn gene_columns(space: &SearchSpace) -> Vec<GeneColumn> {
    let column = |column: Column| GeneColumn {
        name: column.name.to_owned(),
        unit: column.unit.to_owned(),
        integer: column.integer,
        meaning: column.meaning.to_owned(),
    };
    space.columns().into_iter().map(column).collect()
}

/// The counts of a result.
pub fn counts(result: &EvaluationResult) -> Counts {
    Counts {
        object_correct: result.object_correct,
        category_correct: result.category_correct,
        queries: result.queries,
    }
}

/// The counts of a result whose matches are known, from the matches: what the table of predictions shows.
pub fn recount(dataset: &Dataset, matching: Matching, result: &EvaluationResult) -> Counts {
    let database: Vec<&CloudEntry> = matching.database(dataset).collect();
    let mut counts = Counts { object_correct: 0, category_correct: 0, queries: result.queries };
    for (query, found) in matching.queries(dataset).zip(&result.matches) {
        let nearest = database[found.nearest as usize];
        counts.object_correct += u32::from(nearest.instance == query.instance);
        counts.category_correct += u32::from(nearest.category == query.category);
    }
    counts
}

/// A generation's individuals with their descriptors; `computed` names those whose descriptor was new.
pub fn evaluations(
    (space, fitness): (&SearchSpace, &Fitness),
    generation: u32,
    population: &[Individual],
    descriptors: &[Descriptor],
    measured: &[Measured],
    set_errors: Vec<Option<Vec<f32>>>,
    computed: &BTreeMap<usize, Finished<EvaluationResult>>,
) -> Vec<EvaluationRow> {
    type Evaluated<'a> = (((&'a Individual, &'a Descriptor), &'a Measured), Option<Vec<f32>>);
    let row =
        |(index, (((individual, descriptor), measured), set_errors)): (usize, Evaluated<'_>)| EvaluationRow {
            generation,
            individual: index as u32,
            chromosome: individual.bit_string(),
            genes: space.values(descriptor),
            counts: measured.counts,
            objective_correct: fitness.objective_correct(&measured.counts),
            margin: measured.margin,
            set_errors,
            parent_a: individual.parents[0],
            parent_b: individual.parents[1],
            elite: individual.elite,
            computed: computed.get(&index).map(|finished| Computed {
                worker: finished.worker.clone(),
                attempt: finished.attempt,
                queued_seconds: finished.queued.as_secs_f64(),
                run_seconds: finished.run_seconds,
            }),
        };
    population.iter().zip(descriptors).zip(measured).zip(set_errors).enumerate().map(row).collect()
}

/// The winner's answers to the queries of one matching.
pub fn predictions(dataset: &Dataset, matching: Matching, result: &EvaluationResult) -> Vec<PredictionRow> {
    answers(dataset, matching, (0..).zip(result.matches.iter().copied()))
}

/// Answers to some queries of one matching, by their index.
pub fn answers(
    dataset: &Dataset,
    matching: Matching,
    matches: impl Iterator<Item = (u32, Match)>,
) -> Vec<PredictionRow> {
    let (queries, database) = (matching.query_clouds(dataset), matching.database_clouds(dataset));
    let cloud = |index: u32| &dataset.clouds.entries[index as usize];
    let entry = |index: u32| cloud(database[index as usize]);
    let instance = |index: u32| &dataset.clouds.instances[index as usize].name;
    let category = |index: u32| &dataset.clouds.categories[index as usize];
    let row = |(number, found): (u32, Match)| {
        let (query, nearest) = (cloud(queries[number as usize]), entry(found.nearest));
        PredictionRow {
            query: number,
            cloud: query.path.clone(),
            instance: instance(query.instance).clone(),
            category: category(query.category).clone(),
            nearest_cloud: nearest.path.clone(),
            predicted_instance: instance(nearest.instance).clone(),
            predicted_category: category(nearest.category).clone(),
            distance: found.distance,
            runner_up: found
                .runner_up
                .map(|(index, distance)| RunnerUp { cloud: entry(index).path.clone(), distance }),
        }
    };
    matches.map(row).collect()
}

/// Clouds that took no part.
pub fn skipped(dataset: &Dataset) -> Vec<SkippedRow> {
    let row = |skipped: &crate::dataset::SkippedCloud| SkippedRow {
        split: skipped.split.to_owned(),
        cloud: skipped.path.clone(),
        reason: skipped.reason.to_string(),
    };
    dataset.clouds.skipped.iter().map(row).collect()
}
