//! The port on which browsers and monitoring connect: TLS without client certificates, and tokens that say who may look and who may act.

use std::fs::OpenOptions;
use std::io::{self, Read as _, Write as _};
use std::net::{IpAddr, SocketAddr};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use proto::Token;
use proto::tls::{TlsFilesError, read_identity};
use rustls::ServerConfig;
use tokio::net::TcpListener;
use tokio::sync::mpsc;
use tokio_rustls::TlsAcceptor;

use crate::connection::{FIRST_CALL, Stream};
use crate::host_name;
use crate::limiter::{ConnectionLimiter, ConnectionLimits, ConnectionPermit};
use crate::port::Protection;
use crate::refusals::RefusalLog;

/// Connections at a time: each viewer has one that stays and some that come and go. Whoever was not let in leaves room for
/// those who were, and one address for others.
const LIMITS: ConnectionLimits = ConnectionLimits { all: 512, origin: 256, pending: 256, origin_pending: 64 };
/// Pause after a connection that could not be accepted.
const ACCEPT_PAUSE: Duration = Duration::from_millis(200);
/// Who shows it may look.
const VIEW_TOKEN_FILE: &str = "dashboard-view";
/// Who shows it may act, too.
const CONTROL_TOKEN_FILE: &str = "dashboard-control";

/// Why nobody can connect.
#[derive(Debug, thiserror::Error)]
pub enum WebError {
    /// The port is taken.
    #[error("{what} {address}: the port is in use\nstop the program that uses it, or choose another port")]
    PortInUse {
        /// What was to be served.
        what: &'static str,
        /// The wanted address.
        address: SocketAddr,
    },
    /// Any other reason.
    #[error("{what} {address}: cannot listen there, got {source}\nchoose an address of this machine")]
    Listen {
        /// What was to be served.
        what: &'static str,
        /// The wanted address.
        address: SocketAddr,
        /// Why.
        source: io::Error,
    },
    /// Plain text must not leave the machine by accident.
    #[error(
        "{what} {address}: connections from other machines must be encrypted, got neither --tls nor --insecure\nmake certificates with `coordinator certs DIR` and add --tls DIR, or add --insecure inside a trusted network"
    )]
    NotLoopback {
        /// What was to be served.
        what: &'static str,
        /// The wanted address.
        address: SocketAddr,
    },
    /// A file in the folder of certificates.
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
    /// A token.
    #[error("{path}: cannot be used as a token, got {reason}\nremove it: the next start makes another")]
    Token {
        /// Its file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
}

/// What a viewer has to show, and who acts.
#[derive(Clone, Debug)]
pub struct WebTokens {
    /// Who shows it may look.
    pub view: Token,
    /// Who shows it may act, too.
    pub control: Token,
    /// Where both are.
    pub folder: PathBuf,
}

/// A bound port for browsers.
pub struct WebListener {
    what: &'static str,
    listener: TcpListener,
    acceptor: Option<TlsAcceptor>,
    /// Where it is.
    pub address: SocketAddr,
    /// `None`: nothing has to be shown.
    pub tokens: Option<WebTokens>,
}

/// A connection that has shaken hands.
pub struct WebConnection {
    /// Its bytes.
    pub stream: Box<dyn Stream>,
    /// To be kept as long as it lasts, and to be told when a request was let in.
    pub permit: ConnectionPermit,
}

impl WebListener {
    /// Binds the port of `what`, for messages. With TLS, tokens are read from the folder of certificates, and made if they
    /// are not there yet.
    ///
    /// # Errors
    /// [`WebError`].
    pub async fn bind(
        what: &'static str,
        address: SocketAddr,
        protection: &Protection,
    ) -> Result<Self, WebError> {
        if !address.ip().is_loopback() && protection.tls.is_none() && !protection.insecure {
            return Err(WebError::NotLoopback { what, address });
        }
        // On this machine it is as with workers: nothing has to be shown.
        let folder = protection.tls.as_deref().filter(|_| !address.ip().is_loopback());
        let acceptor = folder.map(acceptor).transpose()?;
        let tokens = folder.map(tokens).transpose()?;
        let listener = TcpListener::bind(address).await.map_err(|source| match source.kind() {
            io::ErrorKind::AddrInUse => WebError::PortInUse { what, address },
            _ => WebError::Listen { what, address, source },
        })?;
        let address = listener.local_addr().map_err(|source| WebError::Listen { what, address, source })?;
        Ok(Self { what, listener, acceptor, address, tokens })
    }

