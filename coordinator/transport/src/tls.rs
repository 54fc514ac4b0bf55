//! TLS: the coordinator's side of the handshake.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use proto::JoinAddress;
use proto::tls::{ALPN, CERTIFICATE_FILE, fingerprint, read_certificates, read_identity};
use rustls::client::{verify_server_cert_signed_by_trust_anchor, verify_server_name};
use rustls::crypto::CryptoProvider;
use rustls::pki_types::{CertificateDer, ServerName, UnixTime};
use rustls::server::{ParsedCertificate, WebPkiClientVerifier};
use rustls::{RootCertStore, ServerConfig};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::TcpStream;
use tokio_rustls::TlsAcceptor;

use crate::access::{AccessControl, Requirement};
use crate::certs::{self, CA_FILE, JOIN_FILE};
use crate::connection::{Connection, FIRST_CALL, Stream};
use crate::limiter::ConnectionPermit;
use crate::listen_error::ListenError;

/// First byte of a TLS handshake.
const TLS_HANDSHAKE: u8 = 22;

/// TLS as the coordinator speaks it, and what a call has to show.
pub struct Tls {
    /// Shakes hands.
    pub acceptor: TlsAcceptor,
    /// What a call has to show.
    pub requirement: Requirement,
    /// Where certificates, token and deny list are.
    pub folder: PathBuf,
    /// The join address in that folder.
    pub join: JoinAddress,
    /// The coordinator's certificate.
    certificate: CertificateDer<'static>,
}

impl Tls {
    /// TLS with the certificates and the token in a folder of `coordinator certs`.
    pub fn read(folder: &Path) -> Result<Self, ListenError> {
        let unfit = |reason: String| ListenError::Unfit { folder: folder.to_owned(), reason };
        let provider = Arc::new(rustls::crypto::ring::default_provider());
        let mut roots = RootCertStore::empty();
        let authorities = read_certificates(&folder.join(CA_FILE))?;
        for ca in &authorities {
            roots.add(ca.clone()).map_err(|error| unfit(error.to_string()))?;
        }
        let (certificates, key) = read_identity(folder)?;
        issued(&certificates, &roots, &provider)
            .map_err(|error| unfit(format!("{CERTIFICATE_FILE} that no worker will accept: {error}")))?;
        let certificate = certificates[0].clone(); // there is one: it has been issued
        let join = certs::join_address(folder)?;
        // Workers insist on the CA that the join address names.
        let named = join.trust.as_ref().map(|trust| trust.ca);
        if !authorities.iter().any(|ca| Some(fingerprint(ca)) == named) {
            return Err(unfit(format!("{JOIN_FILE} that does not name the CA of {CA_FILE}")));
        }
        let verifier = WebPkiClientVerifier::builder_with_provider(Arc::new(roots), Arc::clone(&provider))
            .allow_unauthenticated() // whoever has a token needs no certificate
            .build()
            .map_err(|error| unfit(error.to_string()))?;
        let mut config = ServerConfig::builder_with_provider(provider)
            .with_protocol_versions(&[&rustls::version::TLS13])
            .and_then(|builder| {
                builder.with_client_cert_verifier(verifier).with_single_cert(certificates, key)
            })
            .map_err(|error| unfit(error.to_string()))?;
        config.alpn_protocols = vec![ALPN.to_vec()];
        config.send_tls13_tickets = 0; // no session is resumed: each connection shows its certificate anew
        Ok(Self {
            acceptor: TlsAcceptor::from(Arc::new(config)),
            requirement: Requirement::Credential(certs::token(folder)?),
            folder: folder.to_owned(),
            join,
            certificate,
        })
    }

    /// Whether the certificate is for a coordinator of this name.
    pub fn is_for(&self, host: &str) -> bool {
        let Ok(name) = ServerName::try_from(host) else { return false };
        ParsedCertificate::try_from(&self.certificate)
            .is_ok_and(|certificate| verify_server_name(&certificate, &name).is_ok())
    }
}

