//! The search loop: has each generation of a search evaluated and writes it to the run folder, until the search ends.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use descriptor::Descriptor;
use evolution::{Found, Individual, Score, Search, StopReason};
use results::RunFolder;

use crate::experiment::Experiment;
use crate::fitness::Measured;
use crate::result_cache::{MatchingCounts, SearchCounts, Wrong};
use crate::run::RunError;
use crate::run::contradiction::{check_used, remembered_wrongly};
use crate::run::fitness_batch::{Answer, FitnessBatch};
use crate::run::fitness_check::nothing_recognised;
use crate::run::foresight::{EarlyEvaluations, Foresight};
use crate::run::front::FrontPoint;
use crate::run::matching::Matching;
use crate::run::met::Met;
use crate::run::progress::{GenerationReport, Progress};
use crate::run::rows;
use crate::run::scales::Scales;
use crate::run::search_space::decode;
use crate::run::splits::ONLY_SET;
use crate::session::Session;
use crate::tasks;
use crate::trace::Attribute;
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
    pub winner: Found,
    /// The descriptor that the winner stands for.
    pub descriptor: Descriptor,
    /// The winner by the fitness.
    pub train: Measured,
    /// Individuals that a worker evaluated.
    pub computed: u64,
    /// Individuals whose descriptor had been evaluated before.
    pub remembered: u64,
    /// All counts that the search has used.
    pub counts: SearchCounts,
    /// The scales that it has used.
    pub scales: Scales,
    /// The front of a search of several objectives; of others empty.
    pub front: Vec<FrontPoint>,
}

/// The driver of one search.
pub struct SearchLoop<'a> {
    experiment: &'a Experiment,
    session: &'a Session<'a>,
    client: &'a mut Client,
    progress: &'a mut Progress,
    /// Counts of earlier runs and of this one: no descriptor is evaluated twice.
    counts: SearchCounts,
    scales: Scales,
    met: Met,
    /// Descriptors whose counts another principal has confirmed or is asked to.
    confirmed: BTreeSet<DescriptorBytes>,
    /// Of the descriptors that are too costly, what the cheapest costs.
    least_cost: u64,
    computed: u64,
    remembered: u64,
    /// What workers do that the current generation leaves idle.
    early: EarlyEvaluations<'a>,
}

impl<'a> SearchLoop<'a> {
    /// A loop before its first generation. `remembered` counts of earlier runs are not computed again, except those that an
    /// earlier start of this run has computed: they stay its own, whatever other runs have stored since. What it has no
    /// memory for goes to files in the run's folder.
    pub fn new(
        experiment: &'a Experiment,
        session: &'a Session<'a>,
        client: &'a mut Client,
        progress: &'a mut Progress,
        remembered: &SearchCounts,
        folder: &Path,
    ) -> Self {
        let mut cached = remembered.begin(Some(folder));
        let Session { cluster, splits, .. } = session;
        if cluster.has_past() {
            for (matching, counts) in
                [(Matching::Train, &mut cached.train), (Matching::Validation, &mut cached.validation)]
            {
                // Only families without scales are remembered, and clouds of one set.
                counts.drop_unused(|descriptor, _| {
                    cluster.recalls(splits.evaluation(ONLY_SET, &descriptor.into(), matching, false))
                });
            }
        }
        let early = EarlyEvaluations::new(experiment, session, client.id());
        Self {
            experiment,
            session,
            client,
            progress,
            counts: cached,
            scales: Scales::default(),
            met: Met::new(folder),
            confirmed: BTreeSet::new(),
            least_cost: u64::MAX,
            computed: 0,
            remembered: 0,
            early,
        }
    }

    /// The client that evaluates for the search, and the display of the run.
    pub fn client_and_progress(&mut self) -> (&mut Client, &mut Progress) {
        (self.client, self.progress)
    }

    /// Logs to which generation the corrected answers take the run back.
    pub fn note_rewind(&self, tasks: &[Arc<Task>]) {
        let generation = |task: &Arc<Task>| self.met.generation(&task.subject().descriptor).ok().flatten();
        let generation = tasks.iter().filter_map(generation).min().unwrap_or(1);
        let why = format!("{} answers of a worker that was wrong are corrected", tasks.len());
        self.progress.say(&format!("back to generation {generation}: {why}"));
        self.client.note_rewind(generation, why);
    }

