//! Questions of results/README.md in polars: cargo run --release --example questions -- RUN (or SWEEP)
use std::collections::BTreeSet;
use std::error::Error;
use std::path::{Path, PathBuf};

use polars::prelude::*;
use results::{Table, TableName, read_run, read_table};

fn best(run: &Path) -> Result<DataFrame, Box<dyn Error>> {
    let genes = ["shape_bins", "m", "R1", "R2", "w"];
    let descriptors = read_table(run, TableName::Evaluations)?
        .lazy()
        .group_by(genes.map(col))
        .agg([col("object_error").min().alias("error"), len().alias("individuals")])
        .sort(["error"].iter().chain(&genes).copied().collect::<Vec<_>>(), Default::default());
    Ok(descriptors.limit(10).collect()?)
}

fn shares(run: &Path) -> Result<DataFrame, Box<dyn Error>> {
    let workers = read_table(run, TableName::Evaluations)?
        .lazy()
        .filter(col("remembered").not())
        .group_by([col("worker")])
        .agg([len().alias("evaluations"), col("run_seconds").sum().alias("seconds")])
        .with_column((col("seconds") / col("seconds").sum()).alias("share"))
        .sort(["worker"], Default::default());
    Ok(workers.collect()?)
}

fn confusions(run: &Path) -> Result<DataFrame, Box<dyn Error>> {
    let order = SortMultipleOptions::default().with_order_descending_multi([true, false, false]);
    let pairs = read_table(run, TableName::Predictions)?
        .lazy()
        .filter(col("split").eq(lit("test")).and(col("correct_object").not()))
        .group_by(["instance", "predicted_instance"])
        .agg([len().alias("clouds"), (col("runner_up_distance") - col("distance")).mean().alias("margin")])
        .sort(["clouds", "instance", "predicted_instance"], order);
    Ok(pairs.collect()?)
}

fn progress(run: &Path) -> Result<DataFrame, Box<dyn Error>> {
    let generations =
        read_table(run, TableName::Generations)?.lazy().sort(["generation"], Default::default());
    let answer = generations.select([
        col("generation"),
        (lit(1.0) - col("best_fitness")).alias("best"),
        (lit(1.0) - col("mean_fitness")).alias("mean"),
        col("validation_object_error").alias("validation"),
        col("diversity"),
    ]);
    Ok(answer.collect()?)
}

fn lineage(run: &Path) -> Result<DataFrame, Box<dyn Error>> {
    let (evaluations, winner) = (read_table(run, TableName::Evaluations)?, read_run(run)?.row);
    let (mut generation, mut kin) = (winner.winner_generation, BTreeSet::from([winner.winner_individual]));
    let mut lineage = Vec::new();
    while let Some(is_kin) = kin.iter().map(|&one| col("individual").eq(lit(one))).reduce(Expr::or) {
        let of_generation = evaluations.clone().lazy().filter(col("generation").eq(lit(generation)));
        let step = of_generation.filter(is_kin).collect()?;
        kin.clear();
        for parent in ["parent_a", "parent_b"] {
            kin.extend(step.column(parent)?.u32()?.iter().flatten());
        }
        lineage.push(step.lazy());
        generation -= 1;
    }
    let genes = ["shape_bins", "m", "R1", "R2", "w"].map(col);
    let columns =
        [[col("generation"), col("individual")].as_slice(), &genes, &[col("object_error")]].concat();
    Ok(concat(lineage, UnionArgs::default())?.select(columns).collect()?)
}

fn waits(run: &Path) -> Result<DataFrame, Box<dyn Error>> {
    let wait = || col("queued_seconds");
    let generations = read_table(run, TableName::Evaluations)?
        .lazy()
        .filter(col("remembered").not())
        .group_by([col("generation")])
        .agg([
            len().alias("jobs"),
            wait().median().alias("median"),
            wait().quantile(lit(0.9), QuantileMethod::Linear).alias("long"),
            wait().max().alias("longest"),
        ])
        .sort(["generation"], Default::default());
    Ok(generations.collect()?)
}

