//! Several clients of one cluster: what they share, and what is delivered to each.

use std::cell::Cell;

use super::*;
use crate::events::{ControlAction, Controlled};
use crate::scheduler::ClientId;

pub(super) fn evaluation_of(number: u32) -> Evaluation {
    Evaluation::sample(number, 9, 9)
}

/// A worker that recognises as many clouds as `correct` has for the number; counts its results.
pub(super) async fn labour(
    cluster: &Cluster,
    worker: u8,
    answers: &Cell<usize>,
    correct: impl Fn(u32) -> u32,
) {
    let id = WorkerId([worker; 16]);
    let introduction = Introduction::sample("host", worker);
    let principal = introduction.principal;
    cluster.register(id, introduction).unwrap();
    let mut finished: Vec<Report> = Vec::new();
    for sequence in 1.. {
        let reports = std::mem::take(&mut finished);
        let poll = Poll { sequence, finished: reports, wanted: 1, ..Poll::default() };
        let Ok(answer) = cluster.poll((id, principal), poll).await else { break };
        for (lease, task) in answer.jobs {
            let Task::Evaluation(evaluation) = &*task else { panic!("{task}") };
            let object_correct = correct(number(&evaluation.subject));
            let result = EvaluationResult {
                queries: 9,
                object_correct,
                category_correct: 9,
                ..EvaluationResult::default()
            };
            finished.push(Report { lease, run_seconds: 0.1, outcome: Ok(TaskResult::Evaluation(result)) });
            answers.set(answers.get() + 1);
        }
        tokio::task::yield_now().await; // an answer that is there at once would leave nobody else a turn
    }
    std::future::pending().await // it was removed
}

/// How many clouds each descriptor recognises, in the order of asking.
pub(super) async fn ask(client: &mut Client, bins: &[u32]) -> Result<Vec<u32>, ClusterError> {
    let evaluations = bins.iter().map(|&bins| evaluation_of(bins)).collect();
    let finished = client.evaluate(evaluations, |_| {}).await?;
    Ok(finished.iter().map(|finished| finished.result.object_correct).collect())
}

/// The same, where the results are there, or never will be.
pub(super) async fn ask_nobody(client: &mut Client, bins: &[u32]) -> Option<Vec<u32>> {
    tokio::select! {
        biased;
        told = ask(client, bins) => Some(told.unwrap()),
        () = tokio::task::yield_now() => None,
    }
}

#[tokio::test]
async fn equal_questions_are_computed_once_and_everybody_is_told() {
    let (cluster, answers) = (Cluster::new(LIMITS), Cell::new(0));
    let [mut first, mut second] = [cluster.client(), cluster.client()];
    let both = async { tokio::join!(ask(&mut first, &[1, 2, 3]), ask(&mut second, &[3, 4, 1])) };
    let told = tokio::select! {
        told = both => told,
        () = labour(&cluster, 1, &answers, |bins| bins) => unreachable!(),
    };
    assert_eq!((told.0.unwrap(), told.1.unwrap()), (vec![1, 2, 3], vec![3, 4, 1]));
    assert_eq!(answers.get(), 4);
    // What either was told before, the other need not wait for; what it was told itself is computed again.
    assert_eq!(ask_nobody(&mut second, &[2]).await, Some(vec![2]));
    assert_eq!(ask_nobody(&mut second, &[2]).await, None);
}

#[tokio::test]
async fn polls_wait_until_every_client_has_asked_rests_or_is_gone() {
    let cluster = Cluster::new(LIMITS);
    let [mut first, mut second, mut third, fourth] = [(); 4].map(|()| cluster.client());
    let begun = || *cluster.begun.borrow();
    assert_eq!(ask_nobody(&mut first, &[1]).await, None);
    assert!(!begun());
    assert_eq!(ask_nobody(&mut second, &[1]).await, None);
    assert!(!begun());
    third.rest();
    assert!(!begun());
    drop(fourth);
    assert!(begun());
}

