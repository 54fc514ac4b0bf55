//! The other end of a connection: whether any of its requests was let in, and when it came last.

use std::future::pending;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use transport::ConnectionPermit;

use crate::lock::lock;

/// The other end of a connection; each request has it among its extensions.
pub struct Peer {
    permit: ConnectionPermit,
    last_request: Mutex<Instant>,
}

impl Peer {
    /// Of a connection that begins now.
    pub fn new(permit: ConnectionPermit) -> Self {
        Self { permit, last_request: Mutex::new(Instant::now()) }
    }

    /// A request has come.
    pub fn note_request(&self) {
        *lock(&self.last_request) = Instant::now();
    }

    /// A request was let in: the connection stays as long as the peer likes.
    pub fn let_in(&self) {
        self.permit.establish();
    }

    /// Ready when no request has come for `patience`, and none was ever let in.
    pub async fn until_idle(&self, patience: Duration) {
        loop {
            if self.permit.is_established() {
                pending::<()>().await;
            }
            let last_request = *lock(&self.last_request);
            if last_request.elapsed() >= patience {
                return;
            }
            tokio::time::sleep_until((last_request + patience).into()).await;
        }
    }
}
