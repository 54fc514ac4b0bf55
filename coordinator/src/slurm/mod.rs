//! Workers as jobs of Slurm, asked for as long as there is work for them.

mod command;
mod error;
mod scaler;
mod worker_line;

use std::ffi::OsString;
use std::fs;
use std::io;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use cluster::Cluster;
use tokio::process::Command;
use tokio::sync::oneshot;

use crate::console::Console;
use crate::lock::lock;
use command::{PATIENCE, output, runtime, wait};
pub use error::SlurmError;
use scaler::{Decision, Scaler, SlurmJob};
use worker_line::IDLE_SECONDS;
pub use worker_line::{MOST_MINUTES, quoted, quoted_path, worker_line};

/// How often Slurm is asked what has become of its jobs.
const INTERVAL: Duration = Duration::from_secs(15);
/// How long the end of a run, or of this process, waits until those that wait for an allocation are cancelled.
const CANCEL_PATIENCE: Duration = Duration::from_secs(10);
/// In a run folder: the script of the workers and their logs.
const FOLDER: &str = "slurm";
/// The script of the workers.
const SCRIPT: &str = "worker.sh";
/// What a job needs to know of the cluster, of all that Slurm tells a coordinator that is a job itself.
const OF_THE_CLUSTER: [&str; 3] = ["SLURM_CONF", "SLURM_CLUSTERS", "SLURM_JWT"];

/// The name of the jobs of the run that asks for workers now.
static ASKING: Mutex<Option<String>> = Mutex::new(None);

/// Which workers Slurm is asked for.
#[derive(Clone, Debug)]
pub struct SlurmWorkers {
    /// At most so many at a time.
    pub most: u32,
    /// Threads and processors of each.
    pub threads: u32,
    /// How long each may keep its allocation, minutes.
    pub minutes: u32,
    /// More arguments of `sbatch`.
    pub arguments: Vec<String>,
    /// The program.
    pub worker: PathBuf,
    /// The file from which workers learn where the coordinator is.
    pub join_file: PathBuf,
}

/// Cancels workers that still wait for an allocation, as this process is about to end and nobody goes on with its run by itself;
/// returns what becomes of the others, if there may be any.
pub fn interrupted() -> Option<String> {
    let name = lock(&ASKING).take()?;
    let _ = wait(async {
        cancel_waiting(&name).await;
        Ok(())
    }); // without a thread nobody can be told either
    let minutes = IDLE_SECONDS / 60;
    Some(format!(
        "Slurm: workers end when they have had no job for {minutes} min; at once by scancel --name={name}"
    ))
}

/// Asks Slurm for workers, from a thread of its own, until this is dropped; then those that still wait for an allocation are
/// cancelled. Those at work end by themselves.
pub struct Scaling {
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Scaling {
    /// Begins, after Slurm has said that it would take such jobs. `out` is the folder of the run, `listen` where its
    /// coordinator listens.
    ///
    /// # Errors
    /// If it would not, if its commands are not there, if the script cannot be written, or if no other machine reaches the
    /// coordinator.
    pub fn start(
        workers: &SlurmWorkers,
        (out, listen): (&Path, SocketAddr),
        cluster: &Arc<Cluster>,
        console: &Console,
    ) -> Result<Self, SlurmError> {
        if listen.ip().is_loopback() {
            return Err(SlurmError::Loopback(listen));
        }
        let queue = Queue::open(workers, out)?;
        queue.try_out()?;
        let runtime = runtime().map_err(SlurmError::Thread)?;
        let name = queue.name.clone();
        *lock(&ASKING) = Some(name.clone());
        let (stop, stopped) = oneshot::channel::<()>();
        let (cluster, console) = (Arc::clone(cluster), console.clone());
        let scaler = Scaler::new(workers.most, workers.threads);
        let supervised = async move {
            let mut supervisor = Supervisor { queue, scaler, console, complained: None };
            loop {
                let now = cluster.metrics();
                // Before somebody works there are no jobs: nobody knows yet how many workers there is work for, and the
                // wait for an allocation may be long.
                supervisor.look(if now.counters.joined == 0 { u64::MAX } else { now.wanted_threads }).await;
                tokio::time::sleep(INTERVAL).await;
            }
        };
        let work = async move {
            // A command that hangs is killed when the run ends.
            tokio::select! {
                _ = stopped => {}
                () = supervised => {}
            }
            cancel_waiting(&name).await;
        };
        Ok(Self { stop: Some(stop), thread: Some(std::thread::spawn(move || runtime.block_on(work))) })
    }
}

impl Drop for Scaling {
    fn drop(&mut self) {
        self.stop = None;
        *lock(&ASKING) = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join(); // its panic has been reported
        }
    }
}

