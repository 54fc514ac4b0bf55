//! `coordinator control`: orders to a run that goes on.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use clap::{Args, Subcommand};

use cluster::scheduler::MAX_PRIORITY;

use crate::control::{Action, Request, me, request_within};

/// Pause, resume or stop a run or grid that goes on, set priorities in a sweep, drain or deny its workers
///
/// The request goes through the run folder, so that this works on every machine that mounts it. Results stay as they are: a
/// run that was controlled ends with the same digest. Each order is in the table `events`, with who gave it and why. A
/// coordinator that is started again begins unpaused, with no worker drained and all priorities 1.
///
/// Exit codes: 0 done; 1 not done.
///
/// Example: coordinator control results/runs/demo-9c8cd1e943e6 pause --reason "the room gets too warm"
#[derive(Debug, Args)]
pub struct Control {
    /// The folder of a run, a sweep, a run of a sweep, or a grid (`exhaust`), for example results/runs/demo-9c8cd1e943e6
    #[arg(value_name = "RUN")]
    run: PathBuf,
    #[command(subcommand)]
    action: Order,
}

#[derive(Debug, Subcommand)]
enum Order {
    /// Hand out no more jobs; those in hand end and count
    ///
    /// Of a sweep, all its runs; of a run of a sweep, that one.
    ///
    /// Example: coordinator control results/runs/demo-9c8cd1e943e6 pause --reason "the room gets too warm"
    Pause(Why),
    /// Go on with a run that was paused, or give a drained worker jobs again
    ///
    /// Example: coordinator control results/runs/demo-9c8cd1e943e6 resume --reason "cool again"
    Resume {
        /// The worker that was drained, by its label, for example lab-1; by default the run goes on
        #[arg(long, value_name = "WORKER")]
        worker: Option<String>,
        #[command(flatten)]
        why: Why,
    },
    /// End a run as an interrupt does: its exit code is 130, and it can be resumed
    ///
    /// Of a sweep, all its runs; none of them alone. A grid goes on by the same command.
    ///
    /// Example: coordinator control results/runs/demo-9c8cd1e943e6 stop --reason "the machines are needed"
    Stop(Why),
    /// Set how many workers a run of a sweep gets for each that a run of priority 1 gets
    ///
    /// Example: coordinator control results/runs/mysweep-sweep-5a1b0c2d3e4f/seed-3 priority 4 --reason "deadline"
    Priority {
        /// The priority, for example 4; all runs begin with 1
        #[arg(value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_PRIORITY)))]
        priority: u32,
        #[command(flatten)]
        why: Why,
    },
    /// Give a worker no more jobs; it ends those in hand and stays connected
    ///
    /// Example: coordinator control results/runs/demo-9c8cd1e943e6 drain lab-1 --reason "to be updated"
    Drain {
        /// The worker, by its label, as the table `workers` and the coordinator's terminal name it, for example lab-1
        #[arg(value_name = "WORKER")]
        worker: String,
        #[command(flatten)]
        why: Why,
    },
    /// Remove a worker and let it in no more; its jobs go to others
    ///
    /// If it came with a certificate, that is added to the deny list of the coordinator's --tls. Else this one process is
    /// kept out as long as the coordinator is at work.
    ///
    /// Example: coordinator control results/runs/demo-9c8cd1e943e6 deny lab-1 --reason "was stolen"
    Deny {
        /// The worker, by its label, for example lab-1
        #[arg(value_name = "WORKER")]
        worker: String,
        #[command(flatten)]
        why: Why,
    },
}

/// Why, and how long to wait.
#[derive(Debug, Args)]
struct Why {
    /// Why, for whoever reads the results: 1 to 200 printable characters, for example "the room gets too warm"
    #[arg(long, value_name = "TEXT")]
    reason: String,
    /// How long to wait for the coordinator, for example 60 over a network file system, which may show files late
    #[arg(long, value_name = "SECONDS", default_value_t = 10, value_parser = clap::value_parser!(u64).range(1..=3600))]
    wait: u64,
}

impl Control {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let (action, why) = match self.action {
            Order::Pause(why) => (Action::Pause, why),
            Order::Resume { worker, why } => (Action::Resume { worker }, why),
            Order::Stop(why) => (Action::Stop, why),
            Order::Priority { priority, why } => (Action::Priority { priority }, why),
            Order::Drain { worker, why } => (Action::Drain { worker }, why),
            Order::Deny { worker, why } => (Action::Deny { worker }, why),
        };
        let done = send(&self.run, action, why)?;
        super::print(&format!("{done}\n"))?;
        Ok(ExitCode::SUCCESS)
    }
}

fn send(run: &Path, action: Action, Why { reason, wait }: Why) -> anyhow::Result<String> {
    let request = Request { action, reason, by: me() };
    Ok(request_within(run, &request, Duration::from_secs(wait))?)
}
