//! Matching rules: which clouds a query is compared with, and what is counted of the nearest. Worker and coordinator
//! count by the same function, so that the tiles of an evaluation give the bits of the whole.

use super::nearest::{Nearest, is_nearer};
use super::{EvaluationResult, Label};

/// Which clouds a query is compared with, and when it counts as recognised. The default is the paper's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct MatchingRule {
    /// Clouds that a query is not compared with.
    pub exclude: Exclusion,
    /// What the nearest cloud has to have in common with the query.
    pub objective: Objective,
    /// Whether the margin is wanted.
    pub margin: bool,
}

/// Clouds of the database that a query is not compared with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Exclusion {
    /// It is compared with all.
    #[default]
    None,
    /// Those of the same digest: leave-one-out.
    SameCloud,
    /// Those of the same sequence: cross-sequence.
    SameSequence,
}

/// What the nearest cloud has to have in common with a query.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Objective {
    /// The object.
    #[default]
    Object,
    /// The category.
    Category,
}

impl MatchingRule {
    /// Whether it is the paper's: every query is compared with all clouds and counts.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// What the objective looks at.
    pub fn class(&self, label: Label) -> u32 {
        match self.objective {
            Objective::Object => label.instance,
            Objective::Category => label.category,
        }
    }

    /// The counts, and the margin if it is wanted, of queries that show `queries`, by the nearest clouds of a database
    /// that shows `database`. A query with none of its own left is in no count. The margin is the sum over the others,
    /// in their order and in f64, of (other − same) / (other + same), where 0/0 is 0 and a query to which no other
    /// cloud is left has 1.
    ///
    /// # Panics
    /// If an index is beyond the database: a programming error, for [`super::Task::check`] lets none pass.
    pub fn count(&self, nearest: &[Nearest], queries: &[Label], database: &[Label]) -> EvaluationResult {
        let mut counts =
            EvaluationResult { margin: self.margin.then_some(0.0), ..EvaluationResult::default() };
        for (Nearest { same, other }, query) in nearest.iter().zip(queries) {
            let Some(same) = *same else { continue };
            let nearest = other.filter(|&other| is_nearer(other, same)).unwrap_or(same);
            let named = database[nearest.0 as usize];
            counts.queries += 1;
            counts.object_correct += u32::from(named.instance == query.instance);
            counts.category_correct += u32::from(named.category == query.category);
            if let Some(sum) = &mut counts.margin {
                *sum += other.map_or(1.0, |other| margin(same.1, other.1));
            }
        }
        counts
    }
}

fn margin(same: f64, other: f64) -> f64 {
    let sum = other + same;
    if sum == 0.0 { 0.0 } else { (other - same) / sum }
}
