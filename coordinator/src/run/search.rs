//! The search loop: has each generation of a search evaluated and writes it to the run folder, until the search ends.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Instant;

use descriptor::{Descriptor, SearchSpace};
use evolution::{GenerationBest, Individual, Score, Search, StopReason};
use results::RunFolder;

use crate::experiment::Experiment;
use crate::fitness::Measured;
use crate::result_cache::Known;
use crate::run::RunError;
use crate::run::fitness_batch::{Answer, FitnessBatch};
use crate::run::fitness_check::nothing_recognised;
use crate::run::matching::Matching;
use crate::run::progress::{GenerationReport, Progress};
use crate::run::rows;
use crate::run::scales::Scales;
use crate::session::Session;
use crate::tasks;
use cluster::scheduler::Finished;
use cluster::{Client, ClusterError, ClusterNews};
use proto::task::{DescriptorBytes, EvaluationResult, Task};

/// What a search found.
pub struct SearchResult {
    /// Why it ended.
    pub stop_reason: StopReason,
    /// Number of generations.
    pub generations: u32,
    /// The winner.
    pub winner: GenerationBest,
    /// The descriptor that the winner stands for.
    pub descriptor: Descriptor,
    /// The winner by the fitness.
    pub train: Measured,
    /// Individuals that a worker evaluated.
    pub computed: u64,
    /// Individuals whose descriptor had been evaluated before.
    pub remembered: u64,
    /// All counts that the search has used.
    pub counts: Known,
    /// The scales that it has used.
    pub scales: Scales,
}

/// The driver of one search.
pub struct SearchLoop<'a> {
    experiment: &'a Experiment,
    session: &'a Session<'a>,
    client: &'a mut Client,
    progress: &'a mut Progress,
    /// Counts of earlier runs and of this one: no descriptor is evaluated twice.
    counts: Known,
    scales: Scales,
    /// The generation in which the search has first come upon each descriptor: their number is what a budget of
    /// evaluations is spent on, whatever earlier runs have left.
    first_met: BTreeMap<DescriptorBytes, u32>,
    computed: u64,
    remembered: u64,
}

impl<'a> SearchLoop<'a> {
    /// A loop before its first generation. `cached` counts of earlier runs are not computed again, except those that an
    /// earlier start of this run has computed: they stay its own, whatever other runs have stored since.
    pub fn new(
        experiment: &'a Experiment,
        session: &'a Session<'a>,
        client: &'a mut Client,
        progress: &'a mut Progress,
        mut cached: Known,
    ) -> Self {
        let Session { cluster, splits, .. } = session;
        if cluster.has_past() {
            for (matching, counts) in
                [(Matching::Train, &mut cached.train), (Matching::Validation, &mut cached.validation)]
            {
                // Only families without scales are remembered.
                counts.retain(|descriptor, _| {
                    !cluster.recalls(splits.evaluation(&descriptor.into(), matching, false))
                });
            }
        }
        Self {
            experiment,
            session,
            client,
            progress,
            counts: cached,
            scales: Scales::default(),
            first_met: BTreeMap::new(),
            computed: 0,
            remembered: 0,
        }
    }

    /// The client that evaluates for the search, and the display of the run.
    pub fn client_and_progress(&mut self) -> (&mut Client, &mut Progress) {
        (self.client, self.progress)
    }

    /// Logs to which generation the corrected answers take the run back.
    pub fn note_rewind(&self, tasks: &[Arc<Task>]) {
        let generations = tasks.iter().filter_map(|task| self.first_met.get(&task.subject().descriptor));
        let generation = generations.min().copied().unwrap_or(1);
        let why = format!("{} answers of a worker that was wrong are corrected", tasks.len());
        self.progress.say(&format!("back to generation {generation}: {why}"));
        self.client.note_rewind(generation, why);
    }

    /// Evaluates generation after generation until the search ends, and writes each to the run folder.
    pub async fn run(
        &mut self,
        mut search: Search,
        folder: &mut RunFolder,
    ) -> Result<SearchResult, RunError> {
        loop {
            let started = Instant::now();
            let generation = search.generation();
            self.progress.generation_starts(generation, self.first_met.len() as u64);
            let descriptors = self.descriptors_within_budget(&search);
            search.keep_first(descriptors.len());
            let population = search.ask().to_vec();
            let computed = self.evaluate_new(&descriptors).await?;
            let measured: Vec<Measured> =
                descriptors.iter().map(|descriptor| self.counts.train[descriptor]).collect();
            let fitness = self.experiment.fitness();
            let scores: Vec<Score> = measured.iter().map(|measured| fitness.score(measured)).collect();
            let validation = match search.to_validate(&scores) {
                Some(index) => self.validate(&descriptors[index as usize]).await?,
                None => None,
            };
            let validation_score = validation.as_ref().map(|measured| fitness.score(measured));
            let state = search.tell(&scores, validation_score, self.first_met.len() as u64);

            let individuals =
                rows::evaluations(fitness, generation, &population, &descriptors, &measured, &computed);
            let row = results::GenerationRow {
                generation,
                best_so_far_fitness: state.best_so_far.fitness(),
                validation: validation.map(|measured| measured.counts),
                validation_margin: validation.and_then(|measured| measured.margin),
                mutation_rate: state.mutation_rate,
                seconds: started.elapsed().as_secs_f64(),
            };
            // A generation that an earlier start has written keeps the time that it took, unless it rests on answers
            // that were found to be wrong since.
            if generation <= folder.generations() && !folder.has(&individuals, &row)? {
                self.progress.say(&format!(
                    "generation {generation}: is not what was written before, got other counts"
                ));
                folder.truncate(generation - 1)?;
            }
            if generation > folder.generations() {
                // The journal comes first: tables must not name a worker for an answer that a crash could lose.
                self.session.cluster.flush().await?;
                folder.write_generation(&individuals, &row)?;
                self.progress.generation_done(&GenerationReport {
                    generation,
                    counts: &measured.iter().map(|measured| measured.counts).collect::<Vec<_>>(),
                    best: &descriptors[state.best as usize],
                    improved: state.improved,
                    validation: validation.map(|measured| measured.counts),
                    met: self.first_met.len() as u64,
                });
            }

            if let Some(stop_reason) = state.stop {
                let descriptor = decode(self.experiment.space(), &state.winner.individual);
                if let Some(max_cost) =
                    self.experiment.max_cost().filter(|_| !self.experiment.affords(&descriptor))
                {
                    let costs = self.counts.train.keys().map(Descriptor::recognition_cost);
                    return Err(RunError::TooCostly { max_cost, least: costs.min().unwrap_or(u64::MAX) });
                }
                return Ok(SearchResult {
                    stop_reason,
                    generations: generation,
                    train: self.counts.train[&descriptor],
                    winner: state.winner,
                    descriptor,
                    computed: self.computed,
                    remembered: self.remembered,
                    counts: std::mem::take(&mut self.counts),
                    scales: std::mem::take(&mut self.scales),
                });
            }
        }
    }