    /// Evaluates generation after generation until the search ends, and writes each to the run folder.
    pub async fn run(&mut self, search: Search, folder: &mut RunFolder) -> Result<SearchResult, RunError> {
        let done = self.generations(search, folder).await;
        self.early.take().shutdown().await;
        done
    }

    async fn generations(
        &mut self,
        mut search: Search,
        folder: &mut RunFolder,
    ) -> Result<SearchResult, RunError> {
        loop {
            let started = Instant::now();
            let generation = search.generation();
            self.progress.generation_starts(generation, self.met.count());
            let recorded = self.session.trace.generation(self.client.id(), generation);
            let descriptors = self.descriptors_within_budget(&search)?;
            search.keep_first(descriptors.len());
            let population = search.ask().to_vec();
            self.drop_wrong()?;
            let computed = self.evaluate_new(&search, &descriptors).await?;
            let measured = descriptors.iter().map(|descriptor| self.counts.train.measured(descriptor));
            let measured: Vec<Measured> = measured.collect::<Result<_, _>>()?;
            let (experiment, fitness) = (self.experiment, self.experiment.fitness());
            let scored = descriptors.iter().zip(&measured);
            let scores: Vec<Score> =
                scored.map(|(descriptor, measured)| experiment.score(descriptor, measured)).collect();
            let validation = match search.to_validate(&scores) {
                Some(index) => {
                    let next;
                    (search, next) = self.foresee(search, &scores).await;
                    self.validate(&[&descriptors[index as usize]], next).await?.pop()
                }
                None => None,
            };
            let validation_score = validation.as_ref().map(|measured| fitness.score(measured));
            let (told, evaluations) = (scores.clone(), self.met.count());
            let state;
            (search, state) =
                apart(search, move |search| search.tell(&told, validation_score, evaluations)).await;

            let set_errors = descriptors.iter().map(|descriptor| self.met.set_errors(descriptor));
            let set_errors: Vec<Option<Vec<f32>>> = set_errors.collect::<Result<_, _>>()?;
            let individuals = rows::evaluations(
                (experiment.space(), fitness),
                generation,
                &population,
                &descriptors,
                &measured,
                set_errors,
                &computed,
            );
            let row = results::GenerationRow {
                generation,
                best_so_far_fitness: state.best_so_far.fitness(),
                validation: validation.map(|measured| measured.counts),
                validation_margin: validation.and_then(|measured| measured.margin),
                hypervolume: experiment.objectives().hypervolume(search.front(), scores[0].queries),
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
                let error = |score: &Score| 1.0 - score.fitness();
                self.progress.generation_done(&GenerationReport {
                    generation,
                    errors: &scores.iter().map(error).collect::<Vec<_>>(),
                    best: &descriptors[state.best as usize],
                    improved: state.improved,
                    validation: validation_score.as_ref().map(error),
                    met: self.met.count(),
                });
            }

            self.progress.told(generation, state.best_so_far.fitness());
            recorded.end(&[
                ("descry.individuals", Attribute::Count(measured.len() as u64)),
                ("descry.evaluations", Attribute::Count(computed.len() as u64)),
                ("descry.best_fitness", Attribute::Share(state.best_so_far.fitness())),
            ]);
            // Whoever is best decides what comes next: more than one has to say so.
            self.confirm(&descriptors[state.best as usize]);
            if let Some(stop_reason) = state.stop {
                return self.result(&search, state.winner, (generation, stop_reason)).await;
            }
        }
    }

    /// What a search that ends has found. With several objectives, the winner is the best of the front; else it is `last`,
    /// the best so far.
    async fn result(
        &mut self,
        search: &Search,
        last: Found,
        (generations, stop_reason): (u32, StopReason),
    ) -> Result<SearchResult, RunError> {
        self.drop_wrong()?;
        let experiment = self.experiment;
        let front = self.front(search).await?;
        front.iter().for_each(|point| self.confirm(&point.descriptor));
        let points = front.iter().map(|point| point.found.clone());
        let first = points.reduce(|leader, point| point.or_leader(Some(leader), experiment.winner()));
        let winner = first.unwrap_or(last);
        let descriptor = decode(experiment.space(), &winner.individual);
        if let Some(max_cost) = experiment.max_cost().filter(|_| !experiment.affords(&descriptor)) {
            return Err(RunError::TooCostly { max_cost, least: self.least_cost });
        }
        Ok(SearchResult {
            stop_reason,
            generations,
            train: self.counts.train.measured(&descriptor)?,
            winner,
            front,
            descriptor,
            computed: self.computed,
            remembered: self.remembered,
            counts: std::mem::take(&mut self.counts),
            scales: std::mem::take(&mut self.scales),
        })
    }

