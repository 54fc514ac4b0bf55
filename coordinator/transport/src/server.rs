//! The servers of a run: on the port for remote workers, in memory for those of this process.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use hyper_util::rt::TokioIo;
use tokio::io::DuplexStream;
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::{Channel, Endpoint, Server};
use tower::service_fn;

use crate::access::AccessControl;
use crate::auth_layer::AuthLayer;
use crate::listener::{Accepting, Listener};
use crate::service::{Release, Service, SharedEntries};
use crate::wire::{self, Rpc};
use cluster::Cluster;

/// Bytes on their way between the two ends of an in-process connection.
const PIPE_BYTES: usize = 256 << 10;

/// Calls that one connection may have open: a worker's poll and its blobs are far fewer.
const MAX_STREAMS: u32 = 64;
/// How often a silent connection is asked whether it is still there.
const KEEPALIVE: Duration = Duration::from_secs(20);

/// The running servers of one run; they and their connections end when this is dropped.
pub struct Servers {
    cluster: Arc<Cluster>,
    release: Release,
    shared: SharedEntries,
    tasks: JoinSet<()>,
    /// Of remote workers.
    access: Option<Arc<AccessControl>>,
}

/// The server of a connection is not ended by the end of that of the port.
impl Drop for Servers {
    fn drop(&mut self) {
        if let Some(access) = &self.access {
            access.close();
        }
    }
}

impl Servers {
    /// No server yet.
    pub fn new(cluster: Arc<Cluster>, release: Release, shared: SharedEntries) -> Self {
        Self { cluster, release, shared, tasks: JoinSet::new(), access: None }
    }

    /// Serves remote workers, health probes and reflection.
    pub async fn serve(&mut self, listener: Listener) {
        let (health, health_service) = tonic_health::server::health_reporter();
        health.set_serving::<Rpc>().await;
        let reflection = tonic_reflection::server::Builder::configure()
            .register_encoded_file_descriptor_set(proto::FILE_DESCRIPTOR_SET)
            .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
            .build_v1();
        let Accepting { connections, access, run } = listener.accept(Arc::clone(&self.cluster));
        self.access = Some(Arc::clone(&access));
        let mut router = server()
            .layer(AuthLayer(access))
            .add_service(self.service(false))
            .add_service(wire::refusal_of_v1(self.release))
            .add_service(health_service);
        match reflection {
            Ok(service) => router = router.add_service(service),
            Err(error) => tracing::warn!("gRPC reflection is off, got {error}"),
        }
        self.tasks.spawn(run);
        self.spawn(router.serve_with_incoming(ReceiverStream::new(connections)));
    }

    /// A channel to this coordinator that stays inside the process.
    pub fn connect_in_process(&mut self) -> Channel {
        let (sender, receiver) = mpsc::channel::<io::Result<DuplexStream>>(4);
        let router = server().add_service(self.service(true));
        let incoming = ReceiverStream::new(receiver);
        self.spawn(router.serve_with_incoming(incoming));
        Endpoint::from_static("http://in-process").connect_with_connector_lazy(service_fn(move |_| {
            let sender = sender.clone();
            async move {
                let (near, far) = tokio::io::duplex(PIPE_BYTES);
                let gone =
                    |_| io::Error::new(io::ErrorKind::ConnectionRefused, "the coordinator has stopped");
                sender.send(Ok(far)).await.map_err(gone)?;
                Ok::<_, io::Error>(TokioIo::new(near))
            }
        }))
    }

    fn service(&self, in_process: bool) -> Rpc {
        let shared = (self.release, self.shared.clone());
        wire::rpc(Service::new(Arc::clone(&self.cluster), shared, in_process))
    }

    fn spawn(&mut self, server: impl Future<Output = Result<(), tonic::transport::Error>> + Send + 'static) {
        self.tasks.spawn(async move {
            if let Err(error) = server.await {
                tracing::error!("server: stopped, got {error}");
            }
        });
    }
}

fn server() -> Server {
    Server::builder()
        .max_concurrent_streams(MAX_STREAMS)
        // A worker whose machine was switched off says nothing: ask, or its connection stays for ever.
        .http2_keepalive_interval(Some(KEEPALIVE))
        .http2_keepalive_timeout(Some(KEEPALIVE))
}