    /// What the individuals of the current generation stand for, up to the last that the budget of evaluations allows.
    fn descriptors_within_budget(&mut self, search: &Search) -> Vec<Descriptor> {
        let mut left = search.evaluations_left(self.first_met.len() as u64);
        let mut descriptors = Vec::with_capacity(search.ask().len());
        for individual in search.ask() {
            let descriptor = decode(self.experiment.space(), individual);
            if self.experiment.affords(&descriptor)
                && let Entry::Vacant(unmet) = self.first_met.entry(tasks::descriptor_bytes(&descriptor))
            {
                if left == Some(0) {
                    break;
                }
                left = left.map(|left| left - 1);
                unmet.insert(search.generation());
            }
            descriptors.push(descriptor);
        }
        descriptors
    }

    /// Evaluates the descriptors that are new and returns, for the first individual with each of them, who computed
    /// it.
    async fn evaluate_new(
        &mut self,
        descriptors: &[Descriptor],
    ) -> Result<BTreeMap<usize, Finished<EvaluationResult>>, RunError> {
        let (mut new, mut seen) = (Vec::new(), BTreeSet::new());
        for (index, descriptor) in descriptors.iter().enumerate() {
            if self.counts.train.contains_key(descriptor) {
                continue;
            }
            if !self.experiment.affords(descriptor) {
                self.counts.train.insert(descriptor.clone(), self.nothing_recognised(Matching::Train));
            } else if seen.insert(descriptor) {
                new.push((index, descriptor));
            }
        }
        self.computed += new.len() as u64;
        self.remembered += (descriptors.len() - new.len()) as u64;
        let descriptors: Vec<&Descriptor> = new.iter().map(|&(_, descriptor)| descriptor).collect();
        let finished = self.measure(&descriptors, Matching::Train).await?;
        self.progress.counted(self.computed, self.remembered);
        let mut computed = BTreeMap::new();
        for ((index, descriptor), Answer { measured, first }) in new.into_iter().zip(finished) {
            self.counts.train.insert(descriptor.clone(), measured);
            computed.insert(index, first);
        }
        Ok(computed)
    }

    /// Measures descriptors by the fitness.
    async fn measure(
        &mut self,
        descriptors: &[&Descriptor],
        matching: Matching,
    ) -> Result<Vec<Answer>, ClusterError> {
        let Self { client, progress, scales, session, experiment, .. } = self;
        scales.complete(descriptors, &session.splits, client, |news| progress.news(news)).await?;
        let batch = FitnessBatch::new(experiment.fitness(), &session.splits, scales, descriptors, matching);
        let watch = |news: &ClusterNews, descriptors: u64| match matching {
            Matching::Train => progress.evaluated(news, descriptors),
            Matching::Validation | Matching::Test => progress.news(news),
        };
        batch.evaluate(client, watch).await
    }

    fn nothing_recognised(&self, matching: Matching) -> Measured {
        nothing_recognised(self.experiment.fitness(), self.session.splits.dataset(), matching)
    }

    /// A descriptor on the validation set.
    async fn validate(&mut self, descriptor: &Descriptor) -> Result<Option<Measured>, RunError> {
        if let Some(measured) = self.counts.validation.get(descriptor) {
            return Ok(Some(*measured));
        }
        let measured = if self.experiment.affords(descriptor) {
            let finished = self.measure(&[descriptor], Matching::Validation).await?;
            finished.first().map(|answer| answer.measured)
        } else {
            Some(self.nothing_recognised(Matching::Validation))
        };
        if let Some(measured) = measured {
            self.counts.validation.insert(descriptor.clone(), measured);
        }
        Ok(measured)
    }
}

/// What an individual stands for.
///
/// # Panics
/// If it is not of the space: a programming error, as the genome is that of the space.
fn decode(space: &SearchSpace, individual: &Individual) -> Descriptor {
    space.decode(&individual.values).expect("value indices of the search space's genome")
}
