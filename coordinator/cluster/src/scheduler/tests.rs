//! The scheduler's promises: every job is answered once, whatever happens to workers and messages.

mod affinity;
mod control;
mod cost;
mod failures;
mod foresight;
mod metrics;
mod opinions;
mod principals;
mod restarts;

use std::collections::BTreeSet;

use proptest::prelude::*;

use super::*;
use crate::events::Attempt;
use crate::job_names::JobNames;
use proto::LeaseNonce;
use proto::journal::Assurance;
use proto::task::{Described, Evaluation, EvaluationResult, Failure, FailureReason, Report, TaskResult};
use proto::{Digest, Introduction};

const LIMITS: Limits = Limits { max_failures: 3, ..Limits::SAMPLE };

fn evaluation() -> Arc<Task> {
    Arc::new(Task::Evaluation(Evaluation::sample(1, 10, 10)))
}

fn result(queries: u32) -> Result<TaskResult, Failure> {
    Ok(TaskResult::Evaluation(EvaluationResult {
        queries,
        object_correct: 4,
        category_correct: 6,
        ..EvaluationResult::default()
    }))
}

fn panicked(message: &str) -> Result<TaskResult, Failure> {
    Err(Failure::new(FailureReason::Panic, message))
}

fn good() -> Result<TaskResult, Failure> {
    result(10)
}

fn worker(number: u8) -> WorkerId {
    WorkerId([number; 16])
}

/// Who answers for the worker of this number: each stands for itself.
fn principal(number: u8) -> Principal {
    Introduction::sample("host", number).principal
}

/// A scheduler with a clock that only tests move, and a sequence number for each poll.
struct Bench {
    scheduler: Scheduler,
    names: JobNames,
    now: Instant,
    sequence: u64,
}

impl Bench {
    fn new(workers: u8) -> Self {
        let mut bench = Self {
            scheduler: Scheduler::new(Limits { max_workers: 50, ..LIMITS }, RunSecret::new([7; 32]), None),
            names: JobNames::default(),
            now: Instant::now(),
            sequence: 0,
        };
        for number in 1..=workers {
            bench.join(number).unwrap();
        }
        bench
    }

    fn join(&mut self, number: u8) -> Result<String, RegisterRefusal> {
        self.join_as(number, principal(number))
    }

    /// Joins under a principal that may be another's.
    fn join_as(&mut self, number: u8, principal: Principal) -> Result<String, RegisterRefusal> {
        let introduction = Introduction { principal, ..Introduction::sample("host", number) };
        self.scheduler.register(worker(number), introduction, self.now)
    }

    /// The lease of a worker on an attempt at a job.
    fn lease(&self, number: u8, job: JobId, attempt: u32) -> Lease {
        self.scheduler.secret.lease(job, attempt, (worker(number), principal(number)))
    }

    /// By whom a worker has registered.
    fn caller(&self, number: u8) -> Caller {
        let registered = self.scheduler.workers.get(&worker(number)).map(|worker| worker.principal);
        (worker(number), registered.unwrap_or(principal(number)))
    }

    fn submit(&mut self) -> JobId {
        self.submit_for(ClientId::new(1))
    }

    fn submit_for(&mut self, client: ClientId) -> JobId {
        let job = self.names.next(&evaluation());
        self.scheduler.submit(job, evaluation(), client, self.now);
        job
    }

    fn try_poll(&mut self, number: u8, poll: Poll) -> Result<Answer, PollRefusal> {
        self.sequence += 1;
        let caller = self.caller(number);
        self.scheduler.poll(caller, Poll { sequence: self.sequence, ..poll }, self.now)
    }

    fn poll(&mut self, number: u8, held: &[Lease], wanted: usize) -> Answer {
        self.try_poll(number, Poll { held: held.to_vec(), wanted, ..Poll::default() }).unwrap()
    }

    fn take(&mut self, number: u8) -> Lease {
        self.poll(number, &[], 1).jobs[0].0
    }

    fn report(&mut self, number: u8, lease: Lease, outcome: Result<TaskResult, Failure>) -> Answer {
        let finished = vec![Report { lease, run_seconds: 0.5, outcome }];
        self.try_poll(number, Poll { finished, ..Poll::default() }).unwrap()
    }

