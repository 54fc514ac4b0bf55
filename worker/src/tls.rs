//! TLS as a worker speaks it: it trusts the CA of its join address and no other, and may show a certificate.

use std::path::Path;
use std::sync::Arc;

use proto::Fingerprint;
use proto::tls::{ALPN, TlsFilesError, fingerprint, read_identity};
use rustls::client::WebPkiServerVerifier;
use rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use rustls::crypto::{CryptoProvider, ring};
use rustls::pki_types::{CertificateDer, ServerName, UnixTime};
use rustls::{
    CertificateError, ClientConfig, DigitallySignedStruct, InvalidMessage, OtherError, RootCertStore,
    SignatureScheme,
};

/// A worker's side of TLS: trusts coordinators of this CA, and shows the certificate in `identity`, if any.
///
/// # Errors
/// If the files in `identity` cannot be used.
pub fn client_config(ca: Fingerprint, identity: Option<&Path>) -> Result<ClientConfig, TlsFilesError> {
    let provider = Arc::new(ring::default_provider());
    let builder = ClientConfig::builder_with_provider(Arc::clone(&provider))
        .with_protocol_versions(&[&rustls::version::TLS13])
        .expect("ring has suites of TLS 1.3")
        .dangerous() // rustls's word for any verifier of one's own; this one only adds a condition to webpki's
        .with_custom_certificate_verifier(Arc::new(PinnedCa { ca, provider }));
    let mut config = match identity {
        None => builder.with_no_client_auth(),
        Some(folder) => {
            let (certificates, key) = read_identity(folder)?;
            builder
                .with_client_auth_cert(certificates, key)
                .map_err(|source| TlsFilesError::Unfit { folder: folder.to_owned(), source })?
        }
    };
    config.alpn_protocols = vec![ALPN.to_vec()];
    Ok(config)
}

/// Verifies a coordinator's chain against the CA at its end, whose fingerprint must be the one of the join address.
#[derive(Debug)]
struct PinnedCa {
    ca: Fingerprint,
    provider: Arc<CryptoProvider>,
}

#[derive(Debug, thiserror::Error)]
#[error("its CA must have the fingerprint {expected}, got {got}")]
struct WrongCa {
    expected: Fingerprint,
    got: Fingerprint,
}

impl ServerCertVerifier for PinnedCa {
    fn verify_server_cert(
        &self,
        end_entity: &CertificateDer<'_>,
        intermediates: &[CertificateDer<'_>],
        server_name: &ServerName<'_>,
        ocsp_response: &[u8],
        now: UnixTime,
    ) -> Result<ServerCertVerified, rustls::Error> {
        let (root, between) = intermediates.split_last().unwrap_or((end_entity, &[]));
        let got = fingerprint(root);
        if got != self.ca {
            let wrong = Arc::new(WrongCa { expected: self.ca, got });
            return Err(CertificateError::Other(OtherError(wrong)).into());
        }
        let mut roots = RootCertStore::empty();
        roots.add(root.clone().into_owned())?;
        WebPkiServerVerifier::builder_with_provider(Arc::new(roots), Arc::clone(&self.provider))
            .build()
            .map_err(|error| rustls::Error::General(error.to_string()))?
            .verify_server_cert(end_entity, between, server_name, ocsp_response, now)
    }

    fn verify_tls12_signature(
        &self,
        _: &[u8],
        _: &CertificateDer<'_>,
        _: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, rustls::Error> {
        Err(rustls::Error::General("TLS 1.3 is the only version spoken here".to_owned()))
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signature: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, rustls::Error> {
        let algorithms = &self.provider.signature_verification_algorithms;
        rustls::crypto::verify_tls13_signature(message, certificate, signature, algorithms)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.provider.signature_verification_algorithms.supported_schemes()
    }
}

/// What a failed handshake means to the operator, and what to do; `None` for what may pass by itself.
pub fn explain(error: &rustls::Error) -> Option<String> {
    Some(match error {
        rustls::Error::InvalidCertificate(CertificateError::Other(OtherError(wrong))) if wrong.is::<WrongCa>() => {
            format!(
                "the coordinator is not the one of the join address: {wrong}\ntake the join address of this coordinator; if its certificates are the same as ever, somebody else answers in its place"
            )
        }
        rustls::Error::InvalidCertificate(
            expired @ (CertificateError::Expired
            | CertificateError::ExpiredContext { .. }
            | CertificateError::NotValidYet
            | CertificateError::NotValidYetContext { .. }),
        ) => format!("the coordinator's certificate is out of date: {expired}\nmake another with `coordinator certs`, or set the clock of this machine"),
        rustls::Error::InvalidCertificate(
            name @ (CertificateError::NotValidForName | CertificateError::NotValidForNameContext { .. }),
        ) => format!("the coordinator's certificate is for other names: {name}\nuse one of its names, or make certificates for this one: coordinator certs DIR --host NAME"),
        rustls::Error::InvalidCertificate(other) => {
            format!("the coordinator's certificate cannot be trusted: {other}\ntake the join address of this coordinator")
        }
        rustls::Error::InvalidMessage(InvalidMessage::InvalidContentType | InvalidMessage::UnknownProtocolVersion | InvalidMessage::MessageTooLarge) => {
            "the coordinator's port does not speak TLS\nstart it with --tls, or use its plain address, http://…, inside a trusted network".to_owned()
        }
        rustls::Error::AlertReceived(alert) => refused(&format!("{alert:?}")),
        _ => return None,
    })
}

/// What an alert of the coordinator means: it has looked at the certificate of this worker.
pub fn refused(alert: &str) -> String {
    format!(
        "the coordinator refuses the certificate of this worker, or misses one: {alert}\nmake another with `coordinator certs DIR --worker NAME`, or take a join address with a token"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_without_files_says_what_is_missing() {
        let folder = tempfile::tempdir().unwrap();
        let error = client_config(Fingerprint([0; 32]), Some(folder.path())).unwrap_err().to_string();
        assert!(error.contains("cert.pem: cannot be used") && error.contains("\nmake it with"), "{error}");
        client_config(Fingerprint([0; 32]), None).unwrap();
    }
}
