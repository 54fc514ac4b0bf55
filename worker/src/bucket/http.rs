//! Objects by URL, over HTTP: one request each, within a time and a size.

use std::error::Error;
use std::sync::Arc;
use std::time::Duration;

use http_body_util::{BodyExt as _, Full, Limited};
use hyper::body::{Body, Bytes, Incoming};
use hyper::{Method, Request, Response, StatusCode, Uri};
use hyper_rustls::{HttpsConnector, HttpsConnectorBuilder};
use hyper_util::client::legacy::Client;
use hyper_util::client::legacy::connect::HttpConnector;
use hyper_util::rt::{TokioExecutor, TokioTimer};
use rustls::crypto::ring;
use rustls::{ClientConfig, RootCertStore};

/// A connection that takes longer is no use.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(1);
/// Connections without a request are kept for so long.
const IDLE_TIMEOUT: Duration = Duration::from_secs(20);
/// An upload may take so long, and a second more for each of so many bytes.
const UPLOAD_TIMEOUT: (Duration, usize) = (Duration::from_secs(10), 1 << 20);
/// What is read of an answer that is no success, bytes: enough for the name of the fault.
const MAX_FAULT_BYTES: usize = 4 << 10;

/// The header that says what is stored, as S3 checks it.
const CHECKSUM: &str = "x-amz-checksum-sha256";

/// Why a request came to nothing. That there is no such object is no fault.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    /// The server says so.
    #[error("{status}{}", code.as_ref().map_or_else(String::new, |code| format!(" ({code})")))]
    Status {
        /// What it says.
        status: StatusCode,
        /// S3's name for it.
        code: Option<String>,
    },
    /// No answer, or half of one.
    #[error("{0}")]
    Connection(String),
    /// More bytes than the object can have.
    #[error("more than {0} bytes")]
    TooLarge(u64),
    /// No answer in time.
    #[error("no answer in time")]
    Late,
    /// Answers come, but too late.
    #[error("answers that take longer than they save")]
    Costly,
    /// It is not what it should be.
    #[error("{0}")]
    Damaged(String),
    /// No URL that can be asked.
    #[error("a URL that is none")]
    Url,
    /// The coordinator gives no URLs.
    #[error("{0}")]
    Unsigned(String),
}

/// A client of any server that speaks HTTP/1.1, with TLS 1.3 where the URL says so. It follows no redirects.
pub type HttpClient<B> = Client<HttpsConnector<HttpConnector>, B>;

/// A client without connections, which believes the certificates that this machine believes.
pub fn http_client<B: Body<Data: Send> + Send>() -> HttpClient<B> {
    let mut tcp = HttpConnector::new();
    tcp.enforce_http(false);
    tcp.set_nodelay(true);
    tcp.set_connect_timeout(Some(CONNECT_TIMEOUT));
    let provider = Arc::new(ring::default_provider());
    let connector = match HttpsConnectorBuilder::new().with_provider_and_native_roots(Arc::clone(&provider)) {
        Ok(connector) => connector,
        Err(error) => {
            tracing::warn!(
                "certificates of this machine: there are none, got {error}; no bucket is believed over https\ninstall ca-certificates or set SSL_CERT_FILE"
            );
            let config = ClientConfig::builder_with_provider(provider)
                .with_protocol_versions(&[&rustls::version::TLS13])
                .expect("ring has suites of TLS 1.3")
                .with_root_certificates(RootCertStore::empty())
                .with_no_client_auth();
            HttpsConnectorBuilder::new().with_tls_config(config)
        }
    };
    let connector = connector.https_or_http().enable_http1().wrap_connector(tcp);
    Client::builder(TokioExecutor::new())
        .pool_timer(TokioTimer::new())
        .pool_idle_timeout(IDLE_TIMEOUT)
        .build(connector)
}

/// Objects by URL.
#[derive(Clone, Debug)]
pub struct Http(HttpClient<Full<Bytes>>);

impl Http {
    /// A client without connections.
    pub fn new() -> Self {
        Self(http_client())
    }

    /// An object, `None` if there is none. Its caller gives up when it has waited long enough.
    pub async fn get(&self, url: &str, most: u64) -> Result<Option<Vec<u8>>, Fault> {
        let response = self.send(Method::GET, url, None, Bytes::new()).await?;
        match response.status() {
            StatusCode::OK if response.body().size_hint().lower() > most => Err(Fault::TooLarge(most)),
            StatusCode::OK => {
                let most_bytes = usize::try_from(most).unwrap_or(usize::MAX);
                match Limited::new(response.into_body(), most_bytes).collect().await {
                    Ok(body) => Ok(Some(body.to_bytes().into())),
                    Err(error) if error.is::<http_body_util::LengthLimitError>() => {
                        Err(Fault::TooLarge(most))
                    }
                    Err(error) => Err(Fault::Connection(innermost(&*error))),
                }
            }
            StatusCode::NOT_FOUND => Ok(None),
            _ => Err(refused(response).await),
        }
    }

    /// Stores an object whose bytes have this SHA-256, as base64.
    pub async fn put(&self, url: &str, sha256: &str, bytes: Bytes) -> Result<(), Fault> {
        let (base, a_second) = UPLOAD_TIMEOUT;
        let limit = base + Duration::from_secs((bytes.len() / a_second) as u64);
        let sent = async {
            let response = self.send(Method::PUT, url, Some(sha256), bytes).await?;
            if response.status().is_success() { Ok(()) } else { Err(refused(response).await) }
        };
        tokio::time::timeout(limit, sent).await.map_err(|_| Fault::Late)?
    }

    async fn send(
        &self,
        method: Method,
        url: &str,
        sha256: Option<&str>,
        bytes: Bytes,
    ) -> Result<Response<Incoming>, Fault> {
        let uri: Uri = url.parse().map_err(|_| Fault::Url)?;
        let request = Request::builder().method(method).uri(uri);
        let request = sha256.into_iter().fold(request, |request, sum| request.header(CHECKSUM, sum));
        let request = request.body(Full::new(bytes)).map_err(|_| Fault::Url)?;
        self.0.request(request).await.map_err(|error| Fault::Connection(innermost(&error)))
    }
}

/// What an answer says that is no success.
async fn refused(response: Response<Incoming>) -> Fault {
    let status = response.status();
    let body = Limited::new(response.into_body(), MAX_FAULT_BYTES).collect().await;
    let body = body.map(|body| body.to_bytes()).unwrap_or_default();
    Fault::Status { status, code: code(&String::from_utf8_lossy(&body)) }
}

/// The name that S3 has for a fault.
fn code(xml: &str) -> Option<String> {
    let code = xml.split_once("<Code>")?.1.split_once("</Code>")?.0;
    let is_name =
        !code.is_empty() && code.len() <= 64 && code.bytes().all(|byte| byte.is_ascii_alphanumeric());
    is_name.then(|| code.to_owned())
}

/// Why a request failed, as it may be shown.
fn innermost(error: &(dyn Error + 'static)) -> String {
    proto::printable(&proto::root_cause(error).to_string()).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_of_a_fault_is_read_and_nothing_else_is_taken_for_one() {
        let named = |code: &str| format!("<?xml version=\"1.0\"?><Error><Code>{code}</Code></Error>");
        assert_eq!(code(&named("SignatureDoesNotMatch")).as_deref(), Some("SignatureDoesNotMatch"));
        for text in ["", "<Code>", "</Code><Code>", &named(""), &named("\u{1b}[31m"), &named(&"a".repeat(65))]
        {
            assert_eq!(code(text), None, "{text}");
        }
    }
}
