//! Columns of a run folder's tables.

use crate::columns::ColumnKind::{Bool, F64, Text, Timestamp, U32, U64};
use crate::columns::{Column, GeneColumn};
use crate::tables::counts;

pub(super) fn evaluations(genes: &[GeneColumn]) -> Vec<Column> {
    let mut columns = vec![
        Column::new("generation", U32, "", "generation, from 1").in_digest(),
        Column::new("individual", U32, "", "index in the generation, from 0").in_digest(),
        Column::new("chromosome", Text, "bits", "the bit string, genes in table order").in_digest(),
    ];
    columns.extend(genes.iter().map(|gene| gene.column("").in_digest()));
    columns.push(Column::new("fitness", F64, "share", "object_correct / queries"));
    let [object_correct, category_correct, queries, object_error, category_error] =
        counts("", "first training set's clouds");
    columns.extend([
        object_correct.in_digest(),
        category_correct.in_digest(),
        queries,
        object_error,
        category_error,
        Column::new(
            "parent_a",
            U32,
            "",
            "first parent's index in the previous generation; null in generation 1",
        )
        .nullable()
        .in_digest(),
        Column::new("parent_b", U32, "", "second parent's index; null in generation 1 and for an elite")
            .nullable()
            .in_digest(),
        Column::new("elite", Bool, "", "copied unmutated from the previous generation"),
        Column::new("remembered", Bool, "", "taken from an earlier evaluation instead of computed"),
        Column::new("worker", Text, "", "name of the worker, or `N workers` of pieces; null if remembered")
            .nullable(),
        Column::new(
            "attempt",
            U32,
            "",
            "attempt that gave the result, from 1, the last of pieces; null as that",
        )
        .nullable(),
        Column::new("queued_seconds", F64, "s", "wait for a worker, of the first of pieces; null as that")
            .nullable(),
        Column::new("run_seconds", F64, "s", "time on the worker, the sum of pieces; null as that")
            .nullable(),
    ]);
    columns
}

pub(super) fn generations() -> Vec<Column> {
    let mut columns = vec![
        Column::new("generation", U32, "", "generation, from 1").in_digest(),
        Column::new("best_individual", U32, "", "index of the best, the lowest on ties"),
        Column::new("best_object_correct", U32, "clouds", "its object_correct"),
        Column::new("queries", U32, "clouds", "first training set's clouds that took part"),
        Column::new("best_fitness", F64, "share", "highest fitness of the generation"),
        Column::new("mean_fitness", F64, "share", "mean fitness of the generation"),
        Column::new("worst_fitness", F64, "share", "lowest fitness of the generation"),
        Column::new(
            "best_so_far_fitness",
            F64,
            "share",
            "highest fitness of this and all earlier generations",
        ),
    ];
    let [object_correct, category_correct, queries, object_error, category_error] =
        counts("validation_", "validation clouds");
    columns.extend([
        object_correct.nullable().in_digest(),
        category_correct.nullable().in_digest(),
        queries.nullable().in_digest(),
        object_error.nullable(),
        category_error.nullable(),
        Column::new(
            "mutation_rate",
            F64,
            "",
            "probability of a flip per bit between the two mutation points, for this generation's children",
        )
        .in_digest(),
        Column::new("diversity", F64, "share", "mean pairwise Hamming distance of chromosomes, per bit"),
        Column::new("evaluations_computed", U32, "", "individuals evaluated by a worker"),
        Column::new("evaluations_remembered", U32, "", "individuals whose result was known already"),
        Column::new("seconds", F64, "s", "wall time of the generation"),
        Column::new("rows_digest", Text, "", "BLAKE3 of the generation's cells that the run digest covers"),
    ]);
    columns
}

pub(super) fn predictions() -> Vec<Column> {
    [
        Column::new("split", Text, "", "validation or test"),
        Column::new("query", U32, "", "index of the query in its split, from 0"),
        Column::new("cloud", Text, "", "the query's path below the data root"),
        Column::new("instance", Text, "", "the query's object"),
        Column::new("category", Text, "", "the query's category"),
        Column::new("nearest_cloud", Text, "", "path of the database cloud with the smallest set distance"),
        Column::new("predicted_instance", Text, "", "object of the nearest cloud"),
        Column::new("predicted_category", Text, "", "category of the nearest cloud"),
        Column::new("distance", F64, "", "set distance to the nearest cloud"),
        Column::new("runner_up_cloud", Text, "", "nearest cloud of another object than the predicted one")
            .nullable(),
        Column::new("runner_up_distance", F64, "", "set distance to it").nullable(),
        Column::new("correct_object", Bool, "", "predicted_instance is instance"),
        Column::new("correct_category", Bool, "", "predicted_category is category"),
    ]
    .into_iter()
    .map(Column::in_digest)
    .collect()
}

pub(super) fn skipped() -> Vec<Column> {
    vec![
        Column::new("split", Text, "", "split that lists the cloud"),
        Column::new("cloud", Text, "", "path below the data root"),
        Column::new("reason", Text, "", "why it took no part"),
    ]
}

