//! A sample of individuals against what is computed again of them, and who is to blame for what differs.

use std::path::Path;

use cache::Store;
use descriptor::Descriptor;
use proto::Principal;
use results::{Counts, EvaluationRow, WorkerRow};

use crate::console::Console;
use crate::dataset::Dataset;
use crate::experiment::Experiment;
use crate::fitness::Measured;
use crate::result_cache::{CountsByDescriptor, Wrong, finished_runs};
use crate::run::{Matching, RunError, counts_text, nothing_recognised};
use crate::session::Session;

/// What was computed again.
pub struct Recomputed {
    /// Of each individual, in their order.
    pub individuals: Vec<Individual>,
    /// How many of them were evaluated: the others cost too much.
    pub evaluated: usize,
    /// What the winner has with weights for its values, if it was weighed.
    pub weighted: Option<Counts>,
}

/// What was computed again of one individual.
pub struct Individual {
    measured: Measured,
    /// Of clouds of several sets.
    set_errors: Option<Vec<f32>>,
}

/// Computes again what individuals with these descriptors have on the training clouds, and the weighted winner.
///
/// # Errors
/// Those of an evaluation.
pub async fn recompute(
    session: &Session<'_>,
    (experiment, dataset): (&Experiment, &Dataset),
    descriptors: &[Descriptor],
    weighted: Option<&Descriptor>,
) -> Result<Recomputed, RunError> {
    let affordable: Vec<&Descriptor> =
        descriptors.iter().filter(|descriptor| experiment.affords(descriptor)).collect();
    let weights = experiment.set_weights(dataset);
    let fitness = (experiment.fitness(), &weights[..]);
    let work = async {
        let (client, splits) = (&mut session.cluster.client(), &session.splits);
        let answers = session.measure(client, splits, fitness, &affordable).await?;
        let Some(weighted) = weighted else { return Ok((answers, None)) };
        let splits = &splits.beside(weighted, (experiment.preprocess(), experiment.space()));
        let of_weighted = session.measure(client, splits, fitness, &[weighted]).await?;
        Ok((answers, of_weighted.first().map(|answer| answer.measured.counts)))
    };
    let (answers, weighted) = session.perform(&Console::default(), None, work).await?;
    let (evaluated, mut answers) = (answers.len(), answers.into_iter());
    let nothing = nothing_recognised(experiment, dataset, Matching::Train);
    let of_one = |descriptor: &Descriptor| match experiment.affords(descriptor) {
        true => answers.next().map(|one| Individual { measured: one.measured, set_errors: one.set_errors }),
        false => Some(Individual { measured: nothing, set_errors: None }),
    };
    let individuals = descriptors.iter().map_while(of_one).collect();
    Ok(Recomputed { individuals, evaluated, weighted })
}

impl Individual {
    /// What differs in the row of the individual.
    pub fn problems(&self, row: &EvaluationRow) -> Vec<String> {
        let Self { measured: Measured { counts, margin }, set_errors } = self;
        let mut problems = Vec::new();
        // Runs of earlier builds have none.
        if row.set_errors.is_some() && row.set_errors != *set_errors {
            problems.push(format!("expected errors by set {set_errors:?}, got {:?}", row.set_errors));
        }
        if row.margin.map(f64::to_bits) != margin.map(f64::to_bits) {
            problems.push(format!("expected margin {margin:?}, got {:?}", row.margin));
        }
        if row.counts != *counts {
            problems.push(format!("expected {}, got {}", counts_text(counts), counts_text(&row.counts)));
        }
        let place = format!("evaluations, generation {}, individual {}", row.generation, row.individual);
        problems.iter().map(|problem| format!("{place}: {problem}")).collect()
    }
}

/// Who is to blame for these rows of a run: the principals of the workers that have computed them, those from which an
/// earlier run had what they rest on, and the run itself, for what it has left to later ones.
pub fn wrong_sources(
    run: &Path,
    rows: &[(&EvaluationRow, &Descriptor)],
    remembered: &CountsByDescriptor,
    store: &Store,
) -> Result<Wrong, results::Error> {
    let mut wrong =
        Wrong { runs: finished_runs::session_of(store, run).into_iter().collect(), ..Wrong::default() };
    let workers = results::read_workers(run)?;
    for (row, descriptor) in rows {
        match &row.computed {
            Some(computed) => {
                let is_its = |worker: &&WorkerRow| worker.worker == computed.worker;
                let of_one = workers.iter().any(|worker| is_its(&worker));
                // Of pieces, it may have been any of them.
                let theirs = workers.iter().filter(|worker| !of_one || is_its(worker));
                let principals =
                    theirs.filter_map(|worker| worker.principal.as_ref()?.parse::<Principal>().ok());
                wrong.principals.extend(principals);
            }
            None => {
                let sources = remembered.get(descriptor).map(|one| one.source.suspects());
                wrong.principals.extend(sources.into_iter().flatten());
            }
        }
    }
    Ok(wrong)
}
