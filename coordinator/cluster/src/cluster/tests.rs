//! The cluster as workers and clients use it: polls, acknowledgements, the clock, failures.

mod dismissal;
mod foresight;
mod provenance;
mod recorded;
mod sharing;

use super::*;
use crate::events::Departure;
use crate::journal::Journal;
use crate::scheduler::Audit;
use crate::sharding::AwaitingScales;
use proto::journal::{AcceptedResult, Member};
use proto::task::{
    CloudEntry, Described, EvaluationResult, GridCell, Label, Match, Report, Scale, SplitManifest, Subject,
    TaskResult, Tile,
};
use proto::{Digest, Principal};

const LIMITS: Limits = Limits::SAMPLE;

fn cell(number: u32) -> GridCell {
    let Evaluation { subject, query, database, queries, database_clouds, .. } =
        Evaluation::sample(number, 9, 9);
    GridCell { subject, query, database, queries, database_clouds, descriptors: 2 }
}

/// Who answers for the only worker.
fn principal() -> Principal {
    Introduction::sample("one", 1).principal
}

fn identity() -> (SessionId, RunSecret) {
    (SessionId([1; 16]), RunSecret::new([2; 32]))
}

/// What tells tasks apart.
fn number(subject: &Subject) -> u32 {
    u32::from_le_bytes(subject.descriptor.bytes().try_into().unwrap())
}

/// A worker that gives each cell the counts that `answer` has for its number.
async fn work(cluster: &Cluster, answer: impl Fn(u32) -> Vec<u32>) {
    let id = WorkerId([1; 16]);
    let introduction = Introduction::sample("one", 1);
    cluster.register(id, introduction).unwrap();
    let mut finished: Vec<Report> = Vec::new();
    for sequence in 1.. {
        let reports = std::mem::take(&mut finished);
        let poll = Poll { sequence, finished: reports, wanted: 2, ..Poll::default() };
        for (lease, task) in cluster.poll((id, principal()), poll).await.unwrap().jobs.into_iter().rev() {
            let Task::GridCell(cell) = &*task else { panic!("{task}") };
            let outcome = Ok(TaskResult::GridCell(answer(number(&cell.subject))));
            finished.push(Report { lease, run_seconds: 0.1, outcome });
        }
        tokio::task::yield_now().await; // an answer that is there at once would leave nobody else a turn
    }
}

async fn evaluate(answer: impl Fn(u32) -> Vec<u32>) -> Result<Vec<(usize, Vec<u32>)>, ClusterError> {
    let cluster = Cluster::new(LIMITS);
    let mut all = Vec::new();
    let mut client = cluster.client();
    let evaluation = client.evaluate_cells([5, 6, 7].map(cell).to_vec(), |_, answers| {
        all.extend(answers.into_iter().map(|answer| {
            assert_eq!(answer.by, (WorkerId([1; 16]), principal(), None));
            (answer.place, answer.counts)
        }));
        Ok(())
    });
    tokio::select! {
        done = evaluation => done?,
        () = work(&cluster, answer) => {}
    }
    all.sort();
    Ok(all)
}

#[tokio::test]
async fn a_worker_of_the_own_process_is_waited_for_where_one_is_to_come() {
    let cluster = Cluster::new(LIMITS);
    let foreign = Introduction::sample("one", 1);
    cluster.register(WorkerId([1; 16]), foreign.clone()).unwrap();
    cluster.wait_for_worker(false, |_| {}).await;
    let own = Introduction { principal: Principal::Coordinator, ..foreign };
    let waiting = cluster.wait_for_worker(true, |_| {});
    tokio::select! {
        biased;
        () = waiting => panic!("only a foreign worker is here"),
        () = tokio::task::yield_now() => {}
    }
    cluster.register(WorkerId([2; 16]), own).unwrap();
    cluster.wait_for_worker(true, |_| {}).await;
    assert!(cluster.state().scheduler.has_own());
}

