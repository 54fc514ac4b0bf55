//! Sick workers beside healthy ones: whose failures count against a job.

use super::opinions::{audited, lie};
use super::*;

/// Has a worker take a job, if it is given one, and fail at it.
fn fail_next(bench: &mut Bench, number: u8) -> bool {
    let jobs = bench.poll(number, &[], 1).jobs;
    if let Some((lease, _)) = jobs.first() {
        bench.report(number, *lease, panicked("out of memory"));
    }
    !jobs.is_empty()
}

/// Has the first worker answer a job, and returns what was accepted.
fn answered(bench: &mut Bench) -> Finished {
    bench.submit();
    let lease = bench.take(1);
    bench.report(1, lease, good());
    bench.scheduler.drain_finished().remove(0)
}

#[test]
fn three_sick_workers_beside_two_healthy_do_not_end_a_run_and_get_no_more_jobs() {
    let mut bench = Bench::new(5);
    let mut open: BTreeSet<JobId> = (0..40).map(|_| bench.submit()).collect();
    let mut failures = 0;
    for _ in 0..200 {
        // The sick are quick.
        for number in [1, 2, 3] {
            while fail_next(&mut bench, number) {
                failures += 1;
            }
        }
        for number in [4, 5] {
            for (lease, _) in bench.poll(number, &[], 1).jobs {
                bench.report(number, lease, good());
            }
        }
        for finished in bench.scheduler.drain_finished() {
            open.remove(&finished.job);
        }
        bench.now += Duration::from_millis(10);
    }
    assert_eq!((bench.scheduler.failed(), open.len()), (None, 0));
    assert_eq!(failures, 9, "three each");
    let excluded = |event: &Emitted| matches!(event.kind, EventKind::Excluded { seconds: 60, .. });
    assert_eq!(bench.scheduler.drain_events().iter().filter(|event| excluded(event)).count(), 3);
}

#[test]
fn a_new_id_of_a_principal_that_was_excluded_has_one_try() {
    let mut bench = Bench::new(2);
    for _ in 0..20 {
        bench.submit();
    }
    while fail_next(&mut bench, 1) {}
    bench.join_as(3, principal(1)).unwrap();
    assert!(fail_next(&mut bench, 3));
    assert!(!fail_next(&mut bench, 3));
    // Exclusion goes by worker: one that is well goes on.
    bench.join_as(4, principal(1)).unwrap();
    let lease = bench.take(4);
    bench.report(4, lease, good());
    assert!(fail_next(&mut bench, 4), "one failure after a success");
    assert!(!bench.poll(4, &[], 1).jobs.is_empty());
}

#[test]
fn a_job_that_fails_on_as_many_as_have_computed_others_fails_for_good() {
    let mut bench = Bench::new(5);
    for number in 1..=5 {
        bench.submit();
        let lease = bench.take(number);
        bench.report(number, lease, good());
    }
    bench.submit();
    for number in 1..=LIMITS.max_failures as u8 {
        assert_eq!(bench.scheduler.failed(), None);
        assert!(fail_next(&mut bench, number));
    }
    assert_eq!(bench.scheduler.failed().unwrap().failures.len(), LIMITS.max_failures as usize);
}

#[test]
fn a_principal_under_three_names_does_not_end_a_run_that_another_could_do() {
    let mut bench = Bench::new(2);
    for number in [3, 4] {
        bench.join_as(number, principal(1)).unwrap();
    }
    for number in [1, 3, 4] {
        bench.submit();
        let lease = bench.take(number);
        bench.report(number, lease, good());
    }
    bench.scheduler.drain_finished();
    bench.submit();
    for number in [1, 3, 4] {
        assert!(fail_next(&mut bench, number));
    }
    assert_eq!(bench.scheduler.failed(), None);
    // Where nobody else is here, three workers that have computed others are enough.
    let mut alone = bench;
    assert!(fail_next(&mut alone, 2));
    assert_eq!(alone.scheduler.failed().unwrap().failures.len(), 4);
}

