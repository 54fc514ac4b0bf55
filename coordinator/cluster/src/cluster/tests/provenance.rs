//! On whose word what is known about descriptors is believed by others.

use proto::Fingerprint;
use proto::journal::Assurance;

use super::*;
use crate::scheduler::Basis;

const ONE: Principal = Principal::Certificate(Fingerprint([1; 32]));
const OTHER: Principal = Principal::Certificate(Fingerprint([2; 32]));

/// A result about a descriptor, on the word of these.
fn accept(cluster: &Cluster, descriptor: u32, split: u8, by: (Principal, Option<Principal>, Assurance)) {
    let (principal, seconded, assurance) = by;
    let query = vec![Digest([split; 32])];
    let task = Task::Evaluation(Evaluation { query, ..Evaluation::sample(descriptor, 10, 10) });
    let result = EvaluationResult { queries: 10, ..EvaluationResult::default() };
    let finished = Finished {
        job: task.job(0),
        result: TaskResult::Evaluation(result),
        worker_id: WorkerId([1; 16]),
        worker: "host".to_owned(),
        attempt: 1,
        queued: Duration::ZERO,
        run_seconds: 1.0,
        principal,
        seconded,
        assurance,
    };
    cluster.state().scheduler.jobs.accept(&task, &finished);
}

#[tokio::test]
async fn provenances_are_those_of_all_results_about_a_descriptor_however_many_there_are() {
    let cluster = Cluster::new(LIMITS);
    let own = (Principal::Coordinator, None, Assurance::Own);
    let audited = (ONE, Some(OTHER), Assurance::Audited);
    let alone = (ONE, None, Assurance::Unaudited);
    // First results about all of them, then second ones: those about one descriptor lie far from each other.
    for descriptor in 0..3000 {
        accept(&cluster, descriptor, 1, if descriptor % 3 == 2 { alone } else { own });
    }
    for descriptor in 0..3000 {
        accept(&cluster, descriptor, 2, if descriptor % 2 == 0 { audited } else { own });
    }
    let both = Provenance { principals: [Principal::Coordinator, ONE, OTHER].into(), basis: Basis::Audited };
    let all = cluster.provenances().await.unwrap();
    for descriptor in 0..3000 {
        let expected = match descriptor {
            _ if descriptor % 3 == 2 => None, // one stranger alone has said something about it
            _ if descriptor % 2 == 0 => Some(both.clone()),
            _ => Some(Provenance::own()),
        };
        let bytes = Evaluation::sample(descriptor, 10, 10).subject.descriptor;
        assert_eq!(all.get(&bytes).map(|one| &**one), expected.as_ref(), "{descriptor}");
        assert_eq!(cluster.provenance_about(&bytes).unwrap(), expected, "{descriptor}");
    }
    let unknown = Evaluation::sample(3000, 10, 10).subject.descriptor;
    assert_eq!(cluster.provenance_about(&unknown).unwrap(), None);
}