/// Whether these certificates are of one of these authorities and in force.
fn issued(
    certificates: &[CertificateDer<'_>],
    roots: &RootCertStore,
    provider: &CryptoProvider,
) -> Result<(), rustls::Error> {
    let [own, intermediates @ ..] = certificates else {
        return Err(rustls::Error::NoCertificatesPresented);
    };
    let own = ParsedCertificate::try_from(own)?;
    let algorithms = provider.signature_verification_algorithms.all;
    verify_server_cert_signed_by_trust_anchor(&own, roots, intermediates, UnixTime::now(), algorithms)
}

/// A TLS handshake with somebody who may not want one; `None` if it failed, which is noted.
pub async fn shake_hands(
    acceptor: &TlsAcceptor,
    stream: TcpStream,
    permit: ConnectionPermit,
    access: &AccessControl,
) -> Option<(Box<dyn Stream>, Arc<Connection>)> {
    let handshake = async {
        let mut first = [0];
        if stream.peek(&mut first).await? == 1 && first[0] != TLS_HANDSHAKE {
            refuse_plain_text(stream).await?;
            return Err(io::Error::other("plain text"));
        }
        acceptor.accept(stream).await
    };
    let reason = match tokio::time::timeout(FIRST_CALL, handshake).await {
        Ok(Ok(stream)) => {
            let shown = stream.get_ref().1.peer_certificates();
            let certificate = shown.and_then(|chain| chain.first()).map(fingerprint);
            return Some((Box::new(stream), access.connect(permit, certificate)));
        }
        Ok(Err(error)) => {
            tracing::debug!("transport: {}: no TLS handshake, got {error}", permit.address());
            "no TLS handshake"
        }
        Err(_) => "no TLS handshake in time",
    };
    access.refusals.note(reason, permit.address());
    None
}

/// Tells whoever speaks HTTP/2 in plain text, in its own terms, that this is not the way.
async fn refuse_plain_text(mut stream: TcpStream) -> io::Result<()> {
    const SETTINGS: [u8; 9] = [0, 0, 0, 4, 0, 0, 0, 0, 0];
    const INADEQUATE_SECURITY: u8 = 0xc;
    const GOAWAY: [u8; 17] = [0, 0, 8, 7, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, INADEQUATE_SECURITY];
    stream.write_all(&SETTINGS).await?;
    stream.write_all(&GOAWAY).await?;
    stream.shutdown().await?;
    // Closing with unread bytes would reset the connection, and the peer might never read the answer.
    let mut ignored = [0; 1024];
    for _ in 0..64 {
        if stream.read(&mut ignored).await? == 0 {
            break;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::certs::{Site, TOKEN_FILE, make_folder, validity};

    #[test]
    fn files_that_do_not_fit_together_are_refused_before_anybody_comes() {
        let parent = tempfile::tempdir().unwrap();
        let [one, other] = ["one", "other"].map(|name| {
            let folder = parent.path().join(name);
            make_folder(&folder, &Site { hosts: vec![], port: 7700 }, &validity(1)).unwrap();
            folder
        });
        let refused = |file: &str| {
            let own = fs::read(one.join(file)).unwrap();
            fs::copy(other.join(file), one.join(file)).unwrap();
            let error = Tls::read(&one).err().unwrap().to_string();
            fs::write(one.join(file), own).unwrap();
            error
        };
        assert!(refused(CA_FILE).contains("cert.pem that no worker will accept: "), "{}", refused(CA_FILE));
        assert!(
            refused(JOIN_FILE).contains("join that does not name the CA of ca.pem"),
            "{}",
            refused(JOIN_FILE)
        );
        assert!(matches!(Tls::read(&one).unwrap().requirement, Requirement::Credential(Some(_))));
        fs::remove_file(one.join(TOKEN_FILE)).unwrap();
        assert!(matches!(Tls::read(&one).unwrap().requirement, Requirement::Credential(None)));
    }
}
