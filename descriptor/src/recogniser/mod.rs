//! Recognisers that learn from the labels of a database, beside the nearest neighbour (DESIGN 5b).
//!
//! They are learned from the clouds of the database alone; their settings are those that recognise most of its clouds when
//! sequences are left out in turn ([`ChosenSettings::new`]). All of it is + − × ÷ √ and `libm` in a fixed order: equal bits on
//! every machine.

mod choose;
mod folds;
mod given;
mod held_out;
mod kernel_ridge;
mod learn;
mod logistic;
mod matrix;
mod projection;
mod reject;
mod settings;

#[cfg(test)]
mod testing;

use std::collections::BTreeMap;

pub use choose::ChosenSettings;
pub use given::GivenRecogniser;
pub use held_out::{Evidence, HeldOut, HeldOutAnswer};
use kernel_ridge::KernelRidge;
pub use kernel_ridge::{KernelRidgeSettings, MAX_CLOUDS};
pub use learn::{LabelledClouds, LearnedRecogniser};
pub use matrix::Matrix;
pub(crate) use matrix::dot;
use projection::{Components, Projection};
pub use projection::{MAX_COMPONENTS, ProjectionSettings, Reference};
pub use reject::{Calibration, CrossAnswers, RejectError, RejectRule};
pub use settings::Settings;

/// How a cloud gets its name from a database.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Method {
    /// That of the nearest cloud (paper).
    #[default]
    Nearest,
    /// That of the most similar cloud or object after a projection which keeps objects apart.
    Projection,
    /// That of the object with most votes, which clouds give by their distance.
    KernelRidge,
}

/// What speaks for one object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vote {
    /// How much: a cosine, or the value of a regression whose target is 1.
    pub score: f64,
    /// The cloud of the database that shows this object and is most like the query.
    pub cloud: u32,
}

/// Why nothing can be learned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LearnError {
    /// There is nothing to tell apart.
    #[error(
        "database: must show at least two objects to learn from, got {got}\nadd objects, or recognise by the nearest cloud"
    )]
    Objects {
        /// How many there are.
        got: usize,
    },
    /// The system of equations would not fit.
    #[error(
        "database: must have at most {most} clouds for kernel ridge regression, got {got}\nuse a projection, or fewer clouds"
    )]
    Clouds {
        /// How many there are.
        got: usize,
        /// At most.
        most: usize,
    },
    /// Nothing tells objects apart.
    #[error(
        "database: clouds with different signatures expected, got none that differ\nuse another descriptor"
    )]
    Alike,
    /// The system of equations has no solution.
    #[error(
        "database: signatures give a singular system of equations\nuse another descriptor or another recogniser"
    )]
    Singular,
}

impl Method {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Nearest, Self::Projection, Self::KernelRidge];

    /// Its name in experiments, tables and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Nearest => "nearest",
            Self::Projection => "projection",
            Self::KernelRidge => "kernel-ridge",
        }
    }

    /// The one of this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|method| method.name() == name)
    }
}

/// The objects of a database, numbered in the order in which its clouds show them: their labels change no bit.
#[derive(Clone, Debug, PartialEq)]
struct Classes {
    of: Vec<usize>,
    members: Vec<usize>,
}

impl Classes {
    fn new(objects: &[u32]) -> Result<Self, LearnError> {
        let mut places: BTreeMap<u32, usize> = BTreeMap::new();
        let (mut of, mut members) = (Vec::with_capacity(objects.len()), Vec::new());
        for &object in objects {
            let place = *places.entry(object).or_insert(members.len());
            if place == members.len() {
                members.push(0);
            }
            members[place] += 1;
            of.push(place);
        }
        if members.len() < 2 {
            return Err(LearnError::Objects { got: members.len() });
        }
        Ok(Self { of, members })
    }

    fn len(&self) -> usize {
        self.members.len()
    }

    /// The object of a cloud.
    fn of(&self, cloud: usize) -> usize {
        self.of[cloud]
    }

    /// How many clouds show an object.
    fn members(&self, class: usize) -> usize {
        self.members[class]
    }
}

/// What speaks for each object, best first; of equal scores the object that comes first in the database. `votes` are in
/// the order of objects: scores and the clouds that stand for them.
fn ranked(votes: impl Iterator<Item = (f64, u32)>) -> Vec<Vote> {
    let mut votes: Vec<Vote> = votes.map(|(score, cloud)| Vote { score, cloud }).collect();
    votes.sort_by(|a, b| b.score.total_cmp(&a.score)); // stable
    votes
}
