//! What audits cost: answers that are asked for twice, and time, with workers that take a second a job.

use std::collections::BTreeMap;

use super::*;

const GENERATIONS: u32 = 200;
const POPULATION: u32 = 50;

/// Answers that were asked for, and seconds that all generations took.
struct Cost {
    answers: u32,
    seconds: f64,
}

/// Honest workers, each a principal of its own, evaluate generation after generation. Of every so many generations the
/// best is new, and confirmed.
fn play(workers: u8, audit: Audit, new_best_each: Option<u32>) -> Cost {
    let mut bench = Bench::new(0);
    bench.scheduler.limits.max_workers = 1000;
    bench.scheduler.trust = Trust::new(audit);
    (0..workers).for_each(|number| drop(bench.join(number)));
    let begun = bench.now;
    let mut busy: BTreeMap<(Instant, u8), Lease> = BTreeMap::new();
    let mut answers = 0;
    let mut accepted: Vec<Finished> = Vec::new();
    for generation in 0..GENERATIONS {
        for number in 0..POPULATION {
            let task =
                Arc::new(Task::Evaluation(Evaluation::sample(generation * POPULATION + number, 10, 10)));
            bench.scheduler.submit(task.job(0), task, ClientId::new(1), bench.now);
        }
        if let Some(best) =
            accepted.first().filter(|_| new_best_each.is_some_and(|each| generation % each == 0))
        {
            let task = Arc::new(Task::Evaluation(Evaluation::sample((generation - 1) * POPULATION, 10, 10)));
            assert_eq!(task.job(0), best.job);
            bench.scheduler.audit(&task, best, ClientId::new(1), bench.now);
        }
        accepted.clear();
        loop {
            accepted.extend(bench.scheduler.drain_finished());
            if accepted.len() == POPULATION as usize && !bench.scheduler.in_doubt(|_| false) {
                break;
            }
            for number in 0..workers {
                if busy.keys().all(|(_, at_work)| *at_work != number) {
                    for (lease, _) in bench.poll(number, &[], 1).jobs {
                        // From 0.8 to 1.2 s.
                        let took = 800
                            + Evaluation::sample(number.into(), 1, 1).queries
                            + (lease.job.0 % 400) as u32;
                        busy.insert((bench.now + Duration::from_millis(took.into()), number), lease);
                        answers += 1;
                    }
                }
            }
            let ((now, number), lease) = busy.pop_first().expect("somebody works");
            bench.now = now;
            bench.report(number, lease, good());
        }
        accepted.sort_by_key(|finished| {
            (
                finished.job != Task::Evaluation(Evaluation::sample(generation * POPULATION, 10, 10)).job(0),
                finished.job,
            )
        });
        bench.scheduler.drain_events();
        bench.scheduler.drain_confirmed();
    }
    Cost { answers, seconds: bench.now.duration_since(begun).as_secs_f64() }
}

#[test]
fn audits_cost_ten_honest_workers_less_than_a_twentieth_newcomers_included() {
    let all = GENERATIONS * POPULATION;
    for workers in [1, 3, 10, 100] {
        let share = Audit { share: 0.01, first: 0 };
        let before = play(workers, share, None);
        let after = play(workers, Audit { first: 10, ..share }, Some(4));
        let twice = |cost: &Cost| 100.0 * f64::from(cost.answers - all) / f64::from(all);
        let rate = |cost: &Cost| f64::from(all) / cost.seconds;
        println!(
            "{workers:3} workers: {:5.2} and {:5.2} evaluations a second, {:5.2} and {:5.2} % of answers asked for twice",
            rate(&before),
            rate(&after),
            twice(&before),
            twice(&after)
        );
        let more = twice(&after) - twice(&before);
        match workers {
            1 => assert_eq!(more, 0.0, "there is nobody who could audit"),
            10 => assert!(more + 1.0 < 5.0, "{more} points beside the share"),
            _ => {}
        }
    }
}
