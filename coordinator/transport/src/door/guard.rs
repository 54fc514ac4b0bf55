//! The guard before every service: who calls, how often, and how much it sends.

use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::task::{Context, Poll};
use std::time::{Duration, Instant};

use http_body::Frame;
use proto::MAX_MESSAGE_BYTES;
use tokio::time::Sleep;
use tonic::Status;
use tonic::body::Body;
use tonic::codegen::http::{Request, Response};
use tonic::codegen::{BoxFuture, Bytes};
use tower::{Layer, Service};

use crate::door::guest::Guest;

/// The call that adds a worker.
const REGISTER: &str = "/descry.v1.Coordinator/Register";
/// A request that is not whole after this time is given up.
const BODY_TIME: Duration = Duration::from_secs(20);
/// Bytes of requests of one connection that are not whole: the largest message, and small ones beside it.
const MAX_RECEIVING: usize = MAX_MESSAGE_BYTES + (1 << 20);

/// Puts a [`Guarded`] before services.
#[derive(Clone, Copy, Debug)]
pub struct Guard;

impl<S> Layer<S> for Guard {
    type Service = Guarded<S>;

    fn layer(&self, inner: S) -> Guarded<S> {
        Guarded { inner }
    }
}

/// A service whose every call has passed the gate.
#[derive(Clone, Debug)]
pub struct Guarded<S> {
    inner: S,
}

impl<S> Service<Request<Body>> for Guarded<S>
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
        let (guest, wait) = match admit(&request) {
            Ok(admitted) => admitted,
            Err(status) => return Box::pin(async move { Ok(status.into_http()) }),
        };
        let inner = self.inner.clone();
        let mut ready = std::mem::replace(&mut self.inner, inner); // the one that said it is ready
        Box::pin(async move {
            if !wait.is_zero() {
                tokio::time::sleep(wait).await;
            }
            ready.call(request.map(|body| Body::new(Incoming { body, guest, bytes: 0, late: None }))).await
        })
    }
}

/// Lets a call in, with the time it has to wait, or says why not and ends its connection.
fn admit(request: &Request<Body>) -> Result<(Arc<Guest>, Duration), Status> {
    let Some(guest) = request.extensions().get::<Arc<Guest>>() else {
        return Err(Status::internal("this call came through no door"));
    };
    let now = Instant::now();
    let authorization = request.headers().get("authorization").and_then(|value| value.to_str().ok());
    if let Err(status) = guest.gate().check(guest, authorization) {
        guest.gate().stop(guest, "not let in");
        return Err(status);
    }
    if request.uri().path() == REGISTER
        && let Err(wait) = guest.registration(now)
    {
        guest.gate().stop(guest, "too many registrations");
        return Err(Status::resource_exhausted(format!(
            "registrations: too many over one connection\ntry again in {} s, each worker over its own",
            wait.as_secs() + 1
        )));
    }
    Ok((Arc::clone(guest), guest.call(now)))
}

/// A request on its way in: bounded in time, and in bytes together with the others of its connection.
struct Incoming {
    body: Body,
    guest: Arc<Guest>,
    bytes: usize,
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
                this.guest.gate().stop(&this.guest, "a request that does not end");
                Some(Err(Status::deadline_exceeded("the request was not whole in time\nsend it again")))
            });
        };
        if let Some(data) = frame.as_ref().and_then(|frame| frame.as_ref().ok()?.data_ref()) {
            this.bytes += data.len();
            let receiving = this.guest.receiving.fetch_add(data.len(), Ordering::Relaxed) + data.len();
            if receiving > MAX_RECEIVING {
                this.guest.gate().stop(&this.guest, "too many bytes at once");
                return Poll::Ready(Some(Err(Status::resource_exhausted(
                    "requests: too many bytes at once over one connection\nsend one after the other",
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
        self.guest.receiving.fetch_sub(self.bytes, Ordering::Relaxed);
    }
}
