//! Questions of results/README.md in polars: cargo run --release --example questions -- RUN
use std::error::Error;
use std::path::{Path, PathBuf};

use polars::prelude::*;
use results::{TableName, read_table};

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

fn main() -> Result<(), Box<dyn Error>> {
    let run = PathBuf::from(std::env::args().nth(1).ok_or("which run folder?")?);
    for question in [best, shares, confusions] {
        println!("{}", question(&run)?);
    }
    Ok(())
}
