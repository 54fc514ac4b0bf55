//! `cargo bench --bench instructions`: how many instructions each stage takes, as valgrind counts them.
//!
//! Unlike times, these are the same however busy the machine is, so that two versions can be compared by a program:
//! `.ci/instructions` does. They say nothing of memory, and valgrind knows no AVX-512: vectors are those of AVX2.

#![expect(
    clippy::unwrap_used,
    reason = "a benchmark that cannot go on has failed; there is nobody to recover for"
)]

mod stages;

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;
use std::process::{Command, ExitCode, Stdio};

use clap::Parser;

use stages::STAGES;

/// How much more instructions a stage may take than before, per cent: other compilers and libraries change some.
const MARGIN: f64 = 3.0;

/// Counts the instructions of each stage.
///
/// Example: cargo bench --bench instructions -- --write before.toml
#[derive(Debug, Parser)]
struct Options {
    /// File to write the counts to, for example before.toml
    #[arg(long, value_name = "FILE")]
    write: Option<PathBuf>,
    /// Counts of another version, for example before.toml: ends with an error if a stage takes 3 % more now
    #[arg(long, value_name = "FILE")]
    against: Option<PathBuf>,
    /// Under valgrind: the stage to carry out, and how often
    #[arg(long, hide = true, num_args = 2)]
    carry_out: Vec<String>,
    /// Given by cargo
    #[arg(long, hide = true)]
    bench: bool,
}

type Counts = BTreeMap<String, u64>;

fn main() -> ExitCode {
    let options = Options::parse();
    if let [name, times] = &options.carry_out[..] {
        let (_, stage) = STAGES.iter().find(|(stage, _)| stage == name).expect("a stage");
        stage(times.parse().unwrap());
        return ExitCode::SUCCESS;
    }
    let read = |path: &PathBuf| toml::from_str::<Counts>(&fs::read_to_string(path).unwrap()).unwrap();
    let before = options.against.as_ref().map(read);
    let counts: Counts = STAGES.iter().map(|(name, _)| ((*name).to_owned(), count(name))).collect();
    if let Some(path) = options.write {
        fs::write(path, toml::to_string(&counts).unwrap()).unwrap();
    }
    print(&counts, before.as_ref())
}

/// Instructions of a stage: twice minus once, so that what comes before it is left out.
fn count(name: &str) -> u64 {
    let [once, twice] = ["1", "2"].map(|times| collected(name, times));
    twice - once
}

fn collected(name: &str, times: &str) -> u64 {
    let mut command = Command::new("valgrind");
    command.args(["--tool=callgrind", "--callgrind-out-file=/dev/null"]);
    command.arg(std::env::current_exe().unwrap()).args(["--carry-out", name, times]);
    // The widest that valgrind knows, also where the processor has no more.
    command.env("DESCRY_VECTORS", "v3").stdin(Stdio::null());
    let output =
        command.output().unwrap_or_else(|error| panic!("valgrind: {error}; apt-get install valgrind"));
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{name}: {text}");
    let line = text.lines().find_map(|line| line.split_once("Collected :"));
    line.unwrap_or_else(|| panic!("{name}: no count in\n{text}")).1.trim().parse().unwrap()
}

/// Prints the counts; a failure if a stage takes more than before.
fn print(counts: &Counts, before: Option<&Counts>) -> ExitCode {
    let mut code = ExitCode::SUCCESS;
    println!("| stage | instructions | before | change |\n|---|---|---|---|");
    for (name, &count) in counts {
        let Some(&before) = before.and_then(|before| before.get(name)) else {
            println!("| {name} | {count} | – | – |");
            continue;
        };
        let change = 100.0 * (count as f64 / before as f64 - 1.0);
        let note = if change > MARGIN { " more than the margin" } else { "" };
        println!("| {name} | {count} | {before} | {change:+.1} %{note} |");
        if change > MARGIN {
            code = ExitCode::FAILURE;
        }
    }
    code
}
