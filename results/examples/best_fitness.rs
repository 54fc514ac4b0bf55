//! The best fitness of a run: cargo run --release -p results --example best_fitness -- RUN
use polars::prelude::*;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let run = std::env::args().nth(1).ok_or("which run folder?")?;
    let generations = results::read_table(run, results::TableName::Generations)?;
    let fitness = generations.lazy().select([col("best_fitness").max()]).collect()?;
    println!("{:?}", fitness.column("best_fitness")?.f64()?.max());
    Ok(())
}
