//! Row `exhaust`: the whole grid of the paper's search space, on all cores.

use std::fs;

use tempfile::TempDir;

use crate::Bench;
use crate::programs::{Running, program};
use tests::benches::machine::cores;
use tests::benches::table::{Row, megabytes};

/// Measures the row once.
pub fn measure(bench: &mut Bench) {
    let folder = TempDir::new().unwrap();
    let experiment = folder.path().join("household.toml");
    fs::write(&experiment, bench.household.experiment(|_| {})).unwrap();
    let mut command = program("coordinator");
    command.arg("exhaust").arg(&experiment).args(["--listen", "127.0.0.1:0", "--json"]);
    command.arg("--out").arg(folder.path().join("grid")).arg("--cache").arg(folder.path().join("cache"));
    let grid = Running::start(command).finish();
    bench.table.add(Row {
        name: "exhaust",
        what: format!("every descriptor of `household.toml`, from an empty cache, {} threads", cores()),
        own: [grid.seconds].into_iter().collect(),
        peer: None,
        notes: vec![format!("peak resident memory {}", megabytes(grid.peak)), grid.stdout.trim().to_owned()],
    });
}
