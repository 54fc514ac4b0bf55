//! `coordinator certs`: what lets workers in over encrypted connections.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use proto::DEFAULT_PORT;

use transport::certs::{self, CertsError, Site};

use crate::console::say;

/// Make certificates and a token for encrypted connections; print the join address
///
/// Standard output gets the join address alone: it contains the token, so keep it as you keep a password.
///
/// Example: coordinator certs tls --host gpu-host --worker lab-pc-3
#[derive(Debug, Args)]
pub struct Certs {
    /// Folder of the certificates, for example tls; made if it is not there, and never overwritten
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Name or IP address under which workers reach this machine, for example 192.0.2.7; repeatable, the first is in
    /// the join address; by default this machine's name. 127.0.0.1 and ::1 always work
    #[arg(long = "host", value_name = "NAME_OR_IP")]
    hosts: Vec<String>,
    /// Port of the join address, for example 7701
    #[arg(long, value_name = "PORT", default_value_t = DEFAULT_PORT)]
    port: u16,
    /// Name of a worker that gets a certificate of its own, for example lab-pc-3; repeatable
    #[arg(long = "worker", value_name = "NAME")]
    workers: Vec<String>,
    /// Days for which certificates made now are valid, for example 365
    #[arg(long, value_name = "N", default_value_t = 3650, value_parser = clap::value_parser!(u32).range(1..=36500))]
    days: u32,
}

impl Certs {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let Self { folder, hosts, port, workers, days } = self;
        let valid = certs::validity(days);
        if !certs::is_made(&folder) {
            certs::make_folder(&folder, &Site { hosts, port }, &valid)?;
            say(format_args!("made {}: start the coordinator with --tls {0}", folder.display()));
            say(format_args!("a worker needs {}/join: worker --coordinator-file join", folder.display()));
        } else if let Some(host) = hosts.into_iter().next() {
            return Err(CertsError::HostsAreSet(host).into());
        }
        for name in workers {
            let place = certs::add_worker(&folder, &name, &valid)?;
            say(format_args!("made {}: copy it to {name}, and there: worker --tls {name}", place.display()));
        }
        super::print(&format!("{}\n", certs::join_address(&folder)?.reveal()))?;
        Ok(ExitCode::SUCCESS)
    }
}
