//! Serving HTTP to those who watch runs: the loop that answers connections, and who is let in.

pub mod access;

use std::future::{pending, ready};
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::Request;
use axum::middleware::map_request;
use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use hyper_util::server::conn::auto::Builder;
use hyper_util::service::TowerToHyperService;
use tokio::sync::{Notify, mpsc};
use transport::WebConnection;

/// Whoever has not asked for anything by then loses the connection, of which there are few.
const FIRST_REQUEST: Duration = Duration::from_secs(30);
/// How often a peer that says nothing is asked whether it is still there.
const KEEP_ALIVE: Duration = Duration::from_secs(30);

/// Answers requests of all connections as long as they come.
pub async fn serve(router: Router, connections: mpsc::Receiver<WebConnection>) {
    serve_within(FIRST_REQUEST, router, connections).await;
}

async fn serve_within(
    first_request: Duration,
    router: Router,
    mut connections: mpsc::Receiver<WebConnection>,
) {
    while let Some(WebConnection { stream, permit }) = connections.recv().await {
        let asked = Arc::new(Notify::new());
        let note = {
            let asked = Arc::clone(&asked);
            move |request: Request| {
                asked.notify_one();
                ready(request)
            }
        };
        let service = TowerToHyperService::new(router.clone().layer(map_request(note)));
        tokio::spawn(async move {
            let mut builder = Builder::new(TokioExecutor::new());
            // Whoever is slow to ask again holds a connection for half a minute at most.
            builder.http1().timer(TokioTimer::new());
            builder
                .http2()
                .timer(TokioTimer::new())
                .keep_alive_interval(KEEP_ALIVE)
                .max_concurrent_streams(64);
            // The builder waits for as long as a peer likes until it knows which version of HTTP it speaks.
            let silence = async {
                if tokio::time::timeout(first_request, asked.notified()).await.is_ok() {
                    pending().await
                }
            };
            tokio::select! {
                // What a viewer does to its own connection concerns nobody else.
                _ = builder.serve_connection(TokioIo::new(stream), service) => {}
                () = silence => {}
            }
            drop(permit);
        });
    }
}

#[cfg(test)]
mod tests {
    use axum::routing::get;
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _, DuplexStream, duplex};
    use tokio::sync::Semaphore;

    use super::*;

    /// The peer's end of a connection that is served.
    async fn connected(permits: &Arc<Semaphore>, served: &mpsc::Sender<WebConnection>) -> DuplexStream {
        let (peer, stream) = duplex(4096);
        let permit = Arc::clone(permits).acquire_owned().await.unwrap();
        assert!(served.send(WebConnection { stream: Box::new(stream), permit }).await.is_ok());
        peer
    }

    #[tokio::test]
    async fn whoever_asks_for_nothing_loses_the_connection_and_others_keep_theirs() {
        let (served, connections) = mpsc::channel(1);
        let router = Router::new().route("/", get(|| async { "there" }));
        tokio::spawn(serve_within(Duration::from_millis(100), router, connections));
        let permits = Arc::new(Semaphore::new(4));
        let mut viewer = connected(&permits, &served).await;
        let mut ask = async || {
            viewer.write_all(b"GET / HTTP/1.1\r\nhost: here\r\n\r\n").await.unwrap();
            let mut answer = Vec::new();
            while !answer.ends_with(b"there") {
                assert!(viewer.read_buf(&mut answer).await.unwrap() > 0, "closed");
            }
        };
        ask().await;
        for begun in ["", "P", "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"] {
            let mut silent = connected(&permits, &served).await;
            silent.write_all(begun.as_bytes()).await.unwrap();
            let _ = silent.read_to_end(&mut Vec::new()).await; // until it is closed
        }
        ask().await;
        assert!(permits.available_permits() >= 3);
    }
}
