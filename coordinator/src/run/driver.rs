//! One run at work: search, final measures, tables. A sweep has several of them side by side.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::time::{Duration, Instant, SystemTime};

use cache::Store;
use descriptor::Descriptor;
use descriptor::structure::Structure;
use evolution::Exhaustive;
use results::{Counts, LookRow, PredictionSplit, RunFolder, RunRow, SetRow};

use crate::compare::Candidate;
use crate::compare::baselines;
use crate::console::say;
use crate::dataset::Dataset;
use crate::exhaust::{best_of_all, known_optimum};
use crate::experiment::Experiment;
use crate::fitness::{Fitness, Measured};
use crate::observers::tables;
use crate::reopen::winner_of;
use crate::result_cache::SearchCounts;
use crate::run::bounds::bounds;
use crate::run::contradiction::{check_used, contradicted, remembered_wrongly};
use crate::run::effective::effective_queries;
use crate::run::matching::Matching;
use crate::run::progress::Progress;
use crate::run::scaled::Scaled;
use crate::run::scales::MissingScales;
use crate::run::search::{SearchLoop, SearchResult};
use crate::run::search_space;
use crate::run::sets::{merge, with_weight};
use crate::run::splits::SplitBlobs;
use crate::run::summary::Summary;
use crate::run::{RunError, data_digest, front, rows, sets};
use crate::session::Session;
use crate::tasks;
use crate::trace::Attribute;
use crate::weighing::{TrainingClouds, file_text, teaching_sets};
use cluster::{Client, ClusterError};
use proto::task::{Evaluation, EvaluationResult};

/// A run and all that it needs.
pub struct RunDriver<'a> {
    /// What is run.
    pub experiment: &'a Experiment,
    /// On which clouds.
    pub dataset: &'a Dataset,
    /// By whom.
    pub session: &'a Session<'a>,
    /// Counts that earlier runs have left.
    pub remembered: &'a SearchCounts,
    /// Who asks.
    pub client: Client,
    /// Where the results go.
    pub folder: RunFolder,
    /// What is shown.
    pub progress: Progress,
    /// Since when.
    pub start: Start,
}

/// When a run was started.
#[derive(Clone, Copy, Debug)]
pub struct Start {
    /// This time.
    pub now: Instant,
    /// For the first time.
    pub first: SystemTime,
    /// How long it was at work before this time.
    pub before: Duration,
}

/// What a run has found.
pub struct Outcome {
    /// The search.
    pub found: SearchResult,
    /// The winner with weights for its values, where it was weighed.
    weighted: Option<Structure>,
    finals: Finals,
}

