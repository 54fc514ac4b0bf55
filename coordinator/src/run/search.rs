//! The search: generation after generation, whatever makes them, until there is a reason to stop.

use std::collections::BTreeMap;
use std::time::Instant;

use descriptor::Parameters;
use results::{Counts, RunFolder};

use crate::evaluation::EvaluationResult;
use crate::evolution::{GenerationBest, Individual, StopReason, StopRule, Winner, selection};
use crate::experiment::Experiment;
use crate::memory::Known;
use crate::run::progress::{GenerationReport, Progress};
use crate::run::rows;
use crate::run::source::Source;
use crate::run::splits::Matching;
use crate::run::{RunError, Workplace};
use crate::scheduler::Finished;

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
    progress: &'a mut Progress,
    /// Nothing is evaluated twice.
    known: Known,
    computed: u64,
    remembered: u64,
}

impl<'a> Search<'a> {
    /// A search that has not begun; what is `known` from earlier runs is not evaluated again.
    pub fn new(
        experiment: &'a Experiment,
        workplace: &'a Workplace<'a>,
        progress: &'a mut Progress,
        known: Known,
    ) -> Self {
        Self { experiment, workplace, progress, known, computed: 0, remembered: 0 }
    }

    /// Takes generations from `source` until the stop rule ends it, and writes each to the run folder.
    pub async fn run(mut self, mut source: Source, folder: &mut RunFolder) -> Result<Found, RunError> {
        let mut stop = StopRule::new(*self.experiment.stop());
        let mut winner = Winner::default();
        let mut leader = None;
        let mut best_so_far = 0.0f64;
        loop {
            let started = Instant::now();
            let generation = source.generation();
            self.progress.generation_starts(generation);
            let population = source.population().to_vec();
            let computed = self.evaluate_new(&population).await?;
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
            folder.write_generation(
                &individuals,
                &results::GenerationRow {
                    generation,
                    best_so_far_fitness: best_so_far,
                    validation,
                    mutation_rate: source.mutation_rate(),
                    seconds: started.elapsed().as_secs_f64(),
                },
            )?;
            self.progress.generation_done(&GenerationReport {
                generation,
                counts: &counts,
                best: &population[best].parameters,
                improved,
                validation,
                remembered: self.remembered,
            });

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
                    known: self.known,
                });
            }
            source.tell(&correct);
        }
    }

    /// Evaluates the descriptors that are new and returns, for the first individual with each of them, who computed
    /// it.
    async fn evaluate_new(
        &mut self,
        population: &[Individual],
    ) -> Result<BTreeMap<usize, Finished<EvaluationResult>>, RunError> {
        let mut new: Vec<(usize, Parameters)> = Vec::new();
        for (index, individual) in population.iter().enumerate() {
            let parameters = individual.parameters;
            if !self.known.train.contains_key(&parameters)
                && new.iter().all(|(_, known)| *known != parameters)
            {
                new.push((index, parameters));
            }
        }
        self.computed += new.len() as u64;
        self.remembered += (population.len() - new.len()) as u64;
        let evaluations = new
            .iter()
            .map(|(_, parameters)| self.workplace.splits.evaluation(*parameters, Matching::Train, false));
        let progress = &mut *self.progress;
        let finished =
            self.workplace.cluster.evaluate(evaluations.collect(), |news| progress.news(news)).await?;
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
        let finished = self.workplace.cluster.evaluate(vec![evaluation], |news| progress.news(news)).await?;
        let counts = finished.first().map(|finished| rows::counts(&finished.result));
        if let Some(counts) = counts {
            self.known.validation.insert(parameters, counts);
        }
        Ok(counts)
    }
}
