//! Entries that are being made in this process, so that no two workers make the same one.

use std::collections::HashSet;
use std::sync::{Mutex, MutexGuard, PoisonError};

use proto::Digest;
use tokio::sync::Notify;

/// The keys of the entries that are being made.
#[derive(Debug, Default)]
pub struct SingleFlight {
    keys: Mutex<HashSet<Digest>>,
    ended: Notify,
}

/// The right to make an entry: held until it is made, or given up.
#[derive(Debug)]
pub struct Claim<'a>(Option<(&'a SingleFlight, Digest)>);

impl Claim<'_> {
    /// A right that nobody else asks for.
    pub fn unshared() -> Self {
        Self(None)
    }
}

impl SingleFlight {
    /// The right to make an entry, unless somebody has it already.
    pub fn claim(&self, key: Digest) -> Option<Claim<'_>> {
        // Not `then_some`: a claim that is made and dropped would release the key of whoever has it.
        self.keys().insert(key).then(|| Claim(Some((self, key))))
    }

    /// Ready when nobody makes the entry any more; whether it was made is to be looked up.
    pub async fn wait(&self, key: Digest) {
        loop {
            // Listening begins before looking: an end in between is not missed.
            let ended = self.ended.notified();
            if !self.keys().contains(&key) {
                return;
            }
            ended.await;
        }
    }

    fn keys(&self) -> MutexGuard<'_, HashSet<Digest>> {
        // A set is never left half-changed.
        self.keys.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Claim<'_> {
    fn drop(&mut self) {
        if let Some((flight, key)) = self.0 {
            flight.keys().remove(&key);
            flight.ended.notify_waiters();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn an_entry_that_is_being_made_is_waited_for() {
        let flight = SingleFlight::default();
        let key = Digest::of(b"key");
        let claim = flight.claim(key).unwrap();
        assert!(flight.claim(key).is_none());
        assert!(flight.claim(Digest::of(b"other")).is_some());
        let waiting = flight.wait(key);
        tokio::pin!(waiting);
        tokio::select! {
            biased;
            () = &mut waiting => panic!("the claim is still held"),
            () = std::future::ready(()) => {}
        }
        drop(claim);
        waiting.await;
        assert!(flight.claim(key).is_some());
    }
}