impl RunDriver<'_> {
    /// From the first generation to the winner's measures.
    pub async fn search(&mut self) -> Result<Outcome, RunError> {
        let recorded = self.session.trace.run(
            self.client.id(),
            &[
                ("descry.run.name", Attribute::Text(self.experiment.name().to_owned())),
                ("descry.run.seed", Attribute::Count(self.experiment.seed())),
            ],
        );
        let searched = self.search_until_right().await;
        match &searched {
            Ok(Outcome { found, .. }) => recorded.end(&[
                ("descry.stop_reason", Attribute::Text(found.stop_reason.as_str().to_owned())),
                ("descry.generations", Attribute::Count(found.generations.into())),
                ("descry.evaluations", Attribute::Count(found.computed)),
                ("descry.evaluations_remembered", Attribute::Count(found.remembered)),
            ]),
            Err(error) => recorded.fail(error),
        }
        searched
    }

    /// Once more whenever answers turn out to be wrong.
    async fn search_until_right(&mut self) -> Result<Outcome, RunError> {
        let Self { experiment, dataset, session, remembered, client, folder, progress, .. } = self;
        let mut remembered = remembered.begin(None); // a copy, from which wrong counts are dropped
        loop {
            let search = begin_search(experiment, dataset, session, client, progress).await?;
            progress.search_starts(folder.generations());
            let mut search_loop =
                SearchLoop::new(experiment, session, client, progress, &remembered, folder.path());
            match search_once(experiment, &mut search_loop, search, dataset, session, &remembered, folder)
                .await
            {
                // The search is deterministic: it comes back to where it was, by way of the answers that still hold.
                Err(RunError::Cluster(ClusterError::Corrected(tasks))) => search_loop.note_rewind(&tasks),
                Err(error @ RunError::WronglyRemembered { .. }) => {
                    client.note_rewind(1, error.to_string());
                    progress.say(&format!("back to generation 1: {error}"));
                    if let RunError::WronglyRemembered { wrong, .. } = error {
                        remembered.drop_wrong(&wrong);
                        session.forget(&wrong, progress.console());
                    }
                }
                done => return done,
            }
        }
    }

    /// Writes what has happened so far into the folder of a run that has failed: the cause may be in there. That it could
    /// not be written says less than the cause. Nothing is written where it cannot be looked up any more what the run has
    /// asked for.
    pub async fn tell_what_happened(&self) {
        if let Ok(rows) = tables::rows(&self.client).await {
            let _ = self.folder.write_log(&rows);
        }
    }

    /// Writes the tables; the run is finished with the last of them.
    pub async fn finish(&self, outcome: &Outcome) -> Result<Summary, RunError> {
        let (Self { experiment, dataset, folder, .. }, finals) = (self, &outcome.finals);
        folder.write_log(&tables::rows(&self.client).await?)?;
        folder.write_skipped(&rows::skipped(dataset))?;
        let front = front::rows(
            (experiment.space(), experiment.fitness()),
            &outcome.found.front,
            &outcome.found.winner,
        );
        if experiment.objectives().are_several() {
            folder.write_front(&front)?;
        }
        for (split, matching, result) in [
            (PredictionSplit::Validation, Matching::Validation, &finals.validation),
            (PredictionSplit::Test, Matching::Test, &finals.test),
        ] {
            if let Some(result) = result.as_ref().and_then(|measured| measured.matched.as_ref()) {
                folder.write_predictions(split, &rows::predictions(dataset, matching, result))?;
            }
        }
        let sets = finals.of_sets(dataset, &experiment.set_weights(dataset));
        if !sets.is_empty() {
            folder.write_sets(&sets)?;
        }
        let mut run = self.row(outcome);
        compare_with_optimum(&mut run, experiment, dataset, &self.session.store);
        let (compared, pairs) = match finals.evaluated() {
            Some(evaluated) => {
                baselines::compare(evaluated, &run, (dataset, experiment.preprocess()), folder)?
            }
            None => Default::default(),
        };
        let run_digest = folder.write_run(&run)?.to_hex().to_string();
        Ok(Summary {
            winner: winner_of(experiment.space(), &run).ok(),
            run,
            run_digest,
            front,
            family: experiment.space().family(),
            skipped: dataset.clouds.skipped.len(),
            descriptors: experiment.space().size(),
            compared,
            pairs,
            sets,
            bounds: bounds(experiment.space(), &outcome.found.descriptor),
            out: folder.path().to_owned(),
        })
    }

    fn row(&self, Outcome { found, weighted, finals }: &Outcome) -> RunRow {
        let Self { experiment, dataset, start, .. } = self;
        let weights = experiment.set_weights(dataset);
        let effective = |matching, counts: Counts| {
            effective_queries(dataset, (experiment.fitness(), &weights), matching, counts.queries)
        };
        let validation =
            finals.validation.as_ref().map(|measured| measured.counts(dataset, Matching::Validation));
        RunRow {
            name: experiment.name().to_owned(),
            search_config: experiment.search_toml(),
            resolved_toml: experiment.record_toml(),
            seed: experiment.seed(),
            data_digest: data_digest(dataset),
            evaluation_version: descriptor::EVALUATION_VERSION,
            program_version: env!("CARGO_PKG_VERSION").to_owned(),
            build: worker::BUILD.to_owned(),
            host: transport::host_name(),
            started_at: start.first,
            finished_at: SystemTime::now(),
            seconds: (start.before + start.now.elapsed()).as_secs_f64(),
            stop_reason: found.stop_reason.as_str().to_owned(),
            generations: found.generations,
            evaluations_computed: found.computed,
            evaluations_remembered: found.remembered,
            winner_generation: found.winner.generation,
            winner_individual: found.winner.index,
            best_chromosome: found.winner.individual.bit_string(),
            best_genes: experiment.space().values(&found.descriptor),
            train: found.train.counts,
            train_margin: found.train.margin,
            train_effective: effective(Matching::Train, found.train.counts),
            validation,
            validation_effective: validation.and_then(|counts| effective(Matching::Validation, counts)),
            weighted_winner: weighted.as_ref().map(file_text),
            weighted_train: finals.weighted.as_ref().map(|measured| measured.measured.counts),
            test: finals.test.as_ref().map(|measured| measured.counts(dataset, Matching::Test)),
            grid_best_object_correct: None,
        }
    }
}