pub(super) fn workers() -> Vec<Column> {
    vec![
        Column::new("worker", Text, "", "unique name of the worker"),
        Column::new("id", Text, "", "random id that it made when it started, hexadecimal"),
        Column::new("threads", U32, "", "threads that evaluate"),
        Column::new("build", Text, "", "build of the worker"),
        Column::new(
            "credential",
            Text,
            "",
            "token, or certificate and fingerprint; null where nothing is asked for",
        )
        .nullable(),
        Column::new("joined_at", Timestamp, "UTC", "when it registered"),
        Column::new("gone_at", Timestamp, "UTC", "when it went; null if it was there to the end").nullable(),
        Column::new(
            "departure",
            Text,
            "",
            "left, lost, quarantined, denied or ended (with the coordinator's process); null as that",
        )
        .nullable(),
        Column::new("leases", U32, "", "jobs it had in hand when it went; null as that").nullable(),
        Column::new("answers", U64, "", "valid answers it had given when it went; null as that").nullable(),
    ]
}

pub(super) fn attempts() -> Vec<Column> {
    let ends = "answered (first), agreed or disagreed (with an earlier answer), late (after it was given up), failed, \
                overdue, undelivered, revoked, left, lost, quarantined, denied or dropped (the run ended)";
    vec![
        Column::new("job", U64, "", "number of the job"),
        Column::new("attempt", U32, "", "attempt at it, from 1"),
        Column::new("worker", Text, "", "name of the worker"),
        Column::new("task", Text, "", "what was asked"),
        Column::new("handed_out_at", Timestamp, "UTC", "when the worker got it"),
        Column::new("ended_at", Timestamp, "UTC", "when it ended"),
        Column::new("end", Text, "", ends),
        Column::new("reason", Text, "", "what more there is to say of the end").nullable(),
        Column::new("run_seconds", F64, "s", "time on the worker, if it reported").nullable(),
    ]
}

pub(super) fn events() -> Vec<Column> {
    let kinds = "lost, quarantined, denied, disagreement, undecided, rewind, unaudited, starving or omitted (rows that had no room)";
    vec![
        Column::new("at", Timestamp, "UTC", "when"),
        Column::new("event", Text, "", kinds),
        Column::new("worker", Text, "", "whom it is about").nullable(),
        Column::new("generation", U32, "", "generation that the run went back to").nullable(),
        Column::new("message", Text, "", "what happened, for people"),
    ]
}

pub(super) fn run(genes: &[GeneColumn]) -> Vec<Column> {
    let mut columns = vec![
        Column::new("name", Text, "", "name of the experiment"),
        Column::new("search_config", Text, "TOML", "what determines the result, in canonical form")
            .in_digest(),
        Column::new("resolved_toml", Text, "TOML", "the whole resolved experiment"),
        Column::new("seed", U64, "", "seed of every random stream").in_digest(),
        Column::new("data_digest", Text, "", "BLAKE3 over splits, labels and content of the clouds")
            .in_digest(),
        Column::new(
            "evaluation_version",
            U32,
            "",
            "version of the method: equal versions give equal results",
        ),
        Column::new("program_version", Text, "", "version of the coordinator"),
        Column::new("build", Text, "", "build of the coordinator"),
        Column::new("host", Text, "", "machine of the coordinator"),
        Column::new("started_at", Timestamp, "UTC", "start of the run"),
        Column::new("finished_at", Timestamp, "UTC", "end of the run"),
        Column::new("seconds", F64, "s", "wall time at work, over all starts of the run"),
        Column::new("stop_reason", Text, "", "why evolution stopped").in_digest(),
        Column::new("generations", U32, "", "number of generations"),
        Column::new("evaluations_computed", U64, "", "individuals evaluated by a worker"),
        Column::new("evaluations_remembered", U64, "", "individuals whose result was known already"),
        Column::new("winner_generation", U32, "", "generation of the winner"),
        Column::new("winner_individual", U32, "", "its index in that generation"),
        Column::new("best_chromosome", Text, "bits", "its bit string"),
    ];
    columns.extend(genes.iter().map(|gene| gene.column("best_")));
    columns.extend(counts("train_", "first training set's clouds"));
    columns.extend(counts("validation_", "validation clouds").map(Column::nullable));
    columns.extend(counts("test_", "test clouds").map(Column::nullable));
    columns.extend([
        Column::new("predictions_digest", Text, "", "BLAKE3 of the predictions"),
        Column::new("run_digest", Text, "", "BLAKE3 of everything that the columns marked `digest` say"),
        Column::new(
            "grid_best_object_correct",
            U32,
            "clouds",
            "object_correct of the best descriptor of the whole search space; null if it was not known at the end of \
             the run",
        )
        .nullable(),
        Column::new(
            "regret",
            F64,
            "share",
            "(grid_best_object_correct - train_object_correct) / train_queries; null as that",
        )
        .nullable(),
    ]);
    columns
}
