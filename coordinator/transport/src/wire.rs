//! The gRPC service: messages become the coordinator's own types and back. The only file here that knows wire types.

use std::sync::Arc;

use prost::Message as _;
use proto::task::{InvalidMessage, Report, Task};
use proto::v2::coordinator_server::{Coordinator, CoordinatorServer};
use proto::v2::register_reply::Outcome;
use proto::{
    Digest, InvalidId, Lease, MAX_MESSAGE_BYTES, MAX_POLL_ITEMS, MAX_PRESIGNED_URLS, SessionId, WorkerId,
    WorkerSecret, v1, v2,
};
use tokio_stream::StreamExt as _;
use tokio_stream::adapters::Map;
use tonic::{Request, Response, Status};

use crate::blob_stream::{BlobStream, Chunk};
use crate::connection::Caller;
use crate::presigner::{ObjectRequest, SignedUrl};
use crate::service::{Accepted, Refusal, Registration, Release, Service};
use cluster::scheduler::{Answer, Poll};

/// Longest name of a kind of entry of the cache, bytes.
const MAX_KIND_BYTES: usize = 64;

/// What a call is answered with.
type Answered<T> = Result<Response<T>, Status>;

/// The service as a server takes it.
pub type Rpc = CoordinatorServer<Service>;

/// A service, ready to be added to a server.
pub fn rpc(service: Service) -> Rpc {
    CoordinatorServer::new(service)
        .max_decoding_message_size(MAX_MESSAGE_BYTES)
        .max_encoding_message_size(MAX_MESSAGE_BYTES)
}

/// What answers workers of version 1 of the protocol, which cannot call the service of this one.
pub fn refusal_of_v1(release: Release) -> v1::coordinator_server::CoordinatorServer<Release> {
    v1::coordinator_server::CoordinatorServer::new(release)
}

#[tonic::async_trait]
impl v1::coordinator_server::Coordinator for Release {
    async fn register(&self, request: Request<v1::RegisterRequest>) -> Answered<v1::RegisterReply> {
        let refusal = Refusal::ProtocolVersion { got: 1, release: *self };
        if let ((Some(connection), _), Some(reason)) = (opened(request), refusal.counted()) {
            connection.note_refusal(reason);
        }
        let (reason, message) = (v1::RefusalReason::ProtocolVersion.into(), refusal.to_string());
        let refused = v1::Refused { reason, message };
        Ok(Response::new(v1::RegisterReply { outcome: Some(v1::register_reply::Outcome::Refused(refused)) }))
    }
}

#[tonic::async_trait]
impl Coordinator for Service {
    type FetchBlobStream = BlobChunks;
    type FetchDerivedStream = BlobChunks;

    async fn register(&self, request: Request<v2::RegisterRequest>) -> Answered<v2::RegisterReply> {
        let (caller, request) = opened(request);
        let worker = speaker(&request.worker_id, &request.worker_secret);
        let v2::RegisterRequest { protocol_major, protocol_minor, evaluation_version, .. } = request;
        let v2::RegisterRequest { name, threads, build, .. } = request;
        let registration =
            Registration { protocol_major, protocol_minor, evaluation_version, worker, name, threads, build };
        let outcome = match self.register(caller, registration) {
            Ok(Accepted { name, session, heartbeat, hold, audit, has_bucket }) => {
                Outcome::Accepted(v2::Accepted {
                    name,
                    session_id: session.to_vec(),
                    heartbeat_milliseconds: heartbeat.as_millis() as u32,
                    hold_milliseconds: hold.as_millis() as u32,
                    audit,
                    has_bucket,
                    takes_lz4: true,
                })
            }
            Err(refusal) => {
                let reason = match refusal {
                    Refusal::ProtocolVersion { .. } | Refusal::EarlierProtocol { .. } => {
                        v2::RefusalReason::ProtocolVersion
                    }
                    Refusal::EvaluationVersion { .. } => v2::RefusalReason::EvaluationVersion,
                    Refusal::Unprintable => v2::RefusalReason::InvalidRequest,
                    Refusal::Quarantined(_) => v2::RefusalReason::Quarantined,
                    Refusal::RunEnded => v2::RefusalReason::RunEnded,
                    Refusal::Unproven(status) | Refusal::Crowded(status) | Refusal::Call(status) => {
                        return Err(status);
                    }
                };
                Outcome::Refused(v2::Refused { reason: reason.into(), message: refusal.to_string() })
            }
        };
        Ok(Response::new(v2::RegisterReply { outcome: Some(outcome) }))
    }

    async fn poll(&self, request: Request<v2::PollRequest>) -> Answered<v2::PollReply> {
        let (caller, request) = opened(request);
        let (worker, session, poll) = poll(request)?;
        let answer = self.poll(caller, worker, session, poll).await?;
        Ok(Response::new(reply(answer)))
    }

    async fn fetch_blob(&self, request: Request<v2::FetchBlobRequest>) -> Answered<BlobChunks> {
        let (caller, request) = opened(request);
        self.fetch_blob(caller, id(&request.digest)?, request.takes_lz4).await.map(chunks)
    }

    async fn fetch_derived(&self, request: Request<v2::FetchDerivedRequest>) -> Answered<BlobChunks> {
        let (caller, request) = opened(request);
        let (kind, key) = (kind(request.kind)?, id(&request.key)?);
        self.fetch_derived(caller, kind, key).await.map(chunks)
    }

