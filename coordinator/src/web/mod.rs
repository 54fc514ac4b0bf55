//! Serving HTTP to those who watch runs: the loop that answers connections, and who is let in.

pub mod access;

use axum::Router;
use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use hyper_util::server::conn::auto::Builder;
use hyper_util::service::TowerToHyperService;
use tokio::sync::mpsc;
use transport::WebConnection;

/// Answers requests of all connections as long as they come.
pub async fn serve(router: Router, mut connections: mpsc::Receiver<WebConnection>) {
    while let Some(WebConnection { stream, permit }) = connections.recv().await {
        let service = TowerToHyperService::new(router.clone());
        tokio::spawn(async move {
            let mut builder = Builder::new(TokioExecutor::new());
            // Whoever is slow to ask holds a connection for half a minute at most.
            builder.http1().timer(TokioTimer::new());
            builder.http2().timer(TokioTimer::new()).max_concurrent_streams(64);
            // What a viewer does to its own connection concerns nobody else.
            let _ = builder.serve_connection(TokioIo::new(stream), service).await;
            drop(permit);
        });
    }
}
