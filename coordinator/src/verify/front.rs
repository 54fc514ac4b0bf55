//! The front of a finished search of several objectives, found again among all its evaluations.

use std::path::Path;

use evolution::{Front, Individual};
use results::{EvaluationRow, FrontRow};

use crate::experiment::Experiment;
use crate::fitness::Measured;

/// What was found.
#[derive(Debug, Default)]
pub(super) struct Found {
    /// Points of the front.
    pub points: usize,
    /// What is not as it should be.
    pub problems: Vec<String>,
}

/// Compares table `front` with what no evaluation dominates, and the hypervolumes of the generations with those of what none
/// had dominated by then. `evaluations`: all of them, generations in order.
pub(super) fn check(
    run: &Path,
    experiment: &Experiment,
    evaluations: &[EvaluationRow],
) -> Result<Found, results::Error> {
    let (rows, generations) = (results::read_front(run)?, results::read_generations(run)?);
    let mut found = Found { points: rows.len(), problems: Vec::new() };
    let mut front = Front::default();
    // Individuals are known by their places.
    let unnamed = Individual { chromosome: Vec::new(), values: Vec::new(), parents: [None; 2], elite: false };
    let mut recorded = generations.into_iter().map(|generation| generation.hypervolume);
    for generation in evaluations.chunk_by(|a, b| a.generation == b.generation) {
        for row in generation {
            let Some(descriptor) = experiment.space().from_values(&row.genes) else {
                found.problems.push("evaluations: gene values: must lie on the genes' grids".to_owned());
                return Ok(found);
            };
            let score = experiment.score(&descriptor, &Measured { counts: row.counts, margin: row.margin });
            front.add(row.generation, row.individual, &unnamed, score);
        }
        let queries = generation[0].counts.queries;
        let (expected, got) =
            (experiment.objectives().hypervolume(&front, queries), recorded.next().flatten());
        if expected.map(f64::to_bits) != got.map(f64::to_bits) {
            let generation = generation[0].generation;
            found.problems.push(format!(
                "generations, generation {generation}: expected hypervolume {expected:?}, got {got:?}"
            ));
        }
    }
    found.problems.extend(differences(experiment, &front, evaluations, &rows));
    Ok(found)
}

/// Points that the table lacks, has too many, or has with other values than the evaluation that they are.
fn differences(
    experiment: &Experiment,
    front: &Front,
    evaluations: &[EvaluationRow],
    rows: &[FrontRow],
) -> Vec<String> {
    let mut problems = Vec::new();
    let place = |row: &FrontRow| (row.generation, row.individual);
    let expected: Vec<(u32, u32)> =
        front.points().iter().map(|point| (point.generation, point.index)).collect();
    let got: Vec<(u32, u32)> = rows.iter().map(place).collect();
    if expected != got {
        let shown = |places: &[(u32, u32)]| {
            places
                .iter()
                .map(|(generation, index)| format!("{generation}.{index}"))
                .collect::<Vec<_>>()
                .join(" ")
        };
        problems.push(format!(
            "front: expected the individuals (generation.individual) {}, got {}",
            shown(&expected),
            shown(&got)
        ));
        return problems;
    }
    for row in rows {
        let is_it = |other: &&EvaluationRow| (other.generation, other.individual) == place(row);
        let Some(evaluation) = evaluations.iter().find(is_it) else { continue };
        let Some(descriptor) = experiment.space().from_values(&evaluation.genes) else { continue };
        let expected = FrontRow {
            chromosome: evaluation.chromosome.clone(),
            genes: evaluation.genes.clone(),
            train: evaluation.counts,
            train_margin: evaluation.margin,
            cost: descriptor.recognition_cost(),
            size: descriptor.size_of_cloud(),
            ..row.clone()
        };
        if expected != *row {
            problems.push(format!("front, point {}: expected {expected:?}, got {row:?}", row.point));
        }
    }
    problems
}
