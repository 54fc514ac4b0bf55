//! What reads bytes from outside, one function a reader, for the fuzz driver of `tests/`: each takes anything, returns
//! whether it was accepted, and must not panic, hang or reserve memory on the word of its input.

use prost::Message as _;
use proto::{Digest, v2};

use crate::desk::Desk;
use crate::store::Store;
use crate::wire::{self, Job};
use crate::workshop::decoded::Decoded;
use crate::workshop::manifest::Manifest;

/// A reply to a poll, with the jobs in it.
pub fn reply(bytes: &[u8]) -> bool {
    let Ok(reply) = v2::PollReply::decode(bytes) else { return false };
    let (reply, mut desk) = (wire::reply(reply), Desk::new(1));
    desk.absorb(reply.clone());
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
