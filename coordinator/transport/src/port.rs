//! The port of a command: bound by its first session, and kept for those that follow.

use std::io;
use std::net::{SocketAddr, TcpListener as StdListener};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use clap::Args;
use tokio::net::TcpListener;

use crate::listen_error::ListenError;

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

/// How workers of other machines reach a command. Clones share the socket: between two sessions of a command, workers that
/// come wait for the second one, nobody else gets the port, and one that the system has chosen stays the same.
#[derive(Clone, Debug, Default)]
pub struct Port {
    /// How connections are protected.
    pub protection: Protection,
    /// A file to which the address is written.
    pub join_file: Option<PathBuf>,
    held: Arc<Mutex<Option<(SocketAddr, StdListener)>>>,
}

impl Port {
    /// A port that is not bound yet.
    pub fn new(protection: Protection, join_file: Option<PathBuf>) -> Self {
        Self { protection, join_file, held: Arc::default() }
    }

    /// Binds the address, unless an earlier session has.
    pub(crate) async fn bind(&self, address: SocketAddr) -> Result<TcpListener, ListenError> {
        let failed = |source: io::Error| match source.kind() {
            io::ErrorKind::AddrInUse => ListenError::PortInUse { address },
            _ => ListenError::Listen { address, source },
        };
        if let Some(held) = self.held(address).map_err(failed)? {
            return TcpListener::from_std(held).map_err(failed);
        }
        let bound = TcpListener::bind(address).await.and_then(TcpListener::into_std).map_err(failed)?;
        let session = bound.try_clone().and_then(TcpListener::from_std).map_err(failed)?;
        *self.held.lock().unwrap_or_else(PoisonError::into_inner) = Some((address, bound));
        Ok(session)
    }

    /// The socket that is bound to this address, if there is one.
    fn held(&self, address: SocketAddr) -> io::Result<Option<StdListener>> {
        let held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        held.as_ref()
            .filter(|(wanted, _)| *wanted == address)
            .map(|(_, socket)| socket.try_clone())
            .transpose()
    }
}
