//! The key that only the coordinator has: it marks the leases that were granted, and draws the spot checks.

use std::fmt;

use proto::{JobId, Lease, LeaseNonce, Principal, WorkerId};

/// Who calls: a worker, by the principal that answers for the call.
pub type Caller = (WorkerId, Principal);

/// 32 random bytes of a run, which its journal keeps: nothing has to be written before a lease is granted, and the next
/// start still knows the leases of this one.
#[derive(Clone, PartialEq, Eq)]
pub struct RunSecret([u8; 32]);

impl RunSecret {
    /// A secret of these bytes, which must be random.
    pub const fn new(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// Its bytes, for the journal only.
    pub fn reveal(&self) -> [u8; 32] {
        self.0
    }

    /// The lease of an attempt at a job that is granted to a worker, as long as the same principal answers for it.
    pub fn lease(&self, job: JobId, attempt: u32, (worker, principal): Caller) -> Lease {
        let mut hasher = blake3::Hasher::new_keyed(&self.0);
        hasher.update(b"lease");
        hasher.update(&job.0.to_le_bytes());
        hasher.update(&attempt.to_le_bytes());
        hasher.update(&worker.0);
        hasher.update(principal.to_string().as_bytes());
        let mut nonce = [0; 16];
        hasher.finalize_xof().fill(&mut nonce);
        Lease { job, attempt, nonce: LeaseNonce(nonce) }
    }

    /// Whether this lease was granted to this worker.
    pub fn granted(&self, lease: Lease, caller: Caller) -> bool {
        let wide = |LeaseNonce(nonce): LeaseNonce| {
            let mut bytes = [0; 32];
            bytes[..16].copy_from_slice(&nonce);
            blake3::Hash::from_bytes(bytes) // compares in constant time
        };
        wide(lease.nonce) == wide(self.lease(lease.job, lease.attempt, caller).nonce)
    }

    /// A number from 0 to 1 that belongs to a job and that nobody else can tell.
    pub fn draw(&self, job: JobId) -> f64 {
        let mut hasher = blake3::Hasher::new_keyed(&self.0);
        hasher.update(b"draw");
        hasher.update(&job.0.to_le_bytes());
        let mut draw = [0; 8];
        hasher.finalize_xof().fill(&mut draw);
        const BITS: u32 = f64::MANTISSA_DIGITS; // as many as a float holds exactly
        (u64::from_le_bytes(draw) >> (u64::BITS - BITS)) as f64 / (1u64 << BITS) as f64
    }
}

impl fmt::Debug for RunSecret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("RunSecret(…)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proto::{Fingerprint, Origin};

    #[test]
    fn a_lease_is_good_for_its_job_its_attempt_and_its_worker_only() {
        let secret = RunSecret::new([1; 32]);
        let [one, other] = [1, 2].map(|byte| Principal::Certificate(Fingerprint([byte; 32])));
        let [worker, sibling] = [1, 2].map(|byte| WorkerId([byte; 16]));
        let lease = secret.lease(JobId(7), 2, (worker, one));
        assert!(secret.granted(lease, (worker, one)));
        assert!(!secret.granted(lease, (worker, other)) && !secret.granted(lease, (sibling, one)));
        assert!(!secret.granted(Lease { job: JobId(8), ..lease }, (worker, one)));
        assert!(!secret.granted(Lease { attempt: 3, ..lease }, (worker, one)));
        assert!(!secret.granted(Lease { nonce: LeaseNonce::default(), ..lease }, (worker, one)));
        assert!(!RunSecret::new([2; 32]).granted(lease, (worker, one)));
        let origin = Origin::of([192, 0, 2, 1].into());
        let token = secret.lease(JobId(7), 2, (worker, Principal::Token(origin)));
        assert!(!secret.granted(token, (worker, Principal::Anonymous(origin))));
    }

    #[test]
    fn draws_are_spread_over_the_jobs_and_follow_from_the_secret() {
        let [one, other] = [1, 2].map(|byte| RunSecret::new([byte; 32]));
        let below =
            |secret: &RunSecret, bound: f64| (0..4000).filter(|&job| secret.draw(JobId(job)) < bound).count();
        assert!((900..1100).contains(&below(&one, 0.25)), "{}", below(&one, 0.25));
        assert_eq!((below(&one, 0.0), below(&one, 1.0)), (0, 4000));
        assert_eq!(one.draw(JobId(3)), one.clone().draw(JobId(3)));
        assert_ne!(one.draw(JobId(3)), other.draw(JobId(3)));
    }
}
