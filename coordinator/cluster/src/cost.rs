//! What a task costs by count, not by clock: the one place that hedging and sharding ask.

use descriptor::Descriptor;

use crate::evaluation::Evaluation;
use crate::task::Task;

/// The counted cost of a task. Tasks of equal cost take about as long on one machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct CountedCost {
    /// What is counted.
    pub work: Work,
    /// Clouds that are described.
    pub clouds: u64,
    /// Pairs of clouds that are compared.
    pub pairs: u64,
}

/// Kinds of work. Counts of different kinds cannot be compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Work {
    /// Clouds are described and compared.
    Evaluation,
    /// Clouds are described in the disk-ring family.
    Description,
    /// Clouds are described by a fixed descriptor: its kind and its radius, micrometres.
    FixedDescription(u32, u32),
    /// Clouds that were described before are compared.
    Tile,
    /// Clouds are compared under every descriptor of a grid cell.
    GridCell,
}

/// What a task costs.
pub fn counted_cost(task: &Task) -> CountedCost {
    let pairs =
        |evaluation: &Evaluation| u64::from(evaluation.queries) * u64::from(evaluation.database_clouds);
    let (work, clouds, pairs) = match task {
        Task::Evaluation(whole) => {
            let clouds = u64::from(whole.queries) + u64::from(whole.database_clouds);
            (Work::Evaluation, clouds, pairs(whole))
        }
        Task::Tile(tile) => (Work::Tile, 0, pairs(&tile.evaluation)),
        Task::Description(shard) => {
            let work = match shard.descriptor {
                Descriptor::DiskRing(_) => Work::Description,
                Descriptor::Fixed(fixed) => Work::FixedDescription(fixed.kind as u32, fixed.radius_um),
                Descriptor::GlobalHue(_) => Work::FixedDescription(u32::MAX, 0),
            };
            (work, u64::from(shard.clouds), 0)
        }
        Task::GridCell(cell) => (Work::GridCell, u64::from(cell.queries), cell.descriptors as u64),
    };
    CountedCost { work, clouds, pairs }
}
