//! Who answers for whom: one vote a principal, trust that is earned, the coordinator's own workers, ids and places.

use super::*;

/// A valid result that is wrong.
fn lie() -> Result<TaskResult, Failure> {
    Ok(TaskResult::Evaluation(EvaluationResult {
        queries: 10,
        category_correct: 9,
        ..EvaluationResult::default()
    }))
}

fn with_audit(workers: u8, share: f64, first: u32) -> Bench {
    let mut bench = Bench::new(workers);
    bench.scheduler.trust = Trust::new(Audit { share, first });
    bench
}

/// Has a worker take a job and report this.
fn answer(bench: &mut Bench, number: u8, outcome: Result<TaskResult, Failure>) -> JobId {
    let lease = bench.take(number);
    bench.report(number, lease, outcome);
    lease.job
}

#[test]
fn two_workers_of_one_principal_have_one_vote() {
    let mut bench = with_audit(1, 1.0, 0);
    bench.join_as(2, principal(1)).unwrap();
    let job = bench.submit();
    answer(&mut bench, 1, good());
    assert_eq!(bench.scheduler.drain_finished()[0].assurance, Assurance::Owed);
    assert!(bench.poll(2, &[], 1).jobs.is_empty(), "it has answered already");
    assert!(!bench.scheduler.in_doubt(|_| false), "there is nobody who could tell");

    bench.join(3).unwrap();
    assert!(bench.scheduler.in_doubt(|_| false));
    assert_eq!(answer(&mut bench, 3, good()), job);
    assert!(!bench.scheduler.in_doubt(|_| false));
    let confirmed = bench.scheduler.drain_confirmed();
    let fingerprint = good().unwrap().fingerprint();
    let (seconded, assurance) = (Some(principal(3)), Assurance::Audited);
    assert_eq!(confirmed, [Confirmed { job, fingerprint, seconded, assurance, was_disputed: false }]);
    bench.scheduler.check_invariants();
}

#[test]
fn many_ids_of_one_liar_do_not_outvote_two_honest_machines() {
    let mut bench = with_audit(2, 1.0, 0);
    for sybil in 10..20 {
        bench.join_as(sybil, principal(10)).unwrap();
    }
    bench.submit();
    answer(&mut bench, 10, lie());
    assert!((11..20).all(|sybil| bench.poll(sybil, &[], 1).jobs.is_empty()));
    answer(&mut bench, 1, good());
    answer(&mut bench, 2, good());
    assert_eq!(Ok(bench.scheduler.drain_finished()[0].result.clone()), good());
    let departures = bench.departures();
    assert_eq!(departures.len(), 10, "all its ids go");
    assert!(departures.iter().all(|(_, departure)| *departure == Departure::Quarantined));
    assert_eq!(bench.join_as(21, principal(10)), Err(RegisterRefusal::Quarantined));
    assert_eq!(bench.labels(), ["host", "host-2"]);
}

#[test]
fn the_coordinators_own_answer_needs_no_other_and_decides() {
    let mut bench = with_audit(1, 1.0, 10);
    bench.join_as(2, Principal::Coordinator).unwrap();
    for _ in 0..3 {
        bench.submit();
    }
    answer(&mut bench, 2, good());
    let finished = bench.scheduler.drain_finished();
    assert_eq!((finished.len(), finished[0].assurance), (1, Assurance::Own));
    let lied = answer(&mut bench, 1, lie());
    assert!(bench.scheduler.drain_finished().is_empty());
    while answer(&mut bench, 2, good()) != lied {}
    assert_eq!(bench.departures(), [("host".to_owned(), Departure::Quarantined)]);
    let finished = bench.scheduler.drain_finished();
    assert!(finished.iter().all(|one| one.worker == "host-2" && Ok(&one.result) == good().as_ref()));
}

#[test]
fn one_machine_alone_has_no_audits() {
    let mut bench = with_audit(0, 1.0, 10);
    for number in [1, 2] {
        bench.join_as(number, Principal::Coordinator).unwrap();
    }
    for number in [1, 2, 1, 2] {
        bench.submit();
        answer(&mut bench, number, good());
    }
    let finished = bench.scheduler.drain_finished();
    assert!(
        finished.len() == 4 && finished.iter().all(|one| one.attempt == 1 && one.assurance == Assurance::Own)
    );
    let unaudited = |event: &Emitted| matches!(event.kind, EventKind::Unaudited);
    assert!(!bench.scheduler.drain_events().iter().any(unaudited));
}

