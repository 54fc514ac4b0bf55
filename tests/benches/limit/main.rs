//! `cargo bench --bench limit`: how far each stage is from what the processor can do, on one thread.
//!
//! A limit counts what the definition of a stage needs, from the data (neighbours, not candidates), and divides it by the
//! rates of small kernels: a ratio is what better algorithms could still gain.
//!
//! - `kernels`, `rates`: what the processor does a second
//! - `work`: what a stage consists of, and its limit
//! - `count`: neighbours, counted by looking at every pair
//! - `stage`, `cold`, `fitness`, `structures`, `fixed`: the stages and their times

#![expect(
    clippy::unwrap_used,
    reason = "a benchmark that cannot go on has failed; there is nobody to recover for"
)]

mod cold;
mod count;
mod fitness;
mod fixed;
mod kernels;
mod rates;
mod stage;
mod structures;
mod work;

use std::path::PathBuf;

use clap::Parser;
use tests::benches::household::find_set;
use tests::benches::machine::{cores, machine};
use tests::benches::prepared::pool;

use cold::Cold;
use fitness::Fitness;
use fixed::Fixed;
use rates::Processor;
use stage::Stage;
use structures::Structures;
use work::{Element, Rates, amount};

/// The benchmark sets.
const SETS: [&str; 2] = ["household-rgbd", "tabletop-rgbd"];

/// Time of each stage beside what it would take if only what its definition needs were done, at the processor's rates.
/// DESCRY_VECTORS=v3 or baseline: with narrower vectors.
///
/// Example: cargo bench --bench limit
#[derive(Debug, Parser)]
struct Options {
    /// Times that everything is measured, in turn
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    repetitions: u32,
    /// Measure the processor only
    #[arg(long)]
    rates: bool,
    /// Given by cargo
    #[arg(long, hide = true)]
    bench: bool,
}

/// The clouds of one set, and their stages.
struct Set {
    name: &'static str,
    cold: Cold,
    fitness: Fitness,
    structures: Structures,
    fixed: Fixed,
}

impl Set {
    fn new(name: &'static str) -> Self {
        let root: PathBuf = find_set(name);
        let (cold, prepared) = Cold::new(&root);
        let fitness = Fitness::new(&root, &prepared);
        let structures = Structures::new(&prepared[..cold.queries()]);
        Self { name, cold, fitness, structures, fixed: Fixed::new(prepared) }
    }

    fn sample(&mut self) {
        self.cold.sample();
        self.fitness.sample();
        self.structures.sample();
        self.fixed.sample();
    }

    fn stages(&self) -> impl Iterator<Item = &Stage> {
        let Self { cold, fitness, structures, fixed, .. } = self;
        let prepared = fitness.stages.iter().chain(&structures.stages).chain(&fixed.stages);
        cold.stages.iter().chain(prepared)
    }
}

fn main() {
    let options = Options::parse();
    descriptor::wide::check_environment().unwrap_or_else(|error| panic!("{error}"));
    println!("{}; vectors: {}", machine(), descriptor::wide::name());
    let names = if options.rates { [].as_slice() } else { &SETS };
    let mut sets: Vec<Set> = pool(cores()).install(|| names.iter().map(|name| Set::new(name)).collect());
    let mut processor = Processor::new();
    let one_thread = pool(1);
    for _ in 0..options.repetitions {
        processor.sample();
        for set in &mut sets {
            one_thread.install(|| set.sample());
            processor.sample();
        }
    }
    let rates = processor.rates();
    println!("\n{}", table_of_rates(&rates));
    if let [first, second] = sets.as_slice() {
        println!("{}", table_of_stages([first, second], &rates));
    }
}

fn table_of_rates(rates: &Rates) -> String {
    let row = |element: Element| {
        let rate = amount(rates.of(element) as u64);
        format!("| {} | {rate} |\n", element.names()[0])
    };
    let rows: String = Element::ALL.map(row).concat();
    format!("| what | a second |\n|---|---|\n{rows}")
}

fn table_of_stages([first, second]: [&Set; 2], rates: &Rates) -> String {
    let mut text =
        "| stage | set | what must be done | limit | time | time ÷ limit |\n|---|---|---|---|---|---|\n"
            .to_owned();
    for pair in first.stages().zip(second.stages()) {
        for (set, stage) in [(first, pair.0), (second, pair.1)] {
            let (limit, time) = (stage.work.limit(rates), stage.times.median());
            let ms = |seconds: f64| {
                let ms = 1e3 * seconds;
                format!("{ms:.0$} ms", if ms < 10.0 { 2 } else { usize::from(ms < 100.0) })
            };
            let Stage { name, work, .. } = stage;
            text += &format!(
                "| {name} | {} | {work} | {} | {} | {:.1} |\n",
                set.name,
                ms(limit),
                ms(time),
                time / limit
            );
        }
    }
    text
}