#[tokio::test]
async fn a_late_copy_of_an_older_poll_does_not_silence_the_one_that_is_held_back() {
    let cluster = Cluster::new(LIMITS);
    let id = WorkerId([1; 16]);
    let introduction = Introduction::sample("one", 1);
    cluster.register(id, introduction).unwrap();
    cluster.begun.send_replace(true);
    let mut client = cluster.client();
    let poll = |sequence| cluster.poll((id, principal()), Poll { sequence, wanted: 1, ..Poll::default() });
    let late = async {
        tokio::task::yield_now().await; // the newer one comes first
        assert_eq!(poll(1).await.unwrap_err(), PollRefusal::Stale);
        client.evaluate_cells(vec![cell(5)], |_, _| Ok::<_, ClusterError>(())).await
    };
    tokio::select! {
        biased;
        answer = poll(2) => assert_eq!(answer.unwrap().jobs.len(), 1),
        done = late => panic!("nobody works: {done:?}"),
    }
}

#[tokio::test]
async fn cells_are_given_with_their_place_whatever_the_order_of_arrival() {
    let counts = evaluate(|number| vec![number, 0]).await.unwrap();
    assert_eq!(counts, [(0, vec![5, 0]), (1, vec![6, 0]), (2, vec![7, 0])]);
}

fn evaluation() -> Evaluation {
    Evaluation::sample(1, 9, 9)
}

/// One worker that has taken the only job of a cluster and reports it in a poll that waits for more.
async fn reported(cluster: &Arc<Cluster>) -> (Lease, tokio::task::JoinHandle<Answer>) {
    let id = WorkerId([1; 16]);
    let introduction = Introduction::sample("one", 1);
    cluster.register(id, introduction).unwrap();
    let poll = Poll { sequence: 1, wanted: 1, ..Poll::default() };
    let (lease, _) = cluster.poll((id, principal()), poll).await.unwrap().jobs.remove(0);
    let result = EvaluationResult {
        queries: 9,
        object_correct: 1,
        category_correct: 2,
        ..EvaluationResult::default()
    };
    let outcome = Ok(TaskResult::Evaluation(result));
    let finished = vec![Report { lease, run_seconds: 0.1, outcome }];
    let cluster = Arc::clone(cluster);
    let poll = Poll { sequence: 2, wanted: 1, finished, ..Poll::default() };
    (lease, tokio::spawn(async move { cluster.poll((id, principal()), poll).await.unwrap() }))
}

#[tokio::test]
async fn a_poll_that_waits_is_answered_when_its_report_is_on_the_disk() {
    let (journal, held) = Journal::held();
    let cluster = Cluster::with_journal(LIMITS, identity(), journal, Recorded::default());
    let evaluated = tokio::spawn({
        let cluster = Arc::clone(&cluster);
        async move { cluster.client().evaluate(vec![evaluation()], |_| {}).await }
    });
    let (lease, poll) = reported(&cluster).await;
    // The search goes on with the result before that.
    assert_eq!(evaluated.await.unwrap().unwrap()[0].attempt, 1);
    assert!(!poll.is_finished());
    assert_eq!(held.commit(), 5, "the worker, its lease, its answer, and the events of worker and attempt");
    assert_eq!(poll.await.unwrap().acknowledged, [lease]);
    cluster.flush().await.unwrap();
}

fn scale(number: u32) -> Scale {
    Scale { subject: Subject::sample(number), splits: Vec::new(), clouds: 9, described: Vec::new() }
}