    /// Without an address at the default one, or, if another program has that, at any free port.
    ///
    /// # Errors
    /// [`WebError`].
    pub async fn bind_near(
        what: &'static str,
        (address, default): (Option<SocketAddr>, SocketAddr),
        protection: &Protection,
    ) -> Result<Self, WebError> {
        match Self::bind(what, address.unwrap_or(default), protection).await {
            Err(WebError::PortInUse { .. }) if address.is_none() => {
                Self::bind(what, SocketAddr::new(default.ip(), 0), protection).await
            }
            bound => bound,
        }
    }

    /// Its address for people, with the scheme.
    pub fn url(&self) -> String {
        let host = match self.address.ip() {
            ip if ip.is_unspecified() => host_name(),
            IpAddr::V6(ip) => format!("[{ip}]"),
            ip => ip.to_string(),
        };
        let scheme = if self.tokens.is_some() { "https" } else { "http" };
        format!("{scheme}://{host}:{}/", self.address.port())
    }

    /// Accepts connections as long as they are taken.
    pub fn accept(self) -> mpsc::Receiver<WebConnection> {
        let (sender, connections) = mpsc::channel(16);
        tokio::spawn(accept(self.what, self.listener, self.acceptor, sender));
        connections
    }
}

async fn accept(
    what: &'static str,
    listener: TcpListener,
    acceptor: Option<TlsAcceptor>,
    sender: mpsc::Sender<WebConnection>,
) {
    let limiter = ConnectionLimiter::new(LIMITS);
    let refusals = RefusalLog::default();
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            () = sender.closed() => return,
        };
        let (stream, peer) = match accepted {
            Ok(accepted) => accepted,
            Err(error) => {
                tracing::warn!("{what}: cannot accept a connection, got {error}");
                tokio::time::sleep(ACCEPT_PAUSE).await;
                continue;
            }
        };
        let Some(permit) = limiter.acquire(peer.ip()) else {
            refusals.note("too many connections of viewers", peer.ip());
            continue;
        };
        let _ = stream.set_nodelay(true); // only latency is at stake
        let (acceptor, sender) = (acceptor.clone(), sender.clone());
        // A task each: a peer that is slow to shake hands delays no other.
        tokio::spawn(async move {
            let stream: Box<dyn Stream> = match acceptor {
                None => Box::new(stream),
                Some(acceptor) => match tokio::time::timeout(FIRST_CALL, acceptor.accept(stream)).await {
                    Ok(Ok(stream)) => Box::new(stream),
                    _ => return, // no browser, or one that does not trust the certificate
                },
            };
            let _ = sender.send(WebConnection { stream, permit }).await; // the server has ended
        });
    }
}

fn acceptor(folder: &Path) -> Result<TlsAcceptor, WebError> {
    let (certificates, key) = read_identity(folder)?;
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let mut config = ServerConfig::builder_with_provider(provider)
        .with_protocol_versions(&[&rustls::version::TLS13])
        .and_then(|builder| builder.with_no_client_auth().with_single_cert(certificates, key))
        .map_err(|error| WebError::Unfit { folder: folder.to_owned(), reason: error.to_string() })?;
    config.alpn_protocols = vec![b"h2".to_vec(), b"http/1.1".to_vec()];
    Ok(TlsAcceptor::from(Arc::new(config)))
}

