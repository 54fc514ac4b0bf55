//! Provenance: on whose word a result is believed by others than the run that has asked for it.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use proto::Principal;
use proto::journal::Assurance;
use proto::task::DescriptorBytes;

use super::trust::Trust;
use crate::store::Grounds;

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
    pub(super) fn of(grounds: Grounds, trust: &Trust) -> Option<Self> {
        let basis = match grounds.assurance {
            Assurance::Own => return Some(Self::own()),
            Assurance::Audited => Basis::Audited,
            Assurance::Unaudited if trust.has_earned(grounds.principal) => Basis::Earned,
            Assurance::Unaudited | Assurance::Owed => return None,
        };
        let principals = std::iter::once(grounds.principal).chain(grounds.seconded).collect();
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

/// Provenances of descriptors of which several results may be known. Equal ones are shared: there may be millions.
#[derive(Default)]
pub struct Provenances {
    descriptors: BTreeMap<DescriptorBytes, Option<Arc<Provenance>>>,
    shared: BTreeSet<Arc<Provenance>>,
}

impl Provenances {
    /// Adds that of one more result about a descriptor; `None`: it is nothing to go on with for others.
    pub fn add(&mut self, descriptor: &DescriptorBytes, one: Option<Provenance>) {
        match self.descriptors.entry(descriptor.clone()) {
            Entry::Vacant(first) => {
                first.insert(one.map(|one| share(&mut self.shared, one)));
            }
            Entry::Occupied(mut all) => {
                let both = all.get_mut().take().zip(one);
                let both = both.map(|(all, one)| Provenance::clone(&all).and(one));
                all.insert(both.map(|both| share(&mut self.shared, both)));
            }
        }
    }

    /// Those of descriptors with which others may go on.
    pub fn into_known(self) -> BTreeMap<DescriptorBytes, Arc<Provenance>> {
        self.descriptors.into_iter().filter_map(|(one, provenance)| Some((one, provenance?))).collect()
    }
}

fn share(shared: &mut BTreeSet<Arc<Provenance>>, provenance: Provenance) -> Arc<Provenance> {
    if let Some(shared) = shared.get(&provenance) {
        return Arc::clone(shared);
    }
    let provenance = Arc::new(provenance);
    shared.insert(Arc::clone(&provenance));
    provenance
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

    #[test]
    fn of_a_descriptor_every_result_counts_and_equal_provenances_are_one() {
        let bytes = |number: u8| DescriptorBytes::from(vec![number]);
        let audited = |number: u8| Provenance {
            principals: [Principal::Anonymous(Origin::of([192, 0, 2, number].into()))].into(),
            basis: Basis::Audited,
        };
        let mut provenances = Provenances::default();
        for (descriptor, one) in [
            (1, Some(audited(1))),
            (2, Some(audited(1))),
            (3, Some(audited(1))),
            (3, Some(audited(2))),
            (4, Some(audited(1))),
            (4, None),
            (4, Some(audited(1))),
            (5, None),
            (5, Some(audited(1))),
        ] {
            provenances.add(&bytes(descriptor), one);
        }
        let known = provenances.into_known();
        let expected = [(1, audited(1)), (2, audited(1)), (3, audited(1).and(audited(2)))];
        assert_eq!(known, expected.map(|(number, one)| (bytes(number), Arc::new(one))).into());
        assert!(Arc::ptr_eq(&known[&bytes(1)], &known[&bytes(2)]));
    }
}
