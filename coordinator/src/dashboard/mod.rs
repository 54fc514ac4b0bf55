//! The dashboard: a page that shows runs, read from their folders, so that it outlives the coordinator and can neither
//! change nor slow what it shows.
//!
//! `folders.rs` finds runs; `shown.rs` is one of them: `feed.rs` reads its tables as they grow, `run_log.rs` its log,
//! `overview.rs` and `detail.rs` sum it up. `server.rs` answers requests that `web/access.rs` lets in, `stream.rs` sends what
//! is new, `control.rs` passes orders on, `assets.rs` has the page.

mod assets;
mod control;
mod detail;
mod error;
mod feed;
mod folders;
mod overview;
mod query;
mod run_index;
mod run_log;
mod server;
mod shown;
mod state;
mod stream;

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;

use transport::{Protection, WebError, WebListener};

use crate::web::access::Access;
use run_index::RunIndex;
use state::Server;

/// Where a dashboard is served unless the command line says otherwise.
pub const DEFAULT_ADDRESS: SocketAddr =
    SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::LOCALHOST), 7780);

/// A dashboard whose port is bound.
pub struct Dashboard {
    listener: WebListener,
    roots: Vec<PathBuf>,
}

impl Dashboard {
    /// Of the runs in some folders.
    ///
    /// # Errors
    /// If nobody can connect.
    pub async fn bind(
        roots: Vec<PathBuf>,
        address: SocketAddr,
        protection: &Protection,
    ) -> Result<Self, WebError> {
        Ok(Self { listener: WebListener::bind("dashboard", address, protection).await?, roots })
    }

    /// Of one run or sweep, whose folder need not be there yet. Without an address at the default one, or, if another
    /// program has that, at any free port.
    ///
    /// # Errors
    /// If nobody can connect.
    pub async fn of_run(
        folder: PathBuf,
        address: Option<SocketAddr>,
        protection: &Protection,
    ) -> Result<Self, WebError> {
        let listener = WebListener::bind_near("dashboard", (address, DEFAULT_ADDRESS), protection).await?;
        Ok(Self { listener, roots: vec![folder] })
    }

    /// What there is to say to people: where it is and what has to be shown. Without secrets.
    pub fn notices(&self) -> Vec<String> {
        let (url, tokens) = (self.listener.url(), &self.listener.tokens);
        let Some(tokens) = tokens else {
            let mut notices = vec![format!("dashboard: {url}")];
            if !self.listener.address.ip().is_loopback() {
                notices.push(
                    "warning: --insecure: whoever reaches this port can see the runs and their clouds"
                        .to_owned(),
                );
            }
            return notices;
        };
        let folder = tokens.folder.display();
        vec![format!(
            "dashboard: {url}, which asks for a token: {folder}/dashboard-view to look, \
             {folder}/dashboard-control to act, too"
        )]
    }

    /// Answers requests as long as it is polled.
    pub async fn serve(self) {
        let access = Access::new(self.listener.address, self.listener.tokens.clone());
        let server = Server::new(RunIndex::new(self.roots), access);
        server::serve(Arc::new(server), self.listener.accept()).await;
    }
}
