//! How busy a few long evaluations keep many workers, and why these are idle otherwise: the scheduler, the plans, and workers
//! that only wait, on a virtual clock. `cargo test --release -p cluster --lib -- busy --nocapture` prints the figures.

mod generations;
mod simulation;
mod structures;
mod worker;

use crate::sharding::ShardCount;
use generations::{Generations, Unrelated};
use simulation::{Measured, Setting, Simulation};
use structures::Structures;

/// Workers that are equal.
const EQUAL: Setting = Setting { workers: 100, shard_count: ShardCount::Auto, slowest: 1.0, ahead: 1 };

/// Ten evaluations, each of 5 s for describing clouds and 5 s for matching them.
const TEN: Unrelated = Unrelated { evaluations: 10, half: 5.0, spread: 1.0, asked: 0 };

/// As many as `experiments/structure.toml` with the default operators asks for in a generation with seed 1, with as many
/// channels, old and new, …
const TABLETOP: structures::Setting = structures::Setting {
    members: 4,
    evaluations: 100,
    kinds: [(3, 1, 0), (15, 1, 1), (24, 2, 0), (45, 2, 1), (13, 2, 2)],
    describing: 1.0,
};

/// … and `experiments/structure-household.toml`, whose clouds have fewer points.
const HOUSEHOLD: structures::Setting = structures::Setting {
    members: 4,
    evaluations: 62,
    kinds: [(2, 1, 0), (43, 1, 1), (15, 2, 0), (28, 2, 1), (12, 2, 2)],
    describing: 0.33,
};

/// The same with their own operators, which keep channels: there is less to hand out.
const TABLETOP_KEPT: structures::Setting = structures::Setting {
    evaluations: 81,
    kinds: [(4, 1, 0), (7, 1, 1), (38, 2, 0), (45, 2, 1), (6, 2, 2)],
    ..TABLETOP
};
const HOUSEHOLD_KEPT: structures::Setting = structures::Setting {
    evaluations: 56,
    kinds: [(3, 1, 0), (22, 1, 1), (26, 2, 0), (43, 2, 1), (6, 2, 2)],
    ..HOUSEHOLD
};

fn measure(what: &str, setting: Setting, generations: (impl Generations + 'static, u32)) -> Measured {
    let (asked, count) = generations;
    let measured = Simulation::new(setting, asked).run(count);
    let Measured { generation, busy, jobs, twice, between, waiting, barrier, last, up, down } = measured;
    assert!((busy + twice + between + waiting + barrier + last - 1.0).abs() < 0.01, "{measured:?}");
    let [busy, twice, waiting, barrier, last, between] =
        [busy, twice, waiting, barrier, last, between].map(|share| format!("{:.1} %", 100.0 * share));
    let Setting { workers, slowest, .. } = setting;
    println!(
        "| {workers} | {what} | {slowest} | {generation:.2} s | {busy} | {jobs:.0} | {twice} | {waiting} | {barrier} | \
         {last} | {between} | {up:.1}, {down:.1} MB |"
    );
    measured
}

fn print_header() {
    println!(
        "| workers | evaluations | slowest worker | a generation | busy | jobs | twice | waiting | barrier | last | \
         between | up, down |\n|---|---|---|---|---|---|---|---|---|---|---|---|"
    );
}

#[test]
fn ten_evaluations_keep_a_hundred_workers_busy() {
    print_header();
    for workers in [10, 30, 100] {
        let measured = measure("equal", Setting { workers, ..EQUAL }, (TEN, 12));
        assert!(measured.busy > 0.95, "{workers} workers: {measured:?}");
        // Signatures go up once, 1.1 MB an evaluation, and down at most once a worker.
        assert!(measured.up < 11.0 && measured.down < 10.9 * workers as f64, "{measured:?}");
    }
}

#[test]
fn unequal_evaluations_keep_unequal_workers_busy() {
    print_header();
    for (spread, slowest) in [(2.0, 1.0), (1.0, 1.5), (2.0, 2.0)] {
        for workers in [10, 30, 100] {
            let (setting, asked) = (Setting { workers, slowest, ..EQUAL }, Unrelated { spread, ..TEN });
            let measured = measure(&format!("times or by {spread}"), setting, (asked, 12));
            assert!(measured.busy > 0.9, "{workers} workers: {measured:?}");
        }
    }
}

#[test]
fn whole_evaluations_leave_a_hundred_workers_idle() {
    print_header();
    let whole = ShardCount::Fixed(std::num::NonZeroU32::MIN);
    let measured = measure("whole", Setting { shard_count: whole, ..EQUAL }, (TEN, 12));
    assert!(measured.busy < 0.11, "{measured:?}");
}

#[test]
fn searches_for_structures_keep_ten_workers_busy() {
    print_header();
    // The cheaper its channels, the more of a generation is its end.
    for (name, structures, least) in [
        ("tabletop", TABLETOP, [0.98, 0.97, 0.96, 0.88]),
        ("household", HOUSEHOLD, [0.98, 0.95, 0.92, 0.88]),
        ("tabletop, channels kept", TABLETOP_KEPT, [0.98, 0.97, 0.96, 0.88]),
        ("household, channels kept", HOUSEHOLD_KEPT, [0.98, 0.95, 0.92, 0.87]),
    ] {
        for (workers, least) in [1, 6, 10, 20].into_iter().zip(least) {
            let measured = measure(name, Setting { workers, ..EQUAL }, (Structures::new(structures), 25));
            assert!(measured.busy > least, "{workers} workers: {measured:?}");
            // Nobody waits for scales that it does not need.
            assert!(measured.barrier < 0.005, "{workers} workers: {measured:?}");
        }
    }
}
