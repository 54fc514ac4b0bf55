//! Who counted which cell of the grid, and which cells are in doubt for it.

use super::cell_task::cell_bytes;
use super::grid::Grid;
use cluster::CellAnswer;
use cluster::scheduler::{Basis, Doubt, Provenance};
use proto::Principal;
use proto::task::Task;
use std::collections::BTreeSet;

/// Who counted a cell.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CountedBy {
    /// Id of the worker, hexadecimal.
    pub worker_id: String,
    /// Who answers for it.
    pub principal: String,
    /// Another principal that counted the same, if one did.
    pub seconded: Option<String>,
    /// Why others may go on with it; `None` if they may not, or if that is not known.
    pub basis: Option<Basis>,
}

impl CountedBy {
    /// Who has given an answer.
    pub fn of(answer: &CellAnswer) -> Self {
        let (worker_id, principal, seconded) = &answer.by;
        Self {
            worker_id: worker_id.to_string(),
            principal: principal.to_string(),
            seconded: seconded.map(|second| second.to_string()),
            basis: answer.provenance.as_ref().map(|provenance| provenance.basis),
        }
    }

    /// Its provenance, if it has one.
    fn provenance(&self) -> Option<Provenance> {
        let basis = self.basis?;
        if basis == Basis::Own {
            return Some(Provenance::own());
        }
        let principals = std::iter::once(&self.principal).chain(&self.seconded);
        Some(Provenance { principals: principals.map(|one| one.parse().ok()).collect::<Option<_>>()?, basis })
    }

    /// Whether it is believed on the word of this principal.
    fn rests_on(&self, principal: &str) -> bool {
        self.basis != Some(Basis::Own)
            && (self.principal == principal || self.seconded.as_deref() == Some(principal))
    }
}

/// The cells that are in the folder.
#[derive(Debug, Default)]
pub struct Cells {
    /// Each with who counted, if it is known.
    there: Vec<(usize, Option<CountedBy>)>,
    /// How many were found to be in doubt.
    pub removed: usize,
}

impl Cells {
    /// Notes that a cell is there, and who counted.
    pub fn add(&mut self, cell: usize, by: Option<&CountedBy>) {
        self.there.push((cell, by.cloned()));
    }

    /// Who has counted them, as far as that is known.
    pub fn principals(&self) -> BTreeSet<Principal> {
        let of = |by: &CountedBy| match by.basis {
            Some(Basis::Own) => vec![Some(Principal::Coordinator)],
            _ => std::iter::once(&by.principal).chain(&by.seconded).map(|one| one.parse().ok()).collect(),
        };
        self.there.iter().filter_map(|(_, by)| by.as_ref()).flat_map(of).flatten().collect()
    }

    /// The provenance of all of them together; `None` if one has none.
    pub fn provenance(&self) -> Option<Provenance> {
        let mut provenances = self.there.iter().map(|(_, by)| by.as_ref()?.provenance());
        let first = provenances.next()??;
        provenances.try_fold(first, |all, one| Some(all.and(one?)))
    }

    /// The cells that are in doubt after this, which are there no longer: that on which workers differ, and all that a
    /// principal which was wrong has counted, in whichever start of the search.
    pub fn doubt(&mut self, doubt: &Doubt, grid: &Grid) -> Vec<usize> {
        let doubtful = |cell: usize, counted: Option<&CountedBy>| match doubt {
            Doubt::Disagreement { task, .. } => match &**task {
                Task::GridCell(asked) => cell_bytes(grid.radii(cell)) == asked.subject.descriptor,
                _ => false,
            },
            Doubt::Quarantined(principal) => counted.is_some_and(|by| by.rests_on(&principal.to_string())),
        };
        let gone = self.there.extract_if(.., |(cell, counted)| doubtful(*cell, counted.as_ref()));
        let gone: Vec<usize> = gone.map(|(cell, _)| cell).collect();
        self.removed += gone.len();
        gone
    }
}