#[tokio::test]
async fn a_corrected_answer_reaches_everybody_who_was_told_the_wrong_one() {
    let limits = Limits { audit: Audit { share: 1.0, first: 0 }, ..LIMITS };
    let (cluster, answers) = (Cluster::new(limits), Cell::new(0));
    let [mut first, mut second, mut third, mut done] = [(); 4].map(|()| cluster.client());
    let lie = |bins| if bins == 1 { 9 } else { bins };
    let liar = labour(&cluster, 1, &answers, lie);
    tokio::pin!(liar);
    // Nobody else is there to ask.
    let finish = async {
        let told = ask(&mut done, &[1]).await;
        done.rest();
        told
    };
    let all = async {
        tokio::join!(ask(&mut first, &[1]), ask(&mut second, &[1, 2]), ask(&mut third, &[2]), finish)
    };
    let (one, two, three, four) = tokio::select! {
        told = all => told,
        () = &mut liar => unreachable!(),
    };
    assert_eq!(four.unwrap(), [9]);
    assert!(!done.begins_again().unwrap());
    assert_eq!((one.unwrap(), two.unwrap(), three.unwrap()), (vec![9], vec![9, 2], vec![2]));
    let all = async { tokio::join!(ask(&mut first, &[3]), ask(&mut second, &[3]), ask(&mut third, &[3])) };
    let (one, two, three) = tokio::select! {
        told = all => told,
        () = &mut liar => unreachable!(),
        () = labour(&cluster, 2, &answers, |bins| bins) => unreachable!(),
        () = labour(&cluster, 3, &answers, |bins| bins) => unreachable!(),
    };
    for wronged in [one, two] {
        let Err(ClusterError::Corrected(tasks)) = wronged else { panic!("{wronged:?}") };
        assert_eq!(tasks, [Arc::new(Task::Evaluation(evaluation_of(1)))]);
    }
    assert_eq!(three.unwrap(), [3], "it was told nothing wrong");
    assert!(done.begins_again().unwrap() && !done.begins_again().unwrap(), "although it had finished");
    assert_eq!(ask_nobody(&mut done, &[1]).await, Some(vec![1]));
    assert_eq!(ask_nobody(&mut first, &[1, 3]).await, Some(vec![1, 3]));
    assert_eq!(ask_nobody(&mut second, &[1, 2, 3]).await, Some(vec![1, 2, 3]));
    assert!(!cluster.quarantined().is_empty());
}

#[tokio::test]
async fn each_is_told_of_attempts_at_what_it_has_asked_and_of_all_workers() {
    let (cluster, answers) = (Cluster::new(LIMITS), Cell::new(0));
    let [mut first, mut second] = [cluster.client(), cluster.client()];
    let both = async { tokio::join!(ask(&mut first, &[1, 2]), ask(&mut second, &[2, 3, 4])) };
    let _told = tokio::select! {
        told = both => told,
        () = labour(&cluster, 1, &answers, |bins| bins) => unreachable!(),
    };
    first.note_rewind(1, "for a test".to_owned());
    for (client, attempts) in [(first, 2), (second, 3)] {
        let events = client.events().await.unwrap();
        let count = |is_it: fn(&EventKind) -> bool| events.iter().filter(|event| is_it(&event.kind)).count();
        assert_eq!(count(|kind| matches!(kind, EventKind::Attempt(_))), attempts);
        assert_eq!(count(|kind| matches!(kind, EventKind::Joined { .. })), 1);
        assert_eq!(count(|kind| matches!(kind, EventKind::Rewind { generation: 1, .. })), 1);
        assert_eq!(events.len(), attempts + 2);
    }
}

#[tokio::test]
async fn whatever_stops_one_stops_all() {
    let (cluster, answers) = (Cluster::new(LIMITS), Cell::new(0));
    let [mut first, mut second] = [cluster.client(), cluster.client()];
    let both = async { tokio::join!(ask(&mut first, &[1]), ask(&mut second, &[2])) };
    // More than there are clouds: no result at all.
    let (one, two) = tokio::select! {
        ended = both => ended,
        () = labour(&cluster, 1, &answers, |bins| if bins == 1 { 10 } else { bins }) => unreachable!(),
    };
    assert!(matches!(one, Err(ClusterError::JobFailed(_))), "{one:?}");
    assert!(matches!(two, Err(ClusterError::JobFailed(_)) | Ok(_)), "{two:?}");
    let next = ask(&mut second, &[3]).await;
    assert!(matches!(next, Err(ClusterError::JobFailed(_))), "{next:?}");
}

