//! Second and third opinions: hedges, audits, disagreements, quarantine.

use super::*;

/// A valid result that is wrong.
pub(super) fn lie() -> Result<TaskResult, Failure> {
    Ok(TaskResult::Evaluation(EvaluationResult {
        queries: 10,
        object_correct: 5,
        category_correct: 6,
        ..EvaluationResult::default()
    }))
}

/// A bench where everything is audited.
pub(super) fn audited(workers: u8) -> Bench {
    let mut bench = Bench::new(workers);
    bench.scheduler.trust = Trust::new(Audit { share: 1.0, first: 0 });
    bench
}

/// How the attempts that are over by now have ended.
fn ends(bench: &mut Bench) -> Vec<AttemptEnd> {
    let end = |event: Emitted| match event.kind {
        EventKind::Attempt(attempt) => Some(attempt.end),
        _ => None,
    };
    bench.scheduler.drain_events().into_iter().filter_map(end).collect()
}

fn said(bench: &mut Bench, is_it: impl Fn(&EventKind) -> bool) -> usize {
    bench.scheduler.drain_events().iter().filter(|event| is_it(&event.kind)).count()
}

#[test]
fn a_job_that_takes_too_long_is_given_to_an_idle_worker_too_and_the_first_answer_counts() {
    let mut bench = Bench::new(2);
    for _ in 0..3 {
        bench.submit();
    }
    let quick = bench.take(1);
    let slow = bench.take(2);
    bench.pass(10);
    bench.report(1, quick, good());
    let third = bench.take(1);
    bench.pass(4);
    bench.report(1, third, good());
    // The median is 10 s: after 14 s nothing is late, after 15 s it is.
    assert!(bench.poll(1, &[], 2).jobs.is_empty());
    bench.pass(1);
    assert_eq!(bench.scheduler.wake(bench.now), [worker(1)]);
    let again = bench.scheduler.lease_later(bench.caller(1), bench.sequence, 2, bench.now).unwrap()[0].0;
    assert_eq!(again, bench.lease(1, slow.job, 2));
    bench.scheduler.drain_finished();
    bench.report(1, again, good());
    assert_eq!(bench.scheduler.drain_finished()[0].attempt, 2);
    assert!(bench.poll(2, &[slow], 0).revoked.is_empty(), "it cannot drop what it computes");
    ends(&mut bench);
    bench.report(2, slow, good());
    assert_eq!(ends(&mut bench), [AttemptEnd::Agreed]);
    assert!(bench.scheduler.drain_finished().is_empty() && bench.scheduler.jobs.is_empty());
}

/// A worker with two jobs, and a second with a lease on the one that waits.
fn one_behind_another() -> (Bench, Vec<(Lease, Arc<Task>)>, Lease) {
    let mut bench = Bench::new(1);
    for _ in 0..2 {
        bench.submit();
    }
    let jobs = bench.poll(1, &[], 2).jobs;
    bench.join(2).unwrap();
    let again = bench.take(2);
    (bench, jobs, again)
}

#[test]
fn a_job_that_waits_behind_another_is_given_to_an_idle_worker_at_once_and_revoked_when_answered() {
    let (mut bench, jobs, again) = one_behind_another();
    assert_eq!(again, bench.lease(2, jobs[1].0.job, 2));
    bench.report(2, again, good());
    let held: Vec<Lease> = jobs.iter().map(|(lease, _)| *lease).collect();
    assert_eq!(bench.poll(1, &held, 0).revoked, [jobs[1].0]);
    assert_eq!(ends(&mut bench), [AttemptEnd::Answered, AttemptEnd::Revoked]);
}

#[test]
fn an_audited_job_is_done_when_two_workers_agree() {
    let mut bench = audited(2);
    bench.submit();
    let (first, second) = (bench.take(1), bench.take(2));
    bench.report(1, first, good());
    assert!(bench.scheduler.drain_finished().is_empty());
    bench.report(2, second, good());
    let finished = bench.scheduler.drain_finished();
    assert_eq!((finished[0].worker.as_str(), finished[0].attempt), ("host", 1));
    assert_eq!(ends(&mut bench), [AttemptEnd::Answered, AttemptEnd::Agreed]);
}

