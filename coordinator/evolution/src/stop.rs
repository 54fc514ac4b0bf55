//! The stop rule: looks at one generation after the other and says when and why the run ends (DESIGN 5.10).

use std::fmt;

use crate::score::Score;
use crate::settings::StopSettings;

/// Why a run ended, in order of precedence: if several hold after one generation, the first is the reason.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum StopReason {
    /// The best individual names every training query correctly.
    Perfect,
    /// The validation error count rose as often in a row as the patience allows.
    Validation,
    /// No strictly better training fitness for the allowed number of generations.
    Stagnation,
    /// The allowed number of generations is done.
    Generations,
    /// The allowed number of different individuals has been evaluated.
    Evaluations,
    /// Every descriptor of the search space was evaluated: the end of an exhaustive search, whatever the rule.
    Exhaustive,
}

impl StopReason {
    /// Every reason; those of the stop rule first, in order of precedence.
    pub const ALL: [Self; 6] = [
        Self::Perfect,
        Self::Validation,
        Self::Stagnation,
        Self::Generations,
        Self::Evaluations,
        Self::Exhaustive,
    ];

    /// Its name in Parquet and JSON.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Perfect => "perfect",
            Self::Validation => "validation",
            Self::Stagnation => "stagnation",
            Self::Generations => "generations",
            Self::Evaluations => "evaluations",
            Self::Exhaustive => "exhaustive",
        }
    }
}

impl fmt::Display for StopReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Perfect => "every training query was named correctly",
            Self::Validation => "validation errors rose",
            Self::Stagnation => "the training fitness no longer improved",
            Self::Generations => "the last generation was reached",
            Self::Evaluations => "the budget of evaluations was spent",
            Self::Exhaustive => "the whole grid was evaluated",
        })
    }
}

/// The stop rule with what it remembers of the generations seen.
#[derive(Clone, Debug)]
pub struct StopRule {
    settings: StopSettings,
    generations: u32,
    best: Option<Score>,
    generations_without_improvement: u32,
    previous_validation: Option<Score>,
    validation_rises: u32,
}

impl StopRule {
    /// Before the first generation.
    pub fn new(settings: StopSettings) -> Self {
        Self {
            settings,
            generations: 0,
            best: None,
            generations_without_improvement: 0,
            previous_validation: None,
            validation_rises: 0,
        }
    }

    /// How many more different individuals may be evaluated, now that there were `evaluations`; `None` without a budget.
    pub fn evaluations_left(&self, evaluations: u64) -> Option<u64> {
        self.settings.evaluations.map(|budget| u64::from(budget).saturating_sub(evaluations))
    }

    /// Whether the run may end with the next generation, whose best has this score, if validation goes as badly as it can;
    /// `evaluations` as for [`StopRule::observe`].
    pub fn may_end(&self, score: Score, evaluations: u64) -> bool {
        let worst = self.previous_validation.map(|previous| Score { correct: 0, ..previous });
        self.clone().observe(score, worst, evaluations).1.is_some()
    }