/// An order of an operator.
fn order(action: ControlAction) -> Controlled {
    let (reason, by) = ("for a test".to_owned(), "jo@lab".to_owned());
    Controlled { action, member: None, reason, by }
}

#[tokio::test]
async fn results_are_checked_for_whoever_waits_for_that_while_all_others_are_paused() {
    let (cluster, answers) = (Cluster::new(LIMITS), Cell::new(0));
    let [mut first, mut second] = [cluster.client(), cluster.client()];
    cluster.control(order(ControlAction::Pause), &[first.id()]).unwrap();
    let checked = async {
        let told = tokio::select! {
            told = ask(&mut second, &[2]) => told,
            () = labour(&cluster, 1, &answers, |bins| bins) => unreachable!(),
        };
        assert_eq!(told.unwrap(), [2]);
        cluster.quarantine(Introduction::sample("host", 1).principal);
        let work = async {
            // As at each tick. It waits by now for a check of its result.
            cluster.state().hold_checks();
            labour(&cluster, 2, &answers, |bins| bins).await;
        };
        tokio::select! {
            biased;
            confirmed = second.confirmed(|_| {}) => confirmed.unwrap(),
            () = work => unreachable!(),
        }
    };
    tokio::select! {
        biased;
        told = ask(&mut first, &[1]) => panic!("{told:?}, although it is paused"),
        () = checked => {}
    }
    assert_eq!(answers.get(), 2);
}

#[tokio::test]
async fn what_a_paused_client_has_confirmed_is_confirmed_for_whoever_has_asked_for_it_too() {
    let (cluster, answers) = (Cluster::new(LIMITS), Cell::new(0));
    let mut first = cluster.client();
    tokio::select! {
        told = ask(&mut first, &[2]) => assert_eq!(told.unwrap(), [2]),
        () = labour(&cluster, 1, &answers, |bins| bins) => unreachable!(),
    }
    let mut second = cluster.client();
    assert_eq!(ask_nobody(&mut second, &[2]).await.unwrap(), [2]);
    cluster.control(order(ControlAction::Pause), &[first.id()]).unwrap();
    first.confirm(&evaluation_of(2).subject.descriptor);
    tokio::select! {
        biased; // the other worker comes first: somebody can confirm it
        () = labour(&cluster, 2, &answers, |bins| bins) => unreachable!(),
        confirmed = second.confirmed(|_| {}) => confirmed.unwrap(),
    }
    assert_eq!(answers.get(), 2);
    assert!(cluster.is_paused(first.id()));
}

#[tokio::test]
async fn what_is_in_doubt_of_a_client_without_further_questions_is_confirmed_although_it_was_paused() {
    let (cluster, answers) = (Cluster::new(LIMITS), Cell::new(0));
    let mut client = cluster.client();
    tokio::select! {
        told = ask(&mut client, &[2]) => assert_eq!(told.unwrap(), [2]),
        () = labour(&cluster, 1, &answers, |bins| bins) => unreachable!(),
    }
    client.confirm(&evaluation_of(2).subject.descriptor);
    cluster.control(order(ControlAction::Pause), &[client.id()]).unwrap();
    assert!(cluster.state().scheduler.is_paused(ClientId::AUDITOR));
    client.rest();
    assert!(!cluster.is_paused(client.id()) && !cluster.state().scheduler.is_paused(ClientId::AUDITOR));
    tokio::select! {
        biased; // the other worker comes first: somebody can confirm it
        () = labour(&cluster, 2, &answers, |bins| bins) => unreachable!(),
        confirmed = client.confirmed(|_| {}) => confirmed.unwrap(),
    }
    assert_eq!(answers.get(), 2);
}