#[test]
fn where_two_workers_differ_a_third_decides_and_the_odd_one_is_quarantined() {
    let mut bench = audited(3);
    bench.submit();
    let (lied, other) = (bench.take(1), bench.take(2));
    bench.report(1, lied, lie());
    bench.report(2, other, good());
    assert!(bench.scheduler.drain_finished().is_empty());
    let decides = bench.take(3);
    bench.report(3, decides, good());
    let finished = bench.scheduler.drain_finished();
    assert_eq!((Ok(finished[0].result.clone()), finished[0].worker.as_str()), (good(), "host-2"));
    assert_eq!(bench.departures(), [("host".to_owned(), Departure::Quarantined)]);
    assert_eq!(bench.try_poll(1, Poll::default()).unwrap_err(), PollRefusal::Quarantined);
    assert_eq!(bench.join(1), Err(RegisterRefusal::Quarantined));
    assert_eq!(bench.labels(), ["host-2", "host-3"]);
}

#[test]
fn no_answer_of_a_quarantined_worker_counts() {
    let mut bench = audited(3);
    let (first, second) = (bench.submit(), bench.submit());
    let leases = bench.poll(1, &[], 1).jobs;
    bench.report(1, leases[0].0, lie());
    let agrees = bench.take(1);
    bench.report(1, agrees, good());
    for number in [2, 3] {
        let lease = bench.take(number);
        assert_eq!(lease.job, first);
        bench.report(number, lease, good());
    }
    assert_eq!(bench.departures(), [("host".to_owned(), Departure::Quarantined)]);
    bench.scheduler.drain_finished();
    let lease = bench.take(2);
    bench.report(2, lease, good());
    assert!(bench.scheduler.drain_finished().is_empty(), "one good worker is not two");
    let lease = bench.take(3);
    bench.report(3, lease, good());
    assert_eq!(bench.scheduler.drain_finished()[0].job, second);
}

#[test]
fn an_answer_that_was_accepted_is_taken_back_when_its_hedge_and_a_third_contradict_it() {
    let (mut bench, jobs, again) = one_behind_another();
    let behind = jobs[1].0;
    bench.report(1, jobs[0].0, good());
    bench.poll(1, &[behind], 0);
    bench.report(1, behind, lie());
    assert_eq!(bench.scheduler.drain_finished().len(), 2);
    bench.report(2, again, good());
    assert!(bench.scheduler.in_doubt(|_| false));
    assert_eq!(said(&mut bench, |kind| matches!(kind, EventKind::Disagreement { .. })), 1);
    bench.join(3).unwrap();
    let decides = bench.take(3);
    bench.report(3, decides, good());
    assert_eq!(bench.departures(), [("host".to_owned(), Departure::Quarantined)]);
    assert!(!bench.scheduler.in_doubt(|_| false));
    assert!(bench.scheduler.drain_finished().is_empty(), "who keeps the answers asks again");
}

#[test]
fn a_worker_has_one_vote_and_only_on_what_it_was_given() {
    let mut bench = audited(2);
    let job = bench.submit();
    let (first, second) = (bench.take(1), bench.take(2));
    for lease in [first, first, second, bench.lease(2, job, 3)] {
        bench.report(1, lease, lie());
    }
    assert!(bench.scheduler.drain_finished().is_empty());
    assert_eq!(bench.scheduler.jobs.get(job).unwrap().votes.len(), 1);
}

/// The leases of workers of one principal on the only job. Each drops what it was given, so that the next may take it, and
/// may report all the same.
fn taken_under_many_names(bench: &mut Bench) -> Vec<(u8, Lease)> {
    let take = |number| {
        bench.join_as(number, principal(1)).unwrap();
        let lease = bench.take(number);
        bench.poll(number, &[], 0);
        (number, lease)
    };
    (3..30).map(take).collect()
}

#[test]
fn a_principal_that_contradicts_itself_without_end_has_two_votes() {
    let mut bench = audited(2);
    let job = bench.submit();
    for (number, lease) in taken_under_many_names(&mut bench) {
        let result = EvaluationResult {
            queries: 10,
            object_correct: u32::from(number % 10),
            category_correct: 10,
            ..EvaluationResult::default()
        };
        bench.report(number, lease, Ok(TaskResult::Evaluation(result)));
    }
    assert_eq!(bench.scheduler.jobs.get(job).unwrap().votes.len(), 2);
    assert!(bench.scheduler.drain_finished().is_empty());
}