/// Looks at the queue from time to time and asks for what is missing.
struct Supervisor {
    queue: Queue,
    scaler: Scaler,
    console: Console,
    /// What people were told of Slurm's silence; once is enough.
    complained: Option<String>,
}

impl Supervisor {
    async fn look(&mut self, wanted: u64) {
        let jobs = match self.queue.jobs().await {
            Ok(jobs) => jobs,
            // Nobody knows how many workers there are: the run goes on with them, and no other is asked for.
            Err(reason) => {
                if self.complained.as_ref() != Some(&reason) {
                    self.console.say(&format!("Slurm: {reason}, trying again"));
                    self.complained = Some(reason);
                }
                return;
            }
        };
        self.complained = None;
        let mut decision = self.scaler.decide(wanted, &jobs, Instant::now());
        if let Decision::Ask(count) = decision {
            match self.queue.submit(count).await {
                Ok(number) => self.console.say(&asked(count, &number, &self.queue.folder)),
                Err(reason) => {
                    self.console.say(&format!("Slurm: no worker, got {reason}"));
                    decision = self.scaler.refused(Instant::now());
                }
            }
        }
        if let Decision::Pause(pause) = decision {
            self.console.say(&format!(
                "Slurm: asked for no more workers for {} min, because the last have failed: look at {}, and at the logs beside it",
                pause.as_secs() / 60,
                self.queue.folder.join(SCRIPT).display()
            ));
        }
    }
}

/// The jobs of one run in Slurm, all of one name.
struct Queue {
    /// Absolute.
    folder: PathBuf,
    name: String,
    threads: u32,
    minutes: u32,
    arguments: Vec<String>,
}

impl Queue {
    /// Writes the script. The name follows from the folder: a coordinator that is started again finds its workers.
    fn open(workers: &SlurmWorkers, out: &Path) -> Result<Self, SlurmError> {
        let SlurmWorkers { threads, minutes, .. } = *workers;
        let folder = out.join(FOLDER);
        let failed = |source| SlurmError::File { path: folder.clone(), source };
        fs::create_dir_all(&folder).map_err(failed)?;
        let absolute = folder.canonicalize().map_err(failed)?;
        let join_file = std::path::absolute(&workers.join_file).map_err(failed)?;
        let coordinator = format!("--coordinator-file {}", quoted_path(&join_file)?);
        let line = worker_line(&workers.worker, &coordinator, threads, minutes)?;
        let script =
            format!("#!/bin/sh\n#SBATCH --ntasks=1\n#SBATCH --requeue\n#SBATCH --open-mode=append\n{line}\n");
        atomic::write(&folder.join(SCRIPT), script.as_bytes()).map_err(failed)?;
        let digest = blake3::hash(absolute.as_os_str().as_encoded_bytes()).to_hex();
        let name = format!("descry-{}", &digest[..8]);
        Ok(Self { folder: absolute, name, threads, minutes, arguments: workers.arguments.clone() })
    }

    /// Has Slurm say whether it would take a worker.
    fn try_out(&self) -> Result<(), SlurmError> {
        let refused = |reason| SlurmError::Refused { reason, script: self.folder.join(SCRIPT) };
        let mut sbatch = self.sbatch(1);
        match wait(output(sbatch.arg("--test-only").arg(self.folder.join(SCRIPT)), PATIENCE)) {
            Ok(done) => said(&done).map(drop).map_err(refused),
            Err(error) if error.kind() == io::ErrorKind::TimedOut => Err(refused(format!("sbatch: {error}"))),
            Err(source) => Err(SlurmError::NoCommand { command: "sbatch", source }),
        }
    }

