//! Requests and answers.

use std::path::Path;
use std::sync::Arc;

use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::{Request, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_DISPOSITION, CONTENT_TYPE, SET_COOKIE};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse as _, Response};
use axum::routing::{any, get, post};
use proto::Message;
use serde::Deserialize;
use serde_json::json;
use tokio::sync::mpsc;
use transport::WebConnection;
use worker::names::Names;

use super::assets::asset;
use super::control::Order;
use super::error::DashboardError;
use super::query::Query;
use super::shown::Which;
use super::state::Server;
use super::stream;
use crate::web;
use crate::web::access::{Refusal, Right, protect};

/// Longest body of a request, bytes.
const MAX_BODY: usize = 16 << 10;
/// Points of a cloud unless the request says otherwise.
const POINTS: usize = 20_000;

/// Who asks, as `check` has found out.
#[derive(Clone, Copy)]
struct Caller(Right);

type Shared = State<Arc<Server>>;

/// Answers requests of all connections as long as they come.
pub async fn serve(server: Arc<Server>, connections: mpsc::Receiver<WebConnection>) {
    let router = Router::new()
        .route("/api/runs", get(runs))
        .route("/api/run", get(run))
        .route("/api/generations", get(generations))
        .route("/api/stream", get(stream))
        .route("/api/answers", get(answers))
        .route("/api/clouds", get(clouds))
        .route("/api/cloud", get(cloud))
        .route("/api/explain", get(explain))
        .route("/api/landscape", get(landscape))
        .route("/api/report", get(report))
        .route("/api/control", post(control))
        .route("/api/login", post(login))
        .route("/api/{*path}", any(unknown))
        .fallback(get(page))
        .layer(from_fn_with_state(Arc::clone(&server), check))
        .with_state(server);
    web::serve(router, connections).await;
}

/// Lets in who may come in, and protects every answer.
async fn check(State(server): Shared, mut request: Request, next: Next) -> Response {
    let mut response = match server.access.admit(&request) {
        Err(refusal) => refused(refusal),
        Ok(right) if right < needed(request.uri().path()) => refused(Refusal::Token),
        Ok(right) => {
            request.extensions_mut().insert(Caller(right));
            next.run(request).await
        }
    };
    protect(response.headers_mut());
    response
}

/// What a path asks for.
fn needed(path: &str) -> Right {
    match path {
        "/api/login" => Right::Page,
        "/api/control" => Right::Control,
        path if path.starts_with("/api/") => Right::View,
        _ => Right::Page,
    }
}

fn refused(refusal: Refusal) -> Response {
    let (status, text) = refusal.text();
    (status, [(CONTENT_TYPE, "application/json")], json!({"error": text}).to_string()).into_response()
}

fn failed(error: &DashboardError) -> Response {
    let text = Message::of(error).to_string();
    let text = Names::of_this_process().in_text(&text);
    (error.status(), [(CONTENT_TYPE, "application/json")], json!({"error": text}).to_string()).into_response()
}

/// An answer as JSON, which nobody keeps.
fn answer(text: Option<Result<String, DashboardError>>) -> Response {
    match text {
        Some(Ok(text)) => {
            ([(CONTENT_TYPE, "application/json"), (CACHE_CONTROL, "no-store")], text).into_response()
        }
        Some(Err(error)) => failed(&error),
        None => StatusCode::SERVICE_UNAVAILABLE.into_response(), // shutting down
    }
}

async fn page(request: Request) -> Response {
    match asset(request.uri().path()) {
        Some((_, kind, text)) => {
            let text = Names::of_this_process().in_text(text);
            ([(CONTENT_TYPE, kind), (CACHE_CONTROL, "no-cache")], text).into_response()
        }
        None => StatusCode::NOT_FOUND.into_response(),
    }
}

async fn unknown() -> Response {
    let text = json!({"error": "no such address\nreload the page: the program may be another"}).to_string();
    (StatusCode::NOT_FOUND, [(CONTENT_TYPE, "application/json")], text).into_response()
}

async fn runs(State(server): Shared, request: Request) -> Response {
    let right = right(&request);
    answer(server.blocking(move |server| Ok(server.list(right))).await)
}

async fn run(State(server): Shared, request: Request) -> Response {
    let query = Query::new(request.uri().query());
    let work = move |server: &Server| {
        let shown = server.runs.run(query.text("id")?)?;
        shown.refresh();
        shown.detail()
    };
    answer(server.blocking(work).await)
}

async fn generations(State(server): Shared, request: Request) -> Response {
    let query = Query::new(request.uri().query());
    let work = move |server: &Server| {
        let shown = server.runs.run(query.text("id")?)?;
        shown.refresh();
        Ok(shown.generations())
    };
    answer(server.blocking(work).await)
}

