//! Why Slurm is not asked for workers.

use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;

/// Why Slurm is not asked for workers.
#[derive(Debug, thiserror::Error)]
pub enum SlurmError {
    /// A command of Slurm.
    #[error(
        "{command}: cannot be started, got {source}\nrun the coordinator where the commands of Slurm are in PATH"
    )]
    NoCommand {
        /// Its name.
        command: &'static str,
        /// Why.
        source: io::Error,
    },
    /// Slurm would not take such jobs.
    #[error(
        "--slurm-workers: Slurm refuses such jobs, got {reason}\ncorrect --slurm-args, --slurm-threads and --slurm-minutes, or try {script} with sbatch --test-only"
    )]
    Refused {
        /// In Slurm's words.
        reason: String,
        /// What it was asked to run.
        script: PathBuf,
    },
    /// The coordinator listens where only this machine reaches it.
    #[error(
        "--slurm-workers: needs an address that other machines reach, got {0}\nadd --listen 0.0.0.0:0 and --tls DIR"
    )]
    Loopback(SocketAddr),
    /// Nothing could ask Slurm while the run goes on.
    #[error(
        "--slurm-workers: needs a thread that asks for them, got {0}\nend other programs, or raise the limit of threads"
    )]
    Thread(io::Error),
    /// The folder of scripts and logs.
    #[error("{path}: cannot be used, got {source}\ncheck permissions and free space")]
    File {
        /// Which file or folder.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A path for a shell.
    #[error("{0}: must be a path in UTF-8\nrename it")]
    NoText(PathBuf),
    /// A word for a shell.
    #[error("{0:?}: cannot stand in a command\nrename it")]
    NoWord(String),
}
