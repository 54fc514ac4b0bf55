//! What the journal says at the next start of what happened in this one.

use proto::journal::Assurance;

use super::*;
use crate::journal::JournalFile;
use crate::journal::tests::header;
use crate::scheduler::ClientId;

const AUDITED: Limits = Limits { audit: Audit { share: 1.0, first: 0 }, ..LIMITS };

/// A cluster whose journal is a file.
fn started(path: &std::path::Path) -> Arc<Cluster> {
    JournalFile::create(path, &header()).unwrap();
    let (file, _, recorded) = JournalFile::open(path).unwrap();
    Cluster::with_journal(AUDITED, identity(), Journal::start(file).unwrap(), recorded)
}

/// What the next start finds.
async fn found(cluster: Arc<Cluster>, path: &std::path::Path) -> Recorded {
    cluster.flush().await.unwrap();
    drop(cluster);
    loop {
        // The thread that writes lets go of the file when it has nothing left to do.
        match JournalFile::open(path) {
            Err(JournalError::InUse { .. }) => tokio::task::yield_now().await,
            other => break other.unwrap().2,
        }
    }
}

/// A worker of this number, each of which stands for itself; the last of the numbers is of the own process.
fn caller(number: u8) -> (WorkerId, Principal) {
    let foreign = Introduction::sample("one", number).principal;
    (WorkerId([number; 16]), if number == u8::MAX { Principal::Coordinator } else { foreign })
}

fn join(cluster: &Cluster, number: u8) {
    let (id, principal) = caller(number);
    cluster.register(id, Introduction { principal, ..Introduction::sample("one", number) }).unwrap();
}

/// Has a worker take the only job and give it so many right answers.
async fn answer_next(cluster: &Cluster, number: u8, correct: u32) {
    let poll = |poll| cluster.poll(caller(number), poll);
    let (lease, _) = poll(Poll { sequence: 1, wanted: 1, ..Poll::default() }).await.unwrap().jobs.remove(0);
    let result = EvaluationResult {
        queries: 9,
        object_correct: correct,
        category_correct: correct,
        ..EvaluationResult::default()
    };
    let finished = vec![Report { lease, run_seconds: 0.1, outcome: Ok(TaskResult::Evaluation(result)) }];
    poll(Poll { sequence: 2, finished, ..Poll::default() }).await.unwrap();
}

fn evaluated(cluster: &Arc<Cluster>) -> tokio::task::JoinHandle<EvaluationResult> {
    let cluster = Arc::clone(cluster);
    tokio::spawn(async move {
        cluster.client().evaluate(vec![evaluation()], |_| {}).await.unwrap().remove(0).result
    })
}

#[tokio::test]
async fn a_worker_that_comes_back_under_another_credential_is_a_member() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("journal");
    let cluster = started(&path);
    let (id, principal) = caller(2);
    join(&cluster, 1);
    let introduction = Introduction { principal, ..Introduction::sample("one", 1) };
    cluster.register(WorkerId([1; 16]), introduction.clone()).unwrap();
    cluster.register(id, introduction.clone()).unwrap();
    let members = found(cluster, &path).await.members;
    assert_eq!(members.keys().copied().collect::<Vec<_>>(), [WorkerId([1; 16]), id]);
    assert!(members.values().all(|member| member.introduction == introduction));
}

#[tokio::test]
async fn what_decides_a_disagreement_stays() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("journal");
    let cluster = started(&path);
    for number in [1, 2, u8::MAX] {
        join(&cluster, number);
    }
    let evaluated = evaluated(&cluster);
    answer_next(&cluster, 1, 3).await;
    answer_next(&cluster, u8::MAX, 4).await;
    assert_eq!(evaluated.await.unwrap().object_correct, 4);
    let recorded = found(cluster, &path).await;
    let job = Task::Evaluation(evaluation()).job(0);
    let accepted = recorded.accepted.get(job).unwrap().expect("the result that was delivered");
    assert_eq!((accepted.principal, accepted.assurance), (Principal::Coordinator, Assurance::Own));
    assert_eq!(recorded.quarantined, [caller(1).1].into());
}

#[tokio::test]
async fn a_result_that_was_checked_is_as_good_as_the_audit_of_the_check() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("journal");
    let cluster = started(&path);
    join(&cluster, 1);
    let evaluated = evaluated(&cluster);
    answer_next(&cluster, 1, 3).await;
    assert_eq!(evaluated.await.unwrap().object_correct, 3);
    cluster.quarantine(caller(1).1);
    join(&cluster, 2);
    answer_next(&cluster, 2, 3).await;
    join(&cluster, 3);
    answer_next(&cluster, 3, 3).await;
    assert!(!cluster.state().is_in_doubt(ClientId::new(1)));
    let accepted = found(cluster, &path).await.accepted.get(Task::Evaluation(evaluation()).job(0)).unwrap();
    let accepted = accepted.expect("a result that was found right");
    assert_eq!((accepted.principal, accepted.seconded), (caller(2).1, Some(caller(3).1)));
    assert_eq!(accepted.assurance, Assurance::Audited);
}
