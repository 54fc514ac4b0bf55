//! Trust in principals, earned by audits: which answers a second principal has to give as well.
//!
//! Adaptive replication as in BOINC: the first answers of a newcomer are all audited, then the fewer the more have been.

use std::collections::BTreeMap;

use proto::Principal;

/// Answers with which others have agreed before a principal's word is enough beyond its run.
const EARNED: u32 = 10;

/// How much is audited.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Audit {
    /// The least share of all answers, from 0 to 1: of those whom most is known of.
    pub share: f64,
    /// The first answers of a principal that are all audited. 0: the share is all that counts.
    pub first: u32,
}

impl Audit {
    /// Nothing.
    pub const NONE: Self = Self { share: 0.0, first: 0 };
}

/// What is known of the principals that have answered.
#[derive(Debug)]
pub(super) struct Trust {
    audit: Audit,
    /// Answers that were audited or are going to be. One that is found wrong ends all trust: the principal is
    /// quarantined, and what it has answered is computed again.
    audited: BTreeMap<Principal, u32>,
    /// Answers with which another principal has agreed.
    agreed: BTreeMap<Principal, u32>,
}

impl Trust {
    pub(super) fn new(audit: Audit) -> Self {
        Self { audit, audited: BTreeMap::new(), agreed: BTreeMap::new() }
    }

    /// Counts one more answer that is audited.
    pub(super) fn count(&mut self, principal: Principal) {
        let audited = self.audited.entry(principal).or_default();
        *audited = audited.saturating_add(1);
    }

    /// Counts one more answer with which another principal has agreed.
    pub(super) fn agree(&mut self, principal: Principal) {
        let agreed = self.agreed.entry(principal).or_default();
        *agreed = agreed.saturating_add(1);
    }

    /// Whether a principal's word alone is enough for others to go on with: others have agreed with it often enough.
    pub(super) fn has_earned(&self, principal: Principal) -> bool {
        principal == Principal::Coordinator
            || self.agreed.get(&principal).is_some_and(|&agreed| agreed >= EARNED)
    }

    /// Makes a principal a newcomer again.
    pub(super) fn forget(&mut self, principal: Principal) {
        self.audited.remove(&principal);
        self.agreed.remove(&principal);
    }

    /// Whether the answer of a principal to a job with this draw is audited
    /// ([`RunSecret::draw`](crate::secret::RunSecret::draw)).
    pub(super) fn audits(&self, principal: Principal, draw: f64) -> bool {
        principal != Principal::Coordinator && draw < self.share(principal)
    }

    /// The share of a principal's answers that is audited now.
    fn share(&self, principal: Principal) -> f64 {
        let Audit { share, first } = self.audit;
        let audited = self.audited.get(&principal).copied().unwrap_or(0);
        match first {
            0 => share,
            first if audited < first => 1.0,
            _ => share.max(1.0 / f64::from(audited)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::Origin;

    fn principal(byte: u8) -> Principal {
        Principal::Anonymous(Origin::of([192, 0, 2, byte].into()))
    }

    #[test]
    fn a_newcomer_is_audited_always_and_then_the_less_the_more_it_was_but_never_below_the_share() {
        let mut trust = Trust::new(Audit { share: 0.02, first: 10 });
        for _ in 0..10 {
            assert!(trust.audits(principal(1), 0.999));
            trust.count(principal(1));
        }
        assert!(trust.audits(principal(1), 0.099) && !trust.audits(principal(1), 0.1));
        for _ in 10..20 {
            trust.count(principal(1));
        }
        assert!(trust.audits(principal(1), 0.049) && !trust.audits(principal(1), 0.05));
        for _ in 20..1000 {
            trust.count(principal(1));
        }
        assert!(trust.audits(principal(1), 0.019) && !trust.audits(principal(1), 0.02));
        assert!(trust.audits(principal(2), 0.999), "another is a newcomer");
        assert!(!trust.audits(Principal::Coordinator, 0.0));
    }

    #[test]
    fn trust_is_earned_by_agreement_and_not_by_audits_to_come() {
        let mut trust = Trust::new(Audit { share: 0.0, first: 10 });
        (0..100).for_each(|_| trust.count(principal(1)));
        assert!(!trust.has_earned(principal(1)) && trust.has_earned(Principal::Coordinator));
        (0..EARNED).for_each(|_| trust.agree(principal(1)));
        assert!(trust.has_earned(principal(1)));
        trust.forget(principal(1));
        assert!(!trust.has_earned(principal(1)));
    }

    #[test]
    fn without_newcomers_the_share_is_all() {
        for (share, audited) in [(0.0, false), (0.5, true), (1.0, true)] {
            let trust = Trust::new(Audit { share, first: 0 });
            assert_eq!(trust.audits(principal(1), 0.4999), audited);
            assert!(!trust.audits(principal(1), 0.5) || share == 1.0);
        }
    }
}
