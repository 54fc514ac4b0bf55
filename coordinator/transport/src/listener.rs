//! The port on which workers of other machines connect.

use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use proto::JoinAddress;
use tokio::net::TcpListener;
use tokio::sync::mpsc;
use tokio_rustls::TlsAcceptor;

use crate::access::{AccessControl, Requirement};
use crate::certs;
use crate::connection::{ConnectionStream, Stream};
use crate::deny_list::DenyList;
use crate::host_name;
use crate::limiter::ConnectionLimits;
use crate::listen_error::ListenError;
use crate::port::Port;
use crate::refusals::RefusalLog;
use crate::tls::{Tls, shake_hands};
use cluster::Cluster;

/// Pause after a connection that could not be accepted.
const ACCEPT_PAUSE: Duration = Duration::from_millis(200);
/// How often the deny list is looked at.
const DENY_INTERVAL: Duration = Duration::from_secs(1);

/// A bound port that accepts no connection yet.
pub struct Listener {
    listener: TcpListener,
    address: SocketAddr,
    tls: Option<Tls>,
    deny: Option<DenyList>,
    join_file: Option<PathBuf>,
    refusals: Arc<RefusalLog>,
}

impl Listener {
    /// Binds the port, and writes its address to the port's join file, in place of what that held.
    ///
    /// # Errors
    /// If others have the port, if nothing protects it, or if a file cannot be read or written.
    pub async fn bind(address: SocketAddr, port: &Port) -> Result<Self, ListenError> {
        let protection = &port.protection;
        if !address.ip().is_loopback() && protection.tls.is_none() && !protection.insecure {
            return Err(ListenError::NotLoopback { address });
        }
        let tls = protection.tls.as_deref().map(Tls::read).transpose()?;
        let opened = tls.as_ref().map(|Tls { folder, .. }| {
            let path = folder.join(certs::DENY_FILE);
            DenyList::open(folder).map_err(|reason| ListenError::DenyList { path, reason })
        });
        let deny = opened.transpose()?;
        let listener = port.bind(address).await?;
        let address = listener.local_addr().map_err(|source| ListenError::Listen { address, source })?;
        let join_file = port.join_file.clone();
        let bound = Self { listener, address, tls, deny, join_file, refusals: Arc::default() };
        bound.write_join_file()?;
        Ok(bound)
    }

    /// Only its owner can read the file.
    fn write_join_file(&self) -> Result<(), ListenError> {
        let Some(path) = &self.join_file else { return Ok(()) };
        let text = format!("{}\n", self.join_address().reveal());
        let failed = |source| ListenError::JoinFile { path: path.clone(), source };
        atomic::write_secret(path, text.as_bytes()).map_err(failed)
    }

    /// By which address other machines reach this port: under this machine's name, unless its certificate is for other
    /// names alone or it listens at a single address.
    fn join_address(&self) -> JoinAddress {
        let port = self.address.port();
        let Some(Tls { join, requirement, .. }) = &self.tls else {
            let ip = self.address.ip();
            // An unspecified address means every address of this machine, which others know by its name.
            let host = if ip.is_unspecified() { host_name() } else { ip.to_string() };
            return JoinAddress { host, port, trust: None };
        };
        let host = if self.is_certified() { host_name() } else { join.host.clone() };
        let mut address = JoinAddress { host, port, trust: join.trust.clone() };
        if let (Requirement::Credential(None), Some(trust)) = (requirement, &mut address.trust) {
            trust.token = None;
        }
        address
    }

    /// Whether workers accept the certificate from a coordinator of this machine's name.
    fn is_certified(&self) -> bool {
        self.tls.as_ref().is_some_and(|tls| tls.is_for(&host_name()))
    }

