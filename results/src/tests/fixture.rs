//! A small finished run that the tests write, read and damage.

use std::path::Path;
use std::time::{Duration, SystemTime};

use polars::prelude::DataFrame;

use crate::record::{Context, Value};
use crate::*;

pub fn genes() -> Vec<GeneColumn> {
    let gene = |name: &str, unit: &str, integer| GeneColumn {
        name: name.to_owned(),
        unit: unit.to_owned(),
        integer,
        meaning: format!("meaning of {name}"),
    };
    vec![gene("shape_bins", "", true), gene("m", "", true), gene("R1", "cm", false), gene("w", "", false)]
}

/// Individual 1 of each generation is remembered, the others are computed.
pub fn individual(generation: u32, individual: u32) -> EvaluationRow {
    let correct = 4 + (generation + 2 * individual) % 5;
    let [parent_a, parent_b] = match (generation, individual) {
        (1, _) => [None, None],
        (_, 0) => [Some(2), None],
        _ => [Some(0), Some(individual)],
    };
    EvaluationRow {
        generation,
        individual,
        chromosome: format!("{:06b}", 11 * generation + 5 * individual),
        genes: vec![Some(f64::from(8 + individual)), None, Some(1.3), Some(f64::from(generation) / 100.0)],
        counts: Counts { object_correct: correct, category_correct: correct + 1, queries: 9 },
        objective_correct: None,
        margin: None,
        set_errors: (individual > 0).then(|| vec![0.25, 0.5]),
        parent_a,
        parent_b,
        elite: generation > 1 && individual == 0,
        computed: (individual != 1).then(|| Computed {
            worker: format!("worker-{individual}"),
            attempt: 1 + individual / 2,
            queued_seconds: 0.25,
            run_seconds: 1.5,
        }),
    }
}

pub fn population(generation: u32) -> Vec<EvaluationRow> {
    (0..3).map(|index| individual(generation, index)).collect()
}

pub fn generation(generation: u32) -> GenerationRow {
    let best = (1..=generation).filter_map(|generation| PopulationSummary::of(&population(generation)));
    GenerationRow {
        generation,
        best_so_far_fitness: best.map(|summary| summary.best_fitness).fold(0.0, f64::max),
        // Generation 1 was not validated.
        validation: (generation > 1).then_some(VALIDATION),
        validation_margin: None,
        hypervolume: None,
        mutation_rate: if generation == 1 { 0.4 } else { 0.4 * 0.97 },
        seconds: 2.5,
    }
}

pub const VALIDATION: Counts = Counts { object_correct: 1, category_correct: 2, queries: 2 };
pub const TEST: Counts = Counts { object_correct: 2, category_correct: 2, queries: 3 };

pub fn predictions(split: PredictionSplit) -> Vec<PredictionRow> {
    let queries = match split {
        PredictionSplit::Validation => vec![("mug_1", "mug_1", "mug"), ("can_1", "can_2", "can")],
        PredictionSplit::Test => {
            vec![("mug_1", "mug_1", "mug"), ("can_1", "mug_2", "mug"), ("can_2", "can_2", "can")]
        }
    };
    let row = |(query, (instance, predicted, category)): (usize, (&str, &str, &str))| PredictionRow {
        query: query as u32,
        cloud: format!("{instance}/{}_{query}.pcd", split.as_str()),
        instance: instance.to_owned(),
        category: instance.split('_').next().unwrap().to_owned(),
        nearest_cloud: format!("{predicted}/train_{query}.pcd"),
        predicted_instance: predicted.to_owned(),
        predicted_category: category.to_owned(),
        distance: 0.1 + query as f64,
        runner_up: (query != 1)
            .then(|| RunnerUp { cloud: "box_1/train_0.pcd".to_owned(), distance: 0.3 + query as f64 }),
    };
    queries.into_iter().enumerate().map(row).collect()
}

pub fn skipped() -> Vec<SkippedRow> {
    vec![SkippedRow {
        split: "test".to_owned(),
        cloud: "can_1/test_9.pcd".to_owned(),
        reason: "7 usable points, needs 10".to_owned(),
    }]
}

