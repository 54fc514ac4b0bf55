//! Answers workers on behalf of one run: registrations, polls, and what they fetch.

use std::sync::Arc;
use std::time::Duration;

use proto::{
    Digest, Introduction, MAX_NAME_BYTES, PROTOCOL_MAJOR, PROTOCOL_MINOR, Principal, SessionId, WorkerId,
    WorkerSecret,
};
use tokio::sync::Semaphore;
use tonic::Status;

use crate::blob_stream::BlobStream;
use crate::connection::{Caller, Connection};
use crate::presigner::{ObjectRequest, Presigner, SignedUrl};
use crate::principal_share::PrincipalShare;
use cluster::Cluster;
use cluster::blobs::{Blob, BlobError};
use cluster::scheduler::{Answer, Poll, PollRefusal, RegisterRefusal};

/// See [`Service::blobs`].
const BLOBS_AT_ONCE: usize = 64;
/// Of these, those of one principal: whatever it does with them, others get some.
const BLOBS_OF_ONE: usize = 48;

/// Entries that the coordinator has in its own store, by kind and key: `None` if there is none, or if it must not be
/// given away yet.
pub type DerivedEntries = Arc<dyn Fn(&str, Digest) -> Option<Vec<u8>> + Send + Sync>;

/// What a run gives to its workers beside blobs.
#[derive(Clone)]
pub struct SharedEntries {
    /// Entries of the coordinator's own store.
    pub derived: DerivedEntries,
    /// URLs to the bucket that its machines share, if there is one.
    pub presigner: Option<Arc<Presigner>>,
}

/// What this program is, for workers of another release.
#[derive(Clone, Copy, Debug)]
pub struct Release {
    /// Its name and version.
    pub build: &'static str,
    /// Version of the numbers that an evaluation gives.
    pub evaluation_version: u32,
}

/// How a worker asks to be let in.
pub struct Registration {
    /// Version of the protocol that it speaks.
    pub protocol_major: u32,
    /// What was added to that version as far as it knows.
    pub protocol_minor: u32,
    /// Version of the numbers that its evaluations give.
    pub evaluation_version: u32,
    /// Its id, and what proves it; why that cannot be, of one that may be of an earlier release.
    pub worker: Result<(WorkerId, WorkerSecret), Status>,
    /// The name its operator gave it.
    pub name: String,
    /// Threads that evaluate.
    pub threads: u32,
    /// Its build string.
    pub build: String,
}

/// How a worker that is registered has to behave.
pub struct Accepted {
    /// The label under which it appears in progress and results.
    pub name: String,
    /// The run.
    pub session: SessionId,
    /// While busy it polls at least this often.
    pub heartbeat: Duration,
    /// The longest time for which a poll is held back.
    pub hold: Duration,
    /// The share of the clouds prepared by others that it prepares again.
    pub audit: f64,
    /// Whether the machines of the run share a bucket.
    pub has_bucket: bool,
}

/// Why a worker is not registered, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum Refusal {
    /// It speaks another version of the protocol.
    #[error(
        "protocol version: must be {PROTOCOL_MAJOR}, got {got}\ninstall the coordinator's release ({build}) on this worker",
        build = .release.build
    )]
    ProtocolVersion {
        /// Its version.
        got: u32,
        /// What this program is.
        release: Release,
    },
    /// It would pass over what was added to tasks since its release, and compute something else.
    #[error(
        "protocol version: must be at least {PROTOCOL_MAJOR}.{PROTOCOL_MINOR}, got {PROTOCOL_MAJOR}.{got}\ninstall the coordinator's release ({build}) on this worker",
        build = .release.build
    )]
    EarlierProtocol {
        /// Its minor version.
        got: u32,
        /// What this program is.
        release: Release,
    },
    /// It computes other numbers.
    #[error(
        "evaluation version: must be {expected}, got {got}\ninstall the coordinator's release ({build}) on this worker: another one computes other numbers",
        expected = .release.evaluation_version,
        build = .release.build
    )]
    EvaluationVersion {
        /// Its version.
        got: u32,
        /// What this program is.
        release: Release,
    },
    /// Its texts are not fit to be shown.
    #[error(
        "name and build: must be printable, and the name at most {MAX_NAME_BYTES} bytes\nchoose another --name"
    )]
    Unprintable,
    /// An answer of its principal was wrong.
    #[error(
        "answers: one that came with this worker's {} was wrong, so that no answer that does counts any more\ncheck this machine's memory and clock rate; whoever runs the coordinator can let it in again with --readmit '{}'", kind(.0), .0
    )]
    Quarantined(Principal),
    /// There is nothing left to do.
    #[error("run: has ended\nstart the worker again for the next run, or with --stay to wait for it")]
    RunEnded,
    /// Its id is not shown to be its own.
    #[error(transparent)]
    Unproven(Status),
    /// More workers than may speak over one connection.
    #[error(transparent)]
    Crowded(Status),
    /// The call itself is wrong, or there are as many workers as there may be.
    #[error(transparent)]
    Call(#[from] Status),
}

