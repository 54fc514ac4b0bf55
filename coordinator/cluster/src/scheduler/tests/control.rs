//! What an operator orders: who is given jobs, and what stays as it was.

use super::*;

/// How many of so many jobs that a worker asks for one by one are of the first client, which asks without end, as the
/// second does.
fn first_of(bench: &mut Bench, jobs: usize) -> usize {
    let mut first = 0;
    for _ in 0..jobs {
        let lease = bench.take(1);
        first += usize::from(
            bench.scheduler.jobs.get(lease.job).is_some_and(|job| job.clients.contains(&ClientId::new(1))),
        );
        bench.report(1, lease, good());
        bench.scheduler.check_invariants();
    }
    first
}

#[test]
fn jobs_of_a_paused_client_are_not_handed_out_and_those_in_hand_are_accepted() {
    let mut bench = Bench::new(2);
    let [first, second] = [bench.submit(), bench.submit()];
    let other = bench.submit_for(ClientId::new(2));
    let lease = bench.take(1);
    assert_eq!(lease.job, first);
    assert!(bench.scheduler.pause(ClientId::new(1)) && !bench.scheduler.pause(ClientId::new(1)));
    bench.scheduler.check_invariants();
    let answer = bench.report(1, lease, good());
    assert_eq!(answer.acknowledged, [lease]);
    assert_eq!(bench.scheduler.drain_finished().len(), 1);
    let lease = bench.take(1);
    assert_eq!(lease.job, other);
    bench.report(1, lease, good());
    assert!(bench.poll(2, &[], 1).jobs.is_empty());
    assert!(bench.scheduler.wake(bench.now).is_empty());
    // What comes meanwhile waits, too.
    let third = bench.submit();
    bench.pass(20);
    assert!(bench.poll(2, &[], 1).jobs.is_empty());
    bench.scheduler.check_invariants();
    assert!(bench.scheduler.resume(ClientId::new(1)) && !bench.scheduler.resume(ClientId::new(1)));
    bench.scheduler.check_invariants();
    assert_eq!(bench.scheduler.wake(bench.now), [worker(2)]);
    assert_eq!(bench.take(2).job, second);
    assert_eq!(bench.scheduler.jobs.get(third).unwrap().leases, []);
}

#[test]
fn a_job_that_another_client_waits_for_is_handed_out_although_one_is_paused() {
    let mut bench = Bench::new(1);
    let job = bench.submit();
    bench.scheduler.pause(ClientId::new(1));
    bench.scheduler.share(job, ClientId::new(2), bench.now);
    bench.scheduler.check_invariants();
    bench.scheduler.pause(ClientId::new(2));
    assert!(bench.poll(1, &[], 1).jobs.is_empty());
    bench.scheduler.forget_client(ClientId::new(2));
    bench.scheduler.check_invariants();
    assert_eq!(bench.take(1).job, job);
}

#[test]
fn a_job_in_hand_of_a_paused_client_is_not_doubled_when_it_takes_long() {
    let mut bench = Bench::new(2);
    for _ in 0..20 {
        bench.submit();
        let lease = bench.take(1);
        bench.pass(1);
        bench.report(1, lease, good());
    }
    let job = bench.submit();
    let lease = bench.take(1);
    bench.scheduler.pause(ClientId::new(1));
    bench.pass(10);
    bench.poll(1, &[lease], 0);
    assert!(bench.poll(2, &[], 1).jobs.is_empty());
    bench.scheduler.resume(ClientId::new(1));
    assert_eq!(bench.take(2).job, job, "now it is");
}

#[test]
fn workers_are_shared_out_by_priority_at_once_and_a_pause_saves_up_no_turns() {
    let mut bench = Bench::new(1);
    for _ in 0..400 {
        bench.submit_for(ClientId::new(1));
        bench.submit_for(ClientId::new(2));
    }
    assert_eq!(first_of(&mut bench, 40), 20);
    bench.scheduler.set_priority(ClientId::new(1), 3);
    assert_eq!(bench.scheduler.priority(ClientId::new(1)), 3);
    let served = first_of(&mut bench, 40);
    assert!((29..=31).contains(&served), "{served} of 40");
    bench.scheduler.set_priority(ClientId::new(1), 1);
    bench.scheduler.pause(ClientId::new(1));
    assert_eq!(first_of(&mut bench, 40), 0);
    bench.scheduler.resume(ClientId::new(1));
    let served = first_of(&mut bench, 40);
    assert!((19..=21).contains(&served), "{served} of 40");
}

