//! The gRPC service: converts, asks the cluster, converts back.

use std::sync::Arc;

use proto::v1::coordinator_server::{Coordinator, CoordinatorServer};
use proto::{BLOB_CHUNK_BYTES, MAX_MESSAGE_BYTES, MAX_NAME_BYTES, PROTOCOL_MAJOR, v1};
use tokio::sync::Semaphore;
use tokio_stream::Stream;
use tonic::{Request, Response, Status};

use crate::blobs::BlobError;
use crate::cluster::Cluster;
use crate::prepared::PreparedClouds;
use crate::scheduler::{Introduction, PollRefusal};
use crate::wire;

/// See [`Service::blobs`].
const BLOBS_AT_ONCE: usize = 64;

/// Answers workers on behalf of one run.
pub struct Service {
    cluster: Arc<Cluster>,
    preparation: v1::Preparation,
    prepared: Arc<PreparedClouds>,
    /// Blobs and entries in memory at once, over all connections: who does not read what it asked for must not fill it.
    blobs: Arc<Semaphore>,
}

impl Service {
    /// The service, ready to be added to a server.
    pub fn server(
        cluster: Arc<Cluster>,
        preparation: v1::Preparation,
        prepared: Arc<PreparedClouds>,
    ) -> CoordinatorServer<Self> {
        let blobs = Arc::new(Semaphore::new(BLOBS_AT_ONCE));
        CoordinatorServer::new(Self { cluster, preparation, prepared, blobs })
            .max_decoding_message_size(MAX_MESSAGE_BYTES)
            .max_encoding_message_size(MAX_MESSAGE_BYTES)
    }
}

type Chunks = std::pin::Pin<Box<dyn Stream<Item = Result<v1::BlobChunk, Status>> + Send>>;

impl Service {
    /// Sends the bytes that `read` gives, when there is room for them.
    async fn send(
        &self,
        read: impl FnOnce() -> Result<Vec<u8>, Status> + Send + 'static,
    ) -> Result<Response<Chunks>, Status> {
        let permit = Arc::clone(&self.blobs).acquire_owned().await;
        let permit = permit.map_err(|error| Status::internal(error.to_string()))?;
        let read = tokio::task::spawn_blocking(read).await;
        let bytes = read.map_err(|error| Status::internal(error.to_string()))??;
        // Pieces are cut when they are sent: a slow reader holds one blob, not two.
        let pieces = (0..bytes.len()).step_by(BLOB_CHUNK_BYTES).map(move |start| {
            let _held_until_sent = &permit;
            let end = bytes.len().min(start + BLOB_CHUNK_BYTES);
            Ok(v1::BlobChunk { data: bytes[start..end].to_vec() })
        });
        Ok(Response::new(Box::pin(tokio_stream::iter(pieces))))
    }
}

fn refused(reason: v1::RefusalReason, message: String) -> Response<v1::RegisterReply> {
    let refused = v1::Refused { reason: reason.into(), message };
    Response::new(v1::RegisterReply { outcome: Some(v1::register_reply::Outcome::Refused(refused)) })
}

#[tonic::async_trait]
impl Coordinator for Service {
    async fn register(
        &self,
        request: Request<v1::RegisterRequest>,
    ) -> Result<Response<v1::RegisterReply>, Status> {
        let request = request.into_inner();
        if request.protocol_major != PROTOCOL_MAJOR {
            return Ok(refused(
                v1::RefusalReason::ProtocolVersion,
                format!(
                    "protocol version: must be {PROTOCOL_MAJOR}, got {}\ninstall the coordinator's release ({}) on this worker",
                    request.protocol_major,
                    worker::BUILD
                ),
            ));
        }
        if request.evaluation_version != descriptor::EVALUATION_VERSION {
            return Ok(refused(
                v1::RefusalReason::EvaluationVersion,
                format!(
                    "evaluation version: must be {}, got {}\ninstall the coordinator's release ({}) on this worker: another one computes other numbers",
                    descriptor::EVALUATION_VERSION,
                    request.evaluation_version,
                    worker::BUILD
                ),
            ));
        }
        let id = wire::id(&request.worker_id)?;
        if request.name.len() > MAX_NAME_BYTES || request.name.chars().any(char::is_control) {
            return Ok(refused(
                v1::RefusalReason::InvalidRequest,
                format!("name: must be printable and at most {MAX_NAME_BYTES} bytes\nchoose another --name"),
            ));
        }
        let introduction = Introduction {
            name: request.name,
            threads: request.threads,
            build: proto::truncate(&request.build, MAX_NAME_BYTES).to_owned(),
        };
        let Some(name) = self.cluster.register(id, introduction) else {
            return Err(Status::resource_exhausted("this coordinator has as many workers as it can take"));
        };
        let accepted = v1::Accepted {
            name,
            session_id: self.cluster.session.to_vec(),
            heartbeat_milliseconds: self.cluster.heartbeat().as_millis() as u32,
            hold_milliseconds: self.cluster.hold().as_millis() as u32,
        };
        Ok(Response::new(v1::RegisterReply {
            outcome: Some(v1::register_reply::Outcome::Accepted(accepted)),
        }))
    }

    async fn poll(&self, request: Request<v1::PollRequest>) -> Result<Response<v1::PollReply>, Status> {
        let (worker, session, poll) = wire::poll(request.into_inner())?;
        if session != self.cluster.session {
            return Err(Status::not_found("this coordinator was started anew: register again"));
        }
        match self.cluster.poll(worker, poll).await {
            Ok(answer) => Ok(Response::new(wire::reply(answer, &self.preparation))),
            Err(PollRefusal::UnknownWorker) => Err(Status::not_found("unknown worker: register again")),
            Err(PollRefusal::Stale) => Err(Status::aborted("a newer poll of this worker was seen")),
        }
    }

    type FetchBlobStream = Chunks;

    async fn fetch_blob(
        &self,
        request: Request<v1::FetchBlobRequest>,
    ) -> Result<Response<Self::FetchBlobStream>, Status> {
        let digest = wire::blob_digest(&request.into_inner())?;
        let cluster = Arc::clone(&self.cluster);
        let read = move || {
            cluster.blobs.read(digest).map_err(|error| match error {
                BlobError::Unknown(_) => Status::not_found(error.to_string()),
                BlobError::Read { .. } | BlobError::Changed(_) => Status::data_loss(error.to_string()),
            })
        };
        self.send(read).await
    }

    type FetchDerivedStream = Chunks;

    async fn fetch_derived(
        &self,
        request: Request<v1::FetchDerivedRequest>,
    ) -> Result<Response<Self::FetchDerivedStream>, Status> {
        let request = request.into_inner();
        let (kind, key) = wire::derived_key(&request)?;
        let (kind, cluster, prepared) =
            (kind.to_owned(), Arc::clone(&self.cluster), Arc::clone(&self.prepared));
        let read = move || {
            let entry = prepared.read(&kind, key, &cluster.blobs);
            entry.ok_or_else(|| {
                Status::not_found(format!("derived entry {key}: this coordinator has none of this name"))
            })
        };
        self.send(read).await
    }
}