#[tokio::test]
async fn scales_are_in_the_order_of_asking_and_there_at_the_next_start() {
    let asked = || [5, 6, 7].map(scale).to_vec();
    let (journal, held) = Journal::held();
    let cluster = Cluster::with_journal(LIMITS, identity(), journal, Recorded::default());
    let scaled = tokio::spawn({
        let cluster = Arc::clone(&cluster);
        async move { cluster.client().scales(asked(), &[], |_| {}).await }
    });
    let id = WorkerId([1; 16]);
    cluster.register(id, Introduction::sample("one", 1)).unwrap();
    let poll = Poll { sequence: 1, wanted: 3, ..Poll::default() };
    let jobs = cluster.poll((id, principal()), poll).await.unwrap().jobs;
    let report = |(lease, task): &(Lease, Arc<Task>)| {
        let result = TaskResult::Scale(f64::from(number(task.subject())) / 10.0);
        Report { lease: *lease, run_seconds: 0.1, outcome: Ok(result) }
    };
    let finished: Vec<Report> = jobs.iter().rev().map(report).collect();
    assert_eq!(finished.len(), 3);
    cluster.poll((id, principal()), Poll { sequence: 2, finished, ..Poll::default() }).await.unwrap();
    // What names them must not be handed out before they are on the disk.
    for _ in 0..100 {
        tokio::task::yield_now().await;
    }
    assert!(!scaled.is_finished());
    held.commit();
    let scales = scaled.await.unwrap().unwrap();
    assert_eq!(scales.iter().map(|one| one.result.scale).collect::<Vec<f64>>(), [0.5, 0.6, 0.7]);

    let accepted = asked().into_iter().zip(&scales).map(|(asked, scale)| {
        let job = Task::Scale(asked).job(0);
        assert_eq!(job, scale.job);
        let result = TaskResult::Scale(scale.result.scale);
        let Finished {
            worker_id, worker, principal, seconded, assurance, attempt, queued, run_seconds, ..
        } = scale.clone();
        let accepted = AcceptedResult {
            result,
            worker_id,
            worker,
            principal,
            seconded,
            assurance,
            attempt,
            queued,
            run_seconds,
        };
        (job, Box::new(accepted))
    });
    let recorded = Recorded { starts: 2, accepted: accepted.collect(), ..Recorded::default() };
    let (journal, _held) = Journal::held();
    let cluster = Cluster::with_journal(LIMITS, identity(), journal, recorded);
    let again = cluster.client().scales(asked(), &[], |_| {}).await.unwrap();
    assert_eq!(again, scales, "nobody is there to compute them");
}

/// What a worker reports for a task, where every query is nearest to the first cloud of a tile.
fn answer(task: &Task) -> TaskResult {
    match task {
        Task::Scale(scale) => TaskResult::Scale(f64::from(number(&scale.subject)) / 10.0),
        Task::Description(shard) => {
            TaskResult::Description(Described::new(vec![7; 8 * shard.clouds as usize]))
        }
        Task::Tile(Tile { evaluation, .. }) => {
            let found = Match { nearest: 0, distance: 0.5, runner_up: None };
            let queries = evaluation.queries;
            let matches = vec![found; queries as usize];
            TaskResult::Evaluation(EvaluationResult { queries, matches, ..EvaluationResult::default() })
        }
        Task::Evaluation(_) | Task::GridCell(_) => panic!("{task}"),
    }
}

#[tokio::test]
async fn an_evaluation_is_handed_out_once_its_own_scale_is_on_the_disk_and_before_others_are_found() {
    let (journal, held) = Journal::held();
    let cluster = Cluster::with_journal(LIMITS, identity(), journal, Recorded::default());
    let evaluated = tokio::spawn({
        let cluster = Arc::clone(&cluster);
        let awaiting = AwaitingScales {
            evaluation: Evaluation { scales: vec![1.0], ..evaluation() },
            awaited: vec![(0, 0)],
        };
        let scales = [5, 6].map(scale).to_vec();
        async move { cluster.client().evaluate_and_scale(vec![awaiting], (scales, &[]), |_, _| {}).await }
    });
    let workers = [("one", 1), ("two", 2), ("three", 3)].map(|(name, address)| {
        let introduction = Introduction::sample(name, address);
        let caller = (WorkerId([address; 16]), introduction.principal);
        cluster.register(caller.0, introduction).unwrap();
        caller
    });
    let poll = |worker: usize, poll| {
        let (cluster, caller) = (Arc::clone(&cluster), workers[worker]);
        tokio::spawn(async move { cluster.poll(caller, poll).await.unwrap().jobs })
    };
    let first = || Poll { sequence: 1, wanted: 1, ..Poll::default() };
    let [found, missing] = [0, 1].map(|worker| poll(worker, first()));
    let (found, missing) = (found.await.unwrap(), missing.await.unwrap());
    let [(lease, task), (_, other)] = [&found[0], &missing[0]];
    assert_eq!([task, other].map(|task| number(task.subject())), [5, 6]);
    let next = poll(2, first());
    let report = Report { lease: *lease, run_seconds: 0.1, outcome: Ok(answer(task)) };
    let _reported = poll(0, Poll { sequence: 2, finished: vec![report], ..Poll::default() });
    for _ in 0..100 {
        tokio::task::yield_now().await;
    }
    assert!(!next.is_finished(), "a start after this moment would not know the scale");
    while !next.is_finished() {
        held.commit();
        tokio::task::yield_now().await;
    }
    let jobs = next.await.unwrap();
    let [(_, task)] = &jobs[..] else { panic!("{jobs:?}") };
    let Task::Evaluation(evaluation) = &**task else { panic!("{task}") };
    assert_eq!((&evaluation.scales[..], evaluated.is_finished()), (&[0.5][..], false));
    evaluated.abort();
}

