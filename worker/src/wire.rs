//! From messages to the worker's own types and back: the only file here that knows both.

use std::time::Duration;

use prost::Message as _;
use proto::task::{InvalidMessage, Report, Task};
use proto::v2::coordinator_client::CoordinatorClient;
use proto::v2::register_reply::Outcome;
use proto::{Compressed, Digest, Lease, MAX_MESSAGE_BYTES, SessionId, WorkerSecret, v2};
use tonic::{Request, Status, Streaming};

use crate::identity::{BUILD, Identity};
use crate::link::Link;

/// Calls to the coordinator.
#[derive(Clone, Debug)]
pub struct Client(CoordinatorClient<Link>);

/// What a coordinator says to a worker that registers.
#[derive(Debug)]
pub enum Registration {
    /// It may poll.
    Accepted(Accepted),
    /// It never will: why, and what to do.
    Refused(String),
    /// The run has ended.
    RunEnded,
}

/// How a worker that was accepted has to behave.
#[derive(Debug)]
pub struct Accepted {
    /// The label under which it appears in progress and results.
    pub name: String,
    /// The run.
    pub session: SessionId,
    /// A busy worker polls at least this often.
    pub heartbeat: Duration,
    /// The longest time for which a poll is held back.
    pub hold: Duration,
    /// The share of the clouds prepared by others that it prepares again, from 0 to 1.
    pub audit: f64,
    /// Whether the machines of the run share a bucket.
    pub has_bucket: bool,
    /// Whether the coordinator takes descriptions compressed.
    pub takes_compressed: bool,
}

/// An object of the bucket for which a URL is wanted.
#[derive(Clone, Debug)]
pub struct ObjectRequest {
    /// Which one.
    pub key: Digest,
    /// SHA-256 of the bytes that are to be stored; `None`: it is to be read.
    pub sha256: Option<Vec<u8>>,
}

/// A URL that is good for one object and one method.
#[derive(Clone, Debug)]
pub struct SignedUrl {
    /// The URL.
    pub url: String,
    /// SHA-256 of the bytes that may be used; `None`: whatever is there may be used.
    pub sha256: Option<Vec<u8>>,
}

/// What a worker says in one poll.
#[derive(Debug)]
pub struct Poll {
    /// Who polls, proven.
    pub secret: WorkerSecret,
    /// In which run; `None` before the first.
    pub session: Option<SessionId>,
    /// Grows with each poll.
    pub sequence: u64,
    /// Every lease it holds.
    pub held: Vec<Lease>,
    /// Finished and not acknowledged.
    pub finished: Vec<Report>,
    /// Whether the coordinator takes descriptions compressed.
    pub takes_compressed: bool,
    /// How many more jobs it takes.
    pub wanted: usize,
    /// Whether it is about to stop.
    pub leaving: bool,
}

/// What a poll is answered with.
#[derive(Clone, Debug, Default)]
pub struct Reply {
    /// Reports that need not be sent again.
    pub acknowledged: Vec<Lease>,
    /// Leases that are no longer wanted.
    pub revoked: Vec<Lease>,
    /// New leases.
    pub jobs: Vec<Job>,
    /// Whether the run has ended.
    pub run_ended: bool,
}

/// Until a stream begins: behind those of all other workers, which may be many.
const QUEUED: Duration = Duration::from_secs(30 * 60);
/// Until its next part is there; the coordinator gives up sooner.
const CHUNK: Duration = Duration::from_secs(180);

/// A lease with what is to be done under it.
#[derive(Clone, Debug)]
pub struct Job {
    /// The lease.
    pub lease: Lease,
    /// The task, if it can be read.
    pub task: Result<Task, InvalidMessage>,
}

impl Client {
    /// Calls over a link.
    pub fn new(link: Link) -> Self {
        let client = CoordinatorClient::new(link);
        Self(client.max_decoding_message_size(MAX_MESSAGE_BYTES).max_encoding_message_size(MAX_MESSAGE_BYTES))
    }