    fn pass(&mut self, seconds: u64) {
        for _ in 0..seconds {
            self.now += Duration::from_secs(1);
            self.scheduler.expire(self.now);
        }
    }

    fn labels(&self) -> Vec<&str> {
        self.scheduler.workers.keys().map(|id| self.scheduler.identities[id].label.as_str()).collect()
    }

    /// Workers that went since the last call, with the reason.
    fn departures(&mut self) -> Vec<(String, Departure)> {
        let went = |event: Emitted| match event.kind {
            EventKind::Departed { label, departure, .. } => Some((label, departure)),
            _ => None,
        };
        self.scheduler.drain_events().into_iter().filter_map(went).collect()
    }
}

#[test]
fn a_job_is_leased_once_and_its_answer_acknowledged() {
    let mut bench = Bench::new(2);
    let job = bench.submit();
    let lease = bench.take(1);
    assert_eq!(lease, bench.lease(1, job, 1));
    assert!(bench.poll(2, &[], 5).jobs.is_empty());
    bench.pass(2);
    assert_eq!(bench.report(1, lease, good()).acknowledged, [lease]);
    let finished = bench.scheduler.drain_finished();
    assert_eq!(finished.len(), 1);
    assert_eq!((finished[0].job, finished[0].worker.as_str(), finished[0].attempt), (job, "host", 1));
    assert_eq!(finished[0].queued, Duration::ZERO);
    // The same report again, because the acknowledgement was lost: acknowledged, not counted twice.
    assert_eq!(bench.report(1, lease, good()).acknowledged, [lease]);
    assert!(bench.scheduler.drain_finished().is_empty());
}

#[test]
fn labels_are_unique_and_kept_by_a_worker_that_returns() {
    let mut bench = Bench::new(2);
    assert_eq!(bench.labels(), ["host", "host-2"]);
    bench.submit();
    let lease = bench.take(2);
    bench.report(2, lease, good());
    bench.pass(31);
    assert!(bench.labels().is_empty());
    // The first has left no trace in the results: its label is free again. The second's is not.
    assert_eq!(bench.join(3).as_deref(), Ok("host"));
    assert_eq!(bench.join(2).as_deref(), Ok("host-2"));
    assert_eq!(bench.join(4).as_deref(), Ok("host-3"));
    let joined = |event: &Emitted| matches!(event.kind, EventKind::Joined { .. });
    assert_eq!(bench.scheduler.drain_events().iter().filter(|event| joined(event)).count(), 5);
}

#[test]
fn the_jobs_of_a_silent_worker_go_to_another_and_a_late_answer_still_counts() {
    let mut bench = Bench::new(1);
    let job = bench.submit();
    let lost = bench.take(1);
    bench.pass(31);
    assert_eq!(bench.departures(), [("host".to_owned(), Departure::Lost)]);
    bench.join(2).unwrap();
    let again = bench.take(2);
    assert_eq!(again, bench.lease(2, job, 2));
    // The first worker was only cut off: it registers again and hands in its result.
    bench.join(1).unwrap();
    assert_eq!(bench.report(1, lost, good()).acknowledged, [lost]);
    assert_eq!(bench.scheduler.drain_finished()[0].attempt, 1);
    // The second worker has begun: it goes on, and its result is compared and changes nothing.
    assert!(bench.poll(2, &[again], 0).revoked.is_empty());
    assert_eq!(bench.report(2, again, good()).acknowledged, [again]);
    assert!(bench.scheduler.drain_finished().is_empty());
}

#[test]
fn a_returning_worker_keeps_a_job_that_nobody_else_has_begun() {
    let mut bench = Bench::new(1);
    bench.submit();
    let lease = bench.take(1);
    bench.pass(31);
    bench.join(1).unwrap();
    let answer = bench.poll(1, &[lease], 1);
    assert!(answer.revoked.is_empty() && answer.jobs.is_empty());
    bench.join(2).unwrap();
    assert!(bench.poll(2, &[], 1).jobs.is_empty());
    bench.report(1, lease, good());
    assert_eq!(bench.scheduler.drain_finished().len(), 1);
}