#[tokio::test]
async fn scales_and_evaluations_that_are_sharded_at_the_same_time_are_told_from_each_other() {
    let cluster = Cluster::new(LIMITS);
    cluster.set_shard_count(ShardCount::Fixed(4.try_into().unwrap()));
    let entry = |index: u32| CloudEntry {
        digest: Digest([1; 32]),
        bytes: 1,
        label: Label { category: 0, instance: 0 },
        path: index.to_string(),
        sequence: None,
    };
    let split = SplitManifest { split: "train".to_owned(), clouds: (0..9).map(entry).collect() };
    let split = vec![cluster.blobs.publish_bytes(split.encode())];
    let asked = Evaluation { query: split.clone(), database: split.clone(), ..evaluation() };
    let mut client = cluster.client();
    let scales = [5, 6, 7].map(|number| Scale { splits: split.clone(), ..scale(number) });
    let asked = client.evaluate_and_scale(vec![asked.into()], (scales.to_vec(), &[]), |_, _| {});
    let work = async {
        let id = WorkerId([1; 16]);
        cluster.register(id, Introduction::sample("one", 1)).unwrap();
        let mut finished: Vec<Report> = Vec::new();
        for sequence in 1.. {
            let poll =
                Poll { sequence, finished: std::mem::take(&mut finished), wanted: 2, ..Poll::default() };
            for (lease, task) in cluster.poll((id, principal()), poll).await.unwrap().jobs.into_iter().rev() {
                finished.push(Report { lease, run_seconds: 0.1, outcome: Ok(answer(&task)) });
            }
            tokio::task::yield_now().await;
        }
    };
    let (evaluated, scales) = tokio::select! {
        done = asked => done.unwrap(),
        () = work => unreachable!("it goes on"),
    };
    assert_eq!(evaluated.iter().map(|one| one.result.object_correct).collect::<Vec<_>>(), [9]);
    assert_eq!(scales.iter().map(|one| one.result.scale).collect::<Vec<f64>>(), [0.5, 0.6, 0.7]);
    for scale in scales {
        let [described] = &scale.result.described[..] else { panic!("{scale:?}") };
        assert_eq!((described.split, described.shards.len()), (split[0], 4));
        let descriptions = described.shards.iter().map(|shard| shard.description);
        assert!(descriptions.map(|digest| cluster.blobs.read(digest)).all(|kept| kept.is_ok()));
    }
}

#[tokio::test]
async fn a_run_whose_answers_cannot_be_kept_ends() {
    let (journal, held) = Journal::held();
    let cluster = Cluster::with_journal(LIMITS, identity(), journal, Recorded::default());
    held.fail();
    let ended = cluster.client().evaluate(vec![evaluation()], |_| {}).await;
    assert!(matches!(ended, Err(ClusterError::Journal(_))));
    assert!(cluster.flush().await.is_err());
}

#[tokio::test]
async fn a_cell_that_is_never_answered_well_is_named() {
    let failed = evaluate(|number| vec![number; if number == 6 { 3 } else { 2 }]).await;
    let message = failed.unwrap_err().to_string();
    assert!(message.starts_with("grid cell of descriptor 6: failed 2 times, got\n"), "{message}");
    assert!(message.contains("one: invalid result: counts: must be 2, got 3"), "{message}");
}

