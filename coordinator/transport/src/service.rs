//! The gRPC service: converts, asks the cluster, converts back.

use std::sync::Arc;

use proto::v2::coordinator_server::{Coordinator, CoordinatorServer};
use proto::{Digest, Introduction, MAX_MESSAGE_BYTES, MAX_NAME_BYTES, PROTOCOL_MAJOR, WorkerId, v1, v2};
use tokio::sync::Semaphore;
use tonic::{Request, Response, Status};

use crate::blob_stream::BlobStream;
use crate::connection::Connection;
use crate::wire;
use cluster::Cluster;
use cluster::blobs::BlobError;
use cluster::scheduler::{PollRefusal, RegisterRefusal};

/// See [`Service::blobs`].
const BLOBS_AT_ONCE: usize = 64;

/// What a worker is told that was wrong.
const QUARANTINED: &str = "answers: two other workers contradict one that this worker gave, so that none of its answers counts any more\ncheck this machine's memory and clock rate, and start the worker again";

/// Entries that the coordinator has in its own store, by kind and key: `None` if there is none, or if it must not be
/// given away yet.
pub type DerivedEntries = Arc<dyn Fn(&str, Digest) -> Option<Vec<u8>> + Send + Sync>;

/// What this program is, for workers of another release.
#[derive(Clone, Copy, Debug)]
pub struct Release {
    /// Its name and version.
    pub build: &'static str,
    /// Version of the numbers that an evaluation gives.
    pub evaluation_version: u32,
}

impl Release {
    /// What a worker of another protocol version is told.
    fn other_protocol(self, got: u32) -> String {
        let Self { build, .. } = self;
        format!(
            "protocol version: must be {PROTOCOL_MAJOR}, got {got}\ninstall the coordinator's release ({build}) on this worker"
        )
    }
}

/// Answers workers of version 1 of the protocol, which cannot call the service of this one.
pub struct RefusalOfV1(pub Release);

#[tonic::async_trait]
impl v1::coordinator_server::Coordinator for RefusalOfV1 {
    async fn register(&self, _: Request<v1::RegisterRequest>) -> Result<Response<v1::RegisterReply>, Status> {
        let reason = v1::RefusalReason::ProtocolVersion.into();
        let refused = v1::Refused { reason, message: self.0.other_protocol(1) };
        Ok(Response::new(v1::RegisterReply { outcome: Some(v1::register_reply::Outcome::Refused(refused)) }))
    }
}

/// Answers workers on behalf of one run.
pub struct Service {
    cluster: Arc<Cluster>,
    release: Release,
    derived: DerivedEntries,
    /// Blobs and entries in memory at once, over all connections: who does not read what it asked for must not fill it.
    blobs: Arc<Semaphore>,
    /// Whether it serves workers of this process.
    in_process: bool,
}

impl Service {
    /// The service, ready to be added to a server.
    pub fn server(
        cluster: Arc<Cluster>,
        (release, derived): (Release, DerivedEntries),
        in_process: bool,
    ) -> CoordinatorServer<Self> {
        let blobs = Arc::new(Semaphore::new(BLOBS_AT_ONCE));
        CoordinatorServer::new(Self { cluster, release, derived, blobs, in_process })
            .max_decoding_message_size(MAX_MESSAGE_BYTES)
            .max_encoding_message_size(MAX_MESSAGE_BYTES)
    }
}

impl Service {
    /// Sends the bytes that `read` gives, when there is room for them.
    async fn send(
        &self,
        connection: Option<Arc<Connection>>,
        read: impl FnOnce() -> Result<Vec<u8>, Status> + Send + 'static,
    ) -> Result<Response<BlobStream>, Status> {
        // Its own permit first: a connection that does not read must not take those of all others.
        let own = match connection {
            Some(connection) => connection.blob_permit().await,
            None => None,
        };
        let permit = Arc::clone(&self.blobs).acquire_owned().await;
        let permit = permit.map_err(|error| Status::internal(error.to_string()))?;
        let read = tokio::task::spawn_blocking(read).await;
        let bytes = read.map_err(|error| Status::internal(error.to_string()))??;
        Ok(Response::new(BlobStream::of(bytes, (own, permit))))
    }
}

/// The connection of a call; none for workers of this process.
fn connection<T>(request: &Request<T>) -> Option<Arc<Connection>> {
    request.extensions().get().cloned()
}

/// Notes which worker speaks over which connection, so that denying one ends the other.
fn note(connection: Option<Arc<Connection>>, worker: WorkerId) -> Result<(), Status> {
    connection.map_or(Ok(()), |connection| connection.note(worker))
}

fn refused(reason: v2::RefusalReason, message: String) -> Response<v2::RegisterReply> {
    let refused = v2::Refused { reason: reason.into(), message };
    Response::new(v2::RegisterReply { outcome: Some(v2::register_reply::Outcome::Refused(refused)) })
}

