//! The search: generation after generation, whatever makes them, until there is a reason to stop.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Instant;

use descriptor::{Descriptor, Parameters};
use results::{Counts, RunFolder};

use crate::evolution::{GenerationBest, Individual, StopReason, StopRule, Winner, selection};
use crate::experiment::Experiment;
use crate::memory::Known;
use crate::run::progress::{GenerationReport, Progress};
use crate::run::rows;
use crate::run::source::Source;
use crate::run::splits::Matching;
use crate::run::{RunError, Workplace};
use crate::tasks;
use cluster::Client;
use cluster::scheduler::Finished;
use proto::task::{DescriptorBytes, EvaluationResult, Task};

/// What a search found.
pub struct Found {
    /// Why it ended.
    pub stop_reason: StopReason,
    /// Number of generations.
    pub generations: u32,
    /// Where the winner stood.
    pub winner: GenerationBest,
    /// The winner.
    pub individual: Individual,
    /// The winner on the training set.
    pub train: Counts,
    /// Individuals that a worker evaluated.
    pub computed: u64,
    /// Individuals whose descriptor had been evaluated before.
    pub remembered: u64,
    /// All counts that the search has seen.
    pub known: Known,
}

/// One search under way.
pub struct Search<'a> {
    experiment: &'a Experiment,
    workplace: &'a Workplace<'a>,
    client: &'a mut Client,
    progress: &'a mut Progress,
    /// Nothing is evaluated twice.
    known: Known,
    /// In which generation each descriptor was first evaluated.
    born: BTreeMap<DescriptorBytes, u32>,
    computed: u64,
    remembered: u64,
}

impl<'a> Search<'a> {
    /// A search that has not begun; what is `known` from earlier runs is not evaluated again. What an earlier start of
    /// this run has evaluated stays its own, whatever other runs have found out since.
    pub fn new(
        experiment: &'a Experiment,
        workplace: &'a Workplace<'a>,
        client: &'a mut Client,
        progress: &'a mut Progress,
        mut known: Known,
    ) -> Self {
        let Workplace { cluster, splits, .. } = workplace;
        if cluster.has_past() {
            for (matching, known) in
                [(Matching::Train, &mut known.train), (Matching::Validation, &mut known.validation)]
            {
                let is_own = |parameters| cluster.recalls(splits.evaluation(parameters, matching, false));
                known.retain(|parameters, _| !is_own(*parameters));
            }
        }
        let born = BTreeMap::new();
        Self { experiment, workplace, client, progress, known, born, computed: 0, remembered: 0 }
    }

    /// Who asks for the search, and the display of the run.
    pub fn parties(&mut self) -> (&mut Client, &mut Progress) {
        (self.client, self.progress)
    }

    /// Notes to which generation the corrected answers take the run back.
    pub fn note_rewind(&self, tasks: &[Arc<Task>]) {
        let born = tasks.iter().filter_map(|task| self.born.get(&task.subject().descriptor));
        let generation = born.min().copied().unwrap_or(1);
        let why = format!("{} answers of a worker that was wrong are corrected", tasks.len());
        self.progress.say(&format!("back to generation {generation}: {why}"));
        self.client.note_rewind(generation, why);
    }

