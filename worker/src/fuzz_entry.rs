//! Entry points for fuzzing, one for each reader of bytes from outside: takes anything, returns whether it was accepted,
//! and must not panic, hang or allocate what its input merely claims to need.

use cache::Store;
use proto::Digest;

use crate::executor::decoded::Decoded;
use crate::executor::manifest::Manifest;
use crate::job_slots::JobSlots;
use crate::wire::{self, Job};

/// A reply to a poll, with the jobs in it.
pub fn reply(bytes: &[u8]) -> bool {
    let Some(reply) = wire::decode_reply(bytes) else { return false };
    let mut slots = JobSlots::new(1);
    slots.absorb(reply.clone());
    let sound = |job: &Job| job.task.as_ref().is_ok_and(|task| Decoded::new(task).is_ok());
    reply.jobs.iter().any(sound)
}

/// The list of a split's clouds.
pub fn manifest(bytes: &[u8]) -> bool {
    Manifest::decode(Digest::of(bytes), bytes).is_ok()
}

/// A derived entry that another machine offers.
pub fn entry(store: &Store, kind: &str, key: Digest, bytes: &[u8]) -> bool {
    store.adopt(kind, key, bytes).is_ok()
}
