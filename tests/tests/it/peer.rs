//! A worker by hand, from the protocol: it may say whatever it likes.

use std::path::Path;
use std::time::Duration;

use proto::v2::coordinator_client::CoordinatorClient;
use proto::v2::register_reply::Outcome;
use proto::{WorkerId, WorkerSecret, v2};
use tonic::Status;

/// One that is registered.
#[derive(Clone)]
pub struct Peer {
    pub client: CoordinatorClient<worker::Link>,
    pub secret: WorkerSecret,
    pub session: Vec<u8>,
    pub sequence: u64,
}

/// The introduction of a worker with the secret of these bytes.
pub fn introduction(secret: [u8; 32], name: &str) -> v2::RegisterRequest {
    let secret = WorkerSecret::new(secret);
    v2::RegisterRequest {
        protocol_major: proto::PROTOCOL_MAJOR,
        protocol_minor: proto::PROTOCOL_MINOR,
        evaluation_version: descriptor::EVALUATION_VERSION,
        worker_id: secret.id().to_vec(),
        worker_secret: secret.reveal(),
        name: name.to_owned(),
        threads: 1,
        build: name.to_owned(),
    }
}

/// A connection of its own to this join address, with the certificate in a folder, if there is one.
pub fn connect(address: &str, identity: Option<&Path>) -> CoordinatorClient<worker::Link> {
    let link = worker::link(&address.parse().unwrap(), identity).unwrap();
    CoordinatorClient::new(link).max_encoding_message_size(usize::MAX)
}

/// Registers, also where the connection is not there yet; gives up soon where there is nobody.
pub async fn register(
    client: &mut CoordinatorClient<worker::Link>,
    introduction: v2::RegisterRequest,
) -> Result<v2::RegisterReply, Status> {
    let mut tries = 0;
    loop {
        tries += 1;
        match client.register(introduction.clone()).await {
            Err(status) if status.code() == tonic::Code::Unavailable && tries < 200 => {
                tokio::time::sleep(Duration::from_millis(20)).await;
            }
            reply => return reply.map(tonic::Response::into_inner),
        }
    }
}

impl Peer {
    /// Registers over a connection of its own; the refusal, if there is one.
    pub async fn join(address: &str, identity: Option<&Path>, name: &str) -> Result<Self, String> {
        let secret: [u8; 32] = rand::random();
        let mut client = connect(address, identity);
        let reply = register(&mut client, introduction(secret, name)).await;
        let reply = reply.map_err(|status| status.to_string())?;
        match reply.outcome.unwrap() {
            Outcome::Accepted(accepted) => {
                let (secret, session) = (WorkerSecret::new(secret), accepted.session_id);
                Ok(Self { client, secret, session, sequence: 0 })
            }
            Outcome::Refused(refused) => Err(refused.message),
        }
    }

    pub fn id(&self) -> WorkerId {
        self.secret.id()
    }

    /// Its next poll, which says nothing.
    pub fn request(&mut self) -> v2::PollRequest {
        self.sequence += 1;
        v2::PollRequest {
            worker_id: self.id().to_vec(),
            worker_secret: self.secret.reveal(),
            session_id: self.session.clone(),
            sequence: self.sequence,
            ..Default::default()
        }
    }

    /// Polls with what `say` adds.
    pub async fn poll(&mut self, say: impl FnOnce(&mut v2::PollRequest)) -> Result<v2::PollReply, Status> {
        let mut request = self.request();
        say(&mut request);
        self.client.poll(request).await.map(tonic::Response::into_inner)
    }

    /// Polls until it is given a job.
    pub async fn take(&mut self) -> v2::Job {
        loop {
            let reply = self.poll(|poll| poll.wanted = 1).await.unwrap();
            if let Some(job) = reply.jobs.into_iter().next() {
                return job;
            }
        }
    }
}