async fn stream(State(server): Shared, request: Request) -> Response {
    match stream::stream(server, &Query::new(request.uri().query()), right(&request)).await {
        Ok(body) => {
            ([(CONTENT_TYPE, "text/event-stream"), (CACHE_CONTROL, "no-store")], body).into_response()
        }
        Err(error) => failed(&error),
    }
}

async fn answers(State(server): Shared, request: Request) -> Response {
    let query = Query::new(request.uri().query());
    let work = move |server: &Server| server.runs.run(query.text("id")?)?.answers(query.text("of")?);
    answer(server.blocking(work).await)
}

async fn clouds(State(server): Shared, request: Request) -> Response {
    let query = Query::new(request.uri().query());
    let work = move |server: &Server| {
        let shown = server.runs.run(query.text("id")?)?;
        shown.refresh();
        shown.clouds()
    };
    answer(server.blocking(work).await)
}

async fn cloud(State(server): Shared, request: Request) -> Response {
    let query = Query::new(request.uri().query());
    let work = move |server: &Server| {
        let shown = server.runs.run(query.text("id")?)?;
        shown.refresh();
        shown.cloud(query.text("path")?, query.number("points")?.unwrap_or(POINTS))
    };
    match server.computing(work).await {
        Some(Ok(bytes)) => {
            ([(CONTENT_TYPE, "application/octet-stream"), (CACHE_CONTROL, "private, max-age=3600")], bytes)
                .into_response()
        }
        Some(Err(error)) => failed(&error),
        None => StatusCode::SERVICE_UNAVAILABLE.into_response(), // shutting down
    }
}

async fn explain(State(server): Shared, request: Request) -> Response {
    let query = Query::new(request.uri().query());
    let work = move |server: &Server| {
        let shown = server.runs.run(query.text("id")?)?;
        shown.refresh();
        let individual = query.number("generation")?.zip(query.number("individual")?);
        let which = match (query.text_if_any("compared"), individual) {
            (Some(name), _) => Which::Compared(name),
            (None, Some((generation, individual))) => Which::Individual(generation, individual),
            (None, None) => Which::Best,
        };
        shown.explain(which, query.text("query")?, query.text("answer")?)
    };
    answer(server.computing(work).await)
}

async fn landscape(State(server): Shared, request: Request) -> Response {
    let query = Query::new(request.uri().query());
    let work = move |server: &Server| {
        let found = server.runs.landscape(query.text("id")?, query.text("a")?, query.text("b")?)?;
        Ok(found.to_string())
    };
    answer(server.blocking(work).await)
}

/// The report of a run, to be kept.
async fn report(State(server): Shared, request: Request) -> Response {
    let query = Query::new(request.uri().query());
    let work = move |server: &Server| {
        let shown = server.runs.run(query.text("id")?)?;
        let name = Path::new(&shown.found().id).file_name().map(|name| name.to_string_lossy().into_owned());
        Ok::<_, DashboardError>((name.unwrap_or_default(), shown.report()?))
    };
    match server.computing(work).await {
        Some(Ok((name, page))) => {
            let plain: String =
                name.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
            let mut headers = HeaderMap::new();
            headers.insert(CONTENT_TYPE, HeaderValue::from_static("text/html; charset=utf-8"));
            if let Ok(value) = HeaderValue::from_str(&format!("attachment; filename=\"{plain}.html\"")) {
                headers.insert(CONTENT_DISPOSITION, value);
            }
            (headers, page).into_response()
        }
        Some(Err(error)) => failed(&error),
        None => StatusCode::SERVICE_UNAVAILABLE.into_response(), // shutting down
    }
}

async fn control(State(server): Shared, request: Request) -> Response {
    let Some(body) = body(request).await else {
        let text = format!("order: at most {MAX_BODY} bytes expected, got more\nshorten the reason");
        let text = json!({"error": text}).to_string();
        return (StatusCode::PAYLOAD_TOO_LARGE, [(CONTENT_TYPE, "application/json")], text).into_response();
    };
    // Not among those that read folders: it waits for another process.
    let work = move || {
        let order = Order::read(&body)?;
        let shown = server.runs.run(&order.id)?;
        order.carry_out(&shown).map(|done| json!({"done": done}).to_string())
    };
    answer(tokio::task::spawn_blocking(work).await.ok())
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Login {
    token: String,
}

async fn login(State(server): Shared, request: Request) -> Response {
    let shown: Option<Login> = body(request).await.and_then(|body| serde_json::from_slice(&body).ok());
    match shown.and_then(|Login { token }| server.access.cookie(&token)) {
        Some(cookie) => (StatusCode::NO_CONTENT, [(SET_COOKIE, cookie)]).into_response(),
        None => refused(Refusal::Token),
    }
}

/// The body of a request; `None` if it is too long or breaks off.
async fn body(request: Request<Body>) -> Option<Bytes> {
    axum::body::to_bytes(request.into_body(), MAX_BODY).await.ok()
}

fn right(request: &Request) -> Right {
    request.extensions().get::<Caller>().map_or(Right::Page, |Caller(right)| *right)
}
