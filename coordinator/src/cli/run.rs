//! `coordinator run`: an experiment from start to result.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use clap::Args;
use descriptor::recogniser::Method;
use proto::Principal;
use transport::Port;

use super::after_run::AfterRun;
use super::sign::{RUN_FILES, Sign, sign};
use super::workers::Workers;
use crate::console::say;
use crate::dashboard::Dashboard;
use crate::experiment::{Experiment, Plan};
use crate::metrics::MetricsServer;
use crate::run::{self, RunOptions};
use crate::signing::SigningKey;
use crate::sweep;

/// Run an experiment; workers may join at any time
///
/// With a section [sweep] in the experiment, all its runs go on at the same time.
///
/// Killed, the same command goes on with the evaluation at which it was killed; so does `coordinator resume DIR`.
///
/// Exit codes: 0 finished; 1 bad input or another error; 2 usage; 3 no worker left within the grace; 4 a job failed for
/// good; 5 the deadline was reached; 6 two workers differ and nobody else came to decide; 130 interrupted, or stopped by
/// `coordinator control`; 143 terminated. After 3 to 6, 130 and 143, the same command goes on; after 1,
/// once the cause is removed.
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
    /// Serve metrics for Prometheus at /metrics, and /healthz and /readyz for probes, by default at 127.0.0.1:7790, for
    /// example 0.0.0.0:7790 with --tls for a Prometheus of another machine
    #[arg(long, value_name = "ADDR", num_args = 0..=1)]
    #[expect(clippy::option_option, reason = "left out, without an address, with one")]
    pub(super) metrics: Option<Option<SocketAddr>>,
}

/// What the command does with a run when it is finished, beside showing it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Afterwards {
    /// A random search of the same budget, and a comparison of both.
    pub(super) control: bool,
    /// A comparison.
    pub(super) comparison: bool,
}

impl Afterwards {
    /// Only a comparison.
    pub(super) const COMPARISON: Self = Self { control: false, comparison: true };
}

/// How a run is carried out, which changes none of its results.
#[derive(Debug, Args)]
pub struct Manner {
    /// Print the summary as one JSON object (of a sweep, one a line for each run) on standard output, for example for jq
    #[arg(long)]
    pub(super) json: bool,
    /// Let workers of this principal in again that gave a wrong answer and were repaired, as the column `principal` of the
    /// table `workers` names it, for example 'token 192.0.2.7'
    #[arg(long, value_name = "PRINCIPAL")]
    readmit: Vec<Principal>,
    #[command(flatten)]
    pub(super) workers: Workers,
}

impl Run {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let key = self.sign.key()?;
        let plan = Plan::read(&self.experiment, self.manner.workers.overrides(self.seed))?;
        let out = match &plan {
            Plan::Run(experiment) => run::folder(experiment, self.out, self.fresh),
            Plan::Sweep(sweep) => sweep::folder(sweep, self.out, self.fresh),
        };
        if self.control && matches!(plan, Plan::Sweep(_)) {
            anyhow::bail!(
                "--control: is for a single run, got a sweep\nadd a variant to it: [sweep.variants.random] search.method = \"random\""
            );
        }
        let afterwards = Afterwards { control: self.control, comparison: false };
        self.manner.execute(&plan, out, self.observers, afterwards, key.as_ref())
    }
}

impl Manner {
    /// Runs an experiment or a sweep in a folder, signs and shows the result.
    pub(super) fn execute(
        self,
        plan: &Plan,
        out: PathBuf,
        observers: Observers,
        afterwards: Afterwards,
        key: Option<&SigningKey>,
    ) -> anyhow::Result<ExitCode> {
        let [json, text] = self.run(plan, out.clone(), (&self.workers.port(), observers), afterwards)?;
        for (_, run) in sweep::run_folders(&out)? {
            sign(key, &run, &RUN_FILES)?;
        }
        super::print(if self.json { &json } else { &text })?;
        Ok(ExitCode::SUCCESS)
    }

    /// Runs an experiment or a sweep in a folder: the result as JSON and for people.
    pub(super) fn run(
        &self,
        plan: &Plan,
        out: PathBuf,
        (port, observers): (&Port, Observers),
        afterwards: Afterwards,
    ) -> anyhow::Result<[String; 2]> {
        let advice = format!(
            "go on: the same command again, or coordinator resume {} with the same options",
            out.display()
        );
        let Workers { protection, .. } = &self.workers;
        let Afterwards { control, comparison } = afterwards;
        let learns = |experiment: &Experiment| experiment.recognition() != Method::Nearest;
        let learns = match plan {
            Plan::Run(experiment) => learns(experiment),
            Plan::Sweep(sweep) => sweep.members().iter().any(|member| learns(&member.experiment)),
        };
        let options = RunOptions {
            out: Some(out.clone()),
            fresh: false,
            events: observers.events,
            port: port.clone(),
            slurm: self.workers.slurm()?,
            storage: self.workers.storage()?,
            readmit: self.readmit.clone(),
            comparison_follows: control || comparison || learns,
            metrics: observers.metrics.map(|_| Arc::default()),
        };
        let after = AfterRun { options: &options, overrides: self.workers.overrides(None), control };
        super::block_on(&advice, async {
            if let Some(address) = observers.dashboard {
                let dashboard = Dashboard::of_run(out, address, protection).await?;
                dashboard.notices().iter().for_each(say);
                tokio::spawn(dashboard.serve());
            }
            if let (Some(address), Some(source)) = (observers.metrics, &options.metrics) {
                let metrics = MetricsServer::bind(address, protection, Arc::clone(source)).await?;
                metrics.notices().iter().for_each(say);
                tokio::spawn(metrics.serve());
            }
            Ok(match plan {
                Plan::Run(experiment) => {
                    let summary = run::run(experiment, &options).await?;
                    let summary = after.complete(experiment, summary, comparison).await?;
                    [format!("{}\n", summary.json()), summary.text()]
                }
                Plan::Sweep(sweep) => {
                    let mut summary = sweep::sweep(sweep, &options).await?;
                    let mut left = sweep.members().len();
                    for (member, (_, finished)) in sweep.members().iter().zip(&mut summary.summaries) {
                        left -= 1;
                        let another_follows = comparison || left > 0;
                        *finished =
                            after.complete(&member.experiment, finished.clone(), another_follows).await?;
                    }
                    [summary.json(), summary.text()]
                }
            })
        })
    }
}