    /// Has what the run knows of a descriptor confirmed, once.
    fn confirm(&mut self, descriptor: &Descriptor) {
        let bytes = tasks::descriptor_bytes(descriptor);
        if !self.confirmed.contains(&bytes) {
            self.client.confirm(&bytes);
            self.confirmed.insert(bytes);
        }
    }

    /// What the individuals of the current generation stand for, up to the last that the budget of evaluations allows.
    fn descriptors_within_budget(&mut self, search: &Search) -> Result<Vec<Descriptor>, ClusterError> {
        let mut left = search.evaluations_left(self.met.count());
        let mut descriptors = Vec::with_capacity(search.ask().len());
        for individual in search.ask() {
            let descriptor = decode(self.experiment.space(), individual);
            if !self.experiment.affords(&descriptor) {
                self.least_cost = self.least_cost.min(self.experiment.limited_cost(&descriptor));
            } else if !self.met.contains(&descriptor)? {
                if left == Some(0) {
                    break;
                }
                left = left.map(|left| left - 1);
                self.met.insert(&descriptor, search.generation());
            }
            descriptors.push(descriptor);
        }
        Ok(descriptors)
    }

    /// Evaluates the descriptors that are new and returns, for the first individual with each of them, who computed
    /// it.
    async fn evaluate_new(
        &mut self,
        search: &Search,
        descriptors: &[Descriptor],
    ) -> Result<BTreeMap<usize, Finished<EvaluationResult>>, RunError> {
        let new = self.take_new(descriptors.iter(), Matching::Train)?;
        self.computed += new.len() as u64;
        self.remembered += (descriptors.len() - new.len()) as u64;
        self.use_remembered(descriptors.iter(), Matching::Train).await?;
        let mut foresight = self.foresight(search, descriptors, &new)?;
        let descriptors: Vec<&Descriptor> = new.iter().map(|&(_, descriptor)| descriptor).collect();
        // What was foreseen is asked for now; before that it must not be given up.
        let mut foreseen = self.early.take();
        let experiment = self.experiment;
        let foresee = |measured: &[(usize, Measured)]| {
            for &(index, ref measured) in measured {
                foresight.take(index, experiment.score(descriptors[index], measured));
            }
            foresight.individuals()
        };
        let finished = self.measure(&descriptors, Matching::Train, foresee).await?;
        foreseen.shutdown().await;
        self.progress.counted(self.computed, self.remembered);
        let mut computed = BTreeMap::new();
        for ((index, descriptor), Answer { measured, set_errors, first }) in new.into_iter().zip(finished) {
            self.counts.train.insert(descriptor, measured);
            if let Some(errors) = set_errors {
                self.met.insert_set_errors(descriptor, &errors);
            }
            computed.insert(index, first);
        }
        Ok(computed)
    }

