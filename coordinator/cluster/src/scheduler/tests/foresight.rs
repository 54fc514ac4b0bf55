//! Jobs that are only foreseen: who is given them, and what becomes of them when they are asked for, or never are.

use super::*;

const CLIENT: ClientId = ClientId::new(1);

/// Worker 1 answers jobs of this kind, so that it is known that they are short, and that it can.
fn learn(bench: &mut Bench) {
    for _ in 0..20 {
        bench.submit();
        let lease = bench.take(1);
        let finished = vec![Report { lease, run_seconds: 0.01, outcome: good() }];
        bench.try_poll(1, Poll { finished, ..Poll::default() }).unwrap();
    }
    bench.scheduler.drain_finished();
}

#[test]
fn what_is_foreseen_is_for_workers_that_have_nothing_in_hand() {
    let mut bench = Bench::new(3);
    learn(&mut bench);
    let foreseen = [1, 2].map(|number| bench.submit_for(CLIENT.foresight(number)));
    let asked = [(); 4].map(|()| bench.submit());
    let leases = [1, 2, 3].map(|worker| bench.take(worker));
    assert_eq!(leases.map(|lease| lease.job), [asked[0], asked[1], asked[2]]);
    // One job waits for workers that are busy, of which this one may not take it: what is foreseen is not for it either.
    bench.report(1, leases[0], panicked("no"));
    let lease = bench.take(1);
    assert_eq!(lease.job, asked[3]);
    assert!(bench.scheduler.hands_out_ahead(worker(1)));
    assert!(bench.poll(1, &[lease], 1).jobs.is_empty());
    bench.scheduler.check_invariants();
    let answer = bench.poll(2, &[leases[1]], 2);
    assert_eq!(answer.jobs.iter().map(|(lease, _)| lease.job).collect::<Vec<_>>(), [asked[0]]);
    bench.report(1, lease, good());
    assert_eq!(bench.take(1).job, foreseen[0]);
    bench.scheduler.check_invariants();
}

#[test]
fn no_worker_that_is_busy_is_woken_for_what_is_only_foreseen() {
    let mut bench = Bench::new(3);
    learn(&mut bench);
    let asked = [(); 3].map(|()| bench.submit());
    let leases = [1, 2, 3].map(|worker| bench.take(worker));
    assert_eq!(leases.map(|lease| lease.job), asked);
    for (worker, lease) in (1..).zip(leases) {
        assert!(bench.poll(worker, &[lease], 1).jobs.is_empty());
    }
    for number in 1..4 {
        bench.submit_for(CLIENT.foresight(number));
    }
    assert_eq!(bench.scheduler.wake(bench.now), []);
    bench.submit();
    assert_eq!(bench.scheduler.wake(bench.now).len(), 1);
}

#[test]
fn nobody_doubles_what_is_only_foreseen() {
    let mut bench = Bench::new(2);
    learn(&mut bench);
    let job = bench.submit_for(CLIENT.foresight(1));
    let lease = bench.take(1);
    bench.pass(3);
    assert!(bench.poll(2, &[], 1).jobs.is_empty());
    bench.scheduler.share(job, CLIENT, bench.now);
    bench.scheduler.check_invariants();
    assert_eq!((bench.take(2).job, lease.job), (job, job));
}

#[test]
fn what_is_foreseen_takes_its_turn_with_the_others_once_it_is_asked_for() {
    let mut bench = Bench::new(1);
    let foreseen = [1, 2].map(|number| bench.submit_for(CLIENT.foresight(number)));
    let asked = bench.submit();
    bench.scheduler.share(foreseen[1], CLIENT, bench.now);
    bench.scheduler.check_invariants();
    for job in [asked, foreseen[1], foreseen[0]] {
        let lease = bench.take(1);
        assert_eq!(lease.job, job);
        bench.report(1, lease, good());
    }
}

#[test]
fn what_is_foreseen_is_given_up_with_whom_it_was_foreseen_for_unless_it_has_begun_or_is_asked_for() {
    let mut bench = Bench::new(2);
    let client = CLIENT.foresight(7);
    let jobs = [(); 4].map(|()| bench.submit_for(client));
    let begun = bench.take(1);
    bench.scheduler.share(jobs[1], CLIENT, bench.now);
    bench.scheduler.share(jobs[2], CLIENT.foresight(8), bench.now);
    assert_eq!((begun.job, bench.scheduler.forget_client(client)), (jobs[0], vec![jobs[3]]));
    bench.scheduler.check_invariants();
    bench.report(1, begun, good());
    assert_eq!(bench.scheduler.drain_finished().len(), 1);
    assert_eq!([1, 2].map(|worker| bench.take(worker).job), [jobs[1], jobs[2]]);
    assert!(bench.scheduler.jobs.get(jobs[3]).is_none());
}