#[tokio::test]
async fn what_an_operator_orders_is_done_once_and_told_to_everybody() {
    let (cluster, answers) = (Cluster::new(LIMITS), Cell::new(0));
    let [mut first, mut second] = [cluster.client(), cluster.client()];
    let (one, both) = ([first.id()], [first.id(), second.id()]);
    let worker = || "host".to_owned();
    let refused = |action, clients: &[_]| cluster.control(order(action), clients).unwrap_err();
    let done = |action, clients: &[_]| cluster.control(order(action), clients).unwrap();

    done(ControlAction::Pause, &one);
    assert!(cluster.is_paused(first.id()) && !cluster.is_paused(second.id()));
    assert_eq!(refused(ControlAction::Pause, &one), ControlRefusal::Paused);
    let told = async {
        let (asked, ()) = tokio::join!(ask(&mut first, &[1]), async {
            assert_eq!(ask(&mut second, &[2]).await.unwrap(), [2]);
            assert_eq!(answers.get(), 1, "although another was asked first");
            // Nobody waits but who is paused.
            assert!(cluster.state().is_halted());
            done(ControlAction::Pause, &both);
            assert_eq!(refused(ControlAction::Pause, &both), ControlRefusal::Paused);
            assert!(cluster.state().scheduler.is_paused(ClientId::AUDITOR), "nor is anything checked");
            done(ControlAction::Resume { worker: None }, &both);
            assert!(!cluster.state().is_halted());
            assert!(!cluster.state().scheduler.is_paused(ClientId::AUDITOR));
        });
        asked.unwrap()
    };
    let told = tokio::select! {
        told = told => told,
        () = labour(&cluster, 1, &answers, |bins| bins) => unreachable!(),
    };
    assert_eq!(told, [1]);
    assert_eq!(refused(ControlAction::Resume { worker: None }, &both), ControlRefusal::NotPaused);

    assert_eq!(
        cluster.fleet().iter().map(|one| (one.answers, one.draining)).collect::<Vec<_>>(),
        [(2, false)]
    );
    assert!((cluster.fleet()[0].busy_seconds - 0.2).abs() < 1e-9);
    let drained = done(ControlAction::Drain { worker: worker() }, &both);
    assert!(drained.ends_with("; no other worker is here to go on"), "{drained}");
    assert!(cluster.fleet()[0].draining);
    assert_eq!(refused(ControlAction::Drain { worker: worker() }, &both), ControlRefusal::Drained(worker()));
    done(ControlAction::Resume { worker: Some(worker()) }, &both);
    let again = ControlAction::Resume { worker: Some(worker()) };
    assert_eq!(refused(again, &both), ControlRefusal::NotDrained(worker()));
    let nobody = refused(ControlAction::Deny { worker: "nobody".to_owned() }, &both).to_string();
    assert_eq!(nobody, "worker: must be one that is here, got \"nobody\"\nhere are: host");
    let own = Introduction { principal: Principal::Coordinator, ..Introduction::sample("local", 2) };
    cluster.register(WorkerId([2; 16]), own).unwrap();
    let local = ControlAction::Deny { worker: "local".to_owned() };
    assert_eq!(refused(local, &both), ControlRefusal::Own("local".to_owned()));
    done(ControlAction::Deny { worker: worker() }, &both);
    assert_eq!(cluster.fleet().len(), 1);
    for (priority, clients) in [(0, &one), (101, &one)] {
        assert_eq!(
            refused(ControlAction::Priority { priority }, clients),
            ControlRefusal::Priority(priority)
        );
    }
    done(ControlAction::Priority { priority: 7 }, &one);
    assert_eq!((cluster.priority(first.id()), cluster.priority(second.id())), (7, 1));

    let said = |kind: &EventKind| match kind {
        EventKind::Controlled(_) => Some(kind.to_string()),
        _ => None,
    };
    let events: Vec<String> =
        second.events().await.unwrap().iter().filter_map(|event| said(&event.kind)).collect();
    assert_eq!(
        events,
        [
            "paused by jo@lab: for a test",
            "paused by jo@lab: for a test",
            "resumed by jo@lab: for a test",
            "worker host: drained by jo@lab: for a test",
            "worker host: resumed by jo@lab: for a test",
            "worker host: denied by jo@lab: for a test",
            "priority 7 by jo@lab: for a test",
        ]
    );
}
