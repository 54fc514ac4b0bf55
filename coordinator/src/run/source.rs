//! Where the individuals of each generation come from: one of the methods of searching.

use crate::evolution::{Evolution, Individual, RandomSearch};

/// A method at work.
pub enum Source {
    /// The genetic algorithm.
    Ga(Evolution),
    /// Random search.
    Random(RandomSearch),
    /// The best of all descriptors, found before: the only individual of the only generation.
    Grid([Individual; 1]),
}

impl Source {
    /// The current generation, counted from 1.
    pub fn generation(&self) -> u32 {
        match self {
            Self::Ga(evolution) => evolution.generation(),
            Self::Random(search) => search.generation(),
            Self::Grid(_) => 1,
        }
    }

    /// The individuals of the current generation.
    pub fn population(&self) -> &[Individual] {
        match self {
            Self::Ga(evolution) => evolution.population(),
            Self::Random(search) => search.population(),
            Self::Grid(best) => best,
        }
    }

    /// The rate with which the children of the current generation are mutated; 0 if there are none.
    pub fn mutation_rate(&self) -> f64 {
        match self {
            Self::Ga(evolution) => evolution.mutation_rate(),
            Self::Random(_) | Self::Grid(_) => 0.0,
        }
    }

    /// Whether no generation can follow that has anything better.
    pub fn is_exhausted(&self) -> bool {
        matches!(self, Self::Grid(_))
    }

    /// Takes the correct counts of the current generation, in individual order, and makes the next one.
    pub fn tell(&mut self, correct: &[u32]) {
        match self {
            Self::Ga(evolution) => evolution.tell(correct),
            Self::Random(search) => search.advance(),
            Self::Grid(_) => {}
        }
    }
}