#[test]
fn a_lease_whose_reply_was_lost_is_given_out_again_at_once() {
    let mut bench = Bench::new(2);
    let job = bench.submit();
    bench.take(1); // the reply never arrives: the next poll does not list it
    assert!(bench.poll(1, &[], 0).jobs.is_empty());
    assert_eq!(bench.take(2), bench.lease(2, job, 2));
}

#[test]
fn a_worker_that_leaves_hands_its_leases_back_without_a_failure() {
    let mut bench = Bench::new(2);
    for _ in 0..LIMITS.max_failures + 1 {
        bench.submit();
    }
    let job = bench.take(1).job;
    bench.try_poll(1, Poll { leaving: true, ..Poll::default() }).unwrap();
    assert_eq!(bench.try_poll(1, Poll::default()).unwrap_err(), PollRefusal::UnknownWorker);
    assert_eq!(bench.departures(), [("host".to_owned(), Departure::Left)]);
    assert_eq!(bench.take(2).job, job);
    assert_eq!(bench.scheduler.failed(), None);
}

#[test]
fn a_duplicated_or_delayed_poll_changes_nothing() {
    let mut bench = Bench::new(1);
    bench.submit();
    let lease = bench.take(1);
    let late = Poll { sequence: bench.sequence, held: vec![], wanted: 1, ..Poll::default() };
    assert_eq!(bench.scheduler.poll(bench.caller(1), late, bench.now).unwrap_err(), PollRefusal::Stale);
    let stale = bench.scheduler.lease_later(bench.caller(1), bench.sequence - 1, 1, bench.now);
    assert_eq!(stale.unwrap_err(), PollRefusal::Stale);
    assert!(bench.poll(1, &[lease], 0).revoked.is_empty());
}

#[test]
fn a_failed_job_goes_to_another_worker_and_ends_after_the_limit() {
    let mut bench = Bench::new(2);
    let job = bench.submit();
    let lease = bench.take(1);
    bench.report(1, lease, panicked("index out of bounds"));
    assert!(bench.poll(1, &[], 1).jobs.is_empty(), "not where it failed, while another worker is there");
    let lease = bench.take(2);
    assert_eq!((lease.job, lease.attempt), (job, 2));
    // A result that cannot be one is a failure, too.
    bench.report(2, lease, result(11));
    assert_eq!(bench.scheduler.failed(), None);
    let lease = bench.take(1); // it failed everywhere: anyone may try again
    bench.report(1, lease, panicked("index out of bounds"));
    let failed = bench.scheduler.failed().unwrap();
    let failures: Vec<String> = failed.failures.iter().map(ToString::to_string).collect();
    assert_eq!(
        failures,
        [
            "host: panic: index out of bounds",
            "host-2: invalid result: queries: must be 10, got 11",
            "host: panic: index out of bounds"
        ]
    );
    assert!(!failed.is_malformed());
}

#[test]
fn a_job_is_malformed_when_two_say_so_and_whatever_else_goes_wrong_is_tried_elsewhere() {
    use FailureReason::*;
    for reason in [Other, Data, Panic, Cloud, Description, InvalidResult, InvalidJob] {
        let mut bench = Bench::new(2);
        bench.submit();
        for number in [1, 2] {
            assert_eq!(bench.scheduler.failed(), None, "{reason}");
            let lease = bench.take(number);
            assert_eq!(lease.attempt, u32::from(number));
            bench.report(number, lease, Err(Failure::new(reason, "what")));
        }
        let failed = bench.scheduler.failed();
        assert_eq!(failed.is_some(), reason == InvalidJob, "{reason}");
        assert!(failed.is_none_or(JobFailed::is_malformed));
        if let Some(failed) = failed {
            let message = crate::ClusterError::JobFailed(failed.clone()).to_string();
            let expected =
                "evaluation of descriptor 1: malformed, got\n  host: invalid job: what\n  host-2: invalid";
            assert!(message.starts_with(expected), "{message}");
        }
    }
}

