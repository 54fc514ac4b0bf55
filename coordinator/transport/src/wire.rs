//! From messages to the coordinator's own types and back: beside the service the only file here that knows both.

use std::sync::Arc;

use cluster::scheduler::{Answer, Poll};
use proto::task::{Report, Task};
use proto::{Digest, Lease, MAX_POLL_ITEMS, SessionId, WorkerId, v2};
use tonic::Status;

/// A reply to a poll.
pub fn reply(answer: Answer) -> v2::PollReply {
    let job = |(lease, task): (Lease, Arc<Task>)| v2::Job {
        lease: Some(lease.into()),
        task: Some(v2::Task::from(&*task)),
    };
    v2::PollReply {
        acknowledged: answer.acknowledged.into_iter().map(Into::into).collect(),
        revoked: answer.revoked.into_iter().map(Into::into).collect(),
        jobs: answer.jobs.into_iter().map(job).collect(),
    }
}

/// An id from the wire.
pub fn id<T: for<'a> TryFrom<&'a [u8], Error = proto::InvalidId>>(bytes: &[u8]) -> Result<T, Status> {
    T::try_from(bytes).map_err(|error| Status::invalid_argument(error.to_string()))
}

/// Who polls in which session, and what it says.
pub fn poll(request: v2::PollRequest) -> Result<(WorkerId, SessionId, Poll), Status> {
    let worker = id(&request.worker_id)?;
    let session = id(&request.session_id)?;
    for (what, items) in [("held", request.held.len()), ("finished", request.finished.len())] {
        if items > MAX_POLL_ITEMS {
            return Err(Status::invalid_argument(format!(
                "{what}: at most {MAX_POLL_ITEMS} items, got {items}"
            )));
        }
    }
    let invalid = |error: proto::task::InvalidMessage| Status::invalid_argument(error.to_string());
    let reports = request.finished.into_iter().map(|report| Report::try_from(report).map_err(invalid));
    let poll = Poll {
        sequence: request.sequence,
        held: request.held.into_iter().map(Into::into).collect(),
        finished: reports.collect::<Result<_, _>>()?,
        wanted: (request.wanted as usize).min(MAX_POLL_ITEMS),
        leaving: request.leaving,
    };
    Ok((worker, session, poll))
}

/// Kind and key of a derived entry that is asked for.
pub fn derived_key(request: &v2::FetchDerivedRequest) -> Result<(&str, Digest), Status> {
    Ok((&request.kind, id(&request.key)?))
}

/// The digest a blob is asked for by.
pub fn blob_digest(request: &v2::FetchBlobRequest) -> Result<Digest, Status> {
    id(&request.digest)
}
