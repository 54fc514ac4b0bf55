//! What is certain of the next generation before the current one is over, and is evaluated beforehand.

use std::collections::BTreeSet;
use std::ops::Range;

use descriptor::Descriptor;
use evolution::{Individual, Score, Search};
use tokio::task::JoinSet;

use crate::experiment::Experiment;
use crate::result_cache::MatchingCounts;
use crate::run::fitness_batch::FitnessBatch;
use crate::run::matching::Matching;
use crate::run::scales::Scales;
use crate::run::search_space::decode;
use crate::session::Session;
use cluster::scheduler::ClientId;

/// A generation that is being evaluated. Parts of it that have children of their own are looked at as soon as they have their
/// scores.
pub struct Foresight<'a> {
    search: &'a Search,
    /// How many different individuals have been evaluated when it is over.
    evaluations: u64,
    scores: Vec<Option<Score>>,
    /// The best of them, kept as they come: a generation may have many thousands of individuals, and each brings news.
    best: Option<Score>,
    /// Of each descriptor that is being evaluated the individuals that stand for it.
    waiting: Vec<Vec<usize>>,
    open: Vec<Part>,
}

/// A part of a generation of which it is not certain yet what follows.
struct Part {
    number: usize,
    /// Its individuals.
    place: Range<usize>,
    /// How many of them lack scores.
    lacking: usize,
}

impl<'a> Foresight<'a> {
    /// Of the current generation, in which `scores` are known and the others `waiting` for descriptors that are being
    /// evaluated.
    pub fn new(
        search: &'a Search,
        evaluations: u64,
        (scores, waiting): (Vec<Option<Score>>, Vec<Vec<usize>>),
    ) -> Self {
        let part = |(number, place): (usize, Range<usize>)| {
            let lacking = scores[place.clone()].iter().filter(|score| score.is_none()).count();
            Part { number, place, lacking }
        };
        let open = search.parts(evaluations).into_iter().enumerate().map(part).collect();
        let best = scores.iter().flatten().copied().reduce(Score::or_better);
        Self { search, evaluations, scores, best, waiting, open }
    }

    /// A descriptor that was evaluated has this score.
    pub fn take(&mut self, descriptor: usize, score: Score) {
        for individual in std::mem::take(&mut self.waiting[descriptor]) {
            let before = self.scores[individual].replace(score);
            self.best = Some(self.best.map_or(score, |best| best.or_better(score)));
            if before.is_none()
                && let Some(part) = self.open.iter_mut().find(|part| part.place.contains(&individual))
            {
                part.lacking -= 1;
            }
        }
    }

    /// The individuals of the next generation that are certain by now and were not before.
    pub fn individuals(&mut self) -> Vec<Individual> {
        let Self { search, evaluations, scores, best: Some(best), open, .. } = self else {
            return Vec::new();
        };
        let mut certain = Vec::new();
        open.retain(|Part { number, place, lacking }| {
            if *lacking > 0 {
                return true;
            }
            let scores: Vec<Score> = scores[place.clone()].iter().flatten().copied().collect();
            let follow = search.foresee_part(*number, &scores, (*best, *evaluations));
            let is_open = follow.is_none();
            certain.extend(follow.into_iter().flatten());
            is_open
        });
        certain
    }
}

/// Has descriptors evaluated before the search asks for them, by workers that have nothing else to do.
pub struct EarlyEvaluations<'a> {
    experiment: &'a Experiment,
    session: &'a Session<'a>,
    /// The client that will ask for them.
    owner: ClientId,
    clients: JoinSet<()>,
}

impl<'a> EarlyEvaluations<'a> {
    /// For a client that searches.
    pub fn new(experiment: &'a Experiment, session: &'a Session<'a>, owner: ClientId) -> Self {
        Self { experiment, session, owner, clients: JoinSet::new() }
    }