#[test]
fn a_description_that_its_family_refuses_is_a_failure() {
    let mut bench = Bench::new(1);
    bench.scheduler.limits.check_description = |_, bytes, clouds| match bytes[0] {
        0 => Ok(()),
        first => Err(format!("{clouds} clouds, got {first}")),
    };
    let shard =
        proto::task::Description { subject: Subject::sample(1), manifest: Digest([1; 32]), clouds: 3 };
    let task = Arc::new(Task::Description(shard));
    bench.scheduler.submit(task.job(0), Arc::clone(&task), ClientId::new(1), bench.now);
    let described = |byte| Ok(TaskResult::Description(Described::new(vec![byte; 24])));
    let lease = bench.take(1);
    bench.report(1, lease, described(7));
    assert_eq!(bench.scheduler.drain_finished(), []);
    let lease = bench.take(1);
    bench.report(1, lease, described(0));
    assert_eq!(bench.scheduler.drain_finished().len(), 1);
    let failed = bench.scheduler.drain_events().into_iter().find_map(|event| match event.kind {
        EventKind::Attempt(Attempt { end: AttemptEnd::Failed(reason), .. }) => Some(reason),
        _ => None,
    });
    assert_eq!(failed.as_deref(), Some("invalid result: 3 clouds, got 7"));
}

#[test]
fn a_failure_on_a_lease_that_was_given_up_is_not_counted() {
    let mut bench = Bench::new(1);
    bench.submit();
    let lost = bench.take(1);
    bench.pass(31);
    bench.join(1).unwrap();
    bench.join(2).unwrap();
    let again = bench.take(2);
    bench.report(1, lost, panicked("late"));
    assert_eq!(bench.poll(2, &[again], 0).revoked, []);
    bench.report(2, again, panicked("first"));
    let third = bench.take(1);
    bench.report(1, third, panicked("second"));
    assert_eq!(bench.scheduler.failed(), None, "two failures of three");
    let fourth = bench.take(2);
    bench.report(2, fourth, panicked("third"));
    assert_eq!(bench.scheduler.failed().unwrap().failures.len(), 3);
}

#[test]
fn lost_workers_are_no_failures_of_their_jobs_until_there_are_very_many() {
    let mut bench = Bench::new(0);
    bench.submit();
    for number in 1..=LIMITS.max_losses as u8 {
        assert_eq!(bench.scheduler.failed(), None, "after {} losses", number - 1);
        bench.join(number).unwrap();
        bench.take(number);
        bench.pass(31);
    }
    assert_eq!(bench.scheduler.failed().unwrap().failures.len(), LIMITS.max_losses as usize);
}

#[test]
fn a_job_that_hangs_on_a_living_worker_goes_to_another_and_either_answer_counts() {
    let mut bench = Bench::new(2);
    let job = bench.submit();
    let hanging = bench.take(1);
    for _ in 0..21 {
        bench.pass(29);
        assert!(bench.departures().is_empty(), "both workers poll");
        bench.poll(1, &[hanging], 1);
        let later = bench.poll(2, &[], 1);
        if let Some((lease, _)) = later.jobs.first() {
            assert_eq!(*lease, bench.lease(2, job, 2));
            assert_eq!(bench.poll(1, &[hanging], 1).revoked, [hanging], "it is not given back to who hangs");
            bench.report(1, hanging, good());
            assert_eq!(bench.scheduler.drain_finished()[0].attempt, 1);
            return;
        }
    }
    panic!("the job was never given to another worker");
}

#[test]
fn answers_to_attempts_that_were_never_handed_out_or_to_others_are_ignored() {
    let mut bench = Bench::new(1);
    let job = bench.submit();
    for attempt in [0, 1, 7] {
        bench.report(1, Lease { job, attempt, nonce: LeaseNonce::default() }, good());
        bench.report(1, bench.lease(2, job, attempt), good());
    }
    assert!(bench.scheduler.drain_finished().is_empty());
    assert_eq!(bench.take(1), bench.lease(1, job, 1));
}

