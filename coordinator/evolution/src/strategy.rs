//! What a method of searching has to say: its generations.

use std::ops::Range;

use crate::individual::Individual;
use crate::past::Past;
use crate::score::Score;
use crate::stop::StopReason;

/// A method of searching. It keeps no state of its own: a generation follows from those before and their scores, so that
/// a search that is begun again with the same scores takes the same way.
pub trait Strategy: Send + Sync {
    /// Generation 1, not empty.
    fn first(&self) -> Vec<Individual>;

    /// The generation after number `generation`, which had these individuals with these scores; not empty. They are the
    /// last of the past, as far as that is kept.
    fn next(
        &self,
        generation: u32,
        population: &[Individual],
        scores: &[Score],
        past: &Past,
    ) -> Vec<Individual>;

    /// Individuals of a generation of so many that have children of their own, whatever the others' scores, each in one part
    /// at most; none, if the next generation follows only from all of them.
    fn parts(&self, _individuals: usize) -> Vec<Range<usize>> {
        Vec::new()
    }

    /// The individuals of the next generation that follow from one of these parts of generation number `generation`, which
    /// has these scores.
    fn next_of_part(
        &self,
        _generation: u32,
        _part: usize,
        _population: &[Individual],
        _scores: &[Score],
    ) -> Vec<Individual> {
        Vec::new()
    }

    /// How many of the individuals that were told last are to be kept for it.
    fn remembers(&self) -> usize {
        0
    }

    /// Individuals of the largest generation that there can be.
    fn largest_generation(&self) -> u32;

    /// The rate with which the children of a generation are mutated, 0 to 1; 0 if there is no mutation.
    fn mutation_rate(&self, _generation: u32) -> f64 {
        0.0
    }

    /// Why no generation can follow that has anything better; `None` if one can. It goes before the stop rule.
    fn exhausted(&self) -> Option<StopReason> {
        None
    }
}