/// One attempt at it, unless answers turn out to be wrong.
async fn search_once(
    experiment: &Experiment,
    search_loop: &mut SearchLoop<'_>,
    search: evolution::Search,
    dataset: &Dataset,
    session: &Session<'_>,
    remembered: &SearchCounts,
    folder: &mut RunFolder,
) -> Result<Outcome, RunError> {
    let found = search_loop.run(search, folder).await?;
    let (client, progress) = search_loop.client_and_progress();
    let weighted = weighted(experiment, dataset, &found, progress).await?;
    let winner = weighted
        .as_ref()
        .map_or(Cow::Borrowed(&found.descriptor), |one| Cow::Owned(Descriptor::Structure(one.clone())));
    let candidates = baselines::candidates(&winner, experiment);
    if experiment.compares_baselines() && candidates.len() == 1 {
        progress.say("clouds without colours: no baseline describes them, so that the winner stands alone");
    }
    if !Matching::Test.query_clouds(dataset).is_empty() {
        folder.record_look(&LookRow {
            at: SystemTime::now(),
            command: "run".to_owned(),
            reason: "final test of the winner".to_owned(),
            descriptors: candidates.iter().map(|one| one.label.as_str()).collect::<Vec<_>>().join(" "),
        })?;
    }
    let finals = Finals::evaluate(
        experiment,
        (candidates, weighted.is_some()),
        session,
        &found,
        remembered,
        (client, progress),
    )
    .await?;
    check_used(&session.cluster, &found.counts)?;
    Ok(Outcome { found, weighted, finals })
}

/// The winner with weights for its values, where the experiment wants some: learned here, from clouds that the workers have,
/// too, so that nobody has to be believed.
async fn weighted(
    experiment: &Experiment,
    dataset: &Dataset,
    found: &SearchResult,
    progress: &mut Progress,
) -> Result<Option<Structure>, RunError> {
    let (Descriptor::Structure(structure), Some(how)) = (&found.descriptor, experiment.weighs()) else {
        return Ok(None);
    };
    progress.say("weighing the values of the winner by the training clouds");
    let sets = teaching_sets(dataset, &experiment.set_weights(dataset));
    let (structure, preprocess) = (structure.clone(), *experiment.preprocess());
    let weigh = move || -> Result<Structure, RunError> {
        Ok(TrainingClouds::describe(&sets, &preprocess, &structure)?.weigh(&structure, how)?)
    };
    let weighed = tokio::task::spawn_blocking(weigh).await;
    weighed.unwrap_or_else(|error| std::panic::resume_unwind(error.into_panic())).map(Some)
}

/// The experiment's search, at generation 1.
async fn begin_search(
    experiment: &Experiment,
    dataset: &Dataset,
    session: &Session<'_>,
    client: &mut Client,
    progress: &mut Progress,
) -> Result<evolution::Search, RunError> {
    let strategy = match search_space::strategy(experiment)? {
        Some(strategy) => strategy,
        None => {
            let best = best_of_all(experiment, dataset, session, client, progress).await?;
            let best = experiment.space().encode(&best.descriptor());
            let genome = search_space::genome(experiment.space(), experiment.encoding());
            Box::new(Exhaustive::new(best.expect("the best of the search space lies in it"), &genome))
        }
    };
    Ok(evolution::Search::new(strategy, *experiment.stop(), experiment.winner()))
}

