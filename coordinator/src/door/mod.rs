//! The door: where workers on other machines come in, and strangers do not.
//!
//! `mod` listens, `tls` shakes hands, `gate` knows who may come in, `guest` is one connection, `guard` stands before every
//! call, `limits` and `deny` decide without IO of their own.

mod deny;
mod gate;
mod guard;
mod guest;
mod limits;
mod tls;

use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use clap::Args;
use proto::JoinAddress;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpListener;
use tokio::sync::mpsc;
use tokio_rustls::TlsAcceptor;
use worker::tls::TlsFilesError;

use crate::certs::{self, CertsError};
use crate::cluster::Cluster;
use crate::run::host;
use deny::DenyList;
use gate::{Gate, Key};
pub use guard::Guard;
pub use guest::Guest;
use guest::GuestStream;
use limits::CrowdLimits;
use tls::{Tls, shake_hands};

/// Pause after a connection that could not be accepted.
const ACCEPT_PAUSE: Duration = Duration::from_millis(200);
/// How often the deny list is looked at.
const DENY_INTERVAL: Duration = Duration::from_secs(1);

/// How connections from other machines are protected.
#[derive(Clone, Debug, Default, Args)]
pub struct Protection {
    /// Folder of certificates and token, as `coordinator certs` makes it, for example tls: only workers with one of them
    /// are let in, and connections are encrypted
    #[arg(long, value_name = "DIR")]
    pub tls: Option<PathBuf>,
    /// Accept unencrypted connections from other machines, for example inside a trusted network
    #[arg(long, conflicts_with = "tls")]
    pub insecure: bool,
}