/// One that was lost, one that stayed, and what became of the first one's job.
pub fn log() -> RunLog {
    let at =
        |milliseconds: u64| SystemTime::UNIX_EPOCH + Duration::from_millis(1_700_000_000_000 + milliseconds);
    let worker = |name: &str, departure: Option<&str>| WorkerRow {
        worker: name.to_owned(),
        id: "0a".repeat(16),
        threads: 2,
        build: "release".to_owned(),
        credential: departure.map(|_| "token".to_owned()),
        principal: departure.map(|_| "token 192.0.2.7".to_owned()),
        joined_at: at(200),
        gone_at: departure.map(|_| at(3_000)),
        departure: departure.map(str::to_owned),
        leases: departure.map(|_| 1),
        answers: departure.map(|_| 3),
    };
    let attempt = |attempt, worker: &str, end: &str, reason: Option<&str>| AttemptRow {
        job: u64::MAX,
        attempt,
        worker: worker.to_owned(),
        task: "evaluation of a descriptor".to_owned(),
        handed_out_at: at(300),
        ended_at: at(3_000),
        end: end.to_owned(),
        reason: reason.map(str::to_owned),
        run_seconds: reason.is_none().then_some(0.25),
    };
    RunLog {
        workers: vec![worker("first", Some("lost")), worker("second", None)],
        attempts: vec![
            attempt(1, "first", "lost", Some("no sign of life within the lease")),
            attempt(2, "second", "answered", None),
        ],
        events: vec![EventRow {
            at: at(3_000),
            event: "lost".to_owned(),
            worker: Some("first".to_owned()),
            generation: None,
            message: "no sign of life within the lease".to_owned(),
        }],
    }
}

/// That of the run itself.
pub fn look() -> LookRow {
    LookRow {
        at: SystemTime::UNIX_EPOCH + Duration::from_millis(1_700_000_004_000),
        command: "run".to_owned(),
        reason: "final test".to_owned(),
        descriptors: "evolved".to_owned(),
    }
}

/// Generation 2, whose individuals have 6, 8 and 5 of 9 right: individual 1 wins.
pub fn run() -> RunRow {
    let winner = individual(2, 1);
    let at = |milliseconds| SystemTime::UNIX_EPOCH + Duration::from_millis(milliseconds);
    RunRow {
        name: "sample".to_owned(),
        search_config: "seed = 18446744073709551615\n".to_owned(),
        resolved_toml: "version = 1\nseed = 18446744073709551615\n".to_owned(),
        seed: u64::MAX,
        data_digest: "5f".repeat(32),
        evaluation_version: 1,
        program_version: "0.1.0".to_owned(),
        build: "release".to_owned(),
        host: "somewhere".to_owned(),
        started_at: at(1_700_000_000_123),
        finished_at: at(1_700_000_005_456),
        seconds: 5.333,
        stop_reason: "validation_rises".to_owned(),
        generations: 2,
        evaluations_computed: 4,
        evaluations_remembered: 2,
        winner_generation: 2,
        winner_individual: 1,
        best_chromosome: winner.chromosome,
        best_genes: winner.genes,
        train: winner.counts,
        train_margin: None,
        train_effective: None,
        validation: Some(VALIDATION),
        validation_effective: None,
        weighted_winner: None,
        weighted_train: None,
        test: Some(TEST),
        grid_best_object_correct: Some(9),
    }
}

/// The table with these rows, as far as they determine it.
pub fn frame<R: Value>(table: TableName, rows: &[R], context: Context) -> DataFrame {
    Table::new(table, &genes()).unwrap().filled(rows, context).unwrap().frame
}

/// What a generation's row is computed from beside itself.
pub fn context(individuals: &[EvaluationRow]) -> Context<'static> {
    Context { population: PopulationSummary::of(individuals).unwrap(), ..Context::default() }
}

/// What rows below these labels are computed from.
pub fn labelled<'a>(labels: &'a [&'a str]) -> Context<'a> {
    Context { labels, ..Context::default() }
}

/// Writes the run; the folder is unlocked on return.
pub fn write(folder: &Path) -> String {
    let mut out = RunFolder::create(folder, &genes()).unwrap();
    for number in 1..=2 {
        out.write_generation(&population(number), &generation(number)).unwrap();
    }
    for split in PredictionSplit::ALL {
        out.write_predictions(split, &predictions(split)).unwrap();
    }
    out.record_look(&look()).unwrap();
    out.write_skipped(&skipped()).unwrap();
    out.write_log(&log()).unwrap();
    out.write_run(&run()).unwrap().to_string()
}
