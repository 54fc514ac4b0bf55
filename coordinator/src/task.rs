//! One task: what a job asks of a worker, and what a worker may answer.

use std::fmt;

use descriptor::{GENES, GeneKind};
use proto::Digest;

use crate::evaluation::{Evaluation, EvaluationResult};

/// What one job asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Task {
    /// One descriptor.
    Evaluation(Evaluation),
    /// Every descriptor with one R1 and one R2.
    GridCell(GridCell),
}

/// What a task gives.
#[derive(Clone, Debug, PartialEq)]
pub enum TaskResult {
    /// Of one descriptor.
    Evaluation(EvaluationResult),
    /// How many queries each descriptor of the cell recognises (object), in the order shape_bins, m, w, w fastest.
    GridCell(Vec<u32>),
}

/// Evaluate every descriptor of the search space that has this R1 and this R2.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GridCell {
    /// R1, micrometres.
    pub disk_um: u32,
    /// R2, micrometres.
    pub ring_um: u32,
    /// Split manifests of the queries, in order.
    pub query: Vec<Digest>,
    /// Split manifests of the database, in order.
    pub database: Vec<Digest>,
    /// Clouds in `query`.
    pub queries: u32,
    /// How many descriptors the cell has.
    pub descriptors: usize,
}

impl Task {
    /// Refuses an answer that cannot be one to this task.
    pub fn check(&self, result: &TaskResult) -> Result<(), String> {
        match (self, result) {
            (Self::Evaluation(evaluation), TaskResult::Evaluation(result)) => evaluation.check(result),
            (Self::GridCell(cell), TaskResult::GridCell(counts)) => cell.check(counts),
            (Self::Evaluation(_), TaskResult::GridCell(_)) => {
                Err("must be an evaluation, got a grid cell".to_owned())
            }
            (Self::GridCell(_), TaskResult::Evaluation(_)) => {
                Err("must be a grid cell, got an evaluation".to_owned())
            }
        }
    }
}

impl fmt::Display for Task {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Evaluation(evaluation) => write!(f, "evaluation of {}", evaluation.parameters),
            Self::GridCell(cell) => {
                let [disk, ring] =
                    [(GeneKind::DiskRadius, cell.disk_um), (GeneKind::RingRadius, cell.ring_um)]
                        .map(|(kind, um)| GENES[kind as usize].value(um));
                write!(f, "grid cell of R1={disk} cm R2={ring} cm")
            }
        }
    }
}

impl GridCell {
    fn check(&self, counts: &[u32]) -> Result<(), String> {
        if counts.len() != self.descriptors {
            return Err(format!("counts: must be {}, got {}", self.descriptors, counts.len()));
        }
        match counts.iter().find(|&&count| count > self.queries) {
            Some(count) => Err(format!("count: must be at most {}, got {count}", self.queries)),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use descriptor::Parameters;

    use super::*;

    #[test]
    fn a_task_takes_answers_of_its_own_kind_and_size_only() {
        let (query, database) = (vec![], vec![]);
        let evaluation = Task::Evaluation(Evaluation {
            parameters: Parameters::PAPER_BEST,
            query: vec![],
            database: vec![],
            queries: 2,
            database_clouds: 3,
            want_matches: false,
        });
        let cell = Task::GridCell(GridCell {
            disk_um: 5_000,
            ring_um: 21_000,
            query,
            database,
            queries: 2,
            descriptors: 3,
        });
        let result = TaskResult::Evaluation(EvaluationResult {
            queries: 2,
            object_correct: 1,
            category_correct: 2,
            matches: vec![],
        });
        assert_eq!(evaluation.check(&result), Ok(()));
        assert!(cell.check(&result).is_err());
        for (counts, good) in [
            (vec![0, 2, 1], true),
            (vec![0, 3, 1], false),
            (vec![0, 2], false),
            (vec![0, 2, 1, 0], false),
            (vec![], false),
        ] {
            let result = TaskResult::GridCell(counts);
            assert_eq!(cell.check(&result).is_ok(), good, "{result:?}");
            assert!(evaluation.check(&result).is_err());
        }
    }
}
