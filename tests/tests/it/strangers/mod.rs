//! Encrypted connections: who is let in, who is not, and what those can do who are not.

mod attacks;
mod crowd;
mod http2;
mod refusals;
mod revoked;
mod secrets;

use std::fs;
use std::path::PathBuf;

use serde_json::Value;

use crate::experiments::{Experiment, digest};
use crate::process::{Running, run};

/// Long enough to do something to it while it runs.
const SEARCH: &str = "[ga]\npopulation = 8\n[stop]\ngenerations = 100\nstagnation = \"off\"\n\
    validation_patience = \"off\"\n[coordinator]\nlease_seconds = 60\n";

/// An experiment beside a folder of certificates for it.
pub struct Site {
    pub experiment: Experiment,
}

impl Site {
    /// Certificates for this machine and for these workers.
    fn new(workers: &[&str]) -> Self {
        Self::of_host("127.0.0.1", workers)
    }

    /// Certificates for a host of this name.
    fn of_host(host: &str, workers: &[&str]) -> Self {
        Self::with(Experiment::new(SEARCH), host, workers)
    }

    /// Certificates for an experiment's coordinator on this host and for these workers.
    pub fn with(experiment: Experiment, host: &str, workers: &[&str]) -> Self {
        let site = Self { experiment };
        let tls = site.experiment.path("tls");
        let mut args = vec!["certs", &tls, "--host", host];
        for worker in workers {
            args.extend(["--worker", worker]);
        }
        run("coordinator", args).expect_success();
        site
    }

    /// A coordinator with TLS that waits for workers, and its port.
    fn coordinator(&self, ip: &str) -> (Running, u16) {
        let args = self.experiment.run_args("out", &["--local-workers", "0"]);
        self.start("coordinator", ip, args)
    }

    /// Starts a command that waits for workers with TLS, and its port.
    pub fn start(&self, name: &str, ip: &str, mut args: Vec<String>) -> (Running, u16) {
        let (tls, listen) = (self.experiment.path("tls"), format!("{ip}:0"));
        args.retain(|arg| arg != "--listen" && arg != "127.0.0.1:0");
        args.extend(["--tls", &tls, "--listen", &listen].map(str::to_owned));
        let mut coordinator = Running::start(self.experiment.folder(), name, "coordinator", args);
        let line = coordinator.wait_for("this port is ");
        let port = line.split("this port is ").nth(1).unwrap().split(':').next().unwrap().parse().unwrap();
        (coordinator, port)
    }

    /// The join address, with this port.
    pub fn address(&self, port: u16) -> String {
        let address = fs::read_to_string(self.experiment.path("tls/join")).unwrap();
        address.trim().replace(":7700", &format!(":{port}"))
    }

    /// Starts a worker with a certificate of its own.
    pub fn certified(&self, name: &str, port: u16) -> Running {
        let folder = self.worker_folder(name, port);
        let args = ["--tls", &folder, "--name", name, "--threads", "1", "--no-cache"];
        Running::start(self.experiment.folder(), name, "worker", args)
    }

    /// A worker's folder, whose join address has this port.
    pub fn worker_folder(&self, name: &str, port: u16) -> String {
        let folder = self.experiment.path(&format!("tls/workers/{name}"));
        let join = PathBuf::from(&folder).join("join");
        let address = fs::read_to_string(&join).unwrap();
        let (host, rest) = address.rsplit_once(':').unwrap(); // a port of an earlier start, perhaps
        let rest = rest.trim_start_matches(|digit: char| digit.is_ascii_digit());
        fs::write(join, format!("{host}:{port}{rest}")).unwrap();
        folder
    }

    /// The digest of this search when nobody disturbs it.
    fn undisturbed(&self) -> Value {
        digest(&self.experiment.run("undisturbed", &[]).expect_success())
    }
}
