//! How busy a few long evaluations keep many workers, and why these are idle otherwise: the scheduler, the plans, and workers
//! that only wait, on a virtual clock. `cargo test --release -p cluster --lib -- busy --nocapture` prints the figures.

mod simulation;
mod worker;

use crate::sharding::ShardCount;
use simulation::{Measured, Setting, Simulation};

const GENERATIONS: u32 = 12;

/// Ten evaluations, each of 5 s for describing clouds and 5 s for matching them, for workers that are equal.
const TEN: Setting = Setting {
    workers: 100,
    shard_count: ShardCount::Auto,
    evaluations: 10,
    half: 5.0,
    spread: 1.0,
    slowest: 1.0,
    ahead: 1,
};

fn measure(setting: Setting) -> Measured {
    let measured = Simulation::new(setting).run(GENERATIONS);
    let Measured { generation, busy, jobs, twice, between, waiting, barrier, last, up, down } = measured;
    assert!((busy + twice + between + waiting + barrier + last - 1.0).abs() < 0.01, "{measured:?}");
    let [busy, twice, waiting, barrier, last, between] =
        [busy, twice, waiting, barrier, last, between].map(|share| format!("{:.1} %", 100.0 * share));
    let Setting { workers, spread, slowest, .. } = setting;
    println!(
        "| {workers} | {spread} | {slowest} | {generation:.2} s | {busy} | {jobs:.0} | {twice} | {waiting} | {barrier} | \
         {last} | {between} | {up:.1}, {down:.1} MB |"
    );
    measured
}

fn print_header() {
    println!(
        "| workers | evaluations cost, times the mean or by it | slowest worker | a generation | busy | jobs | twice | \
         waiting | barrier | last | between | up, down |\n|---|---|---|---|---|---|---|---|---|---|---|---|"
    );
}

#[test]
fn ten_evaluations_keep_a_hundred_workers_busy() {
    print_header();
    for workers in [10, 30, 100] {
        let measured = measure(Setting { workers, ..TEN });
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
            let measured = measure(Setting { workers, spread, slowest, ..TEN });
            assert!(measured.busy > 0.9, "{workers} workers: {measured:?}");
        }
    }
}

#[test]
fn whole_evaluations_leave_a_hundred_workers_idle() {
    print_header();
    let measured = measure(Setting { shard_count: ShardCount::Fixed(std::num::NonZeroU32::MIN), ..TEN });
    assert!(measured.busy < 0.11, "{measured:?}");
}