fn meanings(_: &Path) -> Result<DataFrame, Box<dyn Error>> {
    let columns = Table::new(TableName::Generations, &[])?.columns;
    let texts = |of: fn(&results::Column) -> &str| columns.iter().map(of).collect::<Vec<_>>();
    Ok(df!(
        "column" => texts(|column| &column.name),
        "unit" => texts(|column| &column.unit),
        "meaning" => texts(|column| &column.meaning),
    )?)
}

/// A table of all runs of a sweep.
fn of_all(sweep: &Path, table: TableName) -> Result<LazyFrame, Box<dyn Error>> {
    let mut runs = Vec::new();
    for folder in std::fs::read_dir(sweep)? {
        let folder = folder?.path();
        if folder.join("run").is_dir() {
            let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
            runs.push(read_table(&folder, table)?.lazy().with_column(lit(name).alias("run_folder")));
        }
    }
    Ok(concat(runs, UnionArgs::default())?)
}

fn seeds(sweep: &Path) -> Result<DataFrame, Box<dyn Error>> {
    let error = || col("test_object_error");
    let variants = of_all(sweep, TableName::Run)?
        .group_by([col("run_folder").str().replace(lit("seed-.*"), lit(""), false).alias("variant")])
        .agg([
            len().alias("runs"),
            error().min().alias("lowest"),
            error().median().alias("median"),
            error().max().alias("highest"),
            error().std(1).alias("deviation"),
        ])
        .sort(["variant"], Default::default());
    Ok(variants.collect()?)
}

fn differences(sweep: &Path) -> Result<DataFrame, Box<dyn Error>> {
    let predictions = of_all(sweep, TableName::Predictions)?.filter(col("split").eq(lit("test")));
    let test = predictions.select([col("run_folder"), col("cloud"), col("correct_object")]);
    let both = JoinArgs::new(JoinType::Inner).with_suffix(Some("_b".into()));
    let (one, other) = (|| col("correct_object"), || col("correct_object_b"));
    let pairs = test
        .clone()
        .join(test, [col("cloud")], [col("cloud")], both)
        .filter(col("run_folder").lt(col("run_folder_b")))
        .group_by([col("run_folder").alias("one"), col("run_folder_b").alias("other")])
        .agg([
            one().and(other().not()).sum().alias("only_one"),
            other().and(one().not()).sum().alias("only_other"),
        ])
        .sort(["one", "other"], Default::default());
    Ok(pairs.collect()?)
}

fn genes_and_objects(sweep: &Path) -> Result<DataFrame, Box<dyn Error>> {
    let wrong = || lit(1.0) - col("correct_object").cast(DataType::Float64);
    let of_gene = |gene: &str| pearson_corr(col(format!("best_{gene}")), wrong()).alias(gene);
    let genes = ["shape_bins", "m", "R1", "R2", "w"].map(of_gene);
    let by_run = [col("run_folder")];
    let objects = of_all(sweep, TableName::Predictions)?
        .join(of_all(sweep, TableName::Run)?, by_run.clone(), by_run, JoinArgs::new(JoinType::Inner))
        .group_by([col("instance")])
        .agg([[wrong().mean().alias("error")].as_slice(), &genes].concat())
        .sort(
            ["error", "instance"],
            SortMultipleOptions::default().with_order_descending_multi([true, false]),
        );
    Ok(objects.collect()?)
}

fn main() -> Result<(), Box<dyn Error>> {
    type Question = fn(&Path) -> Result<DataFrame, Box<dyn Error>>;
    let folder = PathBuf::from(std::env::args().nth(1).ok_or("which folder?")?);
    let of_run: [Question; 7] = [best, progress, lineage, waits, shares, confusions, meanings];
    let of_sweep: [Question; 3] = [seeds, differences, genes_and_objects];
    let questions = if folder.join("run").is_dir() { of_run.as_slice() } else { &of_sweep };
    for question in questions {
        println!("{}", question(&folder)?);
    }
    Ok(())
}
