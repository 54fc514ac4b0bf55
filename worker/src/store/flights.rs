//! Entries that are being made in this process, so that no two workers make the same one.

use std::collections::HashSet;
use std::sync::{Mutex, MutexGuard, PoisonError};

use proto::Digest;
use tokio::sync::Notify;

/// The keys in flight.
#[derive(Debug, Default)]
pub struct Flights {
    keys: Mutex<HashSet<Digest>>,
    landed: Notify,
}

/// The right to make an entry: held until it is made, or given up.
#[derive(Debug)]
pub struct Claim<'a>(Option<(&'a Flights, Digest)>);

impl Claim<'_> {
    /// A right that nobody else asks for.
    pub fn unshared() -> Self {
        Self(None)
    }
}

impl Flights {
    /// The right to make an entry, unless somebody has it already.
    pub fn claim(&self, key: Digest) -> Option<Claim<'_>> {
        // Only a right that was given may be made: dropping it gives it back.
        self.keys().insert(key).then(|| Claim(Some((self, key))))
    }

    /// Ready when the entry is in flight no longer; whether it was made is to be looked up.
    pub async fn landed(&self, key: Digest) {
        loop {
            // Listening begins before looking: a landing in between is not missed.
            let landed = self.landed.notified();
            if !self.keys().contains(&key) {
                return;
            }
            landed.await;
        }
    }

    fn keys(&self) -> MutexGuard<'_, HashSet<Digest>> {
        // A set is never left half-changed.
        self.keys.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Claim<'_> {
    fn drop(&mut self) {
        if let Some((flights, key)) = self.0 {
            flights.keys().remove(&key);
            flights.landed.notify_waiters();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn an_entry_in_flight_is_waited_for() {
        let flights = Flights::default();
        let key = Digest::of(b"key");
        let claim = flights.claim(key).unwrap();
        assert!(flights.claim(key).is_none());
        assert!(flights.claim(Digest::of(b"other")).is_some());
        let waiting = flights.landed(key);
        tokio::pin!(waiting);
        tokio::select! {
            biased;
            () = &mut waiting => panic!("the claim is still held"),
            () = std::future::ready(()) => {}
        }
        drop(claim);
        waiting.await;
        assert!(flights.claim(key).is_some());
    }
}
