//! What one principal may have of something that all share, over however many connections.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError, Weak};

use proto::Principal;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// Permits of which each principal has as many.
pub struct PrincipalShare {
    permits: usize,
    /// Those of which some are held or waited for.
    shares: Mutex<BTreeMap<Principal, Weak<Semaphore>>>,
}

impl PrincipalShare {
    /// So many permits for each.
    pub fn new(permits: usize) -> Self {
        Self { permits, shares: Mutex::default() }
    }

    /// A permit of this principal's, once there is one.
    pub async fn permit(&self, principal: Principal) -> Option<OwnedSemaphorePermit> {
        self.share(principal).acquire_owned().await.ok() // nobody closes it
    }

    fn share(&self, principal: Principal) -> Arc<Semaphore> {
        let mut shares = self.shares.lock().unwrap_or_else(PoisonError::into_inner);
        shares.get(&principal).and_then(Weak::upgrade).unwrap_or_else(|| {
            shares.retain(|_, share| share.strong_count() > 0);
            let share = Arc::new(Semaphore::new(self.permits));
            shares.insert(principal, Arc::downgrade(&share));
            share
        })
    }
}

#[cfg(test)]
mod tests {
    use proto::{Fingerprint, Introduction};

    use super::*;

    #[tokio::test]
    async fn who_holds_all_of_its_own_waits_and_others_do_not() {
        let share = PrincipalShare::new(2);
        let [one, other] = [1, 2].map(|number| Introduction::sample("host", number).principal);
        let held = [share.permit(one).await, share.permit(one).await];
        let third = share.permit(one);
        tokio::pin!(third);
        tokio::select! {
            biased;
            _ = &mut third => panic!("a third permit"),
            theirs = share.permit(other) => assert!(theirs.is_some()),
        }
        drop(held);
        assert!(third.await.is_some());
    }

    #[tokio::test]
    async fn of_principals_that_hold_nothing_nothing_is_kept() {
        let share = PrincipalShare::new(2);
        for byte in 0..100 {
            drop(share.permit(Principal::Certificate(Fingerprint([byte; 32]))).await);
        }
        assert_eq!(share.shares.lock().unwrap().len(), 1);
    }
}