#[test]
fn whoever_asks_for_nothing_is_not_waited_for_until_it_asks_again() {
    let mut bench = audited(2);
    let job = bench.submit();
    let lease = bench.take(1);
    bench.report(1, lease, good());
    let mut seconds = 0;
    let finished = loop {
        bench.poll(1, &[], 1);
        bench.poll(2, &[], 0); // busy with something of before, it seems
        bench.pass(1);
        seconds += 1;
        let finished = bench.scheduler.drain_finished();
        if !finished.is_empty() {
            break finished;
        }
        assert!(seconds < 2 * LIMITS.job.as_secs(), "for ever");
    };
    assert!(seconds >= LIMITS.job.as_secs(), "{seconds}");
    assert_eq!((finished[0].job, finished[0].assurance), (job, Assurance::Owed));
    assert!(!bench.scheduler.in_doubt(|_| false), "nobody could end it");
    let lease = bench.take(2);
    assert_eq!(lease.job, job);
    bench.report(2, lease, good());
    assert_eq!(bench.scheduler.drain_confirmed()[0].assurance, Assurance::Audited);
}

#[test]
fn a_principal_has_one_vote_for_a_result_under_however_many_names() {
    let mut bench = audited(2);
    let job = bench.submit();
    for (number, lease) in taken_under_many_names(&mut bench) {
        bench.report(number, lease, good());
        bench.report(number, lease, lie()); // a worker answers once
    }
    assert_eq!(bench.scheduler.jobs.get(job).unwrap().votes.len(), 1);
    assert!(bench.scheduler.drain_finished().is_empty());
    let lease = bench.take(2);
    bench.report(2, lease, good());
    assert_eq!(bench.scheduler.drain_finished()[0].assurance, Assurance::Audited);
}

#[test]
fn a_single_worker_is_believed_until_another_joins() {
    let mut bench = audited(1);
    for _ in 0..2 {
        bench.submit();
    }
    let first = bench.take(1);
    bench.report(1, first, good());
    let second = bench.take(1);
    bench.report(1, second, lie());
    assert_eq!(bench.scheduler.drain_finished().len(), 2);
    assert!(!bench.scheduler.in_doubt(|_| false), "there is nobody who could tell");
    assert_eq!(said(&mut bench, |kind| matches!(kind, EventKind::Unaudited)), 1, "once for both");
    bench.join(2).unwrap();
    assert!(bench.scheduler.in_doubt(|_| false));
    let checks = bench.poll(2, &[], 2).jobs;
    assert_eq!(checks[0].0, bench.lease(2, first.job, 2));
    bench.report(2, checks[0].0, good());
    let check = bench.take(2);
    bench.report(2, check, good());
    bench.join(3).unwrap();
    let decides = bench.take(3);
    bench.report(3, decides, good());
    assert_eq!(bench.departures(), [("host".to_owned(), Departure::Quarantined)]);
    assert!(!bench.scheduler.in_doubt(|_| false));
}

#[test]
fn what_waits_for_a_second_opinion_is_done_when_the_last_other_worker_goes() {
    let mut bench = audited(2);
    bench.submit();
    let first = bench.take(1);
    bench.take(2);
    bench.report(1, first, good());
    assert!(bench.scheduler.drain_finished().is_empty());
    bench.try_poll(2, Poll { leaving: true, ..Poll::default() }).unwrap();
    assert_eq!(bench.scheduler.drain_finished().len(), 1);
}

#[test]
fn two_workers_that_differ_wait_for_a_third_no_longer_than_the_grace() {
    let mut bench = audited(2);
    bench.submit();
    let (first, second) = (bench.take(1), bench.take(2));
    bench.report(1, first, good());
    bench.report(2, second, lie());
    let mut wait = |seconds: u64| {
        for _ in 0..seconds / 20 {
            bench.pass(20);
            bench.poll(1, &[], 0);
            bench.poll(2, &[], 0);
        }
        (
            bench.scheduler.staffing(bench.now),
            said(&mut bench, |kind| matches!(kind, EventKind::Undecided { .. })),
        )
    };
    assert_eq!(wait(300), (Staffing::Staffed, 1));
    assert_eq!(wait(20), (Staffing::Undecided, 0));
    bench.join(3).unwrap();
    bench.pass(1);
    assert_eq!(bench.scheduler.staffing(bench.now), Staffing::Staffed);
}

#[test]
fn workers_that_idle_for_want_of_jobs_are_reported_now_and_then() {
    let mut bench = Bench::new(2);
    bench.submit();
    let lease = bench.take(1);
    bench.poll(2, &[], 1);
    let mut reports = 0;
    for _ in 0..15 {
        bench.pass(10);
        bench.poll(1, &[lease], 0);
        bench.poll(2, &[], 1);
        reports += said(&mut bench, |kind| matches!(kind, EventKind::Starving { idle: 1, unfinished: 1 }));
    }
    assert_eq!(reports, 2, "after 10 s and 120 s more");
}
