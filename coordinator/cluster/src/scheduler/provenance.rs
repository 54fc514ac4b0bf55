//! Provenance: on whose word a result is believed by others than the run that has asked for it.

use std::collections::BTreeSet;

use proto::Principal;
use proto::journal::Assurance;

use super::Finished;
use super::trust::Trust;

/// Why others may go on with a result, from least to most.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Basis {
    /// A principal gave it with whose answers others have agreed often enough.
    Earned,
    /// Two principals gave the same.
    Audited,
    /// The coordinator's own process computed it.
    Own,
}

/// Who has computed something, and why others may go on with it.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Provenance {
    /// On whose word it rests.
    pub principals: BTreeSet<Principal>,
    /// Why they are believed: of several results, the least reason.
    pub basis: Basis,
}

impl Provenance {
    /// That of a result; `None` if it is nothing to go on with for others.
    pub(super) fn of<R>(finished: &Finished<R>, trust: &Trust) -> Option<Self> {
        let basis = match finished.assurance {
            Assurance::Own => return Some(Self::own()),
            Assurance::Audited => Basis::Audited,
            Assurance::Unaudited if trust.has_earned(finished.principal) => Basis::Earned,
            Assurance::Unaudited | Assurance::Owed => return None,
        };
        let principals = std::iter::once(finished.principal).chain(finished.seconded).collect();
        Some(Self { principals, basis })
    }

    /// That of what the coordinator's own process has computed.
    pub fn own() -> Self {
        Self { principals: [Principal::Coordinator].into(), basis: Basis::Own }
    }

    /// That of what follows from both.
    pub fn and(mut self, other: Self) -> Self {
        self.principals.extend(other.principals);
        self.basis = self.basis.min(other.basis);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::Origin;

    #[test]
    fn what_follows_from_several_results_is_as_sure_as_the_least_of_them() {
        let other = Principal::Anonymous(Origin::of([192, 0, 2, 1].into()));
        let earned = Provenance { principals: [other].into(), basis: Basis::Earned };
        let both = Provenance { principals: [other, Principal::Coordinator].into(), basis: Basis::Earned };
        assert_eq!(Provenance::own().and(earned.clone()), both);
        assert_eq!(earned.and(Provenance::own()), both);
    }
}