#[test]
fn of_one_principal_alone_as_many_workers_as_have_computed_others_are_enough() {
    let mut bench = Bench::new(1);
    for number in [2, 3, 4] {
        bench.join_as(number, principal(1)).unwrap();
    }
    for number in [1, 2, 3] {
        bench.submit();
        let lease = bench.take(number);
        bench.report(number, lease, good());
    }
    bench.submit();
    for number in [1, 2, 3] {
        assert_eq!(bench.scheduler.failed(), None);
        assert!(fail_next(&mut bench, number));
    }
    assert_eq!(bench.scheduler.failed().unwrap().failures.len(), 3);
}

#[test]
fn a_confirmation_that_has_failed_is_tried_again_where_only_the_own_worker_may_answer() {
    let mut bench = Bench::new(2);
    bench.join_as(9, Principal::Coordinator).unwrap();
    let accepted = answered(&mut bench);
    bench.scheduler.confirm(&evaluation(), &accepted, ClientId::new(1), bench.now);
    assert!(fail_next(&mut bench, 9));
    assert!(bench.scheduler.in_doubt(|_| false));
    let lease = bench.take(9);
    bench.report(9, lease, good());
    assert!(!bench.scheduler.in_doubt(|_| false));
}

#[test]
fn what_the_own_worker_cannot_confirm_is_confirmed_by_a_second_principal() {
    let mut bench = Bench::new(2);
    bench.join_as(9, Principal::Coordinator).unwrap();
    let job = bench.submit();
    let lease = bench.take(1);
    bench.report(1, lease, good());
    let accepted = bench.scheduler.drain_finished().remove(0);
    bench.scheduler.confirm(&evaluation(), &accepted, ClientId::new(1), bench.now);
    assert!(bench.poll(2, &[], 1).jobs.is_empty(), "the own one is asked");
    for _ in 0..LIMITS.max_failures {
        assert!(fail_next(&mut bench, 9));
    }
    assert!(bench.scheduler.in_doubt(|_| false), "nobody has confirmed it");
    let lease = bench.take(2);
    assert_eq!(lease.job, job);
    bench.report(2, lease, good());
    assert!(!bench.scheduler.in_doubt(|_| false));
    assert_eq!(bench.scheduler.drain_confirmed()[0].assurance, Assurance::Audited);
}

/// Nobody is asked without end, and the run goes on with the answer that there is, as where nobody else is here.
#[test]
fn a_second_answer_that_nobody_can_give_is_not_waited_for() {
    for is_delivered in [false, true] {
        let mut bench = audited(1);
        if !is_delivered {
            bench.join(2).unwrap();
        }
        let job = bench.submit();
        let lease = bench.take(1);
        bench.report(1, lease, good());
        let accepted = bench.scheduler.drain_finished();
        assert_eq!(accepted.len(), usize::from(is_delivered));
        if is_delivered {
            bench.join(2).unwrap();
            assert!(bench.scheduler.in_doubt(|_| false));
        }
        let mut failures = 0;
        for _ in 0..50 {
            failures += u32::from(fail_next(&mut bench, 2));
            bench.pass(1);
            bench.poll(1, &[], 0);
        }
        assert_eq!(failures, LIMITS.max_failures);
        assert_eq!((bench.scheduler.failed(), bench.scheduler.in_doubt(|_| false)), (None, false));
        let accepted = bench.scheduler.drain_finished();
        assert_eq!(
            accepted.iter().map(|one| one.job).collect::<Vec<_>>(),
            [job][usize::from(is_delivered)..]
        );
        assert!(accepted.iter().all(|one| one.assurance == Assurance::Owed));
        // Whoever comes may give it.
        bench.join(3).unwrap();
        let lease = bench.take(3);
        assert_eq!(lease.job, job);
        bench.report(3, lease, good());
        assert_eq!(bench.scheduler.drain_confirmed()[0].assurance, Assurance::Audited);
    }
}

#[test]
fn sick_machines_of_a_principal_leave_a_second_answer_to_its_healthy_ones() {
    let mut bench = audited(2);
    let healthy = 2 + LIMITS.max_failures as u8;
    for number in 3..=healthy {
        bench.join_as(number, principal(2)).unwrap();
    }
    bench.submit();
    let lease = bench.take(1);
    for number in 2..healthy {
        assert!(fail_next(&mut bench, number));
    }
    bench.report(1, lease, good());
    assert!(bench.scheduler.drain_finished().is_empty(), "one of them has not tried");
    let lease = bench.take(healthy);
    bench.report(healthy, lease, good());
    assert_eq!(bench.scheduler.drain_finished()[0].assurance, Assurance::Audited);
}

