//! `coordinator join-command`: what to paste so that other machines join.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context as _;
use clap::{Args, ValueEnum};
use proto::JoinAddress;
use transport::certs;
use worker::names::Names;

use crate::slurm::{MOST_MINUTES, quoted, quoted_path, worker_line};

/// Print the commands that start workers on other machines
///
/// They copy the program and the join address, in files that only you can read: no token stands in a command, where every
/// user of a machine could see it. Nothing has to be installed there.
///
/// Example: coordinator join-command lab-pc-3 lab-pc-4 --tls tls
#[derive(Debug, Args)]
pub struct JoinCommand {
    /// The other machines, as ssh knows them, for example lab-pc-3
    #[arg(value_name = "HOST")]
    hosts: Vec<String>,
    /// Folder of certificates that the coordinator is started with, for example tls
    #[arg(long, value_name = "DIR", required_unless_present_any = ["coordinator", "join_file"])]
    tls: Option<PathBuf>,
    /// File to which the coordinator writes where it is, if it is started with this option, for example tls/here; for
    /// Slurm, it need not be there yet
    #[arg(long, value_name = "FILE", conflicts_with_all = ["tls", "coordinator"])]
    join_file: Option<PathBuf>,
    /// Address of a coordinator without certificates, inside a trusted network, for example http://192.0.2.7:7700
    #[arg(long, value_name = "URL", conflicts_with = "tls")]
    coordinator: Option<JoinAddress>,
    /// How the machines are reached: by ssh, or by Slurm, whose nodes must have this machine's folders; for example slurm
    #[arg(long, value_name = "WAY", value_enum, default_value = "ssh")]
    over: Way,
    /// Workers that Slurm starts, for example 8
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..))]
    workers: u32,
    /// Processors of each of them, for example 16
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: u32,
    /// Minutes for which Slurm gives them their place, for example 240
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u32).range(2..=MOST_MINUTES))]
    minutes: u32,
    /// The program `worker`, for example target/release/worker; by default the one beside this program
    #[arg(long, value_name = "FILE")]
    worker: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Way {
    Ssh,
    Slurm,
}

/// What the commands are made of; paths are absolute.
struct Parts {
    /// The program.
    worker: PathBuf,
    /// The file with the join address, or the address where it holds no secret.
    join: Join,
}

enum Join {
    File(PathBuf),
    Plain(JoinAddress),
}

impl JoinCommand {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let Self { hosts, tls, join_file, coordinator, over, workers, threads, minutes, worker } = self;
        let worker = match worker {
            Some(worker) => worker,
            None => beside_this_program()?,
        };
        let advice = "build it: cargo build --release -p worker; or name it with --worker";
        let worker = absolute(&worker, advice)?;
        let join = match (join_file, tls, coordinator) {
            (Some(file), ..) => Join::File(match over {
                Way::Ssh => absolute(&file, "start the coordinator first, with --join-file")?,
                // A coordinator that Slurm starts as well makes it later.
                Way::Slurm => std::path::absolute(&file)?,
            }),
            (None, Some(tls), _) => {
                certs::join_address(&tls)?; // says what is wrong with a folder
                let file = tls.join(certs::JOIN_FILE);
                Join::File(absolute(&file, "make it: coordinator certs DIR --host NAME")?)
            }
            (None, None, Some(address)) if address.trust.is_none() => Join::Plain(address),
            (None, None, Some(address)) => anyhow::bail!(
                "--coordinator: must be an address without secrets, got {address}\nname the folder of certificates with --tls"
            ),
            (None, None, None) => {
                anyhow::bail!("--tls: which folder, got none\nname the folder of certificates with --tls")
            }
        };
        let parts = Parts { worker, join };
        let text = match over {
            Way::Ssh if hosts.is_empty() => {
                anyhow::bail!(
                    "HOST: which machines, got none\nname them as ssh knows them, for example lab-pc-3"
                )
            }
            Way::Ssh => hosts.iter().map(|host| parts.over_ssh(host)).collect::<anyhow::Result<String>>()?,
            Way::Slurm if hosts.is_empty() => parts.over_slurm(workers, threads, minutes)?,
            Way::Slurm => {
                anyhow::bail!("HOST: Slurm chooses the machines, got {}\nleave them out", hosts.join(" "))
            }
        };
        super::print(&text)?;
        Ok(ExitCode::SUCCESS)
    }
}

impl Parts {
    /// One line that copies everything to a machine and starts a worker there, whose log comes back.
    fn over_ssh(&self, host: &str) -> anyhow::Result<String> {
        let host = quoted(host)?;
        let (folder, name) = (folder_of(&self.worker)?, name_of(&self.worker)?);
        let platform = format!("{} {}", kernel(), std::env::consts::ARCH);
        let check = format!(
            "[ \"$(uname -sm)\" = \"{platform}\" ] || {{ echo \"this worker is for {platform}, this machine is $(uname -sm)\" >&2; exit 1; }}"
        );
        let (packed, option) = match &self.join {
            Join::File(join) => {
                let (folder, name) = (folder_of(join)?, name_of(join)?);
                (format!(" -C {folder} {name}"), format!("--coordinator-file {name}"))
            }
            Join::Plain(address) => (String::new(), format!("--coordinator {address}")),
        };
        let remote = format!(
            "{check}; umask 077 && mkdir -p descry-worker && cd descry-worker && tar -xf - && exec ./{name} {option}"
        );
        Ok(format!("tar -cf - -C {folder} {name}{packed} | ssh {host} {}\n", quoted(&remote)?))
    }

    /// One line that asks Slurm for workers; each leaves before its time is over, gives its place back when there is nothing
    /// to do, and is queued again when it is preempted.
    fn over_slurm(&self, workers: u32, threads: u32, minutes: u32) -> anyhow::Result<String> {
        let option = match &self.join {
            Join::File(join) => format!("--coordinator-file {}", quoted_path(join)?),
            Join::Plain(address) => format!("--coordinator {address}"),
        };
        let start = worker_line(&self.worker, &option, threads, minutes)?;
        Ok(format!(
            "sbatch --job-name=descry-worker --array=1-{workers} --ntasks=1 --cpus-per-task={threads} --time={minutes} --requeue --open-mode=append --wrap={}\n",
            quoted(&start)?
        ))
    }
}

/// The program `worker` that was built with this one.
pub(super) fn beside_this_program() -> anyhow::Result<PathBuf> {
    let this = std::env::current_exe().context("where this program is cannot be found out")?;
    let name = this.file_name().unwrap_or_default().to_string_lossy();
    let worker = match Names::of_this_process() {
        Names::Built => name.replace(Names::Built.coordinator(), Names::Built.worker()),
        names => names.worker().to_owned(),
    };
    Ok(this.with_file_name(worker))
}

fn absolute(path: &Path, advice: &str) -> anyhow::Result<PathBuf> {
    path.canonicalize()
        .map_err(|error| anyhow::anyhow!("{}: cannot be used, got {error}\n{advice}", path.display()))
}

fn folder_of(path: &Path) -> anyhow::Result<String> {
    Ok(quoted_path(path.parent().unwrap_or(Path::new("/")))?)
}

fn name_of(path: &Path) -> anyhow::Result<String> {
    Ok(quoted_path(Path::new(path.file_name().unwrap_or_default()))?)
}

/// How `uname -s` calls this system.
fn kernel() -> &'static str {
    match std::env::consts::OS {
        "macos" => "Darwin",
        _ => "Linux",
    }
}