#[test]
fn losing_the_last_worker_starts_a_grace_and_never_having_had_one_does_not() {
    let mut bench = Bench::new(0);
    bench.pass(1_000);
    assert_eq!(bench.scheduler.staffing(bench.now), Staffing::NotYet);
    bench.join(1).unwrap();
    assert_eq!(bench.scheduler.staffing(bench.now), Staffing::Staffed);
    bench.pass(31);
    bench.pass(100);
    assert_eq!(bench.scheduler.staffing(bench.now), Staffing::Lost(Duration::from_secs(100)));
    bench.pass(201);
    assert_eq!(bench.scheduler.staffing(bench.now), Staffing::GraceOver);
    bench.join(2).unwrap();
    assert_eq!(bench.scheduler.staffing(bench.now), Staffing::Staffed);
}

#[test]
fn nobody_takes_a_job_ahead_while_another_has_none() {
    let mut bench = Bench::new(2);
    for _ in 0..2 {
        bench.submit();
    }
    let first = bench.poll(1, &[], 2).jobs;
    assert_eq!(first.len(), 1);
    assert_eq!(bench.poll(2, &[], 2).jobs.len(), 1);
    for _ in 0..2 {
        bench.submit();
    }
    // Now both have one, and may take the next ahead.
    assert_eq!(bench.poll(1, &[first[0].0], 1).jobs.len(), 1);
}

#[test]
fn a_job_that_takes_long_is_not_taken_ahead() {
    for (milliseconds, ahead) in [(100, 1), (101, 0)] {
        let mut bench = Bench::new(1);
        bench.submit();
        let lease = bench.take(1);
        bench.now += Duration::from_millis(milliseconds);
        bench.report(1, lease, good());
        for _ in 0..3 {
            bench.submit();
        }
        assert_eq!(bench.poll(1, &[], 2).jobs.len(), 1 + ahead, "{milliseconds} ms");
    }
}

/// How often one of four workers has nothing to do, while each client has generations of five made, one after another.
fn idle_turns(clients: u32) -> usize {
    let mut bench = Bench::new(4);
    let mut runs: Vec<(ClientId, u32, BTreeSet<JobId>)> =
        (1..=clients).map(|client| (ClientId::new(client), 6, BTreeSet::new())).collect();
    let mut idle = 0;
    loop {
        for (client, generations, open) in &mut runs {
            if open.is_empty() && *generations > 0 {
                *generations -= 1;
                *open = (0..5).map(|_| bench.submit_for(*client)).collect();
            }
        }
        if runs.iter().all(|(_, _, open)| open.is_empty()) {
            return idle;
        }
        let leases = [1, 2, 3, 4].map(|worker| (worker, bench.poll(worker, &[], 1).jobs.pop()));
        for (worker, leased) in leases {
            let Some((lease, _)) = leased else {
                idle += 1;
                continue;
            };
            bench.report(worker, lease, good());
            runs.iter_mut().for_each(|(_, _, open)| open.retain(|job| *job != lease.job));
        }
    }
}

#[test]
fn clients_fill_each_others_gaps_at_the_ends_of_generations() {
    assert_eq!(idle_turns(1), 18, "the fifth of each generation leaves three without");
    assert!(idle_turns(4) < 4, "{}", idle_turns(4));
}

#[test]
fn a_job_that_another_asks_for_too_is_handed_out_as_early_as_for_the_one_that_waits_less() {
    let mut bench = Bench::new(1);
    let jobs: Vec<JobId> = (0..20).map(|_| bench.submit()).collect();
    bench.scheduler.share(jobs[15], ClientId::new(2), bench.now);
    bench.scheduler.check_invariants();
    let order: Vec<JobId> = bench.poll(1, &[], 20).jobs.iter().map(|(lease, _)| lease.job).collect();
    assert_eq!((order.len(), order[1]), (20, jobs[15]));
}

#[test]
fn a_pause_of_the_coordinator_is_not_held_against_its_workers() {
    let mut bench = Bench::new(1);
    bench.submit();
    let lease = bench.take(1);
    bench.pass(20);
    bench.now += Duration::from_secs(100_000);
    bench.scheduler.expire(bench.now);
    assert_eq!(bench.labels(), ["host"]);
    assert!(bench.poll(1, &[lease], 0).revoked.is_empty());
    bench.pass(31);
    assert!(bench.labels().is_empty(), "silence while the coordinator listens counts");
}