#[test]
fn a_second_answer_that_brings_workers_down_does_not_end_a_run() {
    let mut bench = audited(1);
    bench.submit();
    let lease = bench.take(1);
    bench.report(1, lease, good());
    bench.scheduler.drain_finished();
    let mut losses = 0;
    for number in 2..250 {
        bench.join_as(number, principal(2)).unwrap();
        if bench.poll(number, &[], 1).jobs.is_empty() {
            break;
        }
        losses += 1;
        bench.scheduler.remove_worker(worker(number), Departure::Lost, bench.now);
        bench.scheduler.check_invariants();
    }
    assert_eq!(losses, LIMITS.max_losses);
    assert_eq!(bench.scheduler.failed(), None);
}

#[test]
fn what_the_own_worker_cannot_confirm_it_is_not_asked_again() {
    let mut bench = Bench::new(1);
    bench.join_as(9, Principal::Coordinator).unwrap();
    let accepted = answered(&mut bench);
    for _ in 0..2 {
        bench.scheduler.confirm(&evaluation(), &accepted, ClientId::new(1), bench.now);
        while fail_next(&mut bench, 9) {}
        bench.scheduler.check_invariants();
        assert!(!bench.scheduler.in_doubt(|_| true), "nobody could end it");
    }
}

#[test]
fn whoever_fails_at_a_second_answer_keeps_it_from_nobody() {
    let mut bench = audited(3);
    bench.submit();
    let lease = bench.take(1);
    bench.report(1, lease, lie());
    // Whoever has tried may try again only after everybody else.
    assert!(fail_next(&mut bench, 2) && fail_next(&mut bench, 3));
    for _ in 1..LIMITS.max_failures {
        assert!(fail_next(&mut bench, 2));
    }
    assert!(!fail_next(&mut bench, 2));
    assert!(bench.scheduler.drain_finished().is_empty(), "a third is here");
    let lease = bench.take(3);
    bench.report(3, lease, good());
    assert!(bench.scheduler.drain_finished().is_empty(), "two differ");
    bench.join_as(9, Principal::Coordinator).unwrap();
    let lease = bench.take(9);
    bench.report(9, lease, good());
    assert_eq!(Ok(bench.scheduler.drain_finished().remove(0).result), good());
}

#[test]
fn a_worker_that_takes_a_job_again_and_again_does_not_keep_it_from_others() {
    let mut bench = Bench::new(2);
    let job = bench.submit();
    let mut polls = 0;
    // Each poll drops what the last one was given, and asks for more.
    while !bench.poll(1, &[], 1).jobs.is_empty() {
        polls += 1;
        bench.now += Duration::from_millis(1);
        assert!(polls < 20, "for ever");
    }
    assert!(polls > 3, "a reply that is lost now and then is no fault");
    let lease = bench.take(2);
    assert_eq!(lease.job, job);
    bench.report(2, lease, good());
    assert_eq!((bench.scheduler.drain_finished().len(), bench.scheduler.failed()), (1, None));
    // It gets jobs again after a while.
    bench.submit();
    for _ in 0..70 {
        bench.poll(1, &[], 0);
        bench.poll(2, &[], 0); // who is left: it is not for want of others
        bench.pass(1);
    }
    bench.take(1);
}

#[test]
fn where_everybody_fails_nobody_is_waited_for() {
    let mut bench = Bench::new(4);
    for _ in 0..8 {
        bench.submit();
    }
    for _ in 0..100 {
        for number in 1..=4 {
            fail_next(&mut bench, number);
        }
    }
    assert!(bench.scheduler.failed().is_some());

    let mut alone = Bench::new(1);
    alone.submit();
    for _ in 0..LIMITS.max_failures {
        assert!(fail_next(&mut alone, 1));
    }
    assert!(alone.scheduler.failed().is_some());
}

#[test]
fn the_last_that_has_not_tried_may_go() {
    let mut bench = Bench::new(4);
    bench.submit();
    for number in [1, 2, 3] {
        fail_next(&mut bench, number);
    }
    assert_eq!(bench.scheduler.failed(), None);
    bench.try_poll(4, Poll { leaving: true, ..Poll::default() }).unwrap();
    bench.pass(1);
    assert!(bench.scheduler.failed().is_some());
}