/// Why nobody can connect.
#[derive(Debug, thiserror::Error)]
pub enum DoorError {
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
        "--listen {address}: connections from other machines must be encrypted, got neither --tls nor --insecure\nmake certificates with `coordinator certs DIR` and add --tls DIR, or add --insecure inside a trusted network"
    )]
    NotLoopback {
        /// The wanted address.
        address: SocketAddr,
    },
    /// The folder of certificates.
    #[error(transparent)]
    Certs(#[from] CertsError),
    /// A file in it.
    #[error(transparent)]
    Files(#[from] TlsFilesError),
    /// Files that do not fit together.
    #[error("--tls {folder}: cannot be used, got {reason}\nmake another folder with `coordinator certs`")]
    Unfit {
        /// The folder.
        folder: PathBuf,
        /// Why.
        reason: String,
    },
}

/// An open port that nobody has been let in by yet.
pub struct Door {
    listener: TcpListener,
    address: SocketAddr,
    tls: Option<Tls>,
}

impl Door {
    /// Listens.
    pub async fn open(address: SocketAddr, protection: &Protection) -> Result<Self, DoorError> {
        if !address.ip().is_loopback() && protection.tls.is_none() && !protection.insecure {
            return Err(DoorError::NotLoopback { address });
        }
        let tls = protection.tls.as_deref().map(Tls::read).transpose()?;
        if let Some(tls) = &tls {
            DenyList::check(&tls.folder).map_err(|error| DoorError::Unfit {
                folder: tls.folder.clone(),
                reason: format!("{} that cannot be read: {error}", deny::DENY_FILE),
            })?;
        }
        let listener = TcpListener::bind(address).await.map_err(|source| match source.kind() {
            io::ErrorKind::AddrInUse => DoorError::PortInUse { address },
            _ => DoorError::Listen { address, source },
        })?;
        let address = listener.local_addr().map_err(|source| DoorError::Listen { address, source })?;
        Ok(Self { listener, address, tls })
    }

    /// What there is to say to people: how workers join, and what may have been overlooked. Without secrets.
    pub fn notices(&self) -> Vec<String> {
        let (ip, port) = (self.address.ip(), self.address.port());
        let mut notices = Vec::new();
        if let Some(Tls { folder, join, key, .. }) = &self.tls {
            let file = folder.join(certs::JOIN_FILE);
            notices.push(if matches!(key, Key::Credentials(None)) {
                let workers = folder.join(certs::WORKERS_FOLDER);
                format!(
                    "workers may join with a certificate: worker --tls {}",
                    workers.join("NAME").display()
                )
            } else {
                format!("workers may join with: worker --coordinator-file {}", file.display())
            });
            if join.port != port {
                let file = file.display();
                notices.push(format!(
                    "warning: {file}: names port {}, and this port is {port}: workers need an address with this one",
                    join.port
                ));
            }
            return notices;
        }
        if !ip.is_loopback() {
            notices.push(
                "warning: --insecure: whoever reaches this port can read the clouds and send results"
                    .to_owned(),
            );
        }
        // An unspecified address means every address of this machine, which others know by its name.
        let host = if ip.is_unspecified() { host() } else { ip.to_string() };
        let join = JoinAddress { host, port, trust: None };
        notices.push(format!("workers may join with: worker --coordinator {join}"));
        notices
    }

    /// Lets workers in: the connections that have shaken hands.
    pub fn admit(self, cluster: Arc<Cluster>) -> Admission {
        let key = self.tls.as_ref().map_or(Key::None, |tls| tls.key.clone());
        let gate = Gate::new(cluster, key, CrowdLimits::within(open_files().unwrap_or(1024)));
        let mut deny = self.tls.as_ref().map(|tls| DenyList::new(&tls.folder));
        look(&mut deny, &gate); // before anybody comes
        let acceptor = self.tls.map(|tls| tls.acceptor);
        let (sender, connections) = mpsc::channel(64);
        let watched = Arc::clone(&gate);
        let tend = async move {
            tokio::join!(accept(self.listener, acceptor, gate, sender), watch(deny, watched));
        };
        Admission { connections, tend: Box::pin(tend) }
    }
}

/// A connection of any kind.
pub trait Stream: AsyncRead + AsyncWrite + Send + Unpin {}
impl<T: AsyncRead + AsyncWrite + Send + Unpin> Stream for T {}

/// A guest's connection, ready for HTTP/2.
pub type Connection = GuestStream<Box<dyn Stream>>;

/// An open door.
pub struct Admission {
    /// Those who have come in.
    pub connections: mpsc::Receiver<io::Result<Connection>>,
    /// Has to run for anybody to come in; has no end.
    pub tend: std::pin::Pin<Box<dyn Future<Output = ()> + Send>>,
}

async fn accept(
    listener: TcpListener,
    acceptor: Option<TlsAcceptor>,
    gate: Arc<Gate>,
    sender: mpsc::Sender<io::Result<Connection>>,
) {
    loop {
        let (stream, peer) = match listener.accept().await {
            Ok(accepted) => accepted,
            Err(error) => {
                // Out of file descriptors, most likely: trying again at once would only burn a core.
                tracing::warn!("cannot accept a connection, got {error}");
                tokio::time::sleep(ACCEPT_PAUSE).await;
                continue;
            }
        };
        let _ = stream.set_nodelay(true); // only latency is at stake
        let Some(presence) = gate.admit(peer.ip()) else { continue };
        let (acceptor, sender) = (acceptor.clone(), sender.clone());
        // Beside the others: whoever is slow to shake hands keeps nobody waiting. It ends in bounded time.
        tokio::spawn(async move {
            let connection = match acceptor {
                None => {
                    Some(GuestStream::new(Box::new(stream) as Box<dyn Stream>, Guest::new(presence, None)))
                }
                Some(acceptor) => shake_hands(&acceptor, stream, presence).await,
            };
            if let Some(connection) = connection {
                let _ = sender.send(Ok(connection)).await; // the server has ended
            }
        });
    }
}

/// Keeps the deny list in force.
async fn watch(mut deny: Option<DenyList>, gate: Arc<Gate>) {
    while deny.is_some() {
        tokio::time::sleep(DENY_INTERVAL).await;
        look(&mut deny, &gate); // a small file, once a second: not worth a thread of its own
    }
}

fn look(deny: &mut Option<DenyList>, gate: &Gate) {
    if let Some(denied) = deny.as_mut().and_then(DenyList::look) {
        gate.deny(denied);
    }
}

/// How many files this process may have open.
fn open_files() -> Option<usize> {
    let soft = rlimit::Resource::NOFILE.get_soft().ok()?;
    Some(usize::try_from(soft).unwrap_or(usize::MAX)) // no limit is the largest number
}
