//! What a search remembers of the individuals it was told last, for strategies that learn from more than one generation.

use std::collections::VecDeque;

use crate::individual::Individual;
use crate::score::Score;

/// The individuals that were told last, each once, with their scores: the oldest first.
#[derive(Clone, Debug, Default)]
pub struct Past {
    most: usize,
    told: VecDeque<(Individual, Score)>,
}

impl Past {
    /// At most so many.
    pub(crate) fn of(most: usize) -> Self {
        Self { most, told: VecDeque::new() }
    }

    /// Adds a generation, the last of it first: what is forgotten of a large one is not its elite. To add it again changes
    /// nothing.
    pub(crate) fn add(&mut self, population: &[Individual], scores: &[Score]) {
        if self.most == 0 {
            return;
        }
        for (individual, &score) in population.iter().zip(scores).rev() {
            self.told.retain(|(told, _)| told.values != individual.values);
            self.told.push_back((individual.clone(), score));
        }
        let beyond = self.told.len().saturating_sub(self.most);
        self.told.drain(..beyond);
    }

    /// All of them.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (&Individual, &Score)> {
        self.told.iter().map(|(individual, score)| (individual, score))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::score::tests::scores;
    use crate::tests::paper;

    fn individual(value: u32) -> Individual {
        Individual::of_values(vec![value, 0, 0, 0, 0], [None, None], &paper())
    }

    fn told(past: &Past) -> Vec<(u32, u32)> {
        past.iter().map(|(individual, score)| (individual.values[0], score.correct)).collect()
    }

    #[test]
    fn the_last_are_kept_each_once_with_its_last_score() {
        let mut past = Past::of(3);
        past.add(&[1, 2, 1].map(individual), &scores(&[10, 20, 11]));
        assert_eq!(told(&past), [(2, 20), (1, 10)]);
        for _ in 0..2 {
            past.add(&[4, 3, 2].map(individual), &scores(&[40, 30, 21]));
            assert_eq!(told(&past), [(2, 21), (3, 30), (4, 40)]);
        }
        past.add(&[5, 6, 7, 8].map(individual), &scores(&[50, 60, 70, 80]));
        assert_eq!(told(&past), [(7, 70), (6, 60), (5, 50)]);
        let mut nothing = Past::default();
        nothing.add(&[individual(1)], &scores(&[1]));
        assert_eq!(told(&nothing), []);
    }
}