    /// Introduces a worker.
    pub async fn register(
        &mut self,
        secret: &WorkerSecret,
        identity: &Identity,
        timeout: Duration,
    ) -> Result<Registration, Status> {
        let mut request = Request::new(v2::RegisterRequest {
            protocol_major: proto::PROTOCOL_MAJOR,
            protocol_minor: proto::PROTOCOL_MINOR,
            evaluation_version: descriptor::EVALUATION_VERSION,
            worker_id: secret.id().to_vec(),
            worker_secret: secret.reveal(),
            name: identity.name.clone(),
            threads: identity.threads,
            build: BUILD.to_owned(),
        });
        request.set_timeout(timeout);
        match within(timeout, self.0.register(request)).await?.into_inner().outcome {
            Some(Outcome::Accepted(accepted)) => Ok(Registration::Accepted(Accepted {
                session: SessionId::try_from(&accepted.session_id[..])
                    .map_err(|error| Status::internal(error.to_string()))?,
                name: accepted.name,
                heartbeat: Duration::from_millis(accepted.heartbeat_milliseconds.max(1).into()),
                hold: Duration::from_millis(accepted.hold_milliseconds.into()),
                audit: if accepted.audit.is_nan() { 1.0 } else { accepted.audit.clamp(0.0, 1.0) },
                has_bucket: accepted.has_bucket,
                takes_compressed: accepted.takes_lz4,
            })),
            Some(Outcome::Refused(refused)) if refused.reason() == v2::RefusalReason::RunEnded => {
                Ok(Registration::RunEnded)
            }
            Some(Outcome::Refused(refused)) => Ok(Registration::Refused(refused.message)),
            None => Err(Status::internal("the reply to the registration is empty")),
        }
    }

    /// Heartbeat, finished work and request for more.
    pub async fn poll(mut self, poll: Poll, timeout: Duration) -> Result<Reply, Status> {
        let sent = |report: Report| match poll.takes_compressed {
            true => report.into(),
            false => report.uncompressed().into(),
        };
        let mut request = Request::new(v2::PollRequest {
            worker_id: poll.secret.id().to_vec(),
            worker_secret: poll.secret.reveal(),
            session_id: poll.session.map_or_else(Vec::new, SessionId::to_vec),
            sequence: poll.sequence,
            held: poll.held.into_iter().map(Into::into).collect(),
            finished: poll.finished.into_iter().map(sent).collect(),
            wanted: poll.wanted as u32,
            leaving: poll.leaving,
        });
        request.set_timeout(timeout);
        Ok(reply(within(timeout, self.0.poll(request)).await?.into_inner()))
    }

    /// The blob with this digest, unchecked; `None` if it has more than `most` bytes.
    pub async fn fetch_blob(&self, digest: Digest, most: u64) -> Result<Option<Vec<u8>>, Status> {
        let request = v2::FetchBlobRequest { digest: digest.to_vec(), takes_lz4: true };
        let mut client = self.0.clone();
        collect(within(QUEUED, client.fetch_blob(request)).await?.into_inner(), most).await
    }

    /// An entry of the coordinator's store, unchecked; `None` if it has more than `most` bytes.
    pub async fn fetch_derived(&self, kind: &str, key: Digest, most: u64) -> Result<Option<Vec<u8>>, Status> {
        let request = v2::FetchDerivedRequest { kind: kind.to_owned(), key: key.to_vec() };
        let mut client = self.0.clone();
        collect(within(QUEUED, client.fetch_derived(request)).await?.into_inner(), most).await
    }