/// Notes how good the best descriptor there is would have been, if that is known.
pub fn compare_with_optimum(run: &mut RunRow, experiment: &Experiment, dataset: &Dataset, store: &Store) {
    let Some(optimum) = known_optimum(experiment, dataset, store) else {
        run.grid_best_object_correct = None;
        return;
    };
    let (best, winner) = (optimum.object_correct, run.train.object_correct);
    // What the run has beaten is no optimum, nor is what it finds to be worse than the grid says.
    let is_winner = optimum.descriptor().values() == run.best_genes;
    let is_wrong = best < winner || is_winner && best != winner;
    if is_wrong {
        say(format_args!(
            "warning: grid: the optimum that is known recognises {best} clouds, the winner {winner}: the grid is wrong\nevaluate it again: coordinator exhaust --fresh"
        ));
    }
    run.grid_best_object_correct = (!is_wrong).then_some(best);
}

/// The winner on the sets that had no part in the search; and on the training sets once more, so that no winner rests
/// on counts that another run has left.
struct Finals {
    validation: Option<Final>,
    /// With weights, if it has some.
    test: Option<Final>,
    /// With weights on the training sets; `None` if it has none.
    weighted: Option<Final>,
    /// What the winner is compared with, and the winner first.
    candidates: Vec<Candidate>,
    /// Of each candidate but the winner on the test clouds.
    baselines: Vec<EvaluationResult>,
}

/// The winner on the clouds of one matching.
struct Final {
    measured: Measured,
    /// With each query's match, unless the set was matched by another rule than the paper's: then a query has no nearest
    /// cloud of the whole database.
    matched: Option<EvaluationResult>,
}

impl Final {
    /// From the results of a matching's evaluations, with their weights; `None` if there are none. `merge`: of results
    /// with matches, one of each set of clouds.
    fn of(
        results: Vec<EvaluationResult>,
        weights: &[u32],
        merge: impl FnOnce(Vec<EvaluationResult>) -> EvaluationResult,
    ) -> Option<Self> {
        let weighted = results.iter().zip(weights);
        let counted = weighted.map(|(result, &weight)| (rows::counts(result), result.margin, weight));
        let measured = Measured::sum(counted);
        let has_matches = !results.first()?.matches.is_empty();
        Some(Self { measured, matched: has_matches.then(|| merge(results)) })
    }

    fn counts(&self, dataset: &Dataset, matching: Matching) -> Counts {
        match &self.matched {
            Some(result) => rows::recount(dataset, matching, result),
            None => self.measured.counts,
        }
    }
}

impl Finals {
    /// Each candidate on the test clouds of each set.
    fn of_sets(&self, dataset: &Dataset, weights: &[u32]) -> Vec<SetRow> {
        let winner = self.test.as_ref().and_then(|test| test.matched.as_ref());
        let measured = self.candidates.iter().zip(winner.into_iter().chain(&self.baselines));
        measured.flat_map(|(one, result)| sets::rows(dataset, weights, &one.label, result)).collect()
    }

    /// The candidates and their evaluations on the test clouds; `None` if there are no such clouds, or nothing to compare
    /// the winner with.
    fn evaluated(&self) -> Option<impl Iterator<Item = (&Candidate, &EvaluationResult)>> {
        let winner = self.test.as_ref()?.matched.as_ref().filter(|_| !self.baselines.is_empty())?;
        Some(self.candidates.iter().zip(std::iter::once(winner).chain(&self.baselines)))
    }