impl Refusal {
    /// A few words for it, by which it is counted; `None` for what the cluster counts itself, and for errors of this
    /// program.
    pub(crate) fn counted(&self) -> Option<&'static str> {
        match self {
            Self::ProtocolVersion { .. } | Self::EarlierProtocol { .. } => Some("wrong protocol version"),
            Self::EvaluationVersion { .. } => Some("wrong evaluation version"),
            Self::Unprintable => Some("invalid name or build"),
            Self::Unproven(_) => Some("invalid worker id or secret"),
            Self::Crowded(_) => Some("too many workers over one connection"),
            Self::Quarantined(_) | Self::RunEnded | Self::Call(_) => None,
        }
    }
}

/// Answers workers on behalf of one run.
pub struct Service {
    cluster: Arc<Cluster>,
    release: Release,
    shared: SharedEntries,
    /// Blobs and entries in memory at once, over all connections: who does not read what it asked for must not fill it.
    blobs: Arc<Semaphore>,
    /// What each principal may have of them.
    blobs_of_one: PrincipalShare,
    /// Whether it serves workers of this process.
    in_process: bool,
}

impl Service {
    /// The service of a run, for remote workers or for those of this process.
    pub fn new(cluster: Arc<Cluster>, (release, shared): (Release, SharedEntries), in_process: bool) -> Self {
        let blobs = Arc::new(Semaphore::new(BLOBS_AT_ONCE));
        let blobs_of_one = PrincipalShare::new(BLOBS_OF_ONE);
        Self { cluster, release, shared, blobs, blobs_of_one, in_process }
    }

    /// Who answers for a call.
    fn principal(&self, caller: Option<&Arc<Connection>>) -> Result<Principal, Status> {
        match caller {
            Some(connection) => Ok(connection.principal()),
            None if self.in_process => Ok(Principal::Coordinator),
            None => Err(Status::internal("this call has no connection")),
        }
    }

    /// Registers a worker, or says why not.
    pub fn register(&self, caller: Caller, registration: Registration) -> Result<Accepted, Refusal> {
        let registered = self.try_register(caller.as_ref(), registration);
        let reason = registered.as_ref().err().and_then(Refusal::counted);
        if let (Some(reason), Some(connection)) = (reason, caller) {
            connection.note_refusal(reason);
        }
        registered
    }

    fn try_register(
        &self,
        caller: Option<&Arc<Connection>>,
        registration: Registration,
    ) -> Result<Accepted, Refusal> {
        let Registration { protocol_major, protocol_minor, evaluation_version, worker, name, threads, build } =
            registration;
        let release = self.release;
        if protocol_major != PROTOCOL_MAJOR {
            return Err(Refusal::ProtocolVersion { got: protocol_major, release });
        }
        if protocol_minor < PROTOCOL_MINOR {
            return Err(Refusal::EarlierProtocol { got: protocol_minor, release });
        }
        if evaluation_version != release.evaluation_version {
            return Err(Refusal::EvaluationVersion { got: evaluation_version, release });
        }
        let unprintable = |text: &str| !text.chars().all(proto::is_printable);
        if name.len() > MAX_NAME_BYTES || unprintable(&name) || unprintable(&build) {
            return Err(Refusal::Unprintable);
        }
        let principal = self.principal(caller)?;
        let worker = worker.and_then(proven).map_err(Refusal::Unproven)?;
        note(caller, worker).map_err(Refusal::Crowded)?;
        let build = proto::truncate(&build, MAX_NAME_BYTES).to_owned();
        let introduction = Introduction { name, threads, build, principal };
        let registered = self.cluster.register(worker, introduction);
        let name = registered.map_err(|refusal| match refusal {
            RegisterRefusal::Full => Refusal::Call(Status::resource_exhausted(
                "this coordinator has as many workers as it can take",
            )),
            RegisterRefusal::Quarantined => Refusal::Quarantined(principal),
            RegisterRefusal::RunEnded => Refusal::RunEnded,
            RegisterRefusal::Denied => Refusal::Call(Status::permission_denied(
                "this worker was denied by whoever runs the coordinator\nask them why",
            )),
        })?;
        let cluster = &self.cluster;
        let (session, heartbeat, hold) = (cluster.session, cluster.heartbeat(), cluster.hold());
        let has_bucket = self.shared.presigner.is_some();
        Ok(Accepted { name, session, heartbeat, hold, audit: cluster.audit().share, has_bucket })
    }

