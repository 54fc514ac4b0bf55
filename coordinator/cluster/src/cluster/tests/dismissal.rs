//! The end of a run, as workers hear of it.

use super::*;

const ID: WorkerId = WorkerId([1; 16]);

/// A poll of a worker that would take a job.
fn polling(sequence: u64) -> Poll {
    Poll { sequence, wanted: 1, ..Poll::default() }
}

#[tokio::test]
async fn a_poll_that_is_held_back_hears_at_once_that_the_run_has_ended_and_nobody_is_waited_for_after_that() {
    let cluster = Cluster::new(LIMITS);
    cluster.register(ID, Introduction::sample("one", 1)).unwrap();
    cluster.begun.send_replace(true);
    let started = tokio::time::Instant::now();
    let worker = async {
        let answer = cluster.poll((ID, principal()), polling(1)).await.unwrap();
        assert!(answer.run_ended && answer.jobs.is_empty());
        let leaving = Poll { sequence: 2, leaving: true, ..Poll::default() };
        cluster.poll((ID, principal()), leaving).await.unwrap();
    };
    let coordinator = async {
        tokio::task::yield_now().await; // the poll is held back by then
        cluster.dismiss_workers().await;
    };
    tokio::join!(worker, coordinator);
    assert!(started.elapsed() < cluster.hold(), "neither waited for the other");
    assert_eq!(cluster.state().scheduler.last_sign_of_life(), None);
    let mut events = cluster.events();
    let (mut joined, mut departed) = (0, 0);
    for event in events.read_to_end() {
        joined += usize::from(matches!(event.kind, EventKind::Joined { .. }));
        departed += usize::from(matches!(event.kind, EventKind::Departed { .. }));
    }
    assert_eq!((joined, departed), (1, 0), "leaving at the end is no event");
    // Who comes now is told so, too.
    let refusal = cluster.register(WorkerId([2; 16]), Introduction::sample("two", 1)).unwrap_err();
    assert_eq!(refusal, RegisterRefusal::RunEnded);
}

#[tokio::test]
async fn a_worker_that_says_nothing_is_not_waited_for_longer_than_a_busy_one_may_be_silent() {
    let cluster = Cluster::new(Limits { lease: Duration::from_millis(60), ..LIMITS });
    cluster.register(ID, Introduction::sample("one", 1)).unwrap();
    let started = tokio::time::Instant::now();
    cluster.dismiss_workers().await;
    assert!(started.elapsed() > cluster.heartbeat(), "it may have been busy");
}

#[tokio::test]
async fn without_workers_of_other_processes_nobody_is_waited_for() {
    let cluster = Cluster::new(LIMITS);
    let own = Introduction { principal: Principal::Coordinator, ..Introduction::sample("own", 1) };
    cluster.register(ID, own).unwrap();
    let started = tokio::time::Instant::now();
    cluster.dismiss_workers().await;
    assert!(started.elapsed() < DISMISSAL_MARGIN);
}

#[tokio::test]
async fn a_run_that_nobody_was_asked_for_ends_for_its_workers_too() {
    let cluster = Cluster::new(LIMITS);
    let _client = cluster.client(); // it has submitted nothing, as where all counts are remembered
    cluster.register(ID, Introduction::sample("one", 1)).unwrap();
    tokio::select! {
        biased;
        answer = cluster.poll((ID, principal()), polling(1)) => assert!(answer.unwrap().run_ended),
        () = cluster.dismiss_workers() => panic!("the poll was held back all the time"),
    }
}
