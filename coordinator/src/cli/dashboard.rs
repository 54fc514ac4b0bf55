//! `coordinator dashboard`: runs in a browser.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use transport::Protection;

use crate::console::say;
use crate::dashboard::{DEFAULT_ADDRESS, Dashboard as Server};

/// Show runs in a browser, finished, running and dead ones alike: their progress, their descriptors, and the clouds that
/// they get wrong, in 3D
///
/// Reads run folders and needs no coordinator at work. At a loopback address, the default, no browser needs a token,
/// even with --tls. Any other address needs --tls, and then every browser a token, or --insecure, and then none does.
///
/// Example: coordinator dashboard results
#[derive(Debug, Args)]
pub struct Dashboard {
    /// Folders of runs, sweeps and grids, or folders that have some below them, for example results/runs; by default
    /// results
    #[arg(value_name = "DIR")]
    folders: Vec<PathBuf>,
    /// Where it is served, for example 0.0.0.0:7780 (other machines) or 127.0.0.1:0 (any free port)
    #[arg(long, value_name = "ADDR", default_value_t = DEFAULT_ADDRESS)]
    listen: SocketAddr,
    /// Folder of certificates, as `coordinator certs` makes it, for example tls: at an address that is not loopback,
    /// connections are encrypted, and browsers need the token in its file dashboard-view or dashboard-control
    #[arg(long, value_name = "DIR")]
    tls: Option<PathBuf>,
    /// Accept unencrypted connections from other machines, without a token, for example inside a trusted network
    #[arg(long, conflicts_with = "tls")]
    insecure: bool,
}

impl Dashboard {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let folders = match self.folders {
            none if none.is_empty() => vec![PathBuf::from("results")],
            some => some,
        };
        if let Some(missing) = folders.iter().find(|folder| !folder.is_dir()) {
            anyhow::bail!(
                "{}: a folder of runs expected, got none\nname one, or start a run: coordinator run EXP.toml",
                missing.display()
            );
        }
        let protection = Protection { tls: self.tls, insecure: self.insecure };
        let runtime = super::runtime()?;
        runtime.block_on(async {
            let served = async {
                let dashboard = Server::bind(folders, self.listen, &protection).await?;
                for notice in dashboard.notices() {
                    say(&notice);
                }
                dashboard.serve().await;
                anyhow::Ok(())
            };
            tokio::select! {
                biased; // once the address is told, an interruption is awaited
                // This is how a server ends, and nothing is lost by it.
                interruption = super::interruption() => interruption.map(|_| ()).map_err(Into::into),
                served = served => served,
            }
        })?;
        runtime.shutdown_background(); // what a viewer has asked for is abandoned
        Ok(ExitCode::SUCCESS)
    }
}
