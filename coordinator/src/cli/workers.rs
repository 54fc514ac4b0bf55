//! Who works for a command and where they connect, for all commands that have something computed.

use std::net::SocketAddr;
use std::path::PathBuf;

use anyhow::Context as _;
use cache::{Storage, StorageArgs};
use clap::Args;
use transport::{Port, Protection};

use super::join_command::beside_this_program;
use crate::experiment::{LocalWorkers, Overrides};
use crate::shared_bucket::Bucket;
use crate::slurm::{MOST_MINUTES, SlurmWorkers};

/// Workers, where they connect and what those of this process may take.
#[derive(Debug, Args)]
pub struct Workers {
    /// Where workers are awaited, for example 0.0.0.0:7700 (other machines) or 127.0.0.1:0 (any free port); by
    /// default 127.0.0.1:7700
    #[arg(long, value_name = "ADDR")]
    listen: Option<SocketAddr>,
    /// Write the join address, with this machine's name and the port, to this file, which only you can read: workers
    /// that are started with --coordinator-file find a coordinator that a batch system starts anywhere, for example
    /// tls/here
    #[arg(long, value_name = "FILE")]
    join_file: Option<PathBuf>,
    /// Workers inside this process: auto (one on all cores), a number that shares the cores, or 0 to wait for
    /// `worker`s, for example 0
    #[arg(long, value_name = "auto|N")]
    local_workers: Option<LocalWorkers>,
    #[command(flatten)]
    slurm: SlurmArgs,
    #[command(flatten)]
    pub(super) protection: Protection,
    #[command(flatten)]
    storage: StorageArgs,
}

/// Workers that Slurm is asked for.
#[derive(Debug, Args)]
struct SlurmArgs {
    /// Ask Slurm for up to so many workers, as long as there is work for them, for example 8. Script and logs are in the
    /// run's folder, in slurm/; workers find the coordinator by --join-file
    #[arg(long, value_name = "N", requires = "join_file", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    slurm_workers: Option<u32>,
    /// Processors of each of them, for example 16
    #[arg(long, value_name = "N", requires = "slurm_workers", default_value_t = 8)]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=1024))]
    slurm_threads: u32,
    /// Minutes of the allocation of each, for example 240
    #[arg(long, value_name = "N", requires = "slurm_workers", default_value_t = 60)]
    #[arg(value_parser = clap::value_parser!(u32).range(2..=MOST_MINUTES))]
    slurm_minutes: u32,
    /// More arguments of sbatch, for example '--partition=cpu --account=vision'
    #[arg(
        long,
        value_name = "TEXT",
        requires = "slurm_workers",
        default_value = "",
        hide_default_value = true
    )]
    #[arg(allow_hyphen_values = true)]
    slurm_args: String,
}

impl Workers {
    /// Workers that Slurm is asked for, if any.
    pub(super) fn slurm(&self) -> anyhow::Result<Option<SlurmWorkers>> {
        let SlurmArgs { slurm_workers, slurm_threads: threads, slurm_minutes: minutes, slurm_args } =
            &self.slurm;
        let (Some(most), Some(join_file)) = (*slurm_workers, &self.join_file) else { return Ok(None) };
        let arguments = shlex::split(slurm_args).with_context(|| {
            format!("--slurm-args: must be words of a shell, got {slurm_args}\nclose its quotation marks")
        })?;
        let worker = beside_this_program()?;
        let join_file = join_file.clone();
        Ok(Some(SlurmWorkers { most, threads: *threads, minutes: *minutes, arguments, worker, join_file }))
    }

    /// What the command may use of the disk and of memory, and what it shares with other machines.
    pub(super) fn storage(&self) -> anyhow::Result<Storage> {
        let storage = self.storage.resolve();
        // A bucket that cannot be used is found out before a folder is made for a run.
        storage.bucket.as_ref().map(Bucket::open).transpose()?;
        Ok(storage)
    }

    /// How workers of other machines reach the command.
    pub(super) fn port(&self) -> Port {
        Port::new(self.protection.clone(), self.join_file.clone())
    }

    /// What replaces settings of the experiment.
    pub(super) fn overrides(&self, seed: Option<u64>) -> Overrides {
        Overrides { seed, listen: self.listen, local_workers: self.local_workers }
    }
}
