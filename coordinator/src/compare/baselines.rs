//! The winner of a run beside descriptors that anybody has without a search, on the test clouds.

use descriptor::recogniser::Method;
use descriptor::{Descriptor, FixedDescriptor, Label, Preprocess, SetDistance};
use proto::task::EvaluationResult;
use results::{ComparedRow, PairRow, RunFolder, RunRow};

use super::candidate::{Candidate, Choice, Named};
use super::tables::Tables;
use super::timing::seconds_of_a_cloud;
use crate::dataset::Dataset;
use crate::run::matching::Matching;

/// The winner and, after it, the baselines that clouds with or without colours allow, all as the paper compares.
pub fn candidates(winner: &Descriptor, colour: bool) -> Vec<Candidate> {
    let baselines = Named::BASELINES.into_iter().filter(|one| colour || !one.needs_colour());
    let plain = std::iter::once(Named::Evolved).chain(baselines).map(|named| Choice {
        named,
        distance: SetDistance::default(),
        recogniser: Method::default(),
    });
    plain.map(|choice| choice.candidate(winner, FixedDescriptor::DEFAULT_RADIUS_UM)).collect()
}

/// What is written of a finished run.
pub struct Finished<'a> {
    /// Its row.
    pub run: &'a RunRow,
    /// Its clouds.
    pub dataset: &'a Dataset,
    /// How they are prepared.
    pub preprocess: &'a Preprocess,
    /// Its folder.
    pub out: &'a RunFolder,
}

impl Finished<'_> {
    /// Writes the comparison of [`candidates`], from the evaluation of each on the test clouds.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn compare<'r>(
        &self,
        evaluated: impl Iterator<Item = (&'r Candidate, &'r EvaluationResult)>,
    ) -> Result<(Vec<ComparedRow>, Vec<PairRow>), results::Error> {
        let Self { run, dataset, preprocess, out } = *self;
        let label = |&index: &u32| {
            let cloud = &dataset.clouds.entries[index as usize];
            Label { category: cloud.category, instance: cloud.instance }
        };
        let queries: Vec<Label> = Matching::Test.query_clouds(dataset).iter().map(label).collect();
        let database: Vec<Label> = Matching::Test.database_clouds(dataset).iter().map(label).collect();
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
}
