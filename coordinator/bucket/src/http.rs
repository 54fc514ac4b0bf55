//! Requests of `object_store` by the HTTP client that workers have.

use std::error::Error;
use std::io;
use std::time::Duration;

use async_trait::async_trait;
use http_body_util::BodyExt as _;
use object_store::ClientOptions;
use object_store::client::{
    HttpClient, HttpConnector, HttpError, HttpErrorKind, HttpRequest, HttpRequestBody, HttpResponse,
    HttpResponseBody, HttpService,
};

/// Until the head of an answer is there.
const TIMEOUT: Duration = Duration::from_secs(10);

/// Makes such clients.
#[derive(Debug)]
pub struct Connector;

impl HttpConnector for Connector {
    fn connect(&self, _: &ClientOptions) -> object_store::Result<HttpClient> {
        Ok(HttpClient::new(Service(worker::http_client())))
    }
}

#[derive(Debug)]
struct Service(worker::HttpClient<HttpRequestBody>);

#[async_trait]
impl HttpService for Service {
    async fn call(&self, request: HttpRequest) -> Result<HttpResponse, HttpError> {
        let answer = tokio::time::timeout(TIMEOUT, self.0.request(request)).await;
        let late = |_| HttpError::new(HttpErrorKind::Timeout, io::Error::from(io::ErrorKind::TimedOut));
        let answer = answer.map_err(late)?.map_err(|error| {
            let kind = if error.is_connect() { HttpErrorKind::Connect } else { HttpErrorKind::Request };
            HttpError::new(kind, error)
        })?;
        let broken = |error: hyper::Error| {
            let error: Box<dyn Error + Send + Sync> = Box::new(error);
            HttpError::new_boxed(HttpErrorKind::Interrupted, error)
        };
        Ok(answer.map(|body| HttpResponseBody::new(body.map_err(broken).boxed())))
    }
}