fn tokens(folder: &Path) -> Result<WebTokens, WebError> {
    let token = |name: &str| {
        let path = folder.join(name);
        read_or_make(&path).map_err(|error| WebError::Token { path, reason: error.to_string() })
    };
    Ok(WebTokens {
        view: token(VIEW_TOKEN_FILE)?,
        control: token(CONTROL_TOKEN_FILE)?,
        folder: folder.to_owned(),
    })
}

/// The token in a file; a new one if there is none, which only the owner can read.
fn read_or_make(path: &Path) -> io::Result<Token> {
    match OpenOptions::new().write(true).create_new(true).mode(0o600).open(path) {
        Ok(mut file) => {
            let token = Token::new(rand::random());
            file.write_all(format!("{}\n", token.reveal()).as_bytes())?;
            file.sync_all()?;
            Ok(token)
        }
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
            if !std::fs::metadata(path)?.is_file() {
                return Err(io::Error::other("something that is no file"));
            }
            let mut text = String::new();
            std::fs::File::open(path)?.take(1024).read_to_string(&mut text)?;
            text.trim().parse().map_err(io::Error::other)
        }
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use tokio::io::AsyncReadExt as _;
    use tokio::net::TcpStream;

    use super::*;
    use crate::certs::{Site, make_folder, validity};

    #[tokio::test]
    async fn other_machines_need_tls_and_its_tokens_stay() {
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path().join("tls");
        make_folder(&folder, &Site { hosts: vec![], port: 7700 }, &validity(1)).unwrap();
        let bind = |address: &str, protection: Protection| {
            let address = address.parse().unwrap();
            async move { WebListener::bind("dashboard", address, &protection).await }
        };
        let refused = bind("0.0.0.0:0", Protection::default()).await.err().unwrap().to_string();
        assert!(refused.contains("must be encrypted, got neither --tls nor --insecure"), "{refused}");
        assert!(bind("127.0.0.1:0", Protection::default()).await.unwrap().tokens.is_none());
        let tls = || Protection { tls: Some(folder.clone()), insecure: false };
        let first = bind("0.0.0.0:0", tls()).await.unwrap().tokens.unwrap();
        let second = bind("0.0.0.0:0", tls()).await.unwrap().tokens.unwrap();
        assert_eq!((&first.view, &first.control), (&second.view, &second.control));
        assert_ne!(first.view, first.control);
        let mode = folder.join(CONTROL_TOKEN_FILE).metadata().unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
        std::fs::write(folder.join(VIEW_TOKEN_FILE), "short").unwrap();
        let refused = bind("0.0.0.0:0", tls()).await.err().unwrap().to_string();
        assert!(refused.contains("dashboard-view: cannot be used as a token"), "{refused}");
    }

    #[tokio::test]
    async fn whoever_is_not_let_in_leaves_room_for_others() {
        let address = "127.0.0.1:0".parse().unwrap();
        let listener = WebListener::bind("dashboard", address, &Protection::default()).await.unwrap();
        let address = listener.address;
        let mut connections = listener.accept();
        let mut held = Vec::new();
        for _ in 0..LIMITS.origin_pending {
            let peer = TcpStream::connect(address).await.unwrap();
            held.push((peer, connections.recv().await.unwrap()));
        }
        let mut refused = TcpStream::connect(address).await.unwrap();
        assert!(matches!(refused.read(&mut [0]).await, Ok(0) | Err(_)), "closed");
        held[0].1.permit.establish();
        let _viewer = TcpStream::connect(address).await.unwrap();
        assert!(connections.recv().await.is_some());
    }

    #[tokio::test]
    async fn a_port_in_use_is_named() {
        let first = WebListener::bind("dashboard", "127.0.0.1:0".parse().unwrap(), &Protection::default())
            .await
            .unwrap();
        let second = WebListener::bind("dashboard", first.address, &Protection::default())
            .await
            .err()
            .unwrap()
            .to_string();
        assert!(second.contains("the port is in use"), "{second}");
    }
}
