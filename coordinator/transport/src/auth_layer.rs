//! The layer before every service: who calls, how often, and how much it sends.

use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::task::{Context, Poll};
use std::time::{Duration, Instant};

use http_body::Frame;
use proto::{MAX_MESSAGE_BYTES, Origin};
use tokio::time::Sleep;
use tonic::Status;
use tonic::body::Body;
use tonic::codegen::http::{Request, Response};
use tonic::codegen::{BoxFuture, Bytes};
use tower::{Layer, Service};

use crate::access::AccessControl;
use crate::budget::RequestShare;
use crate::connection::Connection;

/// The call that adds a worker.
const REGISTER: &str = "/descry.v2.Coordinator/Register";
/// A request that is not whole after this time is given up.
const BODY_TIME: Duration = Duration::from_secs(20);
/// Bytes of requests of one connection that are not whole: the largest message, and small ones beside it.
const MAX_RECEIVING: usize = MAX_MESSAGE_BYTES + (1 << 20);

/// Puts an [`AuthService`] before services.
#[derive(Clone)]
pub struct AuthLayer(pub Arc<AccessControl>);

impl<S> Layer<S> for AuthLayer {
    type Service = AuthService<S>;

    fn layer(&self, inner: S) -> AuthService<S> {
        AuthService { inner, access: Arc::clone(&self.0) }
    }
}

/// A service of which only those calls are made that access control lets in.
#[derive(Clone)]
pub struct AuthService<S> {
    inner: S,
    access: Arc<AccessControl>,
}

impl<S> Service<Request<Body>> for AuthService<S>
where
    S: Service<Request<Body>, Response = Response<Body>> + Clone + Send + 'static,
    S::Future: Send,
{
    type Response = Response<Body>;
    type Error = S::Error;
    type Future = BoxFuture<Response<Body>, S::Error>;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.inner.poll_ready(context)
    }

    fn call(&mut self, request: Request<Body>) -> Self::Future {
        let (connection, wait) = match admit(&self.access, &request) {
            Ok(admitted) => admitted,
            Err(status) => return Box::pin(async move { Ok(status.into_http()) }),
        };
        let (inner, access) = (self.inner.clone(), Arc::clone(&self.access));
        let mut ready = std::mem::replace(&mut self.inner, inner); // the one that said it is ready
        Box::pin(async move {
            if !wait.is_zero() {
                tokio::time::sleep(wait).await;
            }
            let share = access.requests.begin(Origin::of(connection.address()));
            let incoming = |body| Incoming { body, connection, access, bytes: 0, share, late: None };
            ready.call(request.map(|body| Body::new(incoming(body)))).await
        })
    }
}

/// Lets a call in, with the time it has to wait, or says why not and ends its connection.
fn admit(access: &AccessControl, request: &Request<Body>) -> Result<(Arc<Connection>, Duration), Status> {
    let Some(connection) = request.extensions().get::<Arc<Connection>>() else {
        return Err(Status::internal("this call has no connection"));
    };
    let now = Instant::now();
    let authorization = request.headers().get("authorization").and_then(|value| value.to_str().ok());
    if let Err(status) = access.check(connection, authorization) {
        access.stop(connection, "not let in");
        return Err(status);
    }
    if request.uri().path() == REGISTER
        && let Err(wait) = connection.registration(now)
    {
        access.stop(connection, "too many registrations");
        return Err(Status::resource_exhausted(format!(
            "registrations: too many over one connection\ntry again in {} s, each worker over its own",
            wait.as_secs() + 1
        )));
    }
    Ok((Arc::clone(connection), connection.call(now)))
}

/// A request on its way in: bounded in time, and in bytes together with the others of its connection.
struct Incoming {
    body: Body,
    connection: Arc<Connection>,
    access: Arc<AccessControl>,
    bytes: usize,
    share: RequestShare,
    /// Set once the request keeps us waiting.
    late: Option<Pin<Box<Sleep>>>,
}

impl http_body::Body for Incoming {
    type Data = Bytes;
    type Error = Status;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Status>>> {
        let this = &mut *self;
        let Poll::Ready(frame) = Pin::new(&mut this.body).poll_frame(context) else {
            let late = this.late.get_or_insert_with(|| Box::pin(tokio::time::sleep(BODY_TIME)));
            return late.as_mut().poll(context).map(|()| {
                this.access.stop(&this.connection, "a request that does not end");
                Some(Err(Status::deadline_exceeded("the request was not whole in time\nsend it again")))
            });
        };
        if let Some(data) = frame.as_ref().and_then(|frame| frame.as_ref().ok()?.data_ref()) {
            this.bytes += data.len();
            let receiving = this.connection.receiving.fetch_add(data.len(), Ordering::Relaxed) + data.len();
            if receiving > MAX_RECEIVING || !this.share.grow(data.len()) {
                this.access.stop(&this.connection, "too many bytes at once");
                return Poll::Ready(Some(Err(Status::resource_exhausted(
                    "requests: too many bytes at once from one address\nsend one after the other",
                ))));
            }
        }
        Poll::Ready(frame)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }
}

impl Drop for Incoming {
    fn drop(&mut self) {
        self.connection.receiving.fetch_sub(self.bytes, Ordering::Relaxed);
    }
}
