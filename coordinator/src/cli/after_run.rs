//! What follows a run where it is asked for: the recogniser that learns, and a random search of the same budget.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use descriptor::recogniser::Method;
use descriptor::{SetDistance, VectorMetric};
use evolution::StopReason;
use results::EvaluationRow;

use crate::compare::{CompareError, EVOLVED, Options, Source, Sources, baselines, compare, label};
use crate::console::say;
use crate::experiment::{Experiment, Overrides};
use crate::run::summary::Summary;
use crate::run::{self, RunOptions};

/// The name of the control run's winner in a comparison.
const RANDOM: &str = "random";

/// What follows a run.
pub(super) struct AfterRun<'a> {
    /// How the run was started.
    pub(super) options: &'a RunOptions,
    /// Port and workers.
    pub(super) overrides: Overrides,
    /// Whether a random search of the same budget follows.
    pub(super) control: bool,
}

impl AfterRun<'_> {
    /// Adds what is asked for, and not there yet, to the comparison of a finished run. `another_follows`: workers stay for
    /// another comparison.
    ///
    /// # Errors
    /// As of a run and of a comparison. What cannot be learned from these clouds is none: a warning says so.
    pub(super) async fn complete(
        &self,
        experiment: &Experiment,
        summary: Summary,
        another_follows: bool,
    ) -> anyhow::Result<Summary> {
        let method = experiment.recognition();
        if summary.run.test.is_none() {
            if self.control || method != Method::Nearest {
                say(format_args!(
                    "warning: without test clouds nothing is compared: neither --control nor [recognition]"
                ));
            }
            return Ok(summary);
        }
        if !summary.sets.is_empty() {
            if self.control || method != Method::Nearest {
                let run = summary.out.display();
                say(format_args!(
                    "warning: clouds of several sets are compared set by set: neither --control nor [recognition]\n\
                     coordinator compare {run} --set NAME does it on one"
                ));
            }
            return Ok(summary);
        }
        let is_there = |label: &str| summary.compared.iter().any(|row| row.descriptor == label);
        let learns = method != Method::Nearest && !is_there(&label(EVOLVED, method));
        let control = if self.control && !is_there(RANDOM) {
            Some(self.random_search(experiment, &summary).await?)
        } else {
            None
        };
        if !learns && control.is_none() {
            return Ok(summary);
        }
        let reason = match (learns, &control) {
            (true, None) => "the experiment's recogniser",
            (false, _) => "random search of the same budget",
            (true, Some(_)) => "the experiment's recogniser and random search of the same budget",
        };
        let runs = control.map(|path| Source { name: Some(RANDOM.to_owned()), path });
        let options = Options {
            descriptors: Some(baselines::named(experiment)),
            given: Sources { runs: runs.into_iter().collect(), ..Sources::default() },
            foreign: Vec::new(),
            foreign_metric: VectorMetric::default(),
            perturbations: Vec::new(),
            distances: vec![SetDistance::default()],
            recognisers: if learns { vec![Method::Nearest, method] } else { vec![Method::Nearest] },
            radius_um: None,
            replace: false,
            times: false,
            set: None,
            reason: reason.to_owned(),
            data: None,
            overrides: self.overrides,
            port: self.options.port.clone(),
            slurm: self.options.slurm.clone(),
            storage: self.options.storage.clone(),
            another_follows,
        };
        let out = summary.out.clone();
        match compare(&out, &options).await {
            Ok(comparison) => Ok(Summary { compared: comparison.rows, pairs: comparison.pairs, ..summary }),
            Err(error @ (CompareError::Learn { .. } | CompareError::Recognise { .. })) => {
                say(format_args!("warning: {error}"));
                Ok(summary)
            }
            Err(error) => Err(error.into()),
        }
    }

    /// Runs a random search of as many different descriptors as the run has met; gives its folder, beside the run's.
    async fn random_search(&self, experiment: &Experiment, summary: &Summary) -> anyhow::Result<PathBuf> {
        let chromosomes = results::read_evaluations(&summary.out)?;
        // What costs too much is not evaluated, and no part of a budget.
        let is_evaluated = |row: &&EvaluationRow| {
            let descriptor = experiment.space().from_values(&row.genes);
            descriptor.is_some_and(|descriptor| experiment.affords(&descriptor))
        };
        let met: HashSet<Vec<Option<u64>>> = chromosomes
            .iter()
            .filter(is_evaluated)
            .map(|row| row.genes.iter().map(|gene| gene.map(f64::to_bits)).collect())
            .collect();
        let control = experiment.random_control(met.len() as u32);
        say(format_args!("random search of {} descriptors, as many as the run has met", met.len()));
        let out = beside(&summary.out);
        let options = RunOptions { out: Some(out.clone()), comparison_follows: true, ..self.options.clone() };
        let finished = run::run(&control, &options).await?;
        if finished.run.stop_reason != StopReason::Evaluations.as_str() {
            say(format_args!("random search: ended with fewer descriptors, {}", finished.run.stop_reason));
        }
        Ok(out)
    }
}

/// The folder of the random search that a run is compared with.
fn beside(out: &Path) -> PathBuf {
    let mut name = out.file_name().unwrap_or_default().to_owned();
    name.push("-random");
    out.with_file_name(name)
}
