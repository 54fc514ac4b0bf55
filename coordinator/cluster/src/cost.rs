//! What a task costs by count, not by clock: the one place that hedging and sharding ask.

use proto::task::{Task, TaskKind};

/// The counted cost of a task. Tasks of one kind take time in proportion to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CountedCost {
    /// What is counted. Counts of different kinds cannot be compared.
    pub kind: TaskKind,
    /// As [`Task::cost`] has it.
    pub units: u64,
}

/// What a task costs.
pub fn counted_cost(task: &Task) -> CountedCost {
    CountedCost { kind: task.kind(), units: task.cost() }
}
