//! What both sides of TLS share: the files of `coordinator certs`, fingerprints of certificates, the protocol inside.

use std::path::{Path, PathBuf};
use std::{fs, io};

use rustls::crypto::ring;
use rustls::pki_types::pem::{self, PemObject};
use rustls::pki_types::{CertificateDer, PrivateKeyDer};

use crate::Fingerprint;

/// The protocol inside, as the handshake names it: a server of anything else is noticed in the handshake.
pub const ALPN: &[u8] = b"h2";
/// The certificate in a folder of `coordinator certs`.
pub const CERTIFICATE_FILE: &str = "cert.pem";
/// The private key of that certificate.
pub const KEY_FILE: &str = "key.pem";

/// Why there is no TLS with what the operator gave.
#[derive(Debug, thiserror::Error)]
pub enum TlsFilesError {
    /// A file that is missing or no PEM.
    #[error("{path}: cannot be used, got {source}\nmake it with `coordinator certs`, and copy it whole")]
    Pem {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: pem::Error,
    },
    /// The files do not fit together.
    #[error(
        "{folder}: {CERTIFICATE_FILE} and {KEY_FILE} cannot be used, got {source}\ncopy both from the same folder of `coordinator certs`"
    )]
    Unfit {
        /// Their folder.
        folder: PathBuf,
        /// Why.
        source: rustls::Error,
    },
}

/// SHA-256 of a certificate's DER.
pub fn fingerprint(certificate: &CertificateDer<'_>) -> Fingerprint {
    let suite = ring::cipher_suite::TLS13_AES_128_GCM_SHA256;
    let sha256 = suite.tls13().expect("is a suite of TLS 1.3").common.hash_provider;
    let mut fingerprint = Fingerprint([0; 32]);
    fingerprint.0.copy_from_slice(sha256.hash(certificate).as_ref());
    fingerprint
}

/// The longest file that is read as PEM, bytes.
const MAX_PEM_BYTES: u64 = 1 << 20;

/// Refuses what is no file, such as a pipe that would be waited for, and what is far longer than any chain.
fn check_pem(path: &Path) -> Result<(), TlsFilesError> {
    let wrong = |source| TlsFilesError::Pem { path: path.to_owned(), source: pem::Error::Io(source) };
    let metadata = fs::metadata(path).map_err(wrong)?;
    if !metadata.is_file() {
        return Err(wrong(io::Error::new(io::ErrorKind::InvalidInput, "something that is no file")));
    }
    if metadata.len() > MAX_PEM_BYTES {
        return Err(wrong(io::Error::new(io::ErrorKind::FileTooLarge, "more than 1 MiB")));
    }
    Ok(())
}

/// Certificates and private key in a folder of `coordinator certs`.
pub fn read_identity(
    folder: &Path,
) -> Result<(Vec<CertificateDer<'static>>, PrivateKeyDer<'static>), TlsFilesError> {
    let key = folder.join(KEY_FILE);
    let certificates = read_certificates(&folder.join(CERTIFICATE_FILE))?;
    check_pem(&key)?;
    Ok((
        certificates,
        PrivateKeyDer::from_pem_file(&key).map_err(|source| TlsFilesError::Pem { path: key, source })?,
    ))
}

/// The certificates of a PEM file, at least one.
pub fn read_certificates(path: &Path) -> Result<Vec<CertificateDer<'static>>, TlsFilesError> {
    check_pem(path)?;
    let wrong = |source| TlsFilesError::Pem { path: path.to_owned(), source };
    let certificates = CertificateDer::pem_file_iter(path).map_err(wrong)?;
    let certificates: Vec<_> = certificates.collect::<Result<_, _>>().map_err(wrong)?;
    if certificates.is_empty() { Err(wrong(pem::Error::NoItemsFound)) } else { Ok(certificates) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fingerprints_are_sha_256() {
        let fingerprint = fingerprint(&CertificateDer::from(b"abc".to_vec()));
        // FIPS 180-2, B.1.
        let expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(fingerprint.to_string(), expected);
    }
}
