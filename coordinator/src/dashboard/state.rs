//! What requests are answered from, and how many of them at a time.

use std::sync::Arc;

use serde_json::json;
use tokio::sync::Semaphore;

use super::run_index::RunIndex;
use crate::web::access::{Access, Right};

/// Requests that read tables at a time, …
const READING: usize = 2;
/// … and those that describe clouds; others wait.
const COMPUTING: usize = 2;
/// What requests are answered from.
pub struct Server {
    /// The runs.
    pub runs: RunIndex,
    /// Who may come in.
    pub access: Access,
    reading: Arc<Semaphore>,
    computing: Arc<Semaphore>,
}

impl Server {
    /// Of these runs, for whom `access` lets in.
    pub fn new(runs: RunIndex, access: Access) -> Self {
        let [reading, computing] = [READING, COMPUTING].map(|permits| Arc::new(Semaphore::new(permits)));
        Self { runs, access, reading, computing }
    }

    /// Reads on another thread, some at a time.
    pub async fn blocking<T: Send + 'static>(
        self: &Arc<Self>,
        work: impl FnOnce(&Self) -> T + Send + 'static,
    ) -> Option<T> {
        self.elsewhere(&self.reading, work).await
    }

    /// Does what takes longer, so that nobody waits for it who reads.
    pub async fn computing<T: Send + 'static>(
        self: &Arc<Self>,
        work: impl FnOnce(&Self) -> T + Send + 'static,
    ) -> Option<T> {
        self.elsewhere(&self.computing, work).await
    }

    async fn elsewhere<T: Send + 'static>(
        self: &Arc<Self>,
        permits: &Arc<Semaphore>,
        work: impl FnOnce(&Self) -> T + Send + 'static,
    ) -> Option<T> {
        let permit = Arc::clone(permits).acquire_owned().await.ok()?;
        let server = Arc::clone(self);
        let working = tokio::task::spawn_blocking(move || {
            let _permit = permit; // the work goes on where the viewer has gone
            work(&server)
        });
        working.await.ok()
    }

    /// The runs in short, as JSON, for who may do this. Blocks.
    pub fn list(&self, right: Right) -> String {
        let runs = self.runs.list();
        let (root, build, may_control) = (self.runs.roots(), json!(worker::BUILD), right == Right::Control);
        format!("{{\"root\":{root},\"build\":{build},\"may_control\":{may_control},\"runs\":{runs}}}")
    }
}
