//! What peers were refused, counted by reason, with a log line now and then.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::sync::{Mutex, PoisonError};

/// Refusals of one coordinator since its start.
#[derive(Default)]
pub struct RefusalLog(Mutex<BTreeMap<&'static str, u64>>);

impl RefusalLog {
    /// How often peers were refused, by reason.
    pub fn counts(&self) -> BTreeMap<&'static str, u64> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Counts a refusal. It is logged the 1st, 2nd, 4th, 8th … time, so that nobody can fill the log from outside.
    pub fn note(&self, reason: &'static str, address: IpAddr) {
        let count = {
            let mut refusals = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            let count = refusals.entry(reason).or_default();
            *count += 1;
            *count
        };
        if count.is_power_of_two() {
            tracing::warn!("transport: {reason}: {count} refused so far, the last from {address}");
        }
    }
}