    /// What can be foreseen while the descriptors that are `new` are evaluated, each with the first individual of the
    /// generation that stands for it.
    fn foresight<'s>(
        &self,
        search: &'s Search,
        descriptors: &[Descriptor],
        new: &[(usize, &Descriptor)],
    ) -> Result<Foresight<'s>, ClusterError> {
        let places: BTreeMap<&Descriptor, usize> =
            new.iter().map(|&(_, descriptor)| descriptor).zip(0..).collect();
        let mut waiting = vec![Vec::new(); new.len()];
        let score = |(index, descriptor)| match places.get(descriptor) {
            Some(&place) => {
                waiting[place].push(index);
                Ok(None)
            }
            None => {
                let measured = self.counts.train.measured(descriptor)?;
                Ok(Some(self.experiment.score(descriptor, &measured)))
            }
        };
        let scores = descriptors.iter().enumerate().map(score).collect::<Result<_, ClusterError>>()?;
        Ok(Foresight::new(search, self.met.count(), (scores, waiting)))
    }

    /// Uses what earlier runs have left of these descriptors, a share of it only after it was computed again.
    ///
    /// # Errors
    /// As [`remembered_wrongly`], where something else was computed.
    async fn use_remembered<'d>(
        &mut self,
        descriptors: impl Iterator<Item = &'d Descriptor>,
        matching: Matching,
    ) -> Result<(), RunError> {
        let Self { client, progress, session, counts, .. } = self;
        let known = if matching == Matching::Train { &mut counts.train } else { &mut counts.validation };
        let (mut checked, mut asked) = (Vec::new(), Vec::new());
        for descriptor in descriptors {
            let Some(source) = known.unused.remove(descriptor) else { continue };
            counts.used.insert(Arc::clone(&source));
            // Another task than that of the search, of which the next start must not find an answer.
            let evaluation = session.splits.evaluation(ONLY_SET, &descriptor.into(), matching, true);
            if session.cluster.spot_checks(&Task::Evaluation(evaluation.clone())) {
                checked.push((descriptor, known.measured(descriptor)?.counts, source));
                asked.push(evaluation);
            }
        }
        if asked.is_empty() {
            return Ok(());
        }
        let computed = client.evaluate(asked, |news| progress.news(news)).await?;
        let computed = computed.iter().map(|finished| rows::counts(&finished.result));
        let differing: Vec<_> = checked
            .into_iter()
            .zip(computed)
            .filter(|((_, remembered, _), computed)| remembered != computed)
            .collect();
        for ((descriptor, ..), _) in &differing {
            client.confirm(&tasks::descriptor_bytes(descriptor));
        }
        // What was computed now may be as wrong: then it is corrected, and the search begins again.
        client.confirmed(|news| progress.news(news)).await?;
        match differing.into_iter().next() {
            Some(((descriptor, remembered, source), computed)) => Err(remembered_wrongly(
                &session.cluster,
                descriptor,
                matching,
                (&remembered, &source),
                &computed,
            )),
            None => Ok(()),
        }
    }

    /// Drops what principals that were found to be wrong by now have left in earlier runs.
    ///
    /// # Errors
    /// If some of it was used.
    fn drop_wrong(&mut self) -> Result<(), RunError> {
        let cluster = &self.session.cluster;
        self.counts.drop_wrong(&Wrong::principals(cluster.quarantined()));
        check_used(cluster, &self.counts)
    }

    /// The individuals of the next generation that will be evaluated, as far as it is certain that there is one.
    async fn foresee(&self, search: Search, scores: &[Score]) -> (Search, Vec<Individual>) {
        let met = self.met.count();
        let (mut left, scores) = (search.evaluations_left(met), scores.to_vec());
        let (search, next) =
            apart(search, move |search| search.foresee(&scores, met).map(<[_]>::to_vec)).await;
        let mut next = next.unwrap_or_default();
        next.retain(|individual| {
            let descriptor = decode(self.experiment.space(), individual);
            // What cannot be looked up is not foreseen: it is told where the search itself asks.
            let is_known = self.counts.train.contains(&descriptor).unwrap_or(true);
            let is_new = !is_known && left != Some(0);
            left = left.map(|left| left - u64::from(is_new));
            is_new
        });
        (search, next)
    }

    /// Measures descriptors by the fitness, and finds the scales that they lack. `foresee` says which individuals are certain
    /// by now, when it is told which descriptors have what; these are evaluated beforehand.
    async fn measure(
        &mut self,
        descriptors: &[&Descriptor],
        matching: Matching,
        mut foresee: impl FnMut(&[(usize, Measured)]) -> Vec<Individual>,
    ) -> Result<Vec<Answer>, ClusterError> {
        let Self { client, progress, scales, session, experiment, counts, early, .. } = self;
        let known = &counts.train;
        let weights = experiment.set_weights(session.splits.dataset());
        let fitness = (experiment.fitness(), &weights[..]);
        let batch = FitnessBatch::new(fitness, &session.splits, scales, descriptors, matching);
        let watch = |news: &ClusterNews, evaluated: u64, measured: &[(usize, Measured)]| {
            match matching {
                Matching::Train => progress.evaluated(news, evaluated),
                Matching::Validation | Matching::Test => progress.news(news),
            }
            early.evaluate(&foresee(measured), known, scales);
        };
        let (answers, found) = batch.evaluate(client, watch).await?;
        scales.add(found);
        Ok(answers)
    }

    /// What is known on the training or the validation clouds. Test clouds are no part of a search.
    fn known(&mut self, matching: Matching) -> &mut MatchingCounts {
        match matching {
            Matching::Train => &mut self.counts.train,
            Matching::Validation | Matching::Test => &mut self.counts.validation,
        }
    }

    /// Those of these descriptors that are to be evaluated, each once, with its first place; what costs too much recognises
    /// nothing.
    fn take_new<'d>(
        &mut self,
        descriptors: impl Iterator<Item = &'d Descriptor>,
        matching: Matching,
    ) -> Result<Vec<(usize, &'d Descriptor)>, ClusterError> {
        let (mut new, mut seen, mut nothing) = (Vec::new(), BTreeSet::new(), None);
        for (index, descriptor) in descriptors.enumerate() {
            if self.known(matching).contains(descriptor)? {
                continue;
            }
            if !self.experiment.affords(descriptor) {
                let nothing = *nothing.get_or_insert_with(|| self.nothing_recognised(matching));
                self.known(matching).insert(descriptor, nothing);
            } else if seen.insert(descriptor) {
                new.push((index, descriptor));
            }
        }
        Ok(new)
    }

    fn nothing_recognised(&self, matching: Matching) -> Measured {
        nothing_recognised(self.experiment, self.session.splits.dataset(), matching)
    }

    /// Descriptors on the validation set. Meanwhile, the individuals that are evaluated `next` are begun with.
    async fn validate(
        &mut self,
        descriptors: &[&Descriptor],
        mut next: Vec<Individual>,
    ) -> Result<Vec<Measured>, RunError> {
        let new = self.take_new(descriptors.iter().copied(), Matching::Validation)?;
        let new: Vec<&Descriptor> = new.into_iter().map(|(_, descriptor)| descriptor).collect();
        self.use_remembered(descriptors.iter().copied(), Matching::Validation).await?;
        let finished = self.measure(&new, Matching::Validation, |_| std::mem::take(&mut next)).await?;
        for (descriptor, Answer { measured, .. }) in new.into_iter().zip(finished) {
            self.counts.validation.insert(descriptor, measured);
        }
        let measured = descriptors.iter().map(|descriptor| self.counts.validation.measured(descriptor));
        Ok(measured.collect::<Result<_, _>>()?)
    }

    /// The front of a search of several objectives, each point on the validation set if there is one.
    async fn front(&mut self, search: &Search) -> Result<Vec<FrontPoint>, RunError> {
        if !self.experiment.objectives().are_several() {
            return Ok(Vec::new());
        }
        let points = search.front().points();
        let space = self.experiment.space();
        let descriptors: Vec<Descriptor> =
            points.iter().map(|point| decode(space, &point.individual)).collect();
        let has_validation = !self.session.splits.dataset().splits.validation.is_empty();
        let validated = if has_validation {
            self.validate(&descriptors.iter().collect::<Vec<_>>(), Vec::new())
                .await?
                .into_iter()
                .map(Some)
                .collect()
        } else {
            vec![None; points.len()]
        };
        let fitness = self.experiment.fitness();
        let mut front = Vec::with_capacity(points.len());
        for ((found, descriptor), validation) in points.iter().zip(descriptors).zip(validated) {
            let score = validation.as_ref().map(|measured| fitness.score(measured));
            let found = Found { validation: score, ..found.clone() };
            let train = self.counts.train.measured(&descriptor)?;
            front.push(FrontPoint { found, train, descriptor, validation });
        }
        Ok(front)
    }
}

/// Takes a step of a search on another thread: to make a generation may take as long as to evaluate it, and other runs
/// of a sweep are driven by the same task.
async fn apart<T: Send + 'static>(
    mut search: Search,
    step: impl FnOnce(&mut Search) -> T + Send + 'static,
) -> (Search, T) {
    let taken = tokio::task::spawn_blocking(move || {
        let told = step(&mut search);
        (search, told)
    });
    taken.await.unwrap_or_else(|error| std::panic::resume_unwind(error.into_panic()))
}
