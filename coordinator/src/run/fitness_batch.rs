//! Descriptors measured by a fitness: their evaluations, and the weighted sums of what comes back.

use std::collections::BTreeMap;

use cluster::scheduler::Finished;
use cluster::{AwaitingScales, Client, ClusterError, ClusterNews, FoundScale};
use descriptor::Descriptor;
use proto::task::EvaluationResult;
use results::Counts;

use crate::fitness::{Fitness, Measured};
use crate::run::matching::Matching;
use crate::run::rows;
use crate::run::scales::{MissingScales, Scales};
use crate::run::sets::with_weight;
use crate::run::splits::SplitBlobs;

/// The evaluations of some descriptors under a fitness.
pub struct FitnessBatch {
    fitness: Fitness,
    /// Evaluations of a descriptor in one set; `None` of clouds of one set.
    of_set: Option<usize>,
    evaluations: Vec<AwaitingScales>,
    /// The scales that are asked for with them.
    missing: MissingScales,
    /// Of each descriptor the weights of its evaluations, which follow one another.
    weights: Vec<Vec<u32>>,
}

/// Descriptors of which some evaluations are done and others not.
struct Incomplete<'a> {
    /// Of each descriptor the weights of its evaluations.
    weights: &'a [Vec<u32>],
    /// What is there, by descriptor and evaluation.
    counted: BTreeMap<usize, BTreeMap<usize, Counted>>,
}

/// Counts, margin and weight of an evaluation.
type Counted = (Counts, Option<f64>, u32);

impl Incomplete<'_> {
    /// Takes in an evaluation; gives the descriptor, with the weighted sum, if it was the last one of it.
    fn take(&mut self, index: usize, result: &EvaluationResult) -> Option<(usize, Measured)> {
        let of_descriptor = self.weights.first()?.len();
        let (descriptor, evaluation) = (index / of_descriptor, index % of_descriptor);
        let weight = self.weights[descriptor][evaluation];
        let counted = self.counted.entry(descriptor).or_default();
        counted.insert(evaluation, (rows::counts(result), result.margin, weight));
        if counted.len() < of_descriptor {
            return None;
        }
        let counted = self.counted.remove(&descriptor)?;
        Some((descriptor, Measured::sum(counted.into_values())))
    }
}

/// What is known of one descriptor.
pub struct Answer {
    /// The weighted sum.
    pub measured: Measured,
    /// The error in each set that has a weight, by number; `None` of clouds of one set.
    pub set_errors: Option<Vec<f32>>,
    /// The first of its evaluations, which says who computed it.
    pub first: Finished<EvaluationResult>,
}

impl FitnessBatch {
    /// Of these descriptors, and the scales that they lack in the sets that have a weight.
    pub fn new(
        (fitness, set_weights): (&Fitness, &[u32]),
        splits: &SplitBlobs<'_>,
        scales: &Scales,
        descriptors: &[&Descriptor],
        matching: Matching,
    ) -> Self {
        let missing = scales.missing(descriptors, &with_weight(set_weights), splits);
        let (mut evaluations, mut weights) = (Vec::new(), Vec::new());
        for &descriptor in descriptors {
            let scaled = |set| scales.of(set, descriptor, &missing);
            let parts = splits.measure((fitness, set_weights), scaled, matching);
            weights.push(parts.iter().map(|&(_, weight)| weight).collect());
            evaluations.extend(parts.into_iter().map(|(evaluation, _)| evaluation));
        }
        let of_set = (splits.sets().len() > 1).then(|| fitness.parts(matching).len());
        Self { fitness: *fitness, of_set, evaluations, missing, weights }
    }

    /// One answer a descriptor, in their order, and the scales that were missing, for [`Scales::add`]. `watch` is shown all
    /// news, how many descriptors more are evaluated: as many as the evaluations that are finished would make, whosever they
    /// are, and those of which all evaluations are done, by index.
    pub async fn evaluate(
        self,
        client: &mut Client,
        mut watch: impl FnMut(&ClusterNews, u64, &[(usize, Measured)]),
    ) -> Result<(Vec<Answer>, (MissingScales, Vec<Finished<FoundScale>>)), ClusterError> {
        let of_descriptor = self.weights.first().map_or(1, Vec::len).max(1);
        let mut open = 0;
        let mut incomplete = Incomplete { weights: &self.weights, counted: BTreeMap::new() };
        let watch = |news: &ClusterNews, evaluated: &[(usize, &EvaluationResult)]| {
            open += news.finished;
            let descriptors = open / of_descriptor;
            open %= of_descriptor;
            let measured = evaluated.iter().filter_map(|&(index, result)| incomplete.take(index, result));
            watch(news, descriptors as u64, &measured.collect::<Vec<_>>());
        };
        let asked = (self.missing.tasks.clone(), &self.missing.needed_by[..]);
        let (finished, scales) = client.evaluate_and_scale(self.evaluations, asked, watch).await?;
        let mut finished = finished.into_iter();
        let answer = |weights: Vec<u32>| {
            let parts: Vec<_> = finished.by_ref().take(weights.len()).collect();
            let weighted = parts.iter().zip(weights);
            let counted: Vec<_> = weighted
                .map(|(part, weight)| (rows::counts(&part.result), part.result.margin, weight))
                .collect();
            // All parts of a set have its weight in theirs, which its share of errors does not show.
            let error = |of_set: &[_]| {
                let measured = Measured::sum(of_set.iter().copied());
                (1.0 - self.fitness.score(&measured).fitness()) as f32
            };
            let set_errors = self.of_set.map(|count| counted.chunks(count).map(error).collect());
            let measured = Measured::sum(counted);
            parts.into_iter().next().map(|first| Answer { measured, set_errors, first })
        };
        Ok((self.weights.into_iter().filter_map(answer).collect(), (self.missing, scales)))
    }
}