#[test]
fn what_is_foreseen_is_held_and_preferred_with_the_client_that_will_ask_for_it() {
    let mut bench = Bench::new(1);
    let [mine, other] = [CLIENT, ClientId::new(2)].map(|client| bench.submit_for(client.foresight(1)));
    bench.scheduler.pause(CLIENT);
    bench.scheduler.check_invariants();
    let lease = bench.take(1);
    assert_eq!(lease.job, other);
    bench.report(1, lease, good());
    assert!(bench.poll(1, &[], 1).jobs.is_empty());
    bench.scheduler.resume(CLIENT);
    for _ in 0..20 {
        bench.submit_for(CLIENT.foresight(1));
        bench.submit_for(ClientId::new(2).foresight(1));
    }
    bench.scheduler.set_priority(CLIENT, 3);
    bench.scheduler.check_invariants();
    let asked = bench.submit_for(ClientId::new(2));
    let lease = bench.take(1);
    assert_eq!(lease.job, asked, "all others are still only foreseen");
    bench.report(1, lease, good());
    assert!(bench.scheduler.jobs.get(mine).is_some_and(Job::is_foreseen));
    let mut of_mine = 0;
    for _ in 0..12 {
        let lease = bench.take(1);
        let clients = &bench.scheduler.jobs.get(lease.job).unwrap().clients;
        of_mine += usize::from(clients.iter().all(|client| client.owner() == CLIENT));
        bench.report(1, lease, good());
    }
    assert!((8..=10).contains(&of_mine), "{of_mine} of 12");
}

#[test]
fn what_is_asked_for_has_not_waited_before() {
    let mut bench = Bench::new(1);
    let job = bench.submit_for(CLIENT.foresight(1));
    bench.pass(20);
    bench.scheduler.share(job, CLIENT.foresight(2), bench.now);
    bench.pass(20);
    bench.scheduler.share(job, CLIENT, bench.now);
    bench.pass(1);
    bench.scheduler.share(job, ClientId::new(2), bench.now);
    let waited = bench.now - bench.scheduler.jobs.get(job).unwrap().submitted;
    assert_eq!(waited, Duration::from_secs(1));
}

#[test]
fn two_who_differ_on_what_is_only_foreseen_end_nothing() {
    let mut bench = Bench::new(2);
    bench.scheduler.trust = Trust::new(Audit { share: 1.0, first: 0 });
    let job = bench.submit_for(CLIENT.foresight(1));
    let leases = [bench.take(1), bench.take(2)];
    for (worker, lease) in (1..).zip(leases) {
        bench.report(worker, lease, if worker == 1 { good() } else { opinions::lie() });
    }
    bench.pass(20);
    assert_eq!(bench.scheduler.undecided_since, None);
    bench.scheduler.share(job, CLIENT, bench.now);
    bench.pass(1);
    assert!(bench.scheduler.undecided_since.is_some());
}

#[test]
fn what_fails_is_not_tried_again_and_fails_nothing_before_it_is_asked_for() {
    for is_lost in [false, true] {
        let mut bench = Bench::new(4);
        learn(&mut bench);
        (bench.scheduler.limits.max_failures, bench.scheduler.limits.max_losses) = (1, 1);
        let job = bench.submit_for(CLIENT.foresight(1));
        let lease = bench.take(1);
        if is_lost {
            bench.scheduler.remove_worker(worker(1), Departure::Lost, bench.now);
        } else {
            bench.report(1, lease, panicked("no"));
        }
        bench.scheduler.check_invariants();
        assert!(bench.scheduler.failed().is_none());
        assert!(bench.poll(2, &[], 1).jobs.is_empty());
        bench.scheduler.share(job, CLIENT, bench.now);
        bench.scheduler.check_invariants();
        if !is_lost {
            assert!(bench.scheduler.failed().is_some(), "as often as the limit says");
            continue;
        }
        // Nobody knows how often it was tried before: one loss more.
        assert_eq!(bench.take(2).job, job);
        bench.scheduler.remove_worker(worker(2), Departure::Lost, bench.now);
        assert!(bench.scheduler.failed().is_some());
    }
}
