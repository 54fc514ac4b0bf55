//! Answers to scrapes and probes.

use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::{Request, State};
use axum::http::header::{ACCEPT, CACHE_CONTROL, CONTENT_TYPE, WWW_AUTHENTICATE};
use axum::http::{HeaderMap, StatusCode};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse as _, Response};
use axum::routing::get;
use prometheus_client::encoding::{prometheus_text, text};
use prometheus_client::registry::Registry;
use tokio::sync::Semaphore;

use super::collector::Collector;
use super::source::MetricsSource;
use crate::web::access::{Access, Refusal, Right, protect};

/// Format of OpenMetrics.
const OPENMETRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";
const PLAIN: &str = "text/plain; charset=utf-8";
/// Requests that look at the scheduler at a time: each takes its lock for a moment.
const LOOKS: usize = 2;
/// A lock that cannot be had for so long is held by a thread that hangs.
const PATIENCE: Duration = Duration::from_secs(5);

struct Server {
    source: Arc<MetricsSource>,
    registry: Registry,
    access: Access,
    looks: Arc<Semaphore>,
}

type Shared = State<Arc<Server>>;

/// All that is answered.
pub fn router(source: Arc<MetricsSource>, access: Access) -> Router {
    let mut registry = Registry::default();
    registry.register_collector(Box::new(Collector(Arc::clone(&source))));
    let server = Arc::new(Server { source, registry, access, looks: Arc::new(Semaphore::new(LOOKS)) });
    Router::new()
        .route("/metrics", get(metrics))
        .route("/healthz", get(healthz))
        .route("/readyz", get(readyz))
        .fallback(unknown)
        .layer(from_fn_with_state(Arc::clone(&server), check))
        .with_state(server)
}

/// Lets in who may come in: probes tell nobody anything, and need not show a token.
async fn check(State(server): Shared, request: Request, next: Next) -> Response {
    let needed = if request.uri().path() == "/metrics" { Right::View } else { Right::Page };
    let mut response = match server.access.admit(&request) {
        Err(refusal) => refused(refusal),
        Ok(right) if right < needed => refused(Refusal::Token),
        Ok(_) => next.run(request).await,
    };
    protect(response.headers_mut());
    response
}

fn refused(refusal: Refusal) -> Response {
    let (status, why) = refusal.text();
    let mut response = line(status, why);
    if status == StatusCode::UNAUTHORIZED {
        response.headers_mut().insert(WWW_AUTHENTICATE, axum::http::HeaderValue::from_static("Bearer"));
    }
    response
}

fn line(status: StatusCode, text: &str) -> Response {
    (status, [(CONTENT_TYPE, PLAIN), (CACHE_CONTROL, "no-store")], format!("{text}\n")).into_response()
}

/// What a look at the scheduler gives, on a thread that may wait for its lock; `None` if that cannot be had.
async fn look<T: Send + 'static>(
    server: &Arc<Server>,
    look: impl FnOnce(&Server) -> T + Send + 'static,
) -> Option<T> {
    let looked = async {
        let permit = Arc::clone(&server.looks).acquire_owned().await.ok()?;
        let shared = Arc::clone(server);
        let looked = tokio::task::spawn_blocking(move || {
            let _permit = permit; // a thread that nobody waits for any more still looks
            look(&shared)
        });
        looked.await.ok()
    };
    tokio::time::timeout(PATIENCE, looked).await.ok().flatten()
}

async fn metrics(State(server): Shared, headers: HeaderMap) -> Response {
    let wants_openmetrics = headers
        .get_all(ACCEPT)
        .iter()
        .filter_map(|accept| accept.to_str().ok())
        .any(|accept| accept.contains("application/openmetrics-text"));
    let encoded = look(&server, move |server| {
        let mut body = String::new();
        let (kind, encoded) = if wants_openmetrics {
            (OPENMETRICS, text::encode(&mut body, &server.registry))
        } else {
            (prometheus_text::CONTENT_TYPE, prometheus_text::encode(&mut body, &server.registry))
        };
        encoded.map(|()| (kind, body))
    });
    match encoded.await {
        Some(Ok((kind, body))) => ([(CONTENT_TYPE, kind), (CACHE_CONTROL, "no-store")], body).into_response(),
        Some(Err(error)) => line(StatusCode::INTERNAL_SERVER_ERROR, &format!("metrics: {error}")),
        None => line(StatusCode::SERVICE_UNAVAILABLE, HANGS),
    }
}

const HANGS: &str = "the scheduler has not answered for 5 s";

async fn healthz(State(server): Shared) -> Response {
    match look(&server, |server| server.source.probe()).await {
        Some(()) => line(StatusCode::OK, "ok"),
        None => line(StatusCode::SERVICE_UNAVAILABLE, HANGS),
    }
}

async fn readyz(State(server): Shared) -> Response {
    match look(&server, |server| server.source.ready()).await {
        Some(Ok(())) => line(StatusCode::OK, "ready"),
        Some(Err(why)) => line(StatusCode::SERVICE_UNAVAILABLE, why),
        None => line(StatusCode::SERVICE_UNAVAILABLE, HANGS),
    }
}

async fn unknown() -> Response {
    line(StatusCode::NOT_FOUND, "no such address\nask for /metrics, /healthz or /readyz")
}