    /// Of candidates of which the first is the winner, with weights or not.
    async fn evaluate(
        experiment: &Experiment,
        (candidates, is_weighted): (Vec<Candidate>, bool),
        session: &Session<'_>,
        found: &SearchResult,
        remembered: &SearchCounts,
        (client, progress): (&mut Client, &mut Progress),
    ) -> Result<Self, RunError> {
        let Session { cluster, splits, .. } = session;
        let (fitness, dataset) = (experiment.fitness(), splits.dataset());
        let (weights, tested) = (experiment.set_weights(dataset), splits.sets_with_queries(Matching::Test));
        let (tested, mut scales): (Vec<u32>, _) = (tested.collect(), found.scales.clone());
        // The first candidate is the winner with its weights, if it has some.
        let (winner, last) = (&found.descriptor, &candidates[0].descriptor);
        let space = (experiment.preprocess(), experiment.space());
        let splits_of_last = splits.beside(last, space);
        // Those of sets that the search has left out.
        scales.complete(&[winner], &tested, splits, client, |news| progress.news(news)).await?;
        if is_weighted {
            let sets: BTreeSet<u32> = with_weight(&weights).into_iter().chain(tested.clone()).collect();
            let sets: Vec<u32> = sets.into_iter().collect();
            scales.complete(&[last], &sets, &splits_of_last, client, |news| progress.news(news)).await?;
        }
        splits.publish_test(&cluster.blobs);
        let is_summed = *fitness != Fitness::PAPER || splits.sets().len() > 1;
        let none_missing = MissingScales::default();
        let scaled = |set, descriptor| scales.of(set, descriptor, &none_missing);
        let measure = |splits: &SplitBlobs<'_>, descriptor, matching| {
            let parts = splits.measure((fitness, &weights), |set| scaled(set, descriptor), matching);
            parts.into_iter().map(|(part, weight)| (part.evaluation, weight)).collect()
        };
        let plain = |splits: &SplitBlobs<'_>, descriptor, matching| {
            let in_set = |set| (splits.evaluation(set, &scaled(set, descriptor), matching, true), 1);
            splits.sets_with_queries(matching).map(in_set).collect()
        };
        let asked: [Vec<(Evaluation, u32)>; 4] = [
            if is_summed {
                measure(splits, winner, Matching::Validation)
            } else {
                plain(splits, winner, Matching::Validation)
            },
            plain(&splits_of_last, last, Matching::Test),
            measure(splits, winner, Matching::Train),
            if is_weighted { measure(&splits_of_last, last, Matching::Train) } else { Vec::new() },
        ];
        let weights =
            asked.each_ref().map(|parts| parts.iter().map(|&(_, weight)| weight).collect::<Vec<_>>());
        let beside = |one: &Candidate| {
            let (splits, one) = (splits.beside(&one.descriptor, space), Scaled::from(&one.descriptor));
            let in_set = |&set| splits.evaluation(set, &one, Matching::Test, true);
            tested.iter().map(in_set).collect::<Vec<_>>()
        };
        let baselines: Vec<Evaluation> = candidates.iter().skip(1).flat_map(beside).collect();
        let evaluations =
            asked.into_iter().flatten().map(|(evaluation, _)| evaluation).chain(baselines).collect();
        let finished = client.evaluate(evaluations, |news| progress.news(news)).await?;
        // What the run ends with rests on nobody's word alone.
        for descriptor in candidates.iter().map(|one| &one.descriptor).chain([winner]) {
            client.confirm(&tasks::descriptor_bytes(descriptor));
        }
        client.confirmed(|news| progress.news(news)).await?;
        let mut results = finished.into_iter().map(|finished| finished.result);
        let mut of = |matching, weights: &[u32]| {
            let results = results.by_ref().take(weights.len()).collect();
            Final::of(results, weights, |results| {
                merge(dataset, matching, splits.sets_with_queries(matching).zip(results))
            })
        };
        let [validation, test, training, weighted] = [
            of(Matching::Validation, &weights[0]),
            of(Matching::Test, &weights[1]),
            of(Matching::Train, &weights[2]),
            of(Matching::Train, &weights[3]),
        ];
        let validated = found.counts.validation.get(winner)?;
        let known = [
            (Matching::Train, Some(found.train), &remembered.train, &training),
            (Matching::Validation, validated, &remembered.validation, &validation),
        ];
        for (matching, held, remembered, computed) in known {
            let (Some(held), Some(Final { measured: computed, .. })) = (held, computed) else { continue };
            if held != *computed {
                let (held, computed) = (&held.counts, &computed.counts);
                return Err(match remembered.unused.get(winner) {
                    Some(source) => remembered_wrongly(cluster, winner, matching, (held, source), computed),
                    None => contradicted(winner, matching, held, computed),
                });
            }
        }
        let results: Vec<EvaluationResult> = results.collect();
        let of_all = |of_sets: &[EvaluationResult]| {
            merge(dataset, Matching::Test, tested.iter().copied().zip(of_sets.iter().cloned()))
        };
        let baselines = results.chunks(tested.len().max(1)).map(of_all).collect();
        Ok(Self { validation, test, weighted, candidates, baselines })
    }
}