    /// Takes generations from `source` until the stop rule ends it, and writes each to the run folder.
    pub async fn run(&mut self, mut source: Source, folder: &mut RunFolder) -> Result<Found, RunError> {
        let mut stop = StopRule::new(*self.experiment.stop());
        let mut winner = Winner::default();
        let mut leader = None;
        let mut best_so_far = 0.0f64;
        loop {
            let started = Instant::now();
            let generation = source.generation();
            self.progress.generation_starts(generation);
            let population = source.population().to_vec();
            let computed = self.evaluate_new(generation, &population).await?;
            let counts: Vec<Counts> =
                population.iter().map(|one| self.known.train[&one.parameters]).collect();
            let correct: Vec<u32> = counts.iter().map(|counts| counts.object_correct).collect();

            let best = selection::best(&correct).unwrap_or(0) as usize;
            let validation = self.validate(population[best].parameters).await?;
            let candidate = GenerationBest {
                generation,
                individual: best as u32,
                parameters: population[best].parameters,
                correct: correct[best],
                validation_errors: validation.map(|counts| counts.queries - counts.object_correct),
            };
            let improved = winner.observe(candidate);
            if improved {
                leader = Some((candidate, population[best].clone(), counts[best]));
            }
            best_so_far = best_so_far.max(counts[best].fitness());
            let reason = if source.is_exhausted() {
                Some(StopReason::Exhaustive)
            } else {
                stop.observe(correct[best], counts[best].queries, candidate.validation_errors)
            };

            let individuals = rows::evaluations(generation, &population, &counts, &computed);
            let row = results::GenerationRow {
                generation,
                best_so_far_fitness: best_so_far,
                validation,
                mutation_rate: source.mutation_rate(),
                seconds: started.elapsed().as_secs_f64(),
            };
            // What an earlier start has written stays as it is, with the time that it took; unless it rests on answers
            // that were found to be wrong since.
            if generation <= folder.generations() && !folder.has(&individuals, &row)? {
                self.progress.say(&format!(
                    "generation {generation}: is not what was written before, got other counts"
                ));
                folder.truncate(generation - 1)?;
            }
            if generation > folder.generations() {
                // No table says who computed what before the journal does.
                self.workplace.cluster.flush().await?;
                folder.write_generation(&individuals, &row)?;
                self.progress.generation_done(&GenerationReport {
                    generation,
                    counts: &counts,
                    best: &population[best].parameters,
                    improved,
                    validation,
                    remembered: self.remembered,
                });
            }

            if let Some(stop_reason) = reason
                && let Some((winner, individual, train)) = leader
            {
                let (computed, remembered) = (self.computed, self.remembered);
                return Ok(Found {
                    stop_reason,
                    generations: generation,
                    winner,
                    individual,
                    train,
                    computed,
                    remembered,
                    known: std::mem::take(&mut self.known),
                });
            }
            source.tell(&correct);
        }
    }

    /// Evaluates the descriptors that are new and returns, for the first individual with each of them, who computed
    /// it.
    async fn evaluate_new(
        &mut self,
        generation: u32,
        population: &[Individual],
    ) -> Result<BTreeMap<usize, Finished<EvaluationResult>>, RunError> {
        let (mut new, mut seen) = (Vec::new(), BTreeSet::new());
        for (index, Individual { parameters, .. }) in population.iter().enumerate() {
            if !self.known.train.contains_key(parameters) && seen.insert(*parameters) {
                new.push((index, *parameters));
            }
        }
        let bytes = |parameters| tasks::descriptor_bytes(&Descriptor::DiskRing(parameters));
        self.born.extend(new.iter().map(|(_, parameters)| (bytes(*parameters), generation)));
        self.computed += new.len() as u64;
        self.remembered += (population.len() - new.len()) as u64;
        let evaluations = new
            .iter()
            .map(|(_, parameters)| self.workplace.splits.evaluation(*parameters, Matching::Train, false));
        let progress = &mut *self.progress;
        let finished = self.client.evaluate(evaluations.collect(), |news| progress.news(news)).await?;
        for ((_, parameters), finished) in new.iter().zip(&finished) {
            self.known.train.insert(*parameters, rows::counts(&finished.result));
        }
        Ok(new.into_iter().map(|(index, _)| index).zip(finished).collect())
    }

    /// Counts of the generation's best on the validation set, unless the stop rule does without.
    async fn validate(&mut self, parameters: Parameters) -> Result<Option<Counts>, RunError> {
        if self.experiment.stop().validation_patience.is_none() {
            return Ok(None);
        }
        if let Some(known) = self.known.validation.get(&parameters) {
            return Ok(Some(*known));
        }
        let evaluation = self.workplace.splits.evaluation(parameters, Matching::Validation, false);
        let progress = &mut *self.progress;
        let finished = self.client.evaluate(vec![evaluation], |news| progress.news(news)).await?;
        let counts = finished.first().map(|finished| rows::counts(&finished.result));
        if let Some(counts) = counts {
            self.known.validation.insert(parameters, counts);
        }
        Ok(counts)
    }
}
