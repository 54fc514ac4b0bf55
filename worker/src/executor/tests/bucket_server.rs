//! A server that keeps objects as S3 does, well or badly.

use std::collections::HashMap;
use std::convert::Infallible;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex};

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use http_body_util::{BodyExt as _, Full};
use hyper::body::{Bytes, Incoming};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::TokioIo;
use proto::{MAX_BLOB_BYTES, v2};
use ring::digest;
use tokio::net::TcpListener;

/// What the server does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// What it should.
    Well,
    /// It takes requests and answers none.
    Hung,
    /// It answers the first of a batch, and lets the others wait.
    Stalls,
    /// The key is wrong.
    Forbidden,
    /// Nothing more can be stored.
    Full,
    /// A bit of each object is wrong.
    Corrupt,
    /// It closes each connection half-way.
    Truncating,
    /// It answers with more than any object has.
    TooLarge,
    /// Nobody listens.
    Gone,
}

impl Mode {
    /// Whether it lets others wait for ever.
    pub fn waits(self) -> bool {
        matches!(self, Self::Hung | Self::Stalls)
    }
}

/// A bucket, and what was asked of it.
#[derive(Clone)]
pub struct BucketServer {
    address: SocketAddr,
    /// By path.
    pub objects: Arc<Mutex<HashMap<String, Vec<u8>>>>,
    /// SHA-256 of the contents for which the coordinator vouches, by path; of no other objects it knows any.
    pub known: Arc<Mutex<HashMap<String, Vec<u8>>>>,
    pub mode: Mode,
    /// Requests to read and to write so far.
    pub requests: Arc<[AtomicU32; 2]>,
}

impl BucketServer {
    /// Serves until the test ends.
    pub async fn start(mode: Mode) -> Self {
        Self::with(mode, Arc::default()).await
    }

    /// Another one with these objects.
    pub async fn with(mode: Mode, objects: Arc<Mutex<HashMap<String, Vec<u8>>>>) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let server = Self { address, objects, known: Arc::default(), mode, requests: Arc::default() };
        if mode == Mode::Gone {
            return server; // the listener is dropped
        }
        let serving = server.clone();
        tokio::spawn(async move {
            loop {
                let (stream, _) = listener.accept().await.unwrap();
                let server = serving.clone();
                tokio::spawn(async move {
                    let answer = service_fn(move |request| {
                        let server = server.clone();
                        async move { Ok::<_, Infallible>(server.answer(request).await) }
                    });
                    let _ = http1::Builder::new().serve_connection(TokioIo::new(stream), answer).await;
                });
            }
        });
        server
    }

    /// What a coordinator would sign, and the SHA-256 of what is there as far as it knows it.
    pub fn urls(&self, request: &v2::PresignUrlsRequest) -> (Vec<String>, Vec<Vec<u8>>) {
        let hex = |bytes: &[u8]| bytes.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
        let kind = request.kind.replace(' ', "-");
        let known = self.known.lock().unwrap();
        let signed = |object: &v2::Object| {
            let path = format!("/lab/{kind}/{}", hex(&object.key));
            (format!("http://{}{path}?signed", self.address), known.get(&path).cloned().unwrap_or_default())
        };
        request.objects.iter().map(signed).unzip()
    }

    /// Requests to read and to write so far.
    pub fn asked(&self) -> [u32; 2] {
        [0, 1].map(|which| self.requests[which].load(Ordering::Relaxed))
    }

    async fn answer(&self, request: Request<Incoming>) -> Response<Full<Bytes>> {
        let (path, is_write) = (request.uri().path().to_owned(), *request.method() == Method::PUT);
        let before = self.requests[usize::from(is_write)].fetch_add(1, Ordering::Relaxed);
        let status = |status, body: Vec<u8>| {
            Response::builder().status(status).body(Full::new(Bytes::from(body))).unwrap()
        };
        match self.mode {
            Mode::Hung => std::future::pending().await,
            Mode::Stalls if before > 0 => std::future::pending().await,
            Mode::Forbidden => {
                let fault = b"<Error><Code>InvalidAccessKeyId</Code></Error>".to_vec();
                return status(StatusCode::FORBIDDEN, fault);
            }
            Mode::Full if is_write => return status(StatusCode::INSUFFICIENT_STORAGE, vec![]),
            Mode::TooLarge => return status(StatusCode::OK, vec![0; MAX_BLOB_BYTES as usize + 1]),
            _ => {}
        }
        if is_write {
            let sum = request.headers()["x-amz-checksum-sha256"].clone();
            let bytes = request.into_body().collect().await.unwrap().to_bytes();
            let expected = BASE64_STANDARD.encode(digest::digest(&digest::SHA256, &bytes));
            if sum != expected {
                return status(StatusCode::BAD_REQUEST, vec![]);
            }
            self.objects.lock().unwrap().insert(path, bytes.to_vec());
            return status(StatusCode::OK, vec![]);
        }
        let Some(mut bytes) = self.objects.lock().unwrap().get(&path).cloned() else {
            return status(StatusCode::NOT_FOUND, vec![]);
        };
        match self.mode {
            Mode::Corrupt => {
                let middle = bytes.len() / 2;
                bytes[middle] ^= 1;
            }
            Mode::Truncating => bytes.truncate(bytes.len() / 2),
            _ => {}
        }
        status(StatusCode::OK, bytes)
    }
}