    /// Answers a poll.
    pub async fn poll(
        &self,
        caller: Caller,
        worker: (WorkerId, WorkerSecret),
        session: SessionId,
        poll: Poll,
    ) -> Result<Answer, Status> {
        if session != self.cluster.session {
            return Err(Status::not_found("another run: register again"));
        }
        let principal = self.principal(caller.as_ref())?;
        let worker = proven(worker)?;
        note(caller.as_ref(), worker)?;
        self.cluster.poll((worker, principal), poll).await.map_err(|refusal| match refusal {
            PollRefusal::UnknownWorker => Status::not_found("unknown worker: register again"),
            PollRefusal::Quarantined => {
                Status::failed_precondition(Refusal::Quarantined(principal).to_string())
            }
            PollRefusal::Stale => Status::aborted("a newer poll of this worker was seen"),
        })
    }

    /// A blob that workers may have; compressed, if it is kept like this and the worker takes it.
    pub async fn fetch_blob(
        &self,
        caller: Caller,
        digest: Digest,
        takes_compressed: bool,
    ) -> Result<BlobStream, Status> {
        self.cluster.begun().await; // what is not released by then is told so
        let cluster = Arc::clone(&self.cluster);
        let read = move || {
            let blob = match takes_compressed {
                true => cluster.blobs.read_as_kept(digest),
                false => cluster.blobs.read(digest).map(Blob::Bytes),
            };
            blob.map_err(|error| match error {
                BlobError::Unknown(_) => Status::not_found(error.to_string()),
                BlobError::Read { .. } | BlobError::Changed(_) => Status::data_loss(error.to_string()),
            })
        };
        self.send(caller, read).await
    }

    /// An entry of the coordinator's own store.
    pub async fn fetch_derived(
        &self,
        caller: Caller,
        kind: String,
        key: Digest,
    ) -> Result<BlobStream, Status> {
        self.cluster.begun().await;
        let derived = Arc::clone(&self.shared.derived);
        let read = move || {
            derived(&kind, key).map(Blob::Bytes).ok_or_else(|| {
                Status::not_found(format!("derived entry {key}: this coordinator has none of this name"))
            })
        };
        self.send(caller, read).await
    }

    /// URLs to the bucket that the machines of this run share; none for whoever was found wrong.
    pub async fn presign_urls(
        &self,
        caller: Caller,
        kind: String,
        objects: Vec<ObjectRequest>,
    ) -> Result<Vec<Option<SignedUrl>>, Status> {
        let (principal, presigner) = (self.principal(caller.as_ref())?, self.shared.presigner.as_ref());
        if self.cluster.is_quarantined(&principal) {
            if let Some(presigner) = presigner {
                presigner.withhold(&kind, &objects);
            }
            return Err(Status::failed_precondition(Refusal::Quarantined(principal).to_string()));
        }
        let Some(presigner) = presigner else {
            return Err(Status::unimplemented("bucket: this coordinator has none"));
        };
        self.cluster.begun().await;
        presigner.urls(principal, kind, objects).await.map_err(Status::unavailable)
    }

    /// Sends the bytes that `read` gives, when there is room for them.
    async fn send(
        &self,
        caller: Caller,
        read: impl FnOnce() -> Result<Blob, Status> + Send + 'static,
    ) -> Result<BlobStream, Status> {
        // Its own permits first: whoever does not read must not take those of all others.
        let own = match caller {
            Some(connection) => {
                let of_connection = connection.blob_permit().await;
                (of_connection, self.blobs_of_one.permit(connection.principal()).await)
            }
            None => (None, None),
        };
        let permit = Arc::clone(&self.blobs).acquire_owned().await;
        let permit = permit.map_err(|error| Status::internal(error.to_string()))?;
        let read = tokio::task::spawn_blocking(read).await;
        let blob = read.map_err(|error| Status::internal(error.to_string()))??;
        Ok(BlobStream::of(blob, (own, permit)))
    }
}

/// The worker that speaks: its id is its own.
fn proven((worker, secret): (WorkerId, WorkerSecret)) -> Result<WorkerId, Status> {
    if secret.id() != worker {
        return Err(Status::permission_denied(
            "worker_secret: is not that of worker_id\nmake a secret of your own, and the id from it",
        ));
    }
    Ok(worker)
}

/// Notes over which connection a worker speaks, so that denying one ends the other.
fn note(caller: Option<&Arc<Connection>>, worker: WorkerId) -> Result<(), Status> {
    caller.map_or(Ok(()), |connection| connection.note(worker))
}

/// What a principal is known by.
fn kind(principal: &Principal) -> &'static str {
    match principal {
        Principal::Coordinator => "process",
        Principal::Certificate(_) => "certificate",
        Principal::Token(_) => "token from this address",
        Principal::Anonymous(_) => "address",
    }
}
