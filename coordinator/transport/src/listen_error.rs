//! Why workers cannot connect.

use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;

use proto::tls::TlsFilesError;

use crate::certs::CertsError;

/// Why workers cannot connect.
#[derive(Debug, thiserror::Error)]
pub enum ListenError {
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
    /// Where the address is to be written.
    #[error("--join-file {path}: cannot be written, got {source}\nchoose a file in a folder that is there")]
    JoinFile {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
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
    /// Nobody knows who is denied.
    #[error(
        "{path}: must say who is denied, {reason}\ncorrect it or restore it from a copy; if nobody is to be denied, write the line # nobody"
    )]
    DenyList {
        /// The list.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
}
