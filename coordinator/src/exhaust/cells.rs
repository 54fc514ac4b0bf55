//! Who counted which cell of the grid, and which cells are in doubt for it.

use super::cell_task::cell_bytes;
use super::grid::Grid;
use cluster::scheduler::Doubt;
use proto::task::Task;

/// Who counted a cell.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CountedBy {
    /// Id of the worker, hexadecimal.
    pub worker_id: String,
    /// Who answers for it.
    pub principal: String,
}

/// The cells that are in the folder.
#[derive(Debug, Default)]
pub struct Cells {
    /// Each with who answers for its counts, if it is known.
    there: Vec<(usize, Option<String>)>,
    /// How many were found to be in doubt.
    pub removed: usize,
}

impl Cells {
    /// Notes that a cell is there, and who counted.
    pub fn add(&mut self, cell: usize, by: Option<&CountedBy>) {
        self.there.push((cell, by.map(|by| by.principal.clone())));
    }

    /// The cells that are in doubt after this, which are there no longer: that on which workers differ, and all that a
    /// principal which was wrong has counted, in whichever start of the search.
    pub fn doubt(&mut self, doubt: &Doubt, grid: &Grid) -> Vec<usize> {
        let doubtful = |cell: usize, counted: Option<&str>| match doubt {
            Doubt::Disagreement { task, .. } => match &**task {
                Task::GridCell(asked) => cell_bytes(grid.radii(cell)) == asked.subject.descriptor,
                _ => false,
            },
            Doubt::Quarantined(principal) => counted == Some(&principal.to_string()),
        };
        let gone = self.there.extract_if(.., |(cell, counted)| doubtful(*cell, counted.as_deref()));
        let gone: Vec<usize> = gone.map(|(cell, _)| cell).collect();
        self.removed += gone.len();
        gone
    }
}
