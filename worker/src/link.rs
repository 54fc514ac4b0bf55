//! The link to a coordinator: plain or encrypted, with what the worker has to show at each call.

use std::error::Error;
use std::future::Future;
use std::io;
use std::net::IpAddr;
use std::path::Path;
use std::sync::{Arc, PoisonError, RwLock};
use std::time::Duration;

use hyper_util::rt::TokioIo;
use proto::tls::TlsFilesError;
use proto::{JoinAddress, Token};
use rustls::pki_types::ServerName;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpStream, lookup_host};
use tokio::time::{Instant, timeout_at};
use tokio_rustls::TlsConnector;
use tonic::metadata::{Ascii, MetadataValue};
use tonic::service::Interceptor;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::{Channel, Endpoint};
use tonic::{Code, Request, Status};
use tower::service_fn;

use crate::tls;

/// A connection that is not there after this time is given up.
const CONNECT_TIME: Duration = Duration::from_secs(5);

/// A connection that is made when it is needed and made again when it is lost.
pub type Link = InterceptedService<Channel, Credentials>;

/// Where the coordinator is, and how it is spoken to.
struct Target {
    host: String,
    port: u16,
    tls: Option<TlsConnector>,
    token: Option<MetadataValue<Ascii>>,
}

/// Where a worker looks for its coordinator, which may change; nowhere, at first.
#[derive(Clone, Default)]
pub struct Coordinator(Arc<RwLock<Option<Arc<Target>>>>);

impl Coordinator {
    /// The coordinator at `address`; `identity` is a folder with a certificate to show.
    ///
    /// # Errors
    /// If the files in `identity` cannot be used.
    pub fn at(address: &JoinAddress, identity: Option<&Path>) -> Result<Self, TlsFilesError> {
        let coordinator = Self::default();
        coordinator.move_to(address, identity)?;
        Ok(coordinator)
    }

    /// It is elsewhere now: calls go there as soon as the connection to where it was is lost.
    ///
    /// # Errors
    /// If the files in `identity` cannot be used.
    pub fn move_to(&self, address: &JoinAddress, identity: Option<&Path>) -> Result<(), TlsFilesError> {
        let tls = match &address.trust {
            Some(trust) => Some(TlsConnector::from(Arc::new(tls::client_config(trust.ca, identity)?))),
            None => None,
        };
        let token = address.trust.as_ref().and_then(|trust| trust.token.as_ref()).and_then(metadata);
        let target = Target { host: address.host.clone(), port: address.port, tls, token };
        *self.0.write().unwrap_or_else(PoisonError::into_inner) = Some(Arc::new(target));
        Ok(())
    }

    /// A link to it, wherever it is when the link is dialled.
    pub fn link(&self) -> Link {
        let coordinator = self.clone();
        let connect = service_fn(move |_| {
            let target = coordinator.target();
            async move {
                let nowhere = || io::Error::new(io::ErrorKind::NotFound, "its address is not known yet");
                Ok::<_, io::Error>(TokioIo::new(connect(&*target.ok_or_else(nowhere)?, CONNECT_TIME).await?))
            }
        });
        // The name is for the log only: the connector dials.
        let channel = Endpoint::from_static("http://coordinator")
            // A cable that was pulled gives no error: ask the other side whether it is still there.
            .http2_keep_alive_interval(Duration::from_secs(10))
            .keep_alive_timeout(Duration::from_secs(10))
            .keep_alive_while_idle(true)
            .connect_with_connector_lazy(connect);
        Link::new(channel, Credentials(self.clone()))
    }

