//! The winner of a run beside descriptors that anybody has without a search, on the test clouds.

use descriptor::recogniser::Method;
use descriptor::{Descriptor, FixedDescriptor, Label, Preprocess, SetDistance};
use proto::task::EvaluationResult;
use results::{ComparedRow, PairRow, RunFolder, RunRow};

use super::candidate::{Candidate, Choice, Named};
use super::tables::Tables;
use super::timing::seconds_of_a_cloud;
use crate::dataset::{CloudEntry, Dataset};
use crate::experiment::Experiment;
use crate::run::matching::Matching;

/// The winner of an experiment and, after it, the baselines that it wants and its clouds allow, with or without colours.
pub fn named(experiment: &Experiment) -> Vec<Named> {
    let colour = experiment.preprocess().colour;
    let baselines = Named::BASELINES.into_iter().filter(|_| experiment.compares_baselines());
    std::iter::once(Named::Evolved).chain(baselines).filter(|one| colour || !one.needs_colour()).collect()
}

/// The same as the paper compares them.
pub fn candidates(winner: &Descriptor, experiment: &Experiment) -> Vec<Candidate> {
    let plain = |named| {
        let choice = Choice { named, distance: SetDistance::default(), recogniser: Method::default() };
        choice.candidate(winner, FixedDescriptor::DEFAULT_RADIUS_UM)
    };
    named(experiment).into_iter().map(plain).collect()
}

/// Writes the comparison of [`candidates`] into the folder of a run, from the evaluation of each on the test clouds.
///
/// # Errors
/// If it cannot be written.
pub fn compare<'a>(
    evaluated: impl Iterator<Item = (&'a Candidate, &'a EvaluationResult)>,
    run: &RunRow,
    (dataset, preprocess): (&Dataset, &Preprocess),
    out: &RunFolder,
) -> Result<(Vec<ComparedRow>, Vec<PairRow>), results::Error> {
    let label = |cloud: &CloudEntry| Label { category: cloud.category, instance: cloud.instance };
    let queries: Vec<Label> = Matching::Test.queries(dataset).map(label).collect();
    let database: Vec<Label> = Matching::Test.database(dataset).map(label).collect();
    let tables = Tables { run, dataset, labels: [&queries, &database], out };
    out.begin_comparison()?;
    let (mut compared, mut rows) = (Vec::new(), Vec::new());
    for (candidate, result) in evaluated {
        let one = tables.add_evaluated(candidate, result)?;
        let cloud_seconds = seconds_of_a_cloud(dataset, preprocess, &candidate.descriptor);
        rows.push(ComparedRow { cloud_seconds, ..one.row.clone() });
        compared.push(one);
    }
    let pairs = tables.pairs(&compared);
    out.write_comparison(&rows, &pairs)?;
    Ok((rows, pairs))
}