    async fn presign_urls(&self, request: Request<v2::PresignUrlsRequest>) -> Answered<v2::PresignUrlsReply> {
        let (caller, v2::PresignUrlsRequest { kind, objects }) = opened(request);
        let got = objects.len();
        if got > MAX_PRESIGNED_URLS {
            return Err(Status::invalid_argument(format!(
                "objects: at most {MAX_PRESIGNED_URLS}, got {got}"
            )));
        }
        let objects = objects.into_iter().map(object).collect::<Result<_, _>>()?;
        let urls = self.presign_urls(caller, self::kind(kind)?, objects).await?;
        let sent = |signed: Option<SignedUrl>| match signed {
            None => (String::new(), Vec::new()),
            Some(SignedUrl { url, sha256 }) => (url, sha256.map_or_else(Vec::new, Vec::from)),
        };
        let (urls, sha256) = urls.into_iter().map(sent).unzip();
        Ok(Response::new(v2::PresignUrlsReply { urls, sha256 }))
    }
}

/// An object from the wire.
fn object(object: v2::Object) -> Result<ObjectRequest, Status> {
    let length = object.sha256.len();
    let sha256 = match length {
        0 => None,
        _ => Some(object.sha256.try_into().map_err(|_| {
            Status::invalid_argument(format!("sha256: length must be 0 or 32 bytes, got {length}"))
        })?),
    };
    Ok(ObjectRequest { key: id(&object.key)?, sha256 })
}

/// Who calls, and what is asked.
fn opened<T>(request: Request<T>) -> (Caller, T) {
    (request.extensions().get().cloned(), request.into_inner())
}

/// An id from the wire.
fn id<T: for<'a> TryFrom<&'a [u8], Error = InvalidId>>(bytes: &[u8]) -> Result<T, Status> {
    T::try_from(bytes).map_err(|error| Status::invalid_argument(error.to_string()))
}

/// A kind of entry, which may be kept while the call waits its turn.
fn kind(kind: String) -> Result<String, Status> {
    match kind.len() {
        ..=MAX_KIND_BYTES => Ok(kind),
        got => Err(Status::invalid_argument(format!("kind: at most {MAX_KIND_BYTES} bytes, got {got}"))),
    }
}

/// Who speaks, and what proves it.
fn speaker(worker: &[u8], secret: &[u8]) -> Result<(WorkerId, WorkerSecret), Status> {
    let secret = WorkerSecret::try_from(secret).map_err(|_| {
        Status::invalid_argument(format!("worker_secret: length must be 32 bytes, got {}", secret.len()))
    })?;
    Ok((id(worker)?, secret))
}

/// Who polls in which session, and what it says.
fn poll(request: v2::PollRequest) -> Result<((WorkerId, WorkerSecret), SessionId, Poll), Status> {
    let worker = speaker(&request.worker_id, &request.worker_secret)?;
    let session = id(&request.session_id)?;
    for (what, items) in [("held", request.held.len()), ("finished", request.finished.len())] {
        if items > MAX_POLL_ITEMS {
            return Err(Status::invalid_argument(format!(
                "{what}: at most {MAX_POLL_ITEMS} items, got {items}"
            )));
        }
    }
    let got: u64 = request.finished.iter().map(|report| u64::from(lz4_length(report))).sum();
    // A short block can be said to hold any number of bytes, and taking in many of them would keep a processor busy.
    if got > MAX_MESSAGE_BYTES as u64 {
        return Err(Status::invalid_argument(format!(
            "finished: at most {MAX_MESSAGE_BYTES} bytes once they are decompressed, got {got}"
        )));
    }
    let invalid = |error: InvalidMessage| Status::invalid_argument(error.to_string());
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

/// How many bytes a report has if its block is decompressed.
fn lz4_length(report: &v2::JobReport) -> u32 {
    match &report.outcome {
        Some(v2::job_report::Outcome::Result(v2::TaskResult {
            result: Some(v2::task_result::Result::Description(described)),
        })) => described.lz4_length,
        _ => 0,
    }
}

/// A reply to a poll.
fn reply(answer: Answer) -> v2::PollReply {
    let job = |(lease, task): (Lease, Arc<Task>)| v2::Job {
        lease: Some(lease.into()),
        task: Some(v2::Task::from(&*task)),
    };
    v2::PollReply {
        acknowledged: answer.acknowledged.into_iter().map(Into::into).collect(),
        revoked: answer.revoked.into_iter().map(Into::into).collect(),
        jobs: answer.jobs.into_iter().map(job).collect(),
        run_ended: answer.run_ended,
    }
}

/// A blob as messages.
type BlobChunks = Map<BlobStream, fn(Result<Chunk, Status>) -> Result<v2::BlobChunk, Status>>;

fn chunks(blob: BlobStream) -> Response<BlobChunks> {
    Response::new(blob.map(|chunk| {
        let Chunk { data, lz4_length } = chunk?;
        Ok(v2::BlobChunk { data, lz4_length })
    }))
}

/// Whether these bytes are a poll of a worker.
pub fn reads_poll(bytes: &[u8]) -> bool {
    v2::PollRequest::decode(bytes).is_ok_and(|request| poll(request).is_ok())
}

/// Whether these bytes ask for a blob or an entry.
pub fn reads_fetch(bytes: &[u8]) -> bool {
    let is_digest = |bytes: Vec<u8>| id::<Digest>(&bytes).is_ok();
    v2::FetchBlobRequest::decode(bytes).is_ok_and(|request| is_digest(request.digest))
        || v2::FetchDerivedRequest::decode(bytes).is_ok_and(|request| is_digest(request.key))
        || v2::PresignUrlsRequest::decode(bytes)
            .is_ok_and(|request| request.objects.into_iter().all(|one| object(one).is_ok()))
}
