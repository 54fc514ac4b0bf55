//! A scheduler that goes on where an earlier start of the coordinator ended.

use super::*;
use crate::journal::Recorded;
use proto::journal::{AcceptedResult, Member};

fn answered((label, number): (&str, u8)) -> AcceptedResult {
    let result = EvaluationResult {
        queries: 10,
        object_correct: 4,
        category_correct: 6,
        ..EvaluationResult::default()
    };
    AcceptedResult {
        result: TaskResult::Evaluation(result),
        worker_id: worker(number),
        worker: label.to_owned(),
        principal: principal(number),
        seconded: None,
        assurance: Assurance::Unaudited,
        attempt: 1,
        queued: Duration::ZERO,
        run_seconds: 1.0,
    }
}

/// A scheduler that goes on: worker 1 was there, and held attempt 2 of the job that is submitted next.
fn resumed() -> (Bench, Lease) {
    let mut bench = Bench::new(0);
    let lease = bench.lease(1, evaluation().job(0), 2);
    let introduction = Introduction::sample("host", 1);
    let member = Member { label: "host".to_owned(), introduction };
    let mut recorded = Recorded {
        members: [(worker(1), member)].into(),
        leases: vec![(lease.job, 1, worker(9)), (lease.job, 2, worker(1))],
        ..Recorded::default()
    };
    // A worker that has reported and gone, and one that was wrong.
    recorded.quarantined = [principal(8)].into();
    recorded.accepted = [JobId(1), JobId(2)]
        .into_iter()
        .zip([("host", 1), ("host-2", 9)].map(|one| Box::new(answered(one))))
        .collect();
    bench.scheduler.restore(&recorded, bench.now);
    bench.scheduler.jobs.restore(recorded);
    assert_eq!(bench.submit(), lease.job);
    (bench, lease)
}

#[test]
fn a_lease_of_an_earlier_start_stays_with_its_worker() {
    let (mut bench, lease) = resumed();
    bench.join(2).unwrap();
    assert!(bench.poll(2, &[], 1).jobs.is_empty());
    let answer = bench.poll(1, &[lease], 0);
    assert!(answer.revoked.is_empty());
    bench.report(1, lease, good());
    let finished = bench.scheduler.drain_finished();
    assert_eq!((finished[0].worker.as_str(), finished[0].attempt), ("host", 2));
}

#[test]
fn a_worker_that_does_not_come_back_after_a_restart_loses_its_lease_and_attempts_go_on() {
    let (mut bench, lease) = resumed();
    bench.join(2).unwrap();
    for _ in 0..=LIMITS.lease.as_secs() {
        bench.poll(2, &[], 0);
        bench.pass(1);
    }
    assert_eq!(bench.take(2), bench.lease(2, lease.job, 3));
    // Names under which results are recorded are not given again.
    assert_eq!(bench.join(3).as_deref(), Ok("host-4"));
}

#[test]
fn a_worker_that_was_quarantined_before_a_restart_stays_so() {
    let (mut bench, _) = resumed();
    assert_eq!(bench.join(8).unwrap_err(), RegisterRefusal::Quarantined);
    bench.join(7).unwrap();
}

#[test]
fn after_a_restart_trust_is_that_of_before_unless_somebody_was_quarantined() {
    let audited = AcceptedResult { assurance: Assurance::Audited, ..answered(("host", 1)) };
    let accepted = (0..20).map(|job| (JobId(job), Box::new(audited.clone()))).collect();
    let mut recorded = Recorded { accepted, ..Recorded::default() };
    for (quarantined, is_trusted) in [(BTreeSet::new(), true), ([principal(8)].into(), false)] {
        recorded.quarantined = quarantined;
        let mut bench = Bench::new(0);
        bench.scheduler.trust = Trust::new(Audit { share: 0.0, first: 10 });
        bench.scheduler.restore(&recorded, bench.now);
        assert_eq!(bench.scheduler.trust.has_earned(principal(1)), is_trusted);
        assert_eq!(bench.scheduler.trust.audits(principal(1), 0.5), !is_trusted);
    }
}

#[test]
fn a_lease_that_no_start_has_recorded_is_taken_over_and_one_that_nobody_was_granted_is_not() {
    let (mut bench, lease) = resumed();
    bench.poll(1, &[], 0); // it never got the job
    bench.join(2).unwrap();
    let unrecorded = bench.lease(2, lease.job, 300);
    let guessed =
        [Lease { nonce: proto::LeaseNonce([3; 16]), ..unrecorded }, bench.lease(1, lease.job, 3), lease];
    assert_eq!(bench.poll(2, &guessed, 0).revoked, guessed);
    for guessed in guessed {
        bench.report(2, guessed, good());
    }
    assert!(bench.scheduler.drain_finished().is_empty());
    assert!(bench.poll(2, &[unrecorded], 0).revoked.is_empty());
    assert!(bench.poll(1, &[], 1).jobs.is_empty());
    bench.report(2, unrecorded, good());
    assert_eq!(bench.scheduler.drain_finished()[0].attempt, 300);
}
