//! Server-sent events: each viewer gets what it does not have yet, as often as there is something.

use std::collections::VecDeque;
use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::body::{Body, Bytes};
use futures_util::stream;
use tokio::time::{Interval, MissedTickBehavior};

use super::error::DashboardError;
use super::feed::Cursor;
use super::query::Query;
use super::run_log::Message;
use super::shown::Shown;
use super::state::Server;
use crate::web::access::Right;

/// How often a viewer is looked after.
const TICK: Duration = Duration::from_secs(1);
/// Ticks after which a viewer that gets nothing gets a comment, so that a connection that has died is noticed.
const QUIET: u32 = 15;

/// One viewer.
struct Viewer {
    server: Arc<Server>,
    right: Right,
    subject: Subject,
    ticks: Interval,
    quiet: u32,
    waiting: VecDeque<Bytes>,
}

enum Subject {
    /// The list of runs, as it was sent last.
    List(String),
    /// A run, and what the viewer has of it.
    Run(Arc<Shown>, Cursor),
}

/// A stream for one viewer: of the run that the query names, or of the list of runs.
///
/// # Errors
/// If there is no such run.
pub async fn stream(server: Arc<Server>, query: &Query, right: Right) -> Result<Body, DashboardError> {
    let subject = match query.text("id") {
        Err(_) => Subject::List(String::new()),
        Ok(id) => {
            let cursor = Cursor::new(
                query.number("generation")?.unwrap_or_default(),
                query.number("event")?.unwrap_or_default(),
            );
            let id = id.to_owned();
            let unknown = DashboardError::UnknownRun { id: id.clone() };
            let found = server.blocking(move |server| server.runs.run(&id)).await;
            Subject::Run(found.unwrap_or(Err(unknown))?, cursor)
        }
    };
    let mut ticks = tokio::time::interval(TICK);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    // The viewer's program comes back after two seconds if the connection ends.
    let waiting = VecDeque::from([Bytes::from_static(b"retry: 2000\n\n")]);
    let viewer = Viewer { server, right, subject, ticks, quiet: 0, waiting };
    let next = |mut viewer: Viewer| async move {
        let bytes = viewer.next().await;
        Some((Ok::<_, Infallible>(bytes), viewer))
    };
    Ok(Body::from_stream(stream::unfold(viewer, next)))
}

impl Viewer {
    /// The next bytes. Nothing is read for a viewer that has not taken the last.
    async fn next(&mut self) -> Bytes {
        loop {
            if let Some(bytes) = self.waiting.pop_front() {
                self.quiet = 0;
                return bytes;
            }
            self.ticks.tick().await;
            for (name, json) in self.look().await {
                self.waiting.push_back(Bytes::from(format!("event: {name}\ndata: {json}\n\n")));
            }
            self.quiet += 1;
            if self.waiting.is_empty() && self.quiet >= QUIET {
                self.quiet = 0;
                return Bytes::from_static(b": nothing new\n\n");
            }
        }
    }

    async fn look(&mut self) -> Vec<Message> {
        match &mut self.subject {
            Subject::List(sent) => {
                let right = self.right;
                let now = self.server.blocking(move |server| server.list(right)).await;
                match now {
                    Some(now) if now != *sent => {
                        *sent = now.clone();
                        vec![("runs", now)]
                    }
                    _ => Vec::new(),
                }
            }
            Subject::Run(shown, cursor) => {
                let (shown, mut moved) = (Arc::clone(shown), cursor.clone());
                let due = shown.is_due();
                let work = move |_: &Server| {
                    if due {
                        shown.refresh();
                    }
                    let messages = shown.since(&mut moved);
                    (messages, moved)
                };
                let Some((messages, moved)) = self.server.blocking(work).await else { return Vec::new() };
                *cursor = moved;
                messages
            }
        }
    }
}
