//! `cargo bench`: what Descry costs beside the same work done with PCL, measured side by side in one run.
//!
//! - `programs`: the programs of this workspace, with their wall time and memory
//! - `peer`: the PCL harness
//! - `sampler`, `watch`: what is seen of a process while it runs
//! - `cold`, `fixed`, `warm`, `runs`, `recognise`, `exhaust`: rows of the table
//! - `scaling`: how cost grows with clouds, points, generations and workers
//! - `load`: how many workers one coordinator keeps busy, and for how long
//! - `pruning`: matching with a database of 20 000 clouds, in full and with pruning
//! - `soak`: run after run while programs are killed and stopped, for ten minutes

#![expect(
    clippy::unwrap_used,
    reason = "a benchmark that cannot go on has failed; there is nobody to recover for"
)]

mod cold;
mod exhaust;
mod fixed;
mod load;
mod peer;
mod programs;
mod pruning;
mod recognise;
mod runs;
mod sampler;
mod scaling;
mod soak;
mod warm;
mod watch;

use std::path::PathBuf;

use clap::Parser;

use peer::Peer;
use tests::benches::household::Household;
use tests::benches::machine::machine;
use tests::benches::table::Table;

/// Rows of the table, in its order.
const ROWS: [&str; 11] = [
    "cold",
    "shotcolor",
    "pfhrgb",
    "warm",
    "weight",
    "run",
    "worker",
    "memory",
    "second",
    "recognise",
    "named",
];

/// Speed of Descry beside PCL's.
///
/// Example: cargo bench -- warm weight
#[derive(Debug, Parser)]
struct Options {
    /// Rows to measure, for example warm; all by default
    #[arg(value_name = "ROW", value_parser = ROWS)]
    rows: Vec<String>,
    /// The clouds of another set than household-rgbd, for rows that need no experiment: tabletop-rgbd
    #[arg(long, value_name = "SET", default_value = "household-rgbd")]
    set: String,
    /// One repetition instead of several of what takes long
    #[arg(long)]
    quick: bool,
    /// Measure only how cost grows with clouds, points, generations and workers, on synthetic clouds
    #[arg(long, conflicts_with_all = ["rows", "exhaust"])]
    scaling: bool,
    /// With 100 000 clouds, too: some ten minutes and 14 GB of disk more
    #[arg(long, requires = "scaling")]
    large: bool,
    /// Where to draw the curves, for example docs/src/images
    #[arg(long, value_name = "DIR", requires = "scaling")]
    curves: Option<PathBuf>,
    /// Measure only the exhaustive search of the whole grid, which takes minutes
    #[arg(long, conflicts_with = "rows")]
    exhaust: bool,
    /// Measure only how many workers one coordinator keeps busy, with workers that only wait: all rows, or those with so
    /// many workers
    #[arg(long, value_name = "WORKERS", num_args = 0.., conflicts_with_all = ["rows", "exhaust", "scaling"])]
    load: Option<Vec<u32>>,
    /// Measure nothing: run after run for so many seconds, 600 by default, while coordinator and workers are killed and
    /// stopped at random, and every run digest is compared
    #[arg(long, value_name = "SECONDS", num_args = 0..=1, default_missing_value = "600")]
    #[arg(conflicts_with_all = ["rows", "exhaust", "scaling", "load", "pieces"])]
    soak: Option<u64>,
    /// Other faults of the soak at other times
    #[arg(long, value_name = "N", default_value_t = 1, requires = "soak")]
    seed: u64,
    /// Measure only what cutting evaluations into pieces gives, with workers that only wait
    #[arg(long, conflicts_with_all = ["rows", "exhaust", "scaling", "load"])]
    pieces: bool,
    /// Measure only whether a coordinator with 1000 workers that only wait goes on for so many seconds, 3600 by default, as
    /// it began
    #[arg(long, value_name = "SECONDS", num_args = 0..=1, default_missing_value = "3600")]
    #[arg(conflicts_with_all = ["rows", "exhaust", "scaling", "load", "soak", "pieces"])]
    endurance: Option<u64>,
    /// Measure only matching with a database of 20 000 clouds, in full and with pruning
    #[arg(long, conflicts_with_all = ["rows", "exhaust", "scaling", "load", "soak", "pieces", "endurance"])]
    pruning: bool,
    /// Given by cargo
    #[arg(long, hide = true)]
    bench: bool,
}

/// What every row needs.
struct Bench {
    /// Rows that are wanted.
    rows: Vec<String>,
    /// Repetitions of what takes long.
    repetitions: usize,
    household: Household,
    peer: Peer,
    table: Table,
}

impl Bench {
    fn wants(&self, rows: &[&str]) -> bool {
        rows.iter().any(|row| self.rows.iter().any(|wanted| wanted == row))
    }
}

fn main() {
    let options = Options::parse();
    let repetitions = if options.quick { 1 } else { 3 };
    println!("{}", machine());
    if options.scaling {
        scaling::measure(repetitions, options.large, options.curves.as_deref());
        return;
    }
    if options.pieces {
        load::measure_pieces();
        return;
    }
    if let Some(workers) = options.load {
        load::measure(&workers, repetitions);
        return;
    }
    if let Some(seconds) = options.endurance {
        load::measure_endurance(seconds);
        return;
    }
    if let Some(seconds) = options.soak {
        soak::soak(seconds, options.seed);
        return;
    }
    let rows = if options.rows.is_empty() { ROWS.map(str::to_owned).to_vec() } else { options.rows };
    let household = Household::find(&options.set);
    if options.pruning {
        pruning::measure(&household);
        return;
    }
    let peer = Peer::find(&household);
    let mut bench = Bench { rows, repetitions, household, peer, table: Table::default() };
    if options.exhaust {
        exhaust::measure(&mut bench);
    } else {
        cold::measure(&mut bench);
        fixed::measure(&mut bench);
        warm::measure(&mut bench);
        runs::measure(&mut bench);
        recognise::measure(&mut bench);
    }
    println!("\n{}", bench.table);
}
