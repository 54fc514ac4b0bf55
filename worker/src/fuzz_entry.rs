//! Entry points for fuzzing, one for each reader of bytes from outside: takes anything, returns whether it was accepted,
//! and must not panic, hang or allocate what its input merely claims to need.

use cache::Store;
use prost::Message as _;
use proto::{Digest, v1};

use crate::executor::manifest::Manifest;
use crate::job_slots::JobSlots;
use crate::wire;

/// A reply to a poll, with the jobs in it.
pub fn reply(bytes: &[u8]) -> bool {
    let Ok(reply) = v1::PollReply::decode(bytes) else { return false };
    let mut slots = JobSlots::new(1);
    slots.absorb(reply.clone());
    reply.jobs.into_iter().filter(|job| wire::task(job.clone()).is_ok()).count() > 0
}

/// The list of a split's clouds.
pub fn manifest(bytes: &[u8]) -> bool {
    Manifest::decode(Digest::of(bytes), bytes).is_ok()
}

/// A derived entry that another machine offers.
pub fn entry(store: &Store, kind: &str, key: Digest, bytes: &[u8]) -> bool {
    store.adopt(kind, key, bytes).is_ok()
}
