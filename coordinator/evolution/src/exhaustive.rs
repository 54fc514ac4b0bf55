//! Exhaustive search, whose one individual is the best of the whole grid.

use crate::genome::Genome;
use crate::individual::Individual;
use crate::past::Past;
use crate::score::Score;
use crate::stop::StopReason;
use crate::strategy::Strategy;

/// The best point of the search space, which the caller has found by evaluating all of them: the only individual of the
/// only generation.
#[derive(Clone, Debug)]
pub struct Exhaustive {
    best: Individual,
}

impl Exhaustive {
    /// `best`: the value index of each field.
    ///
    /// # Panics
    /// If the genome has no such point: a programming error.
    pub fn new(best: Vec<u32>, genome: &Genome) -> Self {
        Self { best: Individual::of_values(best, [None, None], genome) }
    }
}

impl Strategy for Exhaustive {
    fn first(&self) -> Vec<Individual> {
        vec![self.best.clone()]
    }

    fn next(
        &self,
        _generation: u32,
        _population: &[Individual],
        _scores: &[Score],
        _past: &Past,
    ) -> Vec<Individual> {
        self.first()
    }

    fn largest_generation(&self) -> u32 {
        1
    }

    fn exhausted(&self) -> Option<StopReason> {
        Some(StopReason::Exhaustive)
    }
}