#[test]
fn where_two_of_the_coordinators_own_differ_another_decides() {
    let mut bench = with_audit(0, 0.0, 0);
    bench.join_as(2, Principal::Coordinator).unwrap();
    for _ in 0..2 {
        bench.submit();
    }
    let jobs = bench.poll(2, &[], 2).jobs;
    bench.join_as(3, Principal::Coordinator).unwrap();
    let hedge = bench.take(3);
    assert_eq!((hedge.job, hedge.attempt), (jobs[1].0.job, 2));
    bench.report(2, jobs[0].0, good());
    bench.poll(2, &[jobs[1].0], 0);
    bench.report(2, jobs[1].0, lie());
    assert_eq!(bench.scheduler.drain_finished().pop().unwrap().assurance, Assurance::Own);
    bench.report(3, hedge, good());
    bench.join(1).unwrap();
    assert!(bench.scheduler.in_doubt(|_| false));
    answer(&mut bench, 1, good());
    assert_eq!(bench.departures().len(), 2, "a machine that contradicts itself");
    let doubt = bench.scheduler.drain_doubts().pop();
    assert!(matches!(doubt, Some(Doubt::Quarantined(Principal::Coordinator))), "{doubt:?}");
}

#[test]
fn who_is_wrong_outside_of_answers_loses_its_workers_and_its_answers() {
    let mut bench = with_audit(2, 1.0, 0);
    let job = bench.submit();
    answer(&mut bench, 1, lie());
    bench.scheduler.quarantine(principal(1), None, bench.now);
    assert_eq!(bench.departures().len(), 1);
    assert!(
        matches!(bench.scheduler.drain_doubts()[..], [Doubt::Quarantined(wrong)] if wrong == principal(1))
    );
    assert_eq!(bench.join_as(3, principal(1)), Err(RegisterRefusal::Quarantined));
    assert_eq!(answer(&mut bench, 2, good()), job);
    assert_eq!(Ok(bench.scheduler.drain_finished()[0].result.clone()), good());
    bench.scheduler.quarantine(principal(1), None, bench.now);
    assert!(bench.scheduler.drain_doubts().is_empty(), "once is enough");
    bench.scheduler.check_invariants();
}

#[test]
fn a_newcomer_is_audited_until_it_is_known() {
    let mut bench = with_audit(2, 0.0, 3);
    for _ in 0..3 {
        bench.submit();
        answer(&mut bench, 1, good());
        assert!(bench.scheduler.drain_finished().is_empty());
        answer(&mut bench, 2, good());
        assert_eq!(bench.scheduler.drain_finished()[0].assurance, Assurance::Audited);
    }
    // By now both are known: a third of what they answer is audited, then less.
    let mut audited = 0;
    for _ in 0..300 {
        bench.submit();
        answer(&mut bench, 1, good());
        if bench.scheduler.drain_finished().is_empty() {
            audited += 1;
            answer(&mut bench, 2, good());
            bench.scheduler.drain_finished();
        }
    }
    // n grows by 1/n an answer: from 3 to about √(3² + 2·300) = 25 audits.
    assert!((12..36).contains(&audited), "{audited}");
    bench.join(3).unwrap();
    bench.submit();
    answer(&mut bench, 3, good());
    assert!(bench.scheduler.drain_finished().is_empty(), "another newcomer");
    answer(&mut bench, 2, good());
    bench.scheduler.drain_finished();
    bench.scheduler.suspect(principal(1));
    bench.submit();
    answer(&mut bench, 1, good());
    assert!(bench.scheduler.drain_finished().is_empty(), "what it goes on with may be wrong");
}

#[test]
fn one_that_lies_at_first_and_leaves_is_found_when_another_comes() {
    let mut bench = with_audit(1, 0.01, 10);
    let jobs: Vec<JobId> = (0..4).map(|_| bench.submit()).collect();
    for _ in &jobs {
        answer(&mut bench, 1, lie());
    }
    assert_eq!(bench.scheduler.drain_finished().len(), 4);
    bench.try_poll(1, Poll { leaving: true, ..Poll::default() }).unwrap();
    for number in [2, 3] {
        bench.join(number).unwrap();
    }
    assert!(bench.scheduler.in_doubt(|_| false));
    answer(&mut bench, 2, good());
    answer(&mut bench, 3, good());
    let departed = |event: Emitted| match event.kind {
        EventKind::Departed { label, departure: Departure::Quarantined, .. } => Some(label),
        _ => None,
    };
    let quarantined: Vec<String> = bench.scheduler.drain_events().into_iter().filter_map(departed).collect();
    assert_eq!(quarantined, ["host"]);
    assert!(!bench.scheduler.in_doubt(|_| false), "who keeps the answers asks again");
}

