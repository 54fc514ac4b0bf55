//! Metrics for Prometheus and probes for orchestrators, of the runs of this process as long as it lasts.
//!
//! A `MetricsSource` knows what is at work; `families.rs` lists what there is to tell, `collector.rs` tells it at each scrape,
//! `server.rs` answers requests.

mod collector;
mod families;
mod server;
mod source;

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::sync::Arc;

use transport::{Protection, WebError, WebListener};

use crate::web::access::Access;
pub use families::reference;
pub use source::{MetricsSource, RunMetrics, SessionGuard};

/// Where metrics are served unless the command line says otherwise.
const DEFAULT_ADDRESS: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 7790);

/// A port for metrics that is bound.
pub struct MetricsServer {
    listener: WebListener,
    source: Arc<MetricsSource>,
}

impl MetricsServer {
    /// Without an address at the default one, or, if another program has that, at any free port.
    ///
    /// # Errors
    /// If nobody can connect.
    pub async fn bind(
        address: Option<SocketAddr>,
        protection: &Protection,
        source: Arc<MetricsSource>,
    ) -> Result<Self, WebError> {
        let listener = WebListener::bind_near("metrics", (address, DEFAULT_ADDRESS), protection).await?;
        Ok(Self { listener, source })
    }

    /// What there is to say to people: where it is and what has to be shown. Without secrets.
    pub fn notices(&self) -> Vec<String> {
        let mut notice = format!("metrics: {}metrics", self.listener.url());
        if let Some(tokens) = &self.listener.tokens {
            notice += &format!(", for whoever shows the token in {}/dashboard-view", tokens.folder.display());
        } else if !self.listener.address.ip().is_loopback() {
            let warning = "warning: --insecure: whoever reaches this port can see the metrics";
            return vec![notice, warning.to_owned()];
        }
        vec![notice]
    }

    /// Answers requests as long as it is polled.
    pub async fn serve(self) {
        let access = Access::new(self.listener.address, self.listener.tokens.clone());
        crate::web::serve(server::router(self.source, access), self.listener.accept()).await;
    }
}