    /// What there is to say to people: how workers join, and what may have been overlooked. Without secrets.
    pub fn notices(&self) -> Vec<String> {
        let (ip, port) = (self.address.ip(), self.address.port());
        let mut notices = Vec::new();
        if let (Some(file), Some(Tls { join, .. })) = (&self.join_file, &self.tls)
            && !self.is_certified()
        {
            notices.push(format!(
                "warning: {}: names {}, because the certificate is not for {}, the name of this machine",
                file.display(),
                join.host,
                host_name()
            ));
        }
        if let Some(Tls { folder, join, requirement, .. }) = &self.tls {
            let file = self.join_file.clone().unwrap_or_else(|| folder.join(certs::JOIN_FILE));
            notices.push(if matches!(requirement, Requirement::Credential(None)) {
                let workers = folder.join(certs::WORKERS_FOLDER);
                format!(
                    "workers may join with a certificate: worker --tls {}",
                    workers.join("NAME").display()
                )
            } else {
                format!("workers may join with: worker --coordinator-file {}", file.display())
            });
            if self.join_file.is_none() && join.port != port {
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
        notices.push(format!("workers may join with: worker --coordinator {}", self.join_address()));
        notices
    }

    /// What peers will be refused.
    pub fn refusals(&self) -> Arc<RefusalLog> {
        Arc::clone(&self.refusals)
    }

    /// Accepts connections, and shakes hands.
    pub fn accept(self, cluster: Arc<Cluster>) -> Accepting {
        let requirement = self.tls.as_ref().map_or(Requirement::Nothing, |tls| tls.requirement.clone());
        let limits = ConnectionLimits::within(open_files().unwrap_or(1024));
        let access = AccessControl::new(cluster, requirement, limits, self.refusals);
        if let Some(deny) = &self.deny {
            access.deny(deny.in_force()); // before the first connection
        }
        let acceptor = self.tls.map(|tls| tls.acceptor);
        let (sender, connections) = mpsc::channel(64);
        let (accepting, watching) = (Arc::clone(&access), Arc::clone(&access));
        let run = async move {
            tokio::join!(accept(self.listener, acceptor, accepting, sender), watch(self.deny, watching));
        };
        Accepting { connections, access, run: Box::pin(run) }
    }
}

/// The bytes of a connection, ready for HTTP/2.
pub type Incoming = ConnectionStream<Box<dyn Stream>>;

/// A port that accepts connections.
pub struct Accepting {
    /// Those that have shaken hands.
    pub connections: mpsc::Receiver<io::Result<Incoming>>,
    /// Which calls are let in.
    pub access: Arc<AccessControl>,
    /// Accepts connections as long as it is polled; never ends.
    pub run: std::pin::Pin<Box<dyn Future<Output = ()> + Send>>,
}

async fn accept(
    listener: TcpListener,
    acceptor: Option<TlsAcceptor>,
    access: Arc<AccessControl>,
    sender: mpsc::Sender<io::Result<Incoming>>,
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
        let Some(permit) = access.admit(peer.ip()) else { continue };
        let (acceptor, access, sender) = (acceptor.clone(), Arc::clone(&access), sender.clone());
        // A task each: a peer that is slow to shake hands delays no other. It ends in bounded time.
        tokio::spawn(async move {
            let stream = match acceptor {
                None => Some((Box::new(stream) as Box<dyn Stream>, access.connect(permit, None))),
                Some(acceptor) => shake_hands(&acceptor, stream, permit, &access).await,
            };
            if let Some((stream, connection)) = stream {
                let _ = sender.send(Ok(ConnectionStream::new(stream, connection))).await; // the server has ended
            }
        });
    }
}

/// Keeps the deny list in force.
async fn watch(deny: Option<DenyList>, access: Arc<AccessControl>) {
    let Some(mut deny) = deny else { return };
    loop {
        tokio::time::sleep(DENY_INTERVAL).await;
        // On a thread of its own: a network file system may hang.
        let looked = tokio::task::spawn_blocking(move || {
            let denied = deny.look();
            (deny, denied)
        });
        let (list, denied) = match looked.await {
            Ok(looked) => looked,
            // Nobody would be denied any more, and nobody would know.
            Err(error) if error.is_panic() => std::panic::resume_unwind(error.into_panic()),
            Err(_) => return, // the runtime ends
        };
        deny = list;
        if let Some(denied) = denied {
            access.deny(denied);
        }
    }
}

/// How many files this process may have open.
fn open_files() -> Option<usize> {
    let soft = rlimit::Resource::NOFILE.get_soft().ok()?;
    Some(usize::try_from(soft).unwrap_or(usize::MAX)) // no limit is the largest number
}