    fn target(&self) -> Option<Arc<Target>> {
        self.0.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Host and port.
    #[cfg(test)]
    pub fn place(&self) -> Option<(String, u16)> {
        self.target().map(|target| (target.host.clone(), target.port))
    }
}

/// How a token is shown.
fn metadata(token: &Token) -> Option<MetadataValue<Ascii>> {
    let mut value = MetadataValue::try_from(format!("Bearer {}", token.reveal())).ok()?;
    value.set_sensitive(true); // kept out of header tables and of debug output
    Some(value)
}

/// What a worker shows at each call: the token of its join address, or nothing.
#[derive(Clone, Default)]
pub struct Credentials(Coordinator);

impl Interceptor for Credentials {
    fn call(&mut self, mut request: Request<()>) -> Result<Request<()>, Status> {
        if let Some(token) = self.0.target().and_then(|target| target.token.clone()) {
            request.metadata_mut().insert("authorization", token);
        }
        Ok(request)
    }
}

/// Why a connection cannot become one, whatever the patience.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct Untrusted(String);

trait Stream: AsyncRead + AsyncWrite + Send + Unpin {}
impl<T: AsyncRead + AsyncWrite + Send + Unpin> Stream for T {}

/// A link to the coordinator at `address`, which is dialled at the first call; `identity` is a folder with a certificate
/// to show.
///
/// # Errors
/// If the files in `identity` cannot be used.
pub fn link(address: &JoinAddress, identity: Option<&Path>) -> Result<Link, TlsFilesError> {
    Ok(Coordinator::at(address, identity)?.link())
}

/// Connects within `time`. Each step fails in words of its own: whoever waits has to know which one it is.
async fn connect(target: &Target, time: Duration) -> io::Result<Box<dyn Stream>> {
    let Target { host, port, tls, .. } = target;
    let deadline = Instant::now() + time;
    let unresolved = |got: io::Error| {
        io::Error::new(got.kind(), format!("the host name {host} cannot be resolved, got {got}"))
    };
    let found = lookup_host((host.as_str(), *port));
    let found: Vec<_> = within(deadline, "no answer", found).await.map_err(unresolved)?.collect();
    let stream = within(deadline, "it does not answer", TcpStream::connect(&*found)).await?;
    stream.set_nodelay(true)?;
    let Some(tls) = tls else { return Ok(Box::new(stream)) };
    let name = ServerName::try_from(host.clone()).map_err(io::Error::other)?;
    let explained = |error: io::Error| {
        let tls = error.get_ref().and_then(|inner| inner.downcast_ref::<rustls::Error>());
        match (tls.and_then(tls::explain), error.kind()) {
            (Some(explanation), _) => io::Error::other(Untrusted(explanation)),
            (None, io::ErrorKind::UnexpectedEof) => {
                io::Error::other("it ended the TLS handshake: perhaps its port does not speak TLS")
            }
            (None, _) => error,
        }
    };
    let shaken = async { tls.connect(name, stream).await.map_err(explained) };
    Ok(Box::new(within(deadline, "it does not end the TLS handshake", shaken).await?))
}

/// A step of a connection, which fails in these words if it has not come to its end by the deadline.
async fn within<T>(
    deadline: Instant,
    late: &'static str,
    step: impl Future<Output = io::Result<T>>,
) -> io::Result<T> {
    timeout_at(deadline, step).await.unwrap_or_else(|_| Err(io::Error::new(io::ErrorKind::TimedOut, late)))
}

/// Says that a connection to another machine would not be encrypted.
pub fn warn_if_plain(address: &JoinAddress) {
    if address.trust.is_none() && !is_loopback(&address.host) {
        tracing::warn!("the connection is not encrypted: use it inside a trusted network only");
    }
}

fn is_loopback(host: &str) -> bool {
    host == "localhost" || host.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

/// Why the same call would fail for ever, if it would: what the operator has to know.
pub fn hopeless(status: &Status) -> Option<String> {
    let causes = std::iter::successors(status.source(), |&error| error.source());
    let mut innermost: Option<&dyn Error> = None;
    for cause in causes {
        let inner = cause.downcast_ref::<io::Error>().and_then(io::Error::get_ref);
        let untrusted = inner.and_then(|inner| inner.downcast_ref::<Untrusted>());
        if let Some(Untrusted(explanation)) = untrusted.or_else(|| cause.downcast_ref()) {
            return Some(explanation.clone());
        }
        innermost = Some(cause);
    }
    // TLS 1.3 tells a client that its certificate is refused only after the handshake.
    let text = innermost.map(ToString::to_string).unwrap_or_default();
    if let Some((_, alert)) = text.split_once("received fatal alert: ") {
        return Some(tls::refused(alert));
    }
    match status.code() {
        // HTTP/2's "inadequate security": a coordinator with TLS was addressed without.
        Code::PermissionDenied if innermost.is_some() => Some(
            "the coordinator speaks TLS only\nuse its join address, https://…, which `coordinator certs` has made".to_owned(),
        ),
        Code::Unimplemented => Some(format!(
            "the coordinator does not speak version {} of the protocol\ninstall the coordinator's release on this worker",
            proto::PROTOCOL_MAJOR
        )),
        // The same call again would get the same answer.
        Code::InvalidArgument
        | Code::OutOfRange
        | Code::FailedPrecondition
        | Code::PermissionDenied
        | Code::Unauthenticated => {
            Some(status.message().to_owned())
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Why a coordinator cannot be reached.
    async fn failure(address: &str) -> String {
        let target = Coordinator::at(&address.parse().unwrap(), None).unwrap().target().unwrap();
        let connected = connect(&target, Duration::from_millis(200)).await;
        connected.err().unwrap_or_else(|| panic!("{address}: is there")).to_string()
    }

    #[tokio::test]
    async fn what_keeps_a_connection_from_being_made_is_told_apart() {
        let reserved = failure("http://nowhere.invalid:7700").await; // by RFC 6761 nobody has it
        assert!(reserved.starts_with("the host name nowhere.invalid cannot be resolved, got "), "{reserved}");
        let silent = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let port = silent.local_addr().unwrap().port();
        let trusted = format!("https://127.0.0.1:{port}#ca={}", "0".repeat(64));
        assert_eq!(failure(&trusted).await, "it does not end the TLS handshake");
        drop(silent);
        let refused = failure(&trusted).await;
        assert!(refused.starts_with("Connection refused"), "{refused}");
        let late = within(Instant::now(), "it does not answer", std::future::pending::<io::Result<()>>());
        assert_eq!(late.await.unwrap_err().to_string(), "it does not answer");
    }

    #[test]
    fn this_machine_is_told_from_others() {
        for host in ["127.0.0.1", "localhost", "::1", "127.8.8.8"] {
            assert!(is_loopback(host), "{host}");
        }
        for host in ["192.0.2.7", "gpu-host", "2001:db8::1", "127.0.0.1.example"] {
            assert!(!is_loopback(host), "{host}");
        }
    }
}
