//! The list of methods: the word for each, and how it is begun.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::ensemble::Ensemble;
use crate::genetic::GeneticAlgorithm;
use crate::genome::Genome;
use crate::hill_climb::HillClimb;
use crate::nsga2::Nsga2;
use crate::preselection::Decompose;
use crate::random_search::RandomSearch;
use crate::settings::{GaSettings, SettingsError};
use crate::strategy::Strategy;

/// How descriptors to evaluate are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// The genetic algorithm (paper), for each member of a structure where there are several: see descriptor.members.
    #[default]
    Ga,
    /// Independent random individuals, ga.population a generation. Of \[ga\] it uses population and encoding.
    Random,
    /// Every descriptor of the search space. Of \[ga\] it uses encoding.
    Exhaustive,
    /// Hill climbing with random restarts: from a random descriptor to the best of all that differ in one gene by one
    /// step, and on from there while that is better. Of \[ga\] it uses encoding. A restart counts as any generation:
    /// with stop.validation_patience it may end the search.
    HillClimb,
    /// NSGA-II (Deb et al., A fast and elitist multiobjective genetic algorithm: NSGA-II, IEEE Transactions on
    /// Evolutionary Computation 6(2), 2002): several objectives at once, see search.objectives; it ends with a front of
    /// descriptors of which none is better than another in all of them. Of \[ga\] it uses all but elite, selection,
    /// scaling and preselection; population is how many survive a generation and how many children they have.
    Nsga2,
}

impl Method {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Ga, Self::Random, Self::Exhaustive, Self::HillClimb, Self::Nsga2];

    /// The word for it in experiments.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Ga => "ga",
            Self::Random => "random",
            Self::Exhaustive => "exhaustive",
            Self::HillClimb => "hill-climb",
            Self::Nsga2 => "nsga2",
        }
    }

    /// Its strategy; `None` for exhaustive search, which needs to be given the best point
    /// ([`Exhaustive`](crate::Exhaustive)). `members` equal parts of the genome, slot after slot, are evolved side by side by
    /// the genetic algorithm, which decomposes individuals if it preselects.
    ///
    /// # Errors
    /// If the settings are not valid ([`GaSettings::validate`]).
    pub fn strategy(
        self,
        genome: &Genome,
        members: u32,
        settings: GaSettings,
        seed: u64,
        decompose: Decompose,
    ) -> Result<Option<Box<dyn Strategy>>, SettingsError> {
        let genome = genome.clone();
        Ok(match self {
            Self::Ga if members > 1 => Some(Box::new(Ensemble::new(genome, members, settings, seed)?)),
            Self::Ga => Some(Box::new(GeneticAlgorithm::new(genome, settings, seed, decompose)?)),
            Self::Random => Some(Box::new(RandomSearch::new(genome, settings, seed)?)),
            Self::Exhaustive => None,
            Self::HillClimb => Some(Box::new(HillClimb::new(genome, seed))),
            Self::Nsga2 => Some(Box::new(Nsga2::new(genome, settings, seed)?)),
        })
    }
}

impl fmt::Display for Method {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}
