//! Random schedules under a virtual clock: workers that come, go, fall silent, hang, fail and lie, alone or under several ids,
//! and speak in the name of others, messages that are lost, late, doubled and out of order, and an operator who pauses, drains and
//! sets priorities. Each schedule follows from its seed.
//!
//! A seed that fails is printed; `DESCRY_SIMULATION_SEED=<seed>` replays it alone, and `DESCRY_SIMULATIONS=<count>`
//! runs more of them.

mod actor;
mod driver;
mod mishaps;
mod world;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;

use mishaps::Mishaps;
use world::World;

const SCHEDULES: u64 = 10_000;

/// Everything that went wrong in some schedules, by kind.
fn run(seeds: impl Iterator<Item = u64>) -> Mishaps {
    let mut all = Mishaps::default();
    for seed in seeds {
        match catch_unwind(AssertUnwindSafe(|| World::new(seed).run())) {
            Ok(mishaps) => all += mishaps,
            Err(_) => panic!("schedule {seed} failed; replay it with DESCRY_SIMULATION_SEED={seed}"),
        }
    }
    all
}

fn number(variable: &str) -> Option<u64> {
    std::env::var(variable).ok()?.parse().ok()
}

#[test]
fn every_task_gets_its_right_answer_once_whatever_happens_to_workers_and_messages() {
    if let Some(seed) = number("DESCRY_SIMULATION_SEED") {
        run(std::iter::once(seed));
        return;
    }
    let schedules = number("DESCRY_SIMULATIONS").unwrap_or(SCHEDULES);
    let next = AtomicU64::new(0);
    let seeds =
        || std::iter::from_fn(|| Some(next.fetch_add(1, Ordering::Relaxed)).filter(|seed| *seed < schedules));
    let mut all = Mishaps::default();
    thread::scope(|scope| {
        let threads: Vec<_> = (0..2).map(|_| scope.spawn(|| run(seeds()))).collect();
        for thread in threads {
            all += thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        }
    });
    println!("{schedules} schedules: {all:?}");
    assert!(all.each_happened(), "a mishap that never happens tests nothing: {all:?}");
}