    fn sbatch(&self, count: u32) -> Command {
        let mut sbatch = Command::new("sbatch");
        for variable in own_job(std::env::vars_os().map(|(name, _)| name)) {
            sbatch.env_remove(variable);
        }
        sbatch.args(["--parsable", "--output=%A_%a.log"]).arg(format!("--job-name={}", self.name));
        sbatch.arg(format!("--chdir={}", self.folder.display())).arg(format!("--array=1-{count}"));
        sbatch.arg(format!("--cpus-per-task={}", self.threads)).arg(format!("--time={}", self.minutes));
        sbatch.args(&self.arguments);
        sbatch
    }

    /// Asks for workers; the number of their job.
    async fn submit(&self, count: u32) -> Result<String, String> {
        let done = output(self.sbatch(count).arg(self.folder.join(SCRIPT)), PATIENCE).await;
        Ok(said(&done.map_err(|error| format!("sbatch: {error}"))?)?.trim().to_owned())
    }

    /// All jobs of the run, those among them that have ended a short time ago.
    async fn jobs(&self) -> Result<Vec<SlurmJob>, String> {
        let mut squeue = Command::new("squeue");
        squeue.args(["--noheader", "--array", "--states=all", "--format=%i %T", "--me"]);
        let done = output(squeue.arg(format!("--name={}", self.name)), PATIENCE).await;
        let text = said(&done.map_err(|error| format!("squeue: {error}"))?)?;
        Ok(text.lines().filter_map(SlurmJob::parse).collect())
    }
}

/// Cancels jobs without an allocation: they would find nobody.
async fn cancel_waiting(name: &str) {
    let mut scancel = Command::new("scancel");
    scancel.args([&format!("--name={name}"), "--state=PENDING"]);
    let done = output(&mut scancel, CANCEL_PATIENCE).await;
    if let Err(reason) = done.map_err(|error| error.to_string()).and_then(|done| said(&done)) {
        tracing::warn!("Slurm: workers that wait for an allocation may be left, got {reason}");
    }
}

/// Of these variables, those that Slurm has set for the job that the coordinator may be itself: handed on, its processors and
/// memory would bind the workers, which have others.
fn own_job(variables: impl Iterator<Item = OsString>) -> impl Iterator<Item = OsString> {
    let is_own = |name: &OsString| {
        let name = name.to_string_lossy();
        name.starts_with("SLURM_") && !OF_THE_CLUSTER.contains(&&*name)
    };
    variables.filter(is_own)
}

/// What people are told of workers that were asked for.
fn asked(count: u32, number: &str, folder: &Path) -> String {
    let workers = if count == 1 { "worker" } else { "workers" };
    format!("Slurm: asked for {count} more {workers}, job {number}; logs in {}", folder.display())
}

/// What a command has printed, or what it complained about.
fn said(done: &Output) -> Result<String, String> {
    if done.status.success() {
        return Ok(String::from_utf8_lossy(&done.stdout).into_owned());
    }
    let complaint = String::from_utf8_lossy(&done.stderr);
    let lines: Vec<&str> = complaint.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    Err(if lines.is_empty() { done.status.to_string() } else { lines.join("; ") })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn workers_get_nothing_of_the_job_that_asks_for_them() {
        let variables =
            ["PATH", "SLURM_CPU_BIND", "SBATCH_PARTITION", "SLURM_CONF", "SLURM_JOB_ID", "SLURM_JWT"];
        let own: Vec<OsString> = own_job(variables.map(OsString::from).into_iter()).collect();
        assert_eq!(own, ["SLURM_CPU_BIND", "SLURM_JOB_ID"]);
    }

    #[test]
    fn one_worker_is_no_several() {
        let told = |count| asked(count, "7", Path::new("/run/slurm"));
        assert_eq!(told(1), "Slurm: asked for 1 more worker, job 7; logs in /run/slurm");
        assert_eq!(told(2), "Slurm: asked for 2 more workers, job 7; logs in /run/slurm");
    }
}