    /// Takes the score of the next generation's best, its validation score, `None` without validation, and how many
    /// different individuals have been evaluated so far; returns the best score so far, and why the run ends with this
    /// generation.
    ///
    /// Validation *rises* when there are more errors than in the previous generation; as many or fewer end a series of
    /// rises. Neither for that nor for an improvement of the training fitness does the margin count.
    pub fn observe(
        &mut self,
        score: Score,
        validation: Option<Score>,
        evaluations: u64,
    ) -> (Score, Option<StopReason>) {
        self.generations = self.generations.saturating_add(1);
        let improves = self.best.is_none_or(|best| score.correct > best.correct);
        self.generations_without_improvement =
            if improves { 0 } else { self.generations_without_improvement.saturating_add(1) };
        let best = self.best.map_or(score, |best| best.or_better(score));
        self.best = Some(best);
        let rises = matches!(
            (self.previous_validation, validation),
            (Some(previous), Some(now)) if now.correct < previous.correct
        );
        self.validation_rises = if rises { self.validation_rises.saturating_add(1) } else { 0 };
        self.previous_validation = validation;

        let reached = |count: u32, limit: Option<u32>| limit.is_some_and(|limit| count >= limit);
        let holds = |reason: &StopReason| match reason {
            StopReason::Perfect => self.settings.perfect && score.is_perfect(),
            StopReason::Validation => reached(self.validation_rises, self.settings.validation_patience),
            StopReason::Stagnation => reached(self.generations_without_improvement, self.settings.stagnation),
            StopReason::Generations => self.generations >= self.settings.generations,
            StopReason::Evaluations => {
                self.settings.evaluations.is_some_and(|budget| evaluations >= u64::from(budget))
            }
            StopReason::Exhaustive => false,
        };
        (best, StopReason::ALL.into_iter().find(holds))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use expect_test::expect;
    use proptest::prelude::*;

    use super::*;
    use crate::score::tests::score;

    pub(crate) const NEVER: StopSettings = StopSettings {
        perfect: false,
        validation_patience: None,
        stagnation: None,
        generations: u32::MAX,
        evaluations: None,
    };

    proptest! {
        #[test]
        fn a_run_may_end_exactly_if_it_ends_for_some_validation(
            told in prop::collection::vec((0u32..10, 0u32..10), 1..12),
            patience in prop::option::of(1u32..4),
            stagnation in prop::option::of(1u32..5),
        ) {
            let mut rule =
                StopRule::new(StopSettings { validation_patience: patience, stagnation, generations: 9, ..NEVER });
            for (correct, wrong) in told {
                let ends = |wrong| rule.clone().observe(score(correct, 10), Some(errors(wrong)), 0).1.is_some();
                prop_assert_eq!(rule.may_end(score(correct, 10), 0), (0..=50).any(ends));
                rule.observe(score(correct, 10), Some(errors(wrong)), 0);
            }
        }
    }

    fn errors(errors: u32) -> Score {
        score(50 - errors, 50)
    }

    /// Runs (correct, validation errors) of 10 queries to the stop: its generation and reason.
    fn check(
        settings: StopSettings,
        generations: &[(u32, Option<u32>)],
        expected: Option<(usize, StopReason)>,
    ) {
        let mut rule = StopRule::new(settings);
        let stop = generations.iter().enumerate().find_map(|(index, &(correct, wrong))| {
            let (best, reason) = rule.observe(score(correct, 10), wrong.map(errors), 0);
            assert_eq!(Some(best.correct), generations[..=index].iter().map(|generation| generation.0).max());
            reason.map(|reason| (index + 1, reason))
        });
        assert_eq!(stop, expected, "{settings:?} {generations:?}");
    }

    fn without_validation(correct: &[u32]) -> Vec<(u32, Option<u32>)> {
        correct.iter().map(|&correct| (correct, None)).collect()
    }

    fn with_errors(errors: &[u32]) -> Vec<(u32, Option<u32>)> {
        errors.iter().map(|&errors| (5, Some(errors))).collect()
    }

    #[test]
    fn perfect_is_all_queries_and_not_one_less() {
        let settings = StopSettings { perfect: true, ..NEVER };
        check(settings, &without_validation(&[8, 9, 10, 10]), Some((3, StopReason::Perfect)));
        check(settings, &without_validation(&[10]), Some((1, StopReason::Perfect)));
        check(settings, &without_validation(&[9, 9, 9]), None);
        check(NEVER, &without_validation(&[10, 10]), None);
        assert_eq!(StopRule::new(settings).observe(score(0, 0), None, 0), (score(0, 0), None));
    }

    #[test]
    fn validation_rises_over_the_previous_generation_not_over_the_lowest() {
        let settings = StopSettings { validation_patience: Some(1), ..NEVER };
        check(settings, &with_errors(&[4, 5]), Some((2, StopReason::Validation)));
        check(settings, &with_errors(&[4, 4, 3, 3, 2]), None);
        check(settings, &with_errors(&[9, 2, 3]), Some((3, StopReason::Validation)));
        check(settings, &with_errors(&[7]), None);
        check(settings, &without_validation(&[5, 5, 5]), None);
        check(NEVER, &with_errors(&[1, 2, 3, 4]), None);
    }

    #[test]
    fn patience_counts_rises_in_a_row() {
        let settings = StopSettings { validation_patience: Some(3), ..NEVER };
        check(settings, &with_errors(&[1, 2, 3, 4]), Some((4, StopReason::Validation)));
        check(settings, &with_errors(&[1, 2, 3, 3, 4, 5]), None);
        check(settings, &with_errors(&[1, 2, 3, 3, 4, 5, 6]), Some((7, StopReason::Validation)));
        check(settings, &with_errors(&[1, 2, 3, 0, 4, 5]), None);
    }

    #[test]
    fn stagnation_counts_generations_without_a_strictly_better_fitness() {
        let settings = StopSettings { stagnation: Some(3), ..NEVER };
        check(settings, &without_validation(&[5, 5, 5, 5]), Some((4, StopReason::Stagnation)));
        check(settings, &without_validation(&[5, 5, 5, 6, 6, 6]), None);
        check(settings, &without_validation(&[5, 5, 5, 6, 6, 6, 6]), Some((7, StopReason::Stagnation)));
        // Falling and rising back below the best is no improvement.
        check(settings, &without_validation(&[5, 3, 4, 5]), Some((4, StopReason::Stagnation)));
        check(NEVER, &without_validation(&[5; 100]), None);
        let paper = StopSettings::default();
        check(paper, &without_validation(&[5; 60]), Some((41, StopReason::Stagnation)));
    }

    #[test]
    fn generations_count_from_the_random_population() {
        check(
            StopSettings { generations: 1, ..NEVER },
            &without_validation(&[1]),
            Some((1, StopReason::Generations)),
        );
        let paper = StopSettings { stagnation: None, ..StopSettings::default() };
        check(paper, &without_validation(&[5; 300]), Some((200, StopReason::Generations)));
    }

    #[test]
    fn the_budget_of_evaluations_ends_with_the_generation_that_reaches_it() {
        for (budget, expected) in [(1, 1), (10, 1), (11, 2), (25, 3), (26, 4)] {
            let mut rule = StopRule::new(StopSettings { evaluations: Some(budget), ..NEVER });
            let ends = [10, 19, 25, 40].map(|evaluations| rule.observe(score(5, 10), None, evaluations).1);
            let first = ends.iter().position(Option::is_some);
            assert_eq!(first, Some(expected - 1), "{budget}");
            assert!(ends.iter().flatten().all(|&reason| reason == StopReason::Evaluations));
        }
        assert_eq!(StopRule::new(NEVER).observe(score(5, 10), None, u64::MAX).1, None);
    }

    #[test]
    fn a_margin_is_no_improvement_of_fitness_and_no_rise_of_errors() {
        let settings = StopSettings { stagnation: Some(2), validation_patience: Some(1), ..NEVER };
        let mut rule = StopRule::new(settings);
        let with = |margin| Score { margin, ..score(5, 10) };
        assert_eq!(rule.observe(with(0.1), Some(with(0.9)), 0), (with(0.1), None));
        assert_eq!(rule.observe(with(0.3), Some(with(0.1)), 0), (with(0.3), None));
        assert_eq!(rule.observe(with(0.2), Some(with(-0.1)), 0), (with(0.3), Some(StopReason::Stagnation)));
    }

    #[test]
    fn of_two_reasons_in_one_generation_the_first_in_order_counts() {
        // After these four generations every reason that is switched on holds for the first time: fitness is as good
        // as possible from the start, errors rise once, three generations pass without improvement, four in all, of
        // eight individuals each.
        // Perfection alone holds from the first, so it is given queries to reach at the fourth.
        let enabled = |on: &[StopReason]| StopSettings {
            perfect: on.contains(&StopReason::Perfect),
            validation_patience: on.contains(&StopReason::Validation).then_some(1),
            stagnation: on.contains(&StopReason::Stagnation).then_some(3),
            generations: if on.contains(&StopReason::Generations) { 4 } else { u32::MAX },
            evaluations: on.contains(&StopReason::Evaluations).then_some(32),
        };
        let run = |settings| {
            let mut rule = StopRule::new(settings);
            let mut reasons = Vec::new();
            for (queries, wrong, evaluations) in [(11, 4, 8), (11, 4, 16), (11, 4, 24), (10, 5, 32)] {
                reasons.push(rule.observe(score(10, queries), Some(errors(wrong)), evaluations).1);
            }
            reasons
        };
        let rule = &StopReason::ALL[..5];
        for (i, &first) in rule.iter().enumerate() {
            assert_eq!(run(enabled(&[first])), [None, None, None, Some(first)]);
            for &second in &rule[i + 1..] {
                assert_eq!(run(enabled(&[first, second])), [None, None, None, Some(first)]);
            }
        }
        assert_eq!(run(enabled(&StopReason::ALL)), [None, None, None, Some(StopReason::Perfect)]);
    }

    #[test]
    fn names_and_sentences() {
        let text = StopReason::ALL.map(|reason| format!("{}: {reason}\n", reason.as_str())).concat();
        expect![[r#"
            perfect: every training query was named correctly
            validation: validation errors rose
            stagnation: the training fitness no longer improved
            generations: the last generation was reached
            evaluations: the budget of evaluations was spent
            exhaustive: the whole grid was evaluated
        "#]]
        .assert_eq(&text);
    }

    proptest! {
        #[test]
        fn the_rule_is_its_definition_over_the_whole_history(
            generations in prop::collection::vec(
                (0u32..=10, prop::option::weighted(0.9, 0u32..6), 0u32..5),
                1..40,
            ),
            perfect in any::<bool>(),
            validation_patience in prop::option::of(1u32..4),
            stagnation in prop::option::of(1u32..8),
            limit in 1u32..50,
            evaluations in prop::option::of(1u32..100),
        ) {
            let settings =
                StopSettings { perfect, validation_patience, stagnation, generations: limit, evaluations };
            let mut rule = StopRule::new(settings);
            for end in 1..=generations.len() {
                let history = &generations[..end];
                let (correct, wrong, _) = history[end - 1];
                let evaluated: u32 = history.iter().map(|generation| generation.2).sum();
                let rises = |g: usize| {
                    g > 0 && matches!((history[g - 1].1, history[g].1), (Some(a), Some(b)) if b > a)
                };
                let risen = |patience: u32| {
                    let patience = patience as usize;
                    end >= patience && (end - patience..end).all(rises)
                };
                let stagnant = |limit: u32| {
                    let limit = limit as usize;
                    end > limit && {
                        let (before, after) = history.split_at(end - limit);
                        after.iter().map(|g| g.0).max() <= before.iter().map(|g| g.0).max()
                    }
                };
                let expected = if perfect && correct == 10 {
                    Some(StopReason::Perfect)
                } else if validation_patience.is_some_and(risen) {
                    Some(StopReason::Validation)
                } else if stagnation.is_some_and(stagnant) {
                    Some(StopReason::Stagnation)
                } else if end as u32 >= limit {
                    Some(StopReason::Generations)
                } else {
                    evaluations.filter(|&budget| evaluated >= budget).map(|_| StopReason::Evaluations)
                };
                let (_, reason) = rule.observe(score(correct, 10), wrong.map(errors), evaluated.into());
                prop_assert_eq!(reason, expected);
            }
        }
    }
}
