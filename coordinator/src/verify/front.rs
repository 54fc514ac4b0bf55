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
    let volumes: Vec<Option<f64>> = generations.iter().map(|generation| generation.hypervolume).collect();
    Ok(Found { points: rows.len(), problems: differences(experiment, evaluations, &volumes, &rows) })
}

/// What of these hypervolumes, a generation each, and of these points is not what the evaluations give.
fn differences(
    experiment: &Experiment,
    evaluations: &[EvaluationRow],
    volumes: &[Option<f64>],
    rows: &[FrontRow],
) -> Vec<String> {
    let mut problems = Vec::new();
    let mut front = Front::default();
    // Individuals are known by their places.
    let unnamed = Individual { chromosome: Vec::new(), values: Vec::new(), parents: [None; 2], elite: false };
    let mut recorded = volumes.iter().copied();
    for generation in evaluations.chunk_by(|a, b| a.generation == b.generation) {
        for row in generation {
            let Some(descriptor) = experiment.space().from_values(&row.genes) else {
                return vec!["evaluations: gene values: must lie on the genes' grids".to_owned()];
            };
            let score = experiment.score(&descriptor, &Measured { counts: row.counts, margin: row.margin });
            front.add(row.generation, row.individual, &unnamed, score);
        }
        let EvaluationRow { generation, counts, .. } = &generation[0];
        let expected = experiment.objectives().hypervolume(&front, counts.queries);
        let got = recorded.next().flatten();
        if expected.map(f64::to_bits) != got.map(f64::to_bits) {
            problems.push(format!(
                "generations, generation {generation}: expected hypervolume {expected:?}, got {got:?}"
            ));
        }
    }
    let place = |row: &FrontRow| (row.generation, row.individual);
    let expected: Vec<(u32, u32)> =
        front.points().iter().map(|point| (point.generation, point.index)).collect();
    let got: Vec<(u32, u32)> = rows.iter().map(place).collect();
    if expected != got {
        let [expected, got] = [expected, got].map(|places| shown(&places));
        problems
            .push(format!("front: expected the individuals (generation.individual) {expected}, got {got}"));
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
            objective_correct: evaluation.objective_correct,
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

fn shown(places: &[(u32, u32)]) -> String {
    places.iter().map(|(generation, index)| format!("{generation}.{index}")).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use descriptor::Descriptor;
    use descriptor::disk_ring::Parameters;
    use results::Counts;

    use super::*;
    use crate::experiment::Overrides;

    fn experiment() -> Experiment {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("two.toml");
        let toml = "version = 1\n[dataset]\nroot = \"clouds\"\n[search]\nmethod = \"nsga2\"\n\
            objectives = [\"error\", \"size\"]\n";
        std::fs::write(&file, toml).unwrap();
        Experiment::read(&file, Overrides::default()).unwrap()
    }

    fn descriptor(shape_bins: u32) -> Descriptor {
        Descriptor::DiskRing(Parameters { shape_bins, ..Parameters::PAPER_BEST })
    }

    /// Individuals of so many correct answers and shape bins, two a generation.
    fn evaluations(individuals: &[(u32, u32)]) -> Vec<EvaluationRow> {
        let row = |(index, &(object_correct, shape_bins)): (u32, &(u32, u32))| EvaluationRow {
            generation: 1 + index / 2,
            individual: index % 2,
            chromosome: format!("{index:05b}"),
            genes: descriptor(shape_bins).values(),
            counts: Counts { object_correct, category_correct: 10, queries: 10 },
            objective_correct: None,
            margin: None,
            set_errors: None,
            parent_a: None,
            parent_b: None,
            elite: false,
            computed: None,
        };
        (0..).zip(individuals).map(row).collect()
    }

    fn point(point: u32, of: &EvaluationRow, shape_bins: u32) -> FrontRow {
        FrontRow {
            point,
            generation: of.generation,
            individual: of.individual,
            chromosome: of.chromosome.clone(),
            genes: of.genes.clone(),
            train: of.counts,
            objective_correct: None,
            train_margin: None,
            validation: None,
            validation_margin: None,
            cost: descriptor(shape_bins).recognition_cost(),
            size: descriptor(shape_bins).size_of_cloud(),
            winner: point == 1,
        }
    }

    #[test]
    fn points_that_are_dominated_missing_or_changed_are_told_and_so_are_hypervolumes() {
        let experiment = experiment();
        // The second is dominated by the third, the fourth by the first: of more bins and as many errors.
        let all = evaluations(&[(9, 40), (6, 30), (7, 20), (9, 50)]);
        let rows = [point(1, &all[0], 40), point(2, &all[2], 20)];
        // Shares of the box of 10 errors and 1000 values, by hand: 1 error at the size of 40 bins, and so on.
        let room = |errors: u32, bins: u32| {
            f64::from(10 - errors) * (1000 - descriptor(bins).size_of_cloud()) as f64 / 10_000.0
        };
        let both = |better: (u32, u32), worse: (u32, u32)| {
            let common =
                f64::from(10 - worse.0) * (1000 - descriptor(better.1).size_of_cloud()) as f64 / 10_000.0;
            room(better.0, better.1) + room(worse.0, worse.1) - common
        };
        let close = |volumes: &[Option<f64>]| {
            let told = differences(&experiment, &all, volumes, &rows);
            told.iter().filter(|problem| problem.contains("hypervolume")).cloned().collect::<Vec<_>>()
        };
        let told = close(&[None, None]);
        assert_eq!(told.len(), 2, "{told:?}");
        let volume = |problem: &str| -> f64 {
            let (_, text) = problem.split_once("Some(").unwrap();
            text.split_once(')').unwrap().0.parse().unwrap()
        };
        let volumes = [volume(&told[0]), volume(&told[1])];
        for (got, expected) in volumes.into_iter().zip([both((1, 40), (4, 30)), both((1, 40), (3, 20))]) {
            assert!((got - expected).abs() < 1e-12, "{got} for {expected}");
        }
        let volumes = volumes.map(Some);
        let told = |rows: &[FrontRow]| differences(&experiment, &all, &volumes, rows);
        assert_eq!(told(&rows), Vec::<String>::new());
        assert_eq!(
            told(&rows[..1]),
            ["front: expected the individuals (generation.individual) 1.0 2.0, got 1.0"]
        );
        let dominated = [rows[0].clone(), point(2, &all[1], 30), point(3, &all[2], 20)];
        assert!(told(&dominated)[0].ends_with("got 1.0 1.1 2.0"), "{:?}", told(&dominated));
        for changed in [
            FrontRow { size: 7, ..rows[1].clone() },
            FrontRow { cost: 7, ..rows[1].clone() },
            FrontRow { train: rows[0].train, ..rows[1].clone() },
            FrontRow { genes: rows[0].genes.clone(), ..rows[1].clone() },
            FrontRow { chromosome: "1".to_owned(), ..rows[1].clone() },
        ] {
            let told = told(&[rows[0].clone(), changed]);
            assert!(told.len() == 1 && told[0].starts_with("front, point 2: expected"), "{told:?}");
        }
        assert_eq!(differences(&experiment, &all, &[volumes[0], Some(0.5)], &rows).len(), 1);
    }
}