    /// URLs of objects in the bucket, in their order; `None` for those that there are none of.
    pub async fn presign_urls(
        &self,
        kind: &str,
        objects: Vec<ObjectRequest>,
        timeout: Duration,
    ) -> Result<Vec<Option<SignedUrl>>, Status> {
        let object = |ObjectRequest { key, sha256 }: ObjectRequest| v2::Object {
            key: key.to_vec(),
            sha256: sha256.unwrap_or_default(),
        };
        let (asked, kind) = (objects.len(), kind.to_owned());
        let objects = objects.into_iter().map(object).collect();
        let mut request = Request::new(v2::PresignUrlsRequest { kind, objects });
        request.set_timeout(timeout);
        let mut client = self.0.clone();
        let reply = within(timeout, client.presign_urls(request)).await?.into_inner();
        let v2::PresignUrlsReply { urls, sha256 } = reply;
        let got = urls.len();
        if got != asked {
            return Err(Status::internal(format!("URLs: must be {asked}, got {got}")));
        }
        let mut sums = sha256.into_iter();
        let signed = |url: String| {
            let sha256 = sums.next().filter(|sum| !sum.is_empty());
            (!url.is_empty()).then_some(SignedUrl { url, sha256 })
        };
        Ok(urls.into_iter().map(signed).collect())
    }
}

/// A call that ends at its deadline. What tonic makes of a request's timeout ends with the headers of the reply: a coordinator
/// that stops after them would be waited for without end.
async fn within<T>(timeout: Duration, call: impl Future<Output = Result<T, Status>>) -> Result<T, Status> {
    let late = |_| Err(Status::deadline_exceeded(format!("no whole reply within {timeout:?}")));
    tokio::time::timeout(timeout, call).await.unwrap_or_else(late)
}

/// What a reply says. A job without a lease cannot be reported: it is as good as not sent.
fn reply(message: v2::PollReply) -> Reply {
    let leases = |leases: Vec<v2::Lease>| leases.into_iter().map(Lease::from).collect();
    let job = |job: v2::Job| {
        let task = job.task.ok_or(InvalidMessage::Missing("job: task")).and_then(Task::try_from);
        Some(Job { lease: job.lease?.into(), task })
    };
    Reply {
        acknowledged: leases(message.acknowledged),
        revoked: leases(message.revoked),
        jobs: message.jobs.into_iter().filter_map(job).collect(),
        run_ended: message.run_ended,
    }
}

/// What bytes say as the reply to a poll; `None` if they are none.
pub fn decode_reply(bytes: &[u8]) -> Option<Reply> {
    v2::PollReply::decode(bytes).ok().map(reply)
}

/// All bytes of a stream, decompressed; `None` if there are more than `most`.
async fn collect(mut stream: Streaming<v2::BlobChunk>, most: u64) -> Result<Option<Vec<u8>>, Status> {
    let (mut bytes, mut lz4_length) = (Vec::new(), 0);
    while let Some(chunk) = within(CHUNK, stream.message()).await? {
        lz4_length = chunk.lz4_length;
        if (bytes.len() + chunk.data.len()) as u64 > most || u64::from(lz4_length) > most {
            return Ok(None);
        }
        bytes.extend_from_slice(&chunk.data);
    }
    if lz4_length == 0 {
        return Ok(Some(bytes));
    }
    let decompressed = Compressed::of_block(bytes, lz4_length).decompress();
    decompressed.map(Some).map_err(|error| Status::data_loss(error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_job_without_a_task_is_kept_to_be_reported_and_one_without_a_lease_is_not() {
        let lease = v2::Lease { job: 7, attempt: 2, nonce: vec![3; 16] };
        let jobs = vec![v2::Job { lease: Some(lease.clone()), task: None }, v2::Job::default()];
        let reply =
            reply(v2::PollReply { acknowledged: vec![lease.clone()], jobs, ..v2::PollReply::default() });
        assert_eq!(reply.acknowledged, [Lease::from(lease.clone())]);
        let [Job { lease: found, task: Err(error) }] = &reply.jobs[..] else { panic!("{reply:?}") };
        assert_eq!(*found, Lease::from(lease));
        assert!(error.to_string().starts_with("job: task: missing"), "{error}");
    }
}
