//! The declared tables against their cells and against SCHEMA.md.

use expect_test::{expect, expect_file};

use super::comparison;
use super::fixture::{self, frame};
use crate::record::Context;
use crate::*;

#[test]
fn the_schema_document_is_that_of_the_column_table() {
    expect_file!["../../SCHEMA.md"].assert_eq(&schema_markdown().unwrap());
}

/// Each row struct gives exactly the table's columns, in its order, of its kinds, with nulls only where allowed.
#[test]
fn row_structs_and_column_table_do_not_drift_apart() {
    let genes = fixture::genes();
    let population = fixture::population(2);
    let plain = Context::default();
    let paper = fixture::labelled(&["paper"]);
    let split = PredictionSplit::Test;
    let predictions = fixture::predictions(split);
    let log = fixture::log();
    let [curve, _] = comparison::curves();
    let curve_context = Context { relevant: curve.relevant, ..fixture::labelled(&["paper", "all"]) };
    let generation = [fixture::generation(2)];
    let frames = [
        (TableName::Evaluations, frame(TableName::Evaluations, &population, plain)),
        (TableName::Generations, frame(TableName::Generations, &generation, fixture::context(&population))),
        (
            TableName::Predictions,
            frame(TableName::Predictions, &predictions, fixture::labelled(&[split.as_str()])),
        ),
        (TableName::Skipped, frame(TableName::Skipped, &fixture::skipped(), plain)),
        (TableName::Workers, frame(TableName::Workers, &log.workers, plain)),
        (TableName::Attempts, frame(TableName::Attempts, &log.attempts, plain)),
        (TableName::Events, frame(TableName::Events, &log.events, plain)),
        (TableName::Looks, frame(TableName::Looks, &[fixture::look()], plain)),
        (TableName::Run, frame(TableName::Run, &[fixture::run()], plain)),
        (TableName::Distances, frame(TableName::Distances, &comparison::DISTANCES, paper)),
        (TableName::Answers, frame(TableName::Answers, &predictions, paper)),
        (TableName::RecallPrecision, frame(TableName::RecallPrecision, &curve.points, curve_context)),
        (TableName::Pairs, frame(TableName::Pairs, &comparison::pairs(), plain)),
        (TableName::Comparison, frame(TableName::Comparison, &comparison::rows(), plain)),
        (TableName::Perturbed, frame(TableName::Perturbed, &comparison::perturbed(), plain)),
    ];
    let all = TableName::RUN.into_iter().chain(TableName::COMPARISON).chain(TableName::PERTURBED);
    let all: Vec<TableName> = all.collect();
    assert_eq!(frames.each_ref().map(|(name, _)| *name)[..], all);
    for (name, frame) in frames {
        let (table, frame) = (Table::new(name, &genes).unwrap(), frame);
        let expected: Vec<_> =
            table.columns.iter().map(|column| (column.name.clone(), column.kind.data_type())).collect();
        let got: Vec<_> =
            frame.columns().iter().map(|cell| (cell.name().to_string(), cell.dtype().clone())).collect();
        assert_eq!(expected, got, "{name}");
        for column in table.columns.iter().filter(|column| !column.nullable) {
            assert_eq!(frame.column(&column.name).unwrap().null_count(), 0, "{name}.{}", column.name);
        }
        assert!(
            table.key.iter().all(|key| table.column(key).is_some_and(|column| !column.nullable)),
            "{name}"
        );
    }
}

/// DESIGN 4 lists what the run digest covers; this is that list.
#[test]
fn the_digest_covers_the_listed_columns_and_no_other() {
    let genes = fixture::genes();
    let mut covered = String::new();
    for name in TableName::RUN
        .into_iter()
        .chain(TableName::FRONT)
        .chain(TableName::SETS)
        .chain(TableName::COMPARISON)
        .chain(TableName::PERTURBED)
        .chain(TableName::GRID)
        .chain(TableName::ARTEFACT)
    {
        let table = Table::new(name, &genes).unwrap();
        let names: Vec<_> = table
            .columns
            .iter()
            .filter(|column| column.in_digest)
            .map(|column| column.name.as_str())
            .collect();
        covered += &format!("{name}: {}\n", names.join(" "));
    }
    expect![[r#"
        evaluations: generation individual chromosome shape_bins m R1 w object_correct category_correct objective_correct margin parent_a parent_b
        generations: generation validation_object_correct validation_category_correct validation_queries validation_margin hypervolume mutation_rate
        predictions: split query cloud instance category nearest_cloud predicted_instance predicted_category distance runner_up_cloud runner_up_distance correct_object correct_category
        skipped: 
        workers: 
        attempts: 
        events: 
        looks: 
        run: search_config seed data_digest stop_reason weighted_winner weighted_train_object_correct weighted_train_category_correct weighted_train_queries
        front: point generation individual chromosome shape_bins m R1 w train_object_correct train_category_correct train_queries objective_correct train_margin validation_object_correct validation_category_correct validation_queries validation_margin cost size winner
        sets: 
        distances: 
        answers: 
        recall_precision: 
        pairs: 
        comparison: 
        perturbed: 
        cells: 
        best: 
        marginals: 
        landscapes: 
        counts: 
        grid: 
        database: 
        channels: 
    "#]]
    .assert_eq(&covered);
}

#[test]
fn a_gene_that_cannot_be_a_column_is_refused() {
    let mut genes = fixture::genes();
    let mut refused = String::new();
    for name in ["fitness", "chromosome", "R1", ""] {
        genes[0].name = name.to_owned();
        let folder = tempfile::tempdir().unwrap();
        refused += &format!("{}\n\n", RunFolder::create(folder.path(), &genes).unwrap_err());
    }
    expect![[r#"
        gene: name must not be empty, occur twice or be that of another column, got "fitness"
        rename the gene

        gene: name must not be empty, occur twice or be that of another column, got "chromosome"
        rename the gene

        gene: name must not be empty, occur twice or be that of another column, got "R1"
        rename the gene

        gene: name must not be empty, occur twice or be that of another column, got ""
        rename the gene

    "#]]
    .assert_eq(&refused);
}
