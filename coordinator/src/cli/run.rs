//! `coordinator run`: an experiment from start to result.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;

use cache::StorageArgs;
use clap::Args;
use proto::Principal;

use super::after_run::AfterRun;
use super::sign::{RUN_FILES, Sign, sign};
use crate::console::say;
use crate::dashboard::Dashboard;
use crate::experiment::{LocalWorkers, Overrides, Plan};
use crate::run::{self, RunOptions};
use crate::signing::SigningKey;
use crate::sweep;
use transport::Protection;

/// Run an experiment; workers may join at any time
///
/// With a section [sweep] in the experiment, all its runs go on at the same time.
///
/// Killed, the same command goes on with the evaluation at which it was killed; so does `coordinator resume DIR`.
///
/// Exit codes: 0 finished; 1 bad input or another error; 2 usage; 3 no worker left within the grace; 4 a job failed for
/// good; 5 the deadline was reached; 6 two workers differ and nobody else came to decide; 130 interrupted, or stopped by
/// `coordinator control`; 143 terminated. After all of them the same command goes on.
///
/// Example: coordinator run experiments/demo.toml
#[derive(Debug, Args)]
pub struct Run {
    /// The experiment, for example experiments/demo.toml
    #[arg(value_name = "EXP.toml")]
    experiment: PathBuf,
    /// Run folder (of a sweep, the folder for its run folders), for example results/runs/first; by default named after experiment and search settings
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replaces the experiment's seed, for example 7
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Begin another run beside the one that is there, for example after an update. Each use begins another run: a
    /// killed one goes on with `coordinator resume` instead
    #[arg(long)]
    fresh: bool,
    /// Let a random search of as many descriptors follow, in a folder beside the run's that ends in -random, and
    /// compare the winner with its winner: whether the search was worth it, for example to say so in a paper. Of a
    /// sweep, write a variant instead
    #[arg(long)]
    control: bool,
    #[command(flatten)]
    sign: Sign,
    #[command(flatten)]
    observers: Observers,
    #[command(flatten)]
    manner: Manner,
}

/// Who else follows a run.
#[derive(Debug, Default, Args)]
pub struct Observers {
    /// Append what happens, as it happens, to this file: one JSON object a line, for example events.jsonl
    #[arg(long, value_name = "FILE")]
    pub(super) events: Option<PathBuf>,
    /// Show the run in a browser while it goes on, by default at 127.0.0.1:7780, for example 0.0.0.0:7780 with --tls for
    /// browsers of other machines; `coordinator dashboard` shows it afterwards
    #[arg(long, value_name = "ADDR", num_args = 0..=1)]
    #[expect(clippy::option_option, reason = "left out, without an address, with one")]
    pub(super) dashboard: Option<Option<SocketAddr>>,
}

/// How a run is carried out, which changes none of its results.
#[derive(Debug, Args)]
pub struct Manner {
    /// Where workers are awaited, for example 0.0.0.0:7700 (other machines) or 127.0.0.1:0 (any free port); by
    /// default 127.0.0.1:7700
    #[arg(long, value_name = "ADDR")]
    listen: Option<SocketAddr>,
    /// Workers inside this process: auto (one on all cores), a number that shares the cores, or 0 to wait for
    /// `worker`s, for example 0
    #[arg(long, value_name = "auto|N")]
    local_workers: Option<LocalWorkers>,
    /// Print the summary as one JSON object (of a sweep, one a line for each run) on standard output, for example for jq
    #[arg(long)]
    pub(super) json: bool,
    /// Let workers of this principal in again that gave a wrong answer and were repaired, as the column `principal` of the
    /// table `workers` names it, for example 'token 192.0.2.7'
    #[arg(long, value_name = "PRINCIPAL")]
    readmit: Vec<Principal>,
    #[command(flatten)]
    pub(super) protection: Protection,
    #[command(flatten)]
    pub(super) storage: StorageArgs,
}

impl Run {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let key = self.sign.key()?;
        let plan = Plan::read(&self.experiment, self.manner.overrides(self.seed))?;
        let out = match &plan {
            Plan::Run(experiment) => run::folder(experiment, self.out, self.fresh),
            Plan::Sweep(sweep) => sweep::folder(sweep, self.out, self.fresh),
        };
        if self.control && matches!(plan, Plan::Sweep(_)) {
            anyhow::bail!(
                "--control: is for a single run, got a sweep\nadd a variant to it: [sweep.variants.random] search.method = \"random\""
            );
        }
        self.manner.execute(&plan, out, self.observers, self.control, key.as_ref())
    }
}

impl Manner {
    pub(super) fn overrides(&self, seed: Option<u64>) -> Overrides {
        Overrides { seed, listen: self.listen, local_workers: self.local_workers }
    }

    /// Runs an experiment or a sweep in a folder, signs and shows the result.
    pub(super) fn execute(
        self,
        plan: &Plan,
        out: PathBuf,
        observers: Observers,
        control: bool,
        key: Option<&SigningKey>,
    ) -> anyhow::Result<ExitCode> {
        let [json, text] = self.run(plan, out.clone(), observers, control)?;
        for (_, run) in sweep::run_folders(&out)? {
            sign(key, &run, &RUN_FILES)?;
        }
        super::print(if self.json { &json } else { &text })?;
        Ok(ExitCode::SUCCESS)
    }

    /// Runs an experiment or a sweep in a folder: the result as JSON and for people. `control`: a random search follows a
    /// run.
    pub(super) fn run(
        &self,
        plan: &Plan,
        out: PathBuf,
        observers: Observers,
        control: bool,
    ) -> anyhow::Result<[String; 2]> {
        let advice = format!(
            "go on: the same command again, or coordinator resume {} with the same options",
            out.display()
        );
        let (protection, storage) = (self.protection.clone(), self.storage.clone().resolve());
        let options = RunOptions {
            out: Some(out.clone()),
            fresh: false,
            events: observers.events,
            protection,
            storage,
            readmit: self.readmit.clone(),
        };
        let after = AfterRun { options: &options, overrides: self.overrides(None), control };
        super::block_on(&advice, async {
            if let Some(address) = observers.dashboard {
                let dashboard = Dashboard::of_run(out, address, &self.protection).await?;
                dashboard.notices().iter().for_each(say);
                tokio::spawn(dashboard.serve());
            }
            Ok(match plan {
                Plan::Run(experiment) => {
                    let summary = run::run(experiment, &options).await?;
                    let summary = after.complete(experiment, summary).await?;
                    [format!("{}\n", summary.json()), summary.text()]
                }
                Plan::Sweep(sweep) => {
                    let mut summary = sweep::sweep(sweep, &options).await?;
                    for (member, (_, finished)) in sweep.members().iter().zip(&mut summary.summaries) {
                        *finished = after.complete(&member.experiment, finished.clone()).await?;
                    }
                    [summary.json(), summary.text()]
                }
            })
        })
    }
}