#[tonic::async_trait]
impl Coordinator for Service {
    async fn register(
        &self,
        request: Request<v2::RegisterRequest>,
    ) -> Result<Response<v2::RegisterReply>, Status> {
        let connection = connection(&request);
        let request = request.into_inner();
        if request.protocol_major != PROTOCOL_MAJOR {
            let message = self.release.other_protocol(request.protocol_major);
            return Ok(refused(v2::RefusalReason::ProtocolVersion, message));
        }
        if request.evaluation_version != self.release.evaluation_version {
            return Ok(refused(
                v2::RefusalReason::EvaluationVersion,
                format!(
                    "evaluation version: must be {}, got {}\ninstall the coordinator's release ({}) on this worker: another one computes other numbers",
                    self.release.evaluation_version, request.evaluation_version, self.release.build
                ),
            ));
        }
        let id = wire::id(&request.worker_id)?;
        let unprintable = |text: &str| text.chars().any(char::is_control);
        if request.name.len() > MAX_NAME_BYTES || unprintable(&request.name) || unprintable(&request.build) {
            return Ok(refused(
                v2::RefusalReason::InvalidRequest,
                format!(
                    "name and build: must be printable, and the name at most {MAX_NAME_BYTES} bytes\nchoose another --name"
                ),
            ));
        }
        let credential = connection.as_ref().and_then(|connection| connection.credential());
        note(connection, id)?;
        let introduction = Introduction {
            name: request.name,
            threads: request.threads,
            build: proto::truncate(&request.build, MAX_NAME_BYTES).to_owned(),
            credential,
        };
        let name = match self.cluster.register(id, introduction, self.in_process) {
            Ok(name) => name,
            Err(RegisterRefusal::Full) => {
                return Err(Status::resource_exhausted(
                    "this coordinator has as many workers as it can take",
                ));
            }
            Err(RegisterRefusal::Quarantined) => {
                return Ok(refused(v2::RefusalReason::Quarantined, QUARANTINED.to_owned()));
            }
        };
        let accepted = v2::Accepted {
            name,
            session_id: self.cluster.session.to_vec(),
            heartbeat_milliseconds: self.cluster.heartbeat().as_millis() as u32,
            hold_milliseconds: self.cluster.hold().as_millis() as u32,
        };
        Ok(Response::new(v2::RegisterReply {
            outcome: Some(v2::register_reply::Outcome::Accepted(accepted)),
        }))
    }

    async fn poll(&self, request: Request<v2::PollRequest>) -> Result<Response<v2::PollReply>, Status> {
        let connection = connection(&request);
        let (worker, session, poll) = wire::poll(request.into_inner())?;
        if session != self.cluster.session {
            return Err(Status::not_found("another run: register again"));
        }
        note(connection, worker)?;
        match self.cluster.poll(worker, poll).await {
            Ok(answer) => Ok(Response::new(wire::reply(answer))),
            Err(PollRefusal::UnknownWorker) => Err(Status::not_found("unknown worker: register again")),
            Err(PollRefusal::Quarantined) => Err(Status::failed_precondition(QUARANTINED)),
            Err(PollRefusal::Stale) => Err(Status::aborted("a newer poll of this worker was seen")),
        }
    }

    type FetchBlobStream = BlobStream;

    async fn fetch_blob(
        &self,
        request: Request<v2::FetchBlobRequest>,
    ) -> Result<Response<Self::FetchBlobStream>, Status> {
        let connection = connection(&request);
        let digest = wire::blob_digest(&request.into_inner())?;
        self.cluster.begun().await; // what is not released by then is told so
        let cluster = Arc::clone(&self.cluster);
        let read = move || {
            cluster.blobs.read(digest).map_err(|error| match error {
                BlobError::Unknown(_) => Status::not_found(error.to_string()),
                BlobError::Read { .. } | BlobError::Changed(_) => Status::data_loss(error.to_string()),
            })
        };
        self.send(connection, read).await
    }

    type FetchDerivedStream = BlobStream;

    async fn fetch_derived(
        &self,
        request: Request<v2::FetchDerivedRequest>,
    ) -> Result<Response<Self::FetchDerivedStream>, Status> {
        let connection = connection(&request);
        let request = request.into_inner();
        let (kind, key) = wire::derived_key(&request)?;
        self.cluster.begun().await;
        let (kind, derived) = (kind.to_owned(), Arc::clone(&self.derived));
        let read = move || {
            derived(&kind, key).ok_or_else(|| {
                Status::not_found(format!("derived entry {key}: this coordinator has none of this name"))
            })
        };
        self.send(connection, read).await
    }
}