#[test]
fn time_in_the_queue_does_not_count_against_a_job() {
    let mut bench = Bench::new(1);
    for _ in 0..2 {
        bench.submit();
    }
    let jobs = bench.poll(1, &[], 2).jobs;
    let (first, second) = (jobs[0].0, jobs[1].0);
    let work = |bench: &mut Bench, held: &[Lease], seconds: u64| {
        for _ in 0..seconds / 20 {
            bench.pass(20);
            bench.poll(1, held, 0);
        }
    };
    work(&mut bench, &[first, second], 500);
    bench.report(1, first, good());
    bench.poll(1, &[second], 0);
    work(&mut bench, &[second], 500);
    assert!(bench.poll(1, &[second], 0).revoked.is_empty());
    bench.report(1, second, good());
    assert_eq!(bench.scheduler.drain_finished().len(), 2);
}

#[test]
fn registrations_are_bounded() {
    let mut bench = Bench::new(4);
    bench.scheduler.limits.max_workers = 4;
    assert_eq!(bench.join(5), Err(RegisterRefusal::Full));
    assert_eq!(bench.join(4).as_deref(), Ok("host-4"));
}

#[derive(Clone, Debug)]
enum Step {
    Poll { worker: u8, forget: bool, deliver: bool, wanted: usize },
    Silence,
    Join(u8),
    Leave(u8),
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        8 => (1..4u8, any::<bool>(), any::<bool>(), 0..3usize)
            .prop_map(|(worker, forget, deliver, wanted)| Step::Poll { worker, forget, deliver, wanted }),
        1 => Just(Step::Silence),
        2 => (1..4u8).prop_map(Step::Join),
        1 => (1..4u8).prop_map(Step::Leave),
    ]
}

proptest! {
    /// Lost replies, silence, departures and returns in any order: each job is answered exactly once.
    #[test]
    fn every_job_is_answered_exactly_once(steps in prop::collection::vec(step(), 1..200)) {
        let limits = Limits { max_failures: u32::MAX, ..LIMITS };
        let mut bench = Bench::new(3);
        bench.scheduler.limits = limits;
        let jobs: BTreeSet<JobId> = (0..8).map(|_| bench.submit()).collect();
        let mut held: [Vec<Lease>; 4] = Default::default();
        let mut answered = Vec::new();
        // After the random part, worker 1 alone finishes what is left.
        let cleanup = (0..40).flat_map(|_| [
            Step::Join(1),
            Step::Silence,
            Step::Join(1),
            Step::Poll { worker: 1, forget: false, deliver: true, wanted: 1 },
        ]);
        for step in steps.into_iter().chain(cleanup) {
            match step {
                Step::Poll { worker, forget, deliver, wanted } => {
                    let mine = &mut held[worker as usize];
                    let finished = if deliver { mine.pop() } else { None };
                    let reports = finished
                        .iter()
                        .map(|lease| Report { lease: *lease, run_seconds: 0.0, outcome: good() })
                        .collect();
                    let poll = Poll { held: mine.clone(), finished: reports, wanted, ..Poll::default() };
                    if let Ok(answer) = bench.try_poll(worker, poll) {
                        let mine = &mut held[worker as usize];
                        mine.retain(|lease| !answer.revoked.contains(lease));
                        if !forget {
                            mine.extend(answer.jobs.iter().map(|(lease, _)| *lease));
                        }
                    }
                }
                Step::Silence => bench.pass(31),
                Step::Join(worker) => { let _ = bench.join(worker); }
                Step::Leave(worker) => {
                    let _ = bench.try_poll(worker, Poll { leaving: true, ..Poll::default() });
                    held[worker as usize].clear();
                }
            }
            answered.extend(bench.scheduler.drain_finished().into_iter().map(|finished| finished.job));
            bench.scheduler.check_invariants();
        }
        let unique: BTreeSet<JobId> = answered.iter().copied().collect();
        prop_assert_eq!(answered.len(), unique.len());
        prop_assert_eq!(unique, jobs);
    }
}
