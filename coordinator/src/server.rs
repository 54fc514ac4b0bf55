//! Where workers connect: a TCP listener for remote ones, memory for those in this process.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use hyper_util::rt::TokioIo;
use proto::v1;
use tokio::io::DuplexStream;
use tokio::net::TcpListener;
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio_stream::StreamExt as _;
use tokio_stream::wrappers::{ReceiverStream, TcpListenerStream};
use tonic::transport::{Channel, Endpoint, Server, server::Router};
use tower::service_fn;

use crate::cluster::Cluster;
use crate::prepared::PreparedClouds;
use crate::service::Service;

/// Bytes on their way between the two ends of an in-process connection.
const PIPE_BYTES: usize = 256 << 10;

/// Calls that one connection may have open: a worker's poll and its blobs are far fewer.
const MAX_STREAMS: u32 = 64;
/// How often a silent connection is asked whether it is still there.
const KEEPALIVE: Duration = Duration::from_secs(20);
/// Pause after a connection that could not be accepted.
const ACCEPT_PAUSE: Duration = Duration::from_millis(200);

/// Why nobody can connect.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// The port is taken.
    #[error("--listen {address}: the port is in use\nstop the program that uses it, or choose another port")]
    PortInUse {
        /// The wanted address.
        address: SocketAddr,
    },
    /// Any other reason.
    #[error("--listen {address}: cannot listen there, got {source}\nchoose an address of this machine")]
    Listen {
        /// The wanted address.
        address: SocketAddr,
        /// Why.
        source: io::Error,
    },
    /// Plain text must not leave the machine by accident.
    #[error(
        "--listen {address}: connections from other machines are not encrypted, got no --insecure\nadd --insecure inside a trusted network, or listen on 127.0.0.1 and use an SSH tunnel"
    )]
    NotLoopback {
        /// The wanted address.
        address: SocketAddr,
    },
}

/// Binds the address for remote workers.
pub async fn bind(address: SocketAddr, insecure: bool) -> Result<TcpListener, ServerError> {
    if !address.ip().is_loopback() && !insecure {
        return Err(ServerError::NotLoopback { address });
    }
    TcpListener::bind(address).await.map_err(|source| match source.kind() {
        io::ErrorKind::AddrInUse => ServerError::PortInUse { address },
        _ => ServerError::Listen { address, source },
    })
}

/// The running servers of one run; they end when this is dropped.
pub struct Servers {
    cluster: Arc<Cluster>,
    preparation: v1::Preparation,
    prepared: Arc<PreparedClouds>,
    tasks: JoinSet<()>,
}

impl Servers {
    /// No server yet.
    pub fn new(cluster: Arc<Cluster>, preparation: v1::Preparation, prepared: PreparedClouds) -> Self {
        Self { cluster, preparation, prepared: Arc::new(prepared), tasks: JoinSet::new() }
    }

    /// Serves remote workers, health probes and reflection.
    pub async fn serve_tcp(&mut self, listener: TcpListener) {
        let (health, health_service) = tonic_health::server::health_reporter();
        health.set_serving::<proto::v1::coordinator_server::CoordinatorServer<Service>>().await;
        let reflection = tonic_reflection::server::Builder::configure()
            .register_encoded_file_descriptor_set(proto::FILE_DESCRIPTOR_SET)
            .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
            .build_v1();
        let mut router = self.router().add_service(health_service);
        match reflection {
            Ok(service) => router = router.add_service(service),
            Err(error) => tracing::warn!("gRPC reflection is off, got {error}"),
        }
        let incoming = TcpListenerStream::new(listener).then(|connection| async {
            match &connection {
                Ok(stream) => {
                    let _ = stream.set_nodelay(true); // only latency is at stake
                }
                Err(error) => {
                    // Out of file descriptors, most likely: trying again at once would only burn a core.
                    tracing::warn!("cannot accept a connection, got {error}");
                    tokio::time::sleep(ACCEPT_PAUSE).await;
                }
            }
            connection
        });
        self.spawn(router.serve_with_incoming(incoming));
    }

    /// A channel to this coordinator that stays inside the process.
    pub fn connect_in_process(&mut self) -> Channel {
        let (sender, receiver) = mpsc::channel::<io::Result<DuplexStream>>(4);
        let router = self.router();
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

    fn router(&self) -> Router {
        let service =
            Service::server(Arc::clone(&self.cluster), self.preparation.clone(), Arc::clone(&self.prepared));
        Server::builder()
            .tcp_nodelay(true)
            .max_concurrent_streams(MAX_STREAMS)
            // A worker whose machine was switched off says nothing: ask, or its connection stays for ever.
            .http2_keepalive_interval(Some(KEEPALIVE))
            .http2_keepalive_timeout(Some(KEEPALIVE))
            .add_service(service)
    }

    fn spawn(&mut self, server: impl Future<Output = Result<(), tonic::transport::Error>> + Send + 'static) {
        self.tasks.spawn(async move {
            if let Err(error) = server.await {
                tracing::error!("server: stopped, got {error}");
            }
        });
    }
}