#[test]
fn the_grace_for_lost_workers_stands_still_while_nothing_is_to_be_handed_out() {
    let mut bench = Bench::new(1);
    bench.submit();
    bench.poll(1, &[], 0);
    bench.try_poll(1, Poll { leaving: true, ..Poll::default() }).unwrap();
    let pass = |bench: &mut Bench, seconds: u64, is_halted: bool| {
        for _ in 0..seconds {
            bench.now += Duration::from_secs(1);
            if is_halted {
                bench.scheduler.extend_graces(bench.now);
            }
            bench.scheduler.expire(bench.now);
        }
    };
    pass(&mut bench, 1, false);
    pass(&mut bench, 10_000, true);
    assert_eq!(bench.scheduler.staffing(bench.now), Staffing::Lost(Duration::from_secs(1)));
    pass(&mut bench, LIMITS.worker_grace.as_secs() - 1, false);
    assert_eq!(bench.scheduler.staffing(bench.now), Staffing::Lost(LIMITS.worker_grace));
    pass(&mut bench, 1, false);
    assert_eq!(bench.scheduler.staffing(bench.now), Staffing::GraceOver);
}

#[test]
fn a_drained_worker_ends_what_it_has_and_gets_nothing_until_the_drain_ends() {
    let mut bench = Bench::new(2);
    let [first, second] = [bench.submit(), bench.submit()];
    let lease = bench.take(1);
    let drained = bench.scheduler.drain(worker(1), bench.now);
    assert_eq!(drained, Some(Drained { leases: 1, others: 1 }));
    assert_eq!(bench.scheduler.drain(worker(1), bench.now), None, "it is so already");
    bench.scheduler.check_invariants();
    assert_eq!(bench.poll(1, &[lease], 1).jobs.len(), 0);
    assert_eq!(bench.report(1, lease, good()).acknowledged, [lease]);
    assert_eq!(bench.scheduler.drain_finished()[0].job, first);
    assert!(bench.poll(1, &[], 1).jobs.is_empty());
    bench.scheduler.check_invariants();
    assert_eq!(bench.scheduler.wake(bench.now), [], "not for it");
    let of = |bench: &Bench| {
        let fleet = bench.scheduler.fleet(bench.now, |_| std::time::SystemTime::UNIX_EPOCH);
        fleet.iter().map(|one| (one.draining, one.answers, one.leases.len())).collect::<Vec<_>>()
    };
    assert_eq!(of(&bench), [(true, 1, 0), (false, 0, 0)]);
    assert!(bench.scheduler.end_drain(worker(1)) && !bench.scheduler.end_drain(worker(1)));
    bench.scheduler.check_invariants();
    assert_eq!(bench.scheduler.wake(bench.now), [worker(1)]);
    assert_eq!(bench.take(1).job, second);
    assert_eq!(of(&bench), [(false, 1, 1), (false, 0, 0)]);
}

#[test]
fn a_job_that_failed_or_is_to_be_audited_does_not_wait_for_a_worker_that_is_drained() {
    let mut bench = Bench::new(2);
    bench.submit();
    let lease = bench.take(1);
    bench.report(1, lease, panicked("no memory"));
    assert!(bench.poll(1, &[], 1).jobs.is_empty(), "another has not tried");
    bench.scheduler.drain(worker(2), bench.now);
    let lease = bench.take(1);
    bench.report(1, lease, good());
    assert_eq!(bench.scheduler.drain_finished().len(), 1);

    let limits = Limits { audit: Audit { share: 1.0, first: 0 }, max_workers: 50, ..LIMITS };
    let mut audited =
        Bench { scheduler: Scheduler::new(limits, RunSecret::new([7; 32]), None), ..Bench::new(0) };
    audited.join(1).unwrap();
    audited.join(2).unwrap();
    audited.submit();
    let lease = audited.take(1);
    audited.report(1, lease, good());
    assert!(audited.scheduler.drain_finished().is_empty(), "the other has to agree");
    audited.scheduler.drain(worker(2), audited.now);
    audited.scheduler.check_invariants();
    assert_eq!(audited.scheduler.drain_finished()[0].assurance, Assurance::Owed);
    // It is made up for as soon as the drain ends.
    audited.scheduler.end_drain(worker(2));
    audited.scheduler.check_invariants();
    assert!(audited.scheduler.in_doubt(|_| false));
    let lease = audited.take(2);
    audited.report(2, lease, good());
    assert!(!audited.scheduler.in_doubt(|_| false));
}