    /// Has what these individuals stand for evaluated, as far as it is not known.
    pub fn evaluate(&mut self, individuals: &[Individual], known: &MatchingCounts, scales: &Scales) {
        let Self { experiment, session, owner, clients } = self;
        let descriptors = individuals.iter().map(|individual| decode(experiment.space(), individual));
        // What cannot be looked up is told where the search itself asks.
        let is_new = |one: &Descriptor| experiment.affords(one) && !known.contains(one).unwrap_or(true);
        let new: BTreeSet<Descriptor> = descriptors.filter(is_new).collect();
        if new.is_empty() {
            return;
        }
        let weights = experiment.set_weights(session.splits.dataset());
        let (fitness, new) = ((experiment.fitness(), &weights[..]), new.iter().collect::<Vec<_>>());
        let batch = FitnessBatch::new(fitness, &session.splits, scales, &new, Matching::Train);
        let mut client = session.cluster.foresight(*owner);
        clients.spawn(async move {
            // Whatever goes wrong here does so again where somebody waits for it, and is reported there.
            let _ = batch.evaluate(&mut client, |_, _, _| {}).await;
        });
    }

    /// Takes those who wait for what was to be evaluated so far: once they are shut down, what nobody has begun or asked for
    /// is given up.
    pub fn take(&mut self) -> JoinSet<()> {
        std::mem::take(&mut self.clients)
    }
}

#[cfg(test)]
mod tests {
    use evolution::{Encoding, Ensemble, Field, GaSettings, Genome, StopSettings, WinnerRule};

    use super::*;

    fn score(correct: usize) -> Score {
        Score { correct: correct as u32, queries: 50, margin: 0.0, further: [0; 2] }
    }

    /// Two members of four individuals each.
    fn search(generations: u32) -> Search {
        let settings = GaSettings { population: 4, ..GaSettings::default() };
        let genome = Genome::new(vec![Field::new("field", 16); 4], Encoding::Gray);
        let strategy = Ensemble::new(genome, 2, settings, 7).unwrap();
        let stop = StopSettings { generations, ..StopSettings::default() };
        Search::new(Box::new(strategy), stop, WinnerRule::Fitness)
    }

    #[test]
    fn a_part_is_foreseen_once_as_soon_as_all_individuals_of_it_have_a_score() {
        let search = search(2);
        let scores: Vec<Score> = [3, 1, 4, 1, 5, 9, 2, 6].map(score).to_vec();
        // Individuals 1 and 3 stand for one descriptor; 0 and 4 to 6 were evaluated before.
        let known = [0, 4, 5, 6];
        let at_first: Vec<Option<Score>> =
            (0..8).map(|index| known.contains(&index).then(|| scores[index])).collect();
        let waiting = vec![vec![1, 3], vec![2], vec![7]];
        let mut foresight = Foresight::new(&search, 8, (at_first, waiting));
        assert_eq!((foresight.individuals(), foresight.open.len()), (vec![], 2));
        foresight.take(2, scores[7]);
        let second = search.foresee_part(1, &scores[4..], (scores[5], 8)).unwrap();
        assert_eq!((foresight.individuals(), second.len()), (second, 4));
        foresight.take(0, scores[1]);
        assert_eq!(foresight.individuals(), []);
        foresight.take(1, scores[2]);
        let first = search.foresee_part(0, &scores[..4], (scores[5], 8)).unwrap();
        assert_eq!((foresight.individuals(), foresight.open.len()), (first, 0));
        assert_eq!(foresight.individuals(), []);
    }

    #[test]
    fn a_descriptor_that_stands_in_two_parts_may_be_the_last_of_both() {
        let search = search(2);
        let scores: Vec<Score> = [3, 1, 4, 1, 5, 1, 2, 6].map(score).to_vec();
        let at_first: Vec<Option<Score>> =
            (0..8).map(|index| (![1, 3, 5].contains(&index)).then(|| scores[index])).collect();
        let mut foresight = Foresight::new(&search, 8, (at_first, vec![vec![1, 3, 5]]));
        assert_eq!(foresight.individuals(), []);
        foresight.take(0, scores[1]);
        let follow = |part, scores: &[Score]| search.foresee_part(part, scores, (score(6), 8)).unwrap();
        assert_eq!(foresight.individuals(), [follow(0, &scores[..4]), follow(1, &scores[4..])].concat());
    }

    #[test]
    fn nothing_is_foreseen_beyond_the_last_generation() {
        let search = search(1);
        let mut foresight = Foresight::new(&search, 8, (vec![Some(score(1)); 8], Vec::new()));
        assert_eq!(foresight.individuals(), []);
    }
}