#[tokio::test]
async fn a_silent_worker_is_removed_although_nobody_waits_for_results() {
    // Longer than two ticks, because time in which the coordinator seems to have been stopped counts against nobody.
    let limits = Limits { lease: Duration::from_millis(1200), ..LIMITS };
    let (cluster, id) = (Cluster::new(limits), WorkerId([1; 16]));
    let (registered, mut events) = (std::time::Instant::now(), cluster.events());
    cluster.register(id, Introduction::sample("one", 1)).unwrap();
    let removed = loop {
        events.wait().await;
        let departed = |kind: &EventKind| match kind {
            EventKind::Departed { worker, departure, .. } => Some((*worker, *departure)),
            _ => None,
        };
        if let Some(removed) = events.read().iter().find_map(|event| departed(&event.kind)) {
            break removed;
        }
    };
    assert_eq!(removed, (id, Departure::Lost));
    assert!(registered.elapsed() >= limits.lease, "not before its lease ends");
    cluster.begun.send_replace(true);
    assert_eq!(
        cluster.poll((id, principal()), Poll::default()).await.unwrap_err(),
        PollRefusal::UnknownWorker
    );
}

/// A run must not end with what it has not been able to look up.
#[tokio::test]
async fn results_that_cannot_be_read_end_the_run() {
    let on_failing_disk = |fails: bool| {
        let cluster = Cluster::new(LIMITS);
        let (jobs, [_, without_blocks]) = crate::store::tests::on_failing_disks();
        cluster.state().scheduler.jobs = jobs;
        without_blocks.store(fails, std::sync::atomic::Ordering::Relaxed);
        cluster
    };
    let sound = on_failing_disk(false);
    assert_eq!(sound.answerers().unwrap().len(), 1);
    assert_eq!(sound.provenances().await.unwrap().len(), 0, "of one stranger that nobody has audited");
    assert!(sound.flush().await.is_ok());

    let failing = on_failing_disk(true);
    assert_eq!(failing.answerers().unwrap().len(), 1, "nothing was looked up");
    assert!(matches!(failing.provenances().await, Err(ClusterError::Spill(_))));
    assert!(matches!(failing.answerers(), Err(ClusterError::Spill(_))));
    let cluster = on_failing_disk(true);
    assert!(cluster.flush().await.is_ok(), "nothing was looked up");
    for number in 0..1000 {
        cluster.provenance(&Task::Evaluation(Evaluation::sample(number, 10, 10)));
    }
    assert!(matches!(cluster.flush().await, Err(ClusterError::Spill(_))));
    assert!(matches!(cluster.client().has_all(), Err(ClusterError::Spill(_))));
}

/// Nor what it has made of names that it could not look up.
#[tokio::test]
async fn names_that_cannot_be_looked_up_end_the_run() {
    let cluster = Cluster::new(LIMITS);
    let mut client = cluster.client();
    let fails = clients::tests::ask_with_names_on_failing_disk(&mut cluster.state().clients, client.id());
    assert!(cluster.check_spilled().is_ok());
    assert_eq!((client.events().await.unwrap().len(), client.begins_again().unwrap()), (0, false));
    fails.store(true, std::sync::atomic::Ordering::Relaxed);
    for number in 0..200 {
        cluster.state().clients.name(client.id(), &clients::tests::task(number));
    }
    assert!(matches!(client.events().await, Err(ClusterError::Spill(_))));
    assert!(matches!(client.begins_again(), Err(ClusterError::Spill(_))));
    assert!(matches!(cluster.flush().await, Err(ClusterError::Spill(_))));
}

#[tokio::test]
async fn workers_of_an_earlier_start_of_this_process_have_ended_and_others_go_on() {
    let [own, other] = [WorkerId([1; 16]), WorkerId([2; 16])];
    let first = Arc::new(EventLog::new(Vec::new()));
    for (worker, label) in [(own, "own"), (other, "other")] {
        let (label, introduction) = (label.to_owned(), Introduction::sample("host", 1));
        first.append(SystemTime::UNIX_EPOCH, EventKind::Joined { worker, label, introduction });
    }
    let events = first.follow().read_to_end().iter().map(|event| (**event).clone()).collect();
    let member = Member { label: "other".to_owned(), introduction: Introduction::sample("host", 1) };
    let recorded = Recorded { starts: 2, events, members: [(other, member)].into(), ..Recorded::default() };
    let (journal, held) = Journal::held();
    let cluster = Cluster::with_journal(LIMITS, identity(), journal, recorded);
    let ended = cluster.events().read_to_end();
    let [ended] = &ended[..] else { panic!("{ended:?}") };
    assert_eq!(
        (ended.sequence, &ended.kind),
        (2, &EventKind::Ended { worker: own, label: "own".to_owned() })
    );
    assert_eq!(held.commit(), 1, "it is kept");
}
