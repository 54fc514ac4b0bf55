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
    /// Minutes of the allocation of each, for example 240
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u32).range(2..=MOST_MINUTES))]
    minutes: u32,
    /// The program `worker`, for example target/release/worker; by default the one beside this program
    #[arg(long, value_name = "FILE", conflicts_with = "container")]
    worker: Option<PathBuf>,
    /// Start each worker in a container, by the engine that the machine has, podman or docker; for example podman
    #[arg(long, value_name = "ENGINE", value_enum, requires = "image")]
    container: Option<Engine>,
    /// The image of the container, as deploy/image builds it, for example descry.tar
    #[arg(long, value_name = "FILE", requires = "container")]
    image: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Way {
    Ssh,
    Slurm,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Engine {
    Podman,
    Docker,
}

/// What the commands are made of; paths are absolute.
struct Parts {
    program: Program,
    /// The file with the join address, or the address where it holds no secret.
    join: Join,
}

enum Program {
    Worker(PathBuf),
    Image(Engine, PathBuf),
}

enum Join {
    File(PathBuf),
    Plain(JoinAddress),
}

/// Where the files that come over ssh lie there, closed to others.
const UNPACK: &str = "umask 077 && mkdir -p descry-worker && cd descry-worker && tar -xf -";
/// Where a container has the join address.
const JOIN_IN_CONTAINER: &str = "/run/descry/join";

impl JoinCommand {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let Self {
            hosts,
            tls,
            join_file,
            coordinator,
            over,
            workers,
            threads,
            minutes,
            worker,
            container,
            image,
        } = self;
        let program = match (container, image) {
            (Some(engine), Some(image)) => {
                Program::Image(engine, absolute(&image, "build it: deploy/image target/dist descry.tar")?)
            }
            _ => {
                let worker = worker.map_or_else(beside_this_program, Ok)?;
                let advice = "build it: cargo build --release -p worker; or name it with --worker";
                Program::Worker(absolute(&worker, advice)?)
            }
        };
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
        let parts = Parts { program, join };
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
        let (file, start) = match &self.program {
            Program::Worker(worker) => (worker, self.bare(worker)?),
            Program::Image(engine, image) => (image, self.contained(*engine, image)?),
        };
        let packed = match &self.join {
            Join::File(join) => format!(" -C {} {}", folder_of(join)?, name_of(join)?),
            Join::Plain(_) => String::new(),
        };
        let (folder, name) = (folder_of(file)?, name_of(file)?);
        Ok(format!("tar -cf - -C {folder} {name}{packed} | ssh {host} {}\n", quoted(&start)?))
    }

    /// What the other machine does to start the program.
    fn bare(&self, worker: &Path) -> anyhow::Result<String> {
        let platform = format!("{} {}", kernel(), std::env::consts::ARCH);
        let check = format!(
            "[ \"$(uname -sm)\" = \"{platform}\" ] || {{ echo \"this worker is for {platform}, this machine is $(uname -sm)\" >&2; exit 1; }}"
        );
        let option = match &self.join {
            Join::File(join) => format!("--coordinator-file {}", name_of(join)?),
            Join::Plain(address) => format!("--coordinator {address}"),
        };
        let name = name_of(worker)?;
        Ok(format!("{check}; {UNPACK} && exec ./{name} {option}"))
    }

    /// What the other machine does to start the image, whose user must be able to read the file, and nobody else.
    fn contained(&self, engine: Engine, image: &Path) -> anyhow::Result<String> {
        // Podman gives the file to the image's user, also where it runs without root; Docker cannot, so that there the
        // user of the container is the one who owns the file.
        let (engine, cache, user, shared) = match engine {
            Engine::Podman => ("podman", "descry-cache", "", ",U"),
            Engine::Docker => ("docker", "\"$PWD\"/cache", " --user \"$(id -u):$(id -g)\"", ""),
        };
        let (volume, option) = match &self.join {
            Join::File(join) => {
                let name = name_of(join)?;
                if name.contains(':') {
                    anyhow::bail!(
                        "--join-file: a file for a container must have no colon in its name, got {name}\nrename it"
                    );
                }
                let volume = format!(" --volume \"$PWD\"/{name}:{JOIN_IN_CONTAINER}:ro,z{shared}");
                (volume, format!("--coordinator-file {JOIN_IN_CONTAINER}"))
            }
            Join::Plain(address) => (String::new(), format!("--coordinator {address}")),
        };
        let name = name_of(image)?;
        Ok(format!(
            "{UNPACK} && mkdir -p cache && loaded=$({engine} load --quiet --input {name}) && exec {engine} run --rm \
             --read-only --cap-drop=ALL --security-opt=no-new-privileges{user}{volume} --volume {cache}:/cache:z \
             \"${{loaded##* }}\" worker {option} --name \"$(uname -n)\""
        ))
    }

    /// One line that asks Slurm for workers; each leaves before its time is over, gives its allocation back when there is
    /// nothing to do, and is queued again when it is preempted.
    fn over_slurm(&self, workers: u32, threads: u32, minutes: u32) -> anyhow::Result<String> {
        let option = match &self.join {
            Join::File(join) => format!("--coordinator-file {}", quoted_path(join)?),
            Join::Plain(address) => format!("--coordinator {address}"),
        };
        let Program::Worker(worker) = &self.program else {
            anyhow::bail!(
                "--container: Slurm starts the program, got an image\nleave --container and --image out"
            );
        };
        let start = worker_line(worker, &option, threads, minutes)?;
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
