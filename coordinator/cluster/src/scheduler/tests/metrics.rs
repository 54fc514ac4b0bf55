//! What is measured: states of jobs and workers, how many workers are wanted, and what is counted.

use proto::task::TaskKind;

use super::*;
use crate::counters::Counters;
use crate::scheduler::metrics::{JobState, SchedulerMetrics, WorkerState};

fn jobs(metrics: &SchedulerMetrics, state: JobState) -> u64 {
    metrics.jobs.get(&(TaskKind::Evaluation, state)).copied().unwrap_or(0)
}

fn join_with_threads(bench: &mut Bench, number: u8, threads: u32) {
    let introduction = Introduction { threads, ..Introduction::sample("host", number) };
    bench.scheduler.register(worker(number), introduction, bench.now).unwrap();
}

#[test]
fn as_many_workers_are_wanted_as_jobs_could_keep_busy() {
    let mut bench = Bench::new(0);
    let wanted = |bench: &Bench| {
        let metrics = bench.scheduler.metrics();
        (metrics.wanted_workers, metrics.wanted_threads)
    };
    assert_eq!(wanted(&bench), (0, 0));
    for _ in 0..3 {
        bench.submit();
    }
    assert_eq!(wanted(&bench), (3, 3), "a thread each while nobody is here");
    assert_eq!(jobs(&bench.scheduler.metrics(), JobState::Queued), 3);
    join_with_threads(&mut bench, 1, 8);
    assert_eq!(wanted(&bench), (3, 24));
    join_with_threads(&mut bench, 2, 1);
    assert_eq!(wanted(&bench), (3, 14), "13.5 at the mean of 4.5");
    let leases = [1, 2].map(|number| bench.take(number));
    assert_eq!(wanted(&bench), (3, 14), "those in hand count");
    let metrics = bench.scheduler.metrics();
    assert_eq!((jobs(&metrics, JobState::Leased), jobs(&metrics, JobState::Queued)), (2, 1));
    assert_eq!(metrics.workers, [(WorkerState::Busy, (2, 9))].into());

    // What is in hand ends; nothing else is handed out.
    bench.scheduler.pause(ClientId::new(1));
    assert_eq!(wanted(&bench).0, 2);
    bench.report(1, leases[0], good());
    assert_eq!(wanted(&bench).0, 1);
    assert_eq!(jobs(&bench.scheduler.metrics(), JobState::Paused), 1);
    bench.scheduler.resume(ClientId::new(1));
    bench.report(2, leases[1], good());
    let lease = bench.take(1);
    bench.report(1, lease, good());
    assert_eq!(wanted(&bench), (0, 0));
    assert_eq!(bench.scheduler.metrics().jobs, [].into());
}

#[test]
fn a_job_that_awaits_another_principal_is_blocked_and_wants_nobody_who_is_here() {
    let mut bench = Bench::new(1);
    bench.scheduler.trust = Trust::new(Audit { share: 1.0, first: 0 });
    bench.join_as(2, principal(1)).unwrap();
    bench.submit();
    let lease = bench.take(1);
    bench.report(1, lease, good());
    let metrics = bench.scheduler.metrics();
    assert_eq!((jobs(&metrics, JobState::Blocked), metrics.wanted_workers), (1, 0));
    assert_eq!((metrics.counters.audits, metrics.counters.agreements), (1, 0));
    bench.join(3).unwrap();
    assert_eq!(bench.scheduler.metrics().wanted_workers, 1);
    let lease = bench.take(3);
    bench.report(3, lease, good());
    let counters = bench.scheduler.metrics().counters;
    assert_eq!((counters.audits, counters.agreements, counters.disagreements), (1, 1, 0));
}

#[test]
fn counters_say_what_the_events_say() {
    let mut bench = Bench::new(3);
    bench.scheduler.trust = Trust::new(Audit { share: 1.0, first: 0 });
    let mut events = bench.scheduler.drain_events();
    bench.submit();
    let lease = bench.take(1);
    bench.report(1, lease, good());
    let lease = bench.take(2);
    bench.report(
        2,
        lease,
        result(10)
            .map(|_| TaskResult::Evaluation(EvaluationResult { queries: 10, ..EvaluationResult::default() })),
    );
    let lease = bench.take(3);
    bench.report(3, lease, panicked("out of memory"));
    bench.take(3); // nobody else is left to decide
    bench.pass(31);
    events.extend(bench.scheduler.drain_events());
    let mut expected = Counters::default();
    for event in &events {
        expected.note(&event.kind);
        if let EventKind::Attempt(Attempt { end, run_seconds, .. }) = &event.kind {
            expected.attempt_ended(TaskKind::Evaluation, end.as_str(), *run_seconds);
        }
    }
    let counters = bench.scheduler.metrics().counters;
    assert_eq!(counters.attempts, expected.attempts);
    assert_eq!(counters.run_times, expected.run_times);
    assert_eq!((counters.joined, counters.disagreements), (3, 1));
    assert_eq!((counters.joined, &counters.departed), (expected.joined, &expected.departed));
    assert_eq!(counters.departed, [("lost", 3)].into());
    for outcome in ["answered", "disagreed", "failed", "lost"] {
        assert_eq!(counters.attempts.get(&(TaskKind::Evaluation, outcome)), Some(&1), "{outcome}");
    }
    assert_eq!(counters.leases, [(TaskKind::Evaluation, 4)].into());
    assert_eq!(counters.queue_times.count(), 1, "once a job");
    assert_eq!(bench.scheduler.metrics().workers, [].into());
}

#[test]
fn a_worker_that_an_operator_drains_is_draining_and_one_that_is_full_is_refused() {
    let mut bench = Bench::new(2);
    bench.scheduler.drain(worker(1), bench.now);
    let metrics = bench.scheduler.metrics();
    assert_eq!(metrics.workers, [(WorkerState::Idle, (1, 1)), (WorkerState::Draining, (1, 1))].into());
    bench.scheduler.ban(worker(2), bench.now);
    assert!(bench.join(2).is_err());
    assert_eq!(bench.scheduler.metrics().counters.refused, [("denied", 1)].into());
}