#[test]
fn what_is_to_be_confirmed_goes_to_another_principal() {
    let mut bench = with_audit(2, 0.0, 0);
    bench.join_as(3, principal(1)).unwrap();
    let job = bench.submit();
    answer(&mut bench, 1, lie());
    let accepted = bench.scheduler.drain_finished().remove(0);
    assert_eq!(accepted.assurance, Assurance::Unaudited);
    assert!(bench.poll(2, &[], 1).jobs.is_empty());
    bench.scheduler.audit(&evaluation(), &accepted, ClientId::new(1), bench.now);
    assert!(bench.scheduler.in_doubt(|_| false));
    assert!(bench.poll(3, &[], 1).jobs.is_empty());
    assert_eq!(answer(&mut bench, 2, good()), job);
    assert!(bench.scheduler.in_doubt(|_| false), "two differ");
    bench.join(4).unwrap();
    answer(&mut bench, 4, good());
    assert_eq!(bench.departures().len(), 2, "both of the one that was wrong");
    bench.scheduler.check_invariants();
    // What two agree on is not asked a third time.
    let audited = Finished { assurance: Assurance::Audited, ..accepted };
    bench.scheduler.audit(&evaluation(), &audited, ClientId::new(1), bench.now);
    assert_eq!(bench.scheduler.jobs.len(), 0);
}

#[test]
fn what_two_liars_agree_on_is_confirmed_by_the_coordinator_itself() {
    let mut bench = with_audit(2, 1.0, 0);
    bench.join_as(3, Principal::Coordinator).unwrap();
    let job = bench.submit();
    for liar in [1, 2] {
        answer(&mut bench, liar, lie());
    }
    let accepted = bench.scheduler.drain_finished().remove(0);
    assert_eq!(accepted.assurance, Assurance::Audited, "they are believed");
    bench.scheduler.confirm(&evaluation(), &accepted, ClientId::new(1), bench.now);
    assert!(bench.scheduler.in_doubt(|_| false));
    bench.join(4).unwrap();
    assert!(bench.poll(4, &[], 1).jobs.is_empty(), "nobody else can confirm it");
    assert_eq!(answer(&mut bench, 3, good()), job);
    assert_eq!(bench.departures().len(), 2);
    assert!(!bench.scheduler.in_doubt(|_| false));
    bench.scheduler.check_invariants();
}

#[test]
fn what_is_confirmed_is_one_attempt_more() {
    let mut bench = with_audit(2, 0.0, 0);
    let job = bench.submit();
    answer(&mut bench, 1, good());
    let accepted = bench.scheduler.drain_finished().remove(0);
    bench.scheduler.confirm(&evaluation(), &accepted, ClientId::new(1), bench.now);
    assert_eq!(bench.take(2), bench.lease(2, job, 2));
}

#[test]
fn nobody_speaks_in_anothers_name() {
    let mut bench = Bench::new(2);
    bench.submit();
    let lease = bench.take(1);
    let thief = (worker(1), principal(2));
    let locked_out = Poll { sequence: u64::MAX, leaving: true, ..Poll::default() };
    assert_eq!(bench.scheduler.poll(thief, locked_out, bench.now).unwrap_err(), PollRefusal::UnknownWorker);
    let jobs = bench.scheduler.lease_later(thief, bench.sequence, 1, bench.now);
    assert_eq!(jobs.unwrap_err(), PollRefusal::UnknownWorker);
    bench.report(2, lease, lie());
    assert!(bench.scheduler.drain_finished().is_empty(), "the lease is another's");
    assert_eq!(bench.report(1, lease, good()).acknowledged, [lease]);
    assert_eq!(bench.scheduler.drain_finished().len(), 1);
}

#[test]
fn a_worker_that_comes_back_by_another_credential_is_another_and_hands_its_leases_back() {
    let mut bench = Bench::new(1);
    let job = bench.submit();
    let lease = bench.take(1);
    bench.join_as(1, principal(5)).unwrap();
    assert_eq!(bench.departures(), [("host".to_owned(), Departure::Left)]);
    assert_eq!(bench.poll(1, &[lease], 0).revoked, [lease]);
    assert_eq!(bench.take(1), bench.scheduler.secret.lease(job, 2, (worker(1), principal(5))));
    bench.scheduler.check_invariants();
}

#[test]
fn who_registers_without_end_displaces_its_own_ids_and_nobody_elses() {
    let mut bench = Bench::new(0);
    bench.scheduler.limits.max_workers = 4;
    bench.join(1).unwrap();
    for sybil in 100..200 {
        bench.now += Duration::from_millis(1);
        bench.join_as(sybil, principal(100)).unwrap();
    }
    assert_eq!(bench.scheduler.worker_count(), 4);
    // An honest one finds room, too.
    bench.join(2).unwrap();
    assert!([1, 2].iter().all(|number| bench.scheduler.knows(worker(*number))));
    // Whoever has something to show stays, also beside those of its own address that have nothing.
    bench.submit();
    let useful = (100..200).find(|sybil| bench.scheduler.knows(worker(*sybil))).unwrap();
    answer(&mut bench, useful, good());
    for sybil in 200..=255 {
        let _ = bench.join_as(sybil, principal(100));
    }
    assert!(bench.scheduler.knows(worker(useful)));
    bench.scheduler.check_invariants();
}
