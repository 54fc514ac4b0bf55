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
        let principals = self.principals();
        (!principals.is_empty()).then_some(Provenance { principals, basis })
    }

    /// Who has counted it.
    fn principals(&self) -> BTreeSet<Principal> {
        if self.basis == Some(Basis::Own) {
            return [Principal::Coordinator].into();
        }
        std::iter::once(&self.principal).chain(&self.seconded).filter_map(|one| one.parse().ok()).collect()
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
        self.there.iter().filter_map(|(_, by)| by.as_ref()).flat_map(CountedBy::principals).collect()
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
        self.remove(doubtful)
    }

    /// Whoever has counted a cell that an earlier start has left and that is wrong, and the cells that are in doubt for it,
    /// which are there no longer: all that they have counted.
    pub fn wrong(&mut self, wrong: usize) -> (BTreeSet<Principal>, Vec<usize>) {
        let counted = self.there.iter().find(|(cell, _)| *cell == wrong);
        let who = counted.and_then(|(_, by)| Some(by.as_ref()?.principals())).unwrap_or_default();
        let theirs = |by: &CountedBy| !by.principals().is_disjoint(&who);
        let gone = self.remove(|cell, by| cell == wrong || by.is_some_and(theirs));
        (who, gone)
    }

    fn remove(&mut self, is_doubtful: impl Fn(usize, Option<&CountedBy>) -> bool) -> Vec<usize> {
        let gone = self.there.extract_if(.., |(cell, counted)| is_doubtful(*cell, counted.as_ref()));
        let gone: Vec<usize> = gone.map(|(cell, _)| cell).collect();
        self.removed += gone.len();
        gone
    }
}
