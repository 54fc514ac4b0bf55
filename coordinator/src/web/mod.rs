//! Serving HTTP to those who watch runs: the loop that answers connections, and who is let in.

pub mod access;
pub mod peer;

use std::future::ready;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::extract::Request;
use axum::middleware::map_request;
use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use hyper_util::server::conn::auto::Builder;
use hyper_util::service::TowerToHyperService;
use tokio::sync::mpsc;
use transport::WebConnection;

use peer::Peer;

/// Whoever asks for nothing for so long, and was never let in, loses the connection, of which there are few.
const IDLE: Duration = Duration::from_secs(30);
/// How often a peer that says nothing is asked whether it is still there.
const KEEP_ALIVE: Duration = Duration::from_secs(30);

/// Answers requests of all connections as long as they come.
pub async fn serve(router: Router, connections: mpsc::Receiver<WebConnection>) {
    serve_within(IDLE, router, connections).await;
}

async fn serve_within(idle: Duration, router: Router, mut connections: mpsc::Receiver<WebConnection>) {
    while let Some(WebConnection { stream, permit }) = connections.recv().await {
        let peer = Arc::new(Peer::new(permit));
        let note = {
            let peer = Arc::clone(&peer);
            move |mut request: Request| {
                peer.note_request();
                request.extensions_mut().insert(Arc::clone(&peer));
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
            tokio::select! {
                // What a viewer does to its own connection concerns nobody else.
                _ = builder.serve_connection(TokioIo::new(stream), service) => {}
                // HTTP itself sets no end to a peer that begins no request, sends one byte by byte, or answers pings alone.
                () = peer.until_idle(idle) => {}
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use axum::Extension;
    use axum::routing::{get, post};
    use futures_util::future::join_all;
    use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
    use tokio::net::TcpStream;
    use transport::{Protection, WebListener};

    use super::*;

    /// Sends a request, and reads its answer.
    async fn ask(viewer: &mut TcpStream, path: &str, answer: &str) {
        viewer.write_all(format!("GET {path} HTTP/1.1\r\nhost: here\r\n\r\n").as_bytes()).await.unwrap();
        let mut read = Vec::new();
        while !read.ends_with(answer.as_bytes()) {
            assert!(viewer.read_buf(&mut read).await.unwrap() > 0, "closed");
        }
    }

    #[tokio::test]
    async fn whoever_is_idle_and_was_never_let_in_loses_the_connection_and_others_keep_theirs() {
        let let_in = |Extension(peer): Extension<Arc<Peer>>| async move {
            peer.let_in();
            "let in"
        };
        let router = Router::new()
            .route("/", get(let_in))
            .route("/public", get(|| async { "public" }))
            .route("/login", post(|_: String| async { "login" }));
        let (free, protection) = ("127.0.0.1:0".parse().unwrap(), Protection::default());
        let listener = WebListener::bind("dashboard", free, &protection).await.unwrap();
        let address = listener.address;
        // A machine that is busy may take a while until it has read a request.
        tokio::spawn(serve_within(Duration::from_secs(2), router, listener.accept()));
        let mut viewer = TcpStream::connect(address).await.unwrap();
        ask(&mut viewer, "/", "let in").await;
        let begun = [
            "",
            "P",
            "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
            "POST /login HTTP/1.1\r\nhost: here\r\ncontent-length: 100\r\n\r\n{",
        ];
        let silent = begun.map(|begun| async move {
            let mut silent = TcpStream::connect(address).await.unwrap();
            silent.write_all(begun.as_bytes()).await.unwrap();
            let _ = silent.read_to_end(&mut Vec::new()).await; // until it is closed
        });
        let stranger = async {
            let mut stranger = TcpStream::connect(address).await.unwrap();
            ask(&mut stranger, "/public", "public").await;
            let _ = stranger.read_to_end(&mut Vec::new()).await;
        };
        tokio::join!(join_all(silent), stranger);
        ask(&mut viewer, "/public", "public").await;
    }
}