#[test]
fn what_only_a_paused_client_has_asked_for_keeps_no_other_in_doubt() {
    let paused = ClientId::new(1);
    let in_doubt = |bench: &Bench| [true, false].map(|concerned| bench.scheduler.in_doubt(|_| concerned));
    let mut bench = Bench::new(1);
    bench.scheduler.trust = Trust::new(Audit { share: 1.0, first: 0 });
    let job = bench.submit_for(paused);
    let lease = bench.take(1);
    bench.report(1, lease, good());
    bench.join(2).unwrap();
    assert_eq!(in_doubt(&bench), [true, true]);
    bench.scheduler.pause(paused);
    assert_eq!(in_doubt(&bench), [true, false]);
    assert!(bench.poll(2, &[], 1).jobs.is_empty());
    bench.scheduler.resume(paused);
    assert_eq!(in_doubt(&bench), [true, true]);
    let lease = bench.take(2);
    assert_eq!(lease.job, job);
    bench.report(2, lease, good());
    assert_eq!(in_doubt(&bench), [false, false]);
}

#[test]
fn exclusions_and_drains_of_one_worker_do_not_undo_each_other() {
    let mut bench = Bench::new(2);
    let fail = |bench: &mut Bench| {
        bench.scheduler.count_failure(
            JobId(0),
            worker(1),
            Failure::new(FailureReason::Panic, "no memory"),
            bench.now,
        );
        bench.scheduler.check_invariants();
    };
    (0..3).for_each(|_| fail(&mut bench));
    assert!(bench.scheduler.fleet(bench.now, |_| std::time::SystemTime::UNIX_EPOCH)[0].excluded);
    bench.scheduler.drain(worker(1), bench.now).unwrap();
    bench.scheduler.check_invariants();
    for _ in 0..61 {
        bench.pass(1);
        for number in [1, 2] {
            bench.scheduler.heard_from((worker(number), principal(number)), bench.now);
        }
        bench.scheduler.check_invariants();
    }
    assert!(!bench.scheduler.fleet(bench.now, |_| std::time::SystemTime::UNIX_EPOCH)[0].excluded);
    fail(&mut bench);
    bench.scheduler.drain(worker(2), bench.now).unwrap();
    bench.scheduler.check_invariants();
    bench.submit();
    assert!(bench.poll(1, &[], 1).jobs.is_empty() && bench.poll(2, &[], 1).jobs.is_empty());
    bench.scheduler.end_drain(worker(1));
    bench.scheduler.check_invariants();
    bench.take(1);
    bench.scheduler.remove_worker(worker(2), Departure::Left, bench.now);
    bench.scheduler.check_invariants();
}

#[test]
fn a_denied_worker_goes_with_its_jobs_and_comes_in_no_more_while_others_do() {
    let mut bench = Bench::new(2);
    let job = bench.submit();
    bench.take(1);
    bench.scheduler.ban(worker(1), bench.now);
    bench.scheduler.check_invariants();
    assert_eq!(bench.departures(), [("host".to_owned(), Departure::Denied)]);
    assert_eq!(bench.try_poll(1, Poll::default()).unwrap_err(), PollRefusal::UnknownWorker);
    assert_eq!(bench.join(1), Err(RegisterRefusal::Denied));
    assert_eq!(bench.take(2).job, job);
    assert!(bench.join(3).is_ok());
    assert_eq!(bench.scheduler.worker_labelled("host-2"), Some((worker(2), principal(2))));
    assert_eq!(bench.scheduler.worker_labelled("nobody"), None);
}
