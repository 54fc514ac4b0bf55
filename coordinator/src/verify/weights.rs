//! Weights of a winner's values, learned again from the training clouds.

use descriptor::Descriptor;
use results::RunRow;

use crate::dataset::Dataset;
use crate::experiment::Experiment;
use crate::weighing::{TrainingClouds, WeighingError, file_text, teaching_sets};

/// What was found.
#[derive(Debug, Default)]
pub(super) struct Found {
    /// The winner with the weights that were learned again; `None` of a run that has weighed none.
    pub winner: Option<Descriptor>,
    /// In what the run has other weights.
    pub problem: Option<String>,
}

/// Compares the weighted winner of a run with one that is weighed again.
pub(super) fn check(
    experiment: &Experiment,
    dataset: &Dataset,
    row: &RunRow,
) -> Result<Found, WeighingError> {
    let searched = experiment.space().from_values(&row.best_genes);
    let Some(Descriptor::Structure(structure)) = searched.filter(|_| experiment.weighs()) else {
        let problem = row.weighted_winner.is_some();
        let told = || "run: weighted_winner: expected none, as nothing was to be weighed, got one".to_owned();
        return Ok(Found { winner: None, problem: problem.then(told) });
    };
    let sets = teaching_sets(dataset, &experiment.set_weights(dataset));
    let clouds = TrainingClouds::describe(&sets, experiment.preprocess(), &structure)?;
    let weighted = clouds.weigh(&structure)?;
    let text = file_text(&weighted);
    let problem = match &row.weighted_winner {
        Some(recorded) if *recorded == text => None,
        recorded => {
            let expected = Descriptor::Structure(weighted.clone()).parameters();
            let got = recorded.as_deref().map_or("none", |_| "a file with others");
            Some(format!("run: weighted_winner: expected weights of {expected}, got {got}"))
        }
    };
    Ok(Found { winner: Some(Descriptor::Structure(weighted)), problem })
}
