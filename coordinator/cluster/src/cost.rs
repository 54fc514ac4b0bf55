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

/// What it costs somebody for whom describing a cloud costs no more than this, having described it in part.
pub fn counted_cost_describing(task: &Task, at_most: u64) -> CountedCost {
    let cloud_cost = task.subject().facts.cloud_cost.min(at_most);
    CountedCost { kind: task.kind(), units: task.cost_describing(cloud_cost) }
}
