//! Evolutionary search as ask and tell: a strategy proposes a generation, the caller evaluates it and tells its scores.
//!
//! Pure and synchronous: no clock, no files, no threads, and nothing is known of what an individual stands for. All
//! randomness comes from streams keyed by seed, purpose, generation and index, so a generation depends on nothing but
//! the seed, the settings and the scores told before.
//!
//! A further strategy is a file with its [`Strategy`] and an entry in [`Method`].

pub mod crossover;
mod ensemble;
mod exhaustive;
mod front;
mod genetic;
mod genome;
mod hill_climb;
mod hypervolume;
mod individual;
mod method;
pub mod mutation;
mod nsga2;
mod pareto;
mod past;
mod preselection;
mod random_search;
mod score;
mod search;
pub mod selection;
mod settings;
mod stop;
mod strategy;
mod surrogate;
mod variation;
mod winner;

#[cfg(test)]
mod tests;

pub use ensemble::Ensemble;
pub use exhaustive::Exhaustive;
pub use front::Front;
pub use genetic::GeneticAlgorithm;
pub use genome::{Encoding, Field, Genome};
pub use hill_climb::HillClimb;
pub use hypervolume::hypervolume;
pub use individual::Individual;
pub use method::Method;
pub use nsga2::Nsga2;
pub use past::Past;
pub use preselection::Decompose;
pub use random_search::RandomSearch;
pub use score::{Objectives, Score, dominates};
pub use search::{Search, State};
pub use settings::{
    Crossover, GaSettings, MAX_POPULATION, MAX_PRESELECTION, Mutation, Scaling, SettingsError, StopSettings,
};
pub use stop::{StopReason, StopRule};
pub use strategy::Strategy;
pub use surrogate::Part;
pub use winner::{Found, WinnerRule};
